"""A simulated power cut: the files that remain if only flushed data has reached the disk.

Linux writes names and data when it likes, until a program flushes them. After a cut, the worst of
two kinds can be found: every name is there, but data that was not flushed is not (ext4 writes
names first); or neither data nor names are there that were not flushed.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from glsim.core.files import flush

#: What a folder holds on the disk: name -> inode, or None for a folder.
_Names = dict[str, int | None]


class PowerCuts:
    """A watcher of the folder ``root`` that calls ``on_cut`` before each change and flush.

    Within ``on_cut``, ``write_state`` writes what a power cut at this moment leaves.
    """

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        root: Path,
        kept: Path,
        on_cut: Callable[[PowerCuts, int], None],
    ) -> None:
        """Start watching; ``kept`` is an empty folder on the same file system."""
        self.root, self._kept, self._on_cut = root, kept, on_cut
        self.steps = 0
        self._busy = False
        self._data: dict[int, bytes] = {}  # inode -> what the disk holds
        self._names: dict[Path, _Names] = {}
        for name in ("replace", "rename", "mkdir", "unlink", "rmdir"):
            monkeypatch.setattr(os, name, self._watched(getattr(os, name)))

        def flush_one(descriptor: int) -> None:
            self._step()
            path = Path(f"/proc/self/fd/{descriptor}")
            if path.is_dir():
                self._flush_names(path.readlink())
            else:
                self._data[path.stat().st_ino] = path.read_bytes()

        monkeypatch.setattr(os, "fsync", flush_one)
        monkeypatch.setattr(flush, "_syncfs", lambda: self._flush_all)

    def write_state(self, out: Path, *, names: bool) -> None:
        """Write the remaining files to a new folder; ``names``: all names are on the disk."""
        out.mkdir()
        if names:
            for path in sorted(self.root.rglob("*")):
                copy = out / path.relative_to(self.root)
                if path.is_dir():
                    copy.mkdir()
                else:
                    copy.write_bytes(self._data.get(path.stat().st_ino, b""))
        else:
            self._write_flushed(self.root, out)

    def _write_flushed(self, folder: Path, copy: Path) -> None:
        for name, inode in self._names.get(folder, {}).items():
            if inode is None:
                (copy / name).mkdir()
                self._write_flushed(folder / name, copy / name)
            else:
                (copy / name).write_bytes(self._data.get(inode, b""))

    def _watched(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(path: Any, *rest: Any, **options: Any) -> Any:
            self._step()
            if not self._busy:  # an inode is not used again while it has a name
                at = f"/proc/self/fd/{options['dir_fd']}" if options.get("dir_fd") else ""
                for file in [
                    Path(at, path),
                    *(Path(r) for r in rest[:1] if not isinstance(r, int)),
                ]:
                    if file.is_file():
                        os.link(file, self._kept / str(len(list(self._kept.iterdir()))))
            return function(path, *rest, **options)

        return call

    def _step(self) -> None:
        if self._busy:
            return
        self._busy = True
        try:
            self.steps += 1
            self._on_cut(self, self.steps)
        finally:
            self._busy = False

    def _flush_names(self, folder: Path) -> None:
        if folder == self.root or self.root in folder.parents:
            entries = list(folder.iterdir())
            self._names[folder] = {p.name: None if p.is_dir() else p.stat().st_ino for p in entries}

    def _flush_all(self, _: int) -> int:
        self._step()
        self._flush_names(self.root)
        for path in self.root.rglob("*"):
            if path.is_dir():
                self._flush_names(path)
            else:
                self._data[path.stat().st_ino] = path.read_bytes()
        return 0
