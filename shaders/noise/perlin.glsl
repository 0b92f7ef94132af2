#version 330 core
// perlin: adds Perlin noise, a sum of octaves, in depth or in disparity.
#include "lib/perlin.glsl"
#include "lib/field.glsl"
#include "lib/disparity.glsl"

uniform float amplitude_mm = 2.0;   //@ [0, 100]   mm amplitude in depth
uniform float amplitude_px = 0.0;   //@ [0, 5]     px amplitude in disparity (render_kinect: 0.4, BlenSor: 0.25)
uniform float lattice_x_px = 32.0;  //@ [1, 1024]  px width of a lattice cell of the first octave
uniform float lattice_y_px = 32.0;  //@ [1, 1024]  px height of a lattice cell of the first octave
uniform int octaves = 1;            //@ [1, 8]     1  number of octaves
uniform float persistence = 0.5;    //@ [0, 1]     1  amplitude of an octave over that of the previous one
uniform float lacunarity = 2.0;     //@ [1, 4]     1  frequency of an octave over that of the previous one
uniform float drift_hz = 0.0;       //@ [0, 120]   Hz lattice cells per second that a sequence moves through; 0: a new field per frame

uniform sampler2D u_depth;

out float depth;

void main() {
    float here = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r;
    uint seed = field_seed(drift_hz);
    vec3 at = field_position(vec2(lattice_x_px, lattice_y_px), drift_hz);
    if (drift_hz <= 0.0) at.z = 0.0; // a static field lies on a plane of nodes: half the work
    float sum = 0.0, weight = 1.0;
    // The loop does not start without depth: a software rasteriser skips work in loops only.
    for (int octave = 0; octave < octaves && here > 0.0; octave++) {
        sum += weight * perlin(at, seed + uint(octave));
        at *= lacunarity;
        weight *= persistence;
    }
    depth = displaced(here, amplitude_mm * sum, amplitude_px * sum);
}
