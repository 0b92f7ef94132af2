// surface_light: amplitude, distance and phasors of the light that a surface element returns.
#include "lib/tof.glsl"
#include "lib/turns.glsl"
#include "lib/random.glsl"

uniform float gain = 1894.0;       //@ [0, 1e6]   1  amplitude of white paper at 1 m, facing the camera; measured: 1/16 of the infrared's 30,300 counts
uniform float flat_to = 0.435;     //@ [0, 3]     1  tangent of the angle to the axis up to which the light is even; fit to real infrared images of walls
uniform float fall_off = 0.155;    //@ [1e-3, 10] 1  beyond flat_to the light falls by a factor of e per this tangent; the same fit
uniform float tail = 0.07;         //@ [0, 1]     1  share of the light that does not fall; the same fit
uniform float vignetting = 0.0;    //@ [0, 16]    1  light falls further with this power of the cosine to the axis; 4 for a simple lens. The fit above holds all
uniform float indirect = 0.02;      //@ [0, 0.2]   1  share of an emitter's light that reaches a surface in its shadow by way of the room; measured: 0.04 to 0.05 on many ways; chosen so that as many pixels as in real shadows lie behind the wall
uniform float indirect_mm = 300.0; //@ [0, 5000]  mm half of what that way is longer; measured: a median of 270 behind the wall
uniform float offset_mm = 0.0;     //@ [-50, 50]  mm constant depth error of a device (iai_kinect2: up to 24)
uniform float subsurface_mm = 0.0; //@ [0, 20]    mm delay within the lit material; skin by diffusion theory about 7
uniform float harmonic_2 = 0.01;   //@ [-0.2, 0.2] 1 second harmonic of the correlation: wiggling error with 3 periods per half wave; size measured: 1.2 and 1.4 mm
uniform float harmonic_5 = 0.003;  //@ [-0.2, 0.2] 1 fifth harmonic: 6 periods per half wave; chosen
uniform float harmonic_2_phase_deg = 0.0;   //@ [-180, 180] deg phase of the second harmonic at the three frequencies
uniform float harmonic_5_phase_deg = 0.0;   //@ [-180, 180] deg phase of the fifth harmonic
uniform float harmonic_phase_spread = 1.0;  //@ [0, 1]      1   share of a full turn over which a device's own phases are drawn, per harmonic and frequency, around the two above; measured devices differ

uniform uint u_device_seed;

// Amplitude by Lambert's law and the inverse square of the distance to the emitter (0 without a
// surface), and half the length, m, of the path from the emitter over the surface to the camera.
// The light over the image: 44 real frames' infrared times distance^2 over cosine, median of the
// surfaces per ring, is 1 within 3 % to a tangent of 0.42, .87 at 0.46, .59 at 0.53, .23 at 0.71 and
// .11 at 0.93 (lens and emitter together); this profile meets it within .03. White paper alone, in 204
// frames, has .88, .61, .44, .27, .16 at 0.451, 0.479, 0.534, 0.588, 0.643. A profile with these makes
// the noise of surfaces beyond 210 px 1.4 times that of the 44 frames (this one: 1.1).
// z: depth, m; shape: normal and albedo; lit: the share of the emitters' light that arrives directly.
vec2 surface_light(float z, vec4 shape, vec2 ray, float lit) {
    vec3 direction = vec3(ray, 1.0);
    float stretch = length(direction);
    vec3 from_emitter = z * direction - u_emitter_m;
    float way = length(from_emitter);
    float facing = max(-dot(shape.xyz, from_emitter) / way, 0.0);
    float profile = tail + (1.0 - tail) * exp(min(flat_to - length(ray), 0.0) / fall_off);
    // In real shadows 4 to 10 % of the pixels have a depth, behind the wall: light on a longer way.
    float around = indirect * (1.0 - lit), light = lit + around;
    float detour = indirect_mm * around / max(light, 1e-6);
    float dimmed = light * facing / (way * way) * profile * pow(stretch, -vignetting);
    float amplitude = z > 0.0 ? gain * shape.w * dimmed : 0.0;
    return vec2(amplitude, 0.5 * (z * stretch + way) + 0.001 * (offset_mm + subsurface_mm + detour));
}

// The harmonics of a device, as complex numbers per frequency.
struct Harmonics {
    vec3 real_2, imaginary_2, real_5, imaginary_5;
};

Harmonics device_harmonics() {
    uint key = pcg_word(u_device_seed);
    vec3 turn_2 = vec3(uniform01(pcg_word(key)), uniform01(pcg_word(key + 1u)), uniform01(pcg_word(key + 2u)));
    vec3 turn_5 = vec3(uniform01(pcg_word(key + 3u)), uniform01(pcg_word(key + 4u)), uniform01(pcg_word(key + 5u)));
    vec3 phase_2 = TWO_PI * (harmonic_2_phase_deg / 360.0 + harmonic_phase_spread * (turn_2 - 0.5));
    vec3 phase_5 = TWO_PI * (harmonic_5_phase_deg / 360.0 + harmonic_phase_spread * (turn_5 - 0.5));
    return Harmonics(harmonic_2 * cos(phase_2), harmonic_2 * sin(phase_2),
        harmonic_5 * cos(phase_5), harmonic_5 * sin(phase_5));
}

// Phasors of light of amplitude 1 from a distance, per frequency.
void correlate(float distance_m, Harmonics h, out vec3 real, out vec3 imaginary) {
    vec3 angle = TWO_PI * fract(cycles(distance_m));
    vec3 c = cos(angle), s = sin(angle);
    // Three taps measure a second harmonic as exp(-2 i a) and a fifth as exp(-5 i a).
    vec3 c2 = c * c - s * s, s2 = 2.0 * s * c;
    vec3 c4 = c2 * c2 - s2 * s2, s4 = 2.0 * s2 * c2;
    vec3 c5 = c4 * c - s4 * s, s5 = s4 * c + c4 * s;
    real = c + h.real_2 * c2 + h.imaginary_2 * s2 + h.real_5 * c5 + h.imaginary_5 * s5;
    imaginary = s - h.real_2 * s2 + h.imaginary_2 * c2 - h.real_5 * s5 + h.imaginary_5 * c5;
}

// Depth, m, that the device measures of a lit surface without noise and blur: with its offset, its
// harmonics and the delay in the material, decoded as libfreenect2 does. 0 without a surface. Light
// by other ways (shadows, haze, bounces) depends on the scene and is not in it.
float expected_depth(float z, vec2 ray, Harmonics harmonics) {
    float distance_m = surface_light(z, vec4(0.0, 0.0, -1.0, 1.0), ray, 1.0).y;
    vec3 real, imaginary;
    correlate(distance_m, harmonics, real, imaginary);
    float found = distance_of(unwrapped_cycles(fract(atan(imaginary, real) / TWO_PI)));
    float decoded = along_axis(found, ray);
    // One wrong turn of one phase moves the distance by this much: beyond half of it, the decoder
    // took a wrong turn, or the phases repeat; then nothing is known of the error.
    float turn_m = HALF_WAVE_M_MHZ / dot(u_modulation_mhz, vec3(1.0));
    bool right = abs(found - distance_m) < 0.5 * turn_m && decoded > 0.0;
    return z > 0.0 ? (right ? decoded : z) : 0.0;
}
