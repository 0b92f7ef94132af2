"""
Four devices of one model
=========================

Cameras of one model differ: in gain, in their fixed pattern, in the waves of their depth. Numbers
with ``per = "device"`` are drawn once per device of a plan; the first device is the typical one.
The mean of many frames of a wall shows what a device always does wrong.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import Simulator, load_settings, make_tasks, open_context, open_sources

settings = load_settings(
    overrides={
        "devices": 4,
        "source": {"subjects": 4, "frames_per_subject": 8},
        "scene": {"wall_mm": 1300},
    }
)
sources = open_sources(settings)
simulator = Simulator(settings, sources, open_context())
tasks = make_tasks(settings, sources)
by_device: dict[int, list[np.ndarray]] = {}
for task, frame in zip(tasks, simulator.frames(tasks), strict=True):
    wall = (frame.clean > 1290) & (frame.noisy > 0)
    error_mm = np.where(wall, frame.noisy.astype(float) - frame.clean, np.nan)
    by_device.setdefault(task.device, []).append(error_mm)

# %%
# The people before the wall move, so that most of it is seen in some frame.
figure, axes = plt.subplots(1, 4, figsize=(10, 2.9), layout="constrained")
for axis, (device, errors) in zip(axes, sorted(by_device.items()), strict=True):
    seen = np.isfinite(errors).sum(axis=0)
    mean_mm = np.where(seen > 4, np.nansum(errors, axis=0) / np.maximum(seen, 1), np.nan)
    image = axis.imshow(mean_mm - np.nanmedian(mean_mm), cmap="RdBu_r", vmin=-6, vmax=6)
    axis.set_title(f"device {device}: mean {np.nanmedian(mean_mm):+.1f} mm", fontsize=9)
    axis.set_axis_off()
figure.colorbar(image, ax=axes, label="mean error, less its median [mm]")
plt.show()

# %%
# A command draws them alike: ``glsim generate -o data --set devices=8``. What differs in a Kinect
# V2: :doc:`/explanation/time_of_flight`, "Bias".
