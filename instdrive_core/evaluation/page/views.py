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
from instdrive_core.evaluation.page.map_colors import (
    ERROR_COLORS,
    ERROR_NAMES,
    IGNORED,
    classify_pixels,
    color_bijectively,
    color_errors,
    color_matched,
)
from instdrive_core.evaluation.page.pictures import Picture, convert_to_bytes, encode_map, encode_photo
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.exposure import apply_exposure
from instdrive_core.scene.scene import Scene

PICTURE_BUDGET = 4_500_000
"""Bytes of a page that views may take: it is to be sent by mail."""
MAX_VIEWS = 18
"""More are not drawn: each takes some 0.3 s."""


@dataclass(frozen=True)
class PicturedView:
    """One held-out view with everything that is drawn of it."""

    title: str
    photo: UInt8[ndarray, "h w 3"]
    image: UInt8[ndarray, "h w 3"]
    """Picture of the scene, exposed as PSNR compares it."""
    truth: UInt32[ndarray, "h w"]
    predicted: UInt32[ndarray, "h w"]
    psnr: float | None


@dataclass(frozen=True)
class CaptionedPicture:
    """A picture and the line below it."""

    picture: Picture | None
    caption: str
    by_id: Picture | None = None
    """An ID map in the colours of the bijective map; the page shows either it or `picture`."""

    @property
    def byte_count(self) -> int:
        """Bytes that the pictures take in a page."""
        return sum(shown.byte_count for shown in (self.picture, self.by_id) if shown is not None)


@dataclass(frozen=True)
class ViewRow:
    """Pictures of one view under its title."""

    title: str
    pictures: Sequence[CaptionedPicture]
    columns: int | None = None
    """Pictures side by side; None = as many as fit."""

    @property
    def byte_count(self) -> int:
        """Bytes that the pictures take in a page."""
        return sum(shown.byte_count for shown in self.pictures)


def picture_view(scene: Scene, view: HeldOutView) -> PicturedView:
    """Draw a measured view once more, with its picture."""
    return PicturedView(
        title=title_view(view.frame),
        photo=view.frame.load_image(),
        image=convert_to_bytes(_render_exposed(scene, view.frame)),
        truth=view.truth,
        predicted=np.asarray(view.with_ids(scene.instance_ids).predicted, np.uint32),
        psnr=view.psnr,
    )


def title_view(frame: Frame) -> str:
    """Name a view by camera and time step."""
    return f"{frame.view.name}, step {frame.view.index}"


def build_view_rows(
    scene: Scene, views: Sequence[HeldOutView], truth_of: Mapping[int, int] | None, budget: int
) -> list[ViewRow]:
    """Build the rows of as many views as fit into `budget` bytes, at most `MAX_VIEWS`, in the order given.

    Which ones is spread over the time steps.

    Args:
        scene: the scene that is shown.
        views: its measured views.
        truth_of: the ground-truth ID that each matched predicted ID stands for; None where nothing is labelled, so
            that there is neither ground truth nor error to show.
        budget: bytes that all pictures together may take.
    """
    rows: dict[int, ViewRow] = {}
    for number in islice(spread_over_steps([view.frame.view.index for view in views]), MAX_VIEWS):
        row = _build_view_row(picture_view(scene, views[number]), truth_of)
        budget -= row.byte_count
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


def list_error_colors() -> dict[str, str]:
    """List what the colours of an error map mean: CSS colour by name."""
    return {name: format_color(ERROR_COLORS[category]) for category, name in ERROR_NAMES.items()}


def format_color(color: UInt8[ndarray, "3"]) -> str:
    """Write an RGB colour as CSS does."""
    red, green, blue = color.tolist()
    return f"rgb({red},{green},{blue})"


def caption_photo(image: UInt8[ndarray, "h w 3"], text: str, caption: str) -> CaptionedPicture:
    """Encode a photo with the line below it."""
    return CaptionedPicture(encode_photo(image, text), caption)


def caption_id_map(
    ids: UInt32[ndarray, "h w"], truth_of: Mapping[int, int], text: str, caption: str
) -> CaptionedPicture:
    """Encode an ID map in the colours of matched objects and in the bijective ones, with the line below it."""
    matched = encode_map(color_matched(ids, truth_of), text)
    return CaptionedPicture(matched, caption, encode_map(color_bijectively(ids), f"{text}, bijective colours"))


def compute_right_share(truth: ndarray, predicted: ndarray, truth_of: Mapping[int, int]) -> float | None:
    """Share of the labelled pixels that carry the ID of their object; None where none is labelled."""
    shares = _compute_category_shares(classify_pixels(truth, predicted, truth_of))
    return shares[1] if shares is not None else None


def match_to_themselves(truth_ids: Collection[int]) -> dict[int, int]:
    """Ground-truth IDs that stand for themselves."""
    return {truth_id: truth_id for truth_id in truth_ids}


def _build_view_row(view: PicturedView, truth_of: Mapping[int, int] | None) -> ViewRow:
    psnr = "" if view.psnr is None else f", PSNR {view.psnr:.2f} dB"
    pictures = [
        caption_photo(view.photo, f"photo: {view.title}", "photo"),
        caption_photo(view.image, f"image: {view.title}", f"image{psnr}"),
    ]
    if truth_of is not None:
        pictures += _caption_compared_maps(view, truth_of)
    elif view.predicted.any():
        shown = encode_map(color_bijectively(view.predicted), f"instance map: {view.title}")
        pictures.append(CaptionedPicture(shown, "instance map"))
    return ViewRow(view.title, pictures)


def _caption_compared_maps(view: PicturedView, truth_of: Mapping[int, int]) -> list[CaptionedPicture]:
    categories = classify_pixels(view.truth, view.predicted, truth_of)
    matched = match_to_themselves(truth_of.values())
    errors = encode_map(color_errors(categories, view.truth), f"errors: {view.title}")
    return [
        caption_id_map(view.predicted, truth_of, f"instance map: {view.title}", "instance map"),
        caption_id_map(view.truth, matched, f"ground truth: {view.title}", "ground truth"),
        CaptionedPicture(errors, _describe_errors(categories)),
    ]


def _compute_category_shares(categories: ndarray) -> list[float] | None:
    counts = np.bincount(categories.ravel(), minlength=len(ERROR_NAMES))
    counts[IGNORED] = 0
    return (counts / counts.sum()).tolist() if counts.sum() else None


def _describe_errors(categories: ndarray) -> str:
    shares = _compute_category_shares(categories)
    if shares is None:
        return "errors: nothing is labelled"
    _, right, other, piece, nothing = (f"{share:.1%}" for share in shares)
    return f"errors: {right} right, {other} other object's ID, {piece} further pieces, {nothing} none"


def _render_exposed(scene: Scene, frame: Frame) -> ndarray:
    image = view_scene(scene, frame.view.camera, frame.view.time).color
    if scene.exposures is None:
        return image
    return apply_exposure(image, scene.exposures.interpolate(frame.view.name, frame.view.time))
