"""Replay real frames: render their own surfaces through a sensor, so that the scenes agree.

Real and simulated frames of different scenes differ by the scenes. A replay takes the surfaces,
silhouettes and reflectivity from each real frame (``replay_surfaces``), renders them once through
the sensor at the place of the real camera, and so leaves the camera as the only difference.
Reflectivity is the real infrared over that of the same surfaces at an even reflectivity; without
infrared it is that of skin everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from glsim.compare.replayer import Replayer
from glsim.gl.context import borrowed_context
from glsim.measures.frame import FrameSet
from glsim.measures.static import view_numbers


def replay(
    real: FrameSet,
    sensor: str,
    *,
    seed: int = 0,
    smooth_px: float | None = None,
    mirrored: bool | None = None,
    assignments: Sequence[str] = (),
    backend: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> FrameSet:
    """Render the surfaces of real frames through a sensor.

    Frames that are static in ``real`` show one scene here too. Raises ConfigError for an unknown
    sensor.

    Args:
        real: the frames; their camera replaces that of the sensor.
        sensor: name of a sensor, or a sensor file.
        seed: of the device and its noise.
        smooth_px: standard deviation of the smoothing of the surfaces, px; default: by the
            correlation of the frames' noise.
        mirrored: whether the frames are mirrored, as libfreenect2 delivers them; default: if their
            shadows are on the other side than the sensor's.
        assignments: parameters of the sensor's stages, as of ``--set``.
        progress: is called with the name of each frame.

    Returns:
        Frames with the names, size and order of ``real``.

    """
    with borrowed_context(backend) as context:
        replayer = Replayer(
            real,
            sensor,
            context,
            seed=seed,
            smooth_px=smooth_px,
            mirrored=mirrored,
            assignments=assignments,
        )
        scene_of = view_numbers(real.frames)
        frames = []
        for number, frame in enumerate(real.frames):
            if progress is not None:
                progress(frame.name)
            scene = replayer.scene(real.frames[scene_of[number]])
            frames.append(replayer.frame(frame, scene))
    return FrameSet(f"{sensor}, replay", tuple(frames))
