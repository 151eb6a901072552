"""Which splats of a finished scene are one object, by the masks of photos: votes are counted, nothing is trained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import torch
from jaxtyping import UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.finding.absent_movers import leave_out_absent_movers
from instdrive_core.instances.id_assignment import number_by_size
from instdrive_core.masks.label_map_folder import MaskFolder
from instdrive_core.masks.lidar.scene import build_lidar_scene
from instdrive_core.scene.scene import Scene
from instdrive_core.tracks.photos.setting_apart import set_movers_apart
from instdrive_core.training.build_trainer import make_uniform_sky
from instdrive_core.training.gaussians.model import build_model
from instdrive_core.training.instances.naming import find_instance_classes
from instdrive_core.training.instances.voted_instances import vote_instances
from instdrive_core.training.memory_check import check_training_memory
from instdrive_core.training.settings.config import build_train_config, keep_geometry
from instdrive_core.training.views.view_store import open_view_store
from instdrive_core.training.warm_up import compile_kernels


@dataclass(frozen=True)
class LearnedObjects:
    """Objects of a scene's rows."""

    numbers: UInt32[ndarray, " n"]
    """1, 2, … by falling number of splats."""
    classes: tuple[str, ...]
    """Class of each object; empty = unknown."""
    photos: int
    """Photos whose masks were looked at."""


def learn_objects(scene: Scene, clip: Clip, masks: MaskFolder, on_note: Callable[[str], None]) -> LearnedObjects:
    """Find out which splats are one object. Nothing of the scene changes, and its rows may have any order.

    How far the look at the photos is goes to `progress.report`.

    Args:
        scene: in the clip's world, at its origin.
        clip: the photos; those without masks are left out.
        masks: their masks.
        on_note: is told what is done.

    Raises DataError where no photo has masks, or one is damaged; OptionError where memory is too small.
    """
    torch.set_num_threads(1)  # as in `run_training`
    clip = keep_masked_photos(clip, masks)
    check_training_memory(clip)
    clip, _ = set_movers_apart(clip, masks, None, on_note)
    clip, photos = leave_out_absent_movers(scene, clip)
    if photos:
        on_note(f"what moved in {photos} photos is not in the scene and is left out")
    order = np.argsort(scene.nodes, kind="stable")
    gaussians = scene.gaussians.select(order)
    gaussians = replace(gaussians, features=np.zeros((len(order), 0), np.float32))
    config = keep_geometry(build_train_config())
    with open_view_store(clip, masks) as store:
        compile_kernels(on_note)
        sky = make_uniform_sky(np.zeros(3, np.float32), 1)
        model = build_model(gaussians, scene.nodes[order], scene.actors, sky, store.times)
        lidar = cache(partial(build_lidar_scene, clip)) if clip.training_sweeps else None
        learned = vote_instances(model.copy_to_cpu(), store, config, on_note, lidar)
        photos = sum(photo.has_masks for photo in store.facts)
    numbers = np.empty(len(order), np.uint32)
    numbers[order] = number_by_size(learned.codewords.astype(np.int64))
    on_note("naming the objects")
    classes = find_instance_classes(
        clip, numbers, scene.gaussians.means, scene.nodes, [actor.label for actor in scene.actors]
    )
    names = tuple(classes.get(number, "") for number in range(1, int(numbers.max(initial=0)) + 1))
    return LearnedObjects(numbers, names, photos)


def keep_masked_photos(clip: Clip, masks: MaskFolder) -> Clip:
    """Copy a clip without the training photos that have no masks. Raises DataError where none has any."""
    frames = tuple(frame for frame in clip.frames if frame.view.held_out or frame.key in masks.counts)
    kept = replace(clip, frames=frames)
    if not any(masks.counts[frame.key] for frame in kept.training_frames):
        raise DataError(
            masks.path,
            f"holds masks of none of the photos of {clip.path}",
            "Choose masks that were made for these photos, or have them made now",
        )
    return kept
