"""Training on from a finished run into a new one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import torch
from jaxtyping import Bool
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import OptionError
from instdrive_core.files.json_fields import read_json
from instdrive_core.formats.folder.scenes import write_scene_folder
from instdrive_core.improving.base import MASK_FOLDER, BaseRun, open_base_masks
from instdrive_core.improving.inherited_scene import export_improved_scene, order_rows
from instdrive_core.improving.start import build_improving_trainer
from instdrive_core.masks.label_map_folder import MaskFolder
from instdrive_core.project.carrying.parents_file import write_parents
from instdrive_core.tracks.photos.setting_apart import set_movers_apart
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.device import choose_backend, measure_free_gpu_memory
from instdrive_core.training.build_trainer import resume_trainer
from instdrive_core.training.checkpoint import load_checkpoint
from instdrive_core.training.memory_check import check_gpu_memory, check_training_memory, measure_peak_memory
from instdrive_core.training.run import (
    CHECKPOINT,
    CONFIG,
    FACTS,
    export_learned_exposures,
    run_trainer,
    write_run_facts,
)
from instdrive_core.training.settings.config import Device, TrainConfig
from instdrive_core.training.settings.events import Event
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.photo_depth import estimate_missing_depths
from instdrive_core.training.views.view_store import ViewStore, open_view_store
from instdrive_core.training.warm_up import compile_kernels


@dataclass(frozen=True)
class Improvement:
    """Request to train on from a finished run."""

    base: BaseRun
    out: Path
    config: TrainConfig
    edited: Bool[ndarray, " n"]
    """Rows of the base that the user deleted, moved or recoloured: see `EditGuard`."""
    device: Device = "auto"


def run_improvement(request: Improvement, on_event: Callable[[Event], None], on_note: Callable[[str], None]) -> Path:
    """Train on into `request.out` and return it; a folder that was begun so before goes on where it was.

    Rows of the base keep their places, instances and codewords; what grows comes after them, and `parents.safetensors`
    says from which row. Where `on_event` raises CancelledError, a checkpoint is written first.

    Raises OptionError where the folder holds something else or memory is too small, DataError where the clip's photos
    cannot be read, TrainingDivergedError.
    """
    base, out = request.base, request.out
    torch.set_num_threads(1)  # as in `run_training`
    _check_folder(request)
    backend = choose_backend(request.device)
    check_training_memory(base.clip)
    free = measure_free_gpu_memory(backend)
    if free is not None:
        check_gpu_memory(request.config, free)
    masks = open_base_masks(base)
    clip, _ = set_movers_apart(base.clip, masks, base.facts.get("tracks"), on_note)
    with open_view_store(clip, masks, photo_depths=estimate_missing_depths(clip, on_note)) as store:
        compile_kernels(on_note)
        trainer = _build_trainer(request, store, backend, on_note)
        write_run_facts(out / CONFIG, _collect_config(request))
        run_trainer(trainer, out, on_event)
        on_note("writing the scene")
        trainer.continue_on_cpu()
        _write(request, clip, trainer)
    write_run_facts(out / FACTS, _collect_facts(request, masks, trainer))
    return out


def _check_folder(request: Improvement) -> None:
    path = request.out / CONFIG
    request.out.mkdir(parents=True, exist_ok=True)
    if not path.is_file():
        return
    if read_json(path).get("base") != _collect_config(request)["base"]:
        raise OptionError(f"{request.out}: holds another run. Choose another --out.")


def _build_trainer(request: Improvement, store: ViewStore, backend: Backend, on_note: Callable[[str], None]) -> Trainer:
    trainer = build_improving_trainer(request.config, request.base.scene, store, request.edited, backend)
    path = request.out / CHECKPOINT
    if not path.is_file():
        return trainer
    checkpoint = load_checkpoint(path)
    on_note(f"going on after step {checkpoint.iteration:,}")
    resumed = resume_trainer(request.config, store, path, checkpoint, backend)
    resumed.guard = trainer.guard
    return resumed


def _write(request: Improvement, clip: Clip, trainer: Trainer) -> None:
    assert trainer.lineage is not None
    views = trainer.cameras.correct_views([frame.view for frame in clip.frames])
    exposures = export_learned_exposures(trainer)
    scene = export_improved_scene(request.base.scene, trainer.model, trainer.lineage, views, exposures)
    write_parents(request.out, trainer.lineage.ancestors[order_rows(trainer.lineage)])
    write_scene_folder(request.out, scene)


def _collect_config(request: Improvement) -> dict[str, Any]:
    base = request.base
    return {"base": str(base.run.resolve()), "clip": str(base.clip.path), "train": request.config.to_json()}


def _collect_facts(request: Improvement, masks: MaskFolder | None, trainer: Trainer) -> dict[str, Any]:
    """Facts of the base run, with what was done since on top."""
    facts = {name: value for name, value in request.base.facts.items() if name not in ("pieces", "notes")}
    return facts | {
        "clip": str(Path(request.base.clip.path).resolve()),
        "improved_from": str(request.base.run.resolve()),
        MASK_FOLDER: None if masks is None else str(masks.path.resolve()),
        "seed": request.config.seed,
        "iterations": facts["iterations"] + request.config.geometry.iterations,
        "train_seconds": round(facts["train_seconds"] + trainer.seconds, 1),
        "peak_rss_mb": round(measure_peak_memory() / 2**20),
        "backend": trainer.backend.name,
        "threads": numba.get_num_threads(),
        "n_gaussians": len(trainer.model),
        "n_instances": len(request.base.scene.table),
    }
