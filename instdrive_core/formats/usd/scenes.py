"""Reading splats of USD stages: prims of OpenUSD's ParticleField3DGaussianSplat, one part of the scene for each.

By the schema, scales are standard deviations, opacities lie in [0, 1], and SH coefficients lie splat by splat in the
order and with the signs of a .ply. Arrays that are longer than the positions are cut, shorter ones are passed over.
What moves over time becomes a track; prims of other programs become an instance each where there are several.
"""

from __future__ import annotations

from collections.abc import Mapping, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import WHOLE, ReadOptions, check_memory, count_row_bytes
from instdrive_core.formats.instance_parts import PartCollector
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.formats.usd.placing import Motion, Placing, place_prim
from instdrive_core.formats.usd.stage import OWN_DATA, REMEDY, SPLATS, load_usd, open_stage, refuse_usd_errors
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import transform_gaussians

COEFFICIENTS, DEGREE = "radiance:sphericalHarmonicsCoefficients", "radiance:sphericalHarmonicsDegree"
_MOST_ACTORS = (1 << 16) - 1
_HIGHEST_DEGREE = 3
_SMALLEST_SIDE = 0.1
"""Metres of the box of something whose splats lie in one plane."""


@dataclass(frozen=True)
class _Found:
    """A prim with splats."""

    prim: Any
    count: int
    degree: int
    placing: Placing
    own: Mapping[str, Any]
    """What this program wrote of it."""


def read_usd(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open the splats of a .usd, .usda, .usdc or .usdz.

    Raises DataError where anything about them is wrong, or there are none; UntrustedDataError where the stage needs
    files outside of its folder; MissingExtraError where OpenUSD is not installed.
    """
    path = Path(path)
    size = path.stat().st_size
    with (
        open_stage(path) as stage,
        refuse_usd_errors(path, "its values cannot be read", REMEDY),
        np.errstate(invalid="ignore", over="ignore"),  # not a number in, not a number out
    ):
        return _read_stage(stage, path, size, options)


def _read_stage(stage: Any, path: Path, size: int, options: ReadOptions) -> Scene:
    left_out: list[str] = []
    found = _find_prims(stage, path, left_out)
    total = sum(each.count for each in found)
    check_plausible_count(path, total, size)
    rest = max(REST_COUNTS[each.degree] for each in found)
    check_memory(path, total, 3 * count_row_bytes(rest, 0), options)
    motions = {each.placing.motion.path: each.placing.motion for each in found if each.placing.motion is not None}
    if len(motions) > _MOST_ACTORS:
        raise DataError(path, f"{len(motions)} of its prims move, at most {_MOST_ACTORS} can", "Split the stage")
    nodes = {name: number + 1 for number, name in enumerate(motions)}

    def find_node(each: _Found) -> int:
        return 0 if each.placing.motion is None else nodes[each.placing.motion.path]

    found.sort(key=find_node)
    collector, start = PartCollector(), 0
    names = _Numbers(found)
    for each in found:
        kept = slice(-start % options.keep_every, None, options.keep_every)
        part = _read_splats(each, kept, path, left_out)
        if not np.array_equal(each.placing.pose, np.eye(4)[:3]):
            transform_gaussians(part, each.placing.pose)
        collector.add(part, names.describe(each), find_node(each))
        start += each.count
        report(start / total)
    joined = collector.join()
    about = _read_own_data(stage.GetDefaultPrim())
    return Scene(
        joined.gaussians,
        joined.instance_ids,
        joined.codewords,
        joined.nodes,
        joined.table,
        actors=tuple(
            _make_track(stage, motion, joined.gaussians.means[joined.nodes == nodes[name]])
            for name, motion in motions.items()
        ),
        origin=_parse_numbers(about.get("origin"), np.zeros(3), path, "origin"),
        code_bits=_parse_code_bits(about.get("code_bits")),
        antialiased=about.get("antialiased") is True,
        left_out=tuple(dict.fromkeys(left_out)),
    )


def _find_prims(stage: Any, path: Path, left_out: list[str]) -> list[_Found]:
    usd, geom = load_usd("Usd"), load_usd("UsdGeom")
    found, others = [], 0
    for prim in stage.Traverse(usd.TraverseInstanceProxies()):
        if prim.GetTypeName() != SPLATS:
            others += prim.IsA(geom.Gprim)
            continue
        image = geom.Imageable(prim)
        if image.ComputePurpose() not in (geom.Tokens.default_, geom.Tokens.render):
            left_out.append(f"{prim.GetPath()}: it is a {image.ComputePurpose()}, which pictures do not show")
            continue
        placing = place_prim(stage, prim, path)
        if placing.motion is None and image.ComputeVisibility(usd.TimeCode.EarliestTime()) == geom.Tokens.invisible:
            left_out.append(f"{prim.GetPath()}: it is invisible")
            continue
        count = len(_read_array(prim, "positions", 3, path))
        if count:
            own = _read_own_data(prim)
            found.append(_Found(prim, count, _read_degree(prim, count, path, left_out), placing, own))
    if others:
        left_out.append("prims other than splats: only splats are opened")
    if not found:
        problem = f"no prim of its stage holds splats ({SPLATS})"
        raise DataError(path, problem, "Export splats; meshes and volumes are not opened")
    return found


def _read_degree(prim: Any, count: int, path: Path, left_out: list[str]) -> int:
    """Read the SH degree that is opened. Raises DataError where it is none."""
    degree = prim.GetAttribute(DEGREE).Get()
    if not isinstance(degree, int) or not 0 <= degree < 16:
        raise DataError(path, f"'{DEGREE}' of {prim.GetPath()} is {degree!r}", REMEDY)
    if len(_read_array(prim, COEFFICIENTS, 3, path)) < count * (degree + 1) ** 2:
        return 0
    if degree > _HIGHEST_DEGREE:
        left_out.append(f"SH above degree {_HIGHEST_DEGREE}, of the {degree} of {prim.GetPath()}")
    return min(degree, _HIGHEST_DEGREE)


def _read_splats(each: _Found, kept: slice, path: Path, left_out: list[str]) -> Gaussians:
    prim, count = each.prim, each.count

    def read(name: str, width: int, missing: float | list[float], per_splat: int = 1) -> ndarray:
        values = _read_array(prim, name, width, path)
        if len(values) < count * per_splat:
            if len(values):
                left_out.append(f"'{name}' of {prim.GetPath()}: it has fewer values than its positions need")
            return np.broadcast_to(np.array(missing, np.float32), (len(range(count)[kept]), per_splat, width))
        return values[: count * per_splat].reshape(count, per_splat, width)[kept]

    means = read("positions", 3, 0.0)[:, 0].astype(np.float32)
    scales, opacities = read("scales", 3, 1.0)[:, 0], read("opacities", 1, 1.0)[:, 0, 0]
    _require_range(scales, "scale", 0, np.inf, each, path)
    _require_range(opacities, "opacity", 0, 1, each, path)
    degree = prim.GetAttribute(DEGREE).Get()
    width = (degree + 1) ** 2 if each.degree or not degree else 1
    harmonics = read(COEFFICIENTS, 3, 0.0, width)[:, : REST_COUNTS[each.degree] + 1]
    with np.errstate(divide="ignore"):  # a flat splat's scale of 0 is -inf as a logarithm, as in a .ply
        log_scales = np.log(scales.astype(np.float64))
    return Gaussians(
        means=means,
        quats=read("orientations", 4, [0.0, 0.0, 0.0, 1.0])[:, 0][:, [3, 0, 1, 2]].astype(np.float32),
        log_scales=log_scales.astype(np.float32),
        opacity_logits=logit(opacities.astype(np.float64)).astype(np.float32),
        sh_dc=harmonics[:, 0].astype(np.float32),
        sh_rest=harmonics[:, 1:].astype(np.float32),
        features=np.zeros((len(means), 0), np.float32),
    )


def _read_array(prim: Any, name: str, width: int, path: Path) -> ndarray:
    """Read an array of floats, or its half as long twin where there is none: (n, width); quaternions are xyzw."""
    usd = load_usd("Usd")
    for each in (name, f"{name}h"):
        value = prim.GetAttribute(each).Get(usd.TimeCode.EarliestTime()) if prim.HasAttribute(each) else None
        if isinstance(value, Sized) and len(value):
            values = np.array(value)
            if values.ndim > 2 or values.size != len(values) * width or values.dtype.kind != "f":
                raise DataError(path, f"'{each}' of {prim.GetPath()} is not of {width} floats each", REMEDY)
            values = values + np.float16(0)  # what signals that it is no number is quiet from here on
            return values.reshape(len(values), width)
    return np.zeros((0, width), np.float32)


def _require_range(values: ndarray, name: str, low: float, high: float, each: _Found, path: Path) -> None:
    wrong = np.argwhere(~((values >= low) & (values <= high)))
    if len(wrong):
        value = values[tuple(wrong[0])]
        problem = f"the {name} of splat {wrong[0][0]} of {each.prim.GetPath()} is {value:g}, outside its range"
        raise DataError(path, problem, REMEDY)


class _Numbers:
    """IDs of prims: those that this program wrote, and new ones for others."""

    def __init__(self, found: list[_Found]) -> None:
        known = [each.own.get("id") for each in found]
        self._next = max([number for number in known if isinstance(number, int)], default=0) + 1
        self._alone = len(found) == 1

    def describe(self, each: _Found) -> dict[str, Any]:
        """Describe a prim as `InstancePart.describe` does."""
        if "id" in each.own or (self._alone and each.placing.motion is None):
            return dict(each.own)
        self._next += 1
        return {"id": self._next - 1, "name": each.prim.GetName()}


def _make_track(stage: Any, motion: Motion, means: ndarray) -> Track:
    prim = stage.GetPrimAtPath(motion.path)
    own = _read_own_data(prim).get("track")
    own = own if isinstance(own, dict) else {}
    size = np.maximum(np.ptp(means, axis=0), _SMALLEST_SIDE) if len(means) else np.ones(3)
    label = own.get("label")
    return Track(
        id=str(own["id"]) if "id" in own else motion.path.strip("/"),
        label=label if isinstance(label, str) and label else "object",
        dimensions=_parse_numbers(own.get("dimensions"), size.astype(np.float64), None, ""),
        times=motion.times,
        world_from_box=motion.poses,
        moving=own.get("moving") is not False,
    )


def _read_own_data(prim: Any) -> dict[str, Any]:
    data = prim.GetCustomDataByKey(OWN_DATA) if prim else None
    return dict(data) if isinstance(data, dict) else {}


def _parse_numbers(value: Any, default: Float64[ndarray, "3"], path: Path | None, name: str) -> Float64[ndarray, "3"]:
    """Parse three finite numbers. Without a path, what is none is passed over."""
    if value is None:
        return default
    try:
        numbers = np.array(value, np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        if path is None:
            return default
        raise DataError(path, f"'{name}' in the custom data of the stage is not three numbers", REMEDY)
    return numbers


def _parse_code_bits(value: Any) -> int:
    return value if isinstance(value, int) and 0 <= value <= 32 else 0
