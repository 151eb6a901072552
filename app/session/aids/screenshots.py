"""Saving what the view shows as a picture, in the user's folder of pictures and under a name of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from instdrive_app.files.file_names import find_free_path, find_pictures_folder
from instdrive_app.session.context import SessionContext
from instdrive_app.session.export_kinds import RENDERED_MODES
from instdrive_app.session.files.document_files import DocumentFiles
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import OptionError
from instdrive_core.masks.export.id_maps import MAX_SIDE
from instdrive_core.masks.export.id_pictures import save_png
from instdrive_core.progress import report_span
from instdrive_core.rasterize.pictures import Look, draw_picture
from instdrive_core.scene.camera import Camera
from instdrive_core.wording import phrase

_BAKING = 0.3
"""Share of the work until the scene's edits are applied."""


class Screenshots:
    """Takes pictures of the view at once, twice or four times its size, with or without what is behind the splats."""

    def __init__(self, context: SessionContext, files: DocumentFiles) -> None:
        self._context, self._files = context, files
        self._writing: set[Path] = set()
        """Files that are not there yet, but will be."""

    def take(self, factor: float = 1.0) -> None:
        """Save the view, `factor` times as large as it is shown; drawn in the background, while editing goes on."""
        document, state, messages = self._context.document, self._context.state, self._context.messages
        if document is None:
            return
        camera = state.viewpoint.fit_camera(*state.picture_size).scale(factor)
        source = self._files.path
        stem = source.name.split(".")[0].removesuffix("_edited") if source is not None else "scene"
        path = find_free_path(find_pictures_folder(), stem, ".png", self._writing)
        frozen, look, time = freeze_document(document), RENDERED_MODES[state.view_mode], state.time
        with_sky, transparent = state.draws_sky, state.cut_out_screenshots

        def finish(_: None) -> None:
            self._writing.discard(path)
            messages.info(
                phrase(
                    "Saved a picture of {width} × {height} pixels as {path}",
                    width=camera.width,
                    height=camera.height,
                    path=path,
                )
            )

        def handle_failure(_: BaseException) -> bool:
            self._writing.discard(path)
            return False

        self._writing.add(path)
        self._context.jobs.submit(
            "Taking a screenshot",
            lambda: save_screenshot(path, frozen, camera, time, look, with_sky, transparent),
            finish,
            modal=False,
            on_failure=handle_failure,
        )


def save_screenshot(
    path: Path, document: Document, camera: Camera, time: float, look: Look, with_sky: bool, transparent: bool
) -> None:
    """Draw a document at `time` (seconds) and save the picture as PNG; RGBA where it is `transparent`.

    Raises OptionError where the picture is too large, DataError where it cannot be written.
    """
    if max(camera.width, camera.height) > MAX_SIDE:
        problem = phrase(
            "a picture of {width} × {height} pixels is too large", width=camera.width, height=camera.height
        )
        raise OptionError(
            phrase("{problem}; at most {most} are possible. Choose a smaller size", problem=problem, most=MAX_SIDE)
        )
    with report_span(0.0, _BAKING):
        scene = bake_document(document, None, np.flatnonzero(document.state.drawn))
    if not with_sky:
        scene = replace(scene, sky=None)
    with report_span(_BAKING, 1.0):
        save_png(path, draw_picture(scene, camera, time, look, transparent))
