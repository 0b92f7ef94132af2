"""Write small recordings in cameras' formats: ROS bag (RealSense), Matroska (Azure Kinect)."""

import json
import shutil
import struct
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[Any]

#: Where librealsense puts things.
SENSOR = "/device_0/sensor_0"


def write_bag(
    file: Path, depths: Sequence[Image], lights: Sequence[Image] | None = None, *,
    topics: tuple[str, str] = (f"{SENSOR}/Depth_0/image/data", f"{SENSOR}/Infrared_1/image/data"),
    options: Mapping[str, float] | None = None, encoding: str = "mono16",
) -> None:  # fmt: skip
    """Write a ROS 1 bag as librealsense does, or a node with other ``topics``.

    Args:
        file: to write.
        depths: (H, W) uint16, or float32 for 32FC1.
        lights: (H, W) uint8 or uint16, of the same moments.
        topics: of depth and of infrared.
        options: name of an option of librealsense -> value.
        encoding: of the depth.
    """
    images: dict[str, tuple[Any, str]] = {topics[0]: ([*depths], encoding)}
    if lights is not None:
        images[topics[1]] = [*lights], "8UC1" if lights[0].dtype == np.uint8 else "16UC1"
    place = "info/camera_info" if "/image/data" in topics[0] else "camera_info"
    height, width = depths[0].shape
    info = {"size": (width, height), "focal": 390.4315, "add_px": 0.5, "p": 0.0}
    infos = {f"{topics[0].partition('/image')[0]}/{place}": info | {"model": "Brown Conrady"}}
    pairs = {"Serial Number": "1234", "Name": "Intel RealSense D435"}
    others: list[tuple[str, str, dict[str, Any]]] = [
        ("/device_0/info", "diagnostic_msgs/msg/KeyValue", {"key": key, "value": value})
        for key, value in pairs.items()
    ]
    others += [
        (f"{SENSOR}/option/{option}/value", "std_msgs/msg/Float32", dict[str, Any](data=value))
        for option, value in (options or {}).items()
    ]
    write_topics(file, images, infos, others=others)


def write_mkv(
    file: Path, tracks: Mapping[str, Sequence[Image]], calibration: Any = None, *,
    codec: str = "rawvideo",
) -> None:  # fmt: skip
    """Write a Matroska file.

    Args:
        file: to write.
        tracks: name -> (H, W) uint16 images, or (H, W, 3) uint8 for a colour track.
        calibration: content of calibration.json, or bytes; None: no attachment.
        codec: "rawvideo" for k4arecorder's b16g, or "ffv1".
    """
    import av

    options = {"allow_raw_vfw": "1", "write_crc32": "0"}
    with av.open(str(file), "w", format="matroska", options=options) as out:
        streams = {}
        for name, images in tracks.items():
            colour = images[0].ndim == 3
            stream = out.add_stream("mjpeg" if colour else codec, rate=30)
            stream.height, stream.width = images[0].shape[:2]
            grey = "gray16be" if codec == "rawvideo" else "gray16le"
            stream.pix_fmt = "yuvj420p" if colour else grey
            stream.metadata["title"] = name
            streams[name] = stream
        if calibration is not None:
            text = calibration if isinstance(calibration, bytes) else json.dumps(calibration)
            data = text if isinstance(text, bytes) else text.encode()
            out.add_attachment("calibration.json", "application/octet-stream", data)
        for number in range(max(len(images) for images in tracks.values())):
            for name, images in tracks.items():
                if number >= len(images):
                    continue
                image = images[number]
                kind = "rgb24" if image.ndim == 3 else "gray16le"
                frame = av.VideoFrame.from_ndarray(image, format=kind)
                frame = frame.reformat(format=streams[name].pix_fmt)
                frame.pts, frame.time_base = number, Fraction(1, 30)
                out.mux(streams[name].encode(frame))
        for stream in streams.values():
            out.mux(stream.encode(None))
    if codec == "rawvideo":
        _name_b16g(file, [i[0].shape for i in tracks.values() if i[0].ndim == 2])


def _name_b16g(file: Path, shapes: Sequence[tuple[int, ...]]) -> None:
    """Write the format name of grey tracks as k4arecorder does, where FFmpeg writes 0."""
    data = file.read_bytes()
    for height, width in set(shapes):
        kind = struct.pack("<HH", 1, 16)
        written = struct.pack("<Iii", 40, width, -height) + kind + bytes(4)
        assert written in data
        named = struct.pack("<Iii", 40, width, height) + kind + b"b16g"
        data = data.replace(written, named)
    file.write_bytes(data)


def azure_calibration() -> dict[str, Any]:
    """Return the JSON of a factory calibration, normalised to 1024 x 1024 pixels."""
    numbers = [
        *(0.513, 0.517, 0.4928, 0.4928),
        *(0.548, -0.021, -0.0027, 0.89, 0.086, -0.0139, 0, 0, -7e-5, 2e-5),
    ]
    colour = {"Purpose": "CALIBRATION_CameraPurposePhotoVideo", "Intrinsics": {}}
    depth = {
        "Purpose": "CALIBRATION_CameraPurposeDepth",
        "Intrinsics": {"ModelParameterCount": 14, "ModelParameters": numbers},
    }
    return {"CalibrationInformation": {"Cameras": [colour, depth]}}


def write_topics(
    file: Path, images: Mapping[str, tuple[Any, str]], infos: Mapping[str, Mapping[str, Any]],
    frames: Mapping[str, str] | None = None, count: int = 1,
    others: Sequence[tuple[str, str, Mapping[str, Any]]] = (), start: int = 0,
) -> None:  # fmt: skip
    """Write a bag of any topics: a ROS 1 bag, or one ROS 2 file ``*.mcap`` or ``*.db3``.

    Args:
        file: to write.
        images: topic -> (H, W) pixels, a list of such images, or bytes of a CompressedImage; and
            the encoding or format.
        infos: topic -> size (width, height), focal; p, d, model, binning, roi and add_px to the
            middle of the image may be given.
        frames: topic -> frame_id; "camera" without.
        count: of images of each topic that has no list.
        others: topic, type and fields of messages without a header.
        start: number of frames before the first.
    """
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    first = file.suffix == ".bag"
    types = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    message = types.types
    stamp = message["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    folder = file.with_suffix("")
    if first:
        bag: Any = rosbag1.Writer(file)
        bag.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if file.suffix == ".mcap" else None
        bag = rosbag2.Writer(folder, version=8, **({"storage_plugin": plugin} if plugin else {}))
    connections: dict[str, Any] = {}
    with bag:

        def put(topic: str, one: Any, numbers: Sequence[int]) -> None:
            data = (types.serialize_ros1 if first else types.serialize_cdr)(one, one.__msgtype__)
            if topic not in connections:
                kind = one.__msgtype__
                connections[topic] = bag.add_connection(topic, kind, typestore=types)
            for number in numbers:
                bag.write(connections[topic], 10**9 + (start + number) * 10**7, data)

        def write(topic: str, kind: str, numbers: Sequence[int], **values: Any) -> None:
            head = {"stamp": stamp, "frame_id": (frames or {}).get(topic, "camera")}
            header = message["std_msgs/msg/Header"](**head | ({"seq": 0} if first else {}))
            put(topic, message[f"sensor_msgs/msg/{kind}"](header=header, **values), numbers)

        for topic, kind, values in others:
            put(topic, message[kind](**values), [0])

        for topic, info in infos.items():
            width, height = info["size"]
            focal, add = info.get("focal", 300.0), info.get("add_px", 0.0)
            centre = (width - 1) / 2 + add, (height - 1) / 2 + add
            matrix = [focal, 0, centre[0], 0, focal, centre[1], 0, 0, 1]
            other = info.get("p", focal)
            names = "DKRP" if first else "dkrp"
            arrays = [
                info.get("d", [0.0] * 5), matrix, np.eye(3).ravel(),
                [other, 0, centre[0], 0, 0, other, centre[1], 0, 0, 0, 1, 0],
            ]  # fmt: skip
            places = ("x_offset", "y_offset", "width", "height")
            roi = dict(zip(places, info.get("roi", [0] * 4), strict=True))
            region = message["sensor_msgs/msg/RegionOfInterest"](**roi, do_rectify=False)
            binning = {name: info.get("binning", 0) for name in ("binning_x", "binning_y")}
            numbers = {n: np.array(v, float) for n, v in zip(names, arrays, strict=True)}
            model = info.get("model", "plumb_bob")
            write(topic, "CameraInfo", range(count), height=height, width=width,
                  distortion_model=model, roi=region, **binning, **numbers)  # fmt: skip
        for topic, (pixels, encoding) in images.items():
            if isinstance(pixels, bytes):
                data = np.frombuffer(pixels, np.uint8)
                write(topic, "CompressedImage", range(count), format=encoding, data=data)
                continue
            given = pixels if isinstance(pixels, list) else [pixels] * count
            for number, image in enumerate(given):
                height, width = image.shape[:2]
                rows = np.ascontiguousarray(image).view(np.uint8).ravel()
                write(topic, "Image", [number], height=height, width=width, encoding=encoding,
                      is_bigendian=0, step=rows.size // height, data=rows)  # fmt: skip
    if not first:
        next(folder.glob(f"*{file.suffix}")).rename(file)
        shutil.rmtree(folder)


def rvl(image: Image) -> bytes:
    """Encode (H, W) uint16 as RVL, as compressed_depth_image_transport does, with its header."""
    nibbles: list[int] = []

    def put(number: int) -> None:
        while number > 7:
            nibbles.append(number & 7 | 8)
            number >>= 3
        nibbles.append(number)

    values, at, before = [int(v) for v in image.ravel()], 0, 0
    while at < len(values):
        end = next((k for k in range(at, len(values)) if values[k]), len(values))
        put(end - at)
        at = end
        end = next((k for k in range(at, len(values)) if not values[k]), len(values))
        put(end - at)
        for value in values[at:end]:
            step = value - before
            put(2 * step if step >= 0 else -2 * step - 1)
            before = value
        at = end
    nibbles += [0] * (-len(nibbles) % 8)
    words = [
        sum(nibble << 28 - 4 * k for k, nibble in enumerate(nibbles[n : n + 8]))
        for n in range(0, len(nibbles), 8)
    ]
    height, width = image.shape
    return bytes(12) + struct.pack(f"<ii{len(words)}I", width, height, *words)
