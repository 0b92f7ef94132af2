// skin_signal: returned light, as a multiple of what skin at 0.9 m returns that faces the sensor.
// In this unit an unknown camera's thresholds can be drawn without knowing its counts.

const float SKIN_ALBEDO = 0.6; // glsim's skin in near infrared
const float USUAL_M = 0.9;     // the usual distance of faces

// Lambert's law and the inverse square of the distance. ray: x/z and y/z.
float skin_signal(float depth_m, float albedo, vec3 normal, vec2 ray) {
    vec3 direction = vec3(ray, 1.0);
    float squared = dot(direction, direction);
    float facing = max(-dot(normal, direction), 0.0) * inversesqrt(squared);
    float near = USUAL_M / max(depth_m, 1e-3);
    return depth_m > 0.0 ? albedo / SKIN_ALBEDO * facing * near * near / squared : 0.0;
}
