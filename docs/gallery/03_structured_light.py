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
figure, axes = plt.subplots(2, 2, figsize=(8, 8.4), layout="constrained")
for axis, name in zip(axes.flat, SENSORS, strict=True):
    kinect = name.startswith("kinect")
    distance_mm = 800 if kinect else 500
    settings = load_settings(
        overrides={
            "sensor": name,
            "source": {"subjects": 1, "frames_per_subject": 1},
            "pose": {"distance_mm": distance_mm, "yaw_deg": 15},
            # Without a wall, the filter fills all of the image.
            "scene": {"wall_mm": distance_mm + 400},
            "output": {"crop": 240 if kinect else 320, "depth_unit_mm": 0.1},
        }
    )
    (frame,) = frames(settings)
    noisy_mm = frame.noisy * frame.depth_unit_mm
    pixel_mm = np.median(noisy_mm[noisy_mm > 0]) / frame.intrinsics.fx
    shade = LightSource(45, 45).hillshade(-noisy_mm, 0.6, pixel_mm, pixel_mm)
    axis.imshow(np.where(noisy_mm > 0, shade, np.nan), cmap="gray", vmin=0, vmax=1)
    axis.set_title(name)
    axis.set_axis_off()
plt.show()
