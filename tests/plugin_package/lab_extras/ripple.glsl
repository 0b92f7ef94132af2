#version 330 core
// ripple: alternate columns are nearer and farther.
uniform float amplitude_mm = 20.0;  //@ [0, 50] mm half the difference
uniform sampler2D u_depth;
out float depth;
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    if (depth > 0.0) depth += 0.001 * amplitude_mm * (pixel.x % 2 == 0 ? 1.0 : -1.0);
}
