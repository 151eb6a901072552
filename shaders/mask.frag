#version 330
// Which pixels show a selected (1) and which the hovered (2) instance.

#include "fetch.glsl"

uniform usampler2D rows;
uniform usampler2D instance_ids;
uniform usampler2D states;
uniform uint selected_flag;
uniform uint hovered_id;

out uint mask;

void main() {
    mask = 0u;
    uint row_plus_one = texelFetch(rows, ivec2(gl_FragCoord.xy), 0).r;
    if (row_plus_one == 0u) {
        return;
    }
    ivec2 texel = texel_of(int(row_plus_one - 1u));
    if ((texelFetch(states, texel, 0).r & selected_flag) != 0u) {
        mask |= 1u;
    }
    if (hovered_id != 0u && texelFetch(instance_ids, texel, 0).r == hovered_id) {
        mask |= 2u;
    }
}
