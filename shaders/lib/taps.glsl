// taps: companding of a tap's value: 11 bits, with steps that grow with the value.

// Companding of the Kinect V2 (libfreenect2's lookup table): steps of 1 up to 256, then 128 steps
// per octave, up to 16320.
const float LARGEST_TAP = 16320.0;

vec3 companded(vec3 taps) {
    vec3 size = min(abs(taps), LARGEST_TAP);
    ivec3 exponent = (floatBitsToInt(size) >> 23) - 127; // floor(log2(size)), exactly
    vec3 step = intBitsToFloat((max(exponent - 7, 0) + 127) << 23);
    return sign(taps) * min(floor(size / step + 0.5) * step, LARGEST_TAP);
}
