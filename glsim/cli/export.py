"""``glsim export``: write frames in other programs' formats, or networks as ONNX or safetensors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import print_message, replaced, split_names
from glsim.core.errors import ConfigError, DatasetError, counted, require_package
from glsim.core.files.cloud import cloud_url
from glsim.data.disk_format import HEADER


def export(
    source: Path,
    out: Annotated[Path, typer.Option("-o", "--out")],
    to: str | None = None,
    layers: str | None = None,
    split: str | None = None,
    frames: Annotated[int | None, typer.Option(min=1)] = None,
) -> None:
    """Export a data set's frames for other programs, or export a trained network.

    Depth is in metres. Principal points are converted: the files give the first pixel's centre the
    coordinates (0, 0), as OpenCV, Open3D and ROS do. Networks become ONNX files, which run without
    PyTorch and are written if they give its depths within 0.01 mm, or safetensors files, which hold
    the weights and the recipe and can hold no code.

    Args:
        source: A data set, or best.pt or last.pt of a run of glsim train.
        out: Folder for the files; an .onnx or .safetensors file of a network.
        to: Formats of a data set's frames, several with commas: ply, exr, ...; a wrong name lists
            them all. hf: the data set itself with its card, for hf upload. Default: npz.
        layers: Depth layers: clean, noisy, expected. Default: all.
        split: Only train, val or test. Default: all.
        frames: Only the first N frames. Default: all.
    """
    if source.is_dir() or cloud_url(source) is not None:
        from glsim.data.export import export_dataset
        from glsim.data.reader import open_dataset

        if (best := source / "best.pt").is_file():
            raise ConfigError(f"{source}: is the folder of a run: give {best}")
        if out.exists() and not out.is_dir():
            raise DatasetError(f"-o {out}: is a file: give a folder")
        formats, kept = split_names(to) or ["npz"], split_names(layers)
        data, again = open_dataset(source), replaced(out)
        done = export_dataset(data, out, formats, layers=kept, split=split, count=frames)
        print_message(f"wrote {counted(done, 'frame')} as {', '.join(formats)} to {out}{again}")
    elif not source.exists():
        raise ConfigError(f"{source}: no such data set or checkpoint")
    elif source.name == HEADER:
        raise ConfigError(f"{source}: give the folder of the data set: {source.parent}")
    elif any(option is not None for option in (to, layers, split, frames)):
        raise ConfigError(f"{source}: is no data set, as --to, --layers, --split, --frames need")
    else:
        _export_network(source, out)


def _export_network(checkpoint: Path, out: Path) -> None:
    from glsim.denoise.registry import ONNX_SUFFIX

    if out.suffix not in (ONNX_SUFFIX, ".safetensors"):
        raise ConfigError(f"-o {out}: the name must end in {ONNX_SUFFIX} or .safetensors")
    for package in ("torch", "onnx", "safetensors"):
        require_package(package, "glsim export of a network", "export")
    from glsim.networks.checkpoint import export_safetensors
    from glsim.train.onnx_export import export_onnx

    again = replaced(out)
    if out.suffix != ONNX_SUFFIX:
        export_safetensors(checkpoint, out)
        print_message(f"wrote {out}{again}")
        return
    differences = export_onnx(checkpoint, out)
    print_message(
        f"wrote {out} ({out.stat().st_size / 1e6:.1f} MB): OpenCV gives PyTorch's depth within "
        f"{differences['depth_mm']:.2g} mm{again}"
    )
