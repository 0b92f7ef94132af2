#version 330 core
// tof_light: the light of each pixel as phasors, one a frequency: amplitude and phase.
// Amplitude: Lambert's law and the inverse square of the way from the emitter; phase: half the way
// from the emitter over the surface to the camera. A pixel that sees one smooth surface takes its
// centre; one at an edge adds up the phasors of its samples, so that mixed pixels are what physics
// makes of them and not a blend of depths.
#include "lib/tof.glsl"
#include "lib/loops.glsl"

uniform float gain = 391.0;        //@ [0, 1e6]   1  amplitude of a white wall at 1 m: fit of libfreenect2's units to Fankhauser's curve
uniform float vignetting = 4.0;    //@ [0, 16]    1  power of the cosine to the axis by which a lens darkens; 4 for a simple one
uniform float offset_mm = 0.0;     //@ [-50, 50]  mm error of a device that is the same everywhere (iai_kinect2: up to 24)
uniform float subsurface_mm = 0.0; //@ [0, 20]    mm delay in what is lit; skin by diffusion theory about 7
uniform float harmonic_2 = 0.01;   //@ [0, 0.2]   1  second harmonic of the correlation: wiggling with 3 periods a half wave
uniform float harmonic_5 = 0.003;  //@ [0, 0.2]   1  fifth harmonic: with 6 periods a half wave
uniform float smooth_mm = 0.05;    //@ [0, 100]   mm error of the depth up to which a pixel's centre stands for its samples; 0: never

uniform sampler2D u_clean;
uniform sampler2D u_lit;
uniform sampler2D u_uneven;
uniform sampler2D u_fine_clean;
uniform sampler2D u_fine_normal; // and in w the albedo
uniform sampler2D u_fine_rays;
uniform vec3 u_emitter_m;
uniform int u_supersample;

out vec4 light_a; // real and imaginary part at the first and the second frequency
out vec4 light_b; // at the third; the light itself; unused

// Adds the phasors of a surface element, if there is one (z > 0).
void add(float z, vec4 shape, vec2 ray, float light, inout vec4 sum_a, inout vec4 sum_b) {
    vec3 direction = vec3(ray, 1.0);
    float stretch = length(direction);
    vec3 from_emitter = z * direction - u_emitter_m;
    float way = length(from_emitter);
    float facing = max(-dot(shape.xyz, from_emitter) / way, 0.0);
    float dimmed = light * facing / (way * way) * pow(stretch, -vignetting);
    float amplitude = z > 0.0 ? gain * shape.w * dimmed : 0.0;
    float distance_m = 0.5 * (z * stretch + way) + 0.001 * (offset_mm + subsurface_mm);
    vec3 angle = TWO_PI * fract(cycles(distance_m));
    vec3 c = cos(angle), s = sin(angle);
    // Three taps see a second harmonic as exp(-2 i a) and a fifth as exp(-5 i a).
    vec3 c2 = c * c - s * s, s2 = 2.0 * s * c;
    vec3 c4 = c2 * c2 - s2 * s2, s4 = 2.0 * s2 * c2;
    vec3 c5 = c4 * c - s4 * s, s5 = s4 * c + c4 * s;
    vec3 real = amplitude * (c + harmonic_2 * c2 + harmonic_5 * c5);
    vec3 imaginary = amplitude * (s - harmonic_2 * s2 - harmonic_5 * s5);
    sum_a += vec4(real.x, imaginary.x, real.y, imaginary.y);
    sum_b += vec4(real.z, imaginary.z, amplitude, 0.0);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 sum_a = vec4(0.0), sum_b = vec4(0.0);
    bool mixed = u_supersample > 1 && texelFetch(u_uneven, pixel, 0).r > 0.001 * smooth_mm;
    int side = u_supersample, samples = mixed ? side * side : 1;
    float share = 1.0 / float(samples);
    int k = 0;
    do { // an even pixel's only sample is the middle one
        ivec2 at = pixel * side + (mixed ? ivec2(k % side, k / side) : ivec2(side / 2));
        float z = texelFetch(u_fine_clean, at, 0).r;
        // Light changes slowly on a surface: a sample takes that of the pixel around whose depth is
        // nearest to its own.
        ivec2 alike = pixel;
        float nearest = 1e5;
        int i = mixed ? 0 : 8;
        do {
            ivec2 beside = pixel + (mixed ? ivec2(i % 3, i / 3) - 1 : ivec2(0));
            float there = texelFetch(u_clean, clamp(beside, ivec2(0), textureSize(u_clean, 0) - 1), 0).r;
            float apart = there > 0.0 ? abs(there - z) : 1e5;
            alike = apart < nearest ? beside : alike;
            nearest = min(nearest, apart);
        } while (++i < 9);
        float lit = nearest < 1e5 ? texelFetch(u_lit, alike, 0).r : 1.0;
        vec4 shape = texelFetch(u_fine_normal, at, 0);
        add(z, shape, texelFetch(u_fine_rays, at, 0).rg, share * lit, sum_a, sum_b);
    } while (++k < samples);
    light_a = sum_a;
    light_b = sum_b;
}
