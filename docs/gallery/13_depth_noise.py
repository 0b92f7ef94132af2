"""
Noise as a transform of a training pipeline
===========================================

``DepthNoise`` adds a sensor's noise to clean depth of one's own, in metres: anew with each call, in
each worker of a DataLoader and in each epoch, for arrays of NumPy and tensors of PyTorch. The depth
here is a bowl on a wall, which no face model knows.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import DepthNoise

rows, columns = np.mgrid[:240, :320]
radius = np.hypot(rows - 120, columns - 160)
clean_m = np.where(radius < 90, 0.8 + 0.1 * (radius / 90) ** 2, 1.2).astype(np.float32)

figure, axes = plt.subplots(1, 4, figsize=(10, 2.6), layout="constrained")
for axis, (sensor, call) in zip(
    axes,
    [("kinect-v2", 1), ("kinect-v2", 2), ("kinect-v1", 1), ("any-depth-camera", 1)],
    strict=True,
):
    noise = DepthNoise(sensor, seed=1)
    for _ in range(call):
        noisy_m = noise(clean_m)
    error_mm = np.where(noisy_m > 0, 1000 * (noisy_m - clean_m), np.nan)
    image = axis.imshow(error_mm, cmap="RdBu_r", vmin=-10, vmax=10)
    axis.set_title(f"{sensor}, call {call}", fontsize=9)
    axis.set_axis_off()
figure.colorbar(image, ax=axes, label="noisy - clean [mm]")
plt.show()

# %%
# In a DataLoader, with albumentations and kornia: :doc:`/howto/python`.
