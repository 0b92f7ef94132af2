"""
Noise models of papers, and any depth camera
============================================

Sensors that follow a paper's statistics instead of a camera's physics, for comparisons with other
work, and one whose whole character is drawn anew for each frame: training on it makes denoisers
that work for cameras that nobody simulated.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import frames, load_settings

SENSORS = ["ideal", "led3d", "kinect-v2-fankhauser", "kinect-v2-fast", "kinect-v2-paper"]
seen = {}
for name in SENSORS:
    one = {"source": {"subjects": 1, "frames_per_subject": 1}, "output": {"crop": 160}}
    (seen[name],) = frames(load_settings(overrides={"sensor": name, **one}))
three = {"source": {"subjects": 1, "frames_per_subject": 3}, "output": {"crop": 160}}
drawn = frames(load_settings(overrides={"sensor": "any-depth-camera", **three}))
seen |= {f"any-depth-camera, frame {number}": frame for number, frame in enumerate(drawn)}

# %%
figure, axes = plt.subplots(2, 4, figsize=(10, 5.4), layout="constrained")
for axis, (title, frame) in zip(axes.flat, seen.items(), strict=True):
    both = (frame.clean > 0) & (frame.noisy > 0)
    error_mm = (frame.noisy.astype(float) - frame.clean) * frame.depth_unit_mm
    image = axis.imshow(np.where(both, error_mm, np.nan), cmap="RdBu_r", vmin=-10, vmax=10)
    axis.set_title(title, fontsize=9)
    axis.set_axis_off()
figure.colorbar(image, ax=axes, label="noisy - clean [mm]")
plt.show()
