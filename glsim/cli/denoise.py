"""``glsim denoise``: denoise depth maps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import console, print_message
from glsim.core.errors import ConfigError, DatasetError, counted, did_you_mean

if TYPE_CHECKING:
    from glsim.denoise.denoiser import Denoiser
    from glsim.denoise.frames import DenoisedMaps

#: Step of denoised PNG files, mm; the files state it. Rounding adds noise of 0.03 mm; with whole
#: millimetres, a network's error would be 4 to 8 % larger.
_FINEST_MM = 0.1


def denoise(
    noisy: list[str],
    *,
    out: Annotated[Path, typer.Option("-o", "--out")],
    denoiser: Annotated[str | None, typer.Option("-d", "--denoiser")] = None,
    device: Path | None = None,
    infrared: Path | None = None,
    uncertainty: Path | None = None,
    composite: str = "measured",
    around: str | None = None,
    depth_unit_mm: float | None = None,
    topic: str | None = None,
    out_unit_mm: Annotated[float | None, typer.Option(min=0.01, max=10)] = None,
    form: Annotated[str | None, typer.Option("--format")] = None,
    protocol: str | None = None,
    channel: str | None = None,
    along_ray: Annotated[bool, typer.Option("--along-ray")] = False,
) -> None:
    """Denoise depth maps; 0 means no depth, in and out.

    Whole numbers are steps of --depth-unit-mm; floats are metres, or millimetres if the median of a
    folder says so. Unreadable maps are reported and skipped. For denoisers that use neighbours in
    time a folder is one sequence. Of a folder that glsim wrote, only the noisy depth is used.

    Args:
        noisy: Depth maps (16-bit PNG or TIFF, .npy, .exr), folders, or a glob pattern.
        out: The denoised map, or a folder for them.
        denoiser: A name of glsim eval --list, or a checkpoint. Default: the shipped network that
            fits the noise of the maps.
        infrared: 16-bit infrared PNG, or a folder of them named as the maps, for functions that
            use it. Default: those beside the maps.
        uncertainty: PNG (or folder) for the standard deviation of each depth in steps of 0.01 mm,
            of networks that estimate it. Default: none.
        composite: Pixels that get depth: measured (the input's without unlikely ones, small holes
            closed), soft, hard or 'input mask'.
        around: face: denoise only around the nearest head. Default: everywhere.
        out_unit_mm: Step of the denoised maps, mm. Default for PNG: 0.1, or 0.2 if an input is
            deeper than 6.5 m, and 1 for a map beyond 13 m; for TIFF, that of the input.
        form: Format of the denoised maps: png or tiff (16 bits), npy, exr or tiff-float (metres).
            Default: by the suffix.
        protocol: Depth for the denoiser: depth (as measured) or paper (nearest point of each map at
            1 mm). Default: as the network was trained.
    """
    from glsim.core.depth_protocol import check_protocol
    from glsim.data.map_files import FORMATS
    from glsim.data.map_writer import MapWriter
    from glsim.data.maps import open_maps
    from glsim.denoise.frames import DenoisedMaps
    from glsim.denoise.network_choice import choose_network
    from glsim.denoise.registry import load_denoiser

    if form is not None and form not in FORMATS:
        raise ConfigError(f"--format {form}: {did_you_mean(form, FORMATS)}")
    recording = open_maps(
        noisy, unit_mm=depth_unit_mm, channel=channel, infrared=infrared,
        crops=device is not None, needs_camera=False, along_rays=along_ray, topic=topic,
    )  # fmt: skip
    writer = MapWriter(
        recording, noisy, out, form,
        given_mm=out_unit_mm, finest_mm=_FINEST_MM, sigma_out=uncertainty,
    )  # fmt: skip
    name, note = denoiser, ""
    if name is None:
        name, because = choose_network(recording)
        note = f"denoiser {name}: {because}; -d chooses another"
    loaded = load_denoiser(name, device=device, composite=composite, around=around)
    if infrared is not None and not loaded.infrared:
        raise ConfigError(f"--infrared: {loaded.label} does not use infrared")
    if uncertainty is not None and not loaded.uncertain:
        raise ConfigError(
            f"--uncertainty: {loaded.label} does not estimate its uncertainty; networks trained "
            "with uncertainty = true do, without --around"
        )
    chosen = check_protocol(protocol) or loaded.protocol or "depth"
    loaded.check_protocol(chosen)
    parts = "" if loaded.device is None else " and ".join(loaded.device.parts)
    for line in filter(None, (note, parts and f"{device}: subtracts {parts}")):
        print_message(line)
    maps = DenoisedMaps(recording, loaded, chosen)
    failures = writer.write(
        maps.frames,
        skipped=lambda why: console.print(f"skipped {why}", style="yellow", soft_wrap=True),
    )
    notes = (recording.sentence(camera=False), *_advice(name, loaded, maps))
    for line in filter(None, (*notes, writer.sentence("denoised"))):
        print_message(line)
    if failures:
        raise DatasetError(f"{failures} of {counted(len(writer.targets), 'map')} could not be read")


def _advice(name: str, denoiser: Denoiser, maps: DenoisedMaps) -> Iterator[str]:
    """Yield what another setting of a network would do for these maps, a line each."""
    from glsim.denoise.registry import with_parameter
    from glsim.networks.network import NetworkFunction

    if maps.unchanged:
        yield (
            f"{counted(maps.unchanged, 'map')} came back unchanged: the noise passes for rounding "
            f"and form: -d {with_parameter(name, 'keep_clean', 0)} denoises them"
        )
    sees_one_frame = isinstance(denoiser.function, NetworkFunction) and not denoiser.before
    if sees_one_frame and maps.first_are_still:
        of_eight = with_parameter(name, "average", 8)
        yield f"the first two maps show one still view: -d {of_eight} denoises their mean"
