"""Measured runs side by side: which figures, which value is best, and what makes runs incomparable."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from instdrive_core.errors import DataError
from instdrive_core.evaluation.protocol import Progress, evaluate_run
from instdrive_core.evaluation.run_facts import FACTS, read_run_facts
from instdrive_core.evaluation.tables import format_figure, write_figures
from instdrive_core.formats.folder.scenes import MANIFEST

EVALUATED = "eval.json"
_NEEDED = ("psnr", "per_view", "scene", "clip", "cameras")
COMPARABLE = ("clip", "cameras")
"""Runs that differ in one of these are measured on different photos."""


@dataclass(frozen=True)
class ComparedFigure:
    """One row of a comparison."""

    key: str
    """Key of the protocol, parts joined by dots."""
    title: str
    better: Literal["higher", "lower"] | None
    """None: neither is."""
    digits: int = 3


COMPARED = (
    ComparedFigure("scene.miou", "scene mIoU", "higher"),
    ComparedFigure("scene.macc", "scene mAcc", "higher"),
    ComparedFigure("scene.pq", "PQ", "higher"),
    ComparedFigure("scene.acc25", "Acc @.25", "higher"),
    ComparedFigure("scene.acc50", "Acc @.5", "higher"),
    ComparedFigure("scene.id_switches", "ID switches", "lower", 0),
    ComparedFigure("scene.miou_things", "scene mIoU, things", "higher"),
    ComparedFigure("scene.miou_stuff", "scene mIoU, stuff", "higher"),
    ComparedFigure("per_view.miou", "view mIoU", "higher"),
    ComparedFigure("per_view.macc", "view mAcc", "higher"),
    ComparedFigure("per_view.miou_majority", "view mIoU, majority match", None),
    ComparedFigure("codeword.scene.miou", "codeword scene mIoU", "higher"),
    ComparedFigure("codeword.scene.macc", "codeword scene mAcc", "higher"),
    ComparedFigure("codeword.per_view.miou", "codeword view mIoU", "higher"),
    ComparedFigure("codeword.per_view.macc", "codeword view mAcc", "higher"),
    ComparedFigure("lidar.ap", "LiDAR AP", "higher"),
    ComparedFigure("lidar.ap50", "LiDAR AP50", "higher"),
    ComparedFigure("lidar.ap25", "LiDAR AP25", "higher"),
    ComparedFigure("lidar.miou", "LiDAR mIoU", "higher"),
    ComparedFigure("lidar.vmeasure", "LiDAR V-measure", "higher"),
    ComparedFigure("lidar.instances_per_object", "instances per object", "lower"),
    ComparedFigure("lidar.instances_to_cover", "instances to cover an object", "lower"),
    ComparedFigure("lidar.objects_per_instance", "objects per instance", "lower"),
    ComparedFigure("lidar.codes_per_object", "codewords per object", "lower"),
    ComparedFigure("lidar.objects_per_code", "objects per codeword", "lower"),
    ComparedFigure("click.hit_rate", "clicks that hit", "higher"),
    ComparedFigure("click.iou", "IoU of selections", "higher"),
    ComparedFigure("click.collateral", "collateral", "lower", 4),
    ComparedFigure("click.residue", "residue", "lower", 4),
    ComparedFigure("psnr", "PSNR (dB)", "higher", 2),
    ComparedFigure("psnr_actors", "PSNR, moving objects (dB)", "higher", 2),
    ComparedFigure("ssim", "SSIM", "higher"),
    ComparedFigure("n_gaussians", "Gaussians", None, 0),
    ComparedFigure("n_instances", "instances", None, 0),
    ComparedFigure("iterations", "iterations", None, 0),
    ComparedFigure("train_seconds", "training (s)", "lower", 0),
    ComparedFigure("peak_rss_mb", "memory (MB)", "lower", 0),
)
_FACTS = ("seed",)
"""Numbers that measure nothing."""
_REFERENCE, _REFERENCE_ONCE = "reference_", "oracle_"
"""Start of the reference's keys, and what it was up to version 0.1."""


@dataclass(frozen=True)
class MeasuredRun:
    """A run's figures under a name that tells it from the others."""

    name: str
    figures: dict[str, Any]
    folder: Path | None
    """None where only a file of figures was given."""

    def value(self, key: str) -> float | None:
        """A figure by its dotted key; None where it is unknown or does not apply."""
        found: Any = self.figures
        for part in key.split("."):
            found = found.get(part) if isinstance(found, dict) else None
        return found if isinstance(found, (int, float)) and not isinstance(found, bool) else None


@dataclass(frozen=True)
class ComparedCell:
    """One run's value of one figure."""

    text: str
    delta: str
    """Difference to the first run; empty for the first, and where either is unknown."""
    best: bool


def measure_runs(paths: Sequence[Path], fresh: bool, progress: Progress) -> list[MeasuredRun]:
    """Read or compute the figures of run folders and of files that `instdrive eval --json` wrote, in the order given.

    A folder's `eval.json` is taken where it is newer than the scene; else, or where `fresh`, the run is evaluated and
    the file written. Raises DataError for what is neither.
    """
    figures = [_measure_run(path, fresh, progress) for path in paths]
    folders = [path if path.is_dir() else None for path in paths]
    entries = zip(_choose_names(paths), figures, folders, strict=True)
    return [MeasuredRun(name, values, folder) for name, values, folder in entries]


def compare_runs(runs: Sequence[MeasuredRun]) -> list[tuple[ComparedFigure, list[ComparedCell]]]:
    """Lay the figures that any run knows side by side; references and figures without a row in `COMPARED` come last.

    Values that read the same are equally good; where all do, none is best.
    """
    rows = []
    for figure in (*COMPARED, *_list_further_figures(runs)):
        values = [run.value(figure.key) for run in runs]
        if any(value is not None for value in values):
            best = _find_best(values, figure)
            cells = [
                ComparedCell(
                    _format_value(value, figure),
                    _format_delta(value, values[0], figure) if number else "",
                    number in best,
                )
                for number, value in enumerate(values)
            ]
            rows.append((figure, cells))
    return rows


def find_differences(runs: Sequence[MeasuredRun]) -> list[str]:
    """Say what makes figures of these runs incomparable."""
    found = []
    for key in COMPARABLE:
        values = list(dict.fromkeys(str(run.figures.get(key)) for run in runs))
        if len(values) > 1:
            found.append(f"{key} differ ({', '.join(values)}): the runs are measured on different photos")
    return found


def _list_further_figures(runs: Sequence[MeasuredRun]) -> list[ComparedFigure]:
    known = {figure.key: figure for figure in COMPARED}
    keys = dict.fromkeys(
        key for run in runs for key in _list_keys(run.figures) if key not in known and key not in _FACTS
    )
    return [_build_further_figure(key, known) for key in keys]


def _build_further_figure(key: str, known: Mapping[str, ComparedFigure]) -> ComparedFigure:
    folder, _, name = key.rpartition(".")
    plain = known.get(f"{folder}.{name.removeprefix(_REFERENCE)}")
    if plain is None or not name.startswith(_REFERENCE):
        return ComparedFigure(key, key, None)
    return replace(plain, key=key, title=f"reference: {plain.title}")


def _list_keys(figures: dict[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in figures.items():
        if isinstance(value, dict):
            yield from _list_keys(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


def _measure_run(path: Path, fresh: bool, progress: Progress) -> dict[str, Any]:
    if path.is_file():
        return _read_figures(path)
    if not path.exists():
        raise DataError(
            path, "there is no such run or file", "Give folders that `train` wrote, or files of `eval --json`."
        )
    read_run_facts(path)
    evaluated = path / EVALUATED
    if not fresh and evaluated.is_file() and _is_newer_than_scene(evaluated, path):
        return _read_figures(evaluated)
    figures = evaluate_run(path, progress).figures
    write_figures(evaluated, figures)
    return figures


def _is_newer_than_scene(evaluated: Path, run: Path) -> bool:
    written = [(run / name).stat().st_mtime_ns for name in (MANIFEST, FACTS) if (run / name).is_file()]
    return evaluated.stat().st_mtime_ns >= max(written)


def _read_figures(path: Path) -> dict[str, Any]:
    remedy = "Give a folder that `train` wrote, or a file that `eval --json` wrote."
    try:
        figures = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(path, f"is not valid JSON ({error})", remedy) from error
    missing = [key for key in _NEEDED if not isinstance(figures, dict) or key not in figures]
    if missing:
        raise DataError(path, f"field {missing[0]!r} is missing, so these are no figures of an evaluation", remedy)
    return _rename_keys(figures)


def _rename_keys(figures: dict[str, Any]) -> dict[str, Any]:
    """Rename the keys of files that earlier versions wrote."""
    return {
        _REFERENCE + key.removeprefix(_REFERENCE_ONCE) if key.startswith(_REFERENCE_ONCE) else key: (
            _rename_keys(value) if isinstance(value, dict) else value
        )
        for key, value in figures.items()
    }


def _choose_names(paths: Sequence[Path]) -> list[str]:
    """Choose the last parts of each path that tell it from the others; a run's `eval.json` is named by its folder."""
    whole = [path.resolve() for path in paths]
    named = [
        path.parent if path.name == EVALUATED else path.with_suffix("") if path.is_file() else path for path in whole
    ]
    if len(set(named)) < len(named):  # the same run twice, or as folder and as file
        named = whole
    for count in range(1, max(len(path.parts) for path in named)):
        names = ["/".join(path.parts[-count:]) for path in named]
        if len(set(names)) == len(set(named)):
            return names
    return [str(path) for path in named]


def _find_best(values: Sequence[float | None], figure: ComparedFigure) -> set[int]:
    known = {number: round(value, figure.digits) for number, value in enumerate(values) if value is not None}
    if figure.better is None or len(set(known.values())) < 2:
        return set()
    best = max(known.values()) if figure.better == "higher" else min(known.values())
    return {number for number, value in known.items() if value == best}


def _format_value(value: float | None, figure: ComparedFigure) -> str:
    if value is None:
        return format_figure(None)
    return f"{value:,.{figure.digits}f}"


def _format_delta(value: float | None, first: float | None, figure: ComparedFigure) -> str:
    return "" if value is None or first is None else f"{value - first:+,.{figure.digits}f}"
