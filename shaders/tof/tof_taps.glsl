#version 330 core
// tof_taps: measures three taps per frequency, with noise, saturation and companding.
// It combines the taps into one phasor per frequency. Noise: Var = 1.755 + 0.0166 A, A the tap's
// amplitude; this fits the phase noise that Jaremo Lawin, Forssen and Ovren (ECCV 2016) measured on a
// Kinect V2 within 7 % rms.
//@ sparse
#include "lib/random.glsl"
#include "lib/tof.glsl"
#include "lib/taps.glsl"

uniform float psf_sigma_px = 0.5;       //@ [0, 0.8]   px  standard deviation of the optical blur, without the pixel's area
uniform float read_variance = 1.755;    //@ [0, 1e4]   LSB^2 variance of a tap without light
uniform float shot_variance = 0.0166;   //@ [0, 10]    LSB  variance of a tap for one LSB of light
uniform float ambient_lsb = 0.0;        //@ [0, 1e5]   LSB ambient light: it cancels, except for its noise
uniform float saturation_lsb = 16320.0; //@ [1, 16320] LSB taps beyond this saturate; 16320 is the largest code
uniform bool companding = true;         //@            1   whether taps are rounded to 11 bits
uniform bool dead_border = true;        //@            1   whether the first and last columns are not read out

uniform sampler2D u_light_a;
uniform sampler2D u_light_b;
uniform sampler2D u_clean;
uniform uint u_seed;
uniform vec2 u_frame_size_px;

const float COUNTS_PER_AMPLITUDE = 16.0; // libfreenect2's ab_output_multiplier

out vec4 phasor_a; // as light_a
out vec4 phasor_b; // third frequency; infrared counts; flags, 2: saturated

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_light_a, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    // Blur: three weights per axis with the variance of the Gaussian, clamped at the frame.
    float side = 0.5 * psf_sigma_px * psf_sigma_px, middle = 1.0 - 2.0 * side;
    vec2 texel = 1.0 / vec2(textureSize(u_light_a, 0));
    vec4 a = vec4(0.0), b = vec4(0.0);
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            vec2 at = (gl_FragCoord.xy + vec2(x, y)) * texel;
            float weight = (x == 0 ? middle : side) * (y == 0 ? middle : side);
            a += weight * textureLod(u_light_a, at, 0.0);
            b += weight * textureLod(u_light_b, at, 0.0);
        }
    }
    // Pixels without surface and light get no noise: it would depend on the frame's window.
    bool seen = b.z > 0.0 || textureLod(u_clean, here, 0.0).r > 0.0;
    bool dead = dead_border && (pixel.x == 0 || pixel.x == int(u_frame_size_px.x) - 1);
    vec3 light_real = vec3(a.xz, b.x) / CONTRAST_MULTIPLIER;
    vec3 light_imaginary = vec3(a.yw, b.y) / CONTRAST_MULTIPLIER;
    vec3 sigma = sqrt(read_variance + shot_variance * (b.z / CONTRAST_MULTIPLIER + ambient_lsb));
    vec3 noise[3]; // of each tap at the three frequencies
    for (int frequency = 0; frequency < 3; frequency++) {
        uvec4 bits = random_bits(pixel, u_seed, uint(frequency));
        vec2 pair = normal_pair(bits.xy);
        noise[0][frequency] = pair.x;
        noise[1][frequency] = pair.y;
        noise[2][frequency] = normal_pair(bits.zw).x;
    }
    bool saturated = false;
    vec3 real = vec3(0.0), imaginary = vec3(0.0);
    for (int tap = 0; tap < 3; tap++) {
        vec3 value = light_real * TAP_COS[tap] - light_imaginary * TAP_SIN[tap] + sigma * noise[tap];
        saturated = saturated || any(greaterThan(abs(value), vec3(saturation_lsb)));
        value = companding ? companded(value) : value;
        real += 2.0 / 3.0 * CONTRAST_MULTIPLIER * TAP_COS[tap] * value;
        imaginary -= 2.0 / 3.0 * CONTRAST_MULTIPLIER * TAP_SIN[tap] * value;
    }
    vec3 amplitude = sqrt(real * real + imaginary * imaginary);
    float mean = (amplitude.x + amplitude.y + amplitude.z) / 3.0;
    float infrared = saturated ? 65535.0 : min(COUNTS_PER_AMPLITUDE * mean, 65535.0);
    bool read = seen && !dead, used = read && !saturated;
    phasor_a = used ? vec4(real.x, imaginary.x, real.y, imaginary.y) : vec4(0.0);
    phasor_b = vec4(used ? vec2(real.z, imaginary.z) : vec2(0.0),
        read ? infrared : 0.0, read && saturated ? 2.0 : 0.0);
}
