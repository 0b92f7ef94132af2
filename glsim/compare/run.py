"""Measure two sets of frames and tell them apart: everything that ``glsim compare`` shows."""

from __future__ import annotations

from collections.abc import Callable

from glsim.compare.classifier import Verdict, tell_apart
from glsim.compare.frames import FrameSet
from glsim.compare.light import measure_light
from glsim.compare.patches import KINDS, Patches, edge_patches, surface_patches
from glsim.compare.pattern import measure_pattern
from glsim.compare.report import Comparison, Measurements
from glsim.compare.silhouettes import measure_silhouettes
from glsim.compare.spatial import measure_spatial
from glsim.compare.temporal import measure_temporal, static_pairs
from glsim.compare.validity import measure_invalid


def compare(
    first: FrameSet, second: FrameSet, progress: Callable[[str], None] | None = None
) -> Comparison:
    """Measure both sets and classify their patches. progress: called with the name of each step."""
    say = progress or (lambda _: None)
    measured = []
    for frames in (first, second):
        say(f"measuring {frames.title}")
        measured.append(measure(frames))
    say("classifying patches")
    return Comparison(measured[0], measured[1], classify(first, second, measured))


def measure(frames: FrameSet) -> Measurements:
    """Measure one set of frames."""
    pairs = static_pairs(frames.frames)
    return Measurements(
        title=frames.title,
        frames=len(frames.frames),
        size=(frames.frames[0].camera.width, frames.frames[0].camera.height),
        temporal=measure_temporal(frames.frames, pairs),
        spatial=measure_spatial(frames.frames),
        pattern=measure_pattern(frames.frames),
        light=measure_light(frames.frames, pairs),
        silhouettes=measure_silhouettes(frames.frames),
        invalid=measure_invalid(frames.frames),
    )


def classify(
    first: FrameSet, second: FrameSet, measured: list[Measurements] | None = None
) -> dict[str, Verdict]:
    """Return kind of patch -> verdict. The shadow sides are those measured, each set its own."""
    sides = [
        m.silhouettes.shadow_side
        for m in (measured or [measure(frames) for frames in (first, second)])
    ]
    patches: list[dict[str, Patches]] = [
        surface_patches(frames.frames) | edge_patches(frames.frames, side)
        for frames, side in zip((first, second), sides, strict=True)
    ]
    return {kind: tell_apart(patches[0][kind], patches[1][kind]) for kind in KINDS}
