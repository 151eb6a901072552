"""A clip out of a video or a folder of photos: pictures are chosen and written, their poses found. What was done is
kept, so that the same command goes on where it was interrupted."""

from __future__ import annotations

import io
import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image, ImageOps

from instdrive_core.datasets.capture.candidates import list_photo_files, measure_candidates, read_pictures
from instdrive_core.datasets.capture.choice import FEWEST, choose_pictures
from instdrive_core.datasets.capture.poses import FoundPoses, OnStage, find_poses, require_capture_packages
from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.atomic import replace_atomically, write_bytes
from instdrive_core.files.json_fields import read_json, require_field
from instdrive_core.wording import format_count

STATE = "prepare.json"
_VERSION = 1
_ORIENTATION = 0x0112
"""EXIF's tag of how a photo is to be turned; 1 = as it is."""


@dataclass(frozen=True)
class Preparation:
    """What becomes a clip, and how."""

    source: Path
    """Video, or folder of photos."""
    out: Path
    """Folder of the clip."""
    most: int = 200
    """Photos at most."""
    lens: str = "simple"
    """A word of `structure.LENSES`."""


def prepare_clip(asked: Preparation, on_stage: OnStage) -> FoundPoses | None:
    """Make a clip in COLMAP's layout; None where it was finished before.

    Raises DataError where the source cannot be read or no poses are found, OptionError where `out` holds something
    else or was begun with other options.
    """
    state = _read_state(asked)
    if state is not None and (asked.out / "sparse" / "0" / "cameras.bin").is_file():
        return None
    require_capture_packages()
    if state is None:
        _require_place(asked.out)
        state = _describe(asked) | {"pictures": _choose(asked, on_stage)}
        write_bytes(asked.out / STATE, json.dumps(state, indent=1).encode())
    names = _write_photos(asked, state["pictures"], on_stage)
    return find_poses(asked.out, names, asked.lens, asked.source.is_file(), on_stage)


def _require_place(out: Path) -> None:
    """Raise DataError where the folder cannot be made or written: it is needed after minutes only."""
    place = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not place.is_dir() or not os.access(place, os.W_OK):
        problem = "is no folder" if not place.is_dir() else "cannot be written to"
        raise DataError(place, problem, "Choose another --out")


def _describe(asked: Preparation) -> dict[str, Any]:
    return {"version": _VERSION, "source": str(asked.source.resolve()), "most": asked.most, "lens": asked.lens}


def _read_state(asked: Preparation) -> dict[str, Any] | None:
    """What an interrupted preparation wrote; None for a new folder."""
    file = asked.out / STATE
    if not file.is_file():
        if asked.out.is_dir() and any(asked.out.iterdir()):
            raise OptionError(f"{asked.out} is not empty and no clip that `prepare` began; choose another --out")
        return None
    state = read_json(file)
    for key, value in _describe(asked).items():
        if require_field(file, state, key) != value:
            problem = f"{asked.out} was begun with {key} {state[key]!r}, not {value!r}"
            raise OptionError(f"{problem}; repeat the first options, or choose another --out")
    pictures = require_field(file, state, "pictures")
    is_whole = isinstance(pictures, list) and all(type(number) is int and number >= 0 for number in pictures)
    if not is_whole or not pictures:
        raise DataError(file, "the field 'pictures' is no list of picture numbers", "Remove the folder and begin again")
    return state


def _choose(asked: Preparation, on_stage: OnStage) -> list[int]:
    """Numbers of the pictures to use: all photos of a small folder, of others those that are sharp and apart."""
    if asked.source.is_dir():
        files = list_photo_files(asked.source)
        if len(files) <= asked.most:
            for number, _ in read_pictures(asked.source):  # damaged ones are told before anything is begun
                on_stage("checking photos", number + 1, len(files))
            return _require_enough(asked, list(range(len(files))))
    total = len(list_photo_files(asked.source)) if asked.source.is_dir() else 0
    found = measure_candidates(asked.source, lambda done: on_stage("looking at pictures", done, total))
    return _require_enough(asked, choose_pictures(found, asked.most))


def _require_enough(asked: Preparation, numbers: list[int]) -> list[int]:
    if len(numbers) < FEWEST:
        problem = f"gives {format_count(len(numbers), 'usable photo')}, too few to find poses"
        raise DataError(asked.source, problem, f"Give at least {FEWEST}, taken from places apart")
    return numbers


def _write_photos(asked: Preparation, numbers: list[int], on_stage: OnStage) -> list[str]:
    """Write the chosen pictures that are not there yet; returns their names."""
    folder = asked.out / "images"
    folder.mkdir(parents=True, exist_ok=True)
    if asked.source.is_dir():
        files = list_photo_files(asked.source)
        if numbers[-1] >= len(files):
            raise DataError(asked.source, "has fewer photos than when this began", "Choose another --out")
        copies = [f"{number:06d}{files[number].suffix.lower()}" for number in numbers]  # names without blanks
        for done, number in enumerate(numbers):
            target = folder / copies[done]
            if not target.is_file():
                with replace_atomically(target) as temporary:
                    _copy_upright(files[number], temporary)
            on_stage("copying photos", done + 1, len(numbers))
        return copies
    names = {number: f"{number:06d}.jpg" for number in numbers}
    left = {number for number, name in names.items() if not (folder / name).is_file()}
    for number, picture in read_pictures(asked.source) if left else ():
        if number in left:
            packed = io.BytesIO()
            Image.fromarray(picture).save(packed, "JPEG", quality=95)
            write_bytes(folder / names[number], packed.getvalue())
            left.discard(number)
            on_stage("writing photos", len(numbers) - len(left), len(numbers))
        if not left:
            break
    if left:
        raise DataError(asked.source, f"has no picture {min(left)} any more", "Choose another --out")
    return [names[number] for number in numbers]


def _copy_upright(source: Path, target: Path) -> None:
    """Copy a photo as it is, or turned where its EXIF data say that it lies on its side: COLMAP and its clips know only
    pixels, and a lying photo would give a lying scene."""
    with Image.open(source) as image:
        kind, turned = (
            image.format,
            ImageOps.exif_transpose(image) if image.getexif().get(_ORIENTATION, 1) > 1 else None,
        )
        if turned is None:
            shutil.copyfile(source, target)
        else:
            turned.save(target, kind, quality=95, exif=turned.getexif())
