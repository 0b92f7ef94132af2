// strand_sheets: passes the coordinates of strands on a sheet of hair to lib/strands.glsl.
#ifdef STRANDS
in vec4 in_strand;
in float in_sink_mm;

out vec4 v_strand;
out float v_sink_m;
out vec3 v_sheet_m;
#endif

void pass_strands(vec4 position_m) {
#ifdef STRANDS
    v_strand = in_strand;
    v_sink_m = 0.001 * in_sink_mm;
    v_sheet_m = position_m.xyz;
#endif
}
