"""A training run as a folder: config, log, checkpoint, and at the end the scene that the editor opens."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numba
import torch

from instdrive_core.datasets.checks.drive import describe_faults
from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.formats.folder.scenes import write_scene_folder
from instdrive_core.masks.label_map_folder import MaskFolder
from instdrive_core.masks.lidar.scene import build_lidar_scene
from instdrive_core.masks.making import ensure_masks
from instdrive_core.masks.photo_fit import describe_misfit
from instdrive_core.progress import CancelledError
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.track import Track
from instdrive_core.tracks.choice import TrackSource, with_tracks
from instdrive_core.tracks.photos.setting_apart import set_movers_apart
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.device import choose_backend, measure_free_gpu_memory
from instdrive_core.training.build_trainer import build_trainer_from_clip, build_trainer_from_scene, resume_trainer
from instdrive_core.training.checkpoint import load_checkpoint, save_checkpoint
from instdrive_core.training.checkpoint_pace import CheckpointPace
from instdrive_core.training.gaussians.exposures import export_exposures
from instdrive_core.training.gaussians.first_gaussians import MIN_ACTOR_POINTS
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.instance_learner import InstanceLearner, LearnedInstances, read_codewords
from instdrive_core.training.instances.named_masks import NamedMasks, name_masks
from instdrive_core.training.instances.scene_export import export_trained_scene
from instdrive_core.training.instances.voted_instances import vote_instances
from instdrive_core.training.memory_check import check_gpu_memory, check_training_memory, measure_peak_memory
from instdrive_core.training.run_log import RunLog
from instdrive_core.training.settings.clip_size import AskedSizes, fit_to_clip, measure_way
from instdrive_core.training.settings.config import LEARNED_ELSEWHERE, Device, PieceChoice, TrainConfig, keep_cameras
from instdrive_core.training.settings.events import CheckpointDue, Event, StepDone
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.photo_depth import estimate_missing_depths
from instdrive_core.training.views.view_store import ViewStore, open_view_store
from instdrive_core.training.warm_up import compile_kernels

_NAMED_TRACKS = 8
"""Moving objects that a note names one by one."""
CHECKPOINT, CONFIG, FACTS, LOG = "checkpoint.safetensors", "config.json", "run.json", "log.jsonl"


@dataclass(frozen=True)
class RunRequest:
    """Request to train: the clip, the options, the output folder."""

    clip: Path
    out: Path
    options: ClipOptions
    config: TrainConfig
    masks: Path | None = None
    """Folder of masks; None = the clip's own, else `annotations` masks written into the run."""
    resume: bool = False
    init: Path | None = None
    """A scene file or run to start from instead of LiDAR points."""
    device: Device = "auto"
    learner: InstanceLearner | None = None
    """Learns instances in place of the trainer's instance stage (baselines)."""
    sizes: AskedSizes | None = None
    """Stretch `config` to the clip, but for what is asked for here; None = train `config` as it is."""
    tracks: TrackSource | None = None
    """Where moving objects are taken from; None = cuboids where the clip has some, else found in its sweeps."""
    pieces: PieceChoice = 1
    """Pieces that a drive is cut into along the road, see `pieces.drive`; `run_training` itself trains one."""


@dataclass(frozen=True)
class OpenedClip:
    """A clip that somebody opened already, or a part of one."""

    clip: Clip
    tracks: tuple[Track, ...] | None = None
    """Moving objects that were chosen for it; None = as the request says."""
    notes: tuple[str, ...] = ()
    """Notes that the user was told while it was opened."""


@dataclass(frozen=True)
class _Notes:
    """Notes of a run to its user, passed on at once and kept for `run.json`."""

    on_note: Callable[[str], None]
    told: list[str] = field(default_factory=list)

    def add(self, note: str) -> None:
        self.told.append(note)
        self.on_note(note)


def run_training(
    request: RunRequest,
    on_event: Callable[[Event], None],
    on_note: Callable[[str], None],
    opened: OpenedClip | None = None,
) -> Path:
    """Train a clip into `request.out` and return it.

    `opened` is the clip of the request, or the part of it that is to be trained; None = it is opened here.

    Where `on_event` raises CancelledError, a checkpoint is written first, so that `resume` goes on at that step.
    Time spent in `on_event` does not count as training.

    Raises OptionError where the folder already holds a run and `resume` is off, DataError for clips that cannot
    train, TrainingDivergedError where a loss is no longer finite, OptionError for a device that is not there, or where
    memory is too small for the clip's photos.
    """
    out, notes = request.out, _Notes(on_note, [] if opened is None else list(opened.notes))
    torch.set_num_threads(1)  # the work is in our kernels' threads; torch's would wait for theirs and take their cores
    check_run_output(request)
    backend = choose_backend(request.device)
    out.mkdir(parents=True, exist_ok=True)
    if opened is None:
        notes.add(f"reading {request.clip}")
    clip = load_clip(str(request.clip), request.options) if opened is None else opened.clip
    if not clip.training_frames:
        raise DataError(request.clip, "no photo of a training time step was found", "Check cameras and frame range.")
    if request.sizes is not None:
        request = replace(request, config=fit_to_clip(request.config, clip, request.sizes))
        notes.add(_describe_sizes(request.config, clip))
    if not clip.training_sweeps:
        request = replace(request, config=keep_cameras(request.config))
    check_training_memory(clip)
    free = measure_free_gpu_memory(backend)
    if free is not None:
        check_gpu_memory(request.config, free)
    masks = ensure_masks(request.clip, clip, out, request.masks)
    if opened is None or opened.tracks is None:
        clip = with_tracks(clip, request.tracks, out, notes.add)
    else:
        clip = replace(clip, tracks=opened.tracks)
    notes.add(
        f"{len(clip.training_frames)} training photos, {len(clip.held_out_frames)} held out; "
        + (f"masks: {masks.source}" if masks else "no masks: training RGB only")
    )
    for note in (*clip.notes, *_describe_faults(clip, masks)):
        notes.add(note)
    _note_what_is_missing(clip, request.config, notes.add)
    clip, movers = set_movers_apart(clip, masks, request.tracks, notes.add)
    depths = None if request.config.freeze_geometry else estimate_missing_depths(clip, notes.add)
    with open_view_store(clip, masks, photo_depths=depths) as store:
        compile_kernels(notes.add)
        trainer = _build_trainer(request, clip, store, backend, notes.add)
        if request.init is None:
            _note_movers_without_node(clip, request.config, trainer.model.actor_poses.tracks, notes.add)
        learner = _choose_learner(request, clip)
        if learner is not None:
            trainer.name_masks = partial(_name_masks, learner=learner, config=request.config, on_note=notes.add)
        write_run_facts(out / CONFIG, collect_config(request, masks.source if masks else None))
        run_trainer(trainer, out, on_event)
        trainer.end_training()
        learned = _learn_instances(request, learner, trainer, notes.add) if trainer.has_masks else None
        notes.add("naming instances and writing the scene")
        exposures = export_learned_exposures(trainer)
        scene = export_trained_scene(trainer.model, clip, request.config, learned, exposures, trainer.cameras)
    write_scene_folder(out, replace(scene, seen_movers=movers))
    facts = _collect_facts(request, masks, trainer, backend.name, len(scene.table))
    write_run_facts(out / FACTS, facts | {"seen_moving": len(movers), "notes": notes.told})
    return out


def run_trainer(trainer: Trainer, out: Path, on_event: Callable[[Event], None]) -> None:
    """Run a trainer to its end, with its log and checkpoints in the folder `out`.

    Where `on_event` or a listener of progress raises CancelledError, a checkpoint is written first; time spent in
    `on_event` does not count.
    """
    pace = CheckpointPace()
    with RunLog(out / LOG, trainer.stage, trainer.iteration) as log:
        try:
            for event in trainer.run():
                if isinstance(event, CheckpointDue) and (event.ends_stage or pace.is_due()):
                    with pace.time_saving():
                        save_checkpoint(out / CHECKPOINT, trainer)
                if isinstance(event, StepDone):
                    log.write(event)
                began = time.perf_counter()
                on_event(event)
                trainer.seconds_before -= time.perf_counter() - began
        except CancelledError:
            trainer.check_parameters()
            save_checkpoint(out / CHECKPOINT, trainer)
            raise


def _choose_learner(request: RunRequest, clip: Clip) -> InstanceLearner | None:
    """The learner of the instances; None where they are read off trained features."""
    if request.learner is not None or request.config.instances.learned_by != "votes":
        return request.learner
    # Votes may be counted twice, to learn edges and at the end; the drive's sweeps are looked at once.
    return partial(
        vote_instances, build_lidar=cache(partial(build_lidar_scene, clip)) if clip.training_sweeps else None
    )


def _name_masks(
    model: SceneModel, store: ViewStore, learner: InstanceLearner, config: TrainConfig, on_note: Callable[[str], None]
) -> NamedMasks:
    """Name masks by votes counted on a scene that is still in training (a `MaskNamer`)."""
    on_note("finding out which masks show the same object, to learn their edges")
    learned = learner(model, store, config, lambda note: None)
    return name_masks(model, store, learned, config.instances.min_alpha)


def _learn_instances(
    request: RunRequest, learner: InstanceLearner | None, trainer: Trainer, on_note: Callable[[str], None]
) -> LearnedInstances:
    if learner is None:
        return read_codewords(trainer.model.gaussians().features)
    return learner(trainer.model, trainer.store, request.config, on_note)


def export_learned_exposures(trainer: Trainer) -> Exposures | None:
    """Export the exposures of a trainer's photos; None where it learned none."""
    if trainer.config.freeze_geometry or not trainer.config.geometry.exposure_lr:
        return None
    return export_exposures(trainer.model.shared["exposures"], trainer.store.facts)


def _describe_sizes(config: TrainConfig, clip: Clip) -> str:
    way = "" if clip.points is not None else f" along {measure_way(clip):.0f} m"
    return (
        f"{len(clip.training_frames)} training photos{way}: {config.geometry.iterations:,} iterations, "
        f"up to {config.densify.max_gaussians:,} Gaussians"
    )


def _describe_faults(clip: Clip, masks: MaskFolder | None) -> list[str]:
    """What does not belong together in a clip and its masks."""
    misfit = None if masks is None else describe_misfit(clip, masks)
    return [*describe_faults(clip), *([] if misfit is None else [misfit])]


def _note_what_is_missing(clip: Clip, config: TrainConfig, on_note: Callable[[str], None]) -> None:
    if not clip.tracks and not clip.training_sweeps:
        on_note("no cuboids and no LiDAR: a static scene")
    elif not clip.tracks:
        on_note("no cuboids and no found tracks: a static scene, moving objects will blur")
    elif not config.init.moving_actors:
        on_note("static-only: moving objects stay in the background and will blur")
    elif not any(track.moving for track in clip.tracks):
        on_note(f"{len(clip.tracks)} tracks, none of which moves: a static scene")


def _note_movers_without_node(
    clip: Clip, config: TrainConfig, actors: tuple[Track, ...], on_note: Callable[[str], None]
) -> None:
    """Tell which moving objects got no node of their own, and why: they stay in the background and blur."""
    known = {track.id for track in actors}
    missing = [track for track in clip.tracks if track.moving and track.id not in known]
    if not missing or not config.init.moving_actors:
        return
    moving = sum(track.moving for track in clip.tracks)
    names = ", ".join(f"{track.label} {track.id}" for track in missing[:_NAMED_TRACKS])
    more = "" if len(missing) <= _NAMED_TRACKS else f" and {len(missing) - _NAMED_TRACKS} more"
    if clip.training_sweeps:
        reason = f"fewer than {MIN_ACTOR_POINTS} LiDAR points lie in their boxes"
    else:
        reason = "the clip has no LiDAR points to start them from"
    on_note(f"{len(missing)} of {moving} moving objects will blur, {reason}: {names}{more}")


def check_run_output(request: RunRequest) -> None:
    """Check that a request fits its folder, and its options each other.

    Raises OptionError where the folder holds a run and `resume` is off, or the other way round, or where options lack
    something.
    """
    has_run = (request.out / CONFIG).exists()
    if request.resume and not has_run:
        raise OptionError(f"{request.out}: no run to resume. Leave --resume out to start one.")
    if has_run and not request.resume:
        raise OptionError(f"{request.out}: already holds a run. Add --resume to go on, or choose another --out.")
    if request.config.method in LEARNED_ELSEWHERE and request.learner is None:
        raise OptionError(f"method '{request.config.method}' needs its learner: see baselines/registry.py.")
    if request.config.freeze_geometry and request.init is None:
        raise OptionError("--freeze-geometry needs the scene whose geometry to keep: add --init SCENE.")


def _build_trainer(
    request: RunRequest, clip: Clip, store: ViewStore, backend: Backend, on_note: Callable[[str], None]
) -> Trainer:
    path = request.out / CHECKPOINT
    if backend.name != "cpu":
        on_note(f"backend: {backend.name} on {backend.device}")
    if request.resume and path.exists():
        checkpoint = load_checkpoint(path)
        on_note(f"going on after step {checkpoint.iteration:,} of the {checkpoint.stage} stage")
        return resume_trainer(request.config, store, path, checkpoint, backend)
    if request.resume:
        on_note("the run was interrupted before its first checkpoint: starting again")
    if request.init is not None:
        return build_trainer_from_scene(request.config, clip, store, request.init, backend)
    return build_trainer_from_clip(request.config, clip, store, backend)


def collect_config(request: RunRequest, masks: str | None) -> dict[str, Any]:
    """Collect what `config.json` says: the options of a run, and the source of its masks."""
    return {
        "clip": str(request.clip.resolve()),
        **asdict(request.options),
        "masks": masks,
        "init": str(request.init.resolve()) if request.init else None,
        "train": request.config.to_json(),
    }


def _collect_facts(
    request: RunRequest, masks: MaskFolder | None, trainer: Trainer, backend: str, instances: int
) -> dict[str, Any]:
    config = request.config
    return {
        "version": 1,
        "clip": str(request.clip.resolve()),
        **asdict(request.options),
        "masks": masks.source if masks else None,
        "tracks": request.tracks,
        "method": config.method,
        "preset": config.preset,
        "seed": config.seed,
        "init": str(request.init.resolve()) if request.init else None,
        "iterations": (0 if config.freeze_geometry else config.geometry.iterations) + config.instance_iterations,
        "train_seconds": round(trainer.seconds, 1),
        "peak_rss_mb": round(measure_peak_memory() / 2**20),
        "backend": backend,
        "threads": numba.get_num_threads(),
        "n_gaussians": len(trainer.model),
        "n_instances": instances,
    }


def write_run_facts(path: Path, values: dict[str, Any]) -> None:
    """Write facts of a run as JSON, whole or not at all."""
    write_bytes(path, (json.dumps(values, indent=1) + "\n").encode())
