"""Recognition of the camera of depth maps, and the intrinsics of maps that state none."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final, NamedTuple

from glsim.core.camera import DEFAULT_INTRINSICS, DEFAULT_SENSOR, Intrinsics
from glsim.core.units import MM_PER_M
from glsim.data.recordings.camera_file import StatedCamera
from glsim.data.recordings.files import Votes
from glsim.measures.lattice import lattice_of

#: Size of images that only one kind of camera delivers: (width, height), px -> sensor.
SENSORS_OF_SIZE: Final = {
    (512, 424): "kinect-v2",
    (640, 576): "azure-kinect",
    (320, 288): "azure-kinect-nfov-binned",
    (512, 512): "azure-kinect-wfov",
    (1024, 1024): "azure-kinect-wfov-unbinned",
}
#: Sensors that deliver depth in steps of disparity.
_IN_STEPS: Final = (
    *("realsense-d435", "realsense-d455", "realsense-d415", "realsense-d405"),
    *("oak-d-pro", "kinect-v1-pattern"),
)
#: Focal lengths of devices of one kind agree within this share. Chosen: D435s differ by 2.4 %.
_ALIKE: Final = 0.06


class Camera(NamedTuple):
    """The shipped sensor that resembles a camera ("" if unknown), and the evidence for it.

    ``focal_px``: focal length that the depths tell by the sensor's baseline, px; 0 if they do not.
    """

    sensor: str
    because: str
    focal_px: float = 0.0

    def intrinsics(self, shape: tuple[int, ...]) -> tuple[str, Intrinsics]:
        """Return the sensor whose intrinsics maps of a shape (H, W) are assumed to have; and these.

        Without a shipped sensor they are those of the default. Maps of another size than all modes
        of the sensor are taken for crops.
        """
        name, camera, focal_px = DEFAULT_SENSOR, DEFAULT_INTRINSICS, self.focal_px
        if self.sensor not in ("", name):
            from glsim.sensors.sensor import load_sensor, shipped_sensors

            if self.sensor in shipped_sensors():  # a sensor file may run code
                sensor = load_sensor(self.sensor)
                name, camera = sensor.name, sensor.rig.intrinsics
                sizes = {(h, w): f for w, h, f in reversed(sensor.modes)}
                focal_px = focal_px or sizes.get((shape[0], shape[1]), 0.0)
        focal = (focal_px, focal_px) if focal_px else None
        return name, camera.for_map((shape[0], shape[1]), focal)


def recognise_camera(stated: StatedCamera, stated_by: Path | None, votes: Votes) -> Camera:
    """Recognise a camera by its stated sensor or name, the size of its images, or their values."""
    if stated.sensor:
        return Camera(stated.sensor, f"{stated_by} states it")
    size = width, height = votes.maps_mm[0].shape[::-1]
    if stated.name:
        from glsim.sensors.sensor import sensor_names

        named = stated.name.lower().replace(" ", "-")
        if known := sorted((name for name in sensor_names() if name in named), key=len):
            return Camera(known[-1], f"{stated_by} states it")
    if (sized := SENSORS_OF_SIZE.get(size)) is not None:
        return Camera(sized, f"its images have {width} x {height} pixels")
    if (lattice := lattice_of(votes.maps_mm, votes.step_mm)) is None:
        return Camera("", "neither a file nor the maps say what made them")
    from glsim.sensors.sensor import load_sensor

    steps_mm = lattice.constant * votes.step_mm
    found = [
        (s, steps_mm / (MM_PER_M * s.rig.baseline_m * s.steps_per_px), *mode)
        for s in map(load_sensor, _IN_STEPS)
        for mode in s.modes
    ]
    sensor, focal_px, w, h, usual_px = min(
        found, key=lambda mode: abs(math.log(mode[1] / mode[4])) + (mode[2:4] != size)
    )
    if abs(math.log(focal_px / usual_px)) > _ALIKE:  # decimated to the size of another mode
        focal_px = usual_px
    # Smaller maps of the same ratio of sides are decimated, others are crops.
    scale = width / w if width * h == height * w else 1.0
    because = "its depths lie on a lattice of disparities of f B = "
    because += f"{steps_mm / sensor.steps_per_px:,.0f} px mm"
    return Camera(sensor.name, because, focal_px * scale)
