"""
Shadows on one side and on two
==============================

What a camera sees and its light does not reach has no depth. The emitter stands to the side, and so
does the shadow, the wider the farther the wall is. A camera that matches also loses what it sees
beside a silhouette, on both sides. ``any-depth-camera`` draws the sides of its shadows for each
frame; here both are lit. ``reason`` says of each pixel why it has no depth.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Patch

from glsim import Reason, frames, load_settings

SENSORS = [
    "kinect-v2",
    "kinect-v2-sdk",
    "azure-kinect",
    "kinect-v1",
    "realsense-d415",
    "any-depth-camera",
]
COLOURS = {
    Reason.SHADOW: "#d55e00",
    Reason.EDGE: "#0072b2",
    Reason.LOW_SIGNAL: "#e69f00",
    Reason.MIXED: "#009e73",
    Reason.WINDOW: "#cc79a7",
}
figure, axes = plt.subplots(1, 6, figsize=(10, 2.6), layout="constrained")
for axis, name in zip(axes, SENSORS, strict=True):
    near = name == "realsense-d415"
    two = {"stage": {"any_camera_edges": {"shadow_lit": 0.9}}} if name.startswith("any") else {}
    settings = load_settings(
        overrides={
            "sensor": name,
            "source": {"subjects": 1, "frames_per_subject": 1},
            "pose": {"distance_mm": 500 if near else 900},
            "scene": {"wall_mm": 900 if near else 2200},
            "output": {"crop": 400 if near else 200},
            **two,
        }
    )
    (frame,) = frames(settings)
    image = np.repeat(np.where(frame.clean < 0.8 * frame.clean.max(), 0.93, 0.8)[..., None], 3, -1)
    image[frame.noisy == 0] = 0.2  # for another reason
    for reason, colour in COLOURS.items():
        lost = (frame.reason == reason) & (frame.noisy == 0)
        image[lost] = plt.matplotlib.colors.to_rgb(colour)
    axis.imshow(image, interpolation="nearest")
    axis.set_title(name, fontsize=9)
    axis.set_axis_off()
names = [Patch(color=colour, label=reason.name.lower()) for reason, colour in COLOURS.items()]
figure.legend(handles=names, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
plt.show()
