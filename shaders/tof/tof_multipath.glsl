#version 330 core
// tof_multipath: adds light that one other visible surface has reflected once.
// It bends concave corners outwards. Sample points around in the image represent the surroundings;
// surfaces that the camera does not see, and occlusion, are ignored. Off in the shipped sensors.
//@ sparse
#include "lib/surface_light.glsl"
#include "lib/loops.glsl"

uniform float strength = 1.0;  //@ [0, 10]   1  factor on the physical amount
uniform float radius_px = 48.0;//@ [2, 256]  px radius of the sample points
uniform int samples = 32;      //@ [1, 256]  1  number of sample points

uniform sampler2D u_clean;
uniform sampler2D u_normal; // w: albedo
uniform sampler2D u_rays;
uniform sampler2D u_light_a;
uniform sampler2D u_light_b;
uniform float u_focal_px;

const float PI = 3.14159265359;
const float GOLDEN_ANGLE = 2.39996322973; // Vogel's spiral: uniform over a disc

out vec4 light_a;
out vec4 light_b;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(u_clean, 0) - 1;
    light_a = texelFetch(u_light_a, pixel, 0);
    light_b = texelFetch(u_light_b, pixel, 0);
    float z = texelFetch(u_clean, pixel, 0).r;
    vec3 ray = vec3(texelFetch(u_rays, pixel, 0).rg, 1.0), here = z * ray;
    vec4 shape = texelFetch(u_normal, pixel, 0);
    // Area of the image that each point represents, px^2.
    float pixels = PI * radius_px * radius_px / float(samples);
    // Phases of this stage's own draw: for a few per cent of the light, a change below 0.1 mm.
    Harmonics harmonics = device_harmonics();
    int k = z > 0.0 ? 0 : samples - 1;
    do {
        float turn = GOLDEN_ANGLE * float(k), far = radius_px * sqrt((float(k) + 0.5) / float(samples));
        ivec2 at = pixel + ivec2(floor(far * vec2(cos(turn), sin(turn)) + 0.5));
        bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThanEqual(at, last));
        at = clamp(at, ivec2(0), last);
        float there_z = texelFetch(u_clean, at, 0).r;
        vec3 there_ray = vec3(texelFetch(u_rays, at, 0).rg, 1.0), there = there_z * there_ray;
        vec4 there_shape = texelFetch(u_normal, at, 0);
        float light = texelFetch(u_light_b, at, 0).z;
        vec3 way = there - here;
        float squared = dot(way, way), apart = sqrt(max(squared, 1e-12));
        float arriving = max(dot(shape.xyz, way), 0.0) / apart;
        float leaving = max(-dot(there_shape.xyz, way), 0.0) / apart;
        float area = pixels * there_z * there_z / (u_focal_px * u_focal_px)
            / max(-dot(there_shape.xyz, there_ray), 0.05);
        // A nearby area covers at most a half space.
        float share = arriving * leaving * area / (PI * squared + area);
        bool counts = inside && there_z > 0.0 && z > 0.0;
        float amplitude = counts ? strength * shape.w * light * share : 0.0;
        vec3 real, imaginary;
        correlate(0.5 * (length(there - u_emitter_m) + apart + length(here))
            + 0.001 * (offset_mm + subsurface_mm), harmonics, real, imaginary);
        light_a += amplitude * vec4(real.x, imaginary.x, real.y, imaginary.y);
        light_b += amplitude * vec4(real.z, imaginary.z, 1.0, 0.0);
    } while (++k < samples);
}
