"""Other people in a room: people of the frame's source that are not in the data set."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

import numpy as np

from glsim.core.array_types import Floats
from glsim.core.camera import SensorRig
from glsim.core.products import product
from glsim.core.seeds import pcg_rng, stable_seed
from glsim.faces.face_source import Face, FaceKey, FaceSource
from glsim.faces.variation import vary
from glsim.looks.dress import Dresser
from glsim.looks.room.scenery import Prop, Scenery, body_of
from glsim.looks.room.view import visible_part
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import Settings

#: Number of other people of a source: in 1,000 rooms with one of them, each appears 30 times.
STRANGERS = 32
#: Largest number of a person's sequences that are searched for a standing pose.
_TRIES = 6
#: Number of meshes, cut to the view, that are kept in memory.
_KEPT = 24


class OtherPeople:
    """Loads the bodies of background people and places them in rooms."""

    def __init__(
        self, settings: Settings, sources: Sequence[FaceSource], dressers: Sequence[Dresser],
        rig: SensorRig,
    ) -> None:  # fmt: skip
        self._settings, self._sources, self._rig = settings, sources, rig
        self._dressers = dressers
        people, room = settings.scene.people, settings.scene.room
        self._most = round(people.bounds()[1]) if room != "none" else 0
        self._faces: dict[tuple[int, int], tuple[Face, float] | None] = {}
        self._props: OrderedDict[tuple[object, ...], list[Prop]] = OrderedDict()

    def load(self, source: int, seeds: ScopeSeeds) -> None:
        """Load the background people of a frame's room; the caller holds the sources' lock."""
        if self._most == 0 or not self._settings.source[source].endless:
            return
        for number in self._numbers(seeds, self._most):
            if (source, number) not in self._faces:
                self._faces[source, number] = self._standing(source, number)

    def props(self, source: int, seeds: ScopeSeeds, scenery: Scenery) -> list[Prop]:
        """Return the meshes of other people in a scenery; all frames share their arrays."""
        found: list[Prop] = []
        numbers = self._numbers(seeds, len(scenery.places))
        for number, place in zip(numbers, scenery.places, strict=True):
            key = source, number, place.tobytes()
            if key not in self._props:
                self._props[key] = self._place(source, number, place)
                if len(self._props) > _KEPT:
                    self._props.popitem(last=False)
            self._props.move_to_end(key)
            found += self._props[key]
        return found

    def _numbers(self, seeds: ScopeSeeds, count: int) -> list[int]:
        """Sample the numbers of ``count`` different background people for a room."""
        rng = pcg_rng("other people", getattr(seeds, self._settings.scene.per))
        return [int(number) for number in rng.permutation(STRANGERS)[:count]]

    def _standing(self, source: int, number: int) -> tuple[Face, float] | None:
        """Load a standing person, dressed, and the floor's height y, mm; None without a body."""
        known = self._settings.source[source].subjects or 0
        strangers = self._sources[source].subjects(known + STRANGERS)[known:]
        if number >= len(strangers):
            return None  # the source has fewer people
        name = strangers[number]
        firsts: dict[str, FaceKey] = {}  # first frame of each sequence
        for key in self._sources[source].frames(name, 40 * _TRIES):
            firsts.setdefault(key.sequence, key)
        for key in list(firsts.values())[:_TRIES]:
            face = next(iter(self._sources[source].load([key])))
            body = body_of(face) if isinstance(face, Face) else None
            if body is None or not isinstance(face, Face):
                return None
            if not face.notes.get("sitting"):
                words = "other people", self._settings.seed, source, name
                seeds = ScopeSeeds(*(stable_seed(*words, scope) for scope in ScopeSeeds._fields))
                varied = vary(face, self._settings.variation, seeds)
                return self._dressers[source].dress(varied, seeds), body.floor_mm
        return None

    def _place(self, source: int, number: int, place: Floats) -> list[Prop]:
        """Return the visible meshes of a background person at ``place``."""
        face, floor_mm = self._faces.get((source, number)) or (None, 0.0)
        if face is None:
            return []
        lift = np.eye(4, dtype=np.float32)
        lift[1, 3] = -floor_mm
        view = product(place, lift)
        meshes = [face.mesh, *(part.mesh for part in face.parts)]
        parts = [visible_part(mesh, view, self._rig) for mesh in meshes]
        return [Prop(part, view, "person") for part in parts if part is not None]
