"""
A sensor from a recording
=========================

``glsim fit`` measures the noise of a camera on a recording of a scene that does not move, and
writes a sensor file. We have no camera here. We record with a simulated one whose noise we know,
and see whether the fit finds it.
"""

# %%
# Record
# ------
# The scene: a wall at a slant and three boxes before it. The camera: ``kinect-v2-fast`` with
# twice the noise of light (``shot_variance`` and ``read_variance`` of its stage times four).
# Forty frames, as 16-bit PNG files in millimetres.
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np

from glsim import DepthNoise, load_sensor, load_settings

folder = Path(tempfile.mkdtemp())
stage = next(s for s in load_sensor("kinect-v2-fast").stages if s.name == "tof_fast")
planted = {
    name: 4 * stage.settings[name].bounds()[0] for name in ("read_variance", "shot_variance")
}
print(stage.name, planted)

columns, rows = np.meshgrid(np.arange(512), np.arange(424))
scene = 1500 + 2.0 * (columns - 256) + 0.4 * rows
for left, top, depth in ((60, 220, 900), (210, 250, 1150), (360, 60, 1500)):
    scene[top : top + 140, left : left + 110] = depth
scene_m = scene.astype(np.uint16).astype(np.float32) / 1000

camera = load_settings(
    overrides={"sensor": "kinect-v2-fast", "stage": {stage.name: planted}, "seed": 3}
)
recording = folder / "recording"
recording.mkdir()
noisy = []
with DepthNoise(camera) as noise:
    for number in range(40):
        frame = noise.corrupt_depth(scene_m, frame=number)
        noisy.append(frame.noisy)
        cv2.imwrite(str(recording / f"{number:04d}_depth.png"), frame.noisy)
        cv2.imwrite(str(recording / f"{number:04d}_ir.png"), frame.infrared)

# %%
# The noise over time, of each pixel: more at the far side, where less light returns.
stack = np.stack(noisy).astype(np.float32)
spread = np.where((stack > 0).all(axis=0), stack.std(axis=0), np.nan)
figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
first = axes[0].imshow(np.where(noisy[0] > 0, noisy[0], np.nan), cmap="viridis_r")
figure.colorbar(first, ax=axes[0], label="depth [mm]", shrink=0.8)
second = axes[1].imshow(spread, vmin=0, vmax=8, cmap="magma")
figure.colorbar(second, ax=axes[1], label="standard deviation over time [mm]", shrink=0.8)
for axis in axes:
    axis.set_axis_off()
plt.show()

# %%
# Fit
# ---
# The albedo of the scene relative to a white wall cannot be seen in depth and infrared; maps of
# ``DepthNoise`` have 0.6. The test on the other half of the frames is left out here.
sensor = folder / "mine.toml"
command = [
    sys.executable,
    "-m",
    "glsim",
    "fit",
    str(recording),
    "-o",
    str(sensor),
    "--albedo",
    "0.6",
    "--no-proof",
]
done = subprocess.run(command, capture_output=True, text=True, check=False)
print((done.stdout + done.stderr).replace(str(folder), "."))
done.check_returncode()

# %%
# Compare
# -------
# The fitted sensor sees the same scene. Its noise over distance should be that of the recording.
again = load_settings(overrides={"sensor": str(sensor), "seed": 11})
with DepthNoise(again) as noise:
    simulated = [noise.corrupt_depth(scene_m, frame=n).noisy for n in range(40)]
fitted = np.stack(simulated).astype(np.float32)
fitted_spread = np.where((fitted > 0).all(axis=0), fitted.std(axis=0), np.nan)

edges = np.arange(850, 2200, 150)
middles = (edges[:-1] + edges[1:]) / 2
figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
for label, values in (("recording", spread), ("fitted sensor", fitted_spread)):
    medians = []
    for low, high in pairwise(edges):
        inside = values[(scene >= low) & (scene < high)]
        medians.append(np.nanmedian(inside) if np.isfinite(inside).any() else np.nan)
    axis.plot(middles, medians, "o-", label=label)
axis.set(xlabel="distance [mm]", ylabel="median of the noise [mm]", ylim=(0, None))
axis.legend()
plt.show()
print(f"all pixels: recording {np.nanmedian(spread):.2f} mm, "
      f"fitted {np.nanmedian(fitted_spread):.2f} mm")  # fmt: skip

# %%
# For a real camera, record walls and furniture at many distances, 60 frames or more, with the
# camera at rest. What the fit measures and what it cannot:
# :ref:`Fit one to your camera <fit-a-camera>`.
