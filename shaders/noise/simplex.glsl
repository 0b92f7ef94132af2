#version 330 core
// simplex: adds simplex noise, in depth or in disparity.
#include "lib/simplex.glsl"
#include "lib/field.glsl"
#include "lib/disparity.glsl"

uniform float amplitude_mm = 2.0;  //@ [0, 100]  mm amplitude in depth
uniform float amplitude_px = 0.0;  //@ [0, 5]    px amplitude in disparity (render_kinect: 0.5)
uniform float lattice_px = 8.0;    //@ [1, 1024] px size of a lattice cell
uniform float drift_hz = 0.0;      //@ [0, 120]  Hz lattice cells per second that a sequence moves through; 0: a new field per frame

uniform sampler2D u_depth;

out float depth;

void main() {
    float here = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r;
    float noise = simplex(field_position(vec2(lattice_px), drift_hz), field_seed(drift_hz));
    depth = displaced(here, amplitude_mm * noise, amplitude_px * noise);
}
