// gloss: the mirror light of shiny materials, as an albedo that is added to that of their scattered light.
// Emitter and camera are taken as one place (they are some degrees apart at most), so that only surfaces that face it shine: a lobe
// of Beckmann's facets, F exp(-tan^2 / m^2) / (4 m^2 cos^6), over the 0.87 of a white wall. F: Fresnel's reflectance at normal
// incidence, ((n - 1) / (n + 1))^2; m: rms slope of the facets.
#include "lib/facet.glsl"

// Material -> F, m. The numbers are those of WORN_GLOSS in glsim/looks/dress.py.
vec2 lobe(float material) {
    if (material < 1.5) return vec2(0.028, 0.30); // skin's oil: n 1.4; m .2 to .35 (Weyrich et al., ACM Trans. Graph. 25, 1013, 2006)
    if (material < 2.5) return vec2(0.021, 0.15); // tear film: n 1.337. Of an eye of 7.8 mm; as wide as the facets of the meshes (1 to 2 mm): chosen
    if (material < 3.5) return vec2(0.028, 0.20); // lip: skin, moist; m chosen at the smooth end of skin's
    if (material < 4.5) return vec2(0.040, 0.20); // frame: plastic, n 1.5; m chosen
    if (material < 5.5) return vec2(0.080, 0.05); // lens: two faces of n 1.5; m chosen: a lens of 100 mm radius shows a spot of some millimetres
    if (material < 6.5) return vec2(0.750, 0.15); // metal: nickel, n 2.34 - 5.11 i at 860 nm (Johnson and Christy, Phys. Rev. B 9, 5056, 1974); m as of the eye
    return vec2(0.040, 0.25);                     // leather: its finish of polymers, n 1.5; m chosen between those of plastic and skin
}

// Albedo with the mirror light. material: 0 matte; position: on the drawn triangle, camera frame, m.
float glossy(float albedo, float material, vec3 position_m) {
    float facing = -dot(facet_normal(position_m), normalize(position_m)); // derivatives: before any branch
    if (material < 0.5) return albedo;
    vec2 l = lobe(material);
    float squared = max(facing * facing, 1e-3), slope = (1.0 - squared) / squared;
    float mirrored = l.x * exp(-slope / (l.y * l.y)) / (4.0 * l.y * l.y * squared * squared * squared);
    return albedo + mirrored / 0.87;
}
