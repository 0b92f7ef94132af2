#version 330 core
// regions: writes the region of the face that a pixel shows.
#include "lib/strands.glsl"

flat in float v_region;

out float region;

void main() {
#ifdef STRANDS
    strand_seen(1.0);
#endif
    region = v_region;
}
