"""
Active stereo: two infrared images, matched
===========================================

A RealSense projects dots and matches two images. glsim draws both images and matches them, so that
depth has what matching gives it: fat silhouettes, shadows beside them, and steps of disparity.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import Simulator, load_settings, make_tasks, open_context, open_sources

settings = load_settings(
    overrides={
        "sensor": "realsense-d435",
        "source": {"subjects": 1, "frames_per_subject": 1},
        "pose": {"distance_mm": 600},
        "scene": {"wall_mm": 1200},
    }
)
sources = open_sources(settings)
simulator = Simulator(settings, sources, open_context())
simulator = simulator.with_layers(("clean", "noisy", "infrared", "infrared_right"), ("disparity",))
(frame,) = simulator.frames(make_tasks(settings, sources))

# %%
noisy_mm = np.where(frame.noisy > 0, frame.noisy * frame.depth_unit_mm, np.nan)
images = {
    "infrared, left": (frame.infrared, "gray"),
    "infrared, right": (frame.image("infrared_right"), "gray"),
    "disparity [px]": (
        np.where(frame.extra["disparity"] > 0, frame.extra["disparity"], np.nan),
        "viridis",
    ),
    "depth [mm]": (noisy_mm, "viridis_r"),
}
figure, axes = plt.subplots(2, 2, figsize=(10, 6), layout="constrained")
for axis, (title, (image, colours)) in zip(axes.flat, images.items(), strict=True):
    shown = axis.imshow(image, cmap=colours)
    axis.set_title(title, fontsize=9)
    axis.set_axis_off()
    figure.colorbar(shown, ax=axis, shrink=0.8)
plt.show()

# %%
# The five RealSense models and the OAK-D differ in baseline, pixels and projector:
# ``glsim sensors`` lists them. How the search works: :doc:`/explanation/stereo`.
