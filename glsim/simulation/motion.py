"""Rendering of frames whose scene moves during the exposure.

scene at the frame's instant ------------------------------> clean, normal, region
scenes of the captures --light stages--> mean light -------> taps of the chain at the instant
scenes of the bands of rows --copied--> layers of one frame -> the whole chain (rolling shutter)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from glsim.core.array_types import Floats
from glsim.core.bounds import union
from glsim.core.camera import SensorRig, SubExposure
from glsim.core.errors import ConfigError
from glsim.core.reason import Reason
from glsim.gl.targets import Readback, Target
from glsim.noise.chain import ShaderChain
from glsim.noise.frame_context import FrameContext
from glsim.noise.stage import StageValues
from glsim.render.renderer import Rendered, Renderer
from glsim.render.sub_frames import LIGHT_LAYERS, SubFrames
from glsim.simulation.scenes import FrameScene

#: Layers of the scene at the frame's instant, which a rolling-shutter frame delivers too.
_TRUE_LAYERS = ("clean", "normal", "region")


def exposure_parts(rig: SensorRig, chain: ShaderChain, sensor: str) -> tuple[SubExposure, ...]:
    """Return the parts of a rig's exposure. Raises ConfigError if motion cannot be simulated."""
    parts = rig.exposure.parts()
    if not parts:
        raise ConfigError(
            f"motion.within_exposure: the sensor {sensor!r} does not say when its frame is "
            "exposed: set rig.exposure.read_out_ms (rolling shutter), or take azure-kinect"
        )
    if parts[0].capture is not None and not chain.light_stages:
        raise ConfigError(
            f"rig.exposure.captures: the sensor {sensor!r} has no stage tof_light whose light "
            "captures could measure: leave captures out"
        )
    return parts


class MovingFrames:
    """Draws a frame from several scenes, one for each part of its exposure."""

    def __init__(
        self,
        renderer: Renderer,
        chain: ShaderChain,
        sub_frames: SubFrames,
        parts: tuple[SubExposure, ...],
    ) -> None:
        self._renderer, self._chain, self._sub_frames = renderer, chain, sub_frames
        self.parts = parts
        #: Whether the parts are bands of rows (rolling shutter).
        self.rolls = parts[0].rows is not None

    def draw(
        self,
        still: FrameScene,
        scenes: Sequence[FrameScene],
        reach_px: int,
        frame_of: Callable[[Rendered], FrameContext],
        values: StageValues,
        readback: Readback,
    ) -> FrameContext:
        """Render a frame, queue its readback, and return its FrameContext.

        Args:
            still: the scene at the frame's instant.
            scenes: the scenes of the parts of the exposure.
            reach_px: distance around the crop at which stages read pixels.
            frame_of: makes the FrameContext of a rendered frame.
        """
        renderer = self._renderer
        window = union([renderer.window(s.meshes, s.crop, reach_px) for s in (still, *scenes)])
        drawing = renderer.render(still.meshes, still.crop, still.labels, reach_px, window)
        with drawing as true, renderer.everywhere(window) as everywhere:
            # The scene moves out of its silhouette at the frame's instant, and can come nearer.
            true = replace(true, silhouette=everywhere, nearest_m=renderer.rig.near_m)
            frame = frame_of(true)
            with true.pool.scope() as held:
                if self.rolls:
                    self._roll(true, scenes, frame, values, readback, held)
                else:
                    light = self._light(true, scenes, frame, values, held)
                    self._chain.run(true, frame, values, readback, light=light)
        return frame

    def _roll(
        self,
        true: Rendered,
        scenes: Sequence[FrameScene],
        frame: FrameContext,
        values: StageValues,
        readback: Readback,
        held: list[Target],
    ) -> None:
        """Run the noise chain on layers joined from bands; keep the still scene's clean layers."""
        window, render = true.window, self._renderer.render
        layers = self._sub_frames.rows(
            self.parts,
            lambda k: render(scenes[k].meshes, scenes[k].crop, window=window),
            window,
            frame.height,
        )
        held += layers.values()
        truth = {name: true.layers[name] for name in _TRUE_LAYERS if name in true.layers}
        self._chain.run(replace(true, layers=layers), frame, values, readback, truth=truth)

    def _light(
        self,
        true: Rendered,
        scenes: Sequence[FrameScene],
        frame: FrameContext,
        values: StageValues,
        held: list[Target],
    ) -> dict[str, Target]:
        """Return the light layers, accumulated over the captures of a moving scene."""
        sums: list[Target] = []
        for part, scene in zip(self.parts, scenes, strict=True):
            with (
                self._renderer.render(scene.meshes, scene.crop, window=true.window) as sub,
                self._chain.light(sub, frame, values) as light,
            ):
                if not sums:
                    sums = [sub.pool.take(light[n].layer, true.window) for n in LIGHT_LAYERS]
                    held += sums
                    buffer = sub.pool.framebuffer(sums)
                    buffer.use()
                    buffer.clear(viewport=true.window)
                self._sub_frames.add_capture(sub.pool, part, light, sums)
        return dict(zip(LIGHT_LAYERS, sums, strict=True))


def settle_reasons(layers: dict[str, Floats]) -> None:
    """Match the reasons of a rolling-shutter frame, in place, to the depth of the still scene."""
    surface, depth = layers["clean"] > 0, layers["depth"] > 0
    reason = layers["reason"].copy()
    reason[depth & ~surface] = Reason.GROWN
    reason[depth & surface & (reason == Reason.GROWN)] = Reason.VALID
    # The surface was elsewhere when this row was exposed.
    reason[~depth & surface & (reason == Reason.NO_SURFACE)] = Reason.DROPPED
    layers["reason"] = reason
