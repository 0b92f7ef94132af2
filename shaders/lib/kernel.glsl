// kernel: libfreenect2's 3x3 Gaussian, nearly a box.
const float KERNEL_CORNER = 0.1069973;
const float KERNEL_SIDE = 0.1131098;
const float KERNEL_MIDDLE = 0.1195716;

// The weight of a neighbour, offset -1 to 1 along each axis.
float kernel(ivec2 offset) {
    int steps = abs(offset.x) + abs(offset.y);
    return steps == 0 ? KERNEL_MIDDLE : (steps == 1 ? KERNEL_SIDE : KERNEL_CORNER);
}
