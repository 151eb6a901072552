"""A toy drive with perfect geometry, exact masks and no instance knowledge: what baselines learn on in tests."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from evaluation_scene import ToyDrive, toy_drive

from instdrive_core.evaluation.metrics.held_out import HeldOutView, measure_held_out_view
from instdrive_core.evaluation.metrics.map_scores import score_scene
from instdrive_core.masks.label_map_folder import shuffle_labels
from instdrive_core.training.gaussians.model import SceneModel, build_model
from instdrive_core.training.settings.config import TrainConfig, build_train_config, keep_geometry
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore


@dataclass(frozen=True)
class ToyTraining:
    """What a learner is given, and what measures it."""

    model: SceneModel
    store: ViewStore
    config: TrainConfig
    drive: ToyDrive
    held_out: list[HeldOutView]

    def scene_miou(self, instance_ids: np.ndarray) -> float:
        """Scene mIoU of the given ID of each Gaussian, in the held-out views."""
        predicted = [view.with_ids(instance_ids.astype(np.uint32)) for view in self.held_out]
        return score_scene(predicted, (), ())["miou"]


@pytest.fixture(scope="module", autouse=True)
def _one_torch_thread():
    """Use one thread, as `run_training` does: torch's threads would fight for the cores with those of the kernels."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="session")
def toy() -> ToyTraining:
    """Six time steps of two cameras train, two are held out; labels are shuffled in every photo."""
    drive = toy_drive()
    config = keep_geometry(build_train_config("instdrive", "quick", seed=3))
    config = replace(config, instances=replace(config.instances, pixels_per_view=1000))
    nothing = np.zeros(0)
    views = [
        TrainingView(
            frame.key,
            frame.view.camera,
            frame.view.time,
            frame.load_image(),
            frame.valid,
            shuffle_labels(drive.truth.load(frame), frame.key, 0),
            None,
            nothing.astype(np.int32),
            nothing.astype(np.float32),
        )
        for frame in drive.clip.training_frames
    ]
    scene = drive.scene
    times = [view.time for view in views]
    model = build_model(scene.gaussians, scene.nodes, scene.actors, scene.sky.faces, times)
    held_out = [measure_held_out_view(scene, drive.clip, frame, drive.truth) for frame in drive.clip.held_out_frames]
    return ToyTraining(model, ViewStore.from_views(views), config, drive, held_out)
