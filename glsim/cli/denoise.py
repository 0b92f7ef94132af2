"""``glsim denoise``: denoise depth maps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import MORE, CalibratedDeviceOption, console, print_message
from glsim.errors import ConfigError, DatasetError, did_you_mean

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from glsim.denoise import MapDenoiser, Method
    from glsim.denoise.interface import Depth, Mask
    from glsim.depth_protocol import DepthProtocol

EXAMPLES = """
[bold]Examples[/bold]

glsim denoise noisy.png -o clean.png                     the shipped network

glsim denoise recording/ -o denoised/ -d face-azure-kinect    the network of one camera

glsim denoise noisy.png -o clean.png --uncertainty sigma.png

glsim denoise noisy.png -o clean.png --denoiser quadric:sigma_px=2.5,cleanup=5

glsim denoise recording/ -o denoised/ -d temporal_median

glsim denoise recording/ -o denoised/ --device my_kinect.toml    calibrated by glsim fit

glsim denoise --watch recording/ -o denoised/ --around face      the nearest head alone

glsim denoise --watch recording/ -o denoised/            maps as they appear, until Ctrl-C

glsim denoise noisy.png -o clean.png -d runs/face-ir/best.pt --infrared infrared.png

glsim denoise noisy.png -o clean.png --out-unit-mm 0.1   whole millimetres cost accuracy

glsim denoise recording/ -o denoised/ --format npy       float32 metres

glsim denoise 'maps/*_noisy.png' -o denoised/ -d run/best.pt
"""


def denoise(
    noisy: Annotated[
        list[str] | None,
        typer.Argument(
            help="Depth maps (16-bit PNG or TIFF, .npy, .exr), folders, or a glob pattern."
        ),
    ] = None,
    *,
    out: Annotated[
        Path, typer.Option("-o", "--out", help="The denoised map, or a folder for them.")
    ],
    denoiser: Annotated[
        str,
        typer.Option(
            "-d",
            "--denoiser",
            help="A name of glsim eval --list, or a checkpoint. face is a network for any camera; "
            "face-kinect-v2, face-azure-kinect and face-stereo know one kind and are better "
            "there.",
        ),
    ] = "face",
    device: CalibratedDeviceOption = None,
    watch: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Denoise the depth maps of a folder and those that appear there, until Ctrl-C.",
        ),
    ] = None,
    infrared: Annotated[
        Path | None,
        typer.Option(
            help="16-bit infrared PNG, or a folder of them named as the maps, for networks that "
            "use it. Default: those beside the maps (*_infrared.png, or *_ir.png of *_depth.png)."
        ),
    ] = None,
    uncertainty: Annotated[
        Path | None,
        typer.Option(
            help="PNG (or folder) for the standard deviation of each depth in steps of 0.01 mm, "
            "0 where there is no depth; only for networks that estimate it."
        ),
    ] = None,
    composite: Annotated[
        str,
        typer.Option(
            help="Use of a network's probability of depth: measured (the input's pixels without "
            "flying and unlikely ones, small holes closed), soft, hard or 'input mask'."
        ),
    ] = "measured",
    around: Annotated[
        str | None,
        typer.Option(
            help="face: denoise only around the nearest head, found by its depth; the rest stays "
            "as measured. For live streams.",
            rich_help_panel=MORE,
        ),
    ] = None,
    depth_unit_mm: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=10,
            help="Step of the depth files, mm. Default: what their data set or they state, else 1.",
        ),
    ] = None,
    out_unit_mm: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=10,
            help="Step of the denoised maps, mm; 0.1 holds 6.5 m. Default: 0.1 for PNG of inputs "
            "that state their step (data sets, maps of this command), else that of the input.",
        ),
    ] = None,
    form: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="Format of the denoised maps: png or tiff (16 bits), npy, exr or tiff-float "
            "(float32 metres). Default: by the suffix.",
            rich_help_panel=MORE,
        ),
    ] = None,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Depth for the denoiser: depth (as measured) or paper (moved so that the nearest "
            "point of each map is at 1 mm, and back). Default: as the network was trained."
        ),
    ] = None,
) -> None:
    """Denoise depth maps; 0 means no depth, in and out.

    Whole numbers are steps of --depth-unit-mm, floats of .npy, .exr and TIFF are metres; .npy and
    .exr are written as float32 metres, PNG and TIFF with 16 bits in steps of --out-unit-mm. PNG
    files state their step.

    Maps keep their names, and their folders where two have the same name; unreadable ones are
    reported and skipped. For denoisers that use
    neighbours in time, the maps of a folder are a sequence in the order of their names; --watch
    gives them earlier frames only. Of a folder that glsim wrote, only the noisy depth is used.
    Maps of a data set with an offset (--protocol paper) are denoised at their distance from the
    camera and written with the same offset.
    """
    from glsim.denoise import MapDenoiser, check_composite, load
    from glsim.depth_protocol import check_protocol
    from glsim.map_files import FORMATS

    check_composite(composite, "--composite")
    if form is not None and form not in FORMATS:
        raise ConfigError(f"--format {form}: {did_you_mean(form, FORMATS)}")
    if bool(noisy) == (watch is not None):
        raise ConfigError("give either depth maps to denoise, or a folder with --watch")
    mapped = MapDenoiser(load(denoiser), device, composite, around)
    chosen = check_protocol(protocol) or mapped.method.protocol or "depth"
    mapped.method.check_protocol(chosen)
    if mapped.device is not None:
        print_message(f"{device}: subtracts {' and '.join(mapped.device.parts)}")
    if watch is not None:
        if uncertainty is not None:
            raise ConfigError("--uncertainty does not go with --watch: denoise the files after it")
        if infrared is not None:
            raise ConfigError("--infrared does not go with --watch, which finds the images itself")
        if form not in (None, "png"):
            raise ConfigError("--format does not go with --watch, which writes PNG")
        _watch(watch, out, mapped, depth_unit_mm, out_unit_mm, chosen)
    else:
        _denoise_files(
            noisy or [], out, mapped, infrared, uncertainty, depth_unit_mm, out_unit_mm, form,
            chosen,
        )  # fmt: skip


def _denoise_files(
    noisy: list[str],
    out: Path,
    denoiser: MapDenoiser,
    infrared: Path | None,
    uncertainty: Path | None,
    depth_unit_mm: float | None,
    out_unit_mm: float | None,
    form: str | None,
    protocol: DepthProtocol,
) -> None:
    import numpy as np

    from glsim.denoise.depth_files import MapFrames, find_maps, left_out_of
    from glsim.denoise.frames import Stacks
    from glsim.denoise.map_steps import map_writer, unit_mm
    from glsim.files.atomic import flush_outputs, write_atomic
    from glsim.files.png import encode_png
    from glsim.recordings.names import left_out_text

    method = denoiser.method
    pairs = find_maps(noisy, out, form)
    sigma_targets = _sigma_targets(noisy, [target for _, target in pairs], uncertainty, method)
    sources = [source for source, _ in pairs]
    step_mm = unit_mm(sources, depth_unit_mm)
    writer = map_writer(pairs, step_mm, form, out_unit_mm)
    images = _infrared_images(sources, infrared, method)
    frames = MapFrames(sources, step_mm, denoiser.device, images, protocol)
    stacks = Stacks(frames, method.before, method.after)
    failures = 0
    for number, (source, target) in enumerate(pairs):
        try:
            stack, now = stacks.around(number, method.before, method.after)
            counts = frames.infrared(number) if method.infrared else None
        except DatasetError as error:
            if len(pairs) == 1:
                raise
            failures += 1
            console.print(f"skipped {source}: {error}", style="yellow", soft_wrap=True)
            continue
        if sigma_targets:
            denoised, sigma_mm = method.with_sigma(stack, now, counts)
        else:
            denoised = method(stack, now, counts)
        depth_mm = denoiser.finished(denoised, stack[now]).depth_mm
        depth_mm = frames.as_stored(number, depth_mm, stacks.sample(number).offset_mm)
        depth_m = depth_mm * np.float32(0.001)
        data = writer.encode(number, source, depth_m)
        write_atomic(data, target, sync=len(pairs) == 1)
        if sigma_targets:
            sigma = encode_png(_encode_sigma(sigma_mm, depth_m > 0))
            write_atomic(sigma, sigma_targets[number], sync=len(pairs) == 1)
    if len(pairs) > 1:
        flush_outputs([target for _, target in pairs], out)
        if uncertainty is not None:
            flush_outputs(sigma_targets, uncertainty)
    if others := left_out_of([Path(text) for text in noisy], "noisy"):
        print_message(f"left out {left_out_text(others)}: no noisy depth")
    count = len(pairs) - failures
    print_message(f"wrote {count} denoised depth map(s) to {out}, in {writer.unit()}")
    if failures:
        raise DatasetError(f"{failures} of {len(pairs)} maps could not be read")


def _watch(
    folder: Path,
    out: Path,
    denoiser: MapDenoiser,
    depth_unit_mm: float | None,
    out_unit_mm: float | None,
    protocol: DepthProtocol,
) -> None:
    """Denoise the maps that appear in a folder until Ctrl-C; then print their number and times."""
    from array import array

    from glsim.denoise.map_steps import unit_mm
    from glsim.denoise.watch import watch_folder

    step_mm = unit_mm(sorted(folder.glob("*.png")) or [folder / "*.png"], depth_unit_mm)
    latency_s, busy_s, failures = array("d"), array("d"), 0
    print_message(f"watching {folder}; Ctrl-C ends")
    try:
        for done in watch_folder(folder, out, denoiser, step_mm, out_unit_mm, protocol):
            if done.problem:
                failures += 1
                message = f"skipped {done.source}: {done.problem}"
                console.print(message, style="yellow", soft_wrap=True)
                continue
            busy_s.append(done.seconds)
            if done.latency_s is not None:
                latency_s.append(done.latency_s)
    except KeyboardInterrupt:  # the way to end it; an unfinished file was removed
        pass
    finally:
        out_step_mm = out_unit_mm or step_mm
        print_message(
            f"wrote {len(busy_s)} denoised depth map(s) to {out}, in steps of {out_step_mm:g} mm"
        )
        if busy_s:
            print_message(f"time of a map: {_spread_ms(busy_s)}")
        if latency_s:
            print_message(f"latency, file complete to map written: {_spread_ms(latency_s)}")
    if failures:
        raise DatasetError(f"{failures} of {failures + len(busy_s)} maps could not be read")


def _spread_ms(seconds: Sequence[float]) -> str:
    import numpy as np

    middle, most = 1000.0 * np.percentile(seconds, (50, 95))
    return f"median {middle:.0f} ms, 95 % within {most:.0f} ms"


def _infrared_images(sources: list[Path], infrared: Path | None, method: Method) -> Sequence[Path]:
    from glsim.denoise.depth_files import infrared_files

    if infrared is not None and not method.infrared:
        raise ConfigError(f"--infrared: {method.label} does not use infrared")
    return infrared_files(sources, infrared) if method.infrared else ()


def _sigma_targets(
    noisy: list[str], maps: list[Path], uncertainty: Path | None, method: Method
) -> list[Path]:
    """List one file per map; empty without --uncertainty.

    Raises ConfigError if the denoiser gives no uncertainty or a file is also a depth output.
    """
    from glsim.denoise.depth_files import find_maps

    if uncertainty is None:
        return []
    if not method.uncertain:
        raise ConfigError(
            f"--uncertainty: {method.label} does not estimate its uncertainty; networks trained "
            "with uncertainty = true do"
        )
    targets = [target for _, target in find_maps(noisy, uncertainty, "png")]
    if {*targets} & {*maps}:
        raise ConfigError(
            f"--uncertainty {uncertainty}: is also the output of the depth: give another name"
        )
    return targets


def _encode_sigma(sigma_mm: Depth, valid: Mask) -> NDArray[np.uint16]:
    """Encode (H, W) sigma, mm, as uint16 in steps of 0.01 mm; at least 1 where valid, else 0."""
    import numpy as np

    steps = np.clip(np.rint(sigma_mm * np.float32(100)), 1, 65535)
    return np.where(valid, steps, 0).astype(np.uint16)
