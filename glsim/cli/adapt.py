"""``glsim adapt``: adapt a shipped network to a camera by its own noisy frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import check_outputs, print_message, replaced
from glsim.core.errors import ConfigError, require_package


def adapt(
    recording: Path,
    out: Annotated[Path, typer.Option("-o", "--out")],
    denoiser: Annotated[str | None, typer.Option("-d", "--denoiser")] = None,
    steps: Annotated[int, typer.Option(min=25, max=10_000)] = 200,
    seed: int = 0,
    depth_unit_mm: float | None = None,
    topic: str | None = None,
) -> None:
    """Adapt a shipped network to your camera by its noisy frames alone, without clean depth.

    Record at least four frames with camera and scene at rest, which show the noise, and then what
    you like. One still pair is held back: if it does not come nearer, nothing is written. Take the
    network for scenes like those that you recorded; it may be worse on others.

    Args:
        recording: Depth maps of the camera: a folder, a bag, ...
        out: The adapted network, an .onnx file.
        denoiser: The shipped network to begin with. Default: that which denoise takes.
        steps: Steps of 8 crops of 64 px.
    """
    from glsim.data.maps import open_maps
    from glsim.denoise.network_choice import choose_network
    from glsim.denoise.registry import NETWORKS, ONNX_SUFFIX

    for package in ("torch", "onnx"):
        require_package(package, "glsim adapt", "laptop")
    from glsim.train.adapt import adapt as adapt_network

    if out.suffix != ONNX_SUFFIX:
        raise ConfigError(f"-o {out}: the name must end in {ONNX_SUFFIX}")
    check_outputs(out)
    again = replaced(out)
    frames = open_maps(recording, unit_mm=depth_unit_mm, topic=topic)
    if sentence := frames.sentence(camera=False, real=True):
        print_message(sentence)
    network = denoiser or choose_network(frames)[0]
    if network not in NETWORKS or network == "face-video":
        raise ConfigError(f"-d {network}: give a shipped network that sees one frame")
    done = adapt_network(frames.read(), out, network, steps, seed, print_message)
    print_message(
        f"wrote {out}: a held-back still frame lies {done.after_mm:.2f} mm from the other's mean "
        f"after {done.steps} steps, by {network} {done.before_mm:.2f}, raw {done.raw_mm:.2f}; "
        f"errors that stay in all frames are not seen by this and may remain{again}"
    )
