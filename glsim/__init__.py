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
    from glsim.data.export import export_dataset, push_dataset
    from glsim.data.export.exported_frame import Export
    from glsim.data.layer_images import webdataset_decoder
    from glsim.data.reader import open_dataset
    from glsim.data.verification import verify
    from glsim.denoise import load_denoiser
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
    from glsim.simulation.corrupt import Corrupter
    from glsim.simulation.frame import Frame, Skipped
    from glsim.simulation.pipeline import Simulator, frames, open_sources, simulate
    from glsim.simulation.plan.tasks import make_tasks

__version__: str

_HOME = {
    "Band": "glsim.bench.validate.report",
    "Check": "glsim.bench.validate.report",
    "Corrupter": "glsim.simulation.corrupt",
    "Export": "glsim.data.export.exported_frame",
    "Face": "glsim.faces.face_source",
    "FaceKey": "glsim.faces.face_source",
    "FaceSettings": "glsim.faces.face_source",
    "FaceSource": "glsim.faces.face_source",
    "Frame": "glsim.simulation.frame",
    "GlsimError": "glsim.core.errors",
    "Intrinsics": "glsim.core.camera",
    "Measurement": "glsim.bench.validate.report",
    "Mesh": "glsim.core.mesh",
    "Metric": "glsim.eval.metrics.metric",
    "OneMesh": "glsim.faces.one_mesh",
    "Reason": "glsim.core.reason",
    "ScoringJob": "glsim.eval.scoring.blocks",
    "Sensor": "glsim.sensors.sensor",
    "SensorRig": "glsim.core.camera",
    "Settings": "glsim.settings.schema",
    "Simulator": "glsim.simulation.pipeline",
    "Skipped": "glsim.simulation.frame",
    "array_stage": "glsim.noise.stage",
    "evaluate": "glsim.eval.scoring.evaluate",
    "export_dataset": "glsim.data.export",
    "filter_sequence": "glsim.noise.realsense_filters",
    "frames": "glsim.simulation.pipeline",
    "generate": "glsim.data.driver",
    "load_denoiser": "glsim.denoise",
    "load_mesh": "glsim.faces.meshes",
    "load_sensor": "glsim.sensors.sensor",
    "load_settings": "glsim.settings.schema",
    "make_tasks": "glsim.simulation.plan.tasks",
    "open_context": "glsim.gl.context",
    "open_dataset": "glsim.data.reader",
    "open_sources": "glsim.simulation.pipeline",
    "push_dataset": "glsim.data.export",
    "remove_fixed_pattern": "glsim.sensors.images",
    "sensor_names": "glsim.sensors.sensor",
    "simulate": "glsim.simulation.pipeline",
    "validation_check": "glsim.bench.validate.report",
    "verify": "glsim.data.verification",
    "webdataset_decoder": "glsim.data.layer_images",
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
