"""Measure two sets of frames and tell them apart: everything that ``glsim compare`` shows."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from glsim.bench.compare.classifier import Verdict, tell_apart
from glsim.bench.compare.patches import KINDS, Patches, edge_patches, surface_patches
from glsim.bench.compare.report import Comparison, Measurements
from glsim.bench.measures.light import measure_light
from glsim.bench.measures.pattern import measure_pattern
from glsim.bench.measures.silhouettes import measure_silhouettes
from glsim.bench.measures.spatial import measure_spatial
from glsim.bench.measures.static import static_pairs, view_numbers
from glsim.bench.measures.temporal import measure_temporal
from glsim.bench.measures.validity import measure_invalid
from glsim.core.depth_frame import Frames


def compare_sets(
    first: Frames, second: Frames, progress: Callable[[str], None] | None = None
) -> Comparison:
    """Measure both sets and classify their patches; ``progress`` is called with each step's name.

    Without scikit-learn there are no verdicts of the classifier.
    """
    say = progress or (lambda _: None)
    measured = []
    for frames in (first, second):
        say(f"measuring {frames.title}")
        measured.append(_measure(frames))
    verdicts: dict[str, Verdict] = {}
    if find_spec("sklearn") is None:
        say("no classifier: it needs scikit-learn: pip install 'glsim[eval]'")
    else:
        say("classifying patches")
        patches: list[dict[str, Patches]] = [
            surface_patches(frames) | edge_patches(frames, m.silhouettes.shadow_side)
            for frames, m in zip((first, second), measured, strict=True)
        ]
        views = [view_numbers(frames) for frames in (first, second)]
        verdicts = {
            kind: tell_apart(patches[0][kind], patches[1][kind], views[0], views[1])
            for kind in KINDS
        }
    return Comparison(measured[0], measured[1], verdicts)


def _measure(frames: Frames) -> Measurements:
    pairs = static_pairs(frames)
    return Measurements(
        title=frames.title,
        frames=len(frames),
        size=(frames.intrinsics.width, frames.intrinsics.height),
        temporal=measure_temporal(frames, pairs),
        spatial=measure_spatial(frames),
        pattern=measure_pattern(frames),
        light=measure_light(frames, pairs),
        silhouettes=measure_silhouettes(frames),
        invalid=measure_invalid(frames),
    )
