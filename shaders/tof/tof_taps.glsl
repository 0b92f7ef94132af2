#version 330 core
// tof_taps: measures three taps per frequency, with noise, saturation and companding.
// It combines the taps into one phasor per frequency.
// Noise: real frames have sigma^2 = 1.05^2 + (4600 / infrared)^2 mm^2 after the decoder's 3x3 filter.
// A tap's sigma moves the filtered depth by 1132 / infrared mm per LSB, so that a tap has 4.06 LSB.
// Jaremo Lawin, Forssen and Ovren (ECCV 2016) measured phase noise at amplitudes of 20 to 100; read
// as unfiltered phases it gives a variance of 1.755 + 0.0166 A. It was measured after the filter,
// which divides the variance by 9: 15.8 + 0.15 A. Both agree on the variance without light; the
// growth with light is smaller here, because the real frames show none.
// Optics: a narrow core, a halo, and haze: light that the lens scatters over a neighbourhood. Measured
// at edges of real frames: sigma 0.22 px, 15 % in a halo of 1.2 px; 2 % of haze in shadows.
// The halo's light arrives late: dark print beside white paper is measured up to 12 mm too far, most
// so 1.5 to 2 px from the edge, and the paper beside it 0.7 mm too near. Why is not known: charge that
// diffuses between pixels and reflections within the lens would both be late. A camera's calibration
// holds on even surfaces, so that the mean delay is taken off.
//@ sparse
#include "lib/random.glsl"
#include "lib/tof.glsl"
#include "lib/taps.glsl"

uniform float psf_sigma_px = 0.22;      //@ [0, 0.8]   px  standard deviation of the optical blur's core, without the pixel's area
uniform float halo = 0.10;              //@ [0, 0.5]   1   share of the light in a halo of 1.2 px; measured: 0.15, or none and a core of 0.33 px
uniform float halo_delay_mm = 0.0;      //@ [0, 500]   mm  half of the way by which the halo's light is late; kinect-v2.toml has the measured value
uniform float haze = 0.02;              //@ [0, 0.2]   1   share of the light scattered to 4 to 7 px, which stands for scattering to all distances; measured: shadows hold half of it, 0.012 to 0.008 of the foreground's light, 2 to 7 px beside it
uniform float read_variance = 16.5;     //@ [0, 1e4]   LSB^2 variance of a tap without light; measured, see above
uniform float shot_variance = 0.0166;   //@ [0, 10]    LSB  variance of a tap for one LSB of light; chosen: the law above within 5 %
uniform float ambient_lsb = 0.0;        //@ [0, 1e5]   LSB ambient light: it cancels, except for its noise
uniform float daylight = 0.0;           //@ [0, 2; 0, 1] W/m^2/nm irradiance of daylight on the scene around 850 nm; scene.daylight sets it
// Daylight is the same in all taps and cancels; its noise stays, and the shorter the pixels' shutters, the less light
// of the camera is left: relative noise grows with daylight. Fankhauser et al. (ICAR 2015) measured 32 mm at 1 m in direct sun.
uniform float daylight_lsb = 650.0;     //@ [0, 1e5]   LSB standard deviation of a tap for a daylight of 1 W/m^2/nm; derived: 1132 / infrared mm per LSB, a target of albedo 0.7 and a sun of 0.97 W/m^2/nm
uniform float saturation_lsb = 3600.0;  //@ [1, 16320] LSB taps beyond this saturate; measured: paper facing the camera is lost to 57 % and 87 % at 0.64 m, to 0 and 2 % at 0.73 to 0.78 m
uniform bool companding = true;         //@            1   whether taps are rounded to 11 bits
uniform bool dead_border = true;        //@            1   whether the first and last columns are not read out

uniform sampler2D u_light_a;
uniform sampler2D u_light_b;
uniform sampler2D u_clean;
uniform uint u_seed;
uniform vec2 u_frame_size_px;

const float COUNTS_PER_AMPLITUDE = 16.0; // libfreenect2's ab_output_multiplier

// Weights per axis of a Gaussian of 1.2 px within 3x3; four pixels at a distance of 2 have the rest.
const float HALO_MIDDLE = 0.332485, HALO_SIDE = 0.234939, HALO_OUTER = 0.0891;

out vec4 phasor_a; // as light_a
out vec4 phasor_b; // third frequency; infrared counts; flags, 2: saturated

// Turns phasors by angles, given as cosines and sines per frequency.
void turn(inout vec4 a, inout vec4 b, vec3 c, vec3 s) {
    a = vec4(a.x * c.x - a.y * s.x, a.x * s.x + a.y * c.x, a.z * c.y - a.w * s.y, a.z * s.y + a.w * c.y);
    b.xy = vec2(b.x * c.z - b.y * s.z, b.x * s.z + b.y * c.z);
}

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_light_a, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    // Core: three weights per axis with the variance of the Gaussian. Clamped at the frame.
    float side = 0.5 * psf_sigma_px * psf_sigma_px, middle = 1.0 - 2.0 * side;
    float core = 1.0 - halo - haze;
    vec2 texel = 1.0 / vec2(textureSize(u_light_a, 0));
    vec4 a = vec4(0.0), b = vec4(0.0), late_a = vec4(0.0), late_b = vec4(0.0), haze_a = vec4(0.0), haze_b = vec4(0.0);
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            vec2 at = (gl_FragCoord.xy + vec2(x, y)) * texel;
            float sharp = core * (x == 0 ? middle : side) * (y == 0 ? middle : side);
            float soft = halo * (x == 0 ? HALO_MIDDLE : HALO_SIDE) * (y == 0 ? HALO_MIDDLE : HALO_SIDE);
            vec4 light_a = textureLod(u_light_a, at, 0.0), light_b = textureLod(u_light_b, at, 0.0);
            a += sharp * light_a;
            b += sharp * light_b;
            late_a += soft * light_a;
            late_b += soft * light_b;
        }
    }
    bool beside_light = b.z + late_b.z > 0.0;
    for (int k = 0; k < 4; k++) {
        float s = float(k & 2) - 1.0, t = float((k & 1) * 2) - 1.0;
        vec2 near = (gl_FragCoord.xy + 2.0 * s * vec2(1 - (k & 1), k & 1)) * texel;
        vec2 away = (gl_FragCoord.xy + 4.0 * vec2(s, t)) * texel;
        late_a += HALO_OUTER * halo * textureLod(u_light_a, near, 0.0);
        late_b += HALO_OUTER * halo * textureLod(u_light_b, near, 0.0);
        haze_a += 0.25 * haze * textureLod(u_light_a, away, 0.0);
        haze_b += 0.25 * haze * textureLod(u_light_b, away, 0.0);
    }
    vec3 later = TWO_PI * cycles(0.001 * halo_delay_mm), cosine = cos(later), sine = sin(later);
    turn(late_a, late_b, cosine, sine);
    a += late_a;
    b += late_b;
    // The phase that both have together on an even surface is taken off.
    vec3 real_part = core + halo * cosine, imaginary_part = halo * sine;
    vec3 size = sqrt(real_part * real_part + imaginary_part * imaginary_part);
    turn(a, b, real_part / size, -imaginary_part / size);
    a += haze_a;
    b += haze_b;
    // Pixels without surface and light measure nothing: noise must not depend on a frame's window.
    bool seen = beside_light || textureLod(u_clean, here, 0.0).r > 0.0;
    bool dead = dead_border && (pixel.x == 0 || pixel.x == int(u_frame_size_px.x) - 1);
    vec3 light_real = vec3(a.xz, b.x) / CONTRAST_MULTIPLIER;
    vec3 light_imaginary = vec3(a.yw, b.y) / CONTRAST_MULTIPLIER;
    vec3 sigma = sqrt(read_variance + shot_variance * (b.z / CONTRAST_MULTIPLIER + ambient_lsb)
        + (daylight * daylight_lsb) * (daylight * daylight_lsb));
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
