"""A document with every part filled, and for each kind of edit one that changes it."""

from copy import deepcopy
from functools import cache

import numpy as np
from random_scene import random_scene, random_track

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.kinds.visibility import HideInstances, LockInstances
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky

ROAD, CAR, PAIR, TAXI, BUS, POLE, SIGN = range(1, 8)
"""Instances: a parked car, a pair of things apart from one another, two that drive, a hidden one, a locked one."""
HALF = 0.5**0.5


def rich_document() -> Document:
    """About 2,000 splats on a road, with actors, photos, sky, exposures, extra columns, moves, colours and states."""
    document = Document(deepcopy(_rich_scene()))
    document.open_scene = lambda path: random_scene(seed=1, count=15, instances=2, actors=1)
    for edit in (
        TurnScene((HALF, 0.0, 0.0, HALF)),
        MoveInstances((PAIR,), (0.5, 0.0, 0.0)),
        RecolorInstances((PAIR,), "tint", (0.1, 0.6, 0.3)),
        SetAdjustment((CAR, PAIR), "hue", 40.0),
        SetAdjustment((CAR,), "opacity", 0.9),
        HideInstances((POLE,)),
        LockInstances((SIGN,)),
        SelectInstances((CAR,)),
    ):
        document.apply(edit)
    return document


EXAMPLES = {
    "absorb_floaters": {"id": CAR},
    "adjust_instances": {"ids": [CAR], "what": "brightness", "amount": 1.5},
    "complete_instance": {"id": CAR, "place": [0.0, 2.0], "heading": 0.1, "side": -1},
    "compound": {"edits": [{"kind": "select_none"}, {"kind": "show_all"}], "name": "two at once"},
    "delete_instances": {"ids": [PAIR, TAXI]},
    "delete_rows": {"rows": [[3, 2], [9, 4]]},
    "delete_selected": {},
    "duplicate_instances": {"ids": [CAR, TAXI], "translation": [1.0, 2.0, 0.0]},
    "fill_hole": {
        "cells": [[along, across] for along in range(3) for across in range(2)],
        "corner": [-2.0, -2.0],
        "along": [0.0, 1.0],
        "size": 0.4,
        "plane": [0.0, 0.0, 0.0],
    },
    "find_objects": {"gap": 0.4},
    "grow_selection": {"distance": 0.5},
    "hide_instances": {"ids": [CAR, BUS]},
    "hide_rows": {"rows": [[3, 2], [9, 4]]},
    "insert_scene": {"path": "other.ply", "translation": [1.0, 0.0, 0.0]},
    "invert_selection": {},
    "lay_shadow": {"id": CAR, "contact": 0.5, "sun": [0.5, 0.2], "sun_share": 0.4},
    "lock_instances": {"ids": [TAXI]},
    "merge_instances": {"ids": [PAIR], "into": CAR},
    "move_instances": {"ids": [CAR, TAXI], "translation": [1.0, 0.0, 0.0], "scale": 1.5, "time": 0.1},
    "paint_instances": {"ids": [CAR, BUS], "color": [0.9, 0.1, 0.1], "tolerance": 0.3, "reference": [0.5, 0.4, 0.3]},
    "reassign_selected": {"into": None},
    "recolor_instances": {"ids": [CAR, BUS], "mode": "hue", "color": [0.2, 0.1, 0.9]},
    "relabel_rows": {
        "found_by": "split_instance",
        "parts": [[[3, 2]], [[9, 4]]],
        "into": [None, CAR],
        "like": PAIR,
        "classes": ["Van", ""],
    },
    "rename_instance": {"id": CAR, "name": "old timer"},
    "reset_colors": {"ids": [PAIR]},
    "reset_moves": {"ids": [PAIR]},
    "select_all": {},
    "select_class": {"class_name": "Car", "mode": "remove"},
    "select_codeword": {"codeword": 11, "mode": "add"},
    "select_instances": {"ids": [ROAD]},
    "select_none": {},
    "select_rows": {"rows": [[0, 30]], "mode": "add"},
    "set_adjustment": {"ids": [CAR, PAIR], "what": "contrast", "amount": 1.5},
    "set_class": {"ids": [PAIR, ROAD], "class_name": "Thing"},
    "set_instance_class": {"id": PAIR, "class_name": "Thing"},
    "set_path": {"id": TAXI, "keys": [[0.0, 0.0, 0.0], [0.2, 1.0, 0.5]]},
    "show_all": {},
    "shrink_selection": {"distance": 0.5},
    "solo_instances": {"ids": [CAR, TAXI]},
    "split_instance": {"id": PAIR, "gap": 0.5},
    "start_driving": {"id": CAR, "keys": [[0.0, 2.0, 0.0], [0.3, 3.0, 0.0, 0.1]]},
    "turn_scene": {"rotation": [0.9, 0.1, 0.2, 0.3], "scale": 0.5},
}
"""By kind, the parameters of an edit that changes `rich_document`."""


@cache
def _rich_scene() -> Scene:
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.arange(-4, 4, 0.2), np.arange(-4, 4, 0.2))
    road = np.c_[x.ravel(), y.ravel(), rng.normal(0, 0.004, x.size)]
    parts = [
        (ROAD, 0, road),
        (CAR, 0, _fill_box(rng, 300, [1.6, 2.4, 1.4], [2.0, 0.0, 0.75])),
        (ROAD, 0, _fill_box(rng, 12, [0.6, 0.8, 0.4], [2.0, 0.0, 0.75])),
        (PAIR, 0, _fill_box(rng, 60, [0.5, 0.5, 0.5], [-3.0, 2.0, 0.4])),
        (PAIR, 0, _fill_box(rng, 50, [0.5, 0.5, 0.5], [-3.0, -3.0, 0.4])),
        (POLE, 0, _fill_box(rng, 20, [0.1, 0.1, 1.5], [-1.0, 3.0, 0.8])),
        (SIGN, 0, _fill_box(rng, 20, [0.4, 0.1, 0.4], [-1.0, 3.0, 1.8])),
        (TAXI, 1, _fill_box(rng, 40, [1.8, 4.0, 1.4], [0.0, 0.0, 0.0])),
        (BUS, 2, _fill_box(rng, 40, [2.4, 8.0, 3.0], [0.0, 0.0, 0.0])),
        (0, 0, _fill_box(rng, 80, [0.5, 0.5, 0.6], [3.0, 3.0, 0.45])),
    ]
    means = np.concatenate([points for _, _, points in parts])
    ids = np.concatenate([np.full(len(points), number, np.uint32) for number, _, points in parts])
    nodes = np.concatenate([np.full(len(points), node, np.uint16) for _, node, points in parts])
    codewords = (ids % 3 + 10).astype(np.uint32)
    gaussians = _make_gaussians(rng, means, ids)
    names, classes = {CAR: "old car", TAXI: "taxi"}, {CAR: "Car", TAXI: "Car"}
    views = tuple(_look_down(index) for index in range(4))
    exposures = rng.normal(0, 0.1, (4, 3, 4)).astype(np.float32)
    keys = tuple(f"{view.name}/{index:02d}" for index, view in enumerate(views))
    return Scene(
        gaussians,
        ids,
        codewords,
        nodes,
        build_instance_table(ids, gaussians.means, codewords, nodes, names, classes),
        (random_track(rng, "taxi"), random_track(rng, "bus", 0.2)),
        Sky(rng.random((6, 4, 4, 3)).astype(np.float32)),
        views,
        np.array([500000.0, 4.2e6, 12.5]),
        code_bits=4,
        extra={"confidence": rng.random(len(ids)).astype(np.float32), "mark": (ids % 5).astype(np.uint8)},
        exposures=Exposures(keys, np.array([view.time for view in views]), exposures),
    )


def _fill_box(rng, count, size, center):
    return rng.uniform(-0.5, 0.5, (count, 3)) * size + center


def _make_gaussians(rng, means, ids):
    count, on_road = len(means), (means[:, 2] < 0.05) & (ids == ROAD)
    colors = np.where(on_road[:, None], [0.4, 0.4, 0.42], [0.7, 0.2, 0.1]) + rng.normal(0, 0.03, (count, 3))
    return Gaussians(
        means.astype(np.float32),
        np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        np.log(np.where(on_road[:, None], [0.13, 0.13, 0.015], [0.08, 0.08, 0.08])).astype(np.float32),
        logit(np.full(count, 0.9)).astype(np.float32),
        dc_from_color(np.clip(colors, 0, 1)).astype(np.float32),
        rng.normal(0, 0.05, (count, 3, 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
    )


def _look_down(index):
    eye = np.array([-3.0 + index, -5.0 + index, 4.0])
    camera = Camera(150.0, 150.0, 100.0, 60.0, 200, 120, look_at(eye, np.zeros(3)))
    return CameraView(camera, "front_camera", index, 0.1 * index, photo=f"photos/{index:02d}.jpg")
