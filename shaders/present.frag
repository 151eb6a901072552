#version 330
// What the viewport shows, opaque RGB: blended colour, blended depth through a ramp, or flat ID colours.

#include "fetch.glsl"
#include "id_color.glsl"

const int VIEW_COLOR = 0;
const int VIEW_DEPTH = 1;
const int VIEW_ID = 2;
const int STOPS = 6;
const uint SAFE = 12u;

uniform int view;
uniform vec2 viewport;
uniform sampler2D blended;     // may be smaller than the viewport
uniform usampler2D rows;
uniform usampler2D ids;        // per splat
uniform vec3 ramp[STOPS];      // near to far
uniform vec2 depth_range;      // metres at the two ends of the ramp, on a logarithmic scale

uniform bool has_safe_colors;
uniform vec3 safe_colors[SAFE];  // that colour-blind eyes tell apart

out vec4 shown;

// As app/preferences/instance_colors.py chooses them.
vec3 safe_color(uint id) {
    uint curve = (id * 0x9E3779u) & 0xFFFFFFu;
    return curve == 0u ? vec3(0.0) : safe_colors[((curve >> 12) * SAFE) >> 12];
}

vec3 flat_id_color(ivec2 pixel) {
    uint row_plus_one = texelFetch(rows, pixel, 0).r;
    if (row_plus_one == 0u) {
        return vec3(0.0);
    }
    uint id = texelFetch(ids, texel_of(int(row_plus_one - 1u)), 0).r;
    return has_safe_colors ? safe_color(id) : id_color(id);
}

vec3 depth_color(vec4 accumulated) {
    if (accumulated.a < 0.05) {
        return vec3(0.0);
    }
    float depth = accumulated.r / accumulated.a;
    float place = clamp(log(depth / depth_range.x) / log(depth_range.y / depth_range.x), 0.0, 1.0) * float(STOPS - 1);
    int stop = min(int(place), STOPS - 2);
    return mix(ramp[stop], ramp[stop + 1], place - float(stop));
}

void main() {
    if (view == VIEW_ID) {
        shown = vec4(flat_id_color(ivec2(gl_FragCoord.xy)), 1.0);
        return;
    }
    vec4 accumulated = texture(blended, gl_FragCoord.xy / viewport);
    shown = vec4(view == VIEW_DEPTH ? depth_color(accumulated) : accumulated.rgb, 1.0);
}
