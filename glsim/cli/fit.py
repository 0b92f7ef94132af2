"""``glsim fit``: fit a sensor to a recording of a real camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import (
    JsonOption,
    check_new,
    check_outputs,
    options,
    print_json,
    print_message,
    print_written,
)
from glsim.core.errors import ConfigError


def fit(
    frames: list[Path],
    out: Annotated[Path, typer.Option("-o", "--out")] = Path("sensor.toml"),
    focal_px: Annotated[float | None, typer.Option(min=1)] = None,
    albedo: Annotated[float, typer.Option(min=0.01, max=2)] = 1.0,
    depth_unit_mm: float | None = None,
    base: str | None = None,
    part: Annotated[str, typer.Option("--frames", metavar="A:B", show_default=False)] = ":",
    proof: Annotated[bool, typer.Option("--proof/--no-proof")] = True,
    topic: str | None = None,
    as_json: JsonOption = False,
) -> int:
    """Measure a camera's noise on a recording by a camera at rest and write a sensor file.

    Record 60 frames or more: the camera at rest, a still wall and furniture at the distances that
    you use, at best one wall at a slant, and a head if faces are the aim. What moves is masked.
    Without infrared all surfaces have the albedo --albedo; with infrared, the brightest have it.
    Wiggling needs undistorted frames of plane walls that cover 0.65 m of distances or more. The
    fixed pattern is also written as a map: NAME_fixed_pattern.npy, float32 mm, NaN where unknown.

    The base sensor is the nearest by its depths (the steps of disparity, focal length times
    baseline), the size and unit of its frames and the correlation of its noise; rivals are printed.
    If two are close, --base must name it. For cameras that match images, and Azure Kinects, the fit
    renders the recording's own surfaces through variants of the base. What a recording does not
    show, or what brings all figures together no nearer, stays the base's.

    The fit uses the first half of the frames. The second half is compared with its replay through
    base and fitted sensor. The table, with standard errors, stands in the head of the written file.
    Fewer than 8 frames are not halved. The exit status is 1 if a recording is refused (no file is
    written), or if the fitted sensor is not better by two standard errors: take the base then.

    Args:
        frames: A recording of a depth camera (folder or file), a data set, or map files.
        out: The sensor file to write, a new one.
        focal_px: Focal length, pixels. Default: stated, or the base sensor's.
        albedo: Albedo of the scene relative to a white wall.
        base: Base sensor: a Kinect V2, an Azure Kinect, or one that matches images. Default: by
            evidence in the frames.
        part: Frames to use: from A, counted from 0, to before B. Default: all.
        proof: Fit one half and test on the other. Needs the extra eval.
    """
    from dataclasses import replace
    from importlib.util import find_spec

    from glsim.bench.fit.base_choice import TIME_OF_FLIGHT, choose_base
    from glsim.bench.fit.fitted_sensor import map_of, write_fitted
    from glsim.bench.fit.proof import LEAST_FRAMES, prove
    from glsim.bench.fit.stereo_sensor import fit_stereo
    from glsim.bench.fit.time_of_flight import fit_time_of_flight
    from glsim.data.maps import open_maps

    check_new(out)
    check_outputs(out, map_of(out))
    recording = open_maps(frames, unit_mm=depth_unit_mm, topic=topic)
    first, last, _ = _part(part).indices(len(recording.frames))
    choice = choose_base(recording, base, focal_px)
    proof = proof and find_spec("sklearn") is not None
    halved = proof and last - first >= LEAST_FRAMES
    used = slice(first, (first + last) // 2 if halved else last)
    if choice.name in TIME_OF_FLIGHT:
        fitted = fit_time_of_flight(recording, choice.name, albedo, focal_px, used)
    else:
        fitted = fit_stereo(recording, choice.name, focal_px, used)
    own, better = fitted.lines["base"], True
    table = ["Not tested on frames of its own."]
    if proof:
        tested = slice(used.stop, last) if halved else used
        proven, better = prove(recording, tested, fitted, own, print_message)
        seen = "unseen by the fit" if halved else "seen by the fit, no test of it"
        title = f"Frames {tested.start} to {last - 1}, {seen}, and their replays:"
        table = [title, *proven]
        if not better:
            table.append(f"Not better than {own} by two standard errors: {own} is recommended.")
            if own == "kinect-v2-fast":  # without halo and haze, so that fitting takes minutes
                table.append("kinect-v2, kinect-v2-sdk simulate rims, too: glsim compare --replay.")
    head = [f"# {line}" for line in (*table, f"Base: {choice.text}")]
    lines = {**fitted.lines, "base": choice.text.replace(choice.name, own, 1)}
    fitted = replace(fitted, text="\n".join(head) + "\n" + fitted.text, lines=lines)
    written = write_fitted(fitted, out)
    if as_json:
        facts = {"proof": table, "better_than_base": better if halved else None}
        print_json({"sensor": str(out), "results": fitted.lines, **facts})
    elif not options.quiet:
        results = [f"{name}: {text}" for name, text in lines.items()]
        typer.echo("\n".join([*results, *table]))
    print_written(written)
    if sentence := recording.sentence(focal_px, "the base sensor", real=True):
        print_message(sentence)
    return 0 if better else 1


def _part(text: str) -> slice:
    """Convert A:B to a slice of frame numbers. Raises ConfigError."""
    first, colon, last = text.partition(":")
    if not colon or not all(not end or end.isdecimal() for end in (first, last)):
        raise ConfigError(f"--frames {text}: give the first frame and the one after the last, 0:60")
    return slice(int(first or 0), int(last) if last else None)
