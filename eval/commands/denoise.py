"""``glsim denoise``: a denoiser on depth maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import Debug, Quiet, Verbose, console, say
from glsim.errors import ConfigError, DatasetError

EXAMPLES = """
[bold]Examples[/bold]

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
        str, typer.Option("-d", "--denoiser", help="As in glsim eval --list, or a checkpoint.")
    ],
    composite: Annotated[
        str, typer.Option(help="Of a soft validity: soft, hard or 'input mask'.")
    ] = "hard",
    depth_unit_mm: Annotated[
        float, typer.Option(min=0.01, max=10, help="Step of the depth files, millimetres.")
    ] = 1.0,
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
    from ..maps import MapFrames, find_maps

    if composite not in COMPOSITES:
        raise ConfigError(f"--composite {composite}: choose one of {', '.join(COMPOSITES)}")
    method = load(denoiser)
    pairs = find_maps(noisy, out)
    frames = MapFrames([source for source, _ in pairs], depth_unit_mm)
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
        parts = compose(method(stack, now), stack[now])
        depth_m = parts["" if "" in parts else composite] * np.float32(0.001)
        write_bytes(encode_png(encode_depth(depth_m, depth_unit_mm)), target)
    say(f"wrote {len(pairs) - failures} denoised depth map(s) to {out}")
    if failures:
        raise DatasetError(f"{failures} of {len(pairs)} maps could not be read")
