"""Shadow mapping: an emitter's z-buffer, and the share of its light that reaches each pixel.

    meshes --projector.vert @emitter--> z-buffer
    clean, normal + z-buffer --lit.frag--> lit

Emitters are drawn in turn into the same z-buffer; each adds its share to ``lit`` of each view.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.core.bounds import FieldOfView, Frustum, emitter_frustum
from glsim.core.camera import Emitter, Intrinsics, Point, SensorRig
from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.gl.draw import FullscreenPass, draw_meshes
from glsim.gl.program import link_files, link_meshes
from glsim.gl.targets import Target, TargetPool
from glsim.render.silhouette import Silhouette

LIT = Layer("lit", "float")
#: The layer of light in an imager's view: one share for each of two projectors.
LIT_BY_EACH = Layer("lit", "vec2")

#: Texels of an emitter's z-buffer per camera pixel: shadow edges are finer than the image. Chosen.
_TEXELS_PER_PIXEL = 1.5
#: Side of the z-buffer, texels; a scene that needs more gets fewer texels per pixel.
_SIDE_TEXELS = 2048


@dataclass(frozen=True, eq=False)
class View:
    """The view of the camera or an imager: its layers clean and normal, and the layer of its light.

    ``eye_m``: its position in the camera frame, metres.
    """

    layers: Mapping[str, Target]
    silhouette: Silhouette
    eye_m: Point = (0.0, 0.0, 0.0)
    lit: Layer = LIT


class ShadowMap:
    """A pass that draws the layer ``lit``, the share of light, for the views of a rig."""

    def __init__(self, pool: TargetPool, rig: SensorRig, sight: FieldOfView, rays: Target) -> None:
        """Store the rig, its field of view, and the target that holds ``rig.rays()``."""
        self._pool, self._rig, self._sight, self._rays = pool, rig, sight, rays
        self._context = context = pool.context
        #: Programs that draw meshes into the z-buffer.
        self.programs = link_meshes(context, "render/projector.frag", "render/projector.vert")
        self._pass = FullscreenPass(context, link_files(context, "render/lit.frag"))
        nearest = moderngl.NEAREST, moderngl.NEAREST
        self._unfiltered = context.sampler(filter=nearest, compare_func="")

    @cached_property
    def _depth(self) -> moderngl.Texture:
        """The emitter's z-buffer, 17 MB; it is made at its first use."""
        depth = self._context.depth_texture((_SIDE_TEXELS, _SIDE_TEXELS))
        depth.compare_func = "<="
        depth.filter = (moderngl.LINEAR, moderngl.LINEAR)
        return depth

    @cached_property
    def _buffer(self) -> moderngl.Framebuffer:
        return self._context.framebuffer([], self._depth)

    def draw(
        self, seen: Sequence[View], window: Rect, arrays: Sequence[moderngl.VertexArray],
        views: Sequence[NDArray[np.float32]], corners_m: NDArray[np.float64],
    ) -> list[Target]:  # fmt: skip
        """Draw the share of light that reaches each pixel, 0 to 1; return one target per view.

        Raises MeshError if an emitter is inside the scene. ``arrays``, of meshes for ``programs``,
        cast shadows; without them, or without an emitter, all pixels are 1. ``corners_m``: (N, 3)
        corners of the meshes' bounding boxes, camera frame.
        """
        emitters = self._rig.emitters if arrays else ()
        targets = []
        for view in seen:
            targets.append(self._pool.take(view.lit, window))
            buffer = self._pool.framebuffer(targets[-1:])
            buffer.use()
            level = 0.0 if emitters else 1.0
            buffer.clear(level, level, viewport=window)
        for number, emitter in enumerate(emitters):
            box = emitter_frustum(corners_m, self._sight, emitter.position_m)
            box = box.widened(emitter.spread_m * (1 / box.near_m - 1 / box.far_m))
            self._draw_depth(emitter, box, arrays, views)
            component = (1.0, 0.0) if number == 0 else (0.0, 1.0)
            for view, lit in zip(seen, targets, strict=True):
                weight = (1.0 / len(emitters), 0.0) if view.lit is LIT else component
                self._add_light(lit, view, window, weight)
        return targets

    def _draw_depth(
        self, emitter: Emitter, box: Frustum, arrays: Sequence[moderngl.VertexArray],
        views: Sequence[NDArray[np.float32]],
    ) -> None:  # fmt: skip
        """Draw the emitter's z-buffer for the frustum ``box``; set the uniforms that read it."""
        span = max(box.right - box.left, box.bottom - box.top)
        wanted = _TEXELS_PER_PIXEL * self._rig.intrinsics.fx
        focal = min(wanted, (_SIDE_TEXELS - 4) / max(span, 1e-6))
        # With a margin of two texels the linear filter reads drawn texels only.
        left, top = box.left - 2 / focal, box.top - 2 / focal
        width = min(_SIDE_TEXELS, int(np.ceil((box.right - box.left) * focal)) + 4)
        height = min(_SIDE_TEXELS, int(np.ceil((box.bottom - box.top) * focal)) + 4)
        view = Intrinsics(width, height, focal, focal, -left * focal, -top * focal)
        near, far = box.near_m * 0.99, box.far_m * 1.01
        self.programs.set_matrix("u_clip", view.clip_matrix(near, far))
        self._buffer.use()
        self._buffer.viewport = self._buffer.scissor = (0, 0, width, height)
        self._buffer.clear(viewport=(0, 0, width, height))
        draw_meshes(self._context, arrays, views, emitter.position_m)
        scale = focal / _SIDE_TEXELS
        program = self._pass.program
        program["u_emitter_m"] = emitter.position_m
        program["u_spread_m"] = emitter.end_m
        program["u_shares"] = emitter.shares
        program["u_map"] = (scale, scale, -left * scale, -top * scale)
        program["u_map_range"] = (near, far)
        program["u_texel"] = 1.0 / focal

    def _add_light(
        self, lit: Target, view: View, window: Rect, weight: tuple[float, float]
    ) -> None:
        """Add one emitter's light to a view's target ``lit``; ``weight`` is per component."""
        self._context.blend_func = moderngl.ONE, moderngl.ONE
        program = self._pass.program
        self._depth.use(3)
        self._depth.use(4)
        self._unfiltered.use(4)
        program["u_projector"], program["u_projector_depth"] = 3, 4
        program["u_weight"] = weight
        program["u_eye_m"] = view.eye_m
        with view.silhouette.limits([lit], window, None, moderngl.BLEND):
            clean, normal = (view.layers[name] for name in ("clean", "normal"))
            self._pass.draw(clean=clean, normal=normal, rays=self._rays)
        self._unfiltered.clear(4)
