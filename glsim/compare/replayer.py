"""Render the surfaces of one real frame after the other through a sensor, as ``replay`` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.compare.replay_relief import measure_noise_floor
from glsim.compare.replay_surfaces import (
    ReplaySurfaces,
    find_surfaces,
    mesh_of,
    smooth_surfaces,
)
from glsim.geometry.camera import Intrinsics, SensorRig
from glsim.geometry.mesh import SKIN_ALBEDO, Mesh
from glsim.measures.disparity import LAGS_PX, measure_disparity_noise, to_disparity
from glsim.measures.frame import DepthFrame, FrameSet
from glsim.measures.silhouettes import measure_silhouettes
from glsim.sensors.sensor import load_sensor
from glsim.validate.virtual_camera import Capture, Changes, VirtualCamera

Array = NDArray[np.float64]

#: Standard deviation of the window that removes a frame's noise, over the distance at which its
#: correlation is one half; and its limits, px. Chosen: a Kinect V2's noise is alike over 1.5 px and
#: leaves a fifth of itself in the surfaces at 3 px, a D435's over 5 px at 8.
_SMOOTH_OVER_CORRELATION, _SMOOTH_PX = 1.6, (3.0, 10.0)
#: Even reflectivity of the first capture: no surface beyond 0.3 m is saturated by it.
_EVEN_ALBEDO = 0.25
#: Reflectivity stays in this range; surfaces that shine back at the lens are brighter. Chosen.
_LEAST_ALBEDO, _MOST_ALBEDO = 0.005, 3.0
#: Standard deviation of the smoothing of infrared images before their ratio is taken, px; chosen.
_LIGHT_PX = 0.8
#: Infrared of a dark surface that the ratio is still taken from, counts; chosen: noise is smaller.
_LEAST_COUNTS = 60.0
#: Frames that the noise is measured on; more do not change the smoothing.
_SOME_FRAMES = 8
#: Widest hole of a surface that is closed, px, without and with infrared. Chosen: infrared says how
#: dark the surface is there, so that the sensor may lose it too; without it a hole may be anything.
_WIDEST_HOLE_PX = (12, 80)


class Replayer:
    """A sensor at the place of the camera that recorded some frames."""

    def __init__(
        self,
        real: FrameSet,
        sensor: str,
        context: moderngl.Context,
        *,
        seed: int = 0,
        smooth_px: float | None = None,
        mirrored: bool | None = None,
        assignments: Sequence[str] = (),
    ) -> None:
        """Measure the noise of the frames and load the sensor; arguments as of ``replay``."""
        self._camera = real.camera
        if mirrored is None:
            mirrored = _is_mirrored(real, load_sensor(sensor).rig)
        self._mirrored = mirrored
        self._virtual = VirtualCamera(
            sensor, context, seed=seed, rig=_rig_of(real.camera, mirrored), assignments=assignments
        )
        some = real.frames[:: max(len(real.frames) // _SOME_FRAMES, 1)]
        self._smooth_px = smooth_px or _smoothing_px(some)
        smoothed = [smooth_surfaces(frame.depth_mm, self._smooth_px) for frame in some]
        self._noise = measure_noise_floor(some, smoothed, self._smooth_px)

    def scene(self, frame: DepthFrame) -> Mesh | None:
        """Return the surfaces of a real frame with their reflectivity; None if it has no depth."""
        depth, light, noise = frame.depth_mm, frame.infrared, self._noise.variance(frame)
        if self._mirrored:
            depth, noise = (
                np.ascontiguousarray(depth[:, ::-1]),
                np.ascontiguousarray(noise[:, ::-1]),
            )
            light = None if light is None else np.ascontiguousarray(light[:, ::-1])
        holes_px = _WIDEST_HOLE_PX[light is not None]
        surfaces = find_surfaces(depth, self._smooth_px, holes_px, noise)
        if not np.isfinite(surfaces.front_mm).any():
            return None
        albedo = np.full(depth.shape, SKIN_ALBEDO)
        if light is not None:
            albedo = self._albedo(surfaces, light)
        return mesh_of(surfaces, self._virtual.rig.intrinsics, albedo)

    def frame(
        self, frame: DepthFrame, scene: Mesh | None, changes: Changes | None = None
    ) -> DepthFrame:
        """Render the counterpart of a real frame.

        Args:
            frame: gives the name, and the step of the depth.
            scene: surfaces, of this frame or of one with the same view.
            changes: parameters of the sensor's stages.

        """
        if scene is None:  # nothing to see, and nothing to render
            return replace(frame, depth_mm=np.full_like(frame.depth_mm, np.nan))
        shot = self._capture(scene, f"replay {frame.name}", changes)
        depth_mm, infrared = shot.fine_mm[0], shot.infrared[0]
        depth_mm = np.rint(depth_mm / frame.quantum_mm) * frame.quantum_mm
        if self._mirrored:
            depth_mm, infrared = depth_mm[:, ::-1], infrared[:, ::-1]
        return DepthFrame(
            frame.name,
            np.ascontiguousarray(depth_mm, np.float32),
            np.ascontiguousarray(infrared, np.float32) if frame.infrared is not None else None,
            self._camera,
            frame.quantum_mm,
        )

    def _capture(self, scene: Mesh, name: str, changes: Changes | None = None) -> Capture:
        return self._virtual.capture(scene, frames=1, crop=None, scene=name, changes=changes)

    def _albedo(self, surfaces: ReplaySurfaces, infrared: NDArray[np.float32]) -> Array:
        """Return (H, W) the reflectivity with which the sensor's infrared is the real one."""
        even = np.full(infrared.shape, _EVEN_ALBEDO)
        simulated = self._capture(
            mesh_of(surfaces, self._virtual.rig.intrinsics, even), "light"
        ).infrared[0]
        real, simulated = (
            cv2.GaussianBlur(image.astype(np.float64), (0, 0), _LIGHT_PX)
            for image in (infrared, simulated)
        )
        usable = simulated > _LEAST_COUNTS
        ratio = np.where(usable, _EVEN_ALBEDO * real / np.maximum(simulated, _LEAST_COUNTS), 0.0)
        ratio = np.clip(ratio, _LEAST_ALBEDO, _MOST_ALBEDO)
        # In simulated shadows nothing is known of a surface: it has what is typical of it.
        label = np.where(usable, surfaces.label, -1)
        for number in np.unique(surfaces.label[~usable & (surfaces.label >= 0)]):
            seen = ratio[label == number]
            typical = float(np.median(seen)) if seen.size else SKIN_ALBEDO
            ratio[~usable & (surfaces.label == number)] = typical
        return np.asarray(ratio)


def _smoothing_px(frames: Sequence[DepthFrame]) -> float:
    """Choose the smoothing of surfaces by how far the noise of planes is alike."""
    noise = measure_disparity_noise([to_disparity(frame.depth_mm) for frame in frames])
    alike = 0.5 * (np.array(noise.rows) + np.array(noise.columns))
    if not np.isfinite(alike).all():
        return _SMOOTH_PX[0]
    half = float(np.interp(-0.5, -alike, LAGS_PX))
    return float(np.clip(_SMOOTH_OVER_CORRELATION * half, *_SMOOTH_PX))


def _rig_of(camera: Intrinsics, mirrored: bool) -> dict[str, Any]:
    """Return the keys of [rig] of a camera without lens distortion."""
    cx = camera.width - camera.cx if mirrored else camera.cx
    return {
        "width": camera.width,
        "height": camera.height,
        "focal_px": [camera.fx, camera.fy],
        "centre_px": [cx, camera.cy],
    }


def _is_mirrored(real: FrameSet, rig: SensorRig) -> bool:
    """Say whether the frames' shadows are on the other side than the sensor's."""
    measured = measure_silhouettes(real.frames)
    if not np.isfinite(measured.left.width_mean_px) or not np.isfinite(
        measured.right.width_mean_px
    ):
        return False
    hidden = [*rig.imagers_m[1:], *(emitter.position_m for emitter in rig.emitters)]
    if not hidden or hidden[0][0] == 0:
        return False
    # What stands on the right of the lens does not see the left of a foreground's background.
    return ("left" if hidden[0][0] > 0 else "right") != measured.shadow_side
