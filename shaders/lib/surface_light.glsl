// surface_light: how much light comes back from a surface element, from how far, and what the
// correlation with the emitter's modulation makes of it.
#include "lib/tof.glsl"

uniform float gain = 391.0;        //@ [0, 1e6]   1  amplitude of a white wall at 1 m: fit of libfreenect2's units to Fankhauser's curve
uniform float vignetting = 4.0;    //@ [0, 16]    1  power of the cosine to the axis by which a lens darkens; 4 for a simple one
uniform float offset_mm = 0.0;     //@ [-50, 50]  mm error of a device that is the same everywhere (iai_kinect2: up to 24)
uniform float subsurface_mm = 0.0; //@ [0, 20]    mm delay in what is lit; skin by diffusion theory about 7
uniform float harmonic_2 = 0.01;   //@ [0, 0.2]   1  second harmonic of the correlation: wiggling with 3 periods a half wave
uniform float harmonic_5 = 0.003;  //@ [0, 0.2]   1  fifth harmonic: with 6 periods a half wave

// Amplitude (0 where there is no surface), by Lambert's law and the inverse square of the way from
// the emitter; and half the way from there over the surface to the camera, m.
// shape: normal and albedo; light: the share of it that gets there.
vec2 surface_light(float z, vec4 shape, vec2 ray, float light) {
    vec3 direction = vec3(ray, 1.0);
    float stretch = length(direction);
    vec3 from_emitter = z * direction - u_emitter_m;
    float way = length(from_emitter);
    float facing = max(-dot(shape.xyz, from_emitter) / way, 0.0);
    float dimmed = light * facing / (way * way) * pow(stretch, -vignetting);
    float amplitude = z > 0.0 ? gain * shape.w * dimmed : 0.0;
    return vec2(amplitude, 0.5 * (z * stretch + way) + 0.001 * (offset_mm + subsurface_mm));
}

// The phasors of light of amplitude 1 from a distance.
void correlate(float distance_m, out vec3 real, out vec3 imaginary) {
    vec3 angle = TWO_PI * fract(cycles(distance_m));
    vec3 c = cos(angle), s = sin(angle);
    // Three taps see a second harmonic as exp(-2 i a) and a fifth as exp(-5 i a).
    vec3 c2 = c * c - s * s, s2 = 2.0 * s * c;
    vec3 c4 = c2 * c2 - s2 * s2, s4 = 2.0 * s2 * c2;
    vec3 c5 = c4 * c - s4 * s, s5 = s4 * c + c4 * s;
    real = c + harmonic_2 * c2 + harmonic_5 * c5;
    imaginary = s - harmonic_2 * s2 - harmonic_5 * s5;
}
