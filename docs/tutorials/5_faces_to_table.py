"""
From faces to a table
=====================

The way of a paper: faces, a sensor, denoisers, a table with intervals. We ask how much the choice
of the noise model decides which denoiser wins.
"""

# %%
# Two data sets of the same faces
# -------------------------------
# The same seed and settings give the same faces in the same poses; only the sensor differs.
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

from glsim import ScoringJob, evaluate, generate, load_settings

folder = Path(tempfile.mkdtemp())
sensors = ("kinect-v2", "led3d")
for sensor in sensors:
    settings = load_settings(
        overrides={
            "sensor": sensor,
            "seed": 1,
            "split": "0,0,1",
            "source": {"subjects": 4, "frames_per_subject": 3},
            "output": {"crop": 128},
        }
    )
    generate(settings, folder / sensor, workers=1)

# %%
# Score
# -----
# ``noisy`` is the input as it is. Other names: ``glsim eval --list``; functions of your own and
# networks work, too. A network may have several rows: ways to decide which pixels have depth.
denoisers = {"noisy": "noisy", "median": "median", "quadric": "quadric:sigma_px=2", "face": "face"}
metrics = {
    "mse_mm2": "MSE, all pixels [mm²]",
    "both_rmse_mm": "RMSE where both have depth [mm]",
    "input_interior_rmse_mm": "RMSE, interior of the surface [mm]",
}
specs = tuple(f"{name}@{spec}" for name, spec in denoisers.items())
summaries = {}
for sensor in sensors:
    job = ScoringJob(folder / sensor, "test", specs)
    summaries[sensor] = evaluate(job, folder / f"{sensor}-scores", workers=1).summary
rows = [name for name in summaries[sensors[0]].methods if name.split(" [")[0] in denoisers]

for metric, title in metrics.items():
    print(f"\n{title}\n{'':22}" + "".join(f"{sensor:>12}" for sensor in sensors))
    for name in rows:
        values = [summaries[sensor].mean(name, metric) for sensor in sensors]
        print(f"{name:22}" + "".join(f"{value:12.2f}" for value in values))

# %%
figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained", sharey=True)
for axis, (metric, title) in zip(axes, metrics.items(), strict=True):
    for number, sensor in enumerate(sensors):
        places = [place + 0.4 * number for place in range(len(rows))]
        values = [summaries[sensor].mean(name, metric) for name in rows]
        axis.barh(places, values, 0.4, label=sensor)
    axis.set_yticks([0.2 + place for place in range(len(rows))], rows, fontsize=8)
    axis.set_title(title, fontsize=9)
axes[0].invert_yaxis()
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()

# %%
# Read the first column with care: it is decided by a few hundred silhouette pixels, see
# :doc:`/explanation/all_pixel_mse`.
#
# The same on the command line, with intervals, figures and a report:
#
# .. code-block:: sh
#
#    glsim eval data -d noisy -d median -d quadric:sigma_px=2 -d face -o scores
#
# :doc:`/results/paper_studies` has this comparison under four noise models, with tuned filters.
