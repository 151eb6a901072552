// The real spherical harmonics above the constant, in the order and signs of instdrive_core/maths/spherical_harmonics.py.

uniform sampler2D sh_texture;  // per splat: sh_dc and sh_rest, flattened, padded to whole texels
uniform int sh_texels;
uniform int sh_rest_count;

const float Y0 = 0.28209479177387814;

vec3 sh_coefficient(int row, int which) {
    int start = which * 3;
    int base = row * sh_texels;
    vec3 value;
    for (int channel = 0; channel < 3; ++channel) {
        int place = start + channel;
        value[channel] = texelFetch(sh_texture, texel_of(base + place / 4), 0)[place % 4];
    }
    return value;
}

// Colour before clamping, seen along the unit direction camera -> Gaussian (in the splat's own frame).
vec3 sh_color(int row, vec3 direction) {
    vec3 color = vec3(0.5) + Y0 * sh_coefficient(row, 0);
    if (sh_rest_count < 3) {
        return color;
    }
    float x = direction.x, y = direction.y, z = direction.z;
    color += 0.4886025119029199 * (-y * sh_coefficient(row, 1) + z * sh_coefficient(row, 2) - x * sh_coefficient(row, 3));
    if (sh_rest_count < 8) {
        return color;
    }
    float xx = x * x, yy = y * y, zz = z * z;
    color += 1.0925484305920792 * x * y * sh_coefficient(row, 4)
        - 1.0925484305920792 * y * z * sh_coefficient(row, 5)
        + 0.31539156525252005 * (2.0 * zz - xx - yy) * sh_coefficient(row, 6)
        - 1.0925484305920792 * x * z * sh_coefficient(row, 7)
        + 0.5462742152960396 * (xx - yy) * sh_coefficient(row, 8);
    if (sh_rest_count < 15) {
        return color;
    }
    return color - 0.5900435899266435 * y * (3.0 * xx - yy) * sh_coefficient(row, 9)
        + 2.890611442640554 * x * y * z * sh_coefficient(row, 10)
        - 0.4570457994644658 * y * (4.0 * zz - xx - yy) * sh_coefficient(row, 11)
        + 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * sh_coefficient(row, 12)
        - 0.4570457994644658 * x * (4.0 * zz - xx - yy) * sh_coefficient(row, 13)
        + 1.445305721320277 * z * (xx - yy) * sh_coefficient(row, 14)
        - 0.5900435899266435 * x * (xx - 3.0 * yy) * sh_coefficient(row, 15);
}
