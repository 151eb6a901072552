"""Measured runs side by side as one page: figures, the same held-out views of each, how training went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.comparison import MeasuredRun, compare_runs, find_differences
from instdrive_core.evaluation.metrics.held_out import measure_held_out_view
from instdrive_core.evaluation.metrics.object_rows import count_over_views
from instdrive_core.evaluation.page.cells import Cell, PageTable, build_number_cell
from instdrive_core.evaluation.page.map_colors import match_ids
from instdrive_core.evaluation.page.rendering import write_page
from instdrive_core.evaluation.page.training import build_compared_charts
from instdrive_core.evaluation.page.views import (
    PICTURE_BUDGET,
    CaptionedPicture,
    PicturedView,
    ViewRow,
    caption_id_map,
    caption_photo,
    compute_right_share,
    match_to_themselves,
    picture_view,
)
from instdrive_core.evaluation.run_facts import build_clip_options, read_run_facts
from instdrive_core.evaluation.training_log import read_log
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.masks.ground_truth import find_ground_truth

_FACTS = ("method", "preset", "masks", "seed", "scale", "clip", "cameras", "backend", "threads")


@dataclass(frozen=True)
class _RunViews:
    """One run's views by title, and its match over them."""

    views: dict[str, PicturedView]
    truth_of: dict[int, int]
    """Ground-truth ID by the instance that is matched to it."""


def write_comparison(path: Path, runs: Sequence[MeasuredRun]) -> None:
    """Write the page of several runs.

    Views are drawn of the runs given as folders whose clip can be read; the page says why others are missing. Raises
    DataError where the page cannot be written.
    """
    names = [run.name for run in runs]
    folders = {run.name: run.folder for run in runs if run.folder is not None}
    logs = {name: read_log(folder) for name, folder in folders.items()}
    drawn, view_warnings = _draw_views(folders)
    rows, left_out = _build_view_rows(drawn)
    write_page(
        path,
        "comparison.html.j2",
        f"Comparison of {', '.join(names)}",
        heading=" · ".join(names),
        warnings=find_differences(runs),
        figures=_build_figure_table(runs),
        views=rows,
        view_warnings=view_warnings,
        left_out=left_out,
        has_maps=any(view.truth.any() for run in drawn.values() for view in run.views.values()),
        training=build_compared_charts({name: steps for name, steps in logs.items() if steps}),
        facts=_build_fact_table(runs),
    )


def _build_figure_table(runs: Sequence[MeasuredRun]) -> PageTable:
    rows = [
        [Cell(figure.title), *(build_number_cell(cell.text, None, cell.delta, cell.best) for cell in cells)]
        for figure, cells in compare_runs(runs)
    ]
    return PageTable(("figure", *(run.name for run in runs)), rows)


def _build_fact_table(runs: Sequence[MeasuredRun]) -> PageTable:
    facts = [run.figures if run.folder is None else read_run_facts(run.folder) for run in runs]
    rows = []
    for key in _FACTS:
        values = [each.get(key) for each in facts]
        if any(value is not None for value in values):
            rows.append([Cell(key), *(Cell("–" if value is None else str(value)) for value in values)])
    return PageTable(("fact", *(run.name for run in runs)), rows)


def _draw_views(folders: Mapping[str, Path]) -> tuple[dict[str, _RunViews], list[str]]:
    """Views of each run that can be read, by its name, and why others are missing."""
    drawn: dict[str, _RunViews] = {}
    warnings = []
    for name, folder in folders.items():
        try:
            drawn[name] = _draw_run(folder)
        except InstDriveError as error:
            warnings.append(f"No views of {name}: {error}")
    return drawn, warnings


def _draw_run(run: Path) -> _RunViews:
    """Draw the middle held-out time step of every camera."""
    facts = read_run_facts(run)
    scene, clip = read_scene_folder(run), load_clip(facts["clip"], build_clip_options(facts))
    ground_truth = find_ground_truth(clip)
    frames = clip.held_out_frames
    steps = sorted({frame.view.index for frame in frames})
    measured = [
        measure_held_out_view(scene, clip, frame, ground_truth)
        for frame in frames
        if frame.view.index == steps[len(steps) // 2]
    ]
    drawn = [picture_view(scene, view) for view in measured]
    labelled = [view.with_ids(scene.instance_ids) for view in measured]
    truth_of = match_ids(count_over_views(labelled)) if labelled else {}
    return _RunViews({view.title: view for view in drawn}, truth_of)


def _build_view_rows(runs: Mapping[str, _RunViews]) -> tuple[list[ViewRow], int]:
    """Rows of the views that any run has, as far as they fit into a page, and how many do not."""
    titles = list(dict.fromkeys(title for run in runs.values() for title in run.views))
    rows, budget = [], PICTURE_BUDGET
    for title in titles:
        row = _build_view_row(title, runs)
        budget -= row.byte_count
        if budget < 0:
            break
        rows.append(row)
    return rows, len(titles) - len(rows)


def _build_view_row(title: str, runs: Mapping[str, _RunViews]) -> ViewRow:
    """Photo and ground truth first, then one column per run."""
    first = next(run.views[title] for run in runs.values() if title in run.views)
    everything = match_to_themselves(set(first.truth[first.truth > 0].tolist()))
    images = [caption_photo(first.photo, f"photo: {title}", "photo")]
    maps = [caption_id_map(first.truth, everything, f"ground truth: {title}", "ground truth")]
    for name, run in runs.items():
        view = run.views.get(title)
        if view is None:
            missing = CaptionedPicture(None, f"{name} has no such view")
            images.append(missing)
            maps.append(missing)
            continue
        psnr = "" if view.psnr is None else f", PSNR {view.psnr:.2f} dB"
        share = compute_right_share(view.truth, view.predicted, run.truth_of)
        right = "" if share is None else f", {share:.1%} of the labelled pixels right"
        text = f"{name}, instance map: {title}"
        images.append(caption_photo(view.image, f"{name}: {title}", f"{name}{psnr}"))
        maps.append(caption_id_map(view.predicted, run.truth_of, text, f"{name}{right}"))
    return ViewRow(title, images + maps if first.truth.any() else images, len(images))
