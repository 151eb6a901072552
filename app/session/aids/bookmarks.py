"""Views that the user keeps: camera, time, a name and a small picture. A project holds them."""

from __future__ import annotations

import base64
import binascii
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray
from PIL import Image

from instdrive_app.camera import transform_viewpoint
from instdrive_app.state import Viewpoint
from instdrive_app.stored_viewpoint import read_viewpoint, store_viewpoint
from instdrive_core.scene.transforms import Similarity

MOST = 200
"""Views that are kept at most."""
THUMBNAIL = (192, 108)
"""Most pixels of a small picture."""
LONGEST_NAME = 80
_QUALITY = 82

Thumbnail = UInt8[ndarray, "h w 4"]


@dataclass(frozen=True)
class Bookmark:
    """One kept view."""

    name: str
    viewpoint: Viewpoint
    time: float
    """Seconds into the drive."""
    thumbnail: Thumbnail | None = None
    """RGBA, at most `THUMBNAIL`; None until the view has been drawn."""


class Bookmarks:
    """The kept views of the open document, in order, and the one the user was at last."""

    def __init__(self) -> None:
        self._kept: list[Bookmark] = []
        self.current: int | None = None
        """Index of the view that was kept or returned to last."""
        self.named: int | None = None
        """Index of the view whose name is being typed."""
        self.version = 0
        """Rises with every change that a project has to hold."""

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def kept(self) -> tuple[Bookmark, ...]:
        """The views, oldest first."""
        return tuple(self._kept)

    def clear(self) -> None:
        """Forget all, since another document is open."""
        self._kept, self.current, self.named, self.version = [], None, None, 0

    def keep(self, viewpoint: Viewpoint, time: float) -> Bookmark | None:
        """Keep a view under the next free name; None where there are too many."""
        if len(self._kept) >= MOST:
            return None
        taken = {bookmark.name for bookmark in self._kept}
        name = next(name for number in range(1, MOST + 2) if (name := f"View {number}") not in taken)
        self._kept.append(Bookmark(name, viewpoint, time))
        self.current = len(self._kept) - 1
        self.version += 1
        return self._kept[-1]

    def rename(self, index: int, name: str) -> None:
        """Give a view another name; an empty one leaves it as it is."""
        name = "".join(letter for letter in name if letter.isprintable()).strip()[:LONGEST_NAME]
        if name and name != self._kept[index].name:
            self._kept[index] = replace(self._kept[index], name=name)
            self.version += 1

    def delete(self, index: int) -> None:
        """Forget a view; the one after it takes its place."""
        del self._kept[index]
        self.current, self.named = min(index, len(self._kept) - 1) if self._kept else None, None
        self.version += 1

    def set_thumbnail(self, index: int, picture: UInt8[ndarray, "h w 3"]) -> None:
        """Give a view its small picture, made of what the window shows."""
        small = Image.fromarray(picture)
        small.thumbnail(THUMBNAIL)
        self._kept[index] = replace(self._kept[index], thumbnail=np.array(small.convert("RGBA")))

    def find_pictureless(self, world_from_camera: Float64[ndarray, "4 4"], time: float) -> int | None:
        """Find a view without a small picture that looks from here at this time; None where there is none."""
        for index, bookmark in enumerate(self._kept):
            same = np.array_equal(bookmark.viewpoint.world_from_camera, world_from_camera)
            if bookmark.thumbnail is None and same and bookmark.time == time:
                return index
        return None

    def follow_scene(self, matrix: Similarity) -> None:
        """Keep looking at the same things after the whole scene was transformed by [s R | t]."""
        self._kept = [
            replace(bookmark, viewpoint=transform_viewpoint(bookmark.viewpoint, matrix)) for bookmark in self._kept
        ]

    def store(self) -> list[dict[str, Any]]:
        """Convert the views into JSON values; small pictures as JPEG in base64."""
        return [
            {"name": kept.name, "time": kept.time, **store_viewpoint(kept.viewpoint), **_store_thumbnail(kept)}
            for kept in self._kept
        ]

    def restore(self, stored: object) -> None:
        """Take over what `store` gave; entries that make no sense are left out."""
        self.clear()
        for entry in stored[:MOST] if isinstance(stored, list) else ():
            bookmark = _read_bookmark(entry)
            if bookmark is not None:
                self._kept.append(bookmark)


def _store_thumbnail(bookmark: Bookmark) -> dict[str, str]:
    if bookmark.thumbnail is None:
        return {}
    packed = io.BytesIO()
    Image.fromarray(bookmark.thumbnail).convert("RGB").save(packed, "JPEG", quality=_QUALITY)
    return {"thumbnail": base64.b64encode(packed.getvalue()).decode()}


def _read_bookmark(entry: object) -> Bookmark | None:
    if not isinstance(entry, Mapping):
        return None
    name, time, viewpoint = entry.get("name"), entry.get("time"), read_viewpoint(entry)
    if not isinstance(time, (int, float)) or not math.isfinite(time) or viewpoint is None:
        return None
    if not isinstance(name, str) or not name.isprintable():
        return None
    return Bookmark(name[:LONGEST_NAME], viewpoint, float(time), _read_thumbnail(entry.get("thumbnail")))


def _read_thumbnail(stored: object) -> Thumbnail | None:
    """Read a small picture; None where it is none or too large, as another program may have written it."""
    if not isinstance(stored, str):
        return None
    try:
        picture = Image.open(io.BytesIO(base64.b64decode(stored, validate=True)), formats=("JPEG",))
        if picture.width > THUMBNAIL[0] or picture.height > THUMBNAIL[1]:
            return None
        return np.array(picture.convert("RGBA"))
    except (OSError, ValueError, binascii.Error):
        return None
