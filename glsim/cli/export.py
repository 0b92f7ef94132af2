"""``glsim export``: write the network of a checkpoint as an ONNX file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import Debug, Quiet, print_message
from glsim.errors import ConfigError, TrainError

EXAMPLES = """
[bold]Examples[/bold]

glsim export run/best.pt -o face.onnx

glsim denoise noisy.png -o clean.png -d face.onnx        runs without PyTorch
"""


def export(
    checkpoint: Annotated[Path, typer.Argument(help="best.pt or last.pt of a run of glsim train.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="The ONNX file to write.")],
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Export a trained network as ONNX: glsim denoise then runs it without PyTorch.

    The file is written if it gives the depths of PyTorch within 0.01 mm.
    """
    from glsim.denoise.loading import ONNX_SUFFIX

    if out.suffix != ONNX_SUFFIX:
        raise ConfigError(f"-o {out}: the name must end in {ONNX_SUFFIX}")
    try:
        from glsim.train.export import export_onnx
    except ImportError as error:
        raise TrainError(f"export needs PyTorch: pip install 'glsim[export]' ({error})") from None
    differences = export_onnx(checkpoint, out)
    size_mb = out.stat().st_size / 1e6
    print_message(
        f"wrote {out} ({size_mb:.1f} MB): OpenCV gives PyTorch's depth within "
        f"{differences['depth_mm']:.2g} mm"
    )
