// imager_exposure: an imager's blur, its noise, and its counts.
#include "lib/random.glsl"
#include "lib/layers.glsl"

uniform float exposure = 1.0;            //@ [1e-3, 1000; 0.05, 20 log] 1 counts per count of light: exposure time and gain
uniform float longest_exposure = 4.0;    //@ [0, 1000; 0, 20] 1 automatic exposure: the face looks as bright as at 1 m, as far as this factor reaches; 0 switches it off. Chosen: a D4xx's default gain can be raised 4 times before its noise shows
uniform float psf_sigma_px = 0.6;        //@ [0, 1.2]   px     blur of lens and pixel, standard deviation; with the spot a dot has 1.2 px
uniform float shot_counts = 0.05;        //@ [0, 16]    counts variance of the light's own noise per count
uniform float read_sigma_counts = 0.7;   //@ [0, 1000; 0, 8] counts noise of reading a pixel, standard deviation
uniform float speckle_sigma = 0.05;      //@ [0, 1]     1      noise of laser light as a share of the signal, standard deviation; Landau et al. 2015 for a Kinect V1; SimSense has 0.027 for a D415. It makes noise in disparity hardly depend on distance, as real noise
uniform float pixel_gain_sigma = 0.005;  //@ [0, 0.2]   1      pixels of a device differ in gain, standard deviation
uniform int bits = 8;                    //@ [6, 16]    1      counts end at 2^bits - 1: rectified images have 8 bits, raw ones 10

uniform uint u_seed;
uniform uint u_device_seed;
uniform float u_subject_m;

// The blurred light of a pixel. Light outside the window is 0.
float blurred(sampler2D light, ivec2 pixel) {
    float side = psf_sigma_px > 0.0 ? exp(-0.5 / (psf_sigma_px * psf_sigma_px)) : 0.0;
    float sum = 0.0;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            float weight = (x == 0 ? 1.0 : side) * (y == 0 ? 1.0 : side);
            sum += weight * fetch(light, pixel + ivec2(x, y));
        }
    }
    return sum / ((1.0 + 2.0 * side) * (1.0 + 2.0 * side));
}

// Counts per count of light. Cameras expose to a mean brightness; the face stands for it here, so that a
// crop is exposed like the whole frame.
float exposed() {
    float automatic = min(u_subject_m * u_subject_m, longest_exposure);
    return exposure * (longest_exposure > 0.0 ? automatic : 1.0);
}

// Counts of a pixel; noise and gain: standard normal.
float counts(float light, float noise, float gain) {
    float signal = exposed() * light * (1.0 + pixel_gain_sigma * gain);
    float speckle = speckle_sigma * signal;
    float sigma = sqrt(shot_counts * signal + read_sigma_counts * read_sigma_counts + speckle * speckle);
    return clamp(floor(signal + sigma * noise + 0.5), 0.0, exp2(float(bits)) - 1.0);
}
