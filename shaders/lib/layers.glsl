// layers: reads a layer at integer pixels; 0 outside the frame.

float fetch(sampler2D layer, ivec2 pixel) {
    ivec2 size = textureSize(layer, 0);
    if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, size))) return 0.0;
    return texelFetch(layer, pixel, 0).r;
}
