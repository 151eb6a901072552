"""Every source of masks, registered once: the command line's choices, its help and what is said to a clip that lacks
something derive from these records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError, OptionError
from instdrive_core.masks.annotated.labels import AnnotationLabels, has_annotations
from instdrive_core.masks.exact import ExactLabels, has_exact_labels
from instdrive_core.masks.label_source import LabelSource
from instdrive_core.masks.sam.options import SamOptions


@dataclass(frozen=True)
class SourceOptions:
    """Options of sources, besides the clip."""

    imported: Path | None = None
    """Folder that `import` reads."""
    sam: SamOptions = SamOptions()  # noqa: RUF009 (frozen)
    """Options of `sam`."""


@dataclass(frozen=True)
class MaskSource:
    """A way to make masks; modules and packages that only this source needs are loaded when it is opened."""

    name: str
    """Word on the command line and in the sidecar of a folder of masks."""
    summary: str
    """Words on what the masks are made from, for the command line's help."""
    needs: str
    """Words on what a clip must have, after "has no"; empty = photos are enough."""
    fits: Callable[[Clip], bool]
    """Whether a clip has it; cheap."""
    open: Callable[[Clip, SourceOptions], LabelSource]
    """Raises DataError where the clip lacks what the source needs, OptionError where an option does."""
    list_options: Callable[[SourceOptions], dict[str, Any]] = lambda options: {}
    """Options that the masks depend on, as JSON can hold them: others make other masks."""


def _open_lidar(clip: Clip, options: SourceOptions) -> LabelSource:
    from instdrive_core.masks.lidar.labels import LidarLabels

    return LidarLabels(clip)


def _open_sam(clip: Clip, options: SourceOptions) -> LabelSource:
    from instdrive_core.masks.sam.labels import SamLabels

    return SamLabels(clip, options.sam)


def _open_imported(clip: Clip, options: SourceOptions) -> LabelSource:
    if options.imported is None:
        raise OptionError("The source 'import' reads a folder of masks: name it with --from")
    from instdrive_core.masks.imported.labels import ImportedLabels

    return ImportedLabels(clip, options.imported)


def _list_import_options(options: SourceOptions) -> dict[str, Any]:
    return {} if options.imported is None else {"from": str(options.imported.resolve())}


MASK_SOURCES = (
    MaskSource(
        "exact",
        "a synthetic clip's labels",
        "exact labels ('labels/instances.json'), which only synthetic clips keep",
        lambda clip: has_exact_labels(clip.path),
        lambda clip, options: ExactLabels(clip.path),
    ),
    MaskSource(
        "annotations",
        "made from cuboids, semantic classes and LiDAR",
        "annotations: LiDAR with cuboids or semantic classes is needed",
        has_annotations,
        lambda clip, options: AnnotationLabels(clip, held_out=False),
    ),
    MaskSource(
        "lidar",
        "from LiDAR and photos alone",
        "LiDAR sweeps to make masks of",
        lambda clip: bool(clip.training_sweeps),
        _open_lidar,
    ),
    MaskSource(
        "sam",
        "by Segment Anything",
        "",
        lambda clip: True,
        _open_sam,
        lambda options: {"sam": asdict(options.sam)},
    ),
    MaskSource("import", "made elsewhere, see --from", "", lambda clip: True, _open_imported, _list_import_options),
)
"""Sources in the order in which help and errors list them. A new source is its file or room, a record here, and its
test."""


def find_mask_source(name: str) -> MaskSource:
    """Look a source up. Raises OptionError where there is none of this name."""
    for source in MASK_SOURCES:
        if source.name == name:
            return source
    raise OptionError(f"There is no source of masks '{name}'; choose {_list_names(MASK_SOURCES)}")


def open_mask_source(clip: Clip, name: str, options: SourceOptions = SourceOptions()) -> LabelSource:
    """Open what makes a clip's masks.

    Raises DataError where the clip lacks what the source needs, OptionError where an option does.
    """
    source = find_mask_source(name)
    if not source.fits(clip):
        others = [other for other in MASK_SOURCES if other is not source and other.fits(clip)]
        raise DataError(clip.path, f"has no {source.needs}", f"Use --source {_list_names(others)}")
    return source.open(clip, options)


def describe_mask_sources() -> str:
    """All sources in one line, for the command line's help."""
    return "; ".join(f"`{source.name}`: {source.summary}" for source in MASK_SOURCES)


def _list_names(sources: tuple[MaskSource, ...] | list[MaskSource]) -> str:
    *most, last = [source.name for source in sources]
    return f"{', '.join(most)} or {last}" if most else last
