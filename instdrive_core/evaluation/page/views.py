"""Held-out views as rows of pictures: photo, image, instance map, ground truth, errors."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import UInt8, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Frame
from instdrive_core.evaluation.metrics.held_out import HeldOutView
from instdrive_core.evaluation.page.elements import Content, Markup, element, joined
from instdrive_core.evaluation.page.map_colors import (
    ERROR_COLORS,
    ERROR_NAMES,
    IGNORED,
    bijective_colors,
    error_categories,
    error_colors,
    matched_colors,
)
from instdrive_core.evaluation.page.pictures import as_bytes, map_picture, photo_picture
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.exposure import apply_exposure
from instdrive_core.scene.scene import Scene

PICTURE_BUDGET = 4_500_000
"""Bytes of a page that views may take: it is to be sent by mail."""
MAX_VIEWS = 18
"""More are not drawn: each takes some 0.3 s."""


@dataclass(frozen=True)
class DrawnView:
    """One held-out view with everything that is drawn of it."""

    title: str
    photo: UInt8[ndarray, "h w 3"]
    image: UInt8[ndarray, "h w 3"]
    """What the scene shows, exposed as PSNR compares it."""
    truth: UInt32[ndarray, "h w"]
    predicted: UInt32[ndarray, "h w"]
    psnr: float | None


def drawn_view(scene: Scene, view: HeldOutView) -> DrawnView:
    """Draw a measured view once more, with its picture."""
    return DrawnView(
        title=view_title(view.frame),
        photo=view.frame.load_image(),
        image=as_bytes(_exposed_image(scene, view.frame)),
        truth=view.truth,
        predicted=np.asarray(view.with_ids(scene.instance_ids).predicted, np.uint32),
        psnr=view.psnr,
    )


def view_title(frame: Frame) -> str:
    """Camera and time step."""
    return f"{frame.view.name}, step {frame.view.index}"


def view_rows(
    scene: Scene, views: Sequence[HeldOutView], truth_of: Mapping[int, int] | None, budget: int
) -> list[Markup]:
    """As many views as fit into `budget` bytes, at most `MAX_VIEWS`, spread over the time steps, in the order given.

    Args:
        truth_of: the ground-truth ID that each matched predicted ID stands for; None where nothing is labelled, so
            that there is neither ground truth nor error to show.
    """
    rows: dict[int, Markup] = {}
    for number in islice(spread_over_steps([view.frame.view.index for view in views]), MAX_VIEWS):
        row = _view_row(drawn_view(scene, views[number]), truth_of)
        budget -= len(row)
        if budget < 0:
            break
        rows[number] = row
    return [rows[number] for number in sorted(rows)]


def spread_over_steps(steps: Sequence[int]) -> Iterator[int]:
    """Positions in `steps`: all of one step, then all of another far from it, so that any beginning covers the clip."""
    distinct = sorted(set(steps))
    spread = sorted(range(len(distinct)), key=lambda number: int(f"{number:032b}"[::-1], 2))
    for chosen in spread:
        yield from (number for number, step in enumerate(steps) if step == distinct[chosen])


def error_legend() -> Markup:
    """What the colours of an error map mean."""
    entries = []
    for category, name in ERROR_NAMES.items():
        red, green, blue = ERROR_COLORS[category].tolist()
        swatch = element("span", class_="swatch", style=f"background:rgb({red},{green},{blue})")
        entries.append(element("span", swatch, name))
    return element("div", *entries, class_="legend")


def id_map(ids: UInt32[ndarray, "h w"], truth_of: Mapping[int, int], text: str) -> Markup:
    """A map twice: in the colours of matched objects, and in the bijective ones; the page shows one of them."""
    return joined(
        map_picture(matched_colors(ids, truth_of), text, class_="map matched"),
        map_picture(bijective_colors(ids), f"{text}, bijective colours", class_="map bijective"),
    )


def captioned(picture: Content, caption: str) -> Markup:
    """A picture and the line below it."""
    return element("figure", picture, element("figcaption", caption))


def right_share(truth: ndarray, predicted: ndarray, truth_of: Mapping[int, int]) -> float | None:
    """Share of the labelled pixels that carry the ID of their object; None where none is labelled."""
    shares = _category_shares(error_categories(truth, predicted, truth_of))
    return shares[1] if shares is not None else None


def _view_row(view: DrawnView, truth_of: Mapping[int, int] | None) -> Markup:
    psnr = "" if view.psnr is None else f", PSNR {view.psnr:.2f} dB"
    pictures = [
        captioned(photo_picture(view.photo, f"photo: {view.title}"), "photo"),
        captioned(photo_picture(view.image, f"image: {view.title}"), f"image{psnr}"),
    ]
    if truth_of is not None:
        pictures += _compared_maps(view, truth_of)
    elif view.predicted.any():
        shown = map_picture(bijective_colors(view.predicted), f"instance map: {view.title}", class_="map")
        pictures.append(captioned(shown, "instance map"))
    return joined(element("h3", view.title), element("div", *pictures, class_="views"))


def _compared_maps(view: DrawnView, truth_of: Mapping[int, int]) -> list[Markup]:
    categories = error_categories(view.truth, view.predicted, truth_of)
    matched = self_matched(truth_of.values())
    return [
        captioned(id_map(view.predicted, truth_of, f"instance map: {view.title}"), "instance map"),
        captioned(id_map(view.truth, matched, f"ground truth: {view.title}"), "ground truth"),
        captioned(
            map_picture(error_colors(categories, view.truth), f"errors: {view.title}", class_="map"),
            _error_caption(categories),
        ),
    ]


def self_matched(truth_ids: Collection[int]) -> dict[int, int]:
    """Ground-truth IDs that stand for themselves."""
    return {truth_id: truth_id for truth_id in truth_ids}


def _category_shares(categories: ndarray) -> list[float] | None:
    counts = np.bincount(categories.ravel(), minlength=len(ERROR_NAMES))
    counts[IGNORED] = 0
    return (counts / counts.sum()).tolist() if counts.sum() else None


def _error_caption(categories: ndarray) -> str:
    shares = _category_shares(categories)
    if shares is None:
        return "errors: nothing is labelled"
    _, right, other, piece, nothing = (f"{share:.1%}" for share in shares)
    return f"errors: {right} right, {other} other object's ID, {piece} further pieces, {nothing} none"


def _exposed_image(scene: Scene, frame: Frame) -> ndarray:
    image = view_scene(scene, frame.view.camera, frame.view.time).color
    if scene.exposures is None:
        return image
    return apply_exposure(image, scene.exposures.at(frame.view.name, frame.view.time))
