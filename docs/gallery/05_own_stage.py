"""
A GLSL stage of one's own, without a file of a sensor
=====================================================

``with_stage`` puts code into a simulator's chain. Here a stage of twelve lines behind the Kinect
V2's chain stands for a smeared front glass: depth is lost in a spot, and pulled nearer around it.
"""

import matplotlib.pyplot as plt
import numpy as np

from glsim import Simulator, load_settings, make_tasks, open_context, open_sources

SMEAR = """\
#version 330 core
// smear: a fingerprint on the glass. Chosen, as an example.
uniform float radius_px = 40.0;  //@ [1, 500] px radius of the spot
uniform float pull_mm = 15.0;    //@ [0, 200] mm how much nearer depth is beside it
uniform sampler2D u_depth;
out float depth;
void main() {
    depth = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r;
    float distance_px = length(gl_FragCoord.xy - vec2(270.0, 190.0));
    if (distance_px < 0.4 * radius_px) depth = 0.0;
    if (depth > 0.0) depth -= 0.001 * pull_mm * exp(-0.5 * pow(distance_px / radius_px, 2.0));
}
"""
one = {"subjects": 1, "frames_per_subject": 1}
settings = load_settings(overrides={"source": one, "scene": {"wall_mm": 1500}})
sources = open_sources(settings)
plain = Simulator(settings, sources, open_context())
smeared = plain.with_stage("smear", SMEAR)
louder = smeared.with_values({"smear.pull_mm": 60})

# %%
tasks = make_tasks(settings, sources)
figure, axes = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained")
for axis, (title, simulator) in zip(
    axes, {"kinect-v2": plain, "smear": smeared, "smear.pull_mm = 60": louder}.items(), strict=True
):
    (frame,) = simulator.frames(tasks)
    both = (frame.clean > 0) & (frame.noisy > 0)
    error_mm = np.where(both, frame.noisy.astype(float) - frame.clean, np.nan)
    image = axis.imshow(error_mm, cmap="RdBu_r", vmin=-40, vmax=40)
    axis.set_title(title, fontsize=9)
    axis.set_axis_off()
figure.colorbar(image, ax=axes, label="noisy - clean [mm]")
plt.show()

# %%
# Layers that a stage may read, includes, and stages in Python: :doc:`/howto/noise_stage`.
