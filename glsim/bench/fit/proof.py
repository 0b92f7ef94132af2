"""Proof of a fit: frames against their replays through the base and the fitted sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from glsim.bench.compare.comparison import compare_sets
from glsim.bench.compare.patches import KINDS
from glsim.bench.compare.replay import Replay
from glsim.bench.fit.figures import figure_text, values_with_errors
from glsim.bench.fit.fitted_sensor import FittedSensor, write_fitted
from glsim.core.depth_frame import Frames
from glsim.core.errors import counted
from glsim.data.recording import Recording

#: Frames that are replayed, and fewest frames of a recording to halve. Chosen.
_FRAMES, LEAST_FRAMES = 8, 8


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
        scene, shown = Replay(frames, base), []
        for name in (base, str(file)):
            progress(f"rendering {counted(len(frames), 'frame')} through {name}")
            shown.append(scene.through(name, seed=1))
    rows = [("", ["recording", "base", "fitted"])]
    gains, errors = [], []
    made = [compare_sets(frames, replayed) for replayed in shown]
    for kind in KINDS:
        first, second = (comparison.verdicts[kind] for comparison in made)
        if math.isfinite(first.auc) and math.isfinite(second.auc):
            pairs = [(v.auc, v.auc_error) for v in (first, second)]
            rows.append((f"AUC of {kind}", ["0.50", *map(figure_text, pairs)]))
            if kind in KINDS[:2]:
                gains.append(abs(first.auc - 0.5) - abs(second.auc - 0.5))
                errors.append(math.hypot(first.auc_error, second.auc_error))
    real, *others = map(values_with_errors, (frames, *shown))
    for name, value in real.items():
        values = [value, *(o.get(name, (math.nan,) * 2) for o in others)]
        rows.append((name, [*map(figure_text, values)]))
    gain, error = sum(gains), math.hypot(*errors) if errors else math.inf
    return _table(rows), gain > 2.0 * error


def _table(rows: Sequence[tuple[str, Sequence[str]]]) -> list[str]:
    """Align the columns of a table; rows "NAME; GROUP" stand indented below a line with GROUP."""
    # Without spaces around +- the table has at most 80 columns.
    split = [(n.partition("; ")[::2], [t.replace(" ", "") for t in texts]) for n, texts in rows]
    first = max(len(name) + 2 * bool(group) for (name, group), _ in split)
    wide = [max(map(len, column)) for column in zip(*(texts for _, texts in split), strict=True)]
    lines, before = [], ""
    for (name, group), texts in split:
        lines += [group] if group and group != before else []
        cells = " ".join(f"{t:>{w}}" for t, w in zip(texts, wide, strict=True))
        lines.append(f"{'  ' * bool(group) + name:{first}} {cells}")
        before = group
    return lines
