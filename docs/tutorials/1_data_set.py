"""
A first data set
================

We make a small data set of generated faces, look at what the sensor does to them, and read it as a
training script does.
"""

# %%
# Settings, then frames
# ---------------------
# Settings are one object. What is not given has a default: here the sensor ``kinect-v2``, and
# heads at 0.9 m. The size is small so that this page is quick: four people, four frames of each.
import tempfile
from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from glsim import Reason, generate, load_settings, open_dataset

folder = Path(tempfile.mkdtemp()) / "data"
settings = load_settings(
    overrides={
        "seed": 7,
        "split": "0.5,0.25,0.25",
        "source": {"subjects": 4, "frames_per_subject": 4},
        "pose": {"yaw_deg": {"uniform": [-25, 25], "per": "sequence"}},
        "output": {"crop": 160, "layers": ("clean", "noisy", "infrared", "reason")},
    }
)
summary = generate(settings, folder, workers=1)
print(f"{sum(summary.frames.values())} frames: {summary.frames}")

# %%
# On disk these are 16-bit PNG files and JSON lines; see :doc:`/howto/data_sets`. The first of them:
files = [file.relative_to(folder) for file in folder.rglob("*.*") if file.is_file()]
for file in sorted(file for file in files if file.parts[0] != ".glsim")[:14]:
    print(file)

# %%
# Read it
# -------
# People are never in two splits. ``clean_mm`` and ``noisy_mm`` are float32 millimetres, 0 where
# there is no depth.
dataset = open_dataset(folder)
pair = dataset.split("train")[0]
print(pair.key.subject, pair.clean_mm.shape, pair.noisy_mm.dtype, pair.intrinsics)

# %%
# One frame of four people: clean, noisy, difference, infrared. The difference is shown where both
# have depth.
shown = {p.key.subject: p for p in dataset}
figure, axes = plt.subplots(len(shown), 4, figsize=(8, 2 * len(shown)), layout="constrained")
for row, p in zip(axes, shown.values(), strict=True):
    both = (p.clean_mm > 0) & (p.noisy_mm > 0)
    error = np.where(both, p.noisy_mm - p.clean_mm, np.nan)
    depth = {"vmin": 800, "vmax": 1000, "cmap": "viridis_r"}
    row[0].imshow(np.where(p.clean_mm > 0, p.clean_mm, np.nan), **depth)
    row[1].imshow(np.where(p.noisy_mm > 0, p.noisy_mm, np.nan), **depth)
    row[2].imshow(error, vmin=-8, vmax=8, cmap="RdBu_r")
    row[3].imshow(p.infrared, cmap="gray")
for axis, title in zip(
    axes[0], ("clean", "noisy", "noisy - clean, ±8 mm", "infrared"), strict=True
):
    axis.set_title(title, fontsize=9)
for axis in axes.flat:
    axis.set_axis_off()
plt.show()

# %%
# Two kinds of error
# ------------------
# On the surface the error is a few millimetres. At silhouettes pixels are lost, or lie between
# the face and what is behind it. A mean over all pixels mixes both:
# :doc:`/explanation/all_pixel_mse`. The layer ``reason`` says why a pixel has no depth.
inside = [(p.noisy_mm - p.clean_mm)[(p.clean_mm > 0) & (p.noisy_mm > 0)] for p in dataset]
errors = np.concatenate(inside)
print(f"median of |error|: {np.median(np.abs(errors)):.2f} mm, 99 % below "
      f"{np.percentile(np.abs(errors), 99):.1f} mm")  # fmt: skip
codes = Counter(int(code) for p in dataset for code in p.reason[p.clean_mm > 0])
for code, count in codes.most_common():
    print(f"{count:7d} pixels  {Reason(code).name}: {Reason(code).help}")

# %%
# The same command line
# ---------------------
# .. code-block:: sh
#
#    glsim generate -o data --subjects 4 --frames-per-subject 4 --set split=0.5,0.25,0.25 --seed 7 \
#        --set output.crop=160 --set output.layers=clean,noisy,infrared,reason \
#        --set pose.yaw_deg='{ uniform = [-25, 25], per = "sequence" }'
#    glsim preview data -o seen
#
# Run ``glsim generate`` again: it verifies the set, or completes it after a crash, to the same
# bytes.
