"""A depth camera: intrinsics, lens distortion, emitters, clip matrix and exposure times.

Camera frame (OpenCV): x right, y down, z forward, metres. Image coordinates are continuous: the
centre of the pixel in column u and row v is at (u + 0.5, v + 0.5), row 0 on top. The principal
point (cx, cy) is in these coordinates, as in libfreenect2's point clouds, pyrender and Open3D.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from glsim.core.array_types import Array, Floats, Reals
from glsim.core.errors import ConfigError
from glsim.core.products import norm, product
from glsim.core.rect import Rect

#: (x, y, z) in the camera frame, metres.
Point = tuple[float, float, float]

#: Iterations of the fixed-point inversion of the lens model. 30 iterations leave an error below
#: 1e-6 px at the corners of the Kinect V2, whose k1..k3 are the strongest of the shipped rigs.
_UNDISTORT_ITERATIONS = 30

#: Number of radii in the table of first guesses for the inversion of a lens with a limit. Between
#: two radii the interpolated guess is wrong by less than 1e-6.
_RADII = 4096

#: Width of the widest view of a pinhole camera in focal lengths: 170 degrees. Chosen: normalised
#: focal lengths (1 = the width) are far below, the widest camera that is simulated has 120 degrees.
_WIDEST = 2 * math.tan(math.radians(85))

#: A time-of-flight frame is measured by nine captures: three taps of each of three frequencies.
TAPS, FREQUENCIES = 3, 3


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera: image size, focal lengths and principal point, all in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def clip_matrix(self, near_m: float, far_m: float) -> Floats:
        """Compute the (4, 4) float32 matrix from the camera frame to clip space, with y *down*.

        Row 0 of the GL framebuffer is then the top row of the image, and no image must be flipped.
        The matrix mirrors the order of vertices: counter-clockwise faces become clockwise.
        """
        n, f = near_m, far_m
        return np.array(
            [
                [2 * self.fx / self.width, 0, 2 * self.cx / self.width - 1, 0],
                [0, 2 * self.fy / self.height, 2 * self.cy / self.height - 1, 0],
                [0, 0, (f + n) / (f - n), -2 * f * n / (f - n)],
                [0, 0, 1, 0],
            ],
            dtype=np.float32,
        )

    def finer(self, factor: int) -> Intrinsics:
        """Return the same camera with ``factor`` times as many pixels along each axis."""
        if factor == 1:
            return self
        size = self.width * factor, self.height * factor
        return Intrinsics(*size, *(factor * v for v in (self.fx, self.fy, self.cx, self.cy)))

    def rays(self) -> Floats:
        """Compute the (H, W, 2) float32 rays x/z and y/z through the pixel centres."""
        x = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        y = (np.arange(self.height) + 0.5 - self.cy) / self.fy
        return np.stack(np.meshgrid(x, y), axis=-1).astype(np.float32)

    def project(self, points_m: Reals) -> Array:
        """Project points, (N, 3) camera frame, metres, to image points, (N, 2) float64 pixels."""
        p = np.asarray(points_m, dtype=np.float64)
        u = self.fx * p[:, 0] / p[:, 2] + self.cx
        v = self.fy * p[:, 1] / p[:, 2] + self.cy
        return np.stack([u, v], axis=1)

    def unproject(self, depth_m: Reals) -> Floats:
        """Convert depth, (H, W) metres, to points, (H, W, 3) float32, camera frame, metres."""
        z = np.asarray(depth_m, dtype=np.float32)
        return np.concatenate([self.rays() * z[..., None], z[..., None]], axis=-1)

    def cropped(self, left: int, top: int, width: int, height: int) -> Intrinsics:
        """Return the intrinsics of a window of the image."""
        return replace(self, width=width, height=height, cx=self.cx - left, cy=self.cy - top)

    def for_map(
        self,
        shape: tuple[int, int],
        focal_px: tuple[float, float] | None = None,
        centre_px: tuple[float, float] | None = None,
    ) -> Intrinsics:
        """Return the intrinsics of an uncalibrated depth map that may be a crop of this image.

        The default focal lengths are this camera's. The default principal point is this camera's if
        the sizes are equal, otherwise the centre of the map. Raises ConfigError for an empty map,
        and for focal lengths in another unit.
        """
        height, width = shape
        if centre_px is None:
            whole = (width, height) == (self.width, self.height)
            centre_px = (self.cx, self.cy) if whole else (width / 2, height / 2)
        fx, fy = focal_px or (self.fx, self.fy)
        if not (0 < width <= _WIDEST * fx < np.inf and 0 < height <= _WIDEST * fy < np.inf):
            raise ConfigError(
                f"a camera of {width}x{height} pixels with focal lengths {fx:g}, {fy:g}: give both "
                "in pixels, above 0 (Gazebo, BlenderProc, Isaac: the size of a negative fy)"
            )
        return Intrinsics(width, height, fx, fy, *centre_px)


#: The sensor of settings that name no sensor. Its intrinsics are the default of depth maps without
#: a camera. They stand here as numbers, so that reading maps loads no sensor; a test compares them
#: with the sensor's file.
DEFAULT_SENSOR = "kinect-v2"
DEFAULT_INTRINSICS = Intrinsics(512, 424, 365.456, 365.456, 254.878, 205.395)


@dataclass(frozen=True)
class Distortion:
    """OpenCV's radial and tangential lens distortion of the normalised coordinates x/z and y/z.

    Args:
        k1, k2, k3: coefficients of the radial polynomial in r^2 (the numerator).
        p1, p2: tangential coefficients.
        k4, k5, k6: coefficients of the denominator in the rational model; 0 in the simple model.
        limit_tan: largest r at which the model holds; 0 = everywhere. Beyond it the lens shows
            nothing, and rays are clamped to this r.
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    limit_tan: float = 0.0

    def distort(self, xy: Reals) -> Array:
        """Compute the distorted points, (..., 2) float64, of ideal image points x/z, y/z."""
        xy = np.asarray(xy, dtype=np.float64)
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = self._radial(r2)
        xd = x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x)
        yd = y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y
        return np.stack([xd, yd], axis=-1)

    def _radial(self, r2: Array) -> Array:
        """Compute the radial distortion factor at the squared radius r2."""
        upper = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        if not self.is_rational:
            return upper
        return upper / (1 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6)))

    @property
    def is_rational(self) -> bool:
        """Whether radial distortion is a ratio of polynomials (k4, k5 or k6 is not 0)."""
        return any((self.k4, self.k5, self.k6))

    def undistort(self, xy: Reals) -> Array:
        """Compute ideal points, (..., 2), of distorted ones. Raises ConfigError if a lens folds."""
        target = np.asarray(xy, dtype=np.float64)
        ideal = target.copy()
        if self.limit_tan:
            target, ideal = self._within_limit(target)
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(_UNDISTORT_ITERATIONS):
                ideal = ideal + (target - self.distort(ideal))
            error = np.abs(self.distort(ideal) - target).max(initial=0.0)
        if not error < 1e-5:
            raise ConfigError(
                f"the lens distortion {self} cannot be inverted over the whole image: "
                "check the signs and the order of k1, k2, k3, p1, p2"
            )
        return ideal

    def _within_limit(self, target: Array) -> tuple[Array, Array]:
        """Clamp distorted points, (..., 2), to the model's limit, and guess their ideal points."""
        ideal_r = np.linspace(0.0, self.limit_tan, _RADII)
        distorted_r = ideal_r * self._radial(ideal_r**2)
        if (np.diff(distorted_r) <= 0).any():
            raise ConfigError(
                f"the lens distortion {self} folds before limit_tan: give a smaller limit_tan"
            )
        r = np.maximum(np.sqrt((target**2).sum(axis=-1)), 1e-12)
        held = np.minimum(r, distorted_r[-1])
        guess = np.interp(held, distorted_r, ideal_r)
        return target * (held / r)[..., None], target * (guess / r)[..., None]


@dataclass(frozen=True)
class Emitter:
    """An infrared light source, a point or a short line.

    Args:
        position_m: centre, camera frame, metres.
        spread_m: half the length of the line, metres; 0 for a point. It lies along the baseline.
        path_from_m: start of the light's path in the decoder's model; None for position_m.
        shares: shares of the light that come from the end near the camera, the centre and the far
            end of the line; their sum is 1.
    """

    position_m: Point
    spread_m: float = 0.0
    path_from_m: Point | None = None
    shares: Point = (1 / 3, 1 / 3, 1 / 3)

    @property
    def end_m(self) -> tuple[float, float]:
        """The offset (x, y), metres, from the emitter's centre to its end far from the camera."""
        x, y, _ = self.position_m
        length = math.hypot(x, y)
        return (self.spread_m * x / length, self.spread_m * y / length) if length else (0.0, 0.0)

    def shared_points_m(self) -> list[tuple[Array, float]]:
        """Return the emitter's ends and centre, (3,) metres, each with its share of the light."""
        centre, end = np.array(self.position_m), np.array([*self.end_m, 0.0])
        if not end.any():
            return [(centre, 1.0)]
        return list(zip((centre - end, centre, centre + end), self.shares, strict=True))


class SubExposure(NamedTuple):
    """A part of a frame that is exposed at one time: a capture, or a band of rows.

    Attributes:
        time_ms: middle of this exposure, counted from the frame's instant.
        capture: 0 to 8, for tap ``capture % 3`` of frequency ``capture // 3``; None for rows.
        rows: (first, end) of the band as shares of the image's height; None for a capture.
    """

    time_ms: float
    capture: int | None = None
    rows: tuple[float, float] | None = None


@dataclass(frozen=True)
class Exposure:
    """The times at which the parts of a frame are exposed; by default a single time.

    A frame's instant is the middle of its exposure. A moving scene is rendered at the time of each
    part, and glsim.render.sub_frames combines the parts into one frame.

    Args:
        captures: number of captures of a time-of-flight frame; 0 for other cameras. The first nine
            measure, frequency by frequency in the rig's order; a tenth is not used.
        spacing_ms: time from one capture to the next.
        read_out_ms: time from the first row to the last of a rolling shutter; 0 for a global one.
        bands: number of bands; the rows of a band share one time.
    """

    captures: int = 0
    spacing_ms: float = 0.0
    read_out_ms: float = 0.0
    bands: int = 16

    def parts(self) -> tuple[SubExposure, ...]:
        """Return the parts of the exposure in order of time; () if all pixels share one time."""
        if self.captures and self.spacing_ms > 0:
            middle = 0.5 * (self.captures - 1)
            return tuple(
                SubExposure((k - middle) * self.spacing_ms, capture=k)
                for k in range(TAPS * FREQUENCIES)
            )
        if self.read_out_ms > 0:
            shares = [k / self.bands for k in range(self.bands + 1)]
            return tuple(
                SubExposure((0.5 * (a + b) - 0.5) * self.read_out_ms, rows=(a, b))
                for a, b in pairwise(shares)
            )
        return ()


@dataclass(frozen=True)
class ColourCamera:
    """The pinhole colour camera of a rig; depth can be registered to its image.

    Args:
        position_m: position in the depth camera's frame, metres.
        turn_deg: rotation vector (axis times angle, degrees) from the depth camera's frame.
        covers: part of a depth pixel that covers pixels of the image: "corners" or "centre".
    """

    intrinsics: Intrinsics
    position_m: Point
    turn_deg: Point = (0.0, 0.0, 0.0)
    covers: str = "corners"

    def from_depth(self) -> Array:
        """Return the (4, 4) matrix, metres, from the depth camera's frame to this camera's."""
        import cv2

        matrix = np.eye(4)
        matrix[:3, :3] = cv2.Rodrigues(np.radians(self.turn_deg))[0]
        matrix[:3, 3] = -product(matrix[:3, :3], np.array(self.position_m))
        return matrix

    def corner_points(self, window: Rect, z_m: float) -> Array:
        """Return a window's corners at depth ``z_m``, (4, 3) metres, depth camera's frame."""
        i = self.intrinsics
        corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)]) * window[2:] + window[:2]
        rays = np.column_stack([(corners - (i.cx, i.cy)) / (i.fx, i.fy), np.ones(4)])
        return z_m * product(rays, self.from_depth()[:3, :3]) + self.position_m


@dataclass(frozen=True)
class SensorRig:
    """The hardware of a depth camera: intrinsics, lens, emitters and imagers.

    Args:
        near_m, far_m: clip planes of the rendering. (A noise stage limits the *measuring* range.)
        deliver: the grid of the delivered frame. "undistorted": a pinhole camera. "raw": the
            distorted image of the lens. "colour": the colour camera's image.
        supersample: samples per pixel along each axis, for stages that sum up light; odd.
        modulation_mhz: the three frequencies of a time-of-flight camera; otherwise empty.
        shadow_map: whether the renderer casts shadows. If False, a stage casts them.
        imagers_m: positions of the infrared imagers of a triangulating camera, camera frame,
            metres: two for stereo; one for structured light, whose second view is the first
            emitter; empty for other cameras. Their images have the rig's intrinsics.
        border_px: pixels that the imagers see left, above, right and below the delivered image.
        projector_tan: tangents of half the projector's field of view, horizontal and vertical; 0
            if the emitters project no pattern.
    """

    intrinsics: Intrinsics
    emitters: tuple[Emitter, ...] = ()
    distortion: Distortion = field(default_factory=Distortion)
    deliver: str = "undistorted"
    near_m: float = 0.1
    far_m: float = 12.0
    supersample: int = 1
    modulation_mhz: tuple[float, ...] = ()
    shadow_map: bool = True
    imagers_m: tuple[Point, ...] = ()
    border_px: tuple[int, int, int, int] = (0, 0, 0, 0)
    exposure: Exposure = field(default_factory=Exposure)
    projector_tan: tuple[float, float] = (0.0, 0.0)
    colour: ColourCamera | None = None

    @property
    def registered(self) -> ColourCamera | None:
        """The colour camera, if frames are delivered in its view."""
        return self.colour if self.deliver == "colour" else None

    @property
    def delivered(self) -> Intrinsics:
        """The intrinsics of the delivered frames."""
        return self.intrinsics if self.registered is None else self.registered.intrinsics

    def colour_rig(self) -> SensorRig:
        """Return a rig with the colour camera's view and without emitters."""
        if self.colour is None:
            raise ConfigError("the rig has no colour camera: give it a table [rig.colour]")
        return SensorRig(
            self.colour.intrinsics, near_m=self.near_m, far_m=self.far_m, shadow_map=False
        )

    def canvas(self) -> SensorRig:
        """Return this rig with its image enlarged by ``border_px``, the image of the imagers."""
        if not any(self.border_px):
            return self
        left, top, right, bottom = self.border_px
        i = self.intrinsics
        wide = i.cropped(-left, -top, i.width + left + right, i.height + top + bottom)
        return replace(self, intrinsics=wide, border_px=(0, 0, 0, 0))

    def on_canvas(self, window: Rect) -> Rect:
        """Convert a window of the delivered image to pixels of the canvas."""
        # A registered frame needs all surfaces in the window from ``near_m`` to ``far_m``.
        if self.registered is not None:
            window = self._seen_in_colour(self.registered, window)
        left, top = self.border_px[:2]
        return window._replace(left=window.left + left, top=window.top + top)

    def _seen_in_colour(self, colour: ColourCamera, window: Rect) -> Rect:
        """Return the part of the depth image that covers a window of the colour image."""
        ends = [colour.corner_points(window, z_m) for z_m in (self.near_m, self.far_m)]
        pixels = self.intrinsics.project(np.concatenate(ends))
        left, top = np.floor(pixels.min(axis=0)).astype(int).tolist()
        right, bottom = np.ceil(pixels.max(axis=0)).astype(int).tolist()
        whole = Rect(0, 0, self.intrinsics.width, self.intrinsics.height)
        return Rect(left - 1, top - 1, right - left + 2, bottom - top + 2).intersection(whole)

    @property
    def keeps_distortion(self) -> bool:
        """Whether the delivered frames have the lens distortion."""
        return self.deliver == "raw" and self.distortion != Distortion()

    @property
    def baseline_m(self) -> float:
        """The distance between the two views of a disparity, metres; 0 for a single view."""
        return norm(np.array(self.second_view_m))

    @property
    def second_view_m(self) -> Point:
        """The vector between the views (imagers, camera, emitters), camera frame, metres."""
        views = [*self.imagers_m, *(e.position_m for e in self.emitters)]
        if not self.imagers_m:
            views.insert(0, (0.0, 0.0, 0.0))
        if len(views) < 2:
            return (0.0, 0.0, 0.0)
        (ax, ay, az), (bx, by, bz) = views[:2]
        return (bx - ax, by - ay, bz - az)

    def reach_of_views(self, nearest_m: float) -> tuple[int, int, int, int]:
        """Compute how far other views shift a window to the left, top, right and bottom, px."""
        if not self.imagers_m:
            return (0, 0, 0, 0)
        views = [*self.imagers_m, np.add(self.imagers_m[0], self.second_view_m)]
        shift = np.array([view[:2] for view in views]) * (self.intrinsics.fx, self.intrinsics.fy)
        shift = np.ceil(shift / max(nearest_m, self.near_m))
        # The view from further right shows a point further left.
        left, top = np.maximum(shift.max(axis=0), 0).astype(int).tolist()
        right, bottom = np.maximum(-shift.min(axis=0), 0).astype(int).tolist()
        return left, top, right, bottom

    @property
    def emitter_m(self) -> Point:
        """The origin of the light, camera frame, metres: the emitters' mean, or the camera."""
        if not self.emitters:
            return (0.0, 0.0, 0.0)
        x, y, z = np.mean([e.path_from_m or e.position_m for e in self.emitters], axis=0)
        return (float(x), float(y), float(z))

    def rays(self) -> Floats:
        """Return the undistorted rays x/z, y/z, (H, W, 2) read-only; ConfigError for a bad lens."""
        return _rays(self.intrinsics, self.distortion if self.keeps_distortion else None)

    def for_map(
        self,
        shape: tuple[int, int],
        focal_px: tuple[float, float] | None = None,
        centre_px: tuple[float, float] | None = None,
    ) -> SensorRig:
        """Return the rig for an uncalibrated depth map: see ``Intrinsics.for_map``."""
        if self.registered is not None:
            raise ConfigError(
                "this sensor registers depth to colour, but a map's noise arises in the depth "
                'camera: choose a sensor without deliver = "colour"'
            )
        return replace(self, intrinsics=self.intrinsics.for_map(shape, focal_px, centre_px))

    def pinhole(self) -> Intrinsics:
        """Return the pinhole camera that rasterises; its image covers all distorted rays."""
        i = self.intrinsics
        if not self.keeps_distortion:
            return i
        seen_px = self.rays().reshape(-1, 2) * (i.fx, i.fy)
        left, top = (np.floor(seen_px.min(axis=0)).astype(int) - 1).tolist()
        right, bottom = (np.ceil(seen_px.max(axis=0)).astype(int) + 2).tolist()
        return Intrinsics(right - left, bottom - top, i.fx, i.fy, float(-left), float(-top))


@lru_cache(maxsize=4)
def _rays(image: Intrinsics, lens: Distortion | None) -> Floats:
    """Compute ``SensorRig.rays``, cached because inverting a Kinect V2's lens takes 0.15 s."""
    rays = image.rays()
    if lens is not None:
        rays = lens.undistort(rays).astype(np.float32)
    rays.flags.writeable = False
    return rays
