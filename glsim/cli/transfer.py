"""``glsim transfer``: score networks on sensors and faces that were not in their training."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import WorkersOption, print_message, print_written
from glsim.cli.progress import study_displays
from glsim.core.errors import ConfigError

EXAMPLES = """
glsim transfer -o transfer                           the filters, tuned under each sensor
glsim transfer -o transfer -d face                   the shipped network beside them
glsim transfer -o transfer --leave sensor:led3d      train without this sensor, score under it
glsim transfer -o transfer --train-on any --ict-root FaceXModel     one training, on random sensors
glsim transfer -o mine --study my_study.toml -d run/best.pt
Repeat the same command to resume an interrupted one.
"""


def transfer(
    out: Annotated[Path, typer.Option("-o", "--out")],
    network: Annotated[
        list[str] | None, typer.Option("--network", "-d", metavar="[LABEL@]FILE")
    ] = None,
    leave: list[str] | None = None,
    train_on: Annotated[list[str] | None, typer.Option(metavar="SENSOR")] = None,
    study: str = "full",
    ict_root: Path | None = None,
    workers: WorkersOption = "auto",
) -> None:
    """Score filters and networks on many sensors; train networks without a chosen sensor.

    Writes transfer.md and transfer.csv: interior error, normals, flips and flying pixels of the
    noisy input, the best tuned filter and the network, for each sensor, source of faces and scene.
    Test people are never in training.

    Args:
        out: Folder for all data and results.
        network: Score this network (best.pt, .onnx, or face) in every cell. Repeatable.
        leave: Train a network without sensor:NAME or source:NAME (of faces) and score it there;
            all: one without each. Repeatable.
        train_on: Train one network on this sensor alone, such as any, and score it under all
            others. Repeatable.
        study: full (ten sensors), small (some minutes, to try the command), or your own .toml file
            like those of eval/studies/transfers/.
        ict_root: ICT-FaceKit's FaceXModel. Default: no such faces.
    """
    from glsim.data.worker_processes import worker_count
    from glsim.eval.studies.runner import Runner
    from glsim.eval.studies.transfer import run_transfer
    from glsim.eval.studies.transfer_study import load_study

    chosen, left_out = load_study(study, ict_root)
    trainings = chosen.trainings(leave or (), train_on or ())
    named: dict[str, str] = {}
    for spec in network or ():
        label, at, file = spec.rpartition("@")
        path = Path(file)
        name = label if at else path.parent.name if path.name == "best.pt" else path.stem
        name = re.sub(r"[^A-Za-z0-9._-]", "-", name) or "network"
        if name in (*named, "filters"):
            raise ConfigError(f"--network {spec}: name it another than {name}: LABEL@{file}")
        named[name] = file
    for line in (chosen.title, *left_out):
        print_message(line)
    runner = Runner(out, worker_count(workers), print_message, study_displays())
    print_written(run_transfer(chosen, runner, named, trainings))
