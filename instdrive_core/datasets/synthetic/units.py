"""What each pixel of a synthetic photo shows, finer than instances: parts, cells of the ground, cast shadows.

The street is built again from the config that its clip keeps, and one ray is cast through the middle of each pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray

from instdrive_core.datasets.synthetic.config import (
    CONFIG_FILE,
    FLOWING,
    PANDAR64,
    USUAL_RATE,
    RecordingFlaws,
    StreetConfig,
)
from instdrive_core.datasets.synthetic.world.ego import compute_ego_pose
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.materials import (
    BARK,
    CAR_GLASS,
    LAMP,
    PAINTED_LINE,
    RIM,
    ROOF,
    SHUTTER,
    STRIPES,
    WINDOW,
)
from instdrive_core.datasets.synthetic.world.rig import CAMERAS
from instdrive_core.datasets.synthetic.world.street import StepGeometry
from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.json_fields import read_json, require_field

if TYPE_CHECKING:
    from instdrive_core.datasets.synthetic.sensors.raytrace import RayScene

GROUND_CELL, ROAD_CELL, CROWN_CELL, STOREY, BAY = 5.0, 15.0, 2.0, 3.0, 2.6
"""Sizes of the units, metres."""
SHADOW_REACH = 150.0
_LIFT = 0.02
"""Metres by which a shadow's ray starts above the surface."""
_REMEDY = "Write the synthetic clip again with `instdrive synth`"
_SINCE = {"traffic": FLOWING, "lidar": PANDAR64, "rate": USUAL_RATE}
"""What older streets do not say, and are."""

GROUND, HOUSE, VEGETATION, VEHICLE, PERSON, OTHER = range(6)
"""Families of objects that segmenters treat alike."""
_FAMILIES = {
    "Road": GROUND,
    "Sidewalk": GROUND,
    "Ground": GROUND,
    "Building": HOUSE,
    "Vegetation": VEGETATION,
    "Pedestrian": PERSON,
    "Pedestrian with Object": PERSON,
    "Bicycle": PERSON,
    "Car": VEHICLE,
    "Pickup Truck": VEHICLE,
    "Medium-sized Truck": VEHICLE,
    "Bus": VEHICLE,
}


@dataclass(frozen=True)
class PixelUnits:
    """What the middle of each pixel shows."""

    objects: Int32[ndarray, "h w"]
    """Instance; 0 = sky."""
    coarse: Int64[ndarray, "h w"]
    """Coarse part within the object: panes, wheels, faces of a house, trunk and crown, legs, lane paint; 0 = none."""
    fine: Int64[ndarray, "h w"]
    """Fine part within the object: windows, storeys, lamps, panels, pieces of a crown, cells of the road; 0 = none."""
    cells: Int64[ndarray, "h w"]
    """Cell of the ground, 5 m wide; 0 where no ground is."""
    casters: Int32[ndarray, "h w"]
    """Instance that keeps the sun from the pixel; 0 = none."""


class StreetUnits:
    """The street of a synthetic clip, asked photo by photo."""

    def __init__(self, clip_path: str | Path) -> None:
        """Raises DataError where the clip keeps no config of its street, a damaged one, or one with rolling shutter."""
        file = Path(clip_path) / CONFIG_FILE
        if not file.is_file():
            raise DataError(file, "is missing: the street cannot be built again to find its parts", _REMEDY)
        config = read_street_config(file)
        if config.flaws.shutter_seconds > 0:
            problem = (
                f"shutter_seconds is {config.flaws.shutter_seconds:g}: parts are only known of photos taken at once"
            )
            raise DataError(file, problem, "Write the clip without rolling shutter, or use the faults sam-v1")
        self.street, self._step_seconds = build_street(config), config.step_seconds
        self.families = np.zeros(len(self.street.fixtures) + len(self.street.actors) + 1, np.int64)
        labels = [fixture.label for fixture in self.street.fixtures] + [actor.label for actor in self.street.actors]
        self.families[1:] = [_FAMILIES.get(label, OTHER) for label in labels]
        self._step: tuple[int, StepGeometry, RayScene] | None = None
        self.is_thing = np.array([False, *(item.kind == "thing" for item in self.street.instances(0.0))])

    def look(self, camera: str, index: int, width: int, height: int) -> PixelUnits:
        """Cast a ray through each pixel of a photo of `width`×`height` pixels, taken by a camera of the rig at step
        `index` from where the camera truly was."""
        geometry, rays = self._build_step(index)
        rig_camera = next(known for known in CAMERAS if known.name == camera)
        placed = rig_camera.place(compute_ego_pose(self.street, index * self._step_seconds), width, height)
        directions = np.ascontiguousarray(placed.compute_ray_directions().reshape(-1, 3), np.float32)
        origin = placed.position.astype(np.float32)
        hits = rays.find_first_hits(np.broadcast_to(origin, directions.shape).copy(), directions)
        shape = (height, width)
        struck = np.flatnonzero(hits.triangles >= 0)
        triangles = hits.triangles[struck]
        corners = geometry.mesh.corners[triangles]
        texcoords = _interpolate(geometry.mesh.texcoords[triangles], hits.u[struck], hits.v[struck])
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        normals *= -np.sign((normals * directions[struck]).sum(axis=1, keepdims=True))
        points = origin + directions[struck] * hits.distances[struck, None]
        owners = geometry.instances[triangles]
        kinds = self.street.materials.parameters[geometry.mesh.materials[triangles], 0].astype(np.int64)
        parts = _name_parts(
            self.families[owners], kinds, geometry.mesh.materials[triangles], texcoords, points, normals
        )
        maps = [np.zeros(shape, np.int32), *(np.zeros(shape, np.int64) for _ in range(3)), np.zeros(shape, np.int32)]
        casters = self._find_casters(geometry, rays, points, normals)
        for target, values in zip(maps, (owners, *parts, casters), strict=True):
            target.ravel()[struck] = values
        return PixelUnits(*maps)

    def _build_step(self, index: int) -> tuple[StepGeometry, RayScene]:
        """The street at a step. The last one is kept, since all cameras of a step are asked for in a row."""
        from instdrive_core.datasets.synthetic.sensors.raytrace import RayScene

        if self._step is None or self._step[0] != index:
            geometry = self.street.geometry(index * self._step_seconds)
            self._step = index, geometry, RayScene(geometry.mesh.corners)
        return self._step[1:]

    def _find_casters(
        self, geometry: StepGeometry, rays: RayScene, points: Float32[ndarray, "n 3"], normals: Float32[ndarray, "n 3"]
    ) -> Int32[ndarray, " n"]:
        to_sun = np.asarray(self.street.light.to_sun, np.float32)
        lit = np.flatnonzero(normals @ to_sun > 0)
        starts = (points[lit] + _LIFT * normals[lit]).astype(np.float32)
        hits = rays.find_first_hits(starts, np.broadcast_to(to_sun, starts.shape).copy())
        shaded = (hits.triangles >= 0) & (hits.distances < SHADOW_REACH)
        casters = np.zeros(len(points), np.int32)
        casters[lit[shaded]] = geometry.instances[hits.triangles[shaded]]
        return casters


def read_street_config(file: Path) -> StreetConfig:
    """Read the config that a synthetic clip keeps of its street in `CONFIG_FILE`.

    Raises DataError where it is no such config.
    """
    entries = read_json(file)
    names = [field.name for field in fields(StreetConfig) if field.name not in _SINCE]
    values: dict[str, Any] = {name: require_field(file, entries, name) for name in names}
    values |= {name: entries.get(name, value) for name, value in _SINCE.items()}
    try:
        values["flaws"] = RecordingFlaws(**values["flaws"])
        return StreetConfig(**values)
    except (OptionError, TypeError) as error:
        raise DataError(file, f"holds no config of a street ({error})", _REMEDY) from error


def _interpolate(corners: Float32[ndarray, "n 3 3"], u: Float32[ndarray, " n"], v: Float32[ndarray, " n"]) -> ndarray:
    weights = np.stack([1 - u - v, u, v], axis=1)
    return np.einsum("nk,nkd->nd", weights, corners)


def _name_parts(
    families: ndarray, kinds: ndarray, materials: ndarray, texcoords: ndarray, points: ndarray, normals: ndarray
) -> tuple[ndarray, ndarray, ndarray]:
    """Coarse parts, fine parts and ground cells as numbers that stay the same in every photo."""
    coarse, fine, cells = (np.zeros(len(families), np.int64) for _ in range(3))
    side = _find_sides(normals)
    y, z = texcoords.T[1:]

    ground = families == GROUND
    cells[ground] = 1 + _number_cells(points[ground, :2], GROUND_CELL)
    painted = ground & np.isin(kinds, (PAINTED_LINE, STRIPES))
    coarse[ground] = 1 + painted[ground]
    fine[ground & ~painted] = 10 + _number_cells(points[ground & ~painted, 1:2], ROAD_CELL)

    house = families == HOUSE
    is_roof = (kinds == ROOF) | (normals[:, 2] > 0.7)
    coarse[house] = np.where(is_roof, 1, 2 + side)[house]
    along = np.where(np.abs(normals[:, 0]) > np.abs(normals[:, 1]), points[:, 1], points[:, 0])
    storey = np.floor(points[:, 2] / STOREY).astype(np.int64) + 50
    bay = np.where(kinds == WINDOW, 1 + np.floor(along / BAY).astype(np.int64) + 500, 0)
    fine[house] = ((coarse * 100 + storey) * 2000 + bay)[house]

    plant = families == VEGETATION
    coarse[plant] = np.where(kinds == BARK, 1, 2)[plant]
    crown = plant & (kinds != BARK)
    fine[crown] = 10 + _number_cells(points[crown], CROWN_CELL)

    vehicle = families == VEHICLE
    is_wheel = (kinds == RIM) | ((kinds == 0) & (z < 0.75) & (np.abs(normals[:, 2]) < 0.95))
    named = [(kinds == CAR_GLASS, 1), (is_wheel, 2), (kinds == SHUTTER, 3)]
    coarse[vehicle] = np.select([mask for mask, _ in named], [number for _, number in named], 4)[vehicle]
    third = np.clip(np.floor(y / 1.5), -4, 4).astype(np.int64) + 5
    fine[vehicle] = (100 * coarse + 10 * side + third + 1000 * (kinds == LAMP))[vehicle]

    person = families == PERSON
    coarse[person] = np.digitize(z, (0.85, 1.45))[person] + 1

    other = families == OTHER
    coarse[other] = 1 + materials[other].astype(np.int64)
    return coarse, fine, cells


def _find_sides(normals: ndarray) -> ndarray:
    """Which way a surface faces: 0 … 3 for the horizontal quarters, 4 = up or down."""
    quarter = np.where(
        np.abs(normals[:, 0]) > np.abs(normals[:, 1]), (normals[:, 0] > 0).astype(int), 2 + (normals[:, 1] > 0)
    )
    return np.where(np.abs(normals[:, 2]) > 0.8, 4, quarter).astype(np.int64)


def _number_cells(places: ndarray, size: float) -> ndarray:
    """One number for each cell of a grid."""
    number = np.zeros(len(places), np.int64)
    for column in np.floor(places / size).astype(np.int64).T:
        number = number * 4096 + (column + 2048)
    return number
