// phasor_mean: averages a pixel's phasors with its neighbours'; those of another phase count less.
// The three components of a vec3 are the three frequencies.

// A pixel's own phasors, and sums over its neighbours.
struct PhasorMean {
    vec3 own_real, own_imaginary;
    vec3 unit;                     // 1 / amplitude of the pixel's own phasors
    vec3 bright;                   // 0 for a pixel that is too dark itself: it takes the plain mean
    vec3 least;                    // least squared amplitude of a neighbour that counts
    vec3 real, imaginary, weights; // weighted sums
    vec3 apart;                    // sum of phase distances: 0 for the same phase, 1 for the opposite one
    vec3 near;                     // number of neighbours that count
};

// Starts a mean without any neighbour. own_a, own_b: layers phasor_a and phasor_b of the pixel.
PhasorMean phasor_mean(vec4 own_a, vec4 own_b, float min_amplitude) {
    vec3 real = vec3(own_a.xz, own_b.x), imaginary = vec3(own_a.yw, own_b.y), none = vec3(0.0);
    vec3 norm = real * real + imaginary * imaginary;
    vec3 bright = step(min_amplitude * min_amplitude, norm);
    return PhasorMean(real, imaginary, inversesqrt(max(norm, 1e-20)), bright,
        bright * min_amplitude * min_amplitude, none, none, none, none, vec3(1e-6));
}

// Adds a neighbour with phasors a, b and the weight exp(exponent - sharpness * phase distance) * weight.
void add_neighbour(inout PhasorMean mean, vec4 a, vec4 b, float weight, float exponent, float sharpness) {
    vec3 real = vec3(a.xz, b.x), imaginary = vec3(a.yw, b.y);
    vec3 norm = real * real + imaginary * imaginary;
    vec3 alike = (mean.own_real * real + mean.own_imaginary * imaginary)
        * mean.unit * inversesqrt(max(norm, 1e-20));
    vec3 away = 0.5 - 0.5 * alike;
    vec3 counts = step(mean.least, norm);
    vec3 weights = counts * weight * exp(exponent - sharpness * mean.bright * away);
    mean.apart += counts * away;
    mean.near += counts;
    mean.real += weights * real;
    mean.imaginary += weights * imaginary;
    mean.weights += weights;
}

// Replaces the phasors of the layers a and b by their mean, unless kept, and adds 1 to the flags of an edge.
void set_phasors(PhasorMean mean, bool kept, bool edge, inout vec4 a, inout vec4 b) {
    vec3 real = kept ? mean.own_real : mean.real / mean.weights;
    vec3 imaginary = kept ? mean.own_imaginary : mean.imaginary / mean.weights;
    a = vec4(real.x, imaginary.x, real.y, imaginary.y);
    b = vec4(real.z, imaginary.z, b.z, b.w + (edge ? 1.0 : 0.0));
}
