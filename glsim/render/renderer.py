"""Render meshes for a sensor rig: the clean layers from which the noise stages start.

    mesh --surface.vert/.frag @camera--> clean, normal, albedo
    clean, normal, mesh --ShadowMap----> lit
    mesh --RegionPass @camera----------> region, on request

A supersampling rig draws depth and albedo on a finer grid (samples.frag). The middle sample of a
pixel is its clean depth, the median of its samples at hair (centres.frag); stages read the samples.

If the delivered image keeps the lens distortion, the camera draws a wider pinhole image, and
lens.frag samples its layers on the distorted grid.

In a triangulating rig each imager is drawn like the camera, from its own position:

    mesh --@imager--> left_clean, left_normal (and right_...) --ShadowMap--> left_lit
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from moderngl import Context
from numpy.typing import NDArray

from glsim.core import bounds
from glsim.core.camera import Point, SensorRig
from glsim.core.errors import MeshError
from glsim.core.mesh import SKIN_ALBEDO, Mesh
from glsim.core.pose import pose_matrix
from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.gl.draw import FullscreenPass, draw_meshes
from glsim.gl.includes import SHADER_ROOT
from glsim.gl.program import link, link_files, link_meshes
from glsim.gl.shader_source import load_source
from glsim.gl.targets import Target, TargetPool
from glsim.render.mesh_cache import GpuMesh, MeshCache
from glsim.render.region_pass import REGION, RegionPass
from glsim.render.shadow_map import LIT, LIT_BY_EACH, ShadowMap, View
from glsim.render.silhouette import Silhouette, SilhouettePass

CLEAN = Layer("clean", "float")
NORMAL = Layer("normal", "vec4")
ALBEDO = Layer("albedo", "float")
UNEVEN = Layer("uneven", "float")
_RAYS = Layer("rays", "vec2")

#: Prefixes of the layers of the first and the second imager.
_SIDES = ("left", "right")


@dataclass(frozen=True, eq=False)
class Rendered:
    """The clean layers of a rendered scene, valid within the ``with`` block that made them.

    Attributes:
        layers: targets by name: clean (m along the axis, 0 = no surface), normal (unit vector
            towards the camera, albedo), albedo, lit (0 to 1), and region if labels were given. A
            supersampling rig adds fine_seen (depth and albedo of the samples) and uneven. A rig
            with imagers adds glsim.noise.layer_names.IMAGER_LAYERS.
        window: the part of the frame that the layers hold.
        nearest_m: a lower bound of all depths in the scene.
        face_m: nearest and farthest depth of the first mesh's bounding box, the face.
        silhouette: limits passes to the pixels with a surface.
        rays: x/z and y/z of each pixel's ray in the whole frame; the renderer owns this target.
        pool: owner of the other targets; later passes of the frame take targets from it.
    """

    layers: Mapping[str, Target]
    window: Rect
    nearest_m: float
    face_m: tuple[float, float]
    silhouette: Silhouette
    rays: Target
    pool: TargetPool


class Renderer:
    """A renderer of meshes for one rig; it owns the programs, z-buffers and target pool."""

    def __init__(self, context: Context, rig: SensorRig) -> None:
        self._context, self.rig = context, rig
        image, pinhole = rig.intrinsics, rig.pinhole()
        self._pinhole, self._sight = pinhole, bounds.FieldOfView.of(rig)
        self._pool = TargetPool(context, image.width, image.height)
        self._camera_pool = self._pool
        if rig.keeps_distortion:
            self._camera_pool = TargetPool(context, pinhole.width, pinhole.height)
        self._silhouettes = SilhouettePass(self._pool)
        self._rays = self._pool.upload(_RAYS, rig.rays())
        self._drawn: tuple[Layer, ...] = (CLEAN, NORMAL, ALBEDO)
        fragment = "render/surface.frag"
        self._centres: FullscreenPass | None = None
        if rig.supersample > 1:
            fragment = "render/samples.frag"
            self._centres = supersampled_pass(context, rig, "centres.frag")
            # The layers of the samples: depth and albedo.
            self._drawn = (Layer("fine_seen", "vec2", Fraction(rig.supersample)),)
        self._surface = link_meshes(context, fragment, "render/surface.vert", rig.supersample)
        self._surface.set_matrix("u_clip", pinhole.clip_matrix(rig.near_m, rig.far_m))
        self._lens_pass: FullscreenPass | None = None
        if rig.supersample > 1 and rig.keeps_distortion:
            self._lens_pass = supersampled_pass(context, rig, "lens_samples.frag")
        elif rig.keeps_distortion:
            self._lens_pass = FullscreenPass(context, link_files(context, "render/lens.frag"))
        fine = pinhole.finer(rig.supersample)
        self._depth = context.depth_renderbuffer((fine.width, fine.height))
        self._shadow_map = ShadowMap(self._pool, rig, self._sight, self._rays)
        self._meshes = MeshCache(context, self._surface, self._shadow_map.programs)

    @cached_property
    def _regions(self) -> RegionPass:
        """The pass that draws face regions; it is linked at its first use."""
        return RegionPass(self._context, self.rig, (self._camera_pool, self._pool), self._rays)

    @contextmanager
    def render(
        self, meshes: Sequence[tuple[Mesh, NDArray[np.float32]]], visible: Rect | None = None,
        labels: Sequence[NDArray[np.float32] | None] = (), reach_px: int = 0,
        window: Rect | None = None,
    ) -> Iterator[Rendered]:  # fmt: skip
        """Draw meshes, each with a (4, 4) matrix from canonical mm to camera-frame m.

        Raises MeshError if the first mesh, the face, is not in view.

        Args:
            meshes: each mesh with its (4, 4) matrix; the face is first.
            visible: the delivered crop (None: the whole frame).
            labels: for each mesh the (V,) region numbers of its vertices, or None; without labels
                the layer region is not drawn.
            reach_px: distance around the crop at which stages read pixels, besides the margin.
            window: the part of the frame to draw; default: the part that the meshes can touch.
        """
        boxes = [bounds.bounding_corners(mesh.vertices_mm, view) for mesh, view in meshes]
        window = window or self.window(meshes, visible, reach_px, boxes)
        uploaded = [self._meshes.upload(mesh) for mesh, _ in meshes]
        views = [view for _, view in meshes]
        corners_m = np.concatenate(boxes)
        nearest_m = max(self.rig.near_m, float(corners_m[:, 2].min()))
        with self._pool.scope() as held:
            layers = self._draw_surface(uploaded, views, window)
            held += layers.values()
            if self._centres is not None:
                pixels = self._reduced(self._centres, layers["fine_seen"], window)
                held += pixels.values()
                layers |= pixels
            with ExitStack() as silhouettes:
                uneven = layers.get("uneven", layers["clean"])
                seen = silhouettes.enter_context(self._silhouettes.draw(uneven, window))
                layers |= self._draw_light(
                    View(layers, seen), uploaded, views, corners_m, window,
                    held, silhouettes,
                )  # fmt: skip
                if labels:
                    layers[REGION.name] = self._regions.draw(uploaded, labels, views, window)
                    held.append(layers[REGION.name])
                face_m = float(boxes[0][:, 2].min()), float(boxes[0][:, 2].max())
                yield Rendered(layers, window, nearest_m, face_m, seen, self._rays, self._pool)

    def _draw_light(
        self, camera: View, meshes: Sequence[GpuMesh], views: Sequence[NDArray[np.float32]],
        corners_m: NDArray[np.float64], window: Rect, held: list[Target], silhouettes: ExitStack,
    ) -> dict[str, Target]:  # fmt: skip
        """Draw the depth and normals of the imagers, and the light in all views."""
        seen = [camera]
        layers: dict[str, Target] = {}
        for side, eye_m in zip(_SIDES, self.rig.imagers_m, strict=False):
            drawn, silhouette = camera.layers, camera.silhouette
            if any(eye_m):
                drawn = self._draw_surface(meshes, views, window, eye_m)
                held += drawn.values()
                silhouette = silhouettes.enter_context(
                    self._silhouettes.draw(drawn["clean"], window)
                )
            layers |= {f"{side}_{name}": drawn[name] for name in ("clean", "normal")}
            seen.append(View(drawn, silhouette, eye_m, LIT_BY_EACH))
        arrays = [mesh.projector for mesh in meshes] if self.rig.shadow_map else []
        names = (LIT.name, *(f"{side}_{LIT.name}" for side in _SIDES))
        lit = self._shadow_map.draw(seen, window, arrays, views, corners_m)
        held += lit
        return layers | dict(zip(names, lit, strict=False))

    def window(
        self, meshes: Sequence[tuple[Mesh, NDArray[np.float32]]], visible: Rect | None = None,
        reach_px: int = 0, boxes: Sequence[NDArray[np.float64]] = (),
    ) -> Rect:  # fmt: skip
        """Return the window of the image to render for the meshes. Raises MeshError.

        Arguments as of ``render``; ``boxes``: (8, 3) corners of each mesh's bounding box, camera
        frame, if they are known.
        """
        boxes = boxes or [bounds.bounding_corners(mesh.vertices_mm, view) for mesh, view in meshes]
        face, view = meshes[0]
        around = bounds.vertex_frustum(face.vertices_mm, view, self.rig.near_m)
        windows = [bounds.image_window(boxes[0], self._sight, visible, reach_px, around)]
        for (mesh, view), box in zip(meshes[1:], boxes[1:], strict=True):
            with suppress(MeshError):  # a mesh out of view
                wanted = bounds.image_window(box, self._sight, visible, reach_px)
                if bounds.union([windows[0], wanted]) != windows[0]:
                    # Trousers of a sitting person: their box is far wider than the mesh.
                    around = bounds.vertex_frustum(mesh.vertices_mm, view, self.rig.near_m)
                    wanted = bounds.image_window(box, self._sight, visible, reach_px, around)
                windows.append(wanted)
        nearest_m = float(np.concatenate(boxes)[:, 2].min())
        return bounds.widened(
            bounds.union(windows), self._sight, self.rig.reach_of_views(nearest_m)
        )

    @contextmanager
    def everywhere(self, window: Rect) -> Iterator[Silhouette]:
        """Yield a silhouette that covers all pixels of a window."""
        with self._silhouettes.draw(None, window) as silhouette:
            yield silhouette

    @contextmanager
    def light_depth_map(
        self, clean_m: NDArray[np.float32], normal: NDArray[np.float32], surface: Mesh | None
    ) -> Iterator[Rendered]:
        """Make the layers of a whole frame from a depth map instead of meshes.

        Raises MeshError if an emitter is inside the surface. The map is (H, W) metres, 0 = no
        surface, with unit normals (H, W, 3) towards the camera. ``surface``, placed by
        ``pose_matrix({})``, casts the shadows; None: no shadows.
        """
        image = self.rig.intrinsics
        window = Rect(0, 0, image.width, image.height)
        albedo = np.where(clean_m > 0, np.float32(SKIN_ALBEDO), np.float32(0.0))
        view = pose_matrix({})
        box = (
            np.zeros((0, 3))
            if surface is None
            else bounds.bounding_corners(surface.vertices_mm, view)
        )
        meshes = [] if surface is None else [self._meshes.upload(surface)]
        with self._pool.scope() as held, ExitStack() as silhouettes:
            everywhere = silhouettes.enter_context(self._silhouettes.draw(None, window))
            layers = {
                "clean": self._pool.upload(CLEAN, clean_m),
                "normal": self._pool.upload(NORMAL, np.dstack([normal, albedo])),
                "albedo": self._pool.upload(ALBEDO, albedo),
            }
            held += layers.values()
            layers |= self._draw_light(
                View(layers, everywhere), meshes, [view] * len(meshes), box, window,
                held, silhouettes,
            )  # fmt: skip
            nearest_m = float(clean_m[clean_m > 0].min(initial=np.inf))
            face_m = nearest_m, float(clean_m.max(initial=0.0))
            yield Rendered(layers, window, nearest_m, face_m, everywhere, self._rays, self._pool)

    def _draw_surface(
        self, meshes: Sequence[GpuMesh], views: Sequence[NDArray[np.float32]], window: Rect,
        eye_m: Point = (0.0, 0.0, 0.0),
    ) -> dict[str, Target]:  # fmt: skip
        """Draw the meshes' depth, normal and albedo per pixel, or per sample if supersampled."""
        pinhole, pool = self._pinhole, self._camera_pool
        area = window if self._lens_pass is None else Rect(0, 0, pinhole.width, pinhole.height)
        targets = [pool.take(layer, area) for layer in self._drawn]
        buffer = pool.framebuffer(targets, self._depth)
        buffer.use()
        fine, drawn = pinhole.finer(self.rig.supersample), self._drawn[0].window(area)
        buffer.viewport = (0, 0, fine.width, fine.height)
        buffer.scissor = drawn
        buffer.clear(viewport=drawn)
        arrays = [mesh.surface for mesh in meshes]
        draw_meshes(self._context, arrays, views, eye_m)
        layers = {target.layer.name: target for target in targets}
        if self._lens_pass is None:
            return layers
        return self._through_lens(self._lens_pass, layers, window)

    def _through_lens(
        self, lens: FullscreenPass, pinhole: dict[str, Target], window: Rect
    ) -> dict[str, Target]:
        """Resample pinhole layers to the grid of the lens; give the pinhole targets back."""
        layers = {t.layer.name: self._pool.take(t.layer, window) for t in pinhole.values()}
        read = {f"pinhole_{name.removeprefix('fine_')}": t for name, t in pinhole.items()}
        p = self._pinhole.finer(self.rig.supersample)
        lens.program["u_pinhole"] = (p.fx, p.fy, p.cx, p.cy)
        buffer = self._pool.framebuffer(list(layers.values()))
        lens.draw(buffer, self._drawn[0].window(window), rays=self._rays, **read)
        for target in pinhole.values():
            self._camera_pool.give_back(target)
        return layers

    def _reduced(self, centres: FullscreenPass, samples: Target, window: Rect) -> dict[str, Target]:
        """Reduce samples to pixels: the middle sample, and how much the samples differ."""
        targets = [self._pool.take(layer, window) for layer in (CLEAN, NORMAL, ALBEDO, UNEVEN)]
        centres.draw(self._pool.framebuffer(targets), window, fine_seen=samples, rays=self._rays)
        return {target.layer.name: target for target in targets}


def supersampled_pass(context: Context, rig: SensorRig, file: str) -> FullscreenPass:
    """Link a shader in shaders/render/ that reads all samples of a pixel.

    The number of samples per axis is its constant SAMPLES_PER_AXIS, so that its loops unroll.
    """
    source = load_source(SHADER_ROOT / "render" / file)
    program = link(context, source.with_defines(SAMPLES_PER_AXIS=rig.supersample))
    program["u_focal_px"] = rig.intrinsics.fx, rig.intrinsics.fy
    return FullscreenPass(context, program)
