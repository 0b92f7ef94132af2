"""A face and a sensor rig to clean layers: two z-buffers, and what follows from them.

    mesh --surface.vert/.frag @camera--> clean, normal, albedo
    mesh --projector.vert @emitter----> z-buffer
    clean + z-buffer --lit.frag-------> lit

A rig that supersamples has depth and albedo drawn on a finer grid (samples.frag); the middle sample
of a pixel is its clean depth (centres.frag), and the samples are kept for the stages.

For a rig that keeps its lens distortion, the camera draws a wider pinhole image and lens.frag
brings its layers to the distorted grid.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.bounds import Sight, Tangents, corners, emitter_view, image_window, union
from glsim.camera import Emitter, Intrinsics, SensorRig
from glsim.frame import Rect
from glsim.gl.meshes import draw_meshes, index_buffer
from glsim.gl.program import link_files
from glsim.gl.silhouette import Silhouette
from glsim.gl.source import Layer
from glsim.gl.targets import Target, TargetPool, set_matrix
from glsim.mesh import SKIN_ALBEDO, Mesh
from glsim.pose import pose_matrix
from glsim.regionpass import REGION, Labelled, RegionPass
from glsim.samples import Centres, sample_layer, samples_pass

CLEAN = Layer("clean", "float")
NORMAL = Layer("normal", "vec4")
ALBEDO = Layer("albedo", "float")
LIT = Layer("lit", "float")
_RAYS = Layer("rays", "vec2")

#: Texels of an emitter's z-buffer a camera pixel, so that shadow edges are finer than the image.
_MAP_DENSITY = 1.5
#: Side of the z-buffer; a scene that needs more gets fewer texels a pixel.
_MAP_SIZE = 2048
#: Topologies kept on the GPU; a data set has one a source, or one a file.
_CACHED_TOPOLOGIES = 4


@dataclass(eq=False)
class _Drawable:
    faces: NDArray[np.int32]
    positions: moderngl.Buffer
    albedos: moderngl.Buffer
    indices: moderngl.Buffer
    surface: moderngl.VertexArray
    projector: moderngl.VertexArray
    albedo: object = field(default_factory=object)  # what ``albedos`` holds; at first, nothing


class Renderer:
    """Draws meshes for one rig. Owns the programs, the z-buffers and the target pool."""

    def __init__(self, context: moderngl.Context, rig: SensorRig) -> None:
        self.context, self.rig = context, rig
        image, pinhole = rig.intrinsics, rig.pinhole()
        self._pinhole, self._sight = pinhole, Sight.of(rig)
        self.pool = TargetPool(context, image.width, image.height)
        self._camera_pool = (
            TargetPool(context, pinhole.width, pinhole.height) if rig.is_raw else self.pool
        )
        #: Of the frame that was rendered last.
        self.silhouette = Silhouette(self.pool)
        self.rays = self.pool.upload(_RAYS, rig.rays())
        self._drawn: tuple[Layer, ...] = (CLEAN, NORMAL, ALBEDO)
        drawing, lens = "surface", "lens"
        if rig.supersample > 1:
            drawing, lens = "samples", "lens_samples"
            self._centres = Centres(context, rig, self.rays, self._drawn)
            self._drawn = (sample_layer(rig),)
        #: No depth of the scene that was rendered last is less.
        self.nearest_m = 0.0
        self._surface = link_files(context, "render/surface.vert", f"render/{drawing}.frag")
        self._projector = link_files(context, "render/projector.vert", "render/projector.frag")
        self._lit_pass = self._fullscreen("render/lit.frag")
        self._lens_pass = samples_pass(context, rig, f"{lens}.frag") if rig.is_raw else None
        set_matrix(self._surface, "u_clip", pinhole.clip_matrix(rig.near_m, rig.far_m))
        fine = pinhole.finer(rig.supersample)
        self._depth = context.depth_renderbuffer((fine.width, fine.height))
        self._camera_buffers: dict[tuple[int, ...], moderngl.Framebuffer] = {}
        self._map = context.depth_texture((_MAP_SIZE, _MAP_SIZE))
        self._map.compare_func = "<="
        self._map.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._map_depth = context.sampler(
            filter=(moderngl.NEAREST, moderngl.NEAREST), compare_func=""
        )
        self._map_buffer = context.framebuffer([], self._map)
        self._drawables: OrderedDict[int, _Drawable] = OrderedDict()
        self._regions: RegionPass | None = None

    def _fullscreen(self, name: str) -> moderngl.VertexArray:
        program = link_files(self.context, "render/fullscreen.vert", name)
        return self.context.vertex_array(program, [])

    def render(
        self,
        meshes: Sequence[tuple[Mesh, NDArray[np.float32]]],
        visible: Rect | None = None,
        labels: Sequence[NDArray[np.float32] | None] = (),
        reach_px: int = 0,
    ) -> tuple[dict[str, Target], Rect]:
        """Draw meshes, each with its (4, 4) matrix from canonical mm to camera m.

        visible: the crop that will be delivered (None: all). labels: one a mesh, (V,) numbers of
        its vertices' regions or None; empty: the layer region is not drawn. reach_px: how far
        around the crop stages look besides the margin.
        Returns the layers clean, normal, albedo and lit, those of the finer grid if the rig has
        one (fine_seen, uneven), and the window they are drawn in; give
        the targets back to ``pool``. Raises MeshError if the first mesh, the face, is not in view.
        """
        boxes = [corners(mesh.vertices_mm, view) for mesh, view in meshes]
        window = union([image_window(box, self._sight, visible, reach_px) for box in boxes])
        drawables = [self._drawable(mesh) for mesh, _ in meshes]
        views = [view for _, view in meshes]
        layers = self._draw_surface(drawables, views, window)
        if self.rig.supersample > 1:
            layers |= self._centres.take(self.pool, layers["fine_seen"], window)
        self.silhouette.draw(layers.get("uneven", layers["clean"]), window)
        corners_m = np.concatenate(boxes)
        self.nearest_m = max(self.rig.near_m, float(corners_m[:, 2].min()))
        casting = drawables if self.rig.shadow_map else []
        layers["lit"] = self._draw_lit(layers, window, casting, views, corners_m)
        if labels:
            labelled = [
                Labelled(d.faces, d.positions, of_mesh)
                for d, of_mesh in zip(drawables, labels, strict=True)
            ]
            layers[REGION.name] = self._region_pass().draw(labelled, views, window)
        return layers, window

    def _region_pass(self) -> RegionPass:
        if self._regions is None:
            pools = self._camera_pool, self.pool
            self._regions = RegionPass(self.context, self.rig, pools, self.rays)
        return self._regions

    def light_depth_map(
        self, clean_m: NDArray[np.float32], normal: NDArray[np.float32], surface: Mesh | None
    ) -> dict[str, Target]:
        """The same layers, of the whole frame, for a depth map that exists already.

        clean_m: (H, W) metres, normal: (H, W, 3) unit vectors towards the camera; surface: what
        throws the shadows, placed by ``pose_matrix({})``, or None for nothing.
        """
        image = self.rig.intrinsics
        window = Rect(0, 0, image.width, image.height)
        self.silhouette.leaves_out = False
        view = pose_matrix({})
        albedo = np.where(clean_m > 0, np.float32(SKIN_ALBEDO), np.float32(0.0))
        layers = {
            "clean": self.pool.upload(CLEAN, clean_m),
            "normal": self.pool.upload(NORMAL, np.dstack([normal, albedo])),
            "albedo": self.pool.upload(ALBEDO, albedo),
        }
        casts = surface is not None and self.rig.shadow_map
        drawables = [self._drawable(surface)] if surface is not None and casts else []
        box = np.zeros((0, 3)) if surface is None else corners(surface.vertices_mm, view)
        layers["lit"] = self._draw_lit(layers, window, drawables, [view] * len(drawables), box)
        return layers

    def _drawable(self, mesh: Mesh) -> _Drawable:
        """The mesh on the GPU; its topology is uploaded once, its vertices each time."""
        key = id(mesh.faces)
        drawable = self._drawables.get(key)
        if drawable is None or drawable.positions.size != mesh.vertices_mm.nbytes:
            drawable = self._upload_topology(mesh)
            self._drawables[key] = drawable
            if len(self._drawables) > _CACHED_TOPOLOGIES:
                self._drawables.popitem(last=False)
        self._drawables.move_to_end(key)
        drawable.positions.write(np.ascontiguousarray(mesh.vertices_mm, dtype=np.float32))
        if drawable.albedo is not mesh.albedo:
            albedo = np.full(len(mesh.vertices_mm), SKIN_ALBEDO, np.float32)
            drawable.albedos.write(albedo if mesh.albedo is None else mesh.albedo)
            drawable.albedo = mesh.albedo
        return drawable

    def _upload_topology(self, mesh: Mesh) -> _Drawable:
        make = self.context.buffer
        positions = make(reserve=mesh.vertices_mm.nbytes, dynamic=True)
        albedos = make(reserve=4 * len(mesh.vertices_mm))
        indices, index_size = index_buffer(self.context, mesh.faces, len(mesh.vertices_mm))
        position = (positions, "3f", "in_position_mm")
        surface = self.context.vertex_array(
            self._surface, [position, (albedos, "1f", "in_albedo")], indices, index_size
        )
        projector = self.context.vertex_array(self._projector, [position], indices, index_size)
        return _Drawable(mesh.faces, positions, albedos, indices, surface, projector)

    def _draw_surface(
        self,
        drawables: Sequence[_Drawable],
        views: Sequence[NDArray[np.float32]],
        window: Rect,
    ) -> dict[str, Target]:
        pinhole, pool = self._pinhole, self._camera_pool
        area = window if self._lens_pass is None else Rect(0, 0, pinhole.width, pinhole.height)
        targets = [pool.take(layer, area) for layer in self._drawn]
        key = tuple(target.texture.glo for target in targets)
        if key not in self._camera_buffers:
            textures = [target.texture for target in targets]
            self._camera_buffers[key] = self.context.framebuffer(textures, self._depth)
        buffer = self._camera_buffers[key]
        buffer.use()
        fine, drawn = pinhole.finer(self.rig.supersample), self._drawn[0].window(area)
        buffer.viewport = (0, 0, fine.width, fine.height)
        buffer.scissor = drawn
        buffer.clear(viewport=drawn)
        draw_meshes(self.context, [d.surface for d in drawables], self._surface, views)
        layers = {target.layer.name: target for target in targets}
        return layers if self._lens_pass is None else self._through_lens(layers, window)

    def _through_lens(self, pinhole: dict[str, Target], window: Rect) -> dict[str, Target]:
        assert self._lens_pass is not None
        layers = {t.layer.name: self.pool.take(t.layer, window) for t in pinhole.values()}
        buffer = self.pool.framebuffer(list(layers.values()))
        buffer.use()
        buffer.viewport = self._drawn[0].window(window)
        for unit, (name, target) in enumerate(pinhole.items()):
            target.texture.use(unit)
            self._lens_pass.program[f"u_pinhole_{name.removeprefix('fine_')}"] = unit
        self.rays.texture.use(len(pinhole))
        self._lens_pass.program["u_rays"] = len(pinhole)
        p = self._pinhole.finer(self.rig.supersample)
        self._lens_pass.program["u_pinhole"] = (p.fx, p.fy, p.cx, p.cy)
        self._lens_pass.render(moderngl.TRIANGLES, vertices=3)
        for target in pinhole.values():
            self._camera_pool.give_back(target)
        return layers

    def _draw_lit(
        self,
        layers: dict[str, Target],
        window: Rect,
        drawables: Sequence[_Drawable],
        views: Sequence[NDArray[np.float32]],
        corners_m: NDArray[np.float64],
    ) -> Target:
        """The share of the emitters that reaches a pixel; all of them if nothing is in the way."""
        emitters = self.rig.emitters if drawables else ()
        lit = self.pool.take(LIT, window)
        buffer = self.pool.framebuffer([lit])
        buffer.use()
        buffer.clear(0.0 if emitters else 1.0, viewport=window)
        for emitter in emitters:
            box = emitter_view(corners_m, self._sight, emitter.position_m)
            box = box.widened(emitter.spread_m * (1 / box.near_m - 1 / box.far_m))
            self._draw_map(emitter, box, drawables, views)
            self.context.blend_func = moderngl.ONE, moderngl.ONE
            for unit, name in enumerate(("clean", "normal")):
                layers[name].texture.use(unit)
                self._lit_pass.program[f"u_{name}"] = unit
            self.rays.texture.use(2)
            self._map.use(3)
            self._map.use(4)
            self._map_depth.use(4)
            self._lit_pass.program["u_rays"], self._lit_pass.program["u_projector"] = 2, 3
            self._lit_pass.program["u_projector_depth"] = 4
            self._lit_pass.program["u_weight"] = 1.0 / len(emitters)
            with self.silhouette.limits([lit], window, None, moderngl.BLEND):
                self._lit_pass.render(moderngl.TRIANGLES, vertices=3)
            self._map_depth.clear(4)
        return lit

    def _draw_map(
        self,
        emitter: Emitter,
        box: Tangents,
        drawables: Sequence[_Drawable],
        views: Sequence[NDArray[np.float32]],
    ) -> None:
        """The emitter's z-buffer of ``box``, and the uniforms that look things up in it."""
        span = max(box.right - box.left, box.bottom - box.top)
        focal = min(_MAP_DENSITY * self._pinhole.fx, (_MAP_SIZE - 4) / max(span, 1e-6))
        # Two texels around, so that the linear filter never reads beyond what was drawn.
        left, top = box.left - 2 / focal, box.top - 2 / focal
        width = min(_MAP_SIZE, int(np.ceil((box.right - box.left) * focal)) + 4)
        height = min(_MAP_SIZE, int(np.ceil((box.bottom - box.top) * focal)) + 4)
        view = Intrinsics(width, height, focal, focal, -left * focal, -top * focal)
        near, far = box.near_m * 0.99, box.far_m * 1.01
        set_matrix(self._projector, "u_clip", view.clip_matrix(near, far))
        self._map_buffer.use()
        self._map_buffer.viewport = self._map_buffer.scissor = (0, 0, width, height)
        self._map_buffer.clear(viewport=(0, 0, width, height))
        arrays = [d.projector for d in drawables]
        draw_meshes(self.context, arrays, self._projector, views, emitter.position_m)
        scale = focal / _MAP_SIZE
        program = self._lit_pass.program
        program["u_emitter_m"] = emitter.position_m
        program["u_spread_m"] = emitter.end_m
        program["u_map"] = (scale, scale, -left * scale, -top * scale)
        program["u_map_range"] = (near, far)
        program["u_texel"] = 1.0 / focal
