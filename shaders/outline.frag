#version 330
// A line around and a light tint over masked pixels, blended onto the picture.

uniform usampler2D mask;
uniform vec4 selected_line;
uniform vec4 selected_tint;
uniform vec4 hovered_line;
uniform int thickness;

out vec4 overlay;  // premultiplied

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    ivec2 last = textureSize(mask, 0) - 1;
    uint here = texelFetch(mask, pixel, 0).r;
    uint around = 0u;
    for (int step = 1; step <= thickness; ++step) {
        around |= texelFetch(mask, clamp(pixel + ivec2(step, 0), ivec2(0), last), 0).r;
        around |= texelFetch(mask, clamp(pixel - ivec2(step, 0), ivec2(0), last), 0).r;
        around |= texelFetch(mask, clamp(pixel + ivec2(0, step), ivec2(0), last), 0).r;
        around |= texelFetch(mask, clamp(pixel - ivec2(0, step), ivec2(0), last), 0).r;
    }
    uint edge = around & ~here;
    if ((edge & 1u) != 0u) {
        overlay = selected_line;
    } else if ((edge & 2u) != 0u) {
        overlay = hovered_line;
    } else if ((here & 1u) != 0u) {
        overlay = selected_tint;
    } else {
        discard;
    }
    overlay.rgb *= overlay.a;
}
