"""What drives, as an OpenSCENARIO file: each vehicle follows a polyline with times, in the data set's world."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.atomic import write_bytes
from instdrive_core.formats.objects.scene_objects import SceneObject, choose_unique_names
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

EGO = "Ego"
"""The recording car's name in scenarios."""
_MINOR = 1
"""OpenSCENARIO 1.1: the first version in which trajectories have their present form; newer programs read it."""
_WRITTEN = datetime(2000, 1, 1)
"""Date in each file: equal scenes give equal files."""
_EGO_SIZE = (1.9, 4.6, 1.6)
_CATEGORIES = {
    "truck": "truck",
    "bus": "bus",
    "van": "van",
    "trailer": "trailer",
    "motor": "motorbike",
    "bicycl": "bicycle",
}
"""Parts of class names, and what OpenSCENARIO calls these vehicles; others are cars."""


def write_scenario(path: Path, scene: Scene, objects: Sequence[SceneObject], ego: Track | None) -> None:
    """Write the ways of objects as one .xosc file, atomically.

    An entity's reference point lies below the middle of its track's box. Each vertex of its polyline is a pose of the
    track, with its time in seconds since the clip's first time step.

    Args:
        path: the file.
        scene: whose origin is added.
        objects: those that have a track.
        ego: way of the recording car: x right, y forward; None leaves it out.

    Raises DataError where nothing drives, MissingExtraError without the package scenariogeneration.
    """
    xosc = _load_xosc()
    tracks = [(name, entry.track) for name, entry in zip(choose_unique_names(objects, (EGO,)), objects, strict=True)]
    ways = [*([] if ego is None else [(EGO, ego)]), *((name, track) for name, track in tracks if track is not None)]
    if not ways:
        raise DataError(path, "nothing in the scene drives", "Write a .json or .glb, which have what stands")
    entities, init = xosc.Entities(), xosc.Init()
    act = xosc.Act("drive", _begin_at_once(xosc, "drive"))
    for name, track in ways:
        size = _EGO_SIZE if name == EGO else tuple(track.dimensions.tolist())
        entities.add_scenario_object(name, _build_entity(xosc, name, track.label, size))
        places = _list_positions(xosc, track, scene.origin, None if name == EGO else size[2])
        init.add_init_action(name, xosc.TeleportAction(places[0]))
        if len(places) > 1:
            act.add_maneuver_group(_follow(xosc, name, track.times.tolist(), places))
    story = xosc.StoryBoard(init)
    story.add_act(act)
    scenario = xosc.Scenario(
        "drive",
        "instdrive",
        xosc.ParameterDeclarations(),
        entities,
        story,
        xosc.RoadNetwork(),
        xosc.Catalog(),
        osc_minor_version=_MINOR,
        creation_date=_WRITTEN,
    )
    element = scenario.get_element()
    ElementTree.indent(element)
    write_bytes(path, ElementTree.tostring(element, encoding="utf-8", xml_declaration=True) + b"\n")


def _follow(xosc: Any, name: str, times: list[float], places: list[Any]) -> Any:
    """A group in which an entity follows its polyline from the start, at absolute times."""
    line = xosc.Trajectory(f"way of {name}", False)
    line.add_shape(xosc.Polyline(times, places))
    action = xosc.FollowTrajectoryAction(line, xosc.FollowingMode.position, xosc.ReferenceContext.absolute, 1, 0)
    event = xosc.Event(f"{name} drives", xosc.Priority.overwrite)
    event.add_action(f"{name} follows its way", action)
    event.add_trigger(_begin_at_once(xosc, f"{name} begins"))
    maneuver = xosc.Maneuver(f"{name} drives")
    maneuver.add_event(event)
    group = xosc.ManeuverGroup(f"{name} drives")
    group.add_actor(name)
    group.add_maneuver(maneuver)
    return group


def _begin_at_once(xosc: Any, name: str) -> Any:
    start = xosc.SimulationTimeCondition(0, xosc.Rule.greaterOrEqual)
    return xosc.ValueTrigger(name, 0, xosc.ConditionEdge.none, start)


def _list_positions(xosc: Any, track: Track, origin: Float64[ndarray, "3"], height: float | None) -> list[Any]:
    """Where the reference point is at each pose of a track; its height is left to the road where `height` is None."""
    places = track.world_from_box[:, :3, 3] + origin
    headings = np.arctan2(track.world_from_box[:, 1, 1], track.world_from_box[:, 0, 1])
    return [
        xosc.WorldPosition(x, y, None if height is None else z - height / 2, heading)
        for (x, y, z), heading in zip(places.tolist(), headings.tolist(), strict=True)
    ]


def _build_entity(xosc: Any, name: str, label: str, size: Sequence[float]) -> Any:
    width, length, height = (max(float(side), 0.1) for side in size)
    box = xosc.BoundingBox(width, length, height, 0, 0, height / 2)
    kind = label.lower()
    if "pedestrian" in kind or "person" in kind:
        return xosc.Pedestrian(name, 75, xosc.PedestrianCategory.pedestrian, box)
    category = next((found for part, found in _CATEGORIES.items() if part in kind), "car")
    wheel, reach = min(0.7, 0.5 * height), 0.3 * length
    front = xosc.Axle(math.pi / 6, wheel, 0.9 * width, reach, wheel / 2)
    rear = xosc.Axle(0, wheel, 0.9 * width, -reach, wheel / 2)
    return xosc.Vehicle(name, getattr(xosc.VehicleCategory, category), box, front, rear, 70, 10, 10)


def _load_xosc() -> Any:
    try:
        return importlib.import_module("scenariogeneration.xosc")
    except ModuleNotFoundError as error:
        raise explain_missing_module(error) or error from error
