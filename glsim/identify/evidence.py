"""What a recording shows of its camera: size, lattice of depths, noise, holes, infrared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.errors import DatasetError
from glsim.measures.disparity import DisparityNoise, measure_disparity_noise, to_disparity
from glsim.measures.frame import FrameSet
from glsim.measures.lattice import Lattice, distinct_values, estimate_lattice
from glsim.measures.rims import find_rims
from glsim.measures.validity import hole_share, hole_share_beside_band
from glsim.recordings.recording import Recording

Array = NDArray[np.float64]

#: Frames that are looked at. Chosen: more say nothing new, and take memory.
FRAMES = 12
#: Fewest rims of a side for a gap. Chosen.
_LEAST_RIMS = 40
#: Sides of the triangles at the corners, as a share of the height; Azure's hexagon cuts off more.
_CORNER = 0.1
#: Steps that files of floats are tried for, mm.
_STEPS_MM = (1.0, 0.1)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the frames of a recording show.

    Attributes:
        size: (width, height), px.
        frames: number of frames in the recording.
        unit_mm: step of the files if the recording states it, else None.
        values: different depths, in steps of the files.
        lattice: of these; None with few values.
        noise: of 1 / depth, 1/m if the step is 1 mm.
        gaps_px: median width of the gaps left of, right of, above and below foregrounds; NaN with
            few of them.
        band_px: median width of the band without depth at the left and at the right border.
        corners: share of the pixels in the four corners that have depth in any frame.
        holes: share of pixels without depth, and of those right of the left band.
        infrared: largest infrared counts; None without infrared.
        stated: what the recording itself says about its camera.
    """

    size: tuple[int, int]
    frames: int
    unit_mm: float | None
    values: Array
    lattice: Lattice | None
    noise: DisparityNoise
    gaps_px: tuple[float, float, float, float]
    band_px: tuple[float, float]
    corners: float
    holes: tuple[float, float]
    infrared: float | None
    stated: str

    def telling(self, constant: float) -> int:
        """Return how many of the values would tell whether a lattice of this constant is there."""
        return int((constant / self.values**2 < 0.7).sum())

    @property
    def has_lattice(self) -> bool:
        """Whether the depths are on a lattice, and enough of them say so."""
        return self.lattice is not None and self.lattice.accepted


def gather_evidence(recording: Recording) -> Evidence:
    """Measure the frames of a recording. Raises DatasetError as ``Recording.read`` does."""
    frames = recording.read(FRAMES)
    depths = [np.asarray(f.depth_mm, np.float64) for f in frames.frames]
    step = _file_step(frames)
    values = distinct_values(depths, step)
    if values.size == 0:
        raise DatasetError(f"{recording.path}: no depth is known: all values are 0 or clipped")
    height, width = depths[0].shape
    stated = recording.stated
    return Evidence(
        (width, height),
        len(recording.files),
        stated.unit_mm,
        values,
        estimate_lattice(values),
        measure_disparity_noise([to_disparity(depth / step) for depth in depths]),
        _gaps(depths),
        _bands(depths),
        _corner_share(depths),
        (hole_share(depths), hole_share_beside_band(depths)),
        _largest_counts(frames),
        stated.sensor or stated.name,
    )


def _file_step(frames: FrameSet) -> float:
    """Return the step of the files, mm; of floats the largest that all are multiples of."""
    step = frames.frames[0].quantum_mm
    if step > 0:
        return step
    some = frames.frames[0].depth_mm
    known = some[np.isfinite(some)].astype(np.float64)
    for step in _STEPS_MM:
        if np.abs(known / step - np.rint(known / step)).max(initial=0.0) < 0.01:
            return step
    return _STEPS_MM[-1]


def _gaps(depths: list[Array]) -> tuple[float, float, float, float]:
    widths: list[float] = []
    for columns in (False, True):
        rims = [find_rims(depth, columns=columns) for depth in depths[:4]]
        for right in (False, True):
            own = np.concatenate([rim.gap_px[rim.right == right] for rim in rims])
            widths.append(float(np.median(own)) if own.size >= _LEAST_RIMS else float("nan"))
    return widths[0], widths[1], widths[2], widths[3]


def _bands(depths: list[Array]) -> tuple[float, float]:
    found: list[list[float]] = [[], []]
    for depth in depths:
        known = np.isfinite(depth)
        known = known[known.any(axis=1)]
        for side, image in zip(found, (known, known[:, ::-1]), strict=True):
            if image.size:
                side.append(float(np.median(image.argmax(axis=1))))
    left, right = (float(np.median(side)) if side else float("nan") for side in found)
    return left, right


def _corner_share(depths: list[Array]) -> float:
    known = np.any([np.isfinite(depth) for depth in depths], axis=0)
    side = max(int(_CORNER * known.shape[0]), 1)
    triangle = np.add(*np.mgrid[:side, :side]) < side
    turned = (known, known[:, ::-1], known[::-1], known[::-1, ::-1])
    return float(np.mean([image[:side, :side][triangle] for image in turned]))


def _largest_counts(frames: FrameSet) -> float | None:
    lights = [frame.infrared for frame in frames.frames if frame.infrared is not None]
    return max(float(light.max()) for light in lights) if lights else None
