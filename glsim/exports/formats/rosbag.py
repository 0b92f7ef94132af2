"""A ROS bag of a data set: depth images and camera_info on the topics of a depth camera.

It needs the library rosbags, and no ROS. Depth is 32FC1, metres, NaN without a return (REP 118).
Sequences follow each other with a pause; their own times are kept. Frames without times of their
own, such as scans and recordings, are 1/30 s apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.exports.base import Export
from glsim.exports.formats.cameras import centre_at_zero, coefficients, lens_model
from glsim.exports.frames import ExportFrame
from glsim.geometry.camera import Distortion

#: The optical frame of the camera: x right, y down, z forward (REP 103).
_FRAME_ID = "camera_depth_optical_frame"
#: Namespace of each layer: noisy depth is what the camera gives.
_NAMESPACES = {
    "noisy": "/camera/depth",
    "clean": "/ground_truth/depth",
    "expected": "/ground_truth/expected_depth",
    "infrared": "/camera/ir",
}
_INFO = "/camera/depth/camera_info"
#: Pause between two sequences, and the first stamp, seconds. Chosen; a stamp of 0 means "no time"
#: in ROS.
_PAUSE_S, _START_S = 1.0, 1.0
#: Between frames whose times do not grow, seconds: of a Kinect V2 and most depth cameras.
_STEP_S = 1 / 30


def write_rosbag(frames: Iterator[ExportFrame], out: Path, version: int) -> int:
    """Write frames to a ROS 1 bag file or a ROS 2 bag folder ``out``; return their number.

    ``out`` must not exist.

    Args:
        version: 1 or 2.

    Raises:
        OSError: it cannot be written.
        ImportError: without rosbags.
    """
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    count, sequence, start_s, stamp_s = 0, "", _START_S - _PAUSE_S, 0.0
    with _open(out, version) as bag:
        topics: dict[str, Any] = {}
        for frame in frames:
            own = frame.stem.rpartition("_")[0]
            time_s = float(frame.record.get("time_s", 0.0))
            if own != sequence:
                sequence, start_s = own, max(start_s, stamp_s) + _PAUSE_S
                stamp_s = start_s + time_s
            else:
                later_s = start_s + time_s
                stamp_s = later_s if later_s > stamp_s else stamp_s + _STEP_S
            for topic, message in _messages(types, frame, stamp_s, count, version):
                kind = message.__msgtype__
                if topic not in topics:
                    topics[topic] = bag.add_connection(topic, kind, typestore=types)
                encode = types.serialize_ros1 if version == 1 else types.serialize_cdr
                bag.write(topics[topic], round(stamp_s * 1e9), encode(message, kind))
            count += 1
    return count


def _open(out: Path, version: int) -> Any:
    if version == 1:
        from rosbags.rosbag1 import Writer

        return Writer(out)
    from rosbags.rosbag2 import Writer as Writer2

    return Writer2(out, version=8)  # the older of the two versions that rosbags writes


def _messages(
    types: Any, frame: ExportFrame, stamp_s: float, number: int, version: int
) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of the images of a frame, and of its camera."""
    nanoseconds = round(stamp_s * 1e9)
    time = types.types["builtin_interfaces/msg/Time"](
        sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9
    )
    counter = {"seq": number} if version == 1 else {}
    header = types.types["std_msgs/msg/Header"](**counter, stamp=time, frame_id=_FRAME_ID)
    image = types.types["sensor_msgs/msg/Image"]

    def picture(values: NDArray[Any], encoding: str) -> Any:
        height, width = values.shape
        return image(
            header=header,
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=width * values.itemsize,
            data=np.ascontiguousarray(values).view(np.uint8).ravel(),
        )

    for layer, depth in frame.depth_m.items():
        missing = np.where(depth > 0, depth, np.float32(np.nan))
        yield _topic(layer, frame), picture(missing.astype("<f4"), "32FC1")
    if frame.infrared is not None:
        yield _topic("infrared", frame), picture(frame.infrared.astype("<u2"), "mono16")
    yield _INFO, _camera_info(types, frame, header, version)


def _topic(layer: str, frame: ExportFrame) -> str:
    """Return the topic of a layer; ROS names pictures by whether the lens is taken out."""
    return f"{_NAMESPACES[layer]}/image_{'rect' if frame.lens == Distortion() else 'raw'}"


def _camera_info(types: Any, frame: ExportFrame, header: Any, version: int) -> Any:
    k = centre_at_zero(frame.camera)
    projection = np.hstack([k, np.zeros((3, 1))]).ravel()
    matrices = {
        "d": np.array(coefficients(frame.lens)),
        "k": k.ravel(),
        "r": np.eye(3).ravel(),
        "p": projection,
    }
    if version == 1:
        matrices = {name.upper(): value for name, value in matrices.items()}
    whole = types.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return types.types["sensor_msgs/msg/CameraInfo"](
        header=header,
        height=frame.camera.height,
        width=frame.camera.width,
        distortion_model=lens_model(frame.lens),
        **matrices,
        binning_x=0,
        binning_y=0,
        roi=whole,
    )


BAGS = (
    Export(
        "rosbag",
        "the whole set as a ROS 1 bag, frames.bag (needs rosbags)",
        write=partial(write_rosbag, version=1),
        file="frames.bag",
        library="rosbags",
        replaces=False,
    ),
    Export(
        "rosbag2",
        "the whole set as a ROS 2 bag, frames_ros2 (needs rosbags)",
        write=partial(write_rosbag, version=2),
        file="frames_ros2",
        library="rosbags",
        replaces=False,
    ),
)
