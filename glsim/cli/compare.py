"""``glsim compare``: measure two sets of depth frames, and classify their patches."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import (
    STDOUT,
    FigureOption,
    JsonFileOption,
    check_outputs,
    options,
    print_message,
    print_written,
    write_json,
)
from glsim.cli.progress import step_progress


def compare(
    first: Annotated[Path, typer.Argument(metavar="REAL")],
    second: Annotated[Path | None, typer.Argument(metavar="SIMULATED")] = None,
    replay_sensor: Annotated[str | None, typer.Option("--replay", metavar="SENSOR")] = None,
    assignments: Annotated[
        list[str] | None, typer.Option("--set", metavar="STAGE.KEY=VALUE")
    ] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE.md")] = None,
    json_file: JsonFileOption = None,
    figure: FigureOption = None,
    frames: Annotated[int, typer.Option(min=1, max=2000)] = 60,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    smooth_px: Annotated[float | None, typer.Option(min=0.5, max=20)] = None,
    depth_unit_mm: float | None = None,
    focal_px: Annotated[float | None, typer.Option(min=1)] = None,
    topic: str | None = None,
) -> None:
    """Measure two sets of depth frames and tell them apart.

    With --replay the second set is made from the first: its surfaces, silhouettes and reflectivity
    are rendered through a sensor. Scenes, distances and light then agree, and only the camera
    differs. Frames that the camera's library decimated or registered to colour are replayed in that
    mode, which the last line names; a sensor that cannot have made them is refused.

    The table has noise over distance, radius and infrared, correlation, fixed pattern, silhouettes,
    light, and the AUC of a classifier of patches (which needs the extra eval). It goes to stdout
    unless -o is given.

    Args:
        first: A data set of glsim, or a recording of a depth camera (folder or file).
        second: The same, real or simulated.
        replay_sensor: In place of SIMULATED: REAL's surfaces through this sensor. Default: none.
        assignments: Set a parameter of that sensor. Repeatable.
        out: Write the table as Markdown. Default: print it.
        frames: Number of frames of each set; of larger sets, evenly spread frames are used.
        seed: Random seed of the device and the noise of --replay.
        smooth_px: Standard deviation of the widest smoothing that removes the noise of REAL before
            a replay, pixels. Default: 2 times the distance at which the correlation of its noise
            is 0.5. What exceeds the noise, such as noses, stays.
        focal_px: Focal length of both sets, pixels. Default: the stated one, or that of the sensor
            of --replay, or a Kinect V2's.
    """
    from glsim.bench.compare.comparison import compare_sets
    from glsim.bench.compare.replay import compare_replay
    from glsim.core.errors import ConfigError, require_package
    from glsim.core.files.atomic import write_atomic
    from glsim.data.maps import open_maps
    from glsim.data.recordings.folders import whole_recording

    if (second is None) == (replay_sensor is None):
        raise ConfigError("give the simulated frames, or --replay SENSOR to make them of the real")
    if assignments and replay_sensor is None:
        raise ConfigError("--set changes the sensor of --replay: add --replay SENSOR")
    check_outputs(json_file, out, figure)
    opened = [open_maps(first, unit_mm=depth_unit_mm, topic=topic)]
    sentences = []
    with step_progress(f"reading {first}") as step:
        real = opened[0].read(frames, focal_px)
        if second is not None:
            own = topic if whole_recording([second]) else None
            opened.append(open_maps(second, unit_mm=depth_unit_mm, topic=own))
            other = opened[1].read(frames, focal_px)
            comparison = compare_sets(real, other, progress=step)
        else:
            require_package("scipy", "--replay", "eval")
            stated = focal_px is not None or not opened[0].assumed
            comparison, other, sentence = compare_replay(
                real, str(replay_sensor), stated, step,
                seed=seed, assignments=assignments or (), smooth_px=smooth_px,
            )  # fmt: skip
            sentences.append(sentence)
    table = comparison.as_markdown()
    written = []
    if json_file is not None:
        written += write_json(comparison.as_json(), json_file)
    if out is not None:
        write_atomic(table.encode(), out)
        written.append(out)
        for line in comparison.summary():
            print_message(line.replace("*", ""))
    elif not options.quiet and json_file != STDOUT:
        typer.echo(table, nl=False)
    if figure is not None:
        from glsim.bench.figures import draw_comparison

        draw_comparison(comparison, real, other, figure)
        written.append(figure)
    print_written(written)
    sentences += [
        recording.sentence(focal_px, replay_sensor or "", real=recording is opened[0])
        for recording in opened
    ]
    for note in filter(None, dict.fromkeys(sentences)):
        print_message(note)
