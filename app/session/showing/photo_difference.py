"""How far the splats are from a photo: a heat map and PSNR, computed in the background at the photo's size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from weakref import ref

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from instdrive_app.messages import read_error
from instdrive_app.session.context import SessionContext
from instdrive_core.datasets.photos import load_photo, read_photo_size
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_colored
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import DataError, InstDriveError
from instdrive_core.evaluation.metrics.image_metrics import psnr
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.exposure import apply_exposure
from instdrive_core.wording import phrase

WIDEST = 1920
"""Pixels; wider photos are compared at this width."""
HOT = 0.3
"""Difference, as a share of the range of colours, from which the heat map is at its end."""
HEAT_RAMP = (
    (0.0, 0.0, 0.02),
    (0.25, 0.06, 0.43),
    (0.58, 0.15, 0.40),
    (0.87, 0.32, 0.23),
    (0.99, 0.65, 0.04),
    (1, 1, 0.64),
)
"""Colours from no difference to a large one, evenly spaced."""
SETTLE_SECONDS = 0.3
"""Time for which view and scene stay as they are before they are compared."""


@dataclass(frozen=True)
class Difference:
    """What a photo and the splats differ by."""

    psnr: float
    """dB over all pixels and channels; 100 where they are equal."""
    mean_error: float
    """Mean absolute difference of the channels, as a share of their range."""
    heat: UInt8[ndarray, "h w 4"]
    """Mean absolute difference of each pixel's channels, in colours of `HEAT_RAMP`."""


class PhotoDifference:
    """Compares the edited scene with the photo that is looked at; keeps the last result."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self._wanted: tuple[object, ...] | None = None
        self._waited = 0.0
        self._asked = False
        self._found: tuple[tuple[object, ...], Difference] | None = None
        self.problem = ""
        """Why the photo that is looked at cannot be compared; empty where it can."""

    @property
    def current(self) -> Difference | None:
        """The difference of what is shown now; None until it is computed."""
        return self._found[1] if self._found is not None and self._found[0] == self._wanted else None

    @property
    def psnr(self) -> float | None:
        """PSNR (dB) of what is shown now; None until it is computed."""
        return None if self.current is None else round(self.current.psnr, 2)

    @property
    def is_comparing(self) -> bool:
        """Whether a result is awaited."""
        return self._wanted is not None and self.current is None and not self.problem

    def tick(self, seconds: float, wants: bool) -> None:
        """Follow view and scene while a heat map is wanted; called once a frame, `seconds` after the last."""
        document, index = self._context.document, self._context.state.dataset_view
        if not wants or document is None or index is None:
            self._wanted, self._asked = None, False
            return
        key = (ref(document), document.versions, index)
        if key != self._wanted:
            self._wanted, self._waited, self._asked, self.problem = key, 0.0, False, ""
            return
        self._waited += seconds
        if not self._asked and self.current is None and self._waited >= SETTLE_SECONDS:
            self._asked = True
            self._ask(key, document, document.scene.views[index])

    def _ask(self, key: tuple[object, ...], document: Document, view: CameraView) -> None:
        frozen = freeze_colored(document)

        def keep(found: Difference) -> None:
            self._found = (key, found)

        def explain(error: BaseException) -> bool:
            if isinstance(error, InstDriveError) and key == self._wanted:
                self.problem = read_error(error)
            return isinstance(error, InstDriveError)

        work = "Comparing with the photo"
        self._context.jobs.submit_in_background(work, lambda: compare_with_photo(frozen, view), keep, explain)


def compare_with_photo(document: Document, view: CameraView) -> Difference:
    """Draw what is shown of a document from a photo's camera, with the photo's exposure, and compare both.

    Raises DataError where the photo is unknown, gone or damaged.
    """
    if not view.photo:
        where = f"{view.name}/{view.index:02d}"
        problem = phrase("the scene does not record where this photo is")
        raise DataError(where, problem, phrase("Open the run where its clip is, or train it again"))
    camera = view.camera.scale(min(1.0, WIDEST / view.camera.width))
    path = Path(view.photo)
    if not path.is_file():
        raise DataError(path, "the photo is no longer there", "Open the run where its clip is, or train it again")
    photo = load_photo(path, read_photo_size(path), (camera.width, camera.height)).astype(np.float32) / 255
    scene = bake_document(document, None, np.flatnonzero(document.state.drawn))
    drawn = view_scene(scene, camera, view.time).color
    if scene.exposures is not None:
        drawn = apply_exposure(drawn, scene.exposures.interpolate(view.name, view.time))
    drawn = np.clip(drawn, 0, 1).astype(np.float32)
    error = np.abs(drawn - photo).mean(axis=-1)
    return Difference(psnr(drawn, photo) or 0.0, float(error.mean()), paint_heat(error))


def paint_heat(error: Float[ndarray, "h w"]) -> UInt8[ndarray, "h w 4"]:
    """Paint differences (0 … 1) as opaque RGBA along `HEAT_RAMP`, which ends at `HOT`."""
    places = np.clip(error / HOT, 0, 1) * (len(HEAT_RAMP) - 1)
    ramp = np.array(HEAT_RAMP)
    channels = [np.interp(places, np.arange(len(ramp)), ramp[:, channel]) for channel in range(3)]
    return np.round(np.stack([*channels, np.ones_like(places)], axis=-1) * 255).astype(np.uint8)
