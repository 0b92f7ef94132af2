#version 330 core
// silhouette: writes a depth mask that limits later passes to covered pixels and their neighbours.
uniform sampler2D u_seen; // above 0 where the camera sees a surface

void main() {
    vec2 texel = 1.0 / vec2(textureSize(u_seen, 0));
    float most = 0.0;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            most = max(most, textureLod(u_seen, (gl_FragCoord.xy + vec2(x, y)) * texel, 0.0).r);
        }
    }
    gl_FragDepth = most > 0.0 ? 1.0 : 0.0; // passes are drawn at 0.5
}
