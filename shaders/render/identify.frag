#version 330 core
// identify: writes the number of the triangle, from 1; exact in float32 up to 16 million.
out float triangle;

void main() {
    triangle = float(gl_PrimitiveID + 1);
}
