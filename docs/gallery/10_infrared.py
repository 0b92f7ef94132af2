"""
Infrared beside the depth
=========================

Every sensor delivers its infrared image with the depth, in its own counts: a time-of-flight camera
its amplitude, a stereo camera its dots. Denoisers may use it.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import frames, load_settings

SENSORS = ["kinect-v2", "azure-kinect", "realsense-d435", "kinect-v1-pattern"]
figure, axes = plt.subplots(2, 2, figsize=(10, 7.2), layout="constrained")
for axis, name in zip(axes.flat, SENSORS, strict=True):
    settings = load_settings(
        overrides={
            "sensor": name,
            "source": {"subjects": 1, "frames_per_subject": 1},
            "pose": {"distance_mm": 700, "yaw_deg": -20},
            "scene": {"wall_mm": 1300},
            "appearance": {"wear": "always"},
        }
    )
    (frame,) = frames(settings)
    counts = frame.infrared.astype(float)
    axis.imshow(counts, cmap="gray", vmin=0, vmax=np.percentile(counts, 99.5))
    axis.set_title(f"{name}: {np.median(counts[frame.clean > 0]):.0f} counts (median)", fontsize=9)
    axis.set_axis_off()
plt.show()
