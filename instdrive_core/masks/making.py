"""Writes masks of a clip's training photos, and finds those that a run trains on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import OptionError
from instdrive_core.masks.annotated.labels import has_annotations
from instdrive_core.masks.faults.registry import FaultModel, FaultySource, find_fault_set
from instdrive_core.masks.journal import MaskJournal
from instdrive_core.masks.label_map_folder import (
    SIDECAR,
    FrameMasks,
    MaskFolder,
    locate_label_map,
    locate_sky_mask,
    open_masks,
    shuffle_labels,
    write_masks,
)
from instdrive_core.masks.label_source import LabelSource
from instdrive_core.masks.sources import SourceOptions, find_mask_source, open_mask_source


def make_masks(
    clip: Clip,
    source: str,
    folder: str | Path,
    seed: int = 0,
    on_frame: Callable[[int], None] = lambda done: None,
    faults: FaultModel | None = None,
    options: SourceOptions = SourceOptions(),  # noqa: B008 (frozen)
) -> MaskFolder:
    """Write masks of a clip's training frames. Nothing of held-out time steps is written or used.

    A folder that was left unfinished by the same call goes on where it stopped.

    Args:
        clip: the clip, with the cameras and at the image scale that are wanted.
        source: name of the source of masks, one of `MASK_SOURCES`.
        folder: where to.
        seed: seed of the labels' order and of the faults.
        on_frame: is told the number of frames done, first of all that of frames done before.
        faults: what to get wrong on purpose.
        options: what some sources need.

    Raises DataError where the clip lacks what the source needs or the folder cannot be written, OptionError where an
    option is missing.
    """
    folder, frames = Path(folder), clip.training_frames
    journal = MaskJournal(folder, _build_recipe(clip, source, seed, faults, options))
    sizes = {frame.key: (frame.view.camera.width, frame.view.camera.height) for frame in frames}
    journal.keep(lambda key, entry: sizes.get(key) == (entry["width"], entry["height"]) and _has_files(folder, key))
    left = [frame for frame in frames if frame.key not in journal.entries]
    labels = open_mask_source(clip, source, options)
    damaged = _open_faults(clip, source, labels, seed, faults)

    def masks() -> Iterator[tuple[str, FrameMasks]]:
        for done, frame in enumerate(left, len(frames) - len(left)):
            on_frame(done)
            yield frame.key, damaged.load(frame) if damaged else _make_frame_masks(labels, frame, seed)
        on_frame(len(frames))

    return write_masks(folder, masks(), source, seed, faults, journal)


def ensure_masks(
    clip_path: str | Path,
    clip: Clip,
    run_dir: str | Path,
    masks: Path | None,
    on_frame: Callable[[int], None] = lambda done: None,
) -> MaskFolder | None:
    """Find or make the masks that a run trains on.

    They are those of the given folder, else those in the clip's own ``masks/``, else ones made from its annotations in
    the run's folder, where an earlier start of the run may have left them. None where the clip has no annotations
    either. While masks are made, `on_frame` is told the number of frames done.

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


def _open_faults(
    clip: Clip, source: str, labels: LabelSource, seed: int, faults: FaultModel | None
) -> FaultySource | None:
    if faults is None:
        return None
    known = find_fault_set(faults)
    if known.needs_exact and source != "exact":
        raise OptionError(f"The faults '{faults}' are put into a synthetic clip's own labels: give --source exact")
    return known.open(clip, labels, seed)


def _make_frame_masks(labels: LabelSource, frame: Frame, seed: int) -> FrameMasks:
    return FrameMasks(shuffle_labels(labels.load(frame), frame.key, seed), labels.load_sky(frame))


def _build_recipe(
    clip: Clip, source: str, seed: int, faults: FaultModel | None, options: SourceOptions
) -> dict[str, Any]:
    """All that the masks of a frame depend on, but for its size."""
    recipe: dict[str, Any] = {"clip": str(Path(clip.path).resolve()), "source": source, "seed": seed, "faults": faults}
    return recipe | find_mask_source(source).list_options(options)


def _has_files(folder: Path, key: str) -> bool:
    return locate_label_map(folder, key).is_file() and locate_sky_mask(folder, key).is_file()
