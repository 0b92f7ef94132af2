#version 330 core
// tof_taps: what the pixels measure of the light: three taps a frequency, with noise, saturation
// and companding, put together again to a phasor a frequency.
// Noise: Var = 1.755 + 0.0166 A, A the tap's amplitude; fits the phase noise that Jaremo Lawin,
// Forssen and Ovren (ECCV 2016) measured on a Kinect V2 within 7 % rms.
#include "lib/random.glsl"
#include "lib/layers.glsl"
#include "lib/tof.glsl"
#include "lib/taps.glsl"

uniform float psf_sigma_px = 0.5;       //@ [0, 0.8]   px  standard deviation of the optical blur, beside the pixel's own area
uniform float read_variance = 1.755;    //@ [0, 1e4]   LSB^2 variance of a tap without light
uniform float shot_variance = 0.0166;   //@ [0, 10]    LSB  variance of a tap for one LSB of light
uniform float ambient_lsb = 0.0;        //@ [0, 1e5]   LSB light that is not the sensor's own: cancels, but for its noise
uniform float saturation_lsb = 16320.0; //@ [1, 16320] LSB taps beyond this are lost; 16320 is the code's end
uniform bool companding = true;         //@            1   whether taps are rounded to 11 bits
uniform bool dead_border = true;        //@            1   whether the first and the last column are not read out

uniform sampler2D u_light_a;
uniform sampler2D u_light_b;
uniform uint u_seed;
uniform vec2 u_frame_size_px;

const float COUNTS_PER_AMPLITUDE = 16.0; // libfreenect2's ab_output_multiplier

out vec4 phasor_a; // as light_a
out vec4 phasor_b; // third frequency; infrared counts; 2: saturated

// Taps of one frequency (0, 1, 2) to its phasor, in units of amplitude. saturated becomes true.
vec2 measured(vec2 light, float variance, int frequency, ivec2 pixel, inout bool saturated) {
    float multiplier = CONTRAST_MULTIPLIER[frequency];
    uvec4 bits = random_bits(pixel, u_seed, uint(frequency));
    vec2 first = normal_pair(bits.xy);
    vec3 noise = vec3(first, normal_pair(bits.zw).x);
    vec3 taps = (light.x * TAP_COS - light.y * TAP_SIN) / multiplier + sqrt(variance) * noise;
    for (int i = 0; i < 3; i++) {
        saturated = saturated || abs(taps[i]) > saturation_lsb;
        if (companding) taps[i] = companded(taps[i]);
    }
    return multiplier * (2.0 / 3.0) * vec2(dot(taps, TAP_COS), -dot(taps, TAP_SIN));
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    // Blur: three weights along each axis with the variance of the Gaussian.
    float side = 0.5 * psf_sigma_px * psf_sigma_px;
    vec3 weights = vec3(side, 1.0 - 2.0 * side, side);
    vec4 a = vec4(0.0), b = vec4(0.0);
    for (int y = 0; y < 3; y++) {
        for (int x = 0; x < 3; x++) {
            float weight = weights[x] * weights[y];
            a += weight * fetch_all(u_light_a, pixel + ivec2(x, y) - 1);
            b += weight * fetch_all(u_light_b, pixel + ivec2(x, y) - 1);
        }
    }
    bool saturated = false;
    vec3 variance = read_variance + shot_variance * (b.z / CONTRAST_MULTIPLIER + ambient_lsb);
    vec2 first = measured(a.xy, variance.x, 0, pixel, saturated);
    vec2 second = measured(a.zw, variance.y, 1, pixel, saturated);
    vec2 third = measured(b.xy, variance.z, 2, pixel, saturated);
    float mean = (length(first) + length(second) + length(third)) / 3.0;
    float infrared = saturated ? 65535.0 : min(COUNTS_PER_AMPLITUDE * mean, 65535.0);
    bool dead = dead_border && (pixel.x == 0 || pixel.x == int(u_frame_size_px.x) - 1);
    phasor_a = dead || saturated ? vec4(0.0) : vec4(first, second);
    phasor_b = dead ? vec4(0.0) : vec4(saturated ? vec2(0.0) : third, infrared, saturated ? 2.0 : 0.0);
}
