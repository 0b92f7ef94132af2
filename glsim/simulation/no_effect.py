"""Settings that were given but have no effect in this run; needs.toml lists what each needs."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from glsim.faces.face_source import Face, FaceSource
from glsim.faces.generated import GeneratedFaces
from glsim.faces.one_mesh import OneMesh
from glsim.looks.dress import Dresser
from glsim.looks.room.scenery import body_of
from glsim.settings.schema import MotionSettings, Settings, changed
from glsim.settings.source_settings import generates

_TABLE: Final = tomllib.loads(Path(__file__).with_name("needs.toml").read_text(encoding="utf-8"))


def no_effect(settings: Settings, sources: Sequence[FaceSource]) -> list[str]:
    """Return a line for each group of settings that the user, no preset, changed in vain."""
    lines, given = [], [f"{name}." for name in changed(settings)]
    for row in _TABLE["row"]:
        if names := [n for n in row["settings"] if any(g.startswith(f"{n}.") for g in given)]:
            holds = (_HOLDS[need](settings, sources) for need in row["needs"])
            missing = [n for n, ok in zip(row["needs"], holds, strict=True) if not ok]
            if missing:
                have, they = ("has", "it needs") if len(names) == 1 else ("have", "they need")
                effect = row.get("effect", f"{have} no effect")
                texts = " and ".join(_TABLE["needs"][need] for need in missing)
                lines.append(f"{', '.join(names)} {effect}: {they} {texts}")
    return lines


def _generated(sources: Sequence[FaceSource]) -> bool:
    return any(generates(source.name) for source in sources)


def _has_body(source: FaceSource) -> bool:
    first = next(iter(source.load([source.frames(source.subjects(1)[0], 1)[0]])))
    return isinstance(first, Face) and body_of(first) is not None


#: Need -> whether it holds in a run, for at least one source.
_HOLDS: Final[dict[str, Callable[[Settings, Sequence[FaceSource]], bool]]] = {
    "exposure": lambda s, _: s.motion.within_exposure,
    "moving": lambda s, of: _generated(of) or s.motion != MotionSettings(within_exposure=True),
    "generated": lambda _, of: _generated(of),
    "wall": lambda s, _: s.scene.wall_mm is not None,
    "room": lambda s, _: s.scene.room != "none",
    "furniture": lambda s, _: s.scene.room not in ("none", "empty"),
    "bodies": lambda _, of: any(generates(x.name) and _has_body(x) for x in of),
    "heads": lambda _, of: not all(map(_has_body, of)),
    "varied": lambda s, _: any((*s.variation.shape_mm.bounds(), *s.variation.albedo.bounds())),
    "regions": lambda _, of: any(isinstance(x, GeneratedFaces) for x in of),
    "dressed": lambda s, of: any(Dresser(x, s.appearance).is_on for x in of),
    "hatless": lambda s, _: s.appearance.hat < 1,
    "persons": lambda s, of: len(of) > 1 or len(of[0].subjects(s.source[0].subjects)) > 1,
    "sources": lambda s, _: len(s.source) > 1,
    "dataset": lambda _, of: not any(isinstance(x, OneMesh) for x in of),
}
