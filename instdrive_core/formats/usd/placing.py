"""Where prims stand: fixed in the scene, or carried by one that moves, which becomes a track."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.usd.stage import REMEDY, load_usd

_Z_UP_FROM_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
_FARTHEST = 1e9
"""Metres; what is moved farther does not fit float32."""
_MOST_SAMPLES = 100_000
_EVEN = 1e-3
"""Share by which a carrier's scale may change over time."""


@dataclass(frozen=True)
class Motion:
    """How something moves that carries splats."""

    path: str
    """Where the prim that moves stands in the stage."""
    times: Float64[ndarray, " t"]
    """Seconds, rising."""
    poses: Float64[ndarray, "t 4 4"]
    """Rigid, from the carrier's frame (metres) to the scene."""


@dataclass(frozen=True)
class Placing:
    """Where the splats of a prim stand."""

    pose: Float64[ndarray, "3 4"]
    """[s R | t] to the scene, or to the frame of what carries them."""
    motion: Motion | None


def compute_scene_from_stage(stage: Any) -> Float64[ndarray, "4 4"]:
    """Compute the turn to z up and the scale to metres."""
    geom = load_usd("UsdGeom")
    turn = _Z_UP_FROM_Y_UP if geom.GetStageUpAxis(stage) == geom.Tokens.y else np.eye(4)
    return turn @ np.diag([*[float(geom.GetStageMetersPerUnit(stage))] * 3, 1.0])


def place_prim(stage: Any, prim: Any, path: Path) -> Placing:
    """Place a prim by its own and its ancestors' transforms.

    Raises DataError where one mirrors, shears or stretches unevenly, leads too far, or has too many samples.
    """
    usd, geom = load_usd("Usd"), load_usd("UsdGeom")
    scene_from_stage = compute_scene_from_stage(stage)
    chain = _list_chain(prim)
    carrier = next((each for each in chain if len(geom.Xformable(each).GetTimeSamples()) > 1), None)
    if carrier is None:
        cache = geom.XformCache(usd.TimeCode.EarliestTime())
        pose = scene_from_stage @ _read_matrix(cache.GetLocalToWorldTransform(prim))
        return Placing(_split(pose, prim, path)[0][:3], None)
    codes = sorted({code for each in _list_chain(carrier) for code in geom.Xformable(each).GetTimeSamples()})
    if len(codes) > _MOST_SAMPLES:
        raise DataError(path, f"{carrier.GetPath()} has {len(codes)} samples over time", "Thin them out")
    caches = [geom.XformCache(usd.TimeCode(code)) for code in codes]
    split = [
        _split(scene_from_stage @ _read_matrix(cache.GetLocalToWorldTransform(carrier)), carrier, path)
        for cache in caches
    ]
    scales = np.array([scale for _, scale in split])
    if np.ptp(scales) > _EVEN * scales[0]:
        raise DataError(path, f"{carrier.GetPath()} grows over time, and tracks are rigid", "Bake its scale first")
    poses = np.stack([pose for pose, _ in split])
    poses[:, :3, :3] /= scales[:, None, None]
    relative, _ = caches[0].ComputeRelativeTransform(prim, carrier)
    local = np.diag([*[scales[0]] * 3, 1.0]) @ _read_matrix(relative)
    times = np.array(codes, np.float64) / float(stage.GetTimeCodesPerSecond())
    if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
        raise DataError(path, f"the times at which {carrier.GetPath()} is placed do not rise", REMEDY)
    return Placing(_split(local, prim, path)[0][:3], Motion(str(carrier.GetPath()), times, poses))


def _list_chain(prim: Any) -> list[Any]:
    """List a prim and its ancestors, from the prim up, as far as their transforms count."""
    geom, chain = load_usd("UsdGeom"), []
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(geom.Xformable):
            chain.append(prim)
            if geom.Xformable(prim).GetResetXformStack():
                break
        prim = prim.GetParent()
    return chain


def _read_matrix(matrix: Any) -> Float64[ndarray, "4 4"]:
    return np.array(matrix, np.float64).T  # the library's points are rows


def _split(pose: Float64[ndarray, "4 4"], prim: Any, path: Path) -> tuple[Float64[ndarray, "4 4"], float]:
    """Check that a pose is [s R | t]; also s."""
    if not (np.abs(pose) < _FARTHEST).all():
        raise DataError(path, f"{prim.GetPath()} is moved or scaled beyond {_FARTHEST:g} m", REMEDY)
    linear = pose[:3, :3]
    determinant = float(np.linalg.det(linear))
    scale = float(np.cbrt(determinant)) if determinant > 0 else 0.0
    if scale < 1e-9 or np.abs(linear @ linear.T / scale**2 - np.eye(3)).max() > 1e-4:
        problem = f"{prim.GetPath()} is mirrored, sheared or stretched unevenly, which splats cannot follow"
        raise DataError(path, problem, "Apply its transform before export")
    return pose, scale
