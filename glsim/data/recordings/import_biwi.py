"""Import the Biwi set: real depth maps, and clean maps rendered from posed templates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics, SensorRig
from glsim.core.errors import MeshError
from glsim.core.pose import pose_matrix
from glsim.core.rect import Rect
from glsim.data.driver import write_dataset
from glsim.data.progress import GenerateProgress, GenerateSummary
from glsim.data.worker_processes import Workers
from glsim.faces.base import FaceKey
from glsim.faces.scans.biwi_files import read_calibration, read_depth_bin
from glsim.faces.sources.biwi import Biwi
from glsim.gl.context import describe, open_context
from glsim.gl.targets import Readback
from glsim.render.renderer import Renderer
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.assembly import reconcile_reasons
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.plan.tasks import Task, make_tasks

TITLE = "Biwi: a real Kinect V1; clean is the person's template, posed"


def import_biwi(
    root: Path,
    out: Path,
    *,
    every: int = 1,
    subjects: int | None = None,
    frames_per_subject: int | None = None,
    split: str | None = None,
    workers: Workers = "auto",
    backend: str | None = None,
    progress: Callable[[GenerateProgress], None] | None = None,
) -> GenerateSummary:
    """Write the recordings of Biwi as a data set of glsim.

    The noisy map is the Kinect's whole depth.bin, mm; the clean map holds the head alone. Notes of
    a record have the colour camera and the head pose.

    Args:
        root: folder with NN.obj and NN/frame_*_depth.bin.
        out: folder of the data set.
        every: use every n-th frame.
        subjects: number of people; default: all.
        frames_per_subject: default: all.
        split: shares of train, val and test.
        workers: number of processes.
        backend: of OpenGL.
        progress: called with the state after each frame.

    Raises:
        ConfigError: the root holds no recordings.
        DatasetError: an error of ``write_dataset``.

    """
    options = {"kind": "biwi", "root": root, "every": every}
    options |= {"subjects": subjects, "frames_per_subject": frames_per_subject}
    tree = {"source": {name: value for name, value in options.items() if value is not None}}
    settings = load_settings(overrides=tree | ({"split": split} if split else {}))
    source = Biwi(root, every=every)
    tasks = make_tasks(settings, [source])
    context = open_context(backend)
    renderer = describe(context)["renderer"]
    context.release()
    sensor = {"name": "biwi", "title": TITLE, "width": 640, "height": 480, "stages": []}
    return write_dataset(
        settings,
        tasks,
        out,
        partial(biwi_frames, source=source, backend=backend),
        sensor=sensor,
        renderer=renderer,
        workers=workers,
        progress=progress,
    )


def biwi_frames(
    settings: Settings, tasks: Iterable[Task], *, source: Biwi, backend: str | None = None
) -> Iterator[Frame | Skipped]:
    """Yield one result per task, in order; see ``import_biwi``."""
    context = open_context(backend)
    camera: tuple[Intrinsics, Renderer, Readback] | None = None
    try:
        for task in tasks:
            try:
                image, colour = _calibrations(source, task.key)
                if camera is None or camera[0] != image:
                    camera = image, Renderer(context, SensorRig(image)), Readback(context)
                yield _frame(settings, task, source, image, camera[1], camera[2], colour)
            except MeshError as error:
                if settings.strict:
                    raise
                yield Skipped(task.key, source.name, str(error))
    finally:
        context.release()


def _frame(
    settings: Settings,
    task: Task,
    source: Biwi,
    image: Intrinsics,
    renderer: Renderer,
    readback: Readback,
    colour: dict[str, object],
) -> Frame:
    path = source.depth_path(task.key)
    noisy_m = read_depth_bin(path).astype(np.float32) / np.float32(1000)
    if noisy_m.shape != (image.height, image.width):
        raise MeshError(
            f"{path}: {noisy_m.shape[1]} x {noisy_m.shape[0]} pixels, its depth.cal says "
            f"{image.width} x {image.height}"
        )
    clean_m = _clean_map(source, task.key, image, renderer, readback)
    pose = source.pose(task.key)
    return Frame(
        task.key,
        source.name,
        task.seeds.frame,
        image,
        Rect(0, 0, image.width, image.height),
        clean_m,
        noisy_m,
        np.zeros_like(clean_m),
        reconcile_reasons(clean_m, noisy_m, np.zeros_like(clean_m)),
        depth_unit_mm=settings.output.depth_unit_mm,
        pose={
            name: float(value)
            for name, value in zip(("x_mm", "y_mm", "distance_mm"), pose.centre_mm, strict=True)
        },
        notes={
            "real": "depth.bin of a Kinect V1, unchanged",
            "clean": "the person's template, posed",
            "head_rotation": [[round(float(v), 6) for v in row] for row in pose.rotation],
            "depth_file": path.relative_to(source.root).as_posix(),
            **colour,
        },
    )


def _clean_map(
    source: Biwi, key: FaceKey, image: Intrinsics, renderer: Renderer, readback: Readback
) -> NDArray[np.float32]:
    """Render the template at the pose of the file: (H, W) float32 metres, 0 = no surface."""
    full = np.zeros((image.height, image.width), np.float32)
    with renderer.render([(source.in_camera(key), pose_matrix({}))]) as rendered:
        layers = {"clean": rendered.layers["clean"]}
        readback.request(rendered.pool, layers, rendered.window)
        full[rendered.window.slices] = readback.arrays()["clean"]
    return full


def _calibrations(source: Biwi, key: FaceKey) -> tuple[Intrinsics, dict[str, object]]:
    """Return the depth camera, and notes on the colour camera."""
    folder = source.root / key.sequence
    image = read_calibration(folder / "depth.cal")
    try:
        rgb = read_calibration(folder / "rgb.cal")
    except MeshError as error:
        return image, {"colour_camera": str(error)}
    return image, {"colour_camera": {"focal_px": [rgb.fx, rgb.fy], "centre_px": [rgb.cx, rgb.cy]}}
