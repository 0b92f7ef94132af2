"""
A data set as point clouds
==========================

``glsim export`` carries data sets into other programs. Here clean and noisy depth become PLY files,
which Open3D, MeshLab and CloudCompare open, and are drawn from the file.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import trimesh

from glsim import export_dataset, generate, load_settings, open_dataset

folder = Path(tempfile.mkdtemp())
settings = load_settings(
    overrides={
        "sensor": "kinect-v2",
        "source": {"subjects": 1, "frames_per_subject": 1},
        "pose": {"yaw_deg": 10},
        "output": {"crop": 160},
    }
)
generate(settings, folder / "data")
export_dataset(open_dataset(folder / "data"), folder / "clouds", ["ply"])
files = sorted((folder / "clouds").rglob("*.ply"))
print(*[file.relative_to(folder) for file in files], sep="\n")

# %%
figure, axes = plt.subplots(1, 2, figsize=(9, 4.8), subplot_kw={"projection": "3d"})
for axis, file in zip(axes, files, strict=True):
    points_m = trimesh.load(file).vertices[::3]
    x, y, z = points_m.T
    axis.scatter(x, z, -y, c=z, cmap="viridis_r", s=1.5, vmin=z.min(), vmax=z.min() + 0.25)
    axis.view_init(elev=5, azim=-50)
    axis.set_box_aspect([1, 1, 1.2])
    axis.set_title(file.name, fontsize=9)
    axis.set_axis_off()
plt.show()

# %%
# NumPy, OpenEXR, cameras of Open3D and ROS: :doc:`/howto/export`.
