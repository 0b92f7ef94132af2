"""The finer grid of a rig that supersamples, and how the pixels' layers come from it."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import moderngl

from glsim.camera import SensorRig
from glsim.frame import Rect
from glsim.gl.program import link
from glsim.gl.source import SHADER_ROOT, Layer, load_source
from glsim.gl.targets import Target, TargetPool

UNEVEN = Layer("uneven", "float")


def sample_layer(rig: SensorRig) -> Layer:
    """Depth and albedo of the samples."""
    return Layer("fine_seen", "vec2", Fraction(rig.supersample))


def samples_pass(context: moderngl.Context, rig: SensorRig, name: str) -> moderngl.VertexArray:
    """A pass over a window; the number of samples is a constant in it, so that loops unroll."""
    source = load_source(SHADER_ROOT / "render" / name)
    text = source.text.replace("int SIDE = 3;", f"int SIDE = {rig.supersample};")
    program = link(context, replace(source, text=text))
    if "u_focal_px" in program:
        program["u_focal_px"] = rig.intrinsics.fx, rig.intrinsics.fy
    return context.vertex_array(program, [])


class Centres:
    """The layers of pixels from their samples: the middle one, and how unlike it the others are."""

    def __init__(
        self, context: moderngl.Context, rig: SensorRig, rays: Target, layers: tuple[Layer, ...]
    ) -> None:
        """layers: clean, normal and albedo, as the renderer calls them."""
        self._array = samples_pass(context, rig, "centres.frag")
        self._rays, self._layers = rays, (*layers, UNEVEN)

    def take(self, pool: TargetPool, samples: Target, window: Rect) -> dict[str, Target]:
        """The layers of a window, by name; give them back to ``pool``."""
        targets = [pool.take(layer, window) for layer in self._layers]
        buffer = pool.framebuffer(targets)
        buffer.use()
        buffer.viewport = window
        samples.texture.use(0)
        self._rays.texture.use(1)
        program = self._array.program
        program["u_fine_seen"], program["u_rays"] = 0, 1
        self._array.render(moderngl.TRIANGLES, vertices=3)
        return {target.layer.name: target for target in targets}
