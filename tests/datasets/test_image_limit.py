"""Pictures larger than any camera's are refused by their header, with the number."""

import contextlib
import io
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from PIL import Image

from instdrive_core.datasets.photos import load_photo, read_photo_size
from instdrive_core.errors import DataError
from instdrive_core.files import image_limit
from instdrive_core.masks.label_map_folder import read_label_map

SIDE = 12_000


@pytest.fixture
def huge(tmp_path):
    """A PNG of 144 megapixels in 100 bytes: a header, and next to nothing of what it promises."""
    header = struct.pack(">IIBBBBB", SIDE, SIDE, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b"")]
    parts = [
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks
    ]
    path = tmp_path / "huge.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return path


@pytest.mark.parametrize(
    "read",
    [read_photo_size, lambda path: load_photo(path, (SIDE, SIDE), (10, 10)), read_label_map],
    ids=["size", "photo", "mask"],
)
def test_the_number_is_told_before_anything_is_decoded(huge, read):
    with pytest.raises(DataError, match=r"12000×12000|144000000 pixels"):
        read(huge)


def test_pillow_keeps_to_the_same_limit():
    assert Image.MAX_IMAGE_PIXELS == image_limit.MAX_PIXELS


def test_large_photos_of_real_cameras_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(image_limit, "MAX_PIXELS", 64 * 48)
    file = io.BytesIO()
    Image.fromarray(np.zeros((48, 64, 3), np.uint8)).save(file, "PNG")
    path = tmp_path / "photo.png"
    path.write_bytes(file.getvalue())
    assert read_photo_size(path) == (64, 48)
    monkeypatch.setattr(image_limit, "MAX_PIXELS", 64 * 48 - 1)
    with pytest.raises(DataError, match="64×48, 3,072 pixels; at most 3,071 are read"):
        read_photo_size(path)


@pytest.mark.parametrize("read", [lambda path: load_photo(path, (64, 48), (64, 48)), read_label_map])
def test_a_lying_length_in_a_picture_takes_no_memory(tmp_path, read):
    path = tmp_path / "photo.png"
    Image.fromarray(np.arange(64 * 48, dtype=np.uint8).reshape(48, 64)).save(path)
    content = path.read_bytes()
    place = content.index(b"IDAT") - 4
    path.write_bytes(content[:place] + (700 << 20).to_bytes(4, "big") + content[place + 4 :])
    tracemalloc.start()
    try:
        with contextlib.suppress(DataError):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
