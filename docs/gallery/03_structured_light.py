"""
Structured light: dots, matched with their pattern
==================================================

The Kinect V1 and TrueDepth project a known pattern and match one image with it. ``kinect-v1`` has
the statistics of the same camera without its images, and is fast; ``truedepth-filtered`` is how
Apple delivers its depth: filled and smoothed. Shading shows the steps and the grain.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LightSource

from glsim import frames, load_settings

SENSORS = ["kinect-v1", "kinect-v1-pattern", "truedepth", "truedepth-filtered"]
figure, axes = plt.subplots(1, 4, figsize=(10, 3.2), layout="constrained")
for axis, name in zip(axes, SENSORS, strict=True):
    settings = load_settings(
        overrides={
            "sensor": name,
            "source": {"subjects": 1, "frames_per_subject": 1},
            "pose": {"distance_mm": 900 if name.startswith("kinect") else 500, "yaw_deg": 15},
            "scene": {"wall_mm": 1300},  # without one, the filter fills all of the image
            "output": {"crop": 240},
        }
    )
    (frame,) = frames(settings)
    noisy_mm = frame.noisy * frame.depth_unit_mm
    pixel_mm = np.median(noisy_mm[noisy_mm > 0]) / frame.intrinsics.fx
    shade = LightSource(45, 45).hillshade(-noisy_mm, dx=pixel_mm, dy=pixel_mm)
    axis.imshow(np.where(noisy_mm > 0, shade, np.nan), cmap="gray", vmin=0, vmax=1)
    axis.set_title(name, fontsize=9)
    axis.set_axis_off()
plt.show()
