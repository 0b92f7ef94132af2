"""Dress the faces of a source: add hair, beard, brows, glasses and clothes as meshes."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, TypeVar, cast

import numpy as np

from glsim.core.array_types import Array, Floats, Triangles, Whole
from glsim.core.errors import ConfigError
from glsim.core.mesh import SKIN_ALBEDO, Mesh, occluder_of
from glsim.faces.face_source import Face, FaceSource, WornPart
from glsim.faces.generated import GeneratedFaces
from glsim.looks.anatomy import Anatomy
from glsim.looks.beard import make_beard, make_beard_grid, make_brow_grid, make_brows
from glsim.looks.binding import Binding, Hair, Motion, Points, Rigid, Shell, skull_motion, uncovered
from glsim.looks.cloth import make_clothes
from glsim.looks.cloth_body import fit_cloth, make_cloth_grid
from glsim.looks.glasses import make_glasses
from glsim.looks.hair import make_hair, make_scalp
from glsim.looks.hand import make_hand
from glsim.looks.headwear import make_hat, make_headphones
from glsim.looks.noise import Pattern, pattern_factors
from glsim.looks.outfit import Outfit, sample_outfit
from glsim.looks.styles import STYLE_TABLE
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import AppearanceSettings

_Grid = TypeVar("_Grid")

#: Regions of worn meshes, in the order of the settings.
WORN_REGIONS: Final = ("hair", "beard", "brow", "glasses", "cloth", "hat", "headphones", "hand")
#: Materials with mirror light, added to the albedo of their vertices: 4 times the number that
#: shaders/lib/gloss.glsl has; and the share of light that passes a clear lens twice: 92 % each way.
WORN_GLOSS: Final = {"skin": 4.0, "eye": 8.0, "lip": 12.0, "frame": 16.0, "lens": 20.0,
                     "metal": 24.0, "leather": 28.0}  # fmt: skip
_LENS_TWICE: Final = 0.92**2
#: Sources that wear = "auto" dresses; others have bare faces, as in the paper.
DRESSED_SOURCES: Final = ("people",)
#: Number of subjects whose clothes stay in memory, 2 MB each: a batch of frames has few subjects.
_CACHED_SUBJECTS: Final = 8
#: Number of points on the skull to which its motion is fitted.
_SKULL_POINTS: Final = 96


def worn_regions(settings: AppearanceSettings, sources: Sequence[FaceSource]) -> list[str]:
    """Return the region names of hair, glasses and clothes; [] if no source is dressed."""
    if not any(Dresser(source, settings).is_on for source in sources):
        return []
    return [n for n in WORN_REGIONS if getattr(settings, "brows" if n == "brow" else n) > 0]


@dataclass(eq=False)
class _Worn:
    """A worn mesh and its last placed part, which is reused if skin and skull are still."""

    region: str
    binding: Binding
    mesh: Mesh
    last: tuple[Points, Motion, WornPart] | None = None

    def place(self, vertices_mm: Points, motion: Motion) -> WornPart:
        """Return the worn part on the vertices of a frame's face, (V, 3) mm."""
        skin = vertices_mm[self.binding.used]
        if self.last is not None:
            before, moved, worn = self.last
            if np.array_equal(skin, before) and moved.equals(motion):
                return worn
        mesh = replace(self.mesh, vertices_mm=self.binding.place(vertices_mm, motion))
        self.last = skin, motion, WornPart(mesh, self.region)
        return self.last[2]


@dataclass(eq=False)
class _Wardrobe:
    """All worn meshes of one subject.

    ``skull``: (K, 3) mm, points at rest; ``faces``, ``occluder``: triangles of the skin that no
    cloth covers; ``skin``: the albedo of the source's mesh, and with the scalp's colour.
    """

    outfit: Outfit
    worn: list[_Worn]
    skull: Points
    faces: Triangles
    occluder: Triangles | None
    skin: tuple[object, Floats] | None = None


class Dresser:
    """Dresses the faces of one source; makes each subject's hair and clothes once."""

    def __init__(self, source: FaceSource, settings: AppearanceSettings) -> None:
        """Decide whether to dress. Raises ConfigError: wear = "always" needs regions."""
        wanted = settings.wear == "always" or (
            settings.wear == "auto" and source.name in DRESSED_SOURCES
        )
        if wanted and not isinstance(source, GeneratedFaces):
            raise ConfigError(
                f"{source.name}: its meshes have no known regions, so nobody can be dressed: set "
                "appearance.wear = 'auto'"
            )
        self.is_on = wanted
        self._source = cast("GeneratedFaces[object]", source)
        self._settings = settings
        self._wardrobes: OrderedDict[tuple[str, int], _Wardrobe] = OrderedDict()
        self._grids: dict[object, object] = {}

    def dress(self, face: Face, seeds: ScopeSeeds) -> Face:
        """Add the worn meshes of a face's subject; a pure function of face and seeds."""
        if not self.is_on:
            return face
        wardrobe = self._wardrobe(face, seeds)
        mesh = face.mesh
        motion = skull_motion(wardrobe.skull, mesh.vertices_mm[self._skull])
        parts = tuple(thing.place(mesh.vertices_mm, motion) for thing in wardrobe.worn)
        skin = self._skin(wardrobe, mesh)
        return replace(
            face,
            mesh=Mesh(mesh.vertices_mm, wardrobe.faces, skin, wardrobe.occluder),
            notes={**face.notes, **wardrobe.outfit.words},
            parts=(*face.parts, *parts),
        )

    def sampled(self, face: Face, seeds: ScopeSeeds) -> dict[str, float]:
        """Return the sampled values of an outfit for the manifest: "appearance.name" -> value."""
        return dict(self._wardrobe(face, seeds).outfit.numbers) if self.is_on else {}

    @cached_property
    def _reference(self) -> Anatomy:
        vertices, faces = self._source.neutral(self._source.subjects(1)[0])
        topology = self._source.topology
        assert topology.regions is not None
        return Anatomy(self._source.name, vertices, faces, topology.regions, topology.region_names)

    @cached_property
    def _skull(self) -> Whole:
        """Indices of vertices on the back of the scalp, which move with the skull only."""
        head = self._reference
        inside = head.above_hairline_mm(head.vertices_mm) > 5
        # The front is excluded: raised brows pull the scalp as far back as the ears.
        inside &= head.vertices_mm[:, 2] < head.centre[2] - 25 * head.scale
        scalp = np.flatnonzero(inside & head.outside & ~head.body & ~head.is_in("ear"))
        every = np.linspace(0, len(scalp) - 1, min(_SKULL_POINTS, len(scalp))).astype(int)
        return np.asarray(scalp[every])

    def _grid(self, make: Callable[[Anatomy], _Grid]) -> _Grid:
        """Make a grid of hair, beard, brows or cloth on the source at its first use."""
        if make not in self._grids:
            self._grids[make] = make(self._reference)
        return cast("_Grid", self._grids[make])

    def _wardrobe(self, face: Face, seeds: ScopeSeeds) -> _Wardrobe:
        key = face.key.subject, seeds.subject
        if key not in self._wardrobes:
            own = {"hand": 0.0} if self._reference.body.any() else {}  # bodies have hands
            outfit = sample_outfit(self._settings.model_copy(update=own), seeds, face.notes)
            self._wardrobes[key] = self._make(face, outfit)
            while len(self._wardrobes) > _CACHED_SUBJECTS:
                self._wardrobes.popitem(last=False)
        self._wardrobes.move_to_end(key)
        return self._wardrobes[key]

    def _make(self, face: Face, outfit: Outfit) -> _Wardrobe:
        vertices, _ = self._source.neutral(face.key.subject)
        anatomy = replace(self._reference, vertices_mm=vertices)
        rest = skull_motion(vertices[:3], vertices[:3])
        worn: list[_Worn] = []
        shells: list[Shell] = []

        def wear(
            region: str, binding: Binding, faces: Triangles, albedo: float | Array,
            pattern: Pattern = "plain", light: float | Array = 1.0, shine: str = "", **more: Any,
        ) -> None:  # fmt: skip
            if len(faces):
                points = binding.place(vertices, rest)
                factors = pattern_factors(pattern, points, outfit.seed + len(worn))
                values = np.clip(albedo * light * factors, 0.0, 1.0).astype(np.float32)
                values += WORN_GLOSS[shine] if shine and self._settings.gloss else 0.0
                worn.append(_Worn(region, binding, Mesh(points, faces, values, **more)))

        for region, hair in self._hair(anatomy, vertices, outfit):
            wear(
                region, hair.binding, hair.faces, outfit.hair_albedo, light=hair.light,
                strands=hair.strands, occluder=hair.occluder,
            )  # fmt: skip
        if outfit.glasses:
            frame = STYLE_TABLE["glasses"][outfit.glasses]
            shape, is_lens = make_glasses(anatomy, vertices, frame, outfit.lens, outfit.seed)
            wear("glasses", Rigid(shape), shape.faces, outfit.rim_albedo)
            albedo = cast("Floats", worn[-1].mesh.albedo)
            albedo[is_lens] = outfit.lens_albedo
            if self._settings.gloss:
                rim = WORN_GLOSS[frame.get("of", "frame")]
                albedo += np.where(is_lens, WORN_GLOSS["lens"], rim).astype(np.float32)
        cloth = self._grid(make_cloth_grid) if outfit.garments else None
        if cloth is not None:
            body = fit_cloth(cloth, vertices)
            made = make_clothes(body, outfit.garments, outfit.tucked, anatomy.scale, outfit.seed)
            patterns: tuple[Pattern, ...] = (outfit.pattern, "plain", "plain")
            looks = zip(made, outfit.cloth_albedos, patterns, ("", "", "leather"), strict=False)
            for (shell, folds), bright, pattern, shine in looks:
                shadow = occluder_of(shell.place(vertices, rest), shell.faces)
                wear(
                    "cloth", shell, shell.faces, bright, pattern, shine=shine, folds=folds,
                    occluder=shadow,
                )  # fmt: skip
                shells.append(shell)
        for region, thing, corners, albedos, more in self._carried(anatomy, face.mesh, outfit):
            wear(region, thing, corners, albedos, **more)
        faces, occluder = anatomy.faces, face.mesh.occluder
        if shells:
            free = uncovered(faces, len(vertices), shells)
            faces = faces[free[faces].any(axis=1)]
            occluder = None if occluder is None else occluder[free[occluder].any(axis=1)]
        return _Wardrobe(outfit, worn, vertices[self._skull], faces, occluder)

    def _carried(
        self, anatomy: Anatomy, mesh: Mesh, outfit: Outfit
    ) -> Iterator[tuple[str, Binding, Triangles, float | Array, dict[str, Any]]]:
        """Yield a hat, headphones and a hand: region, binding, triangles, albedo, more of Mesh."""
        hair_mm = 0.0
        if (hair := outfit.hair) is not None:  # hair that hangs swings by 4 mm: chosen
            hair_mm = anatomy.scale * (max(hair.top, hair.side, hair.back) + 4 * (hair.hang > 0))
        if outfit.hat:
            style = STYLE_TABLE["hats"][outfit.hat]
            shape, ribs = make_hat(anatomy, style, hair_mm, outfit.seed)
            yield "hat", Rigid(shape), shape.faces, outfit.hat_albedo, {"folds": ribs}
        if bright := outfit.headphones_albedo:
            shape = make_headphones(anatomy, hair_mm, outfit.seed)
            yield "headphones", Rigid(shape), shape.faces, bright, {"shine": "frame"}
        if outfit.hand:
            pose = STYLE_TABLE["hands"][outfit.hand]
            hand, faces, is_sleeve = make_hand(anatomy, pose, outfit.seed)
            bare = self._bare_albedo(mesh)
            sleeve = outfit.cloth_albedos[0] if outfit.garments else bare
            yield "hand", hand, faces, np.where(is_sleeve, sleeve, bare), {}

    def _hair(
        self, anatomy: Anatomy, skin_mm: Floats, outfit: Outfit
    ) -> Iterator[tuple[str, Hair]]:
        """Yield the sheets of hair, beard and brows of an outfit, with their regions."""
        if outfit.hair is not None:
            scalp = self._grid(make_scalp)
            yield "hair", make_hair(anatomy, scalp, skin_mm, outfit.hair, outfit.seed)
        if outfit.beard:
            grid, style = self._grid(make_beard_grid), STYLE_TABLE["beard"][outfit.beard]
            for sheet in make_beard(grid, skin_mm, style, outfit.beard_mm, outfit.seed):
                yield "beard", sheet
        if outfit.brow_mm:
            brows = self._grid(make_brow_grid)
            yield "brow", make_brows(brows, skin_mm, outfit.brow_mm, outfit.seed)

    def _bare_albedo(self, mesh: Mesh) -> float:
        """Return the albedo of a face's bare skin."""
        skin = self._reference.is_in("skin", "face", "cheek")
        if mesh.albedo is None or not skin.any():
            return SKIN_ALBEDO
        return float(np.median(mesh.albedo[skin]))

    def _skin(self, wardrobe: _Wardrobe, mesh: Mesh) -> Floats | None:
        """Return the albedo of the skin, (V,), also where a source paints hair on the scalp."""
        if wardrobe.skin is None or wardrobe.skin[0] is not mesh.albedo:
            plain = np.full(len(mesh.vertices_mm), SKIN_ALBEDO, np.float32)
            albedo = plain if mesh.albedo is None else mesh.albedo.copy()
            if self._settings.hair:
                albedo[self._reference.is_in("scalp", "hair")] = self._bare_albedo(mesh)
            if self._settings.gloss:
                eye = self._reference.is_in("sclera", "iris", "pupil", "eyes")
                albedo[eye] *= _LENS_TWICE if wardrobe.outfit.glasses else 1.0
                albedo += WORN_GLOSS["skin"]
                for name, where in (("eye", eye), ("lip", self._reference.is_in("lips"))):
                    albedo[where] += WORN_GLOSS[name] - WORN_GLOSS["skin"]
            wardrobe.skin = (mesh.albedo, albedo)
        return wardrobe.skin[1]
