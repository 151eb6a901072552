"""A measured run as one page with pictures, to be opened without the run, the clip or a network."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.evaluation.metrics.object_rows import ObjectRow
from instdrive_core.evaluation.metrics.sharing import MIN_SHARE, Holding
from instdrive_core.evaluation.page.cutouts import cutouts
from instdrive_core.evaluation.page.elements import Content, Markup, element, joined
from instdrive_core.evaluation.page.page import card, color_switch, number_cell, section, table, write_page
from instdrive_core.evaluation.page.training import training_charts
from instdrive_core.evaluation.page.views import PICTURE_BUDGET, error_legend, view_rows
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
    name = run.resolve().name
    write_page(
        path,
        f"{name}: evaluation",
        element("h1", name),
        element("p", describe_split(evaluation), class_="dim"),
        _note(evaluation),
        _headline(evaluation),
        section("Predicted maps, oracle and controls", _map_table(evaluation)) if evaluation.has_truth else None,
        _points(evaluation),
        section(
            "Images, clicks, cost" if evaluation.has_truth else "Images, cost", _pairs(list_summary_rows(evaluation))
        ),
        _views(evaluation),
        _objects(evaluation) if evaluation.has_truth else None,
        _confusions(evaluation) if evaluation.has_truth else None,
        section("Training", training_charts(read_log(run)) or element("p", "This run kept no log.", class_="dim")),
        section("Run", _pairs({key: _fact_text(value) for key, value in read_run_facts(run).items()})),
    )


def _note(evaluation: Evaluation) -> Markup | None:
    """What a reader must know before the figures."""
    if not evaluation.has_truth:
        return element("p", f"RGB only: {IMAGES_ONLY}.", class_="warning")
    if not evaluation.privileged:
        return None
    text = "Privileged: this run was trained with the annotations that it is measured with."
    return element("p", text, class_="warning")


def _headline(evaluation: Evaluation) -> Markup:
    figures = evaluation.figures
    cards = _instance_cards(figures) if evaluation.has_truth else {"SSIM": format_figure(figures["ssim"])}
    cards |= {"PSNR (dB)": format_figure(figures["psnr"], 2), "training (s)": f"{figures['train_seconds']:.0f}"}
    return element("div", *(card(value, name) for name, value in cards.items()), class_="cards")


def _instance_cards(figures: Mapping[str, Any]) -> dict[str, str]:
    scene, click = figures["scene"], figures["click"]
    return {
        "scene mIoU": format_figure(scene["miou"]),
        "of the oracle's": _ratio(scene["miou"], scene["oracle_miou"]),
        "PQ": format_figure(scene["pq"]),
        "of the oracle's PQ": _ratio(scene["pq"], scene["oracle_pq"]),
        "clicks that hit": _percent(click["hit_rate"]),
    }


def _map_table(evaluation: Evaluation) -> Markup:
    rows = [
        [name, *(number_cell(format_figure(value)) for value in values)]
        for name, values in list_map_rows(evaluation).items()
    ]
    note = (
        "Oracle: the true ID of every Gaussian, the bound on this geometry. Instance: what a click selects. Codeword: "
        "the nearest code of the rendered feature. Below them what trivial IDs reach on the same geometry."
    )
    return joined(table(("predicted map", *MAP_COLUMNS), rows), element("p", note, class_="dim small"))


def _points(evaluation: Evaluation) -> Markup | None:
    rows = [
        [name, *(number_cell(format_figure(value)) for value in values)]
        for name, values in list_point_rows(evaluation).items()
    ]
    return section("LiDAR points of held-out sweeps", table(("IDs", *POINT_COLUMNS), rows)) if rows else None


def _views(evaluation: Evaluation) -> Markup:
    truth_of = {row.predicted_id: row.id for row in evaluation.objects if row.predicted_id is not None}
    rows = view_rows(evaluation.scene, evaluation.views, truth_of if evaluation.has_truth else None, PICTURE_BUDGET)
    note = (
        "An object and the instance matched to it (one match for the whole scene) share a colour in both maps; grey "
        "with stripes are instances that match no object, and objects that no instance matches."
    )
    left_out = len(evaluation.views) - len(rows)
    legend = (element("p", note, class_="dim small"), color_switch(), error_legend()) if evaluation.has_truth else ()
    return section(
        "Held-out views",
        *legend,
        element("p", f"{left_out} further views are left out to keep this page small.", class_="dim")
        if left_out
        else None,
        *rows,
    )


def _objects(evaluation: Evaluation) -> Markup:
    if not evaluation.objects:
        return section("Objects", element("p", "This scene has no instances.", class_="dim"))
    pictures = cutouts(evaluation.scene, evaluation.views, evaluation.objects, CUTOUT_BUDGET)
    columns = ("", "object", "class", "kind", "pixels", "IoU", "recall", "in instances", "instance", "codes")
    lines = [_object_line(row, pictures.get(row.id), evaluation.scene.table) for row in evaluation.objects]
    note = (
        "Cut-outs: bright is what object and matched instance share, blue is missed, vermilion is too much. An "
        f"instance counts for an object if it holds {MIN_SHARE:.0%} of its pixels. Click a heading to sort."
    )
    field = element(
        "input", class_="filter", type="search", placeholder="filter", data_table="objects", aria_label="Filter objects"
    )
    shown = table(columns, lines, class_="sortable", id="objects")
    return section("Objects", element("p", note, class_="dim small"), field, shown)


def _object_line(row: ObjectRow, picture: Markup | None, instances: InstanceTable) -> list[Content]:
    kind = f"moving {row.kind}" if row.moving else row.kind
    matched = "none" if row.predicted_id is None else _instance_name(row.predicted_id, instances)
    codes = None if row.codes is None else len(row.codes)
    return [
        picture or element("td", ""),
        joined(_swatch(row.id), row.name),
        row.class_name,
        kind,
        number_cell(f"{row.pixels:,}", row.pixels),
        number_cell(format_figure(row.iou), row.iou),
        number_cell(format_figure(row.recall), row.recall),
        number_cell(str(len(row.instances)), len(row.instances)),
        matched,
        number_cell(format_figure(codes), codes),
    ]


def _confusions(evaluation: Evaluation) -> Markup:
    names = {row.id: row for row in evaluation.objects}
    instances = evaluation.scene.table

    def instance(number: int) -> str:
        return _instance_name(number, instances)

    def code(number: int) -> str:
        return f"code {number}"

    in_instances = {row.id: row.instances for row in evaluation.objects}
    in_codes = {
        row.id: tuple(Holding(holding.predicted_id - 1, holding.share) for holding in row.codes)
        for row in evaluation.objects
        if row.codes is not None
    }
    parts = [
        element("h3", "Objects that share an instance"),
        _shared("instance", evaluation.shared_instances, in_instances, names, instance),
        element("h3", "Objects in several instances"),
        _spread(in_instances, names, instance),
        element("h3", "Objects that share a codeword"),
        _shared("codeword", evaluation.shared_codes, in_codes, names, code),
        element("h3", "Objects in several codewords"),
        _spread(in_codes, names, code),
    ]
    return section("Confusion of codes", *parts)


def _shared(
    kind: str,
    shared: Mapping[int, Sequence[int]],
    held: Mapping[int, Sequence[Holding]],
    names: Mapping[int, ObjectRow],
    title: Callable[[int], str],
) -> Markup:
    lines = []
    for number, objects in sorted(shared.items(), key=lambda entry: -len(entry[1])):
        share = {key: next(each.share for each in held[key] if each.predicted_id == number) for key in objects}
        texts = [f"{names[key].name} ({share[key]:.0%} of it)" for key in objects]
        lines.append([title(number), number_cell(str(len(objects)), len(objects)), ", ".join(texts)])
    return _table_or_none((kind, "shared by", "objects"), lines)


def _spread(
    held: Mapping[int, Sequence[Holding]], names: Mapping[int, ObjectRow], title: Callable[[int], str]
) -> Markup:
    lines = []
    for key, holdings in sorted(held.items(), key=lambda entry: -len(entry[1])):
        if len(holdings) > 1:
            texts = [f"{title(each.predicted_id)} ({each.share:.0%})" for each in holdings]
            lines.append([names[key].name, number_cell(str(len(holdings)), len(holdings)), ", ".join(texts)])
    return _table_or_none(("object", "in", "share of its pixels"), lines)


def _table_or_none(columns: Sequence[str], lines: Sequence[Sequence[Content]]) -> Markup:
    return table(columns, lines, class_="sortable") if lines else element("p", "None.", class_="dim")


def _pairs(rows: Mapping[str, str]) -> Markup:
    return table((), [[name, value] for name, value in rows.items()], class_="facts")


def _instance_name(number: int, instances: InstanceTable) -> str:
    return instances[number].name if number in instances else f"instance {number}"


def _swatch(number: int) -> Markup:
    red, green, blue = colors_from_ids(np.array(number, np.uint32)).tolist()
    return element("span", class_="swatch", style=f"background:rgb({red},{green},{blue})")


def _fact_text(value: Any) -> str:
    return "–" if value is None else str(value)


def _ratio(value: float | None, bound: float | None) -> str:
    return "–" if value is None or not bound else _percent(value / bound)


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.1%}"
