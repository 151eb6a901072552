// Per-splat data lie row by row in 2-D textures of a fixed width.

uniform int texture_width;

ivec2 texel_of(int index) {
    return ivec2(index % texture_width, index / texture_width);
}
