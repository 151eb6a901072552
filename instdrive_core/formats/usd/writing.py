"""Writing scenes as USD: a prim for each instance, moving objects below one that carries them; see `scenes`."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.formats.export_checks import check_numbers
from instdrive_core.formats.instance_parts import BACKGROUND
from instdrive_core.formats.usd.scenes import COEFFICIENTS, DEGREE
from instdrive_core.formats.usd.stage import OWN_DATA, SPLATS, load_usd, refuse_usd_errors
from instdrive_core.instances.table import Instance
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import normalize_quaternions, quaternion_from_matrix
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

TIME_CODES_PER_SECOND = 10.0
"""Sweeps of most LiDARs; where steps lie between, codes are fractions."""
_ROOT = "/Scene"
_LOG_SCALE_LIMITS = (-87.0, 88.0)
_REACH = 3.0
"""Standard deviations that an extent spans."""
_SLACK = 0.06
"""Seconds before and after a track in which its object is shown, as `Track.covers` has it."""
_PACKED_AT = 315_619_200
"""Seconds since 1970 that a package gives as its content's time, so that one scene gives one file: 2 January 1980."""


def write_usd(path: str | Path, scene: Scene) -> None:
    """Write a scene with its moving objects, atomically: text for .usda, a package for .usdz, else binary.

    Raises DataError where the scene has no splats or values that are no numbers; MissingExtraError where OpenUSD is not
    installed.
    """
    path = Path(path)
    if not len(scene):
        raise DataError(path, "the scene has no splats", "Save as .ply instead")
    _check(path, scene.gaussians)
    ending = path.suffix.lower()
    with TemporaryDirectory() as name, refuse_usd_errors(path, "OpenUSD cannot write it", "Free some space"):
        file = Path(name) / ("scene.usda" if ending == ".usda" else "scene.usdc")
        stage = _build_stage(scene)  # its layer lives as long as the stage
        stage.GetRootLayer().Export(str(file))
        if ending == ".usdz":
            file = _pack(file)
        with open_atomically(path) as out, file.open("rb") as content:
            shutil.copyfileobj(content, out, 1 << 20)


def order_by_prim(scene: Scene) -> Int64[ndarray, " n"]:
    """Order rows as they are written: by node, within it by instance; rows of one prim stay in their order."""
    return np.lexsort((scene.instance_ids, scene.nodes))


def _pack(file: Path) -> Path:
    os.utime(file, (_PACKED_AT, _PACKED_AT))
    package = file.with_suffix(".usdz")
    if not load_usd("UsdUtils").CreateNewUsdzPackage(load_usd("Sdf").AssetPath(str(file)), str(package)):
        raise DataError(package, "OpenUSD cannot pack it", "Save as .usdc")
    return package


def _build_stage(scene: Scene) -> Any:
    usd, geom = load_usd("Usd"), load_usd("UsdGeom")
    stage = usd.Stage.CreateInMemory()
    geom.SetStageUpAxis(stage, geom.Tokens.z)
    geom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(TIME_CODES_PER_SECOND)
    stage.SetFramesPerSecond(TIME_CODES_PER_SECOND)
    root = geom.Xform.Define(stage, _ROOT).GetPrim()
    stage.SetDefaultPrim(root)
    about = {"origin": scene.origin.tolist(), "code_bits": scene.code_bits, "antialiased": scene.antialiased}
    root.SetCustomDataByKey(OWN_DATA, about)
    if scene.actors:
        stage.SetStartTimeCode(min(float(track.times[0]) for track in scene.actors) * TIME_CODES_PER_SECOND)
        stage.SetEndTimeCode(max(float(track.times[-1]) for track in scene.actors) * TIME_CODES_PER_SECOND)
    taken: set[str] = set()
    carriers = [root]
    for number, track in enumerate(scene.actors):
        name = _choose_name(f"{track.label or 'object'}_{number + 1}", _ROOT, taken)
        carriers.append(_define_carrier(stage, f"{_ROOT}/{name}", track))
    order = order_by_prim(scene)
    parts = list(_list_parts(scene, order))
    for number, (rows, node, instance) in enumerate(parts):
        parent = str(carriers[node].GetPath())
        name = _choose_name(
            BACKGROUND if instance is None else instance.name or f"instance {instance.id}", parent, taken
        )
        prim = stage.DefinePrim(f"{parent}/{name}", SPLATS)
        prim.SetCustomDataByKey(OWN_DATA, _describe(instance))
        _fill(prim, scene.gaussians.select(rows))
        report((number + 1) / (len(parts) + 1))
    return stage


def _list_parts(
    scene: Scene, order: Int64[ndarray, " n"]
) -> Iterator[tuple[Int64[ndarray, " k"], int, Instance | None]]:
    """List rows, node and instance of each prim, in the order of `order_by_prim`."""
    keys = scene.nodes[order].astype(np.int64) << 32 | scene.instance_ids[order]
    starts = np.flatnonzero(np.r_[True, np.diff(keys) != 0])
    for start, stop in zip(starts, [*starts[1:], len(order)], strict=True):
        number = int(scene.instance_ids[order[start]])
        instance = scene.table.instances.get(number) or Instance(number, f"instance {number}")
        yield order[start:stop], int(scene.nodes[order[start]]), instance if number else None


def _choose_name(wanted: str, parent: str, taken: set[str]) -> str:
    """Choose a name that USD allows, and that no other child of the parent has."""
    name = base = load_usd("Tf").MakeValidIdentifier(wanted)
    number = 2
    while f"{parent}/{name}" in taken:
        name, number = f"{base}_{number}", number + 1
    taken.add(f"{parent}/{name}")
    return name


def _describe(instance: Instance | None) -> dict[str, Any]:
    if instance is None:
        return {"id": 0}
    about = {"id": instance.id, "name": instance.name, "class": instance.class_name, "codeword": instance.codeword}
    return about | {"color": list(instance.color)}


def _define_carrier(stage: Any, place: str, track: Track) -> Any:
    """Define the prim that carries the splats of a moving object along its track."""
    geom, gf = load_usd("UsdGeom"), load_usd("Gf")
    carrier = geom.Xform.Define(stage, place)
    move, turn = carrier.AddTranslateOp(), carrier.AddOrientOp(geom.XformOp.PrecisionDouble)
    quats = normalize_quaternions(quaternion_from_matrix(track.world_from_box[:, :3, :3]))
    for row in range(1, len(quats)):  # neighbours on one side, as readers interpolate between them
        quats[row] *= -1 if quats[row] @ quats[row - 1] < 0 else 1
    codes = (track.times * TIME_CODES_PER_SECOND).tolist()
    for code, pose, quat in zip(codes, track.world_from_box, quats.tolist(), strict=True):
        move.Set(gf.Vec3d(*pose[:3, 3].tolist()), code)
        turn.Set(gf.Quatd(quat[0], *quat[1:]), code)
    slack, shown = _SLACK * TIME_CODES_PER_SECOND, carrier.CreateVisibilityAttr()
    for code, token in (
        (codes[0] - TIME_CODES_PER_SECOND, geom.Tokens.invisible),
        (codes[0] - slack, geom.Tokens.inherited),
        (codes[-1] + slack, geom.Tokens.invisible),
    ):
        shown.Set(token, code)
    about = {"id": track.id, "label": track.label, "dimensions": track.dimensions.tolist(), "moving": track.moving}
    prim = carrier.GetPrim()
    prim.SetCustomDataByKey(OWN_DATA, {"track": about})
    return prim


def _fill(prim: Any, part: Gaussians) -> None:
    vt = load_usd("Vt")
    flat = np.isneginf(part.log_scales)
    scales = np.where(flat, 0, np.exp(np.clip(part.log_scales.astype(np.float64), *_LOG_SCALE_LIMITS)))
    quats = normalize_quaternions(part.quats.astype(np.float64)).astype(np.float32)
    harmonics = np.concatenate([part.sh_dc[:, None], part.sh_rest], axis=1).reshape(-1, 3)
    reach = _REACH * np.minimum(scales.max(axis=1, keepdims=True), 1e6)
    extent = np.stack([(part.means - reach).min(axis=0), (part.means + reach).max(axis=0)])

    def put(name: str, kind: Any, values: ndarray) -> None:
        prim.GetAttribute(name).Set(kind.FromNumpy(np.ascontiguousarray(values, np.float32)))

    put("positions", vt.Vec3fArray, part.means)
    put("orientations", vt.QuatfArray, quats[:, [1, 2, 3, 0]])
    put("scales", vt.Vec3fArray, scales)
    put("opacities", vt.FloatArray, sigmoid(part.opacity_logits.astype(np.float64)))
    prim.GetAttribute(DEGREE).Set(part.sh_degree)
    put(COEFFICIENTS, vt.Vec3fArray, harmonics)
    put("extent", vt.Vec3fArray, extent)


def _check(path: Path, gaussians: Gaussians) -> None:
    rows = np.arange(len(gaussians))
    for name in ("means", "quats", "sh_dc", "sh_rest"):
        check_numbers(path, name, getattr(gaussians, name), rows)
    for name in ("log_scales", "opacity_logits"):
        check_numbers(path, name, getattr(gaussians, name), rows, allow_infinite=True)
