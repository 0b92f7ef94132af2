"""
A sequence: what one frame alone does not know
==============================================

Frames of generated heads follow each other as those of a camera do; the head moves and the
expression changes. ``face-video`` also sees up to four earlier frames, and gets better with each.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import frames, load_denoiser, load_settings

settings = load_settings(
    overrides={
        "redraw": "sequence",
        "source": {"subjects": 1, "frames_per_subject": 8},
        "pose": {"distance_mm": 1500},
        "output": {"crop": 128},
    }
)
names = ["noisy", "face", "face-video"]
streams = {name: load_denoiser(name) for name in names}
curves: dict[str, list[float]] = {name: [] for name in names}
for frame in frames(settings, layers=("clean", "noisy", "expected")):
    expected_mm = frame.expected.astype(float)
    for name, stream in streams.items():
        depth_mm, valid = stream.push(frame.noisy)
        both = valid & (expected_mm > 0)
        curves[name].append(float(np.median(np.abs(depth_mm - expected_mm)[both])))

figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
for name, values in curves.items():
    axis.plot(values, marker="o", label=name)
axis.set(xlabel="frame of the sequence", ylabel="error at 1.5 m [mm], median", ylim=(0, None))
axis.legend(frameon=False)
plt.show()
