"""
Rooms and dressed heads
=======================

``[scene]`` puts walls, doors and furniture around a person, ``[appearance]`` hair, glasses and
cloth on the head. The presets ``office`` and ``living-room`` do both with whole bodies, after
``glsim fetch people``; the embedded heads need nothing.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import frames, load_settings

settings = load_settings(
    overrides={
        "sensor": "kinect-v2",
        "seed": 4,
        "source": {"subjects": 3, "frames_per_subject": 1},
        # An embedded head has no arms: the image ends at its shoulders.
        "pose": {"distance_mm": 620, "y_mm": 225},
        "appearance": {"wear": "always", "glasses": 0.7},
        "scene": {"room": "office", "behind_mm": {"uniform": [900, 2400]}},
    }
)
figure, axes = plt.subplots(2, 3, figsize=(10, 5.8), layout="constrained")
for (above, below), frame in zip(axes.T, frames(settings), strict=True):
    noisy_mm = np.where(frame.noisy > 0, frame.noisy, np.nan)
    image = above.imshow(noisy_mm, cmap="viridis_r", vmin=500, vmax=4000)
    below.imshow(np.sqrt(frame.infrared), cmap="gray")
for axis in axes.flat:
    axis.set_axis_off()
figure.colorbar(image, ax=axes[0], label="noisy depth [mm]")
plt.show()

# %%
# All numbers of a room: :doc:`/howto/scenes`; of hair, glasses and cloth: :doc:`/howto/face_data`.
