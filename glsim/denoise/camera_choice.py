"""Recognition of the camera that made depth maps, and choice of the network for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from numpy.typing import NDArray

from glsim.data.recording import Recording
from glsim.denoise.registry import SHIPPED
from glsim.measures.lattice import distinct_values, estimate_lattice

#: Size of images that only one kind of camera delivers: (width, height), px -> sensor.
_SIZES: Final = {
    (512, 424): "kinect-v2",
    (640, 576): "azure-kinect",
    (320, 288): "azure-kinect-nfov-binned",
    (512, 512): "azure-kinect-wfov",
    (1024, 1024): "azure-kinect-wfov-unbinned",
}
#: Size of images -> RealSense sensor; for other sizes, the D435.
_STEREO_SIZES: Final = {(640, 480): "realsense-d435-vga"}
#: Largest depth in which a lattice is searched, in steps of the files. The search takes half a
#: second; with steps of 1 mm, a lattice is found in depths above 1 m.
_SEARCHED_STEPS: Final = 12_000
#: Network for one kind of camera -> its largest error on other cameras, divided by the best
#: filter's error there (docs/results/model_card.md).
_ELSEWHERE: Final = {"face-kinect-v2": 1.24, "face-azure-kinect": 2.3, "face-stereo": 2.2}
#: First words of a sensor's name -> network for this kind of camera; for other names, SHIPPED.
_NETWORK_OF: Final = {
    "kinect-v2": "face-kinect-v2",
    "azure-kinect": "face-azure-kinect",
    "femto-bolt": "face-azure-kinect",
    "realsense": "face-stereo",
    "truedepth": "face-stereo",
}


class Camera(NamedTuple):
    """The shipped sensor that resembles a camera ("" if unknown), and the evidence for it."""

    sensor: str
    because: str


def recognise_camera(
    maps_mm: Sequence[NDArray[Any]], step_mm: float, stated: str = "", by: object = None
) -> Camera:
    """Recognise a camera: by its stated sensor, else the size of its images, else their values.

    The depths of an active stereo camera lie on a lattice of disparities.

    Args:
        maps_mm: (H, W) millimetres each, as measured, 0 = no return.
        step_mm: rounding of the values; 0: not rounded.
        stated: name of a stated sensor, or "".
    """
    if stated:
        return Camera(stated, f"{by} states it")
    if not maps_mm:
        return Camera("", "no map can be read")
    height, width = maps_mm[0].shape
    if (sensor := _SIZES.get((width, height))) is not None:
        return Camera(sensor, f"its images have {width} x {height} pixels")
    if step_mm > 0:
        values = distinct_values(maps_mm, step_mm)
        lattice = estimate_lattice(values[values <= _SEARCHED_STEPS])
        if lattice is not None and lattice.accepted:
            sensor = _STEREO_SIZES.get((width, height), "realsense-d435")
            return Camera(sensor, "its depths lie on a lattice of disparities")
    return Camera("", "neither a file nor the maps say what made them")


def camera_of(recording: Recording) -> Camera:
    """Recognise the camera of a recording: by its stated sensor, else by its sampled maps."""
    votes, stated = recording.votes, recording.stated
    return recognise_camera(votes.maps_mm, votes.step_mm, stated.sensor, recording.stated_by)


def network_for(sensor: str) -> str:
    """Return the name of the shipped network for frames of a sensor."""
    kinds = (kind for kind in _NETWORK_OF if sensor.startswith(kind))
    return _NETWORK_OF.get(next(kinds, ""), SHIPPED)


def fitting_denoiser(given: str | None, camera: Camera) -> tuple[str, str]:
    """Return the user's denoiser, or else the network for a camera; and a remark or "".

    The remark tells why a network is chosen, or that the user's is for other cameras.
    """
    fitting = network_for(camera.sensor)
    like = f"like {camera.sensor}, because " if camera.sensor else ""
    if given is None:
        return fitting, f"denoiser {fitting}: {like}{camera.because}; -d chooses another"
    if given not in _ELSEWHERE or not like or given == fitting:
        return given, ""
    return given, (
        f"{given} is for another camera: this one is {like}{camera.because}. Elsewhere its error "
        f"is up to {_ELSEWHERE[given]:g} times that of a filter: -d {fitting} fits"
    )
