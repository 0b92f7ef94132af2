"""The files of a sensor that another editor may change."""

from __future__ import annotations

from pathlib import Path

from glsim.sensors.sensor import Sensor


class WatchedFiles:
    """The modification times of a sensor's file and of its stages' files.

    Attributes:
        read_at: time of the last reading, seconds since the epoch.
    """

    def __init__(self) -> None:
        self.read_at = 0.0
        self._times: dict[Path, float] = {}

    def have_changed(self, sensor: Sensor) -> bool:
        """Return whether a file has changed since the last call, or a new one since ``read_at``."""
        specs = [stage.spec for stage in sensor.stages]
        sources = [spec.source for spec in specs if spec.source is not None]
        files = {sensor.file, *(Path(spec.file) for spec in specs if spec.source is None)}
        files = files.union(*(source.files for source in sources))
        times = {file: file.stat().st_mtime for file in files if file.is_file()}
        known, self._times = self._times, times
        return any(
            time != known[file] if file in known else time > self.read_at
            for file, time in times.items()
        )
