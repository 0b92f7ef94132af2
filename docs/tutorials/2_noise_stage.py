"""
A noise stage of your own
=========================

A stage is a GLSL file. Its declarations are its interface: what it reads, what it writes, and its
parameters with their ranges. We write one that adds horizontal bands, as interference of a mains
lamp does, and put it behind the Kinect V2's chain.
"""

# %%
# The stage
# ---------
# ``//@`` declares range, unit and help. glsim checks values against them, and ``glsim stages
# bands.glsl`` prints them. ``random_bits`` gives the same bits for the same pixel, frame and
# stage, whatever the order of the work.
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from glsim import frames, load_sensor, load_settings

folder = Path(tempfile.mkdtemp())
(folder / "bands.glsl").write_text("""\
#version 330 core
// bands: horizontal bands of depth error that move from frame to frame.
#include "lib/random.glsl"
uniform float amplitude_mm = 3.0;  //@ [0, 50] mm height of the bands
uniform float period_px = 30.0;    //@ [4, 500] px distance from band to band
uniform sampler2D u_depth;
uniform uint u_seed;
out float depth;
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    float start = float(random_bits(ivec2(0), u_seed, 0u).x) / 4294967296.0;  // one for the frame
    if (depth > 0.0)
        depth += 0.001 * amplitude_mm * sin(6.2832 * (gl_FragCoord.y / period_px + start));
}
""")

# %%
# The sensor
# ----------
# A sensor file is a rig and a chain. We take the shipped file and add the stage at the end.
shipped = load_sensor("kinect-v2").file.read_text()
sensor = folder / "banded.toml"
sensor.write_text(
    shipped + '\n[[stage]]\nuse = "bands.glsl"\namplitude_mm = { uniform = [1, 4] }\n'
)
print([stage.name for stage in load_sensor(str(sensor)).stages])

# %%
# The amplitude is a distribution: each frame has its own, and the manifest of a data set records
# it.
settings = load_settings(
    overrides={
        "sensor": str(sensor),
        "source": {"subjects": 1, "frames_per_subject": 3},
        "output": {"crop": 160},
    }
)
seen = list(frames(settings))
for frame in seen:
    print({name: round(value, 2) for name, value in frame.parameters.items()})

# %%
figure, axes = plt.subplots(1, 3, figsize=(9, 3.4), layout="constrained")
for axis, frame in zip(axes, seen, strict=True):
    both = (frame.clean > 0) & (frame.noisy > 0)
    error = np.where(both, frame.noisy.astype(float) - frame.clean, np.nan)
    image = axis.imshow(error, vmin=-8, vmax=8, cmap="RdBu_r")
    axis.set_title(f"{frame.parameters['bands.amplitude_mm']:.1f} mm", fontsize=9)
    axis.set_axis_off()
figure.colorbar(image, ax=axes, label="noisy - clean [mm]", shrink=0.8)
plt.show()

# %%
# Next
# ----
# - Switch stages off to see one alone: ``--set tof_edge.enabled=false``.
# - All shipped stages, with links to their source: :doc:`/reference/stages`.
# - Layers, includes and stages in Python: :doc:`/howto/noise_stage`.
