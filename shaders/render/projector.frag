#version 330 core
// projector: writes the z-buffer only.
#include "lib/strands.glsl"

void main() {
#ifdef STRANDS
    strand_seen(1.0);
#endif
}
