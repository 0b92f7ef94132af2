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
from glsim.core.errors import ConfigError
from glsim.core.mesh import SKIN_ALBEDO, Mesh
from glsim.core.products import product
from glsim.core.units import MM_PER_M
from glsim.gl.context import borrowed_context
from glsim.measures.silhouettes import measure_silhouettes
from glsim.measures.static import view_numbers
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
#: of each range gate, and their 2nd percentile the second share of the largest such bound. Chosen,
#: not measured.
_BEYOND_GATE, _NEAREST = 0.75, 0.35
#: Number of frames in which the noise is measured; more frames do not change the smoothing.
_SOME_FRAMES = 4
#: Widest hole in a surface that is closed, px: without and with infrared. Chosen: with infrared,
#: the replay knows how dark the surface is, so that the simulated sensor can lose it again.
_WIDEST_HOLE_PX = (12, 80)


def replay(
    real: Frames,
    sensor: str,
    *,
    seed: int = 0,
    assignments: Sequence[str] = (),
    smooth_px: float | None = None,
    mode: Mode | None = None,
) -> Frames:
    """Render the surfaces of real frames through a sensor.

    The sensor's own frames are decimated or registered to colour as those of ``real`` were.

    Static frames of ``real`` are rendered as one static scene. If shadows lie on one side in
    ``real`` and on the other in the sensor's frames, ``real`` is mirrored, as libfreenect2's frames
    are: the replay renders the scene unmirrored and mirrors its result. Range gates of the sensor
    are widened to the depths of ``real``.

    Raises ConfigError for an unknown sensor, and for depths far outside its range, which are most
    likely in another unit.

    Args:
        real: the frames; their intrinsics replace the sensor's.
        assignments: parameters of the sensor's stages, in the form of ``--set``.
        smooth_px: standard deviation of the smoothing window. Default: from the noise.
        mode: the mode of ``real``, with its intrinsics. Default: the sensor's depth in the grid of
            ``real``.

    Returns:
        Frames with the names, size and order of ``real``; ``note`` says how much was smoothed.
    """
    loaded, camera = load_sensor(sensor), real.intrinsics
    mode = mode or Mode("", camera, camera)
    assignments = [*_range_assignments(real, loaded, mode.depth), *assignments]
    mirrored = not mode.registered and _is_mirrored(real, loaded.rig)
    plain = mode.depth is mode.image
    rig = _grid(replace(mode.depth, cx=camera.width - camera.cx) if mirrored else mode.depth)
    if mode.registered and loaded.rig.colour is not None:
        colour = replace(loaded.rig.colour, intrinsics=camera)
        place = {"position_m": colour.position_m, "turn_deg": colour.turn_deg}
        rig |= {"deliver": "colour", "colour": {**_grid(camera), **place}}
    frames = [_mirror(frame) if mirrored else frame for frame in real]
    if not plain:  # light is known in the depth camera's own grid alone
        frames = [frame.without(["infrared"]) for frame in frames]
    some = frames[:: max(len(frames) // _SOME_FRAMES, 1)]
    noise = measure_replay_noise(some, smooth_px)
    with borrowed_context(None) as context:
        virtual = VirtualCamera(sensor, context, seed=seed, rig=rig, assignments=assignments)

        def scene(frame: DepthFrame) -> Mesh | None:
            """Return the surfaces of a frame with their reflectivity; None without depth."""
            holes_px = _WIDEST_HOLE_PX[frame.infrared is not None]
            surfaces = find_surfaces(
                frame.measured_mm, noise.scales_px, holes_px, noise.energy(frame)
            )
            if not np.isfinite(surfaces.front_mm).any():
                return None
            albedo = np.full(frame.measured_mm.shape, SKIN_ALBEDO)
            if frame.infrared is not None:
                albedo = _albedo(virtual, surfaces, frame.infrared)
            seen_by = virtual.rig.intrinsics if plain else camera
            mesh = mesh_of(surfaces, seen_by, albedo)
            if mode.registered:  # from the colour camera's frame to the depth camera's
                back = np.linalg.inv(colour.from_depth())
                points = product(mesh.vertices_mm.astype(np.float64), back[:3, :3].T)
                moved = (points + MM_PER_M * back[:3, 3]).astype(np.float32)
                mesh = replace(mesh, vertices_mm=moved)
            return mesh

        made = []
        for frame, view in zip(frames, view_numbers(real), strict=True):
            rendered = _render(virtual, scene(frames[view]), frame, mode.decimated_by)
            made.append((_mirror(rendered) if mirrored else rendered).changed(intrinsics=camera))
    return Frames.of(made, f"{sensor}, replay", noise.sentence)


def compare_replay(
    real: Frames,
    sensor: str,
    stated: bool,
    progress: Callable[[str], None],
    *,
    seed: int = 0,
    assignments: Sequence[str] = (),
    smooth_px: float | None = None,
) -> tuple[Comparison, Frames, str]:
    """Compare real frames with their replay in the mode in which they were delivered.

    Of modes that cannot be told apart, the one whose surfaces are told less is chosen. Also returns
    the replay, and a sentence about the mode, the smoothing, and other modes.
    """
    tried: list[tuple[float, Comparison, Frames, str]] = []
    for mode in possible_modes(load_sensor(sensor), real, stated, find_lattice(real)):
        progress(f"rendering {len(real)} frames through {sensor}: {mode.name}")
        grid = Frames.of([f.changed(intrinsics=mode.image) for f in real], real.title)
        made = replay(
            grid, sensor, seed=seed, assignments=assignments, smooth_px=smooth_px, mode=mode
        )
        comparison = compare_sets(grid, made, progress=progress)
        tried.append((comparison.told, comparison, made, mode.name))
    tried.sort(key=lambda entry: entry[0])
    (_, comparison, made, name), *others = tried
    sentence = f"{real.title}: taken for frames in {name}; {made.note}"
    if others:
        also = "; ".join(f"{other[3]}: {other[0]:.2f}" for other in others)
        sentence += f". Chosen by the AUC of surfaces, {tried[0][0]:.2f}; {also}"
    return comparison, made, sentence


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


def _render(
    virtual: VirtualCamera, mesh: Mesh | None, frame: DepthFrame, decimated_by: int
) -> DepthFrame:
    """Render the mesh of a frame with the frame's depth step; without a mesh, no depth."""
    if mesh is None:
        return frame.changed({"noisy_mm": np.zeros_like(frame.noisy_mm)})
    shot = virtual.capture(mesh, 1, None, scene=f"replay {frame.name}")[0]
    depth_mm = (np.rint(shot.noisy_mm / frame.step_mm) * frame.step_mm).astype(np.float32)
    if decimated_by > 1:
        small, depth_mm = decimate(depth_mm, decimated_by), np.zeros_like(frame.noisy_mm)
        depth_mm[: small.shape[0], : small.shape[1]] = small  # librealsense pads with zeros
    light = {} if frame.infrared is None else {"infrared": shot.layer("infrared")}
    return frame.changed({"noisy_mm": depth_mm, **light})


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
