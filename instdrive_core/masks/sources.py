"""Where masks come from: the sources by name, and which folder a training run takes them from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.masks.annotations import AnnotationLabels, has_annotations
from instdrive_core.masks.exact import ExactLabels
from instdrive_core.masks.labelmap import SIDECAR, FrameMasks, MaskFolder, open_masks, shuffled, write_masks

Source = Literal["exact", "annotations"]


def make_masks(
    clip: Clip, source: Source, folder: str | Path, seed: int = 0, on_frame: Callable[[int], None] = lambda done: None
) -> MaskFolder:
    """Write masks of a clip's training frames. Nothing of held-out time steps is written or used.

    Args:
        clip: the clip, with the cameras and at the image scale that are wanted.
        source: how to make them.
        folder: where to.
        seed: of the labels' order.
        on_frame: is told the number of frames done.

    Raises DataError where the clip lacks what the source needs or the folder cannot be written.
    """
    labels = ExactLabels(clip.path) if source == "exact" else AnnotationLabels(clip, held_out=False)
    frames = clip.training_frames()

    def masks() -> Iterator[tuple[str, FrameMasks]]:
        for done, frame in enumerate(frames):
            on_frame(done)
            yield frame.key, _frame_masks(labels, frame, seed)
        on_frame(len(frames))

    return write_masks(folder, masks(), source, seed)


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


def _frame_masks(labels: ExactLabels | AnnotationLabels, frame: Frame, seed: int) -> FrameMasks:
    return FrameMasks(shuffled(labels.load(frame), frame.key, seed), labels.sky(frame))
