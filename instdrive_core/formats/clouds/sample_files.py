"""Small .pcd files of every form: for tests and fuzzing."""

import struct

import numpy as np


def build_pcd(points, colors, form):
    """Bytes of a cloud (n, 3) with colours (n, 3) from 0 to 255; `form` is ``ascii``, ``binary`` or
    ``binary_compressed``."""
    count = len(points)
    packed = (colors[:, 0].astype(np.uint32) << 16) | (colors[:, 1].astype(np.uint32) << 8) | colors[:, 2]
    lines = ["# .PCD v0.7", "VERSION 0.7", "FIELDS x y z rgb", "SIZE 4 4 4 4", "TYPE F F F U", "COUNT 1 1 1 1"]
    lines += [f"WIDTH {count}", "HEIGHT 1", f"POINTS {count}", "VIEWPOINT 0 0 0 1 0 0 0", f"DATA {form}", ""]
    header = "\n".join(lines).encode()
    if form == "ascii":
        rows = [f"{x:.8g} {y:.8g} {z:.8g} {c}" for (x, y, z), c in zip(points.tolist(), packed.tolist(), strict=True)]
        return header + ("\n".join(rows) + "\n").encode()
    if form == "binary":
        rows = np.zeros(count, [("p", "<f4", 3), ("c", "<u4")])
        rows["p"], rows["c"] = points, packed
        return header + rows.tobytes()
    content = points.astype("<f4").T.tobytes() + packed.astype("<u4").tobytes()
    literals = b"".join(
        bytes([len(part) - 1]) + part for part in (content[start : start + 32] for start in range(0, len(content), 32))
    )
    return header + struct.pack("<II", len(literals), len(content)) + literals
