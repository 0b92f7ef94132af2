"""Proof of a fit: frames against their replays through the base and the fitted sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from glsim.bench.compare.comparison import compare_sets, lines_of, measure
from glsim.bench.compare.patches import KINDS
from glsim.bench.compare.replay import replay
from glsim.bench.fit.fitted_sensor import FittedSensor, write_fitted
from glsim.core.depth_frame import Frames
from glsim.data.recording import Recording

#: Frames that are replayed, and fewest frames of a recording to halve. Chosen.
_FRAMES, LEAST_FRAMES = 8, 8
#: Parts of the columns whose spread says the errors, and fewest parts with a value. Chosen: a part
#: of 100 px shows gaps and rows.
_PARTS, _LEAST_PARTS = 5, 3
#: Groups and names of measures that are no noise, by their starts.
_LEFT_OUT = ("pixels without depth", "infrared", "IR r^2", "half step")
#: A value and its standard error, NaN = unknown.
Value = tuple[float, float]


def prove(
    recording: Recording, part: slice, fitted: FittedSensor, base: str,
    progress: Callable[[str], None],
) -> tuple[list[str], bool]:  # fmt: skip
    """Compare a part of a recording with its replays through the base and the fitted sensor.

    Returns the lines of a table, and whether the fitted sensor's AUC is lower than its base's by
    two standard errors.
    """
    static = recording.read_static(_FRAMES, part)
    frames = Frames.of([frame.changed(intrinsics=fitted.image) for frame in static], static.title)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "fitted.toml"
        write_fitted(fitted, file)
        shown = []
        for name in (base, str(file)):
            progress(f"rendering {len(frames)} frames through {name}")
            shown.append(replay(frames, name, seed=1))
    lines = [f"{'':56} {'recording':>18} {'base':>18} {'fitted':>18}"]
    gains, errors = [], []
    made = [compare_sets(frames, replayed) for replayed in shown]
    for kind in KINDS:
        first, second = (comparison.verdicts[kind] for comparison in made)
        if math.isfinite(first.auc) and math.isfinite(second.auc):
            pairs = [(v.auc, v.auc_error) for v in (first, second)]
            lines.append(_line(f"AUC of {kind}", [(0.5, math.nan), *pairs]))
            if kind in KINDS[:2]:
                gains.append(abs(first.auc - 0.5) - abs(second.auc - 0.5))
                errors.append(math.hypot(first.auc_error, second.auc_error))
    real, *others = map(values_with_errors, (frames, *shown))
    for name, value in real.items():
        lines.append(_line(name, [value, *(o.get(name, (math.nan,) * 2) for o in others)]))
    gain, error = sum(gains), math.hypot(*errors) if errors else math.inf
    return lines, gain > 2.0 * error


def _line(name: str, values: Sequence[Value]) -> str:
    cells = []
    for value, error in values:
        digits = 3 if abs(value) < 0.2 else 2
        spread = f" +- {error:.{digits}f}" if math.isfinite(error) else ""
        cells.append(f"{value:.{digits}f}{spread}" if math.isfinite(value) else "-")
    return f"{name[:56]:56} " + " ".join(f"{cell:>18}" for cell in cells)


def values_with_errors(frames: Frames) -> dict[str, Value]:
    """Return measures of noise and silhouettes by name, with errors from parts of the image."""
    whole, parts, found = measure(frames), [], {}
    for own in map(measure, _parts(frames)):
        sides = replace(own.silhouettes, shadow_side=whole.silhouettes.shadow_side)
        parts.append(lines_of(replace(own, silhouettes=sides)))
    for key, value in lines_of(whole).items():
        each = np.array([part.get(key, math.nan) for part in parts])
        each = each[np.isfinite(each)]
        error = each.std(ddof=1) / len(each) ** 0.5 if len(each) >= _LEAST_PARTS else math.nan
        if math.isfinite(value) and not any(text.startswith(_LEFT_OUT) for text in key[:2]):
            found[f"{key[1]}; {key[0]}"] = value, float(error)
    return found


def _parts(frames: Frames) -> list[Frames]:
    """Cut frames into parts of the columns, each with its own camera."""
    camera, parts = frames.intrinsics, []
    width = camera.width // _PARTS
    names = [name for name in ("noisy_mm", "infrared") if name in frames[0]]
    for left in range(0, _PARTS * width, width):
        own = replace(camera, width=width, cx=camera.cx - left)
        at = np.s_[:, left : left + width]
        cut = [f.changed({n: f.layer(n)[at] for n in names}, intrinsics=own) for f in frames]
        parts.append(Frames.of(cut, frames.title))
    return parts
