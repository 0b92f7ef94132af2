"""Replay of real frames: the surfaces of each frame are rendered through a simulated sensor.

Both sets then show equal scenes and differ by the camera alone. The reflectivity of a surface is
the real infrared divided by the simulated infrared of the surface at a uniform reflectivity.
Without infrared, every surface reflects like skin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.bench.compare.comparison import Comparison, compare_sets
from glsim.bench.compare.replay_noise import measure_replay_noise
from glsim.bench.compare.replay_surfaces import ReplaySurfaces, find_surfaces, mesh_of
from glsim.bench.modes import Mode, find_lattice, possible_modes
from glsim.core.array_types import Array
from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.depth_frame import DepthFrame, Frames
from glsim.core.errors import ConfigError, counted
from glsim.core.mesh import SKIN_ALBEDO, Mesh
from glsim.core.products import product
from glsim.core.units import MM_PER_M
from glsim.gl.context import borrowed_context
from glsim.measures.silhouettes import measure_silhouettes
from glsim.measures.static import UNMASKED_LAYER, view_numbers
from glsim.noise.realsense_filters import decimate
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.simulation.virtual_camera import VirtualCamera

#: Uniform reflectivity in the first capture; with it, no surface beyond 0.3 m saturates.
_EVEN_ALBEDO = 0.25
#: Smallest and largest reflectivity. Chosen: only retroreflectors are brighter.
_LEAST_ALBEDO, _MOST_ALBEDO = 0.005, 3.0
#: Infrared images are smoothed by a Gaussian before their ratio is computed: its standard
#: deviation, px; and the smallest infrared for a ratio, counts. Chosen: above the noise.
_LIGHT_PX, _LEAST_COUNTS = 0.8, 60.0
#: Depths of a recording fit a sensor only if their median exceeds the first share of the near limit
#: of each range gate, and their 2nd percentile the second share of the largest such bound. Chosen.
_BEYOND_GATE, _NEAREST = 0.75, 0.35
#: Number of frames in which the noise is measured; more frames do not change the smoothing.
_SOME_FRAMES = 4
#: Widest hole in a surface that is closed, px: without and with infrared. Chosen: with infrared,
#: the replay knows how dark the surface is, so that the simulated sensor can lose it again.
_WIDEST_HOLE_PX = (12, 80)


class Replay:
    """Surfaces of real frames, for rendering through a sensor or variants of it.

    The sensor's frames are decimated or registered to colour as the real ones were. Static frames
    are rendered as one static scene, whose depth is their median. If shadows lie on the other side
    than the sensor's, the real frames are mirrored, as libfreenect2's are: the replay renders the
    scene unmirrored and mirrors its result. Range gates are widened to the real depths.
    """

    def __init__(
        self, real: Frames, sensor: str, *, smooth_px: float | None = None,
        mode: Mode | None = None, relief: bool = True,
    ) -> None:  # fmt: skip
        """Measure the noise of ``real``, whose intrinsics replace the sensor's.

        ``smooth_px``: standard deviation of the smoothing window; default: from the noise.
        ``mode``: of ``real``, with its intrinsics; default: the sensor's depth in its grid.
        ``relief``: whether relief above the noise stays; noise above the usual stays with it.
        """
        camera = real.intrinsics
        self._real, self._sensor, self._mode = real, sensor, mode or Mode("", camera, camera)
        self._mirrored = not self._mode.registered and _is_mirrored(real, load_sensor(sensor).rig)
        whole = [frame.without([UNMASKED_LAYER]) for frame in real]
        frames = [_mirror(frame) if self._mirrored else frame for frame in whole]
        if self._mode.depth is not self._mode.image:  # light is known in the depth camera's grid
            frames = [frame.without(["infrared"]) for frame in frames]
        self._relief = relief
        some = frames[:: max(len(frames) // _SOME_FRAMES, 1)]
        self._frames, self._noise = frames, measure_replay_noise(some, smooth_px)
        self._views: dict[int, list[int]] = {}
        for number, view in enumerate(view_numbers(real)):
            self._views.setdefault(view, []).append(number)
        self._last: tuple[int, DepthFrame, ReplaySurfaces] | None = None  # last view, its surfaces

    def through(
        self, sensor: str = "", *, seed: int = 0, assignments: Sequence[str] = (),
        most: int | None = None,
    ) -> Frames:  # fmt: skip
        """Render the surfaces through a sensor; "" is that of the constructor.

        Returns frames with the names, size and order of the real ones, of each view the first
        ``most``; ``note`` says how much was smoothed. Raises ConfigError for an unknown sensor, and
        for depths far outside its range, which are most likely in another unit.
        """
        sensor = sensor or self._sensor
        loaded, camera, mode = load_sensor(sensor), self._real.intrinsics, self._mode
        depth = mode.depth
        assignments = [*_range_assignments(self._real, loaded, depth), *assignments]
        rig = _grid(replace(depth, cx=camera.width - camera.cx) if self._mirrored else depth)
        back = None
        if mode.registered and loaded.rig.colour is not None:
            colour = replace(loaded.rig.colour, intrinsics=camera)
            own = {name: getattr(colour, name) for name in ("position_m", "turn_deg", "covers")}
            rig |= {"deliver": "colour", "colour": {**_grid(camera), **own}}
            back = np.linalg.inv(colour.from_depth())
        made: dict[int, DepthFrame] = {}
        with borrowed_context(None) as context:
            virtual = VirtualCamera(sensor, context, seed=seed, rig=rig, assignments=assignments)
            for view, every in self._views.items():
                numbers, mesh = every[:most], self._mesh(view, virtual)
                if mesh is not None and back is not None:  # from colour's frame to the depth's
                    points = product(mesh.vertices_mm.astype(np.float64), back[:3, :3].T)
                    moved = (points + MM_PER_M * back[:3, 3]).astype(np.float32)
                    mesh = replace(mesh, vertices_mm=moved)
                frames = [self._frames[number] for number in numbers]
                shots = _render(virtual, mesh, frames, mode.decimated_by)
                for number, shot in zip(numbers, shots, strict=True):
                    turned = _mirror(shot) if self._mirrored else shot
                    made[number] = turned.changed(intrinsics=camera)
        ordered = [made[number] for number in sorted(made)]
        return Frames.of(ordered, f"{sensor}, replay", self._noise.sentence)

    def _mesh(self, view: int, virtual: VirtualCamera) -> Mesh | None:
        """Return the surfaces of a view with their reflectivity; None without depth."""
        if self._last is None or self._last[0] != view:
            frame = _middle([self._frames[number] for number in self._views[view]])
            widest_px, noise = _WIDEST_HOLE_PX[frame.infrared is not None], self._noise
            energy = noise.energy(frame) if self._relief else None
            surfaces = find_surfaces(frame.measured_mm, noise.scales_px, widest_px, energy)
            self._last = view, frame, surfaces
        _, frame, surfaces = self._last
        if not np.isfinite(surfaces.front_mm).any():
            return None
        albedo = np.full(frame.measured_mm.shape, SKIN_ALBEDO)
        if frame.infrared is not None:
            albedo = _albedo(virtual, surfaces, frame.infrared)
        plain = self._mode.depth is self._mode.image
        seen_by = virtual.rig.intrinsics if plain else self._real.intrinsics
        return mesh_of(surfaces, seen_by, albedo)


def compare_replay(
    real: Frames, sensor: str, stated: bool, progress: Callable[[str], None], *, seed: int = 0,
    assignments: Sequence[str] = (), smooth_px: float | None = None,
) -> tuple[Comparison, Frames, str]:  # fmt: skip
    """Compare real frames with their replay in the mode in which they were delivered.

    Of modes that cannot be told apart, the one whose surfaces are told less is chosen. Also returns
    the replay, and a sentence about the mode, the smoothing, and other modes.
    """
    tried: list[tuple[float, Comparison, Frames, str]] = []
    for mode in possible_modes(load_sensor(sensor), real, stated, find_lattice(real)):
        progress(f"rendering {counted(len(real), 'frame')} through {sensor}: {mode.name}")
        grid = Frames.of([f.changed(intrinsics=mode.image) for f in real], real.title, real.note)
        scene = Replay(grid, sensor, smooth_px=smooth_px, mode=mode)
        made = scene.through(seed=seed, assignments=assignments)
        same = Frames.of(list(made), made.title, real.note)
        comparison = compare_sets(grid, same, progress=progress)
        tried.append((comparison.told, comparison, made, mode.name))
    tried.sort(key=lambda entry: entry[0])
    (_, comparison, made, name), *others = tried
    sentence = f"{real.title}: taken for frames in {name}; {made.note}"
    if others:
        also = "; ".join(f"{other[3]}: {other[0]:.2f}" for other in others)
        sentence += f". Chosen by the AUC of surfaces, {tried[0][0]:.2f}; {also}"
    return replace(comparison, replayed=True), made, sentence


def _grid(camera: Intrinsics) -> dict[str, Any]:
    """Return the keys of [rig], or of [rig.colour], that place the pixels of a camera."""
    size = {"width": camera.width, "height": camera.height}
    return {**size, "focal_px": [camera.fx, camera.fy], "centre_px": [camera.cx, camera.cy]}


def _range_assignments(real: Frames, sensor: Sensor, depth: Intrinsics) -> list[str]:
    """Return settings that widen the sensor's gates; raises ConfigError for depths beyond reach."""
    depths = np.concatenate([frame.measured_mm[::4, ::4].ravel() for frame in real])
    near, low, middle, far = np.nanquantile(depths, (0.001, 0.02, 0.5, 0.999)).tolist()
    gates = [
        (stage.name, stage.settings["near_mm"].typical, stage.settings["far_mm"].typical)
        for stage in sensor.stages
        if stage.spec.name == "range_gate"
    ]
    reach = MM_PER_M * sensor.rig.near_m, MM_PER_M * sensor.rig.far_m
    searched = [
        s.settings["largest_px"].typical for s in sensor.stages if "largest_px" in s.settings
    ]
    matched = [MM_PER_M * depth.fx * sensor.rig.baseline_m / px for px in searched]
    least = max([reach[0], *(_BEYOND_GATE * gate[1] for gate in gates), *matched])
    most = min([reach[1], *(gate[2] for gate in gates)])
    if low < _NEAREST * least or not least <= middle <= 1.2 * most:
        raise ConfigError(
            f"{real.title}: depths from {low:.0f} mm on, half of them beyond {middle:.0f} mm; "
            f"{sensor.name} is for {least:.0f} to {most:.0f} mm: give the unit, --depth-unit-mm"
        )
    return [
        text
        for name, gate_near, gate_far in gates
        for text in (
            f"{name}.near_mm={min(near, gate_near):.0f}",
            f"{name}.far_mm={max(far, gate_far):.0f}",
        )
    ]


def _middle(frames: Sequence[DepthFrame]) -> DepthFrame:
    """Return the median over time of frames of one view; no depth where most of them have none."""
    if len(frames) == 1:
        return frames[0]
    depth_mm = np.sort([frame.measured_mm for frame in frames], axis=0)  # NaN comes last
    count = np.isfinite(depth_mm).sum(axis=0)
    # Of an even number, a mean of the two in the middle would lie between two surfaces.
    middle = np.take_along_axis(depth_mm, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    layers = {"noisy_mm": np.where(2 * count >= len(frames), middle, 0)}
    if frames[0].infrared is not None:
        layers["infrared"] = np.mean([f.layer("infrared") for f in frames], axis=0, dtype="f4")
    return frames[0].changed(layers)


def _render(
    virtual: VirtualCamera, mesh: Mesh | None, frames: Sequence[DepthFrame], decimated_by: int
) -> list[DepthFrame]:
    """Render one shot of a still mesh for each frame, in its depth step; no mesh: no depth."""
    if mesh is None:
        return [frame.changed({"noisy_mm": np.zeros_like(frame.noisy_mm)}) for frame in frames]
    made = []
    shots = virtual.capture(mesh, len(frames), None, scene=f"replay {frames[0].name}")
    for frame, shot in zip(frames, shots, strict=True):
        depth_mm = (np.rint(shot.noisy_mm / frame.step_mm) * frame.step_mm).astype(np.float32)
        if decimated_by > 1:
            small, depth_mm = decimate(depth_mm, decimated_by), np.zeros_like(frame.noisy_mm)
            depth_mm[: small.shape[0], : small.shape[1]] = small  # librealsense pads with zeros
        light = {} if frame.infrared is None else {"infrared": shot.layer("infrared")}
        made.append(frame.changed({"noisy_mm": depth_mm, **light}))
    return made


def _mirror(frame: DepthFrame) -> DepthFrame:
    """Exchange left and right of the frame's images; its camera stays."""
    turned = {
        name: np.ascontiguousarray(frame.layer(name)[:, ::-1])
        for name in ("noisy_mm", "infrared")
        if name in frame
    }
    return frame.changed(turned)


def _albedo(
    virtual: VirtualCamera, surfaces: ReplaySurfaces, infrared: NDArray[np.float32]
) -> Array:
    """Compute the (H, W) albedo for which the simulated infrared equals the real infrared."""
    even = mesh_of(surfaces, virtual.rig.intrinsics, np.full(infrared.shape, _EVEN_ALBEDO))
    lit = virtual.capture(even, 1, None, scene="light")[0].infrared
    assert lit is not None
    real, simulated = (
        cv2.GaussianBlur(image.astype(np.float64), (0, 0), _LIGHT_PX) for image in (infrared, lit)
    )
    usable = simulated > _LEAST_COUNTS
    ratio = np.where(usable, _EVEN_ALBEDO * real / np.maximum(simulated, _LEAST_COUNTS), 0.0)
    ratio = np.clip(ratio, _LEAST_ALBEDO, _MOST_ALBEDO)
    # In simulated shadows the albedo is unknown: the median of the surface replaces it.
    label = np.where(usable, surfaces.label, -1)
    for number in np.unique(surfaces.label[~usable & (surfaces.label >= 0)]):
        seen = ratio[label == number]
        typical = float(np.median(seen)) if seen.size else SKIN_ALBEDO
        ratio[~usable & (surfaces.label == number)] = typical
    return np.asarray(ratio)


def _is_mirrored(real: Frames, rig: SensorRig) -> bool:
    """Return whether the frames' shadows lie on the opposite side to the sensor's shadows."""
    measured = measure_silhouettes(real)
    widths = measured.left.width_mean_px, measured.right.width_mean_px
    hidden = [*rig.imagers_m[1:], *(emitter.position_m for emitter in rig.emitters)]
    if not np.isfinite(widths).all() or not hidden or hidden[0][0] == 0:
        return False
    # An imager or emitter right of the lens leaves a shadow on the left of a foreground.
    return ("left" if hidden[0][0] > 0 else "right") != measured.shadow_side
