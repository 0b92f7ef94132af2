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
    from glsim.corrupt import Corrupter
    from glsim.dataset import generate, open_dataset, verify, webdataset_decoder
    from glsim.denoise import load_denoiser
    from glsim.errors import GlsimError
    from glsim.eval.metrics.metric import Metric
    from glsim.eval.scoring.blocks import ScoringJob
    from glsim.eval.scoring.run import evaluate
    from glsim.exports import export_dataset, push_dataset
    from glsim.exports.base import Export
    from glsim.faces.base import Face, FaceKey, FaceSettings, FaceSource
    from glsim.faces.one_mesh import OneMesh
    from glsim.frame import Frame, Skipped
    from glsim.geometry.camera import Intrinsics, SensorRig
    from glsim.geometry.mesh import Mesh
    from glsim.gl.context import open_context
    from glsim.meshio import load_mesh
    from glsim.noise.realsense_filters import filter_sequence
    from glsim.noise.stage import array_stage
    from glsim.pipeline import Simulator, frames, open_sources, simulate
    from glsim.plan.tasks import make_tasks
    from glsim.reason import Reason
    from glsim.sensors.pattern_map import remove_fixed_pattern
    from glsim.sensors.sensor import Sensor, load_sensor, sensor_names
    from glsim.settings.schema import Settings, load_settings
    from glsim.validate.report import Band, Check, Measurement, validation_check

__version__: str

_HOME = {
    "Band": "glsim.validate.report",
    "Check": "glsim.validate.report",
    "Corrupter": "glsim.corrupt",
    "Export": "glsim.exports.base",
    "Face": "glsim.faces.base",
    "FaceKey": "glsim.faces.base",
    "FaceSettings": "glsim.faces.base",
    "FaceSource": "glsim.faces.base",
    "Frame": "glsim.frame",
    "GlsimError": "glsim.errors",
    "Intrinsics": "glsim.geometry.camera",
    "Measurement": "glsim.validate.report",
    "Mesh": "glsim.geometry.mesh",
    "Metric": "glsim.eval.metrics.metric",
    "OneMesh": "glsim.faces.one_mesh",
    "Reason": "glsim.reason",
    "ScoringJob": "glsim.eval.scoring.blocks",
    "Sensor": "glsim.sensors.sensor",
    "SensorRig": "glsim.geometry.camera",
    "Settings": "glsim.settings.schema",
    "Simulator": "glsim.pipeline",
    "Skipped": "glsim.frame",
    "array_stage": "glsim.noise.stage",
    "evaluate": "glsim.eval.scoring.run",
    "export_dataset": "glsim.exports",
    "filter_sequence": "glsim.noise.realsense_filters",
    "frames": "glsim.pipeline",
    "generate": "glsim.dataset",
    "load_denoiser": "glsim.denoise",
    "load_mesh": "glsim.meshio",
    "load_sensor": "glsim.sensors.sensor",
    "load_settings": "glsim.settings.schema",
    "make_tasks": "glsim.plan.tasks",
    "open_context": "glsim.gl.context",
    "open_dataset": "glsim.dataset",
    "open_sources": "glsim.pipeline",
    "push_dataset": "glsim.exports",
    "remove_fixed_pattern": "glsim.sensors.pattern_map",
    "sensor_names": "glsim.sensors.sensor",
    "simulate": "glsim.pipeline",
    "validation_check": "glsim.validate.report",
    "verify": "glsim.dataset",
    "webdataset_decoder": "glsim.dataset",
}

__all__ = [
    "Band",
    "Check",
    "Corrupter",
    "Export",
    "Face",
    "FaceKey",
    "FaceSettings",
    "FaceSource",
    "Frame",
    "GlsimError",
    "Intrinsics",
    "Measurement",
    "Mesh",
    "Metric",
    "OneMesh",
    "Reason",
    "ScoringJob",
    "Sensor",
    "SensorRig",
    "Settings",
    "Simulator",
    "Skipped",
    "array_stage",
    "evaluate",
    "export_dataset",
    "filter_sequence",
    "frames",
    "generate",
    "load_denoiser",
    "load_mesh",
    "load_sensor",
    "load_settings",
    "make_tasks",
    "open_context",
    "open_dataset",
    "open_sources",
    "push_dataset",
    "remove_fixed_pattern",
    "sensor_names",
    "simulate",
    "validation_check",
    "verify",
    "webdataset_decoder",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module; ``__version__`` is that of the installed package."""
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("glsim")
    if name not in _HOME:
        raise AttributeError(f"module 'glsim' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
