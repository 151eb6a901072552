"""A contact sheet of a clip: time steps below each other, the six cameras side by side, from left round to the back.

``python -m instdrive_core.datasets.synthetic.contact_sheet CLIP SHEET.jpg``
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image

CAMERAS = ("left", "front_left", "front", "front_right", "right", "back")
ROWS = 4


def build_clip_sheet(clip: Path, width: int = 480) -> Image.Image:
    """Put together photos of `ROWS` time steps spread over the clip, each `width` pixels wide."""
    steps = sorted((path.stem for path in (clip / "camera" / "front_camera").glob("*.jpg")), key=int)
    chosen = [steps[round(row * (len(steps) - 1) / (ROWS - 1))] for row in range(ROWS)]
    rows = []
    for step in chosen:
        photos = [Image.open(clip / "camera" / f"{camera}_camera" / f"{step}.jpg") for camera in CAMERAS]
        rows.append([photo.resize((width, round(photo.height * width / photo.width))) for photo in photos])
    height = rows[0][0].height
    sheet = Image.new("RGB", (width * len(CAMERAS), height * ROWS))
    for row, photos in enumerate(rows):
        for column, photo in enumerate(photos):
            sheet.paste(photo, (column * width, row * height))
    return sheet


if __name__ == "__main__":
    Path(sys.argv[2]).parent.mkdir(parents=True, exist_ok=True)
    build_clip_sheet(Path(sys.argv[1])).save(sys.argv[2], quality=80)
