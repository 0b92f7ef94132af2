"""Cache of the model on disk: one folder per version of its source files."""

from __future__ import annotations

import hashlib
import logging
import zlib
from pathlib import Path
from typing import Final

import numpy as np

from glsim.faces.ict_facekit.model import IDENTITY_MODES, MorphableModel
from glsim.faces.ict_facekit.topology import Topology
from glsim.files.cache import cache_folder, write_cache_folder

_CACHE_VERSION: Final = "3"  # raise it when the content of the cache changes
_LOG = logging.getLogger(__name__)


def cache_path(files: list[Path]) -> Path:
    """Return the cache of these source files; it depends on their names, sizes and times."""
    digest = hashlib.sha256(_CACHE_VERSION.encode())
    for path in files:
        status = path.stat()
        digest.update(f"\0{path.name}\0{status.st_size}\0{status.st_mtime_ns}".encode())
    return cache_folder() / f"ict-facekit-{digest.hexdigest()[:16]}"


def write_cache(cache: Path, model: MorphableModel) -> MorphableModel:
    """Write the cache atomically and return the model mapped from it.

    Logs a warning and returns ``model`` itself if the folder is not writable.
    """

    def fill(folder: Path) -> None:
        np.save(folder / "basis.npy", model.basis)
        np.savez(
            folder / "topology.npz",
            faces=model.topology.faces,
            kept=model.topology.kept,
            region=model.topology.region,
            checksum=zlib.crc32(model.basis.data),
        )

    write_cache_folder(cache, fill, "the face model")
    return read_cache(cache, model.expressions) or model


def read_cache(cache: Path, expressions: tuple[str, ...]) -> MorphableModel | None:
    """Map the cached model; None if there is no cache or a damaged one."""
    if not cache.is_dir():
        return None
    try:
        with (cache / "topology.npz").open("rb") as file, np.load(file) as parts:
            topology = Topology(parts["faces"], parts["kept"], parts["region"])
            checksum = int(parts["checksum"])
        basis = np.load(cache / "basis.npy", mmap_mode="r")
        shape = (1 + IDENTITY_MODES + len(expressions), 3 * len(topology.kept))
        if basis.shape != shape or zlib.crc32(basis.data) != checksum:
            raise ValueError("the content does not match its checksum")
    except Exception as error:  # damaged bytes raise errors of any type
        _LOG.warning("%s: damaged (%s), rebuilding it", cache, error)
        return None
    return MorphableModel(basis, expressions, topology)
