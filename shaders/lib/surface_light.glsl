// surface_light: amplitude, distance and phasors of the light that a surface element returns.
#include "lib/tof.glsl"

uniform float gain = 391.0;        //@ [0, 1e6]   1  amplitude of a white wall at 1 m; fit of libfreenect2's units to Fankhauser's curve
uniform float vignetting = 4.0;    //@ [0, 16]    1  light falls with this power of the cosine to the axis; 4 for a simple lens
uniform float offset_mm = 0.0;     //@ [-50, 50]  mm constant depth error of a device (iai_kinect2: up to 24)
uniform float subsurface_mm = 0.0; //@ [0, 20]    mm delay within the lit material; skin by diffusion theory about 7
uniform float harmonic_2 = 0.01;   //@ [0, 0.2]   1  second harmonic of the correlation: wiggling error with 3 periods per half wave
uniform float harmonic_5 = 0.003;  //@ [0, 0.2]   1  fifth harmonic: 6 periods per half wave

// Amplitude by Lambert's law and the inverse square of the distance to the emitter (0 without a
// surface), and half the length, m, of the path from the emitter over the surface to the camera.
// z: depth, m; shape: normal and albedo; light: the share of the emitters' light that arrives.
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

// Phasors of light of amplitude 1 from a distance, per frequency.
void correlate(float distance_m, out vec3 real, out vec3 imaginary) {
    vec3 angle = TWO_PI * fract(cycles(distance_m));
    vec3 c = cos(angle), s = sin(angle);
    // Three taps measure a second harmonic as exp(-2 i a) and a fifth as exp(-5 i a).
    vec3 c2 = c * c - s * s, s2 = 2.0 * s * c;
    vec3 c4 = c2 * c2 - s2 * s2, s4 = 2.0 * s2 * c2;
    vec3 c5 = c4 * c - s4 * s, s5 = s4 * c + c4 * s;
    real = c + harmonic_2 * c2 + harmonic_5 * c5;
    imaginary = s - harmonic_2 * s2 - harmonic_5 * s5;
}
