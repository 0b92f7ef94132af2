#version 330 core
// tof_taps: what the pixels measure of the light: three taps a frequency, with noise, saturation
// and companding, put together again to a phasor a frequency.
// Noise: Var = 1.755 + 0.0166 A, A the tap's amplitude; fits the phase noise that Jaremo Lawin,
// Forssen and Ovren (ECCV 2016) measured on a Kinect V2 within 7 % rms.
//@ sparse
#include "lib/random.glsl"
#include "lib/tof.glsl"
#include "lib/taps.glsl"
#include "lib/loops.glsl"

uniform float psf_sigma_px = 0.5;       //@ [0, 0.8]   px  standard deviation of the optical blur, beside the pixel's own area
uniform float read_variance = 1.755;    //@ [0, 1e4]   LSB^2 variance of a tap without light
uniform float shot_variance = 0.0166;   //@ [0, 10]    LSB  variance of a tap for one LSB of light
uniform float ambient_lsb = 0.0;        //@ [0, 1e5]   LSB light that is not the sensor's own: cancels, but for its noise
uniform float saturation_lsb = 16320.0; //@ [1, 16320] LSB taps beyond this are lost; 16320 is the code's end
uniform bool companding = true;         //@            1   whether taps are rounded to 11 bits
uniform bool dead_border = true;        //@            1   whether the first and the last column are not read out

uniform sampler2D u_light_a;
uniform sampler2D u_light_b;
uniform sampler2D u_clean;
uniform uint u_seed;
uniform vec2 u_frame_size_px;

const float COUNTS_PER_AMPLITUDE = 16.0; // libfreenect2's ab_output_multiplier

out vec4 phasor_a; // as light_a
out vec4 phasor_b; // third frequency; infrared counts; 2: saturated

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(u_light_a, 0) - 1;
    // Blur: three weights along each axis with the variance of the Gaussian.
    float side = 0.5 * psf_sigma_px * psf_sigma_px, middle = 1.0 - 2.0 * side;
    vec4 a = vec4(0.0), b = vec4(0.0);
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 at = clamp(pixel + ivec2(x, y), ivec2(0), last); // beyond the frame as at its border
            float weight = (x == 0 ? middle : side) * (y == 0 ? middle : side);
            a += weight * texelFetch(u_light_a, at, 0);
            b += weight * texelFetch(u_light_b, at, 0);
        }
    }
    vec3 variance = read_variance + shot_variance * (b.z / CONTRAST_MULTIPLIER + ambient_lsb);
    vec3 sigma = sqrt(variance);
    // Where the camera sees nothing, nothing is measured: a frame's window must not decide on noise.
    bool seen = b.z > 0.0 || texelFetch(u_clean, pixel, 0).r > 0.0;
    bool dead = dead_border && (pixel.x == 0 || pixel.x == int(u_frame_size_px.x) - 1);
    bool saturated = false;
    vec3 real = vec3(0.0), imaginary = vec3(0.0);
    int frequency = seen ? 0 : 2;
    do {
        vec3 chosen = vec3(frequency == 0, frequency == 1, frequency == 2);
        float multiplier = dot(chosen, CONTRAST_MULTIPLIER);
        vec2 light = chosen.x * a.xy + chosen.y * a.zw + chosen.z * b.xy;
        uvec4 bits = random_bits(pixel, u_seed, uint(frequency));
        vec3 noise = vec3(normal_pair(bits.xy), normal_pair(bits.zw).x);
        vec3 taps = (light.x * TAP_COS - light.y * TAP_SIN) / multiplier + dot(chosen, sigma) * noise;
        saturated = saturated || any(greaterThan(abs(taps), vec3(saturation_lsb)));
        taps = companding ? companded(taps) : taps;
        real += chosen * (multiplier * 2.0 / 3.0) * dot(taps, TAP_COS);
        imaginary -= chosen * (multiplier * 2.0 / 3.0) * dot(taps, TAP_SIN);
    } while (++frequency < 3);
    vec3 amplitude = sqrt(real * real + imaginary * imaginary);
    float mean = (amplitude.x + amplitude.y + amplitude.z) / 3.0;
    float infrared = saturated ? 65535.0 : min(COUNTS_PER_AMPLITUDE * mean, 65535.0);
    bool read = seen && !dead, used = read && !saturated;
    phasor_a = used ? vec4(real.x, imaginary.x, real.y, imaginary.y) : vec4(0.0);
    phasor_b = vec4(used ? vec2(real.z, imaginary.z) : vec2(0.0),
        read ? infrared : 0.0, read && saturated ? 2.0 : 0.0);
}
