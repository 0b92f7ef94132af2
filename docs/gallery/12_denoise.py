"""
Denoise
=======

The shipped network beside filters, on a frame of a Kinect V2. What a device always does wrong, no
denoiser of single frames can see; so errors are measured against ``expected``, which has it.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import frames, load_denoiser, load_settings

settings = load_settings(
    overrides={
        "source": {"subjects": 1, "frames_per_subject": 1},
        "pose": {"yaw_deg": 15},
        "output": {"crop": 160},
    }
)
(frame,) = frames(settings, layers=("clean", "noisy", "expected"))
expected_mm = frame.expected.astype(float)

figure, axes = plt.subplots(1, 4, figsize=(10, 3.3), layout="constrained")
for axis, name in zip(axes, ["noisy", "bilateral", "quadric", "face"], strict=True):
    depth_mm, valid = load_denoiser(name)(frame.noisy)
    error_mm = np.where(valid & (expected_mm > 0), depth_mm - expected_mm, np.nan)
    image = axis.imshow(error_mm, cmap="RdBu_r", vmin=-6, vmax=6)
    axis.set_title(f"{name}: {np.nanmedian(np.abs(error_mm)):.2f} mm (median)", fontsize=9)
    axis.set_axis_off()
figure.colorbar(image, ax=axes, label="error [mm]")
plt.show()

# %%
# On real frames, and in training: :doc:`/howto/denoise`, :doc:`/howto/training`.
