#version 330 core
// tof_fast: simulates the time-of-flight sensor in one step, for very large data sets.
// On even surfaces the noise is drawn with the statistics of the chain tof_light to tof_floor. Only
// beside depth steps phasors are summed up, filtered and unwrapped. One sample per pixel and no taps:
// no companding, no halo, no haze.
//@ sparse
#include "lib/surface_light.glsl"
#include "lib/unwrap.glsl"
#include "lib/correlated_noise.glsl"
#include "lib/floor.glsl"
#include "lib/depth.glsl"

uniform float step_mm = 20.0;         //@ [0, 1000] mm  range of depth in 3x3 beyond which phasors are summed up
uniform float read_variance = 16.5;   //@ [0, 1e4]  LSB^2 variance of a tap without light, as in tof_taps
uniform float shot_variance = 0.0166; //@ [0, 10]   LSB variance of a tap for one LSB of light, as in tof_taps
uniform float saturation_lsb = 3915.0;//@ [1, 16320] LSB amplitudes beyond this saturate; tof_taps loses white surfaces at the same distance
uniform float sharpness = 5.0;        //@ [0, 100]  1   decay of the bilateral filter's weight, as in tof_bilateral
uniform float max_edge = 2.5;         //@ [0, 8]    1   sum of the neighbours' phase distances that marks a pixel, as in tof_bilateral

uniform sampler2D u_clean;
uniform sampler2D u_normal;
uniform sampler2D u_rays;
uniform sampler2D u_lit;
uniform uint u_seed;

out float depth;
out float reason;
out float infrared;
out vec2 decoded; // as in tof_unwrap
#ifdef EXPECTED
out float expected;
#endif

// Amplitude and phasors of a pixel that sees one surface.
float seen(ivec2 pixel, Harmonics harmonics, out vec3 real, out vec3 imaginary) {
    ivec2 at = clamp(pixel, ivec2(0), textureSize(u_clean, 0) - 1);
    vec2 light = surface_light(texelFetch(u_clean, at, 0).r, texelFetch(u_normal, at, 0),
        texelFetch(u_rays, at, 0).rg, texelFetch(u_lit, at, 0).r);
    correlate(light.y, harmonics, real, imaginary);
    real = light.x > 0.0 ? real : vec3(0.0);
    imaginary = light.x > 0.0 ? imaginary : vec3(0.0);
    return light.x;
}

// Standard deviation of the real and imaginary parts after the filter.
vec3 part_sigma(float amplitude) {
    vec3 m = CONTRAST_MULTIPLIER;
    vec3 variance = 2.0 / 3.0 * m * m * (read_variance + shot_variance * amplitude / m);
    return sqrt(variance) / KERNEL_UNIT;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(u_clean, 0) - 1;
    float clean = texelFetch(u_clean, pixel, 0).r, lit = texelFetch(u_lit, pixel, 0).r;
    vec2 ray = texelFetch(u_rays, pixel, 0).rg;
    float low = clean, high = clean;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            float z = texelFetch(u_clean, clamp(pixel + ivec2(x, y), ivec2(0), last), 0).r;
            low = min(low, z);
            high = max(high, z);
        }
    }
    bool beside_step = high - low > 0.001 * step_mm;
    // Nine iterations compute the blur of lens and pixel area (variance 1/5 px^2, weights 1/10, 4/5,
    // 1/10), eight more the bilateral filter, in which each neighbour sees one surface. On an even
    // surface a single iteration computes the pixel's own light.
    vec3 mixed_real = vec3(0.0), mixed_imaginary = vec3(0.0), unit = vec3(0.0);
    vec3 sum_real = vec3(0.0), sum_imaginary = vec3(0.0), total = vec3(1e-6), apart = vec3(0.0);
    float mixed_amplitude = 0.0;
    Harmonics harmonics = device_harmonics();
    int k = beside_step ? 0 : 4;
    do {
        bool blurs = k < 9;
        int place = blurs ? k : k - 9 + int(k > 12); // the second time without the centre
        ivec2 offset = ivec2(place % 3, place / 3) - 1;
        vec3 r, i;
        float a = seen(pixel + offset, harmonics, r, i);
        float weight = (offset.x == 0 ? 0.8 : 0.1) * (offset.y == 0 ? 0.8 : 0.1);
        float light = blurs ? a * (beside_step ? weight : 1.0) : 0.0;
        mixed_real += light * r;
        mixed_imaginary += light * i;
        mixed_amplitude += light;
        if (k == 8) { // the filter starts from the pixel itself
            vec3 norm = mixed_real * mixed_real + mixed_imaginary * mixed_imaginary;
            unit = inversesqrt(max(norm, 1e-20));
            sum_real = KERNEL_MIDDLE * mixed_real;
            sum_imaginary = KERNEL_MIDDLE * mixed_imaginary;
            total = vec3(KERNEL_MIDDLE);
        }
        bool bright = mixed_amplitude >= min_amplitude;
        vec3 away = 0.5 - 0.5 * (mixed_real * r + mixed_imaginary * i) * unit;
        float counts = !blurs && (a >= min_amplitude || !bright) ? 1.0 : 0.0;
        vec3 falls = counts * kernel(offset) * (bright ? exp(-1.442695 * sharpness * away) : vec3(1.0));
        apart += counts * away;
        sum_real += falls * a * r;
        sum_imaginary += falls * a * i;
        total += falls;
    } while (beside_step && ++k < 17);

    float amplitude = mixed_amplitude;
    vec3 sigma = part_sigma(amplitude);
    vec3 noise_real = vec3(0.0), noise_imaginary = vec3(0.0);
    int frequency = beside_step ? 2 : 0;
    do {
        vec3 chosen = vec3(frequency == 0, frequency == 1, frequency == 2);
        vec2 pair = normal_pair(random_bits(pixel, u_seed, uint(1 + frequency)).xy);
        noise_real += chosen * pair.x;
        noise_imaginary += chosen * pair.y;
    } while (--frequency >= 0);
    vec3 filtered_real = sum_real / total + sigma * noise_real;
    vec3 filtered_imaginary = sum_imaginary / total + sigma * noise_imaginary;
    // On an even surface noise is added at the end; here it only decides whether the pixel is too dark.
    float dimmed = amplitude + max(sigma.x, max(sigma.y, sigma.z)) * noise_real.x;
    float kept = dimmed < 1.1 * min_amplitude ? 0.0 : 1.0;
    vec3 real = beside_step ? filtered_real : kept * mixed_real;
    vec3 imaginary = beside_step ? filtered_imaginary : kept * mixed_imaginary;

    float sum;
    int fate;
    float distance_m = unwrapped(real, imaginary, sum, fate);
    float z = along_axis(distance_m, ray);
    bool nothing = mixed_amplitude <= 0.0 && clean <= 0.0;
    reason = nothing ? REASON_NO_SURFACE : reason_of(fate, z, clean, lit);
    if (amplitude > saturation_lsb) reason = REASON_SATURATED;
    bool valid = reason == REASON_VALID || reason == REASON_GROWN;

    vec3 phase_sigma = sigma / max(amplitude, 1.0); // rad
    float light_mm = beside_step ? 0.0 : 1000.0 * length(phase_sigma) / TWO_PI * HALF_WAVE_M_MHZ
        / dot(u_modulation_mhz, vec3(1.0)) / length(vec3(ray, 1.0)); // along z, not along the ray
    float variance = floor_variance(z, texelFetch(u_normal, pixel, 0).xyz, ray) + light_mm * light_mm;
    float noise = correlated_noise(pixel, u_seed);
    depth = valid ? moved_by_mm(z, sqrt(variance) * noise) : 0.0;
    infrared = min(16.0 * amplitude, 65535.0);
    bool edge = beside_step && max(apart.x, max(apart.y, apart.z)) >= max_edge;
    decoded = vec2(edge ? 0.0 : depth, sum);
#ifdef EXPECTED
    expected = expected_depth(clean, ray, harmonics);
#endif
}
