"""What the process of one cell does: make a clip, make masks, train, evaluate, draw; then leave its outcome as JSON."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import threading
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import tyro

from benchmarks.cells import Cell, Scale, build_cell_config, cell_keys, find_street_seed, learning_settings, plan
from benchmarks.outcomes import PUBLISHED, SPLIT
from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.files.atomic import write_bytes
from instdrive_core.scene.scene import Scene

OWN, FROZEN = "learned in the geometry's own run", "learned on its frozen geometry"
_RUN_FACTS = "run.json"


@dataclass(frozen=True)
class Workplace:
    """Where the outcomes of cells lie, and what they are made from."""

    folder: Path
    recorded: Path
    """The recorded clip, in PandaSet's layout."""
    scale: Scale

    @cached_property
    def cells(self) -> dict[str, Cell]:
        """All cells by name, in the order of the plan."""
        return {cell.name: cell for cell in plan(self.scale)}

    @cached_property
    def keys(self) -> dict[str, str]:
        """The key of each cell's outcome."""
        return cell_keys(self.cells.values(), self.scale, str(self.recorded))

    def _path(self, kind: str, name: str, suffix: str = "") -> Path:
        return self.folder / kind / f"{self.cells[name].slug}-{self.keys[name]}{suffix}"

    def outcome_file(self, name: str) -> Path:
        """JSON of a finished cell."""
        return self._path("outcomes", name, ".json")

    def outcome(self, name: str) -> dict[str, Any] | None:
        """What a finished cell left; None before that."""
        file = self.outcome_file(name)
        return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None

    def log_file(self, name: str) -> Path:
        """What a cell's process printed."""
        return self._path("logs", name, ".txt")

    def image(self, name: str) -> Path:
        """The picture of a figure's cell."""
        return self._path("images", name, ".jpg")

    def clip(self, name: str) -> Path:
        """The folder of a clip's cell."""
        return self.recorded if find_street_seed(name) is None else self._path("clips", name)

    def masks(self, name: str) -> Path:
        """The folder of a masks' cell."""
        return self._path("masks", name)

    def run(self, name: str) -> Path:
        """The scene of a geometry's or method's cell."""
        return self.own_run((self.outcome(name) or {}).get("run_of", name))

    def own_run(self, name: str) -> Path:
        """The folder into which a cell trains, if it does: instances of ours may be those of the geometry's run."""
        return self._path("runs", name)

    def options(self, cell: Cell) -> ClipOptions:
        """The part of its clip that a cell uses."""
        if find_street_seed(cell.clip) is not None:
            return ClipOptions(cameras=cell.cameras)
        scale = self.scale
        return ClipOptions(cell.cameras, scale.image_scale, scale.first_frame, scale.last_frame)

    def load_clip(self, cell: Cell) -> Clip:
        """The clip of a cell."""
        return load_clip(str(self.clip(cell.clip)), self.options(cell))


def work(cell: Cell, place: Workplace) -> None:
    """Do a cell and write its outcome. Raises whatever its work raises."""
    started = time.perf_counter()
    done = {"clip": _make_clip, "masks": _make_masks, "geometry": _train_geometry, "method": _measure, "figure": _draw}
    facts = done[cell.kind](cell, place)
    outcome = {"cell": cell.name, "key": place.keys[cell.name], **facts, **provenance()}
    outcome["seconds"] = round(time.perf_counter() - started, 1)
    file = place.outcome_file(cell.name)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(file, (json.dumps(outcome, indent=1, allow_nan=False) + "\n").encode())


def provenance() -> dict[str, Any]:
    """What code was measured, on what machine and when."""
    import numba

    return {
        "commit": commit(),
        "threads": numba.get_num_threads(),
        "machine": f"{processor()}, {os.cpu_count()} logical CPUs, {platform.system()}",
        "date": datetime.now(UTC).date().isoformat(),
    }


def commit() -> str:
    """Short hash of the repository's commit; ``+`` behind it where tracked files differ from it."""
    root = Path(__file__).resolve().parents[1]
    try:
        described = ["git", "-C", str(root), "describe", "--always", "--dirty=+", "--exclude=*"]
        return subprocess.run(described, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def processor() -> str:
    """Model of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()


def end_with_parent() -> None:
    """End this process soon after the one that started it: a killed queue leaves no worker behind."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _make_clip(cell: Cell, place: Workplace) -> dict[str, Any]:
    seed, folder, scale = find_street_seed(cell.clip), place.clip(cell.name), place.scale
    if seed is not None:
        from instdrive_core.datasets.synthetic.config import StreetConfig
        from instdrive_core.datasets.synthetic.write import write_street

        shutil.rmtree(folder, ignore_errors=True)  # half a clip, where this cell was cut off before
        folder.parent.mkdir(parents=True, exist_ok=True)
        write_street(folder, StreetConfig(seed, scale.steps, scale.width, scale.height, scale.lidar_azimuths))
    clip = place.load_clip(cell)
    return {"photos": len(clip.training_frames), "held_out": len(clip.held_out_frames)}


def _make_masks(cell: Cell, place: Workplace) -> dict[str, Any]:
    """By the words of the command line, so that a reader can repeat it."""
    from instdrive_core.cli.masks import create_masks
    from instdrive_core.masks.label_map_folder import open_masks

    options, folder = place.options(cell), place.masks(cell.name)
    words = [str(place.clip(cell.clip)), "--out", str(folder), "--seed", "0"]
    words += ["--source", "exact", "--faults", cell.masks] if cell.masks == "sam-v1" else ["--source", cell.masks]
    for name in ("scale", "first_frame", "last_frame"):
        if getattr(options, name) is not None:
            words += [f"--{name.replace('_', '-')}", str(getattr(options, name))]
    tyro.cli(create_masks, args=words)
    counts = open_masks(folder).counts
    return {"photos": len(counts), "masks": sum(counts.values())}


def _train_geometry(cell: Cell, place: Workplace) -> dict[str, Any]:
    run = place.run(cell.name)
    _train(cell, place, run)
    return {**_collect_facts(run), "learning": learning_settings(build_cell_config(cell, place.scale))}


def _measure(cell: Cell, place: Workplace) -> dict[str, Any]:
    """Learn a method's instances, unless the geometry's own run has just these, and evaluate them."""
    from instdrive_core.evaluation.protocol import evaluate_scene
    from instdrive_core.evaluation.run_facts import read_run_facts
    from instdrive_core.formats.folder.scenes import read_scene_folder
    from instdrive_core.masks.ground_truth import open_ground_truth

    geometry = cell.needs[0]
    own = _is_own(cell, place)
    run = place.run(geometry) if own else place.run(cell.name)
    if not own:
        _train(cell, place, run, init=place.run(geometry))
    # Photos were exposed while geometry was learned; images are compared alike whatever learned the instances.
    exposures = read_scene_folder(place.run(geometry)).exposures
    scene = replace(read_scene_folder(run), exposures=exposures)
    clip, facts = place.load_clip(cell), read_run_facts(run)
    truth = open_ground_truth(clip)
    rows, evaluation = {}, None
    bounding = cell.method == "instdrive" and not cell.variant  # all methods share the geometry, and so the reference
    for row, shown in _rows(cell, scene).items():
        evaluation = evaluate_scene(shown, clip, truth, facts, with_reference=bounding)
        rows[row] = {**evaluation.figures, "shared_codes": len(evaluation.shared_codes) if shown.code_bits else None}
    assert evaluation is not None
    return {
        "run_of": geometry if own else cell.name,
        "learned": OWN if own else FROZEN,
        **_collect_facts(run),
        "learning": learning_settings(build_cell_config(cell, place.scale)),
        "rows": rows,
        "controls": evaluation.controls,
        "privileged": evaluation.privileged,
        "held_out_steps": evaluation.held_out_steps,
    }


def _is_own(cell: Cell, place: Workplace) -> bool:
    """Whether the geometry's run learned this cell's instances itself, with the present code."""
    geometry = place.cells[cell.needs[0]]
    if cell.method != "instdrive" or cell.variant or cell.masks != geometry.masks:
        return False
    trained = place.outcome(geometry.name) or {}
    wanted = json.loads(json.dumps(learning_settings(build_cell_config(cell, place.scale))))
    return trained.get("learning") == wanted and trained.get("commit") == commit()


def _rows(cell: Cell, scene: Scene) -> dict[str, Scene]:
    if not cell.published_too:
        return {SPLIT: scene}
    from instdrive_core.baselines.codeword_instances import assign_instances_by_codeword

    return {PUBLISHED: assign_instances_by_codeword(scene), SPLIT: scene}


def _draw(cell: Cell, place: Workplace) -> dict[str, Any]:
    from benchmarks.paper_figures import Shown, draw

    shown = [Shown(place.cells[name].method, place.cells[name].variant, place.run(name)) for name in cell.needs[:-1]]
    caption = draw(cell.variant, place.load_clip(cell), shown, place.image(cell.name))
    return {"caption": caption}


def _train(cell: Cell, place: Workplace, run: Path, init: Path | None = None) -> None:
    """Train into a folder, or go on where an earlier process was cut off."""
    from instdrive_core.baselines.registry import find_learner
    from instdrive_core.training.run import CHECKPOINT, CONFIG, RunRequest, run_training

    if (run / _RUN_FACTS).is_file():
        return
    masks = next(name for name in cell.needs if place.cells[name].kind == "masks")
    request = RunRequest(
        clip=place.clip(cell.clip),
        out=run,
        options=place.options(cell),
        config=build_cell_config(cell, place.scale),
        masks=place.masks(masks),
        resume=(run / CONFIG).is_file(),
        init=init,
        device="cpu",
        learner=find_learner(cell.method),
    )
    run_training(request, on_event=lambda event: None, on_note=lambda note: print(note, flush=True))
    (run / CHECKPOINT).unlink(missing_ok=True)


def _collect_facts(run: Path) -> dict[str, Any]:
    facts = json.loads((run / _RUN_FACTS).read_text(encoding="utf-8"))
    return {name: facts[name] for name in ("train_seconds", "peak_rss_mb", "iterations", "n_gaussians", "n_instances")}
