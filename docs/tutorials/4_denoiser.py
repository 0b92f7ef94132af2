"""
A denoiser on your data
=======================

We train the smallest useful network for a few seconds, and compare it with a median filter and with
the network in the package. The training is far too short on purpose: the steps are the lesson, not
the result.
"""

# %%
# Data
# ----
# Crops of 96 pixels, a few people. For a real training take 400 people and draw sensor and pose
# at random: :doc:`/howto/training`. Depth in steps of 0.1 mm keeps the surface smooth.
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch

from glsim import generate, load_denoiser, load_settings, open_dataset
from glsim.train import fit, load_recipe, stored_batches

torch.set_num_threads(1)
folder = Path(tempfile.mkdtemp())
settings = load_settings(
    overrides={
        "seed": 5,
        "split": "0.8,0.1,0.1",
        "source": {"subjects": 20, "frames_per_subject": 3},
        "pose": {"yaw_deg": {"uniform": [-30, 30]}},
        "output": {"crop": 96, "depth_unit_mm": 0.1, "layers": ("clean", "noisy", "expected")},
    }
)
generate(settings, folder / "data", workers=1)
dataset = open_dataset(folder / "data")
print({name: len(dataset.split(name)) for name in ("train", "val", "test")})

# %%
# Training
# --------
# A recipe holds every setting of a training. We make the network and the training tiny.
recipe = load_recipe(
    "face",
    overrides={
        "model": {"backbone": {"width": 16, "scales": 2}},
        "training": {"max_steps": 60, "validate_every": 20, "batch": 4},
        "schedule": {"warmup_steps": 5},
        "data": {"crop": 96},
    },
)
losses: list[float] = []
report = fit(
    recipe,
    stored_batches([folder / "data"], recipe),
    folder / "run",
    on_step=lambda status: losses.append(status.loss),
)
print(report["state"], "after", report["steps"], "steps")

figure, axis = plt.subplots(figsize=(6, 3), layout="constrained")
axis.plot(losses)
axis.set(xlabel="step", ylabel="loss of the batch")
plt.show()

# %%
# Use it
# ------
# A denoiser is a function of a depth map in millimetres.
denoisers = {
    "median": load_denoiser("median"),
    "60 steps": load_denoiser(str(folder / "run" / "best.pt")),
    "face (in the package)": load_denoiser("face"),
}
pair = dataset.split("test")[0]
figure, axes = plt.subplots(1, 4, figsize=(10, 3), layout="constrained")
results = {"noisy": pair.noisy_mm} | {name: d(pair.noisy_mm)[0] for name, d in denoisers.items()}
for axis, (name, depth_mm) in zip(axes, results.items(), strict=True):
    both = (pair.clean_mm > 0) & (depth_mm > 0)
    error = np.where(both, depth_mm - pair.clean_mm, np.nan)
    axis.imshow(error, vmin=-8, vmax=8, cmap="RdBu_r")
    typical = np.nanmedian(np.abs(error))
    axis.set_title(f"{name}\nmedian |error| {typical:.2f} mm", fontsize=9)
    axis.set_axis_off()
plt.show()

# %%
# Sixty steps can look good here: this network was trained on the sensor, the distance and the kind
# of faces of the test, the network in the package on many cameras and distances. And one frame
# decides nothing.
#
# Next
# ----
# - Thirty minutes of training: ``glsim train face --data data -o run --minutes 30``; continue
#   with ``--resume``.
# - Score it properly, with intervals and metrics that separate the surface from silhouettes: the
#   next tutorial.
# - What a denoiser keeps and removes: :doc:`/howto/denoise`. How networks hold on sensors that they
#   never saw: :doc:`/results/model_card`.
