"""Measured runs side by side as one page: figures, the same held-out views of each, how training went."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.comparison import ComparedCell, MeasuredRun, compare_runs, find_differences
from instdrive_core.evaluation.metrics.held_out import measure_held_out_view
from instdrive_core.evaluation.metrics.object_rows import count_over_views
from instdrive_core.evaluation.page.elements import Content, Markup, element, joined
from instdrive_core.evaluation.page.map_colors import truth_of_predicted
from instdrive_core.evaluation.page.page import color_switch, number_cell, section, table, write_page
from instdrive_core.evaluation.page.pictures import photo_picture
from instdrive_core.evaluation.page.training import compared_charts
from instdrive_core.evaluation.page.views import (
    PICTURE_BUDGET,
    DrawnView,
    captioned,
    drawn_view,
    id_map,
    right_share,
    self_matched,
)
from instdrive_core.evaluation.run_facts import build_clip_options, read_run_facts
from instdrive_core.evaluation.training_log import read_log
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.masks.ground_truth import find_ground_truth

_FACTS = ("method", "preset", "masks", "seed", "scale", "clip", "cameras", "backend", "threads")


def write_comparison(path: Path, runs: Sequence[MeasuredRun]) -> None:
    """Write the page of several runs. Views are drawn of the runs given as folders whose clip can be read; the page
    says why others are missing. Raises DataError where it cannot be written."""
    names = [run.name for run in runs]
    folders = {run.name: run.folder for run in runs if run.folder is not None}
    logs = {name: read_log(folder) for name, folder in folders.items()}
    charts = compared_charts({name: steps for name, steps in logs.items() if steps})
    write_page(
        path,
        f"Comparison of {', '.join(names)}",
        element("h1", " · ".join(names)),
        *(element("p", text, class_="warning") for text in find_differences(runs)),
        section("Figures", _figure_table(runs)),
        _views(folders),
        section("Training", charts) if charts else None,
        section("Runs", _fact_table(runs)),
    )


def _figure_table(runs: Sequence[MeasuredRun]) -> Markup:
    rows = [[figure.title, *(_cell(cell) for cell in cells)] for figure, cells in compare_runs(runs)]
    note = "Best values are marked unless all are equal; below each value its difference to the first run."
    shown = table(("figure", *(run.name for run in runs)), rows)
    return joined(shown, element("p", note, class_="dim small"))


def _cell(cell: ComparedCell) -> Markup:
    return number_cell(cell.text, None, cell.delta, class_="best" if cell.best else "")


def _fact_table(runs: Sequence[MeasuredRun]) -> Markup:
    facts = [run.figures if run.folder is None else read_run_facts(run.folder) for run in runs]
    rows = []
    for key in _FACTS:
        values = [each.get(key) for each in facts]
        if any(value is not None for value in values):
            rows.append([key, *("–" if value is None else str(value) for value in values)])
    return table(("fact", *(run.name for run in runs)), rows)


def _views(folders: dict[str, Path]) -> Markup | None:
    """The middle held-out time step of every camera, one column per run."""
    drawn: dict[str, _RunViews] = {}
    notes: list[Content] = []
    for name, folder in folders.items():
        try:
            drawn[name] = _run_views(folder)
        except InstDriveError as error:
            notes.append(element("p", f"No views of {name}: {error}", class_="warning"))
    titles = list(dict.fromkeys(title for views in drawn.values() for title in views.views))
    if not titles:
        return section("Held-out views", *notes) if notes else None
    rows, budget = [], PICTURE_BUDGET
    for title in titles:
        row = _view_row(title, drawn)
        budget -= len(row)
        if budget < 0:
            notes.append(element("p", f"{len(titles) - len(rows)} further views are left out.", class_="dim"))
            break
        rows.append(row)
    note = "In ID maps an instance has the colour of the object that it is matched to in these views; grey: of none."
    has_maps = any(view.truth.any() for run in drawn.values() for view in run.views.values())
    legend = (element("p", note, class_="dim small"), color_switch()) if has_maps else ()
    return section("Held-out views", *legend, *notes, *rows)


class _RunViews:
    """One run's views by title, and its match over them."""

    def __init__(self, views: dict[str, DrawnView], truth_of: dict[int, int]) -> None:
        self.views, self.truth_of = views, truth_of


def _run_views(run: Path) -> _RunViews:
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
    drawn = [drawn_view(scene, view) for view in measured]
    labelled = [view.with_ids(scene.instance_ids) for view in measured]
    truth_of = truth_of_predicted(count_over_views(labelled)) if labelled else {}
    return _RunViews({view.title: view for view in drawn}, truth_of)


def _view_row(title: str, runs: dict[str, _RunViews]) -> Markup:
    first = next(run.views[title] for run in runs.values() if title in run.views)
    everything = self_matched(set(first.truth[first.truth > 0].tolist()))
    images: list[Content] = [captioned(photo_picture(first.photo, f"photo: {title}"), "photo")]
    maps: list[Content] = [captioned(id_map(first.truth, everything, f"ground truth: {title}"), "ground truth")]
    for name, run in runs.items():
        view = run.views.get(title)
        if view is None:
            missing = captioned(None, f"{name} has no such view")
            images.append(missing)
            maps.append(missing)
            continue
        psnr = "" if view.psnr is None else f", PSNR {view.psnr:.2f} dB"
        share = right_share(view.truth, view.predicted, run.truth_of)
        right = "" if share is None else f", {share:.1%} of the labelled pixels right"
        images.append(captioned(photo_picture(view.image, f"{name}: {title}"), f"{name}{psnr}"))
        text = f"{name}, instance map: {title}"
        maps.append(captioned(id_map(view.predicted, run.truth_of, text), f"{name}{right}"))
    columns = f"grid-template-columns:repeat({len(images)},minmax(180px,1fr));overflow-x:auto"
    shown = images + maps if first.truth.any() else images
    grid = element("div", *shown, class_="views", style=columns)
    return joined(element("h3", title), grid)
