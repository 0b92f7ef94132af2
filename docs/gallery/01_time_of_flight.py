"""
Time of flight: four decoders of one head
=========================================

The Kinect V2 as libfreenect2 decodes it and as Microsoft's SDK does, and two modes of the Azure
Kinect. Shaded surfaces show the noise best: it is light where the sensor sees much light, and loud
where it sees little.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import frames, load_settings

SENSORS = ["kinect-v2", "kinect-v2-sdk", "azure-kinect", "azure-kinect-wfov"]
figure, axes = plt.subplots(2, 4, figsize=(10, 5.2), layout="constrained")
for (above, below), name in zip(axes.T, SENSORS, strict=True):
    one = {"subjects": 1, "frames_per_subject": 1}
    settings = load_settings(overrides={"sensor": name, "source": one, "scene": {"wall_mm": 1500}})
    (frame,) = frames(settings)
    noisy_mm = np.where(frame.noisy > 0, frame.noisy * frame.depth_unit_mm, np.nan)
    error_mm = np.where(frame.clean > 0, noisy_mm - frame.clean * frame.depth_unit_mm, np.nan)
    depth = above.imshow(noisy_mm, cmap="viridis_r", vmin=800, vmax=1500)
    error = below.imshow(error_mm, cmap="RdBu_r", vmin=-10, vmax=10)
    above.set_title(f"{name}\n{frame.noisy.shape[1]} x {frame.noisy.shape[0]}", fontsize=9)
for axis in axes.flat:
    axis.set_axis_off()
figure.colorbar(depth, ax=axes[0], label="noisy depth [mm]")
figure.colorbar(error, ax=axes[1], label="noisy - clean [mm]")
plt.show()

# %%
# How phases become millimetres, and each constant's source: :doc:`/explanation/time_of_flight`.
