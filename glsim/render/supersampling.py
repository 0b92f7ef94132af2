"""Supersampling: the finer grid of a rig, and its reduction to one value per pixel."""

from __future__ import annotations

from fractions import Fraction

import moderngl

from glsim.core.camera import SensorRig
from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.gl.draw import FullscreenPass
from glsim.gl.includes import SHADER_ROOT
from glsim.gl.program import link
from glsim.gl.shader_source import load_source
from glsim.gl.targets import Target, TargetPool

UNEVEN = Layer("uneven", "float")


def sample_layer(rig: SensorRig) -> Layer:
    """Return the layer that holds depth and albedo of the samples."""
    return Layer("fine_seen", "vec2", Fraction(rig.supersample))


def supersampled_pass(context: moderngl.Context, rig: SensorRig, file: str) -> FullscreenPass:
    """Link a shader below shaders/render/ that visits the samples of a pixel.

    Samples per axis are a constant in it, SAMPLES_PER_AXIS, so that its loops unroll.
    """
    source = load_source(SHADER_ROOT / "render" / file)
    program = link(context, source.with_defines(SAMPLES_PER_AXIS=rig.supersample))
    program["u_focal_px"] = rig.intrinsics.fx, rig.intrinsics.fy
    return FullscreenPass(context, program)


class CentrePass:
    """Reduces samples to pixels: the middle sample, and how much the others differ from it."""

    def __init__(
        self, context: moderngl.Context, rig: SensorRig, rays: Target, layers: tuple[Layer, ...]
    ) -> None:
        """Take the layers clean, normal and albedo, as the renderer declares them."""
        self._pass = supersampled_pass(context, rig, "centres.frag")
        self._rays, self._layers = rays, (*layers, UNEVEN)

    def draw(self, pool: TargetPool, samples: Target, window: Rect) -> dict[str, Target]:
        """Return the pixel layers of a window, by name. The caller gives them back to ``pool``."""
        targets = [pool.take(layer, window) for layer in self._layers]
        buffer = pool.framebuffer(targets)
        buffer.use()
        buffer.viewport = window
        samples.texture.use(0)
        self._rays.texture.use(1)
        program = self._pass.program
        program["u_fine_seen"], program["u_rays"] = 0, 1
        self._pass.draw()
        return {target.layer.name: target for target in targets}
