#version 330 core
// capture: what one capture of a time-of-flight camera adds to the light of a frame that moves.
// The capture measures one tap of one frequency. The sum over the nine captures is the phasors that
// the taps of a frame at rest would give.
#include "lib/tof.glsl"

uniform int u_tap;       // 0 to 2
uniform int u_frequency; // 0 to 2
uniform sampler2D u_light_a;
uniform sampler2D u_light_b;

out vec4 light_a; // as tof_light's
out vec4 light_b;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 a = texelFetch(u_light_a, pixel, 0), b = texelFetch(u_light_b, pixel, 0);
    vec2 own = u_frequency == 0 ? a.xy : (u_frequency == 1 ? a.zw : b.xy);
    float value = own.x * TAP_COS[u_tap] - own.y * TAP_SIN[u_tap];
    vec2 part = 2.0 / 3.0 * value * vec2(TAP_COS[u_tap], -TAP_SIN[u_tap]);
    light_a = vec4(u_frequency == 0 ? part : vec2(0.0), u_frequency == 1 ? part : vec2(0.0));
    light_b = vec4(u_frequency == 2 ? part : vec2(0.0), b.z / 9.0, 0.0);
}
