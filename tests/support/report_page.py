"""Facts and log of a run for pages, hostile text, and a reader of pages."""

import base64
import html.parser
import io
import json

import numpy as np
from PIL import Image

FACTS = {
    "clip": "toy",
    "cameras": "front,side",
    "scale": 1.0,
    "first_frame": None,
    "last_frame": None,
    "masks": "exact",
    "seed": 3,
    "iterations": 10,
    "train_seconds": 1.5,
    "peak_rss_mb": 250,
    "backend": "cpu",
}
HOSTILE = "<script>alert(1)</script>\"'&<img src=x onerror=alert(2)>"
VOID = {"br", "img", "input", "meta"}


class ReadPage(html.parser.HTMLParser):
    """Elements, pictures and text; fails where an element is not closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.images: list[dict] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        assert not [name for name, _ in attrs if name.startswith("on")], "no handlers in attributes"
        if tag == "img":
            self.images.append(dict(attrs))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data

    def pictures(self, start: str) -> list[np.ndarray]:
        """Decoded pictures whose text begins so."""
        return [decode_picture(image["src"]) for image in self.images if image["alt"].startswith(start)]


def decode_picture(source: str) -> np.ndarray:
    """Pixels (h, w, 3) of a data URI."""
    kind, content = source.split(";base64,")
    picture = Image.open(io.BytesIO(base64.b64decode(content, validate=True)))
    assert kind == f"data:image/{(picture.format or '').lower()}"
    return np.asarray(picture.convert("RGB"))


def log_line(stage: str, step: int, **fields) -> str:
    """A step as `log.jsonl` reports it."""
    line = {"stage": stage, "iteration": step, "total": 40, "loss": 1 / (step + 1), "gaussians": 100, "seconds": step}
    return json.dumps(line | {"psnr": 20.0 + step / 10 if stage == "rgb" else None, "terms": {"pull": 0.5}} | fields)
