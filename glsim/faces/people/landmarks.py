"""The 68 landmarks of people: fine vertices, the same in every person, posture and expression.

They are found on the mean grown person, whose two halves are mirror images. Brows, lips and the
midline are places that the model itself defines: the arch of the brow, the border of the lips'
mask, the deepest and the foremost points of the profile. Eyelids, inner lips and the chin are where
the skin turns away from the front. The rest (the contour, the base of the nose, the corners of the
eyes) is chosen on a picture of the mean person by the drawings of Multi-PIE (R. Gross et al., Image
and Vision Computing 28, 2010). Left is the mirror of right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.errors import MeshError
from glsim.faces.people.files import FETCH_AGAIN
from glsim.faces.people.model import BodyModel
from glsim.faces.people.phenotype import MEAN_PERSON, phenotype_weights
from glsim.faces.people.regions import BROW_MM, REGIONS, brow_arch
from glsim.geometry.mesh import vertex_normals

#: The contour in front of the ear, then along the edge of the mandible: y and z from the tip of the
#: nose, mm. Chosen on the mean person from the side.
_CONTOUR = (
    *((33.0, -97.0), (12.0, -94.0), (-8.0, -88.0), (-27.0, -81.0), (-47.0, -70.0)),
    *((-61.0, -57.0), (-69.0, -44.5), (-73.5, -31.0)),
)
#: Points of a brow, as shares of its arch, outer end first: evenly.
_BROW = (0.95, 0.73, 0.5, 0.28, 0.06)
#: Heights of the bridge between nasion and tip, as shares of the way down.
_BRIDGE = (0.0, 1 / 3, 2 / 3)
#: The base of the nose beside its middle, from the tip: distance from the midline and y, mm.
#: Chosen: where the wing meets the lip, and the middle of the nostril's lower rim.
_NOSE_BASE = ((14.0, -11.0), (7.0, -12.0))
#: The corners of an eye, from the tip of the nose: distance from the midline and y, mm. Chosen:
#: where the two lids meet, outside and inside of the caruncle.
_EYE_CORNERS = ((45.5, 38.6), (17.7, 35.8))
#: Places along the outer lips, as shares of the way from the middle to the corner, outer first: the
#: upper lip's second one is the cupid's bow.
_UPPER_LIP, _LOWER_LIP = (0.62, 0.22), (0.62, 0.3)
_INNER_CORNER, _INNER_LIP = 0.92, 0.35
#: Cosine between the surface's normal and the front from which skin counts as turned to the front:
#: behind it are the inner sides of lips and lids. Chosen.
_TURNED = 0.25
#: Largest distance between a vertex and the mirror image of its partner, mm. Measured: 1e-4.
_MIRROR_MM = 0.1


def landmark_vertices(model: BodyModel) -> NDArray[np.int64]:
    """Return the (68,) fine vertices of a model in the order of ``glsim.faces.landmarks``.

    Raises:
        MeshError: the two halves of the mean person are no mirror images, from damaged data.
    """
    face = _MeanFace(model)
    right = _right_and_midline(face)
    left = {name: face.mirrored(vertices) for name, vertices in right.items()}
    lips = [*right["upper_lip"], *left["upper_lip"][-2::-1]]
    lips = [*right["corner"], *lips, *left["corner"]]
    lips += [*left["lower_lip"], *right["lower_lip"][-2::-1]]
    inner = [*right["upper_inner"], *left["upper_inner"][-2::-1]]
    inner += [*left["lower_inner"], *right["lower_inner"][-2::-1]]
    eye = left["eye"]
    return np.array(
        [
            *(*right["contour"], *left["contour"][-2::-1]),
            *(*right["brow"], *left["brow"][::-1]),
            *(*right["bridge"], *right["nose_base"], *left["nose_base"][-2::-1]),
            *(*right["eye"], *eye[3::-1], *eye[:3:-1]),  # the left one begins at its inner corner
            *(*lips, *inner),
        ],
        np.int64,
    )


def _right_and_midline(face: _MeanFace) -> dict[str, list[int]]:
    """Return the parts of the right half; the last point of most is on the midline."""
    nasion, subnasale = face.nasion(), face.subnasale()
    nasion_y = face.points[nasion, 1]
    corner = face.mouth_corner()
    width, slit_y = -face.points[corner, 0], face.points[corner, 1]
    upper = [face.lip_border(share * width, 1) for share in (*_UPPER_LIP, 0.0)]
    lower = [face.lip_border(share * width, -1) for share in (*_LOWER_LIP, 0.0)]
    inner = [face.inner_lip(share * width, side) for side in (1, -1) for share in (_INNER_LIP, 0.0)]
    inner_corner = face.nearest(_INNER_CORNER * width, slit_y, "lips")
    eye_level = face.eye_level()
    return {
        "contour": [*(face.from_the_side(y, z) for y, z in _CONTOUR), face.chin()],
        "brow": [
            face.nearest(x, eye_level + float(brow_arch(np.array(x))))
            for x in (BROW_MM[0] + share * (BROW_MM[1] - BROW_MM[0]) for share in _BROW)
        ],
        "bridge": [*(face.profile_at((1.0 - share) * nasion_y) for share in _BRIDGE), face.tip],
        "nose_base": [*(face.nearest(x, y) for x, y in _NOSE_BASE), subnasale],
        "eye": face.eye(*(face.nearest(x, y) for x, y in _EYE_CORNERS)),
        "corner": [corner],
        "upper_lip": upper,
        "lower_lip": lower,
        "upper_inner": [inner_corner, *inner[:2]],
        "lower_inner": inner[2:],
    }


class _MeanFace:
    """The mean grown person, from the tip of the nose; ``points`` are (V, 3) mm.

    Places are given for the right half, x being the distance from the midline.
    """

    def __init__(self, model: BodyModel) -> None:
        points = model.body(phenotype_weights(MEAN_PERSON))[0].astype(np.float64)
        self.tip = model.landmarks["nose_tip"]
        self.points = points - points[self.tip]
        self._normals = vertex_normals(self.points, model.faces)
        self._regions = model.regions
        in_front = self._in("skin", "brow", "lips", "nose", "lids") & (self.points[:, 2] > -110.0)
        self._right = np.flatnonzero(in_front & (self.points[:, 0] < 1e-3))
        self._turned = self._right[self._normals[self._right, 2] > _TURNED]

    def _in(self, *names: str) -> NDArray[np.bool_]:
        return np.isin(self._regions, [REGIONS.index(name) for name in names])

    def _lips(self) -> NDArray[np.int64]:
        lips: NDArray[np.int64] = self._turned[self._in("lips")[self._turned]]
        return lips

    def _profile(self, low: float, high: float) -> NDArray[np.int64]:
        """The midline's vertices that are turned to the front between two heights, mm."""
        x, y = self.points[self._turned, :2].T
        profile: NDArray[np.int64] = self._turned[(np.abs(x) < 1e-3) & (y > low) & (y < high)]
        return profile

    def mirrored(self, vertices: list[int]) -> list[int]:
        """Return the vertices of the left half that mirror others. Raises MeshError."""
        found = []
        for vertex in vertices:
            off = np.linalg.norm(self.points - self.points[vertex] * [-1, 1, 1], axis=1)
            if off.min() > _MIRROR_MM:
                raise MeshError(f"the mean person is not symmetric: damaged: {FETCH_AGAIN}")
            found.append(int(off.argmin()))
        return found

    def nearest(self, x: float, y: float, region: str = "") -> int:
        """Return the vertex turned to the front that is nearest to a place in the frontal view."""
        among = self._turned if not region else self._turned[self._in(region)[self._turned]]
        off = np.hypot(self.points[among, 0] + x, self.points[among, 1] - y)
        near = off < off.min() + 0.5
        return int(among[near][self.points[among[near], 2].argmax()])

    def from_the_side(self, y: float, z: float) -> int:
        """Return the outermost vertex nearest to a place in the view from the side."""
        off = np.hypot(self.points[self._right, 1] - y, self.points[self._right, 2] - z)
        near = off < off.min() + 0.5
        return int(self._right[near][self.points[self._right[near], 0].argmin()])

    def profile_at(self, y: float) -> int:
        """Return the vertex of the profile nearest to a height."""
        profile = self._profile(-90.0, 90.0)
        return int(profile[np.abs(self.points[profile, 1] - y).argmin()])

    def nasion(self) -> int:
        """Return the deepest point of the profile between the tip of the nose and the brows."""
        profile = self._profile(0.0, float(self.points[self._in("brow"), 1].mean()))
        return int(profile[self.points[profile, 2].argmin()])

    def subnasale(self) -> int:
        """Return the point of the profile farthest behind the line from nose tip to upper lip."""
        lips = self._lips()
        lip = lips[self.points[lips, 1] > self.points[self.mouth_corner(), 1]]
        foremost = self.points[lip[self.points[lip, 2].argmax()], 1:]
        profile = self._profile(float(foremost[0]), 0.0)
        y, z = self.points[profile, 1:].T
        return int(profile[(z * foremost[0] - y * foremost[1]).argmax()])

    def chin(self) -> int:
        """Return the lowest point of the profile, where it faces the front by half at least."""
        lowest = self._lips()[self.points[self._lips(), 1].argmin()]
        at = self._right[np.abs(self.points[self._right, 0]) < 1e-3]
        at = at[self.points[at, 1] < self.points[lowest, 1] - 15.0]
        at = at[(self._normals[at, 2] > 0.5) & (self.points[at, 2] > -60.0)]
        return int(at[self.points[at, 1].argmin()])

    def eye_level(self) -> float:
        """Return the height of the middle of the eyeballs."""
        heights = self.points[self._in("sclera", "iris", "pupil"), 1]
        return float(heights.max() + heights.min()) / 2

    def mouth_corner(self) -> int:
        """Return the outermost vertex of the lips."""
        lips = self._lips()
        return int(lips[self.points[lips, 0].argmin()])

    def lip_border(self, x: float, side: int) -> int:
        """Return the vertex of the lips' upper (side 1) or lower (-1) border at a distance x."""
        lips = self._lips()
        near = lips[np.abs(self.points[lips, 0] + x) < 1.5]
        return int(near[(side * self.points[near, 1]).argmax()])

    def inner_lip(self, x: float, side: int) -> int:
        """Return the last vertex of the upper (side 1) or lower (-1) lip before it turns inside."""
        lips = self._lips()
        off = np.abs(self.points[lips, 0] + x)
        near = lips[off < off.min() + 1.0]
        slit = self.points[self.mouth_corner(), 1]
        of_lip = near[side * self._normals[near, 1] <= 0]  # the inner edges face each other
        return int(of_lip[np.abs(self.points[of_lip, 1] - slit).argmin()])

    def eye(self, outer: int, inner: int) -> list[int]:
        """Return six points of the right eye, clockwise in the image from its outer corner."""
        ends = self.points[[outer, inner], :2]
        lids = self._turned[self._in("lids")[self._turned]]
        found = {}
        for side in (1, -1):
            for share in (1 / 3, 2 / 3):
                x, y = (1 - share) * ends[0] + share * ends[1]
                across, up = (self.points[lids, :2] - (x, y)).T
                near = (np.abs(across) < 2.0) & (side * up > 0)
                off = np.abs(across) + np.abs(up)
                found[side, share] = int(lids[near][off[near].argmin()])
        upper = [found[1, 1 / 3], found[1, 2 / 3]]
        return [outer, *upper, inner, found[-1, 2 / 3], found[-1, 1 / 3]]
