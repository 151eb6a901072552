// The bijection between 24-bit IDs and RGB8 colours of instdrive_core/instances/colormap.py; of longer codewords the low
// 24 bits count. Exact: every channel is a whole number of 255ths.

vec3 id_color(uint id) {
    uint curve = id * 0x9E3779u;  // what overflows 32 bits would not reach the low 24
    uvec3 channels = uvec3(0u);
    for (int bit = 0; bit < 24; ++bit) {
        channels[bit % 3] |= ((curve >> (23 - bit)) & 1u) << (7 - bit / 3);
    }
    return vec3(channels) / 255.0;
}
