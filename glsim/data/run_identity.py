"""The identity of a data set: the header entries that decide its bytes and must not change.

A run resumed with other settings or input files would make a data set of two different halves.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from glsim.core.errors import ConfigError
from glsim.core.files.atomic import to_json
from glsim.core.files.contents import text_hash
from glsim.core.reason import Reason
from glsim.data.chunks import ChunkPlan
from glsim.data.code_version import code_version
from glsim.data.disk_format import FORMAT, FORMAT_VERSION
from glsim.settings.schema import Settings
from glsim.settings.toml_tables import flattened

#: Settings that do not change any frame: a run may be resumed with other values.
_FREE_SETTINGS = ("settings.strict",)

#: Descriptions of records and layers in the header: of each data set, and of optional layers.
_UNITS = {
    "clean, noisy": "uint16 steps of depth_unit_mm along the optical axis, 0 = no return; "
    "add depth_offset_mm of the record",
    "infrared": "uint16 counts",
    "infrared_right": "uint16 counts, the image of a stereo camera's second imager",
    "reason": "uint8 codes, see reasons",
    "intrinsics": "pixels; the centre of the first pixel is at (0.5, 0.5)",
    "time_s": "seconds since the start of the sequence",
    "head_to_camera": "4 x 4, rows first: canonical head frame (x the subject's left, y up, z out "
    "of the face) to camera frame (x right, y down, z forward), both in metres",
    "seeds": "64 bits as hexadecimal digits",
}
_OPTIONAL_UNITS = {
    "normals": "uint16, three channels: unit normal of the mesh in the camera frame (x right, y "
    "down, z forward), (code - 32768) / 32767; 0, 0, 0 = no surface",
    "color": "uint8, three channels: sRGB; 0, 0, 0 = no surface",
    "expected": "as clean, with the sensor's systematic error: wiggling, offset, delay in skin",
}


@dataclass(frozen=True)
class InputHashes:
    """Hashes of all inputs of a data set apart from its settings.

    Attributes:
        stages: file -> hash of each noise stage, with the files that GLSL includes.
        sources: "number kind" of each source -> name of each file -> hash.
        arithmetic: see ``glsim.data.arithmetic``.
    """

    stages: Mapping[str, str] = field(default_factory=dict)
    sources: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    arithmetic: str = ""

    def identity(self) -> dict[str, Any]:
        """Return the header's entries: one hash per stage file and one per source."""
        sources = {name: text_hash(json.dumps(dict(files))) for name, files in self.sources.items()}
        return {"stages": dict(self.stages), "sources": sources, "arithmetic": self.arithmetic}

    def changed_since(self, before: InputHashes) -> str:
        """Name the first stage file or source file whose hash differs from ``before``."""
        for file, hash in before.stages.items():
            if self.stages.get(file) != hash:
                return f"stage file {file}"
        for source, files in before.sources.items():
            now = self.sources.get(source, {})
            for name in [*files, *now]:
                if files.get(name) != now.get(name):
                    return f"source {source}: {name}"
        return "an input"


def make_identity(
    settings: Settings, plan: ChunkPlan, sensor: Mapping[str, Any], renderer: str
) -> dict[str, Any]:
    """Return the header entries that decide a data set's bytes, or say how to read them."""
    optional = {n: text for n, text in _OPTIONAL_UNITS.items() if n in settings.output.layers}
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "glsim_version": code_version(),
        "settings": settings.model_dump(mode="json", exclude_none=True),
        "sensor": dict(sensor),
        "renderer": renderer,
        "planned_frames": plan.frames,
        "plan": plan.fingerprint(),
        "depth_unit_mm": settings.output.depth_unit_mm,
        "units": _UNITS | optional,
        "reasons": {str(int(r)): {"name": r.name.lower(), "help": r.help} for r in Reason},
    }


def refuse_difference(out: str, begun: Mapping[str, Any], identity: Mapping[str, Any]) -> None:
    """Raise ConfigError if an entry of ``identity`` differs from the ``begun`` data set's."""
    simulated, simulates = (bool(h.get("sensor", {}).get("stages")) for h in (begun, identity))
    if simulated != simulates:
        what = "a simulated data set" if simulated else "an imported recording"
        raise ConfigError(f"{out} is {what}: choose a new folder")
    old, new = flattened(begun), flattened(json.loads(to_json(identity, out)))
    for name in new | old:
        compared = name.split(".")[0] in identity and name not in _FREE_SETTINGS
        if compared and old.get(name) != new.get(name):
            raise ConfigError(_difference(out, name, old.get(name), new.get(name)))


def _difference(out: str, name: str, old: Any, new: Any) -> str:
    table, _, rest = name.removeprefix("inputs.").partition(".")
    if name.startswith("inputs."):
        if table == "arithmetic":
            return (
                f"{out} was begun by a version of glsim, a processor, NumPy or OpenGL driver whose "
                f"last bits differ from this machine's ({socket.gethostname()}): continue there, "
                "or choose another folder"
            )
        what = f"stage file {rest}" if table == "stages" else f"a file of source {rest}"
        return f"{what} was changed since {out} was begun: restore it, or choose another folder"
    if name == "plan":
        return (
            f"{out} was begun with other faces: the files of a source have changed: restore them, "
            "or choose another folder"
        )
    if name == "glsim_version":
        return (
            f"{out} was begun with glsim {old}, whose frames of a seed may differ from those of "
            f"{new}: continue with that version (glsim --version prints it, with a hash of the "
            "code), or choose another folder; what is complete can still be read"
        )
    return (
        f"{out} was begun with {name.removeprefix('settings.')} = {json.dumps(old)}, not "
        f"{json.dumps(new)}: continue with the same, or choose another folder"
    )
