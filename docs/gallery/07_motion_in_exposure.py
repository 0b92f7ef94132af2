"""
Motion within the exposure
==========================

A time-of-flight camera takes nine captures for one frame. What moves meanwhile has other phases in
each, and so wrong depth at its rims. A rolling shutter shears it.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import frames, load_settings

MOTIONS = {
    "still": {},
    "0.5 m/s to the right": {"x_mm_s": 500},
    "turns by 200 degrees/s": {"yaw_deg_s": 200},
}
figure, axes = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained")
for axis, (title, speeds) in zip(axes, MOTIONS.items(), strict=True):
    settings = load_settings(
        overrides={
            "source": {"subjects": 1, "frames_per_subject": 1},
            "scene": {"wall_mm": 1300},
            "motion": {"within_exposure": True, **speeds},
            "output": {"crop": 220},
        }
    )
    (frame,) = frames(settings)
    both = (frame.clean > 0) & (frame.noisy > 0)
    error_mm = np.where(both, frame.noisy.astype(float) - frame.clean, np.nan)
    image = axis.imshow(error_mm, cmap="RdBu_r", vmin=-60, vmax=60)
    axis.set_title(title, fontsize=9)
    axis.set_axis_off()
figure.colorbar(image, ax=axes, label="noisy - clean [mm]")
plt.show()

# %%
# Clean depth is that of the middle of the exposure. Which cameras have which exposure:
# :doc:`/howto/scenes`, "Motion".
