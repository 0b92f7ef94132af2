"""glsim: 3D faces in, paired clean and noisy 16-bit depth frames out, without a display.

    from glsim import load_settings, simulate
    for frame in simulate(load_settings(overrides={"sensor": "kinect-v2", ...})):
        frame.clean, frame.noisy, frame.infrared, frame.reason

The names below are the public API; each is imported when it is first used, so that
``import glsim`` costs nothing and needs no OpenGL.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from glsim.camera import Intrinsics, SensorRig
    from glsim.config import Settings, load_settings
    from glsim.corrupt import Corrupter
    from glsim.dataset import generate, open_dataset, verify
    from glsim.errors import GlsimError
    from glsim.faces.one import OneMesh
    from glsim.frame import Frame, Skipped
    from glsim.mesh import Mesh
    from glsim.noise.stage import array_stage
    from glsim.pipeline import simulate
    from glsim.plan import make_tasks
    from glsim.reason import Reason
    from glsim.sensor import Sensor, load_sensor, sensor_names

_HOME = {
    "Corrupter": "glsim.corrupt",
    "Frame": "glsim.frame",
    "GlsimError": "glsim.errors",
    "Intrinsics": "glsim.camera",
    "Mesh": "glsim.mesh",
    "OneMesh": "glsim.faces.one",
    "Reason": "glsim.reason",
    "Sensor": "glsim.sensor",
    "SensorRig": "glsim.camera",
    "Settings": "glsim.config",
    "Skipped": "glsim.frame",
    "array_stage": "glsim.noise.stage",
    "generate": "glsim.dataset",
    "load_sensor": "glsim.sensor",
    "load_settings": "glsim.config",
    "make_tasks": "glsim.plan",
    "open_dataset": "glsim.dataset",
    "sensor_names": "glsim.sensor",
    "simulate": "glsim.pipeline",
    "verify": "glsim.dataset",
}

__all__ = [
    "Corrupter",
    "Frame",
    "GlsimError",
    "Intrinsics",
    "Mesh",
    "OneMesh",
    "Reason",
    "Sensor",
    "SensorRig",
    "Settings",
    "Skipped",
    "array_stage",
    "generate",
    "load_sensor",
    "load_settings",
    "make_tasks",
    "open_dataset",
    "sensor_names",
    "simulate",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Import a public name from where it lives."""
    if name not in _HOME:
        raise AttributeError(f"module 'glsim' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
