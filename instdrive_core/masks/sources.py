"""Where masks come from: the sources by name, and which folder a training run takes them from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.masks.annotations import AnnotationLabels, has_annotations
from instdrive_core.masks.exact import ExactLabels
from instdrive_core.masks.faults import FAULT_MODELS, FaultModel, with_faults
from instdrive_core.masks.labelmap import SIDECAR, FrameMasks, MaskFolder, open_masks, shuffled, write_masks

Source = Literal["exact", "annotations"]


def make_masks(
    clip: Clip,
    source: Source,
    folder: str | Path,
    seed: int = 0,
    on_frame: Callable[[int], None] = lambda done: None,
    faults: FaultModel | None = None,
) -> MaskFolder:
    """Write masks of a clip's training frames. Nothing of held-out time steps is written or used.

    Args:
        clip: the clip, with the cameras and at the image scale that are wanted.
        source: how to make them.
        folder: where to.
        seed: of the labels' order and of the faults.
        on_frame: is told the number of frames done.
        faults: what to get wrong on purpose.

    Raises DataError where the clip lacks what the source needs or the folder cannot be written.
    """
    labels = ExactLabels(clip.path) if source == "exact" else AnnotationLabels(clip, held_out=False)
    frames = clip.training_frames()

    def masks() -> Iterator[tuple[str, FrameMasks]]:
        for done, frame in enumerate(frames):
            on_frame(done)
            yield frame.key, _frame_masks(labels, frame, seed, faults)
        on_frame(len(frames))

    return write_masks(folder, masks(), source, seed, faults)


def ensure_masks(
    clip_path: str | Path,
    clip: Clip,
    run_dir: str | Path,
    masks: Path | None,
    on_frame: Callable[[int], None] = lambda done: None,
) -> MaskFolder | None:
    """The masks a run trains on: the given folder, else the clip's own ``masks/``, else ones made from its annotations
    in the run's folder (kept there from an earlier start of the run); None where the clip has no annotations either.
    `on_frame` is told the number of frames done while masks are made.

    Raises DataError where a folder of masks is damaged.
    """
    if masks is not None:
        return open_masks(masks)
    for folder in (Path(clip_path) / "masks", Path(run_dir) / "masks"):
        if (folder / SIDECAR).is_file():
            return open_masks(folder)
    if not has_annotations(clip):
        return None
    return make_masks(clip, "annotations", Path(run_dir) / "masks", on_frame=on_frame)


def _frame_masks(
    labels: ExactLabels | AnnotationLabels, frame: Frame, seed: int, faults: FaultModel | None
) -> FrameMasks:
    found, sky = labels.load(frame), labels.sky(frame)
    if faults is not None:
        closed = sky if frame.valid is None else sky | ~frame.valid
        found = with_faults(found, closed, FAULT_MODELS[faults], frame.key, seed)
    return FrameMasks(shuffled(found, frame.key, seed), sky)
