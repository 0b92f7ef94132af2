// taps: how a tap's value is read out: saturation, and 11 bits with growing steps.

// Companding of the Kinect V2 (libfreenect2's lookup table): steps of 1 up to 256, then 128 steps
// in each doubling, up to 16320.
const float LARGEST_TAP = 16320.0;

float companded(float tap) {
    float size = min(abs(tap), LARGEST_TAP);
    int exponent = (floatBitsToInt(size) >> 23) - 127;
    float step = exp2(float(max(exponent - 7, 0)));
    return sign(tap) * min(floor(size / step + 0.5) * step, LARGEST_TAP);
}
