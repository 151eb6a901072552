"""A street as geometry: what stands, what moves, and who is who. Nothing is rendered or written here."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int32, UInt8
from numpy import ndarray

from instdrive_core.datasets.synthetic.world.light import Light
from instdrive_core.datasets.synthetic.world.materials import MaterialTable
from instdrive_core.datasets.synthetic.world.mesh import TriangleMesh, build_planar_pose, join_meshes
from instdrive_core.datasets.synthetic.world.pace import StopAndGo
from instdrive_core.datasets.synthetic.world.rig import EGO_HEIGHT

MOVING_PATH = 1.0
"""Metres that an object must travel within the clip to count as moving."""

CLASSES = (
    "Smoke", "Exhaust", "Spray or rain", "Reflection", "Vegetation", "Ground", "Road", "Lane Line Marking",
    "Stop Line Marking", "Other Road Marking", "Sidewalk", "Driveway", "Car", "Pickup Truck", "Medium-sized Truck",
    "Semi-truck", "Towed Object", "Motorcycle", "Other Vehicle - Construction Vehicle", "Other Vehicle - Uncommon",
    "Other Vehicle - Pedicab", "Emergency Vehicle", "Bus", "Personal Mobility Device", "Motorized Scooter", "Bicycle",
    "Train", "Trolley", "Tram / Subway", "Pedestrian", "Pedestrian with Object", "Animals - Bird", "Animals - Other",
    "Pylons", "Road Barriers", "Signs", "Cones", "Construction Signs", "Temporary Construction Barriers",
    "Rolling Containers", "Building", "Other Static Object",
)  # fmt: skip
"""PandaSet's semantic classes; number 1 is the first."""


def get_class_number(name: str) -> int:
    """PandaSet's number of a semantic class."""
    return CLASSES.index(name) + 1


@dataclass(frozen=True)
class Route:
    """A way at constant speed, or at a pace that stops and goes.

    `sway` bends it into a gentle S, as a driver who makes room does.
    """

    x: float
    y: float
    yaw: float = 0.0
    """Direction of travel: 0 = +y, counter-clockwise (radians)."""
    speed: float = 0.0
    """Metres per second; 0 where `pace` says how it moves."""
    sway: float = 0.0
    """Greatest sideways offset in metres."""
    sway_length: float = 30.0
    """Metres per S."""
    pace: StopAndGo | None = None
    """How something moves whose speed changes."""

    @property
    def moves(self) -> bool:
        """Whether it ever leaves its place."""
        return self.speed > 0 or self.pace is not None

    def travel(self, time: float) -> float:
        """Metres along the way from time 0 to `time` seconds."""
        return self.speed * time if self.pace is None else self.pace.travel(time)

    def compute_speed(self, time: float) -> float:
        """Metres per second along the way at `time` seconds."""
        return self.speed if self.pace is None else self.pace.compute_speed(time)

    def pose(self, time: float, height: Callable[[float, float], float]) -> Float64[ndarray, "4 4"]:
        """street_from_foot at `time` seconds."""
        distance = self.travel(time)
        phase = 2 * np.pi * distance / self.sway_length
        aside = 0.5 * self.sway * (1 - np.cos(phase))
        turn = np.arctan(0.5 * self.sway * np.sin(phase) * 2 * np.pi / self.sway_length)
        along, across = (-np.sin(self.yaw), np.cos(self.yaw)), (np.cos(self.yaw), np.sin(self.yaw))
        x = self.x + distance * along[0] + aside * across[0]
        y = self.y + distance * along[1] + aside * across[1]
        return build_planar_pose(x, y, height(x, y), self.yaw - turn)


@dataclass(frozen=True)
class Fixture:
    """Something that stands where it is; one instance."""

    mesh: TriangleMesh
    """Triangles in the street's frame."""
    label: str
    """One of `CLASSES`."""
    kind: str = "thing"
    """``thing`` or ``stuff``."""


@dataclass(frozen=True)
class Actor:
    """Something that PandaSet annotates with cuboids: vehicles, people, cones; one instance."""

    label: str
    """One of `CLASSES`, and the cuboids' label."""
    route: Route
    model: Callable[[float], TriangleMesh]
    """The mesh after so many metres, feet or wheels at z = 0."""
    low: Float64[ndarray, "3"]
    high: Float64[ndarray, "3"]
    """Box around the model over its whole cycle of motion, in the model's frame."""
    uuid: uuid.UUID
    motion: str | None = None
    """``Parked``, ``Stopped`` or ``Moving``; vehicles only."""
    behavior: str | None = None
    """``Walking`` or ``Standing``; pedestrians only."""
    rider: str | None = None
    """``With Rider``; bicycles only."""

    @property
    def dimensions(self) -> Float64[ndarray, "3"]:
        """Width, length and height in metres."""
        return self.high - self.low

    @property
    def centre(self) -> Float64[ndarray, "3"]:
        """The box's centre in the model's frame."""
        return 0.5 * (self.low + self.high)


@dataclass(frozen=True)
class StreetInstance:
    """Object or surface that an instance ID stands for."""

    id: int
    label: str
    kind: str
    moving: bool
    uuid: str | None


@dataclass(frozen=True)
class StepGeometry:
    """All triangles of one time step."""

    mesh: TriangleMesh
    """Triangles in the street's frame."""
    instances: Int32[ndarray, " n"]
    """Instance ID per triangle."""


def join_geometries(parts: Sequence[StepGeometry]) -> StepGeometry:
    """Join the triangles of several parts, in order."""
    mesh = join_meshes([part.mesh for part in parts])
    return StepGeometry(mesh, np.concatenate([part.instances for part in parts]))


@dataclass(frozen=True)
class Street:
    """A street and its traffic. IDs: fixtures from 1 in order, then actors."""

    fixtures: tuple[Fixture, ...]
    actors: tuple[Actor, ...]
    ego: Route
    crossing: float
    """y of the crossing street's middle."""
    materials: MaterialTable
    light: Light
    heading: float
    """Angle by which the street is turned in the world (radians)."""
    height: Callable[[float, float], float]
    """Height of the ground at (x, y)."""

    def actor_id(self, index: int) -> int:
        """Instance ID of actor `index`."""
        return len(self.fixtures) + 1 + index

    def instances(self, duration: float) -> list[StreetInstance]:
        """All instances of a clip of `duration` seconds, by rising ID."""
        listed = [StreetInstance(k + 1, f.label, f.kind, False, None) for k, f in enumerate(self.fixtures)]
        for k, actor in enumerate(self.actors):
            moving = actor.route.travel(duration) > MOVING_PATH
            listed.append(StreetInstance(self.actor_id(k), actor.label, "thing", moving, str(actor.uuid)))
        return listed

    def foot_pose(self, actor: Actor, time: float) -> Float64[ndarray, "4 4"]:
        """street_from_model of an actor."""
        return actor.route.pose(time, self.height)

    def box_pose(self, actor: Actor, time: float) -> Float64[ndarray, "4 4"]:
        """street_from_box of an actor; the box frame's origin is the box's centre."""
        shift = np.eye(4)
        shift[:3, 3] = actor.centre
        return self.foot_pose(actor, time) @ shift

    def geometry(self, time: float) -> StepGeometry:
        """The street at `time` seconds."""
        return join_geometries([self.standing, *self.pose_movers(self.model_movers(time), time)])

    def model_movers(self, time: float) -> dict[int, TriangleMesh]:
        """Meshes of what moves, as they are at `time`, in the models' frames; by actor."""
        return {k: actor.model(actor.route.travel(time)) for k, actor in enumerate(self.actors) if actor.route.moves}

    def pose_movers(self, models: dict[int, TriangleMesh], time: float) -> list[StepGeometry]:
        """Put models of what moves where they are at `time`."""
        posed = []
        for k, model in models.items():
            mesh = model.transform(self.foot_pose(self.actors[k], time))
            posed.append(StepGeometry(mesh, np.full(len(mesh), self.actor_id(k), np.int32)))
        return posed

    @cached_property
    def standing(self) -> StepGeometry:
        """Everything that stands still."""
        meshes = [fixture.mesh for fixture in self.fixtures]
        ids = list(range(1, len(meshes) + 1))
        for k, actor in enumerate(self.actors):
            if not actor.route.moves:
                meshes.append(actor.model(0.0).transform(self.foot_pose(actor, 0.0)))
                ids.append(self.actor_id(k))
        owners = np.repeat(np.array(ids, np.int32), [len(mesh) for mesh in meshes])
        return StepGeometry(join_meshes(meshes), owners)

    def semantics(self) -> UInt8[ndarray, " ids"]:
        """PandaSet class by instance ID; 0 for ID 0."""
        labels = [f.label for f in self.fixtures] + [a.label for a in self.actors]
        return np.array([0, *(get_class_number(label) for label in labels)], np.uint8)

    def world_from_street(self) -> Float64[ndarray, "4 4"]:
        """The world's origin is the car's frame at time 0, as in PandaSet; the street is turned against its axes."""
        turned = build_planar_pose(0, 0, 0, self.heading)
        start = self.ego.pose(0.0, self.height)[:3, 3] + [0, 0, EGO_HEIGHT]
        turned[:3, 3] = -turned[:3, :3] @ start
        return turned
