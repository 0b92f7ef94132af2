"""glsim: simulate paired clean and noisy 16-bit depth frames of 3D faces, without a display.

    for frame in frames(load_settings(overrides={"sensor": "kinect-v2", ...})):
        frame.clean, frame.noisy, frame.infrared, frame.reason

The names below are the public API, with those of ``glsim.train``. Each is imported when it is first
used: ``import glsim`` loads neither OpenGL nor NumPy.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from glsim.bench.validate.report import Band, Check, Measurement, validation_check
    from glsim.core.camera import Intrinsics, SensorRig
    from glsim.core.errors import GlsimError
    from glsim.core.mesh import Mesh
    from glsim.core.reason import Reason
    from glsim.data.driver import generate
    from glsim.data.export import export_dataset
    from glsim.data.export.exported_frame import Export
    from glsim.data.layer_images import webdataset_decoder
    from glsim.data.reader import open_dataset
    from glsim.data.verification import verify
    from glsim.denoise.registry import load_denoiser
    from glsim.eval.metrics.metric import Metric
    from glsim.eval.scoring.blocks import ScoringJob
    from glsim.eval.scoring.evaluate import evaluate
    from glsim.faces.face_source import Face, FaceKey, FaceSettings, FaceSource
    from glsim.faces.meshes import load_mesh
    from glsim.faces.one_mesh import OneMesh
    from glsim.gl.context import open_context
    from glsim.noise.realsense_filters import filter_sequence
    from glsim.noise.stage import array_stage
    from glsim.sensors.images import remove_fixed_pattern
    from glsim.sensors.sensor import Sensor, load_sensor, sensor_names
    from glsim.settings.schema import Settings, load_settings
    from glsim.simulation.depth_noise import DepthNoise
    from glsim.simulation.frame import Frame, Skipped
    from glsim.simulation.pipeline import Simulator, frames, open_sources, simulate
    from glsim.simulation.plan.tasks import make_tasks

__version__: str

#: Module -> the public names that it holds.
_NAMES = {
    "glsim.bench.validate.report": "Band Check Measurement validation_check",
    "glsim.core.camera": "Intrinsics SensorRig",
    "glsim.core.errors": "GlsimError",
    "glsim.core.mesh": "Mesh",
    "glsim.core.reason": "Reason",
    "glsim.data.driver": "generate",
    "glsim.data.export": "export_dataset",
    "glsim.data.export.exported_frame": "Export",
    "glsim.data.layer_images": "webdataset_decoder",
    "glsim.data.reader": "open_dataset",
    "glsim.data.verification": "verify",
    "glsim.denoise.registry": "load_denoiser",
    "glsim.eval.metrics.metric": "Metric",
    "glsim.eval.scoring.blocks": "ScoringJob",
    "glsim.eval.scoring.evaluate": "evaluate",
    "glsim.faces.face_source": "Face FaceKey FaceSettings FaceSource",
    "glsim.faces.meshes": "load_mesh",
    "glsim.faces.one_mesh": "OneMesh",
    "glsim.gl.context": "open_context",
    "glsim.noise.realsense_filters": "filter_sequence",
    "glsim.noise.stage": "array_stage",
    "glsim.sensors.images": "remove_fixed_pattern",
    "glsim.sensors.sensor": "Sensor load_sensor sensor_names",
    "glsim.settings.schema": "Settings load_settings",
    "glsim.simulation.depth_noise": "DepthNoise",
    "glsim.simulation.frame": "Frame Skipped",
    "glsim.simulation.pipeline": "Simulator frames open_sources simulate",
    "glsim.simulation.plan.tasks": "make_tasks",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = [
    "Band", "Check", "DepthNoise", "Export", "Face", "FaceKey", "FaceSettings", "FaceSource",
    "Frame", "GlsimError", "Intrinsics", "Measurement", "Mesh", "Metric", "OneMesh", "Reason",
    "ScoringJob", "Sensor", "SensorRig", "Settings", "Simulator", "Skipped", "array_stage",
    "evaluate", "export_dataset", "filter_sequence", "frames", "generate", "load_denoiser",
    "load_mesh", "load_sensor", "load_settings", "make_tasks", "open_context", "open_dataset",
    "open_sources", "remove_fixed_pattern", "sensor_names", "simulate", "validation_check",
    "verify", "webdataset_decoder",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name from its module; ``__version__`` is that of the installed package."""
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("glsim")
    if name not in _HOME:
        raise AttributeError(f"module 'glsim' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """Return the public names, for completion in an interpreter."""
    return [*__all__, "__version__"]
