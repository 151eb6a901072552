"""Reading splats of glTF files: primitives that KHR_gaussian_splatting marks, one part of the scene for each.

By the extension, scales are standard deviations in metres, opacities lie in [0, 1], quaternions are xyzw, and SH
coefficients have the order and signs of a .ply. Axes are turned from y up to z up, SH included, as nodes are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import WHOLE, ReadOptions, check_memory, count_row_bytes
from instdrive_core.formats.gltf.accessors import count_accessor, read_accessor
from instdrive_core.formats.gltf.container import REMEDY, GltfFile, open_gltf
from instdrive_core.formats.gltf.nodes import decompose_pose, list_nodes
from instdrive_core.formats.instance_parts import PartCollector
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import transform_gaussians

EXTENSION = "KHR_gaussian_splatting"
KERNEL, COLOR_SPACE = "ellipse", "srgb_rec709_display"
SCENE_EXTRAS = ("origin", "code_bits", "antialiased")
"""What the root of a scene says of itself in its extras."""
_POINTS = 0


def list_sh_names(degree: int) -> list[str]:
    """List the attributes that hold the coefficients of one degree."""
    return [f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{number}" for number in range(2 * degree + 1)]


def read_gltf(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open the splats of a .glb or .gltf. Raises DataError where anything about them is wrong, or there are none."""
    gltf = open_gltf(Path(path))
    left_out: list[str] = []
    wanted = [
        (primitive, pose, node)
        for node, pose in list_nodes(gltf)
        if "mesh" in node
        for primitive in _find_splats(gltf, node, left_out)
    ]
    if not wanted:
        problem = f"no mesh of its scene has splats ({EXTENSION})"
        raise DataError(gltf.path, problem, "Meshes of triangles are not opened; export splats")
    counts = [count_accessor(gltf, primitive["attributes"].get("POSITION")) for primitive, _, _ in wanted]
    rest = max(_find_rest(gltf, primitive) for primitive, _, _ in wanted)
    check_memory(gltf.path, sum(counts), 2 * count_row_bytes(rest, 0), options)
    collector, start = PartCollector(), 0
    for (primitive, pose, node), count in zip(wanted, counts, strict=True):
        part = _read_primitive(gltf, primitive, count, slice(-start % options.keep_every, None, options.keep_every))
        check_plausible_count(gltf.path, start + count, gltf.size)
        _place(gltf, part, pose, str(node.get("name", "a node")))
        collector.add(part, node["extras"] if isinstance(node.get("extras"), dict) else {})
        start += count
        report(start / sum(counts))
    joined = collector.join()
    about = _find_scene_extras(gltf)
    return Scene(
        joined.gaussians,
        joined.instance_ids,
        joined.codewords,
        joined.nodes,
        joined.table,
        origin=_parse_origin(gltf, about.get("origin", [0, 0, 0])),
        code_bits=_parse_code_bits(about.get("code_bits")),
        antialiased=about.get("antialiased") is True,
        left_out=tuple(dict.fromkeys(left_out)),
    )


def _find_splats(gltf: GltfFile, node: dict[str, Any], left_out: list[str]) -> list[dict[str, Any]]:
    primitives = gltf.get_entry("meshes", node["mesh"]).get("primitives")
    if not isinstance(primitives, list) or not all(isinstance(primitive, dict) for primitive in primitives):
        raise DataError(gltf.path, "'primitives' of a mesh is no list of objects", REMEDY)
    found = []
    for primitive in primitives:
        extensions = primitive.get("extensions")
        splatting = extensions.get(EXTENSION) if isinstance(extensions, dict) else None
        if splatting is None:
            left_out.append("meshes without splats: only splats are opened")
            continue
        if not isinstance(splatting, dict) or not isinstance(primitive.get("attributes"), dict):
            raise DataError(gltf.path, f"a primitive has {EXTENSION} that is no object, or no attributes", REMEDY)
        if splatting.get("extensions"):
            name = str(next(iter(splatting["extensions"])))[:80]
            raise DataError(gltf.path, f"its splats are stored by {name!r}, which is not read", "Export it plain")
        if splatting.get("kernel") != KERNEL or primitive.get("mode") != _POINTS:
            problem = f"splats of kernel {str(splatting.get('kernel'))[:80]!r} and mode {primitive.get('mode')!r}"
            raise DataError(gltf.path, f"{problem} are not read", f"Export them with kernel {KERNEL!r} and mode 0")
        if splatting.get("colorSpace") != COLOR_SPACE:
            space = str(splatting.get("colorSpace"))[:80]
            left_out.append(f"the colour space {space!r}: colours are shown as those of {COLOR_SPACE!r}")
        found.append(primitive)
    return found


def _find_rest(gltf: GltfFile, primitive: dict[str, Any]) -> int:
    """Count the SH coefficients above the constant. Raises DataError where a degree is not whole."""
    degree = 0
    for number in range(1, 4):
        present = [name in primitive["attributes"] for name in list_sh_names(number)]
        if any(present) and not (all(present) and degree == number - 1):
            raise DataError(gltf.path, f"its SH of degree {number} lack coefficients, or lower degrees", REMEDY)
        degree = number if all(present) else degree
    return REST_COUNTS[degree]


def _read_primitive(gltf: GltfFile, primitive: dict[str, Any], count: int, kept: slice) -> Gaussians:
    attributes = primitive["attributes"]

    def read(name: str, width: int) -> ndarray:
        if name not in attributes:
            raise DataError(gltf.path, f"its splats lack the attribute {name!r}", REMEDY)
        return read_accessor(gltf, attributes[name], width, count, name)[kept]

    scales = read(f"{EXTENSION}:SCALE", 3)
    opacities = read(f"{EXTENSION}:OPACITY", 1)[:, 0]
    _require_range(gltf, scales, "scale", 0, np.inf)
    _require_range(gltf, opacities, "opacity", 0, 1)
    degree = REST_COUNTS.index(_find_rest(gltf, primitive))
    columns = [read(name, 3) for number in range(1, degree + 1) for name in list_sh_names(number)]
    means = read("POSITION", 3)
    with np.errstate(divide="ignore"):  # a flat splat's scale of 0 is -inf as a logarithm, as in a .ply
        log_scales = np.log(scales)
    return Gaussians(
        means=means,
        quats=read(f"{EXTENSION}:ROTATION", 4)[:, [3, 0, 1, 2]],
        log_scales=log_scales,
        opacity_logits=logit(opacities.astype(np.float64)).astype(np.float32),
        sh_dc=read(list_sh_names(0)[0], 3),
        sh_rest=np.stack(columns, axis=1) if columns else np.zeros((len(means), 0, 3), np.float32),
        features=np.zeros((len(means), 0), np.float32),
    )


def _require_range(gltf: GltfFile, values: ndarray, name: str, low: float, high: float) -> None:
    wrong = np.argwhere(~((values >= low) & (values <= high)))
    if len(wrong):
        problem = f"the {name} of splat {wrong[0][0]} of a primitive is {values[tuple(wrong[0])]:g}, outside its range"
        raise DataError(gltf.path, problem, REMEDY)


def _place(gltf: GltfFile, part: Gaussians, pose: Float64[ndarray, "4 4"], name: str) -> None:
    if not np.array_equal(pose, np.eye(4)):
        with np.errstate(invalid="ignore", over="ignore"):
            transform_gaussians(part, decompose_pose(gltf, pose, name))


def _find_scene_extras(gltf: GltfFile) -> dict[str, Any]:
    asset = gltf.content.get("asset")
    extras = asset.get("extras") if isinstance(asset, dict) else None
    return extras if isinstance(extras, dict) else {}


def _parse_origin(gltf: GltfFile, value: Any) -> Float64[ndarray, "3"]:
    if not isinstance(value, list) or len(value) != 3 or not all(isinstance(entry, int | float) for entry in value):
        raise DataError(gltf.path, "'origin' in the extras of the asset is not three numbers", REMEDY)
    return np.array(value, np.float64)


def _parse_code_bits(value: Any) -> int:
    return value if isinstance(value, int) and 0 <= value <= 32 else 0
