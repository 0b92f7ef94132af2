"""A whole data set in one HDF5 file, one group per split. It needs h5py."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from glsim.errors import DatasetError
from glsim.exports.export import Export
from glsim.exports.formats.arrays import geometry_arrays
from glsim.exports.formats.cameras import centre_at_zero, coefficients
from glsim.exports.frames import ExportFrame
from glsim.files.atomic import to_json

_UNITS = "depth: metres along the optical axis, 0 = none; K, pixels: first pixel's centre at (0, 0)"


def write_hdf5(frames: Iterator[ExportFrame], out: Path) -> int:
    """Write frames to ``out`` and return their number.

    Each group train, val, test has N rows: LAYER_m (N, H, W) float32 of each depth layer;
    infrared, reason, regions; K (N, 3, 3) and distortion (N, 5) float64; head_to_camera (N, 4, 4),
    landmarks_m and landmarks_px of sets whose records have them; stem and record (JSON), strings.
    The same frames give the same bytes. Raises DatasetError if frames differ in size or layers,
    OSError if the file cannot be written, and ImportError without h5py.
    """
    import h5py

    count = 0
    with h5py.File(out, "w") as file:
        file.attrs["units"] = _UNITS
        for frame in frames:
            group = file.require_group(frame.stem.partition("/")[0])
            if "regions" not in group.attrs and frame.region_names:
                names = {str(n): name for n, name in sorted(frame.region_names.items())}
                group.attrs["regions"] = to_json(names, out.name)
            _append(group, _row(frame), frame.stem, h5py.string_dtype())
            count += 1
    return count


def _row(frame: ExportFrame) -> dict[str, Any]:
    row: dict[str, Any] = {f"{layer}_m": depth for layer, depth in frame.depth_m.items()}
    for name in ("infrared", "reason", "regions"):
        if getattr(frame, name) is not None:
            row[name] = getattr(frame, name)
    if frame.true_normals is not None:
        row["normals"] = frame.true_normals
    row["K"] = centre_at_zero(frame.camera)
    row["distortion"] = np.array(coefficients(frame.lens))
    row |= geometry_arrays(frame)
    return row | {"stem": frame.stem, "record": to_json(frame.record, frame.stem)}


def _append(group: Any, row: dict[str, Any], stem: str, text: Any) -> None:
    """Append one row to the arrays of a group; the first row makes them."""
    if not len(group):
        for name, value in row.items():
            shape = np.shape(value)
            image = len(shape) >= 2 and shape[0] > 4
            group.create_dataset(
                name,
                shape=(0, *shape),
                maxshape=(None, *shape),
                dtype=text if isinstance(value, str) else np.asarray(value).dtype,
                chunks=(1, *shape) if image else True,
                compression="gzip" if image else None,
                compression_opts=1 if image else None,
                shuffle=image,
            )
    if set(group) != set(row):
        odd = sorted(set(group) ^ set(row))[0]
        raise DatasetError(f"{stem}: {odd} is in some frames only: export splits or npz instead")
    for name, value in row.items():
        array = group[name]
        if array.shape[1:] != np.shape(value):
            raise DatasetError(
                f"{stem}: {name} is {np.shape(value)}, before {array.shape[1:]}: HDF5 needs frames "
                "of one size, export npz instead"
            )
        array.resize(len(array) + 1, axis=0)
        array[-1] = value


HDF5 = Export(
    "hdf5",
    "the whole set in frames.h5 (needs h5py)",
    write=write_hdf5,
    file="frames.h5",
    library="h5py",
)
