"""The fleet on one page: a static file without scripts, which a browser shows from disk and loads again by itself."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from instdrive_core.fleet.figures import ClipFigures
from instdrive_core.fleet.records import ClipRecord

PAGE = "index.html"
REFRESH_SECONDS = 5
_PICTURE_WIDTH = 320
_WORDS = {
    "waiting": "waiting",
    "running": "running",
    "done": "done",
    "failed": "failed",
    "stopped": "stopped; the same command goes on",
}


def build_fleet_page(
    records: Sequence[ClipRecord],
    figures: Sequence[ClipFigures],
    pictures: Sequence[str | None],
    is_running: bool,
    moment: float,
) -> str:
    """Build the page's HTML.

    Args:
        records: clips in order.
        figures: of each.
        pictures: of each, from `embed_picture`.
        is_running: whether a driver works, so that the page loads itself again.
        moment: when all this was read, seconds since 1970.
    """
    environment = Environment(
        loader=PackageLoader("instdrive_core.fleet"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    counts = {word: sum(record.status == word for record in records) for word in _WORDS}
    return environment.get_template("fleet.html.j2").render(
        rows=list(zip(records, figures, pictures, strict=True)),
        counts=", ".join(f"{count} {word}" for word, count in counts.items() if count),
        minutes=sum(each.minutes for each in figures),
        refresh=REFRESH_SECONDS if is_running else None,
        written=time.strftime("%Y-%m-%d %H:%M:%S %Z", time.localtime(moment)),
        words=_WORDS,
    )


def embed_picture(jpeg: bytes | None) -> str | None:
    """Shrink a picture into a data address; None where there is none or it is damaged."""
    if jpeg is None:
        return None
    try:
        with Image.open(io.BytesIO(jpeg)) as picture:
            picture.thumbnail((_PICTURE_WIDTH, _PICTURE_WIDTH))
            small = io.BytesIO()
            picture.convert("RGB").save(small, format="JPEG", quality=80)
    except OSError:
        return None
    return "data:image/jpeg;base64," + base64.b64encode(small.getvalue()).decode()
