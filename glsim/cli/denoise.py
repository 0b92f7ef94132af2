"""``glsim denoise``: denoise depth maps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import CalibratedDeviceOption, console, print_message
from glsim.core.errors import ConfigError, DatasetError, DepthRangeError, did_you_mean

if TYPE_CHECKING:
    from glsim.denoise.denoiser import Denoiser
    from glsim.denoise.frames import MapReader

EXAMPLES = """
glsim denoise noisy.png -o clean.png
glsim denoise recording/ -o denoised/ -d face-video       also by earlier frames
glsim denoise recording/ -o denoised/ -d face:average=8   means of still frames first
glsim denoise recording/ -o denoised/ -d quadric:sigma_px=2.5,cleanup=5
glsim denoise recording/ -o denoised/ --device my_kinect.toml    by glsim fit
glsim denoise noisy.png -o clean.png -d run/best.pt --infrared infrared.png
glsim denoise 'maps/*_noisy.png' -o denoised/ --format npy   float32 metres
"""


def denoise(
    noisy: list[str],
    *,
    out: Annotated[Path, typer.Option("-o", "--out")],
    denoiser: Annotated[str | None, typer.Option("-d", "--denoiser")] = None,
    device: CalibratedDeviceOption = None,
    infrared: Path | None = None,
    uncertainty: Path | None = None,
    composite: str = "measured",
    around: str | None = None,
    depth_unit_mm: Annotated[float | None, typer.Option(min=0.01, max=10)] = None,
    out_unit_mm: Annotated[float | None, typer.Option(min=0.01, max=10)] = None,
    form: Annotated[str | None, typer.Option("--format")] = None,
    protocol: str | None = None,
    channel: str | None = None,
) -> None:
    """Denoise depth maps; 0 means no depth, in and out.

    Whole numbers are steps of --depth-unit-mm; floats are metres, or millimetres if the median of a
    folder says so. Unreadable maps are reported and skipped. For denoisers that use neighbours in
    time a folder is one sequence. Of a folder that glsim wrote, only the noisy depth is used.

    Args:
        noisy: Depth maps (16-bit PNG or TIFF, .npy, .exr), folders, or a glob pattern.
        out: The denoised map, or a folder for them.
        denoiser: A name of glsim eval --list, or a checkpoint. Default: the network of the camera
            that camera.toml, the data set, or the maps' size and values show, else face.
        infrared: 16-bit infrared PNG, or a folder of them named as the maps, for networks that use
            it. Default: those beside the maps.
        uncertainty: PNG (or folder) for the standard deviation of each depth in steps of 0.01 mm,
            of networks that estimate it. Default: none.
        composite: Pixels that get depth: measured (the input's without unlikely ones, small holes
            closed), soft, hard or 'input mask'.
        around: face: denoise only around the nearest head. Default: everywhere.
        depth_unit_mm: Step of the depth files, mm. Default: what they state, else 1.
        out_unit_mm: Step of the denoised maps, mm. Default: 0.1 for PNG if no input is deeper than
            6.5 m, else that of the input.
        form: Format of the denoised maps: png or tiff (16 bits), npy, exr or tiff-float (metres).
            Default: by the suffix.
        protocol: Depth for the denoiser: depth (as measured) or paper (nearest point of each map at
            1 mm). Default: as the network was trained.
        channel: Channel of OpenEXR files. Default: the one whose name says depth.
    """
    from glsim.core.depth_protocol import check_protocol
    from glsim.core.files.atomic import flush_outputs
    from glsim.data.map_files import FORMATS
    from glsim.data.recordings.names import left_out_text
    from glsim.denoise.camera_choice import camera_of, fitting_denoiser
    from glsim.denoise.depth_files import check_infrared, find_maps, map_files, output_step_mm
    from glsim.denoise.frames import MapReader
    from glsim.denoise.registry import load_denoiser

    if form is not None and form not in FORMATS:
        raise ConfigError(f"--format {form}: {did_you_mean(form, FORMATS)}")
    pairs, others = find_maps(noisy, out, form)
    files = map_files([source for source, _ in pairs], depth_unit_mm, channel, infrared)
    name, note = fitting_denoiser(denoiser, camera_of(files))
    loaded = load_denoiser(name, device=device, composite=composite, around=around)
    if note:
        print_message(note)
    chosen = check_protocol(protocol) or loaded.protocol or "depth"
    loaded.check_protocol(chosen)
    if loaded.device is not None:
        print_message(f"{device}: subtracts {' and '.join(loaded.device.parts)}")
    if infrared is not None and not loaded.infrared:
        raise ConfigError(f"--infrared: {loaded.label} does not use infrared")
    out_step_mm = output_step_mm(pairs, files.step_mm, form, out_unit_mm)
    if loaded.infrared:
        check_infrared(files)
    maps = MapReader(files, loaded.device, loaded.infrared, chosen)
    sigma_targets = _sigma_targets(noisy, [t for _, t in pairs], uncertainty, loaded)
    failures, unchanged = _denoise_maps(loaded, maps, pairs, sigma_targets, form, out_step_mm)
    if len(pairs) > 1:
        flush_outputs(out)
        if uncertainty is not None:
            flush_outputs(uncertainty)
    left = f"left out {left_out_text(others)}: no noisy depth" if others else ""
    for note in filter(None, (left, *files.notes, *_advice(name, loaded, maps, unchanged))):
        print_message(note)
    unit = "float32 metres" if out_step_mm is None else f"steps of {out_step_mm:g} mm"
    print_message(f"wrote {len(pairs) - failures} denoised depth map(s) to {out}, in {unit}")
    if failures:
        raise DatasetError(f"{failures} of {len(pairs)} maps could not be read")


def _advice(name: str, denoiser: Denoiser, maps: MapReader, unchanged: int) -> Iterator[str]:
    """Yield what another setting of a network would do for these maps, a line each."""
    if unchanged:
        yield (
            f"{unchanged} map(s) came back unchanged, as their noise passes for rounding and form: "
            f"-d {name}:keep_clean=0 denoises them"
        )
    sees_one_frame = hasattr(denoiser.function, "average") and not denoiser.before
    if sees_one_frame and maps.first_are_still():
        yield f"the first two maps show one still view: -d {name}:average=8 denoises their mean"


def _denoise_maps(
    denoiser: Denoiser,
    maps: MapReader,
    pairs: Sequence[tuple[Path, Path]],
    sigma_targets: Sequence[Path],
    form: str | None,
    step_mm: float | None,
) -> tuple[int, int]:
    """Denoise files and write them; return how many could not be read, and how many stayed."""
    import numpy as np

    from glsim.core.files.atomic import write_atomic
    from glsim.core.files.png import encode_png
    from glsim.core.units import to_metres
    from glsim.data.map_files import encode_map, format_of
    from glsim.denoise.frames import Stacks

    stacks = Stacks(maps.frames(), denoiser.before, denoiser.after)
    alone, failures, unchanged = len(pairs) == 1, 0, 0
    for number, (source, target) in enumerate(pairs):
        try:
            stack, now = stacks.around(number)
            counts = stacks.frame(number).layer("infrared") if denoiser.infrared else None
        except DatasetError as error:
            if alone:
                raise
            failures += 1
            console.print(f"skipped {source}: {error}", style="yellow", soft_wrap=True)
            continue
        estimate = denoiser.estimate(stack, now, counts)
        kept_clean = getattr(denoiser.function, "keep_clean", False)
        unchanged += bool(kept_clean) and np.array_equal(estimate.depth_mm, stack[now])
        depth_mm = estimate.composite(denoiser.composite or "measured")
        depth_mm = maps.as_stored(number, depth_mm, stacks.frame(number).offset_mm)
        depth_m = to_metres(depth_mm)
        try:
            data = encode_map(
                depth_m, form or format_of(target), step_mm or 1.0, "--out-unit-mm", state_unit=True
            )
        except DepthRangeError as error:
            raise DepthRangeError(f"{source}: {error}") from None
        write_atomic(data, target, sync=alone)
        if sigma_targets and estimate.sigma_mm is not None:
            steps = np.clip(np.rint(estimate.sigma_mm * np.float32(100)), 1, 65535)
            sigma = encode_png(np.where(depth_m > 0, steps, 0).astype(np.uint16))
            write_atomic(sigma, sigma_targets[number], sync=alone)
    return failures, unchanged


def _sigma_targets(
    noisy: list[str], maps: list[Path], uncertainty: Path | None, denoiser: Denoiser
) -> list[Path]:
    """List one file per map; empty without --uncertainty. Raises ConfigError."""
    from glsim.denoise.depth_files import find_maps

    if uncertainty is None:
        return []
    if not denoiser.uncertain:
        raise ConfigError(
            f"--uncertainty: {denoiser.label} does not estimate its uncertainty; networks trained "
            "with uncertainty = true do, without --around"
        )
    targets = [target for _, target in find_maps(noisy, uncertainty, "png")[0]]
    if {*targets} & {*maps}:
        raise ConfigError(
            f"--uncertainty {uncertainty}: is also the output of the depth: give another name"
        )
    return targets
