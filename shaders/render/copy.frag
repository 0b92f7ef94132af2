#version 330 core
// copy: copies a layer, pixel by pixel.
uniform sampler2D u_layer;

out vec4 copied;

void main() {
    copied = texelFetch(u_layer, ivec2(gl_FragCoord.xy), 0);
}
