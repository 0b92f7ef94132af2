"""Choose the writers by the names of the formats, and write the files of each frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from glsim.dataset import Dataset
from glsim.errors import ConfigError, DatasetError, did_you_mean
from glsim.exports.arrays import encode_exr, encode_npy, encode_npz
from glsim.exports.cameras import open3d_json, ros_yaml
from glsim.exports.frames import DEPTH_LAYERS, ExportFrame, export_frames
from glsim.exports.hdf5 import write_hdf5
from glsim.exports.points import encode_pcd, encode_ply, point_cloud
from glsim.exports.rosbag import write_rosbag
from glsim.files.atomic import wrap_write_errors, write_atomic

#: Format -> files of one frame: end of the name -> bytes.
_PER_FRAME: Final[Mapping[str, Callable[[ExportFrame], Iterator[tuple[str, bytes]]]]] = {
    "ply": lambda f: (
        (f"_{layer}.ply", encode_ply(point_cloud(f, layer), f)) for layer in f.depth_m
    ),
    "pcd": lambda f: (
        (f"_{layer}.pcd", encode_pcd(point_cloud(f, layer), f)) for layer in f.depth_m
    ),
    "npy": lambda f: ((f"_{layer}.npy", encode_npy(z)) for layer, z in f.depth_m.items()),
    "exr": lambda f: ((f"_{layer}.exr", encode_exr(z)) for layer, z in f.depth_m.items()),
    "npz": lambda f: iter([(".npz", encode_npz(f))]),
    "open3d": lambda f: iter([("_camera.json", open3d_json(f.camera))]),
    "ros": lambda f: iter([("_camera_info.yaml", ros_yaml(f.camera, f.lens, "glsim"))]),
}
#: Format of a whole data set -> its file or folder in the output folder, and the library it needs.
_WHOLE: Final = {
    "hdf5": ("frames.h5", "h5py"),
    "rosbag": ("frames.bag", "rosbags"),
    "rosbag2": ("frames_ros2", "rosbags"),
}

#: Format -> what it is, for help and documentation.
FORMATS: Final[Mapping[str, str]] = {
    "ply": "point clouds: metres, normals, region, infrared",
    "pcd": "the same for the Point Cloud Library",
    "npy": "float depth, metres",
    "exr": "float depth, metres, OpenEXR",
    "npz": "all of a frame: depth, points, normals, camera, pose, landmarks, record",
    "open3d": "camera, JSON of Open3D",
    "ros": "camera, camera_info YAML of ROS",
    "hdf5": "the whole set in frames.h5 (needs h5py)",
    "rosbag": "the whole set as a ROS 1 bag, frames.bag (needs rosbags)",
    "rosbag2": "the whole set as a ROS 2 bag, frames_ros2 (needs rosbags)",
}


def export_dataset(
    dataset: Dataset,
    out: Path | str,
    formats: Sequence[str],
    *,
    layers: Sequence[str] | None = None,
    split: str | None = None,
    count: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> int:
    """Write the frames of a data set to the folder ``out`` in other formats.

    formats: names of FORMATS. layers: depth layers, by default all (of DEPTH_LAYERS). split: one
    split only. count: the first so many frames. progress: is called with the frames done.
    Files of a frame are OUT/SPLIT/SUBJECT/SEQUENCE_FRAME..., as the images of the data set. They
    replace older ones; a bag does not. Returns the number of frames. Raises ConfigError, also for a
    library that is not installed, and DatasetError if there is no frame, one cannot be read, or a
    file cannot be written.
    """
    out = Path(out)
    for name in formats:
        if name not in FORMATS:
            raise ConfigError(f"no such format {name!r}: {did_you_mean(name, FORMATS)}")
        if name in _WHOLE:
            file, library = _WHOLE[name]
            if find_spec(library) is None:
                raise ConfigError(f"{name} needs {library}: pip install 'glsim[formats]'")
            if name != "hdf5" and (out / file).exists():
                raise DatasetError(f"{out / file}: exists already: remove it, or choose another -o")
    if not formats:
        raise ConfigError(f"give at least one format of {', '.join(FORMATS)}")
    if out.resolve() == dataset.path.resolve():
        raise ConfigError(f"{out}: is the data set itself: choose another folder")

    def frames() -> Iterator[ExportFrame]:
        return export_frames(dataset, layers, split, count)

    done = 0
    writers = [_PER_FRAME[name] for name in formats if name in _PER_FRAME]
    for done, frame in enumerate(frames() if writers else (), start=1):
        for writer in writers:
            for end, data in writer(frame):
                write_atomic(data, out / f"{frame.stem}{end}", sync=False)
        if progress is not None:
            progress(done)
    for name in formats:
        if name in _WHOLE:
            done = _write_whole(name, frames(), out)
    if not done:
        raise DatasetError(f"{dataset}: has no frame {'in ' + split if split else 'at all'}")
    return done


def _write_whole(name: str, frames: Iterator[ExportFrame], out: Path) -> int:
    """Write all frames into one file or folder, renamed into place at the end; return how many."""
    file = _WHOLE[name][0]
    with wrap_write_errors(out / file):
        out.mkdir(parents=True, exist_ok=True)
        # A bag of ROS 2 holds its own name: what is temporary is the folder around it.
        with TemporaryDirectory(prefix=".glsim-", suffix=".tmp", dir=out) as work:
            made = Path(work) / file
            if name == "hdf5":
                done = write_hdf5(frames, made)
            else:
                done = write_rosbag(frames, made, 2 if name == "rosbag2" else 1)
            if done:
                made.replace(out / file)
    return done


__all__ = ["DEPTH_LAYERS", "FORMATS", "export_dataset"]
