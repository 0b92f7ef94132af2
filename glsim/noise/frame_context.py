"""The data of a frame that noise stages read besides its layers: seeds, sizes, emitters, lens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from glsim.core.array_types import Floats
from glsim.core.camera import Distortion, Point, SensorRig
from glsim.core.rect import Rect
from glsim.core.seeds import stage_seed

#: Layers by name: (h, w) or (h, w, components) float32 arrays of the frame's window.
Layers = Mapping[str, Floats]

_ORIGIN: Point = (0.0, 0.0, 0.0)


def _two(points: Sequence[Point]) -> tuple[Point, Point]:
    """Return the first two points; a single point twice; without a point the origin twice."""
    first = points[0] if points else _ORIGIN
    return first, points[1] if len(points) > 1 else first


@dataclass(frozen=True, kw_only=True)
class FrameContext:
    """The data of a frame that noise stages read besides its layers: seeds, sizes, emitters, lens.

    Args:
        window: the part of the frame that the layers hold.
        seed, sequence_seed, device_seed: 64-bit seeds; in a stage's ``view`` its own 32-bit seeds.
        focal_baseline_px_m: focal length times baseline, pixels times metres; 0 without an emitter.
        emitter_m: start of the light's path (SensorRig.emitter_m).
        supersample: samples per pixel and axis of the layer fine_seen; if 1, fine_seen is clean.
        focal_px: horizontal focal length.
        emitters_m: the first two emitters; an emitter that the rig lacks lights nothing.
        imagers_m: the two imagers; for an imager that the rig lacks, its last one.
        second_view_m: vector from the first to the second of the two views that are matched.
        subject_m: depth of the head, for which cameras set their exposure.
        lens: lens distortion, also for frames that are delivered without it.
        projector_tan: tangents of half the projectors' field of view, horizontal and vertical; 0
            without a projected image.
    """

    window: Rect
    width: int
    height: int
    seed: int
    sequence_seed: int
    device_seed: int
    time_s: float = 0.0
    focal_baseline_px_m: float = 0.0
    emitter_m: Point = _ORIGIN
    modulation_mhz: tuple[float, ...] = ()
    supersample: int = 1
    nearest_m: float = 0.0
    focal_px: float = 1.0
    emitters_m: tuple[Point, Point] = (_ORIGIN, _ORIGIN)
    imagers_m: tuple[Point, Point] = (_ORIGIN, _ORIGIN)
    second_view_m: Point = _ORIGIN
    subject_m: float = 1.0
    lens: Distortion = field(default_factory=Distortion)
    projector_tan: tuple[float, float] = (0.0, 0.0)

    @property
    def batched(self) -> bool:
        """Whether the layers are tensors of maps (B, H, W), see ``twins.batch.WordContext``."""
        return not isinstance(self.seed, int)

    @classmethod
    def for_frame(cls, rig: SensorRig, **given: Any) -> Self:
        """Make the context of a frame of ``rig``; ``given`` sets or replaces fields."""
        image = rig.intrinsics
        of_rig = {
            "width": image.width,
            "height": image.height,
            "focal_baseline_px_m": image.fx * rig.baseline_m,
            "focal_px": image.fx,
            "emitters_m": _two([e.position_m for e in rig.emitters]),
            "imagers_m": _two(rig.imagers_m),
            "lens": rig.distortion,
        }
        named = ("emitter_m", "modulation_mhz", "supersample", "second_view_m", "projector_tan")
        return cls(**{**of_rig, **{name: getattr(rig, name) for name in named}, **given})

    def view(self, stage: str) -> FrameContext:
        """Return the context with the seeds of the stage named ``stage``."""
        return replace(
            self,
            seed=stage_seed(self.seed, stage),
            sequence_seed=stage_seed(self.sequence_seed, stage),
            device_seed=stage_seed(self.device_seed, stage),
        )
