"""The modes in which a camera may have delivered a recording: size, decimation, registration.

A camera that matches images delivers depths round(f B steps / n). These say f of the depth camera,
also where files state the colour camera's, or where the camera's library decimated the frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import Frames
from glsim.core.errors import ConfigError
from glsim.core.units import MM_PER_M
from glsim.measures.lattice import Lattice, distinct_values, lattice_of
from glsim.sensors.sensor import Sensor

#: Factors of librealsense's decimation that take medians; to (size // k), padded to whole fours.
_DECIMATIONS = (2, 3, 4)
#: Focal lengths agree within the first share where both are known of this device, and within the
#: second where one is that of other devices of the kind. Chosen: D435s differ by 2.4 %.
_SAME, _ALIKE = 0.025, 0.06
#: Frames with fewer different depths may lie on a lattice that is not found. Chosen.
_MANY_DEPTHS = 200
#: Fewest rows of a depth mode that is registered to colour, and ratios of colour images' sides.
#: Chosen: smaller modes are not registered, since most of a colour image would be empty.
_LEAST_ROWS, _RATIOS = 360, (4 / 3, 16 / 9)


@dataclass(frozen=True)
class Mode:
    """A mode in which frames may have been delivered.

    Attributes:
        image: intrinsics of the delivered frames.
        depth: intrinsics of the depth camera before decimation and registration.
        decimated_by: 1, or the factor of the decimation.
        registered: whether the frames are in the view of the colour camera.
    """

    name: str
    image: Intrinsics
    depth: Intrinsics
    decimated_by: int = 1
    registered: bool = False


def find_lattice(frames: Frames) -> Lattice | None:
    """Find the lattice of the frames' depths; None if the depths lie on no lattice."""
    return lattice_of((frame.measured_mm for frame in frames), frames[0].step_mm)


def lattice_focal_px(sensor: Sensor, frames: Frames, lattice: Lattice | None) -> float:
    """Compute the depth camera's focal length by the lattice and the sensor's baseline, px, or 0.

    0 without a lattice, or for a sensor without one.
    """
    steps = sensor.steps_per_px
    if lattice is None or steps == 0:
        return 0.0
    product = lattice.constant * (frames[0].step_mm or 1.0) / steps
    return product / (MM_PER_M * sensor.rig.baseline_m)


def possible_modes(
    sensor: Sensor, frames: Frames, stated: bool, lattice: Lattice | None
) -> tuple[Mode, ...]:
    """Return the modes of a sensor in which frames may have been delivered, most likely first.

    ``stated``: whether a file or the user states the intrinsics; otherwise these do not count.
    Raises ConfigError if the sensor cannot have made the frames.
    """
    image, unit, rig = frames.intrinsics, frames[0].step_mm or 1.0, sensor.rig
    size, focal = (image.width, image.height), image.fx if stated else 0.0
    if not stated:
        image = rig.for_map((image.height, image.width)).intrinsics
    steps = sensor.steps_per_px
    if lattice is not None and any(s.spec.name.startswith("tof_") for s in sensor.stages):
        raise ConfigError(
            f"{frames.title}: its depths are round({lattice.constant:,.0f} / n): a camera that "
            f"matches images made them, and {sensor.name} measures the time of flight"
        )
    by_lattice = lattice_focal_px(sensor, frames, lattice)
    found = _native(sensor, image, focal, by_lattice)
    found += _decimated(sensor, image, focal, by_lattice)
    found += _registered(sensor, image, focal, by_lattice)
    if found:
        return tuple(found)
    same = [mode for mode in sensor.modes if mode[:2] == size]
    nearest = min((f for *_, f in same or sensor.modes), key=lambda f: _apart(f, by_lattice or f))
    # Frames may be a crop of a mode: no mode's size, and its focal length.
    crop = not same and _apart(nearest, by_lattice or nearest) < _ALIKE
    if by_lattice and not (crop and _apart(focal or by_lattice, by_lattice) < _SAME):
        baseline_mm = MM_PER_M * rig.baseline_m
        says = f", the files say {focal:.0f}" if focal else ""
        raise ConfigError(
            f"{frames.title}: focal length times baseline of its depths is "
            f"{by_lattice * baseline_mm:,.0f} px mm. With {baseline_mm:.1f} mm, as {sensor.name} "
            f"has, the focal length is {by_lattice:.0f} px{says}; its nearest mode "
            f"{'of this size ' if same else ''}has {nearest:.0f} px: another camera's frames"
        )
    if lattice is None and steps and not same:
        depths = distinct_values((f.measured_mm for f in frames), unit)
        if depths.size > _MANY_DEPTHS:
            raise ConfigError(
                f"{frames.title}: no mode of {sensor.name} has {size[0]}x{size[1]} px, and its "
                "depths are in no steps of disparity: another camera made these frames"
            )
    return (Mode("its own grid", image, image),)


def _apart(first: float, second: float) -> float:
    return abs(float(np.log(first / second)))


def _agree(own: float, stated: float, by_lattice: float, factor: float = 1.0) -> float:
    """Return the focal length of a mode whose usual one is ``own``; 0 if the facts contradict it.

    ``factor``: decimation of ``stated``.
    """
    if by_lattice and _apart(own, by_lattice) > _ALIKE:
        return 0.0
    if stated and by_lattice:
        return stated * factor if _apart(stated * factor, by_lattice) < _SAME else 0.0
    if stated:
        return stated * factor if _apart(stated * factor, own) < _ALIKE else 0.0
    return by_lattice or own


def _with_focal(image: Intrinsics, focal: float, own: Intrinsics) -> Intrinsics:
    """Return intrinsics of the size of ``image`` with a focal length and its own or a centre."""
    if image.fx == focal:
        return image
    same = (image.width, image.height) == (own.width, own.height)
    centre = (own.cx, own.cy) if same else (image.width / 2, image.height / 2)
    return Intrinsics(image.width, image.height, focal, focal, *centre)


def _native(sensor: Sensor, image: Intrinsics, focal: float, by_lattice: float) -> list[Mode]:
    for width, height, own in sensor.modes:
        same = (width, height) == (image.width, image.height)
        if same and (f := _agree(own, focal, by_lattice)):
            camera = _with_focal(image, f, sensor.rig.intrinsics)
            return [Mode(f"its mode {width}x{height}, f {f:.0f} px", camera, camera)]
    return []


def _decimated(sensor: Sensor, image: Intrinsics, focal: float, by_lattice: float) -> list[Mode]:
    modes = []
    for k in _DECIMATIONS:
        for width, height, own in sensor.modes:
            size = tuple(4 * -(-(side // k) // 4) for side in (width, height))
            fits = (image.width, image.height) in (size, (width // k, height // k))
            f = _agree(own, focal, by_lattice, k) if fits else 0.0
            if f and sensor.steps_per_px:
                delivered = _with_focal(image, f / k, image)
                cx, cy = k * delivered.cx, k * delivered.cy
                depth = Intrinsics(width, height, f, f, cx, cy)
                name = f"{width}x{height}, f {f:.0f} px, decimated by {k}"
                modes.append(Mode(name, delivered, depth, k))
    return modes


def _registered(sensor: Sensor, image: Intrinsics, focal: float, by_lattice: float) -> list[Mode]:
    colour, own = sensor.rig.colour, sensor.rig.intrinsics
    ratio = image.width / image.height
    if colour is None or not any(colour.position_m):
        return []
    if min(_apart(ratio, r) for r in _RATIOS) > 0.01:
        return []
    # Sizes of one colour camera share its rows: the focal length grows with their number.
    usual = colour.intrinsics.fx * image.height / colour.intrinsics.height
    if focal and _apart(focal, usual) > _ALIKE:
        return []
    size, wide = (image.width, image.height), {1280, 1920, colour.intrinsics.width}
    if not focal and image.width not in wide and size not in {mode[:2] for mode in sensor.modes}:
        return []
    delivered = _with_focal(image, focal or usual, colour.intrinsics)
    for width, height, usual_px in sensor.modes:
        if height >= _LEAST_ROWS and (f := _agree(usual_px, 0.0, by_lattice)):
            depth = _with_focal(Intrinsics(width, height, 0.0, 0.0, 0.0, 0.0), f, own)
            name = f"registered to colour, f {delivered.fx:.0f} px, of {width}x{height}, f {f:.0f}"
            return [Mode(f"{name} px", delivered, depth, registered=True)]
    return []
