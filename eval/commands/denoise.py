"""``glsim denoise``: a denoiser on depth maps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import Debug, Quiet, Verbose, console, say
from glsim.errors import ConfigError, DatasetError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..denoisers import Method
    from ..types import Depth, Mask

EXAMPLES = """
[bold]Examples[/bold]

glsim denoise noisy.png -o clean.png                     the shipped network

glsim denoise noisy.png -o clean.png --uncertainty sigma.png

glsim denoise noisy.png -o clean.png --denoiser quadric:sigma_px=2.5,cleanup=5

glsim denoise recording/ -o denoised/ -d temporal_median

glsim denoise 'maps/*_noisy.png' -o denoised/ -d run/best.pt
"""


def denoise(
    noisy: Annotated[
        list[str], typer.Argument(help="16-bit depth PNGs, folders of them, or a pattern.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="The PNG of one map, or a folder.")],
    denoiser: Annotated[
        str,
        typer.Option(
            "-d",
            "--denoiser",
            help="As in glsim eval --list, or a checkpoint; face is the shipped network.",
        ),
    ] = "face",
    uncertainty: Annotated[
        Path | None,
        typer.Option(
            help="PNG (or folder) for the standard deviation of each depth in steps of 0.01 mm, "
            "0 where there is no depth; for networks that know it."
        ),
    ] = None,
    composite: Annotated[
        str, typer.Option(help="Of a soft validity: soft, hard or 'input mask'.")
    ] = "hard",
    depth_unit_mm: Annotated[
        float | None,
        typer.Option(
            min=0.01, max=10, help="Step of the depth files, mm. Default: their data set's, else 1."
        ),
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Denoise depth maps; 16 bits in and out, 0 is no depth before and after.

    Maps keep their names. The maps of a folder are a sequence in the order of their names, for
    denoisers that look at neighbours in time. Maps that cannot be read are named and left out.
    """
    import numpy as np

    from glsim.dataset.files import write_bytes
    from glsim.dataset.png import encode_png
    from glsim.frame import encode_depth

    from ..denoisers import COMPOSITES, compose, load
    from ..frames import Stacks
    from ..maps import MapFrames, find_maps, unit_mm

    if composite not in COMPOSITES:
        raise ConfigError(f"--composite {composite}: choose one of {', '.join(COMPOSITES)}")
    method = load(denoiser)
    pairs = find_maps(noisy, out)
    sigma_targets = _sigma_targets(noisy, out, uncertainty, method)
    sources = [source for source, _ in pairs]
    step_mm = unit_mm(sources, depth_unit_mm)
    frames = MapFrames(sources, step_mm)
    stacks = Stacks(frames, method.before, method.after)
    failures = 0
    for number, (source, target) in enumerate(pairs):
        try:
            stack, now = stacks.around(number, method.before, method.after)
        except DatasetError as error:
            if len(pairs) == 1:
                raise
            failures += 1
            console.print(f"skipped {source}: {error}", style="yellow", markup=False)
            continue
        if sigma_targets:
            denoised, sigma_mm = method.with_sigma(stack[now])
        else:
            denoised = method(stack, now)
        parts = compose(denoised, stack[now])
        depth_m = parts["" if "" in parts else composite] * np.float32(0.001)
        write_bytes(encode_png(encode_depth(depth_m, step_mm)), target)
        if sigma_targets:
            write_bytes(encode_png(_encode_sigma(sigma_mm, depth_m > 0)), sigma_targets[number])
    say(f"wrote {len(pairs) - failures} denoised depth map(s) to {out}")
    if failures:
        raise DatasetError(f"{failures} of {len(pairs)} maps could not be read")


def _sigma_targets(
    noisy: list[str], out: Path, uncertainty: Path | None, method: Method
) -> list[Path]:
    """One a map; empty if nobody asked. ConfigError if there is nothing to write, or it clashes."""
    from ..maps import find_maps

    if uncertainty is None:
        return []
    if not method.uncertain:
        raise ConfigError(
            f"--uncertainty: {method.label} does not say how sure it is; networks trained with "
            "uncertainty = true do"
        )
    targets = [target for _, target in find_maps(noisy, uncertainty)]
    if {*targets} & {target for _, target in find_maps(noisy, out)}:
        raise ConfigError(
            f"--uncertainty {uncertainty}: is where the depth goes: give another name"
        )
    return targets


def _encode_sigma(sigma_mm: Depth, valid: Mask) -> NDArray[np.uint16]:
    """(H, W) uint16 in steps of 0.01 mm, at least one step where there is depth, else 0."""
    import numpy as np

    steps = np.clip(np.rint(sigma_mm * np.float32(100)), 1, 65535)
    return np.where(valid, steps, 0).astype(np.uint16)
