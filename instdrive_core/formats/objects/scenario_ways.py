"""Ways of vehicles in OpenSCENARIO files: polylines with times that an entity is told to follow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.xml_file import parse_xml
from instdrive_core.scene.vehicle_path import PathKey, sample_path

LONGEST_SCENARIO = 16 << 20
"""Bytes; an hour's way of a vehicle, ten times a second, is a third of it."""
MARK = "#"
"""Between a file's name and that of one of its entities."""


@dataclass(frozen=True)
class _Following:
    """An entity that follows a trajectory."""

    entity: str
    action: Element
    parts: tuple[Element, ...]
    """The act and the event around it, whose triggers say when it begins; none for what holds from the start."""


def read_scenario_way(
    name: str, origin: Float64[ndarray, "3"], wanted: Sequence[str], follows_middle: bool = True
) -> tuple[PathKey, ...]:
    """Read the way of an entity: of the one that is named, else of the only one, else of one that is wanted.

    Keys are where the middle of the entity's box is; without a heading at every vertex it heads along its way.

    Args:
        name: of the file, or FILE#ENTITY.
        origin: of the scene, in the file's world (metres).
        wanted: names of entities that are taken where several have ways and none is named.
        follows_middle: False: keys are those of the entity's reference point, whatever its box.

    Raises DataError naming the element that is wrong or of a kind that is not read, OptionError where it is not clear
    whose way is meant.
    """
    file, asked = split_entity(name)
    root = parse_xml(file, LONGEST_SCENARIO)
    followed = list(_list_followings(file, root))
    chosen = _choose(file, followed, asked, wanted)
    reader = _Reader(file, root, f"trajectory of {chosen.entity!r}")
    keys = reader.read_keys(chosen, origin)
    return reader.move_to_middle(keys, chosen.entity) if follows_middle else keys


def split_entity(name: str) -> tuple[Path, str | None]:
    """Split FILE#ENTITY into both; a file that there is may have the mark in its name."""
    if MARK not in name or Path(name).is_file():
        return Path(name), None
    file, _, entity = name.rpartition(MARK)
    return Path(file), entity


def is_scenario(name: str) -> bool:
    """Whether a name, with an entity's or without, is that of an OpenSCENARIO file."""
    return split_entity(name)[0].suffix.lower() == ".xosc"


def _list_followings(file: Path, root: Element) -> Iterator[_Following]:
    if root.tag != "OpenSCENARIO":
        raise DataError(file, f"is <{root.tag[:40]}>, not <OpenSCENARIO>", "Give an OpenSCENARIO XML file (1.x)")
    for private in root.iterfind("Storyboard/Init/Actions/Private"):
        for action in private.iterfind("PrivateAction/RoutingAction/FollowTrajectoryAction"):
            yield _Following(private.get("entityRef", ""), action, ())
    for act in root.iterfind("Storyboard/Story/Act"):
        for group in act.iterfind("ManeuverGroup"):
            for event in group.iterfind("Maneuver/Event"):
                for action in event.iterfind("Action/PrivateAction/RoutingAction/FollowTrajectoryAction"):
                    for actor in group.iterfind("Actors/EntityRef"):
                        yield _Following(actor.get("entityRef", ""), action, (act, event))


def _choose(file: Path, followed: Sequence[_Following], asked: str | None, wanted: Sequence[str]) -> _Following:
    names = list(dict.fromkeys(each.entity for each in followed))
    if not names:
        raise DataError(file, "no entity has a FollowTrajectoryAction", "Give one whose vehicles follow polylines")
    listed = ", ".join(names[:20])
    if asked is not None:
        if asked not in names:
            raise OptionError(f"{file}: {asked!r} follows no trajectory; those that do: {listed}")
        names = [asked]
    elif len(names) > 1:
        fitting = [name for name in names if name in wanted]
        if len(fitting) != 1:
            raise OptionError(f"{file}: which way is meant? Write {file}{MARK}NAME with one of: {listed}")
        names = fitting
    found = [each for each in followed if each.entity == names[0]]
    if len(found) > 1:
        problem = f"{names[0]!r} follows {len(found)} trajectories, one after the other"
        raise DataError(file, problem, "Join them into one polyline")
    return found[0]


@dataclass(frozen=True)
class _Reader:
    """Reads values of one file, with the place in errors."""

    file: Path
    root: Element
    where: str

    def read_keys(self, chosen: _Following, origin: Float64[ndarray, "3"]) -> tuple[PathKey, ...]:
        """The vertices of the polyline, relative to the scene's origin."""
        action = chosen.action
        trajectory = action.find("TrajectoryRef/Trajectory")
        trajectory = action.find("Trajectory") if trajectory is None else trajectory  # version 1.0
        if trajectory is None:
            self._fail("comes from a catalogue", "Write the trajectory into the scenario itself")
        line = trajectory.find("Shape/Polyline")
        if line is None:
            shapes = [part.tag for shape in trajectory.iterfind("Shape") for part in shape]
            self._fail(f"has the shape {shapes[0] if shapes else 'of nothing'}", "Write a Polyline of world positions")
        scale, offset = self._read_timing(chosen)
        keys: list[PathKey] = []
        for number, vertex in enumerate(line.iterfind("Vertex")):
            place = f"Vertex[{number}]"
            position = vertex.find("Position/WorldPosition")
            if position is None:
                kinds = [each.tag for part in vertex.iterfind("Position") for each in part]
                self._fail(f"{place} has {kinds[0] if kinds else 'no position'}", "Write a WorldPosition for each")
            time = scale * self._read_number(vertex, "time", place) + offset
            x, y = (self._read_number(position, axis, f"{place}/Position/WorldPosition") for axis in "xy")
            turn = position.get("h")
            heading = None if turn is None else self._read_number(position, "h", f"{place}/Position/WorldPosition")
            if keys and time <= keys[-1].time:
                self._fail(f"the time of {place} is not above that of the one before", "Sort the vertices by time")
            keys.append(PathKey(time, x - float(origin[0]), y - float(origin[1]), heading))
        if not keys:
            self._fail("has no vertex", "Give each polyline at least one Vertex")
        return tuple(keys)

    def move_to_middle(self, keys: tuple[PathKey, ...], entity: str) -> tuple[PathKey, ...]:
        """From the entity's reference point, such as its rear axle, to the middle of its box."""
        ahead, left = self._find_center(entity)
        if not (ahead or left):
            return keys
        headings = sample_path(keys, np.array([key.time for key in keys])).headings.tolist()
        return tuple(
            PathKey(
                key.time,
                key.x + ahead * math.cos(turn) - left * math.sin(turn),
                key.y + ahead * math.sin(turn) + left * math.cos(turn),
                key.heading,
            )
            for key, turn in zip(keys, headings, strict=True)
        )

    def _find_center(self, entity: str) -> tuple[float, float]:
        """Where the middle of an entity's box is: metres ahead and to the left; 0 where the file does not say."""
        for found in self.root.iterfind("Entities/ScenarioObject"):
            center = found.find("*/BoundingBox/Center")
            if found.get("name") == entity and center is not None:
                place = f"Center of {entity!r}"
                return self._read_number(center, "x", place), self._read_number(center, "y", place)
        return 0.0, 0.0

    def _read_timing(self, chosen: _Following) -> tuple[float, float]:
        """Factor and seconds that make times of vertices those of the scenario."""
        timing = chosen.action.find("TimeReference/Timing")
        if timing is None:
            self._fail("has no Timing, so nothing says when it is where", "Give it a TimeReference with a Timing")
        scale, offset = (self._read_number(timing, name, "Timing") for name in ("scale", "offset"))
        domain = self._read_text(timing, "domainAbsoluteRelative", "Timing")
        if domain not in ("absolute", "relative"):
            self._fail(f"Timing/@domainAbsoluteRelative is {domain[:40]!r}", "Write absolute or relative")
        if domain == "relative":
            offset += max((self._read_start(part) for part in chosen.parts), default=0.0)
        return scale, offset

    def _read_start(self, part: Element) -> float:
        """Second at which an act or event begins."""
        conditions = list(part.iterfind("StartTrigger/ConditionGroup/Condition/*"))
        times = [value for each in conditions for value in each.iterfind("SimulationTimeCondition")]
        if len(times) != len(conditions) or len(times) > 1:
            problem = f"its {part.tag} {part.get('name', '')!r}, from which its times count, begins at no known time"
            self._fail(problem, "Write absolute times, or one SimulationTimeCondition")
        return self._read_number(times[0], "value", "SimulationTimeCondition") if times else 0.0

    def _read_number(self, element: Element, name: str, place: str) -> float:
        text = self._read_text(element, name, place)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            self._fail(f"{place}/@{name} is {text[:40]!r}, expected a number", "Write numbers, not expressions")
        return value

    def _read_text(self, element: Element, name: str, place: str) -> str:
        """An attribute, or what the scenario's parameter holds that it names."""
        text = element.get(name)
        if text is None:
            self._fail(f"{place}/@{name} is missing", "Write it")
        for declared in (
            self.root.iterfind("ParameterDeclarations/ParameterDeclaration") if text.startswith("$") else ()
        ):
            if declared.get("name") == text[1:]:
                return declared.get("value", "")
        return text

    def _fail(self, problem: str, remedy: str) -> NoReturn:
        raise DataError(self.file, f"{self.where}: {problem}", remedy)
