#version 330 core
// infrared: computes the returned light: Lambert's law, inverse square of the distance.

uniform float gain_counts = 30300.0; //@ [0, 65535] counts infrared of white paper at 1 m, facing the sensor; measured on real frames, as in tof_light
uniform float ambient_counts = 0.0;  //@ [0, 65535] counts ambient light

uniform sampler2D u_clean;
uniform sampler2D u_normal;
uniform sampler2D u_albedo;
uniform sampler2D u_lit;
uniform sampler2D u_rays;

out float infrared;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float depth = texelFetch(u_clean, pixel, 0).r;
    infrared = ambient_counts;
    if (depth <= 0.0) return;
    vec3 ray = vec3(texelFetch(u_rays, pixel, 0).rg, 1.0);
    float facing = max(-dot(texelFetch(u_normal, pixel, 0).xyz, normalize(ray)), 0.0);
    float distance_squared = dot(ray, ray) * depth * depth;
    float light = gain_counts * texelFetch(u_albedo, pixel, 0).r * facing / distance_squared;
    infrared += light * texelFetch(u_lit, pixel, 0).r;
}
