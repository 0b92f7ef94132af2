// facet: the normal of the drawn triangle, towards the camera.

vec3 facet_normal(vec3 position_m) {
    // Both derivatives lie in the plane of the triangle.
    vec3 n = normalize(cross(dFdx(position_m), dFdy(position_m)));
    return dot(n, position_m) > 0.0 ? -n : n;
}
