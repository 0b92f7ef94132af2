"""Proof of a fit: unseen frames against their replays through the base and the fitted sensor."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from glsim.bench.compare.comparison import compare_sets
from glsim.bench.compare.patches import KINDS
from glsim.bench.compare.replay import replay
from glsim.bench.fit.fitted_sensor import FittedSensor, write_fitted
from glsim.core.depth_frame import Frames
from glsim.data.recording import Recording

#: Frames of the second half that are replayed, and fewest frames of a recording to halve. Chosen.
_FRAMES, LEAST_FRAMES = 8, 8
#: Rows of a comparison in the table: starts of their groups, and their names.
_ROWS = (
    ("residual of surfaces", ("p10", "median", "p90")),
    ("correlation of the residual", tuple(f"{k} px along {xy}" for xy in "xy" for k in (1, 2, 3))),
    ("fixed pattern", ("rows", "columns")),
    ("pixels unlike", ("single holes", "single depths")),
    ("silhouettes", ("width of the gap, median", "invalid share of 8 px outside")),
)  # fmt: skip


@dataclass(frozen=True)
class Proof:
    """Lines of a table: how well replays through base and fitted sensor match unseen frames.

    ``better``: whether the fitted sensor's AUC is lower than its base's by two standard errors.
    """

    lines: tuple[str, ...]
    better: bool


def prove(
    recording: Recording,
    part: slice,
    fitted: FittedSensor,
    base: str,
    progress: Callable[[str], None],
) -> Proof:
    """Compare the frames in ``part``, which a fit did not see, with their replays."""
    unseen = recording.read_static(_FRAMES, part)
    frames = Frames.of([frame.changed(intrinsics=fitted.image) for frame in unseen], unseen.title)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "fitted.toml"
        write_fitted(fitted, file)
        made = []
        for name in (base, str(file)):
            progress(f"rendering {len(frames)} frames through {name}")
            made.append(compare_sets(frames, replay(frames, name, seed=1)))
    lines = [f"{'':44} {'recording':>10} {'base':>14} {'fitted':>14}"]
    gains, errors = [], []
    for kind in KINDS:
        first, second = (comparison.verdicts[kind] for comparison in made)
        if math.isfinite(first.auc) and math.isfinite(second.auc):
            cells = [f"{v.auc:.2f} +- {v.auc_error:.2f}" for v in (first, second)]
            lines.append(f"{'AUC of ' + kind:44} {'.50':>10} {cells[0]:>14} {cells[1]:>14}")
            if kind in KINDS[:2]:
                gains.append(abs(first.auc - 0.5) - abs(second.auc - 0.5))
                errors.append(math.hypot(first.auc_error, second.auc_error))
    own = {(row.group, row.name): row.second for row in made[1].rows}
    for row in made[0].rows:
        chosen = any(row.group.startswith(g) and row.name in names for g, names in _ROWS)
        if chosen and math.isfinite(row.first):
            name = f"{row.name}; {row.group}"
            values = [row.first, row.second, own.get((row.group, row.name), math.nan)]
            real, *others = (f"{value:.2f}" for value in values)
            lines.append(f"{name[:44]:44} {real:>10} {others[0]:>14} {others[1]:>14}")
    gain, error = sum(gains), math.hypot(*errors) if errors else math.inf
    return Proof(tuple(lines), gain > 2.0 * error)
