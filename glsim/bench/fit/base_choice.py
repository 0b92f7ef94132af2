"""Choice of the base sensor of a fit by evidence in the frames, with its rivals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from glsim.bench.compare.replay_noise import half_distance_px
from glsim.bench.modes import find_lattice, lattice_focal_px, possible_modes
from glsim.core.depth_frame import Frames
from glsim.core.errors import ConfigError, did_you_mean
from glsim.core.units import MM_PER_M
from glsim.data.recording import Recording
from glsim.measures.lattice import Lattice
from glsim.sensors.sensor import Sensor, load_sensor, sensor_names

#: Base -> distance at which its noise is half as alike, px: real frames of each kind (of binned
#: Azure Kinects measured elsewhere). A Kinect V2 is fitted from its fast sensor.
_KINDS = {
    "kinect-v2-fast": 1.7, "azure-kinect": 2.4, "azure-kinect-nfov-binned": 1.8,
    "kinect-v1-pattern": 1.9, "truedepth": 3.2, "realsense-d405": 6.5, "realsense-d415": 5.0,
    "realsense-d435": 6.0, "realsense-d455": 6.0,
}  # fmt: skip
#: Bases of a fit of time of flight; others match images.
TIME_OF_FLIGHT = (
    "kinect-v2-fast", "kinect-v2", "kinect-v2-sdk", "azure-kinect", "azure-kinect-nfov-binned",
)  # fmt: skip
#: Modes of a base that are sensors of their own, by the size of the frames.
_OF_SIZE = {("realsense-d435", (640, 480)): "realsense-d435-vga"}
#: Weights of evidence, in units of one standard deviation: focal lengths of one kind differ by 3 %,
#: correlation lengths by 40 %; another kind of steps, size or unit counts as given. Chosen.
_FOCAL, _BASELINE, _ALIKE, _MOST_ALIKE = 0.03, 0.02, 0.4, 2.5
_NO_LATTICE, _OTHER_SIZE, _OTHER_UNIT, _MOST = 3.0, 3.0, 2.0, 5.0
#: Two bases are told apart from this difference of their distances on; a base fits up to the
#: second number. Chosen.
_APART, _TOO_FAR = 1.0, 6.0
#: Number of frames that are looked at.
_FRAMES = 12


@dataclass(frozen=True)
class Rival:
    """A base sensor and its distance from the recording; ``why``: what speaks against it."""

    name: str
    distance: float
    why: str


@dataclass(frozen=True)
class BaseChoice:
    """The chosen base sensor of a fit; ``rivals``: all bases, nearest first, unless it is named."""

    name: str
    rivals: tuple[Rival, ...] = ()

    @property
    def text(self) -> str:
        """The evidence in one line."""
        if not self.rivals:
            return f"{self.name}, as named"
        others = "; ".join(f"{r.name} {r.distance:.1f} ({r.why})" for r in self.rivals[1:4])
        return f"{self.name}, distance {self.rivals[0].distance:.1f}; rivals: {others}"


def choose_base(recording: Recording, base: str | None, focal_px: float | None) -> BaseChoice:
    """Choose the sensor that a fit extends: the named one, the stated one, or the nearest.

    Raises ConfigError if no fit starts from the named sensor, or if evidence decides for none.
    """
    stated = recording.stated.sensor
    if base is not None:
        if base not in TIME_OF_FLIGHT and load_sensor(base).matcher is None:
            known = [*TIME_OF_FLIGHT, *(n for n in sensor_names() if load_sensor(n).matcher)]
            bases = did_you_mean("", known)
            raise ConfigError(f"--base: no fit starts from {base!r}; {bases}")
        return BaseChoice(base)
    if stated and (stated in TIME_OF_FLIGHT or load_sensor(stated).matcher is not None):
        return BaseChoice(stated)
    frames = recording.read(_FRAMES, focal_px)
    known_focal = focal_px is not None or recording.camera is not None
    lattice, some = find_lattice(frames), list(frames[:: max(len(frames) // 4, 1)])
    half_px = half_distance_px(some)
    found = [
        _rival(load_sensor(name), alike, frames, known_focal, lattice, half_px)
        for name, alike in _KINDS.items()
    ]
    rivals = sorted(found, key=lambda rival: rival.distance)
    first, second = rivals[:2]
    if first.distance > _TOO_FAR or second.distance - first.distance < _APART:
        near = ", ".join(f"{r.name} {r.distance:.1f} ({r.why})" for r in rivals[:3])
        missing = "" if known_focal else " or its focal length by --focal-px"
        raise ConfigError(
            f"{recording.path}: cannot tell which camera this is: name it by --base{missing}; "
            f"distances: {near}"
        )
    size = frames.intrinsics.width, frames.intrinsics.height
    return BaseChoice(_OF_SIZE.get((first.name, size), first.name), tuple(rivals))


def _rival(
    sensor: Sensor, alike_px: float, frames: Frames, known_focal: bool, lattice: Lattice | None,
    half_px: float,
) -> Rival:  # fmt: skip
    """Compute the distance of one base, and name the evidence against it, strongest first."""
    image, unit, steps = frames.intrinsics, frames[0].step_mm or 1.0, sensor.steps_per_px
    alike = min(_times(half_px, alike_px, _ALIKE), _MOST_ALIKE)
    terms = {f"noise alike over {half_px:.1f} px": alike}
    if (lattice is None) != (steps == 0):
        terms["steps of disparity" if lattice else "no steps of disparity"] = _NO_LATTICE
    of_size = [f for w, h, f in sensor.modes if (w, h) == (image.width, image.height)]
    lattice_px = lattice_focal_px(sensor, frames, lattice)
    try:
        modes = possible_modes(sensor, frames, known_focal, lattice)
        fits = modes[0].name != "its own grid"
        if fits and lattice_px:
            usual = min((f for *_, f in sensor.modes), key=lambda f: abs(math.log(f / lattice_px)))
            product = f"f B {lattice_px * MM_PER_M * sensor.rig.baseline_m:,.0f} px mm"
            terms[product] = _times(lattice_px, usual, _BASELINE)
    except ConfigError:
        fits, terms["f B of no mode"] = False, _MOST
    if not fits and not of_size:
        terms[f"no mode of {image.width}x{image.height}"] = _OTHER_SIZE
    elif not fits and known_focal:
        terms[f"f {image.fx:.0f} px"] = min(_times(image.fx, f, _FOCAL) for f in of_size)
    fine = sensor.name in ("truedepth", "realsense-d405")
    if fine != (unit < 0.5):
        terms[f"unit {unit:g} mm"] = _OTHER_UNIT
    against: Sequence[str] = sorted(terms, key=lambda name: -terms[name])
    why = ", ".join(name for name in against[:2] if terms[name] > 0.5) or "nothing against it"
    return Rival(sensor.name, math.sqrt(sum(t**2 for t in terms.values())), why)


def _times(value: float, usual: float, spread: float) -> float:
    return min(abs(math.log(value / usual)) / spread, _MOST)
