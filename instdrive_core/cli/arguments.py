"""Words of the command line to values of the scene, with errors that name what would have worked."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable

from instdrive_core.errors import OptionError
from instdrive_core.instances.table import InstanceTable
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.scene import Scene

NEAR = 5
"""Near matches named in an error."""


def check_known_ids(ids: Iterable[int], table: InstanceTable) -> tuple[int, ...]:
    """Check that the scene has instances with these IDs; returns them. Raises OptionError for one it does not have."""
    ids = tuple(ids)
    for instance_id in ids:
        if instance_id in table:
            continue
        if not len(table):
            raise OptionError(f"the scene has no instances, so none with ID {instance_id}; train it with masks first")
        near = sorted(sorted(table.instances, key=lambda known: (abs(known - instance_id), known))[:NEAR])
        listed = ", ".join(f"{known} ({table[known].name})" for known in near)
        raise OptionError(f"the scene has no instance {instance_id}; near it are {listed}. `instdrive info` lists all")
    return ids


def parse_color(text: str) -> tuple[float, float, float]:
    """RGB in [0, 1] from ``#rrggbb``. Raises OptionError."""
    if not re.fullmatch(r"#?[0-9a-fA-F]{6}", text):
        raise OptionError(f"{text!r} is not a colour; write it as #rrggbb with hexadecimal digits, e.g. #d02020")
    digits = text.removeprefix("#")
    red, green, blue = (int(digits[place : place + 2], 16) / 255 for place in (0, 2, 4))
    return red, green, blue


def parse_assignment(text: str, example: str) -> tuple[int, str]:
    """ID and value from ``ID=VALUE``. Raises OptionError."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip().isdecimal() or not value:
        raise OptionError(f"{text!r} is not of the form ID=VALUE; write e.g. {example}")
    return int(name), value


def find_named_view(scene: Scene, name: str) -> CameraView:
    """The view called ``camera_name/index``. Raises OptionError naming near matches."""
    if not scene.views:
        raise OptionError(f"the scene keeps no photo cameras, so there is no view {name!r}; use --view orbit")
    by_name = {f"{view.name}/{view.index}": view for view in scene.views}
    camera, slash, index = name.rpartition("/")
    wanted = f"{camera}/{int(index)}" if slash and index.isdecimal() else name
    if wanted in by_name:
        return by_name[wanted]
    near = _find_near_views(scene, camera, int(index)) if index.isdecimal() else []
    near = near or difflib.get_close_matches(wanted, by_name, n=NEAR, cutoff=0.3) or list(by_name)[:NEAR]
    raise OptionError(f"there is no view {name!r}; near it are {', '.join(near)}, and `orbit` shows the whole scene")


def _find_near_views(scene: Scene, camera: str, index: int) -> list[str]:
    """The views of this camera at the nearest time steps."""
    steps = sorted((view.index for view in scene.views if view.name == camera), key=lambda step: abs(step - index))
    return [f"{camera}/{step}" for step in sorted(steps[:NEAR])]


def find_default_time(scene: Scene) -> float:
    """The moment shown when none is asked for: that of the first photo, else the first of any track, else 0."""
    if scene.views:
        return min(view.time for view in scene.views)
    return min((float(actor.times[0]) for actor in scene.actors), default=0.0)


def find_first_camera(scene: Scene, time: float | None) -> Camera | None:
    """The camera with which an exported file opens: of the first photo taken at the time, else at the nearest one.

    Without photos it is that with which the scene itself was opened, which may be none.
    """
    if not scene.views:
        return scene.start
    moment = find_default_time(scene) if time is None else time
    return min(scene.views, key=lambda view: abs(view.time - moment)).camera


def choose_time(scene: Scene, time: float | None) -> float:
    """The seconds that were asked for, else the default. Raises OptionError where they are not finite."""
    if time is not None and not math.isfinite(time):
        raise OptionError(f"--time {time} is no moment; give seconds, e.g. --time 1.5")
    return find_default_time(scene) if time is None else time
