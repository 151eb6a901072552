"""What the paper's tables are made of: cells, each one step of work with a name, needs and a cost.

A method's cell is (clip, cameras, masks, method, variant), written ``street-7/6/sam-v1/opengaussian``. All methods of a
clip and camera set learn on the Gaussians of one geometry cell, from the masks of one masks cell.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, Literal

from instdrive_core.errors import OptionError
from instdrive_core.training.instances.mask_weights import PIXELS_PER_VIEW
from instdrive_core.training.settings.config import (
    InstanceConfig,
    Method,
    TrainConfig,
    build_train_config,
    keep_geometry,
)

Kind = Literal["clip", "masks", "geometry", "method", "figure"]

TUNED_ON = (7, 11)
"""Seeds of synthetic streets on which settings were chosen."""
HEADLINE_SEEDS = (23, 29)
"""Streets of the headline, on which nothing was chosen."""
TUNED_STREET_SEED = TUNED_ON[0]
STREET = f"street-{TUNED_STREET_SEED}"
"""The standard synthetic clip: of ablations and details, never of the headline."""
PANDASET = "pandaset-002"
CAMERA_SETS = ("1", "3", "6")
METHODS: tuple[Method, ...] = ("gaussian-grouping", "opengaussian", "mask-graph", "paper", "instdrive")
PUBLISHED_TOO = ("gaussian-grouping", "opengaussian", "mask-graph", "paper")
"""Methods with two rows: as published, and with the actor nodes and spatial components of ours."""
SCALED = "scaled"
"""Variant of `paper` whose feature rate grows as its schedule shrinks."""
FULL_LENGTH = "full"
"""Variant of `paper` with the paper's own number of steps, on frozen geometry."""
LOSSES = "losses"
"""Variant of `instdrive` whose features are trained by its losses."""
ABLATIONS = ("no-voxel", "no-pseudo", "d6", "d8", "d10")
PRINTED_DIM, PRINTED_ITERATIONS = 8, 30_000
FIGURES = ("cameras", "lidar", "cutouts")


@dataclass(frozen=True)
class Scale:
    """How large everything is. The miniature shows in minutes that all of it works; its figures mean nothing."""

    name: str = "full"
    steps: int = 20
    """Time steps of a synthetic clip."""
    width: int = 480
    """Pixels of its photos."""
    height: int = 270
    lidar_azimuths: int = 1000
    first_frame: int | None = None
    """Part of the PandaSet clip."""
    last_frame: int | None = None
    image_scale: float | None = None
    """Scale at which the PandaSet clip's photos are read."""
    geometry_iterations: int | None = None
    """None = those of the preset."""
    instance_iterations: int | None = None
    max_gaussians: int | None = None
    cost: float = 1.0
    """Expected seconds of a cell ÷ those at full scale."""


FULL = Scale()
MINIATURE = Scale(
    name="miniature",
    steps=6,
    width=96,
    height=54,
    lidar_azimuths=120,
    first_frame=42,
    last_frame=46,
    image_scale=0.05,
    geometry_iterations=60,
    instance_iterations=40,
    max_gaussians=4_000,
    cost=0.2,
)


@dataclass(frozen=True)
class Cell:
    """One step of work, done by a process of its own."""

    name: str
    kind: Kind
    clip: str
    cameras: str = "6"
    masks: str = ""
    method: Method = "instdrive"
    variant: str = ""
    """Changes of the configuration joined by ``+``; empty = as the method's default."""
    needs: tuple[str, ...] = ()
    """Names of the cells whose outcome it takes, nearest first."""
    seconds: float = 0.0
    """What it is expected to take on 2 cores."""
    optional: bool = False
    """Done only where it is asked for."""

    @property
    def published_too(self) -> bool:
        """Whether it has the row `as published`: competitors as they are, not the ablations of them."""
        return self.method in PUBLISHED_TOO and self.variant in ("", SCALED, FULL_LENGTH)

    @property
    def slug(self) -> str:
        """Its name as a file name."""
        return self.name.replace("/", "_")


def find_street_seed(clip: str) -> int | None:
    """The seed of a synthetic street; None for recorded clips."""
    return int(clip.removeprefix("street-")) if clip.startswith("street-") else None


def method_name(clip: str, cameras: str, masks: str, method: str, variant: str = "") -> str:
    """The name of a method's cell."""
    return f"{clip}/{cameras}/{masks}/{method}" + (f"+{variant}" if variant else "")


def plan(scale: Scale = FULL) -> tuple[Cell, ...]:
    """All cells, optional ones too; each comes after those that it needs."""
    cells = [cell for seed in (TUNED_STREET_SEED, *HEADLINE_SEEDS) for cell in _prepare(f"street-{seed}", ("sam-v1",))]
    cells += _prepare(PANDASET, ("annotations", "lidar"))
    compared = [(STREET, cameras, "sam-v1") for cameras in reversed(CAMERA_SETS)]
    compared += [(f"street-{seed}", "6", "sam-v1") for seed in HEADLINE_SEEDS]
    compared += [(PANDASET, "6", "annotations")]
    for clip, cameras, masks in compared:
        cells.append(_geometry(clip, cameras, masks))
        cells += [_method(clip, cameras, masks, method) for method in reversed(METHODS)]
        cells.append(_method(clip, cameras, masks, "paper", SCALED))
        if cameras == "6":
            cells.append(replace(_method(clip, cameras, masks, "paper", FULL_LENGTH), optional=True))
    cells += [_method(PANDASET, "6", "lidar", method) for method in ("instdrive", "opengaussian")]
    cells.append(_method(STREET, "6", "sam-v1", "instdrive", LOSSES))
    for change in ABLATIONS:
        cells.append(_method(STREET, "6", "sam-v1", "instdrive", f"{LOSSES}+{change}"))
        if change != f"d{PRINTED_DIM}":
            cells.append(_method(STREET, "6", "sam-v1", "paper", f"{SCALED}+{change}"))
    return tuple(replace(cell, seconds=scale.cost * cell.seconds) for cell in (*cells, *_figures()))


def _prepare(clip: str, masks: Sequence[str]) -> list[Cell]:
    made = [
        Cell(f"{clip}/{each}", "masks", clip, masks=each, needs=(clip,), seconds=_MASKS.get(each, 10)) for each in masks
    ]
    return [Cell(clip, "clip", clip, seconds=60 if find_street_seed(clip) is not None else 1), *made]


def _geometry(clip: str, cameras: str, masks: str) -> Cell:
    needs = (f"{clip}/{masks}", clip)
    return Cell(f"{clip}/{cameras}/geometry", "geometry", clip, cameras, masks, needs=needs, seconds=300)


def _method(clip: str, cameras: str, masks: str, method: Method, variant: str = "") -> Cell:
    needs = (f"{clip}/{cameras}/geometry", f"{clip}/{masks}", clip)
    name = method_name(clip, cameras, masks, method, variant)
    cell = Cell(name, "method", clip, cameras, masks, method, variant, needs)
    in_geometry = method == "instdrive" and not variant and masks != "lidar"
    seconds = (
        0 if in_geometry else _INSTANCES[method] * (_FULL_LENGTH if variant == FULL_LENGTH else 1)
    ) + _EVALUATION * (2 if cell.published_too else 1)
    seconds += _REFERENCE if method == "instdrive" and not variant else 0
    return replace(cell, seconds=seconds * _SHARE_OF_CAMERAS[cameras])


def _figures() -> list[Cell]:
    def runs(clip: str, masks: str, *methods: tuple[Method, str]) -> tuple[str, ...]:
        return tuple(method_name(clip, "6", masks, *each) for each in methods)

    ours: tuple[Method, str] = ("instdrive", "")
    grouping: tuple[Method, str] = ("gaussian-grouping", "")
    opengaussian: tuple[Method, str] = ("opengaussian", "")
    without_voxel: tuple[Method, str] = ("instdrive", f"{LOSSES}+no-voxel")
    of_lidar = runs(STREET, "sam-v1", grouping, opengaussian, without_voxel, ("instdrive", LOSSES), ours)
    return [
        _figure("cameras", PANDASET, runs(PANDASET, "annotations", grouping, opengaussian, ours)),
        _figure("cameras", STREET, runs(STREET, "sam-v1", grouping, opengaussian, ours)),
        _figure("lidar", STREET, of_lidar),
        _figure("cutouts", STREET, runs(STREET, "sam-v1", ours)),
    ]


def _figure(figure: str, clip: str, needs: tuple[str, ...]) -> Cell:
    return Cell(f"figure/{figure}/{clip}", "figure", clip, variant=figure, needs=(*needs, clip), seconds=15)


_EVALUATION, _REFERENCE = 25.0, 25.0
_MASKS = {"annotations": 40.0, "lidar": 60.0}
_INSTANCES = {"gaussian-grouping": 500.0, "opengaussian": 350.0, "mask-graph": 15.0, "paper": 350.0, "instdrive": 60.0}
_FULL_LENGTH = 7.0
"""Cost of the paper's own number of steps ÷ that of a short run's."""
_SHARE_OF_CAMERAS = {"1": 0.6, "3": 0.75, "6": 1.0}
"""Cost with so many cameras as a share of the cost with six."""


def build_cell_config(cell: Cell, scale: Scale) -> TrainConfig:
    """What a geometry's or method's cell trains with: the `quick` preset, changed as its variant says.

    Other methods than ours see as many pixels of a photo as ours does.

    Raises OptionError for an unknown variant.
    """
    config = build_train_config(cell.method, "quick")
    if scale.geometry_iterations is not None:
        config = replace(config, geometry=replace(config.geometry, iterations=scale.geometry_iterations))
    if scale.instance_iterations is not None:
        config = replace(config, instances=replace(config.instances, iterations=scale.instance_iterations))
    if scale.max_gaussians is not None:
        config = replace(
            config,
            init=replace(config.init, lidar_points=scale.max_gaussians // 2, near_points=200, far_points=200),
            densify=replace(config.densify, max_gaussians=scale.max_gaussians),
        )
    if cell.kind == "geometry":
        return config
    config = keep_geometry(config)
    instances = config.instances
    if cell.method != "instdrive":
        instances = replace(instances, pixels_per_view=PIXELS_PER_VIEW)
    for change in filter(None, cell.variant.split("+")):
        instances = _change(instances, change, scale)
    # The second row of every method has our actor nodes; what is published of it is read from its codewords alone.
    return replace(config, instances=replace(instances, whole_actors=True))


def _change(instances: InstanceConfig, change: str, scale: Scale) -> InstanceConfig:
    if change == FULL_LENGTH:
        # A miniature is told from the short run by its length, too.
        steps = PRINTED_ITERATIONS if scale.geometry_iterations is None else 2 * scale.geometry_iterations
        return replace(instances, iterations=steps)
    if change == SCALED:
        return replace(instances, feature_lr=instances.feature_lr * PRINTED_ITERATIONS / instances.iterations)
    if change == LOSSES:
        return replace(instances, learned_by="losses")
    if change == "no-voxel":
        return replace(instances, voxel_weight=0.0)
    if change == "no-pseudo":
        return replace(instances, pseudo_weight=0.0)
    if change.startswith("d") and change[1:].isdecimal():
        return replace(instances, feature_dim=int(change[1:]))
    raise OptionError(f"unknown variant {change!r}; there are {', '.join((SCALED, FULL_LENGTH, LOSSES, *ABLATIONS))}")


def learning_settings(config: TrainConfig) -> dict[str, Any]:
    """The part of a configuration that says how instances are learned, as plain values."""
    settings = config.to_json()
    return {part: settings[part] for part in ("instances", "graph") if part in settings}


def cell_keys(cells: Iterable[Cell], scale: Scale, recorded: str) -> dict[str, str]:
    """The key of each cell's outcome: a hash of its own settings and of the keys of what it needs.

    `recorded` is the folder of the recorded clip. A geometry's key leaves out how instances are learned: other
    settings of these do not make other Gaussians.
    """
    keys: dict[str, str] = {}
    for cell in cells:
        facts: dict[str, object] = {
            "kind": cell.kind,
            "scale": scale.name,
            "needs": [keys[name] for name in cell.needs],
        }
        if cell.kind == "clip":
            facts |= asdict(scale) | {
                "cost": None,
                "clip": cell.clip if find_street_seed(cell.clip) is not None else recorded,
            }
        elif cell.kind in ("geometry", "method"):
            config = build_cell_config(cell, scale)
            settings = config.to_json()
            if cell.kind == "geometry":
                settings = {name: part for name, part in settings.items() if name not in learning_settings(config)}
            facts |= {"cameras": cell.cameras, "train": settings}
        else:
            facts |= {"masks": cell.masks, "figure": cell.variant}
        text = json.dumps(facts, sort_keys=True)
        keys[cell.name] = hashlib.sha256(text.encode()).hexdigest()[:12]
    return keys


def choose_cells(cells: Sequence[Cell], patterns: Sequence[str], optional: bool = False) -> tuple[Cell, ...]:
    """The cells whose name contains one of the patterns (``*`` matches anything), and all that they need.

    All where there is no pattern, optional ones only where `optional`. Raises OptionError for a pattern without a cell.
    """
    if not patterns:
        return tuple(cell for cell in cells if optional or not cell.optional)
    wanted: set[str] = set()
    for pattern in patterns:
        found = {cell.name for cell in cells if fnmatchcase(cell.name, f"*{pattern}*")}
        if not found:
            raise OptionError(f"no cell's name contains {pattern!r}; --list shows them all")
        wanted |= found
    for cell in reversed(cells):
        if cell.name in wanted:
            wanted |= set(cell.needs)
    return tuple(cell for cell in cells if cell.name in wanted)
