"""Edits of every kind drawn at random for whatever document is there."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from instdrive_core.edits.bases.adjustments import RANGES
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import DataError, EditError
from instdrive_core.scene.selection import Flag

MAX_DELETED = 0.5
"""Share of splats above which hardly anything more is deleted, so that there is something to edit."""
_STILL_DELETED = 0.05
"""Share of draws that may delete all the same."""
ROOM, SPLATS_PER_EDIT = 600, 0.3
"""By so many splats the document may grow, at once and with each edit of its history."""
_ADDING = ("duplicate_instances", "lay_shadow", "complete_instance", "insert_scene", "fill_hole", "start_driving")
_DELETING = ("delete_instances", "delete_selected", "delete_rows")
_MODES = ("replace", "add", "remove")
_CLASSES = ("", "Car", "Bus", "Vegetation")


class RandomEdits:
    """Draws edits for a document; the same seed and history give the same edits.

    Args:
        document: what is edited.
        inserted: a scene that edits may insert, as they name it.
        seed: of all draws.
    """

    def __init__(self, document: Document, inserted: str, seed: int = 0) -> None:
        self._document, self._inserted = document, inserted
        self._first_count = len(document.scene)
        self._rng = np.random.default_rng(seed)
        self._recipes = self._all_recipes()
        self._done = Counter[str]()
        self.kinds = frozenset(self._recipes)
        """Kinds that are drawn."""

    def apply_one(self) -> str:
        """Do one more edit, after as many draws as it takes; now and then undo or redo a few before. Returns its kind.

        Edits of sliders' drags replace the one before, as in the editor.
        """
        rng, document = self._rng, self._document
        if rng.random() < 0.05:
            for _ in range(rng.choice([1, 1, 2, 3, 20])):
                document.undo()
        if rng.random() < 0.02:
            document.redo()
        while True:
            kind = self._kind()
            gesture = f"drag {len(document.history.edits)}" if rng.random() < 0.1 else None
            before = document.history.edits
            try:
                document.apply(edit_from_json({"kind": kind, **self._recipes[kind]()}), gesture)
            except (EditError, DataError):
                continue
            if document.history.edits != before:
                self._done[kind] += 1
                return kind

    def _kind(self) -> str:
        document = self._document
        deleted = len(document.state.find_rows(Flag.DELETED)) / len(document.scene)
        room = self._first_count + ROOM + SPLATS_PER_EDIT * document.history.cursor - len(document.scene)
        is_spared = deleted > MAX_DELETED and self._rng.random() > _STILL_DELETED
        refused = (*(_ADDING if room < 0 else ()), *(_DELETING if is_spared else ()))
        drawn = sorted(self.kinds - set(refused))
        if self._rng.random() < 0.1:
            # Some kinds seldom fit: they are tried more often.
            return min(drawn, key=lambda kind: self._done[kind])
        return str(self._rng.choice(drawn))

    def _all_recipes(self) -> dict[str, Callable[[], dict[str, Any]]]:
        one, ids, pick = self._one, self._ids, self._pick
        return {
            "absorb_floaters": lambda: {"id": one()},
            "adjust_instances": lambda: {"ids": ids(), **self._adjustment()},
            "complete_instance": self._completion,
            "compound": self._compound,
            "delete_instances": lambda: {"ids": ids()},
            "delete_rows": lambda: {"rows": self._runs(scattered=0)},
            "delete_selected": dict,
            "duplicate_instances": lambda: {"ids": ids(), "translation": self._shift()},
            "fill_hole": self._hole,
            "find_objects": lambda: {"gap": pick((0.3, 0.6)), "unit": pick((None, 1.0))},
            "grow_selection": lambda: {"distance": pick((None, 0.2, 1.0)), "time": self._float(0, 0.5)},
            "hide_instances": lambda: {"ids": ids(), "hidden": pick((True, False))},
            "hide_rows": lambda: {"rows": self._runs(scattered=0), "hidden": pick((True, False))},
            "insert_scene": lambda: {"path": self._inserted, "translation": self._shift()},
            "invert_selection": dict,
            "lay_shadow": self._shadow,
            "lock_instances": lambda: {"ids": ids(), "locked": pick((True, False, False))},
            "merge_instances": lambda: {"ids": (chosen := ids()), "into": pick(chosen)},
            "move_instances": self._move,
            "reassign_selected": lambda: {"into": pick((None, 0, one()))},
            "paint_instances": lambda: {
                "ids": ids(),
                "color": [self._float(0, 1) for _ in range(3)],
                "tolerance": self._float(0, 1),
                "reference": pick((None, [self._float(0, 1) for _ in range(3)])),
            },
            "recolor_instances": lambda: {
                "ids": ids(),
                "mode": pick(("tint", "solid", "hue")),
                "color": [self._float(0, 1) for _ in range(3)],
            },
            "relabel_rows": lambda: {
                "found_by": pick(("absorb_floaters", "split_instance")),
                "parts": [self._runs(scattered=0)],
                "into": [pick((None, one()))],
                "like": one(),
            },
            "rename_instance": lambda: {"id": one(), "name": f"name {self._rng.integers(1000)}"},
            "reset_colors": lambda: {"ids": ids()},
            "reset_moves": lambda: {"ids": ids()},
            "select_all": dict,
            "select_class": lambda: {"class_name": pick(_CLASSES), "mode": pick(_MODES)},
            "select_codeword": lambda: {"codeword": pick((10, 11, 12)), "mode": pick(_MODES)},
            "select_instances": lambda: {"ids": ids(), "mode": pick(_MODES)},
            "select_none": dict,
            "select_rows": lambda: {"rows": self._runs(), "mode": pick(_MODES)},
            "set_adjustment": lambda: {"ids": ids(), **self._adjustment()},
            "set_class": lambda: {"ids": ids(), "class_name": pick(_CLASSES)},
            "set_instance_class": lambda: {"id": one(), "class_name": pick(_CLASSES)},
            "set_path": lambda: {"id": one(), "keys": self._way()},
            "show_all": dict,
            "shrink_selection": lambda: {"distance": pick((None, 0.2)), "time": self._float(0, 0.5)},
            "solo_instances": lambda: {"ids": ids()},
            "split_instance": lambda: {"id": one(), "gap": pick((0.25, 1.0, 3.0))},
            "start_driving": lambda: {"id": one(), "keys": self._way()},
            "turn_scene": self._turn,
        }

    def _pick(self, values: Any) -> Any:
        return values[self._rng.integers(len(values))]

    def _float(self, low: float, high: float) -> float:
        return float(self._rng.uniform(low, high))

    def _one(self) -> int:
        return self._pick(sorted(self._document.scene.table.instances) or [1])

    def _ids(self) -> list[int]:
        return sorted({self._one() for _ in range(self._rng.integers(1, 4))})

    def _shift(self) -> list[float]:
        return self._rng.normal(0, 1, 3).tolist() if self._rng.random() < 0.8 else [0.0, 0.0, 0.0]

    def _way(self) -> list[list[float]]:
        times = np.cumsum([self._float(0.05, 0.4) for _ in range(self._rng.integers(1, 4))]).tolist()
        return [[time, self._float(-4, 4), self._float(-4, 4)] for time in times]

    def _adjustment(self) -> dict[str, Any]:
        what = self._pick(list(RANGES))
        return {"what": what, "amount": self._float(RANGES[what].low, RANGES[what].high)}

    def _runs(self, scattered: float = 0.3) -> list[list[int]]:
        """A few rows, or, like a lasso with a chance of `scattered`, very many."""
        count = len(self._document.scene)
        if self._rng.random() < scattered:
            return [[start, 1] for start in range(int(self._rng.integers(5)), count, 3)]
        starts = np.unique(self._rng.integers(0, count, 4)).tolist()
        return [[start, 1] for start in starts if start + 1 not in starts] or [[0, 1]]

    def _move(self) -> dict[str, Any]:
        switches = {name: bool(self._rng.random() < 0.3) for name in ("yaw_only", "along_lane", "on_ground")}
        rotation = self._rng.normal(0, 1, 4).tolist() if self._rng.random() < 0.5 else [1.0, 0.0, 0.0, 0.0]
        scale = self._float(0.8, 1.25) if self._rng.random() < 0.3 else 1.0
        numbers = {"translation": self._shift(), "rotation": rotation, "scale": scale, "time": self._float(0, 0.5)}
        return {"ids": self._ids(), **numbers, **switches}

    def _completion(self) -> dict[str, Any]:
        number = self._one()
        low, high = np.array(self._document.scene.table.instances[number].bounds) if number > 1 else np.zeros((2, 3))
        place = ((low + high) / 2)[:2].tolist()
        return {"id": number, "place": place, "heading": self._float(0, 3.1), "side": self._pick((1, -1))}

    def _shadow(self) -> dict[str, Any]:
        light = {"contact": self._float(0, 0.8), "sun_share": self._pick((0.0, 0.5)), "softness": self._float(0.1, 0.5)}
        return {"id": self._one(), "sun": self._shift()[:2], "time": self._float(0, 0.5), **light}

    def _turn(self) -> dict[str, Any]:
        """Mostly quarter turns; scales that do not grow or shrink the scene out of all bounds."""
        if self._rng.random() < 0.3:
            return {"rotation": self._rng.normal(0, 1, 4).tolist(), "scale": self._float(0.8, 1.25)}
        half = math.sqrt(0.5)
        return {"rotation": self._pick(([half, half, 0.0, 0.0], [half, -half, 0.0, 0.0], [half, 0.0, half, 0.0]))}

    def _hole(self) -> dict[str, Any]:
        means = self._document.scene.gaussians.means
        x, y = means[self._rng.integers(len(means)), :2].tolist()
        cells = [[along, across] for along in range(4) for across in range(3)]
        return {"cells": cells, "corner": [x, y], "along": [0.0, 1.0], "size": 0.4, "plane": [0.0, 0.0, 0.0]}

    def _compound(self) -> dict[str, Any]:
        kinds = [self._pick(sorted(self.kinds - {"compound", *_ADDING, *_DELETING})) for _ in range(2)]
        parts = [{"kind": kind, **self._recipes[kind]()} for kind in kinds]
        return {"edits": parts, "name": "two at once"}
