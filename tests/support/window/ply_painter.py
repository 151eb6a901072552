"""A splat renderer of its own, from the columns of a .ply file to a picture: plain numpy, nothing of the product.

As the paper's authors draw it (Kerbl et al. 2023): EWA projection with 0.3 pixels of low-pass, spherical harmonics of
degree 1 at most, alpha from 1/255 to 0.99, front to back. The principal point is in the middle.
"""

import numpy as np
from plyfile import PlyData

C0, C1 = 0.28209479177387814, 0.4886025119029199


def painted(path, world_from_camera, fx, fy, width, height, replaced=None):
    """RGB over black (height, width, 3) and coverage (height, width) of a .ply as a camera sees it.

    OpenCV axes. `replaced` gives other values for columns of the file, by name.
    """
    columns = PlyData.read(path)["vertex"].data
    columns = {name: np.asarray(columns[name], float) for name in columns.dtype.names} | (replaced or {})
    pick = lambda *names: np.stack([columns[name] for name in names], axis=-1)  # noqa: E731
    means = pick("x", "y", "z")
    rotation, eye = world_from_camera[:3, :3], world_from_camera[:3, 3]
    points = (means - eye) @ rotation
    order = np.argsort(points[:, 2])
    order = order[points[order, 2] > 0.2]
    colors = seen_colors(columns, means - eye, pick)
    opacities = 1 / (1 + np.exp(-columns["opacity"]))
    axes = axes_of(pick("rot_0", "rot_1", "rot_2", "rot_3")) * np.exp(pick("scale_0", "scale_1", "scale_2"))[:, None]
    wide, high = 1.3 * width / (2 * fx), 1.3 * height / (2 * fy)
    picture, clear = np.zeros((height, width, 3)), np.ones((height, width))
    for row in order:
        x, y, z = points[row]
        tilt = np.clip((x / z, y / z), (-wide, -high), (wide, high))
        jacobian = np.array([[fx / z, 0, -fx * tilt[0] / z], [0, fy / z, -fy * tilt[1] / z]])
        flat = jacobian @ rotation.T @ axes[row]
        covariance = flat @ flat.T + 0.3 * np.eye(2)
        reach = 3.5 * np.sqrt(np.diag(covariance))
        u, v = fx * x / z + width / 2, fy * y / z + height / 2
        left, right = max(int(u - reach[0]), 0), min(int(u + reach[0]) + 2, width)
        top, bottom = max(int(v - reach[1]), 0), min(int(v + reach[1]) + 2, height)
        if left >= right or top >= bottom:
            continue
        dx = np.arange(left, right)[None] + 0.5 - u
        dy = np.arange(top, bottom)[:, None] + 0.5 - v
        (a, b), (_, d) = np.linalg.inv(covariance)
        alpha = np.minimum(opacities[row] * np.exp(-0.5 * (a * dx * dx + d * dy * dy) - b * dx * dy), 0.99)
        alpha[alpha < 1 / 255] = 0
        part = clear[top:bottom, left:right]
        picture[top:bottom, left:right] += (part * alpha)[..., None] * colors[row]
        part *= 1 - alpha
    return picture, 1 - clear


def seen_colors(columns, offsets, pick):
    """Colours as seen from where the offsets begin."""
    x, y, z = (offsets / np.linalg.norm(offsets, axis=1, keepdims=True)).T[:, :, None]
    count = sum(name.startswith("f_rest_") for name in columns) // 3
    assert count in (0, 3), "degree 0 or 1"
    colors = 0.5 + C0 * pick("f_dc_0", "f_dc_1", "f_dc_2")
    if count:
        first, second, third = (pick(*(f"f_rest_{channel * count + k}" for channel in range(3))) for k in range(3))
        colors = colors - C1 * y * first + C1 * z * second - C1 * x * third
    return np.maximum(colors, 0)


def axes_of(quats):
    """Rotation matrices of w, x, y, z."""
    w, x, y, z = (quats / np.linalg.norm(quats, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
