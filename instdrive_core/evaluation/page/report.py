"""A measured run as one page with pictures, to be opened without the run, the clip or a network."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.evaluation.metrics.object_rows import ObjectRow
from instdrive_core.evaluation.metrics.sharing import MIN_SHARE, Holding
from instdrive_core.evaluation.page.cells import Cell, PageTable, build_fact_table, build_number_cell
from instdrive_core.evaluation.page.cutouts import cut_out_objects
from instdrive_core.evaluation.page.pictures import Picture
from instdrive_core.evaluation.page.rendering import write_page
from instdrive_core.evaluation.page.training import build_training_charts
from instdrive_core.evaluation.page.views import PICTURE_BUDGET, build_view_rows, format_color, list_error_colors
from instdrive_core.evaluation.protocol import Evaluation
from instdrive_core.evaluation.run_facts import read_run_facts
from instdrive_core.evaluation.tables import (
    IMAGES_ONLY,
    MAP_COLUMNS,
    POINT_COLUMNS,
    describe_split,
    format_figure,
    list_map_rows,
    list_point_rows,
    list_summary_rows,
)
from instdrive_core.evaluation.training_log import read_log
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.instances.table import InstanceTable

CUTOUT_BUDGET = 900_000
"""Bytes of a page that cut-outs may take."""


def write_report(path: Path, run: Path, evaluation: Evaluation) -> None:
    """Write the page of a run. Raises DataError where the run's facts cannot be read or the page not be written."""
    name, has_truth = run.resolve().name, evaluation.has_truth
    truth_of = {row.predicted_id: row.id for row in evaluation.objects if row.predicted_id is not None}
    views = build_view_rows(evaluation.scene, evaluation.views, truth_of if has_truth else None, PICTURE_BUDGET)
    write_page(
        path,
        "report.html.j2",
        f"{name}: evaluation",
        name=name,
        split=describe_split(evaluation),
        warning=_find_warning(evaluation),
        cards=_list_cards(evaluation),
        maps=_build_figure_table("predicted map", MAP_COLUMNS, list_map_rows(evaluation)) if has_truth else None,
        points=_build_figure_table("IDs", POINT_COLUMNS, list_point_rows(evaluation)),
        summary=build_fact_table(list_summary_rows(evaluation)),
        views=views,
        left_out=len(evaluation.views) - len(views),
        error_colors=list_error_colors(),
        objects=_build_object_table(evaluation) if has_truth else None,
        min_share=f"{MIN_SHARE:.0%}",
        confusions=_build_confusion_tables(evaluation) if has_truth else None,
        training=build_training_charts(read_log(run)),
        facts=build_fact_table({key: _format_fact(value) for key, value in read_run_facts(run).items()}),
    )


def _find_warning(evaluation: Evaluation) -> str:
    """Find what a reader must know before the figures; empty where there is nothing."""
    if not evaluation.has_truth:
        return f"RGB only: {IMAGES_ONLY}."
    if evaluation.privileged:
        return "Privileged: this run was trained with the annotations that it is measured with."
    return ""


def _list_cards(evaluation: Evaluation) -> dict[str, str]:
    """Headline figures by name."""
    figures = evaluation.figures
    cards = _list_instance_cards(figures) if evaluation.has_truth else {"SSIM": format_figure(figures["ssim"])}
    return cards | {"PSNR (dB)": format_figure(figures["psnr"], 2), "training (s)": f"{figures['train_seconds']:.0f}"}


def _list_instance_cards(figures: Mapping[str, Any]) -> dict[str, str]:
    scene, click = figures["scene"], figures["click"]
    recorded = figures["ground_truth"] == "annotations"
    things = {"things, scene mIoU": format_figure(scene["miou_things"])} if recorded else {}
    return things | {
        "scene mIoU": format_figure(scene["miou"]),
        "of the reference's": _format_ratio(scene["miou"], scene["reference_miou"]),
        "PQ": format_figure(scene["pq"]),
        "of the reference's PQ": _format_ratio(scene["pq"], scene["reference_pq"]),
        "clicks that hit": _format_percent(click["hit_rate"]),
    }


def _build_figure_table(
    first: str, columns: Sequence[str] | Mapping[str, str], rows: Mapping[str, Sequence[float | int | None]]
) -> PageTable:
    """Rows of figures by name, under a first column called `first`."""
    lines = [
        [Cell(name), *(build_number_cell(format_figure(value)) for value in values)] for name, values in rows.items()
    ]
    return PageTable((first, *columns), lines)


def _build_object_table(evaluation: Evaluation) -> PageTable:
    pictures = cut_out_objects(evaluation.scene, evaluation.views, evaluation.objects, CUTOUT_BUDGET)
    columns = ("", "object", "class", "kind", "pixels", "IoU", "recall", "in instances", "instance", "codes")
    lines = [_build_object_line(row, pictures.get(row.id), evaluation.scene.table) for row in evaluation.objects]
    return PageTable(columns, lines, "sortable", "objects")


def _build_object_line(row: ObjectRow, picture: Picture | None, instances: InstanceTable) -> list[Cell]:
    codes = None if row.codes is None else len(row.codes)
    return [
        Cell("", picture=picture),
        Cell(row.name, color=format_color(colors_from_ids(np.array(row.id, np.uint32)))),
        Cell(row.class_name),
        Cell(f"moving {row.kind}" if row.moving else row.kind),
        build_number_cell(f"{row.pixels:,}", row.pixels),
        build_number_cell(format_figure(row.iou), row.iou),
        build_number_cell(format_figure(row.recall), row.recall),
        build_number_cell(str(len(row.instances)), len(row.instances)),
        Cell("none" if row.predicted_id is None else _name_instance(row.predicted_id, instances)),
        build_number_cell(format_figure(codes), codes),
    ]


def _build_confusion_tables(evaluation: Evaluation) -> dict[str, PageTable]:
    """Tables of what shares an ID and of what is in several, by title."""
    objects = {row.id: row for row in evaluation.objects}
    instances = evaluation.scene.table

    def name_instance(number: int) -> str:
        return _name_instance(number, instances)

    def name_code(number: int) -> str:
        return f"code {number}"

    in_instances = {row.id: row.instances for row in evaluation.objects}
    in_codes = {
        row.id: tuple(Holding(holding.predicted_id - 1, holding.share) for holding in row.codes)
        for row in evaluation.objects
        if row.codes is not None
    }
    shared_instances, shared_codes = evaluation.shared_instances, evaluation.shared_codes
    return {
        "Objects that share an instance": _list_shared(
            "instance", shared_instances, in_instances, objects, name_instance
        ),
        "Objects in several instances": _list_divided(in_instances, objects, name_instance),
        "Objects that share a codeword": _list_shared("codeword", shared_codes, in_codes, objects, name_code),
        "Objects in several codewords": _list_divided(in_codes, objects, name_code),
    }


def _list_shared(
    kind: str,
    shared: Mapping[int, Sequence[int]],
    held: Mapping[int, Sequence[Holding]],
    objects: Mapping[int, ObjectRow],
    name_id: Callable[[int], str],
) -> PageTable:
    """IDs that count for several objects, most objects first."""
    lines = []
    for number, keys in sorted(shared.items(), key=lambda entry: -len(entry[1])):
        share = {key: next(each.share for each in held[key] if each.predicted_id == number) for key in keys}
        texts = [f"{objects[key].name} ({share[key]:.0%} of it)" for key in keys]
        lines.append([Cell(name_id(number)), build_number_cell(str(len(keys)), len(keys)), Cell(", ".join(texts))])
    return PageTable((kind, "shared by", "objects"), lines, "sortable")


def _list_divided(
    held: Mapping[int, Sequence[Holding]], objects: Mapping[int, ObjectRow], name_id: Callable[[int], str]
) -> PageTable:
    """Objects for which several IDs count, most IDs first."""
    lines = []
    for key, holdings in sorted(held.items(), key=lambda entry: -len(entry[1])):
        if len(holdings) > 1:
            texts = [f"{name_id(each.predicted_id)} ({each.share:.0%})" for each in holdings]
            count = build_number_cell(str(len(holdings)), len(holdings))
            lines.append([Cell(objects[key].name), count, Cell(", ".join(texts))])
    return PageTable(("object", "in", "share of its pixels"), lines, "sortable")


def _name_instance(number: int, instances: InstanceTable) -> str:
    return instances[number].name if number in instances else f"instance {number}"


def _format_fact(value: Any) -> str:
    return "–" if value is None else str(value)


def _format_ratio(value: float | None, bound: float | None) -> str:
    return "–" if value is None or not bound else _format_percent(value / bound)


def _format_percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.1%}"
