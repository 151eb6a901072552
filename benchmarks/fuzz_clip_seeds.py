"""Whole clips and masks, small, for `benchmarks.fuzz` to damage: PandaSet, COLMAP, nerfstudio, imported masks."""

from __future__ import annotations

import gzip
import io
import json
import pickle
import struct
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd
from PIL import Image
from pycocotools import mask as coco

pd.options.mode.string_storage = "python"  # pickles are the same whether or not pyarrow is there

WIDTH, HEIGHT, STEPS = 32, 18, 3
"""Size of the photos in pixels; number of time steps."""
_FORWARD = {"w": 0.5**0.5, "x": -(0.5**0.5), "y": 0.0, "z": 0.0}
_IDENTITY = (1.0, 0.0, 0.0, 0.0)


def list_clip_seeds(seed: Callable[..., Any]) -> Iterator[Any]:
    """One of each kind; `seed` is `fuzz_seeds.Seed`."""
    yield seed("pandaset", "clip", list_pandaset_files())
    for protocol in (2, 4, 5):
        yield seed("pickle", f"protocol {protocol}", {"t.pkl": _table(_points(), protocol)}, "t.pkl")
    yield seed("pickle", "gzip", {"t.pkl.gz": gzip.compress(_table(_cuboids(), 4), mtime=0)}, "t.pkl.gz")
    yield seed("colmap", "binary", _colmap_binary())
    yield seed("colmap", "text", _colmap_text())
    for form in ("ascii", "binary_little_endian", "binary_big_endian"):
        yield seed("nerfstudio", form, _nerfstudio(form))
        yield seed("point_ply", form, {"points.ply": _point_ply(form)}, "points.ply")
    yield from _mask_seeds(seed)


def _photo(step: int, form: str = "JPEG") -> bytes:
    rng = np.random.default_rng(step)
    return _image(rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8), form)


def _image(pixels: np.ndarray, form: str = "PNG") -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, form)
    return file.getvalue()


def _table(columns: dict[str, np.ndarray], protocol: int) -> bytes:
    return pickle.dumps(pd.DataFrame(columns), protocol=protocol)


def _points() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    columns = {name: rng.normal(0, 9, 40) for name in "xyz"}
    return columns | {"i": np.full(40, 51.0), "t": np.full(40, 1.5e9), "d": np.arange(40) % 2}


def _cuboids() -> dict[str, np.ndarray]:
    columns = {"uuid": np.array(["a", "b"], object), "label": np.array(["Car", "Car"], object), "yaw": np.zeros(2)}
    columns |= {f"position.{axis}": np.array([3.0, 9.0]) for axis in "xyz"}
    columns |= {f"dimensions.{axis}": np.array([2.0, 4.0]) for axis in "xyz"}
    return columns | {"cuboids.sensor_id": np.array([-1, 0]), "cuboids.sibling_id": np.array(["-", "-"], object)}


def list_pandaset_files() -> dict[str, bytes]:
    """A sequence of PandaSet: content by name."""
    camera = "camera/front_camera/"
    poses = [{"position": {"x": 0.0, "y": float(step), "z": 1.5}, "heading": _FORWARD} for step in range(STEPS)]
    texts = {
        "meta/timestamps.json": [1.5e9 + 0.1 * step for step in range(STEPS)],
        f"{camera}poses.json": poses,
        f"{camera}intrinsics.json": {"fx": 20.0, "fy": 21.0, "cx": 15.5, "cy": 8.5},
        "annotations/semseg/classes.json": {"7": "Road", "13": "Car"},
    }
    files = {name: json.dumps(content).encode() for name, content in texts.items()}
    npy = io.BytesIO()
    np.save(npy, np.arange(40, dtype=np.int32))
    for step in range(STEPS):
        files[f"{camera}{step:02d}.jpg"] = _photo(step)
    for step in range(2):
        files[f"lidar/{step:02d}.pkl.gz"] = gzip.compress(_table(_points(), 4), mtime=0)
        files[f"annotations/cuboids/{step:02d}.pkl.gz"] = gzip.compress(_table(_cuboids(), 4), mtime=0)
    files["annotations/semseg/00.pkl.gz"] = gzip.compress(_table({"class": np.arange(40)}, 4), mtime=0)
    return files | {"labels/lidar/00.npy": npy.getvalue()}


def _colmap_binary() -> dict[str, bytes]:
    cameras = struct.pack("<QIiQQ4d", 1, 7, 1, WIDTH, HEIGHT, 20.0, 20.0, WIDTH / 2, HEIGHT / 2)
    images = struct.pack("<Q", STEPS)
    for step in range(STEPS):
        images += struct.pack("<I7dI", step + 1, *_IDENTITY, float(step), 0.0, 0.0, 7) + f"{step:03d}.jpg".encode()
        images += b"\0" + struct.pack("<QddQ", 1, 3.5, 4.5, 1)
    points = struct.pack("<Q", 9)
    for number in range(9):
        points += struct.pack("<Q3d3BdQ2I", number + 1, number, 1.0, 8.0, 9, 99, 200, 0.5, 1, 1, 0)
    model = {"cameras": cameras, "images": images, "points3D": points}
    return _photos() | {f"sparse/0/{name}.bin": data for name, data in model.items()}


def _colmap_text() -> dict[str, bytes]:
    images = [f"# Number of images: {STEPS}, mean observations per image: 1"]
    for step in range(STEPS):
        images += [f"{step + 1} 1.0 0.0 0.0 0.0 {step}.0 0.0 0.0 7 {step:03d}.jpg", "3.5 4.5 1"]
    points = ["# Number of points: 9, mean track length: 1"]
    points += [f"{number + 1} {number}.25 1.0 8.0 9 99 200 0.5 1 0" for number in range(9)]
    cameras = ["# Number of cameras: 1", f"7 PINHOLE {WIDTH} {HEIGHT} 20.0 20.0 {WIDTH / 2} {HEIGHT / 2}"]
    model = {"cameras": cameras, "images": images, "points3D": points}
    return _photos() | {f"sparse/0/{name}.txt": ("\n".join(lines) + "\n").encode() for name, lines in model.items()}


def _photos() -> dict[str, bytes]:
    return {f"images/{step:03d}.jpg": _photo(step) for step in range(STEPS)}


def _nerfstudio(form: str) -> dict[str, bytes]:
    poses = np.tile(np.eye(4), (STEPS, 1, 1))
    poses[:, 0, 3] = np.arange(STEPS)
    frames = [
        {"file_path": f"images/{step:03d}.jpg", "transform_matrix": pose.tolist()} for step, pose in enumerate(poses)
    ]
    size = {"w": WIDTH, "h": HEIGHT, "fl_x": 20.0, "fl_y": 20.0, "cx": WIDTH / 2, "cy": HEIGHT / 2, "k1": 0.01}
    content = {"camera_model": "OPENCV", **size, "ply_file_path": "points.ply", "frames": frames}
    return _photos() | {"transforms.json": json.dumps(content).encode(), "points.ply": _point_ply(form)}


def _point_ply(form: str) -> bytes:
    columns = [("float", name) for name in "xyz"] + [("uchar", name) for name in ("red", "green", "blue")]
    header = ["ply", f"format {form} 1.0", "element vertex 9"]
    header += [f"property {kind} {name}" for kind, name in columns] + ["end_header", ""]
    rows = [(number, 1.25, 8.5, 9, 99, 200) for number in range(9)]
    if form == "ascii":
        body = "".join(" ".join(map(repr, row)) + "\n" for row in rows).encode()
    else:
        body = b"".join(struct.pack(("<" if "little" in form else ">") + "3f3B", *row) for row in rows)
    return "\n".join(header).encode() + body


def _mask_seeds(seed: Callable[..., Any]) -> Iterator[Any]:
    masks = np.zeros((2, HEIGHT, WIDTH), bool)
    masks[0, 2:9, 3:14], masks[1, 5:16, 10:30] = True, True
    labels = np.where(masks[1], 2, masks[0]).astype(np.uint16)
    for name, save in (("stored", np.savez), ("deflated", np.savez_compressed)):
        file = io.BytesIO()
        save(file, masks=masks)
        yield seed("mask_npz", name, {"m.npz": file.getvalue()}, "m.npz")
    texts, lists = [], []
    for mask in masks:
        encoded: Any = coco.encode(np.asfortranarray(mask.astype(np.uint8)))
        texts.append({"segmentation": {"size": [HEIGHT, WIDTH], "counts": encoded["counts"].decode()}, "area": 1})
        flat = mask.ravel(order="F").astype(int)
        runs = np.diff([0, *np.flatnonzero(np.diff(flat, prepend=0)).tolist(), flat.size]).tolist()
        lists.append({"segmentation": {"size": [HEIGHT, WIDTH], "counts": runs}})
    yield seed("mask_rle", "text", {"m.json": json.dumps(texts).encode()}, "m.json")
    yield seed("mask_rle", "lists", {"m.json": json.dumps({"annotations": lists}).encode()}, "m.json")
    yield seed("mask_png", "16 bits", {"m.png": _image(labels)}, "m.png")
    yield seed("mask_png", "8 bits", {"m.png": _image(labels.astype(np.uint8))}, "m.png")
    entry = {"width": WIDTH, "height": HEIGHT, "masks": 2}
    sidecar = {"version": 1, "source": "exact", "faults": None, "seed": 0, "frames": {"front/00": entry}}
    files = {"masks.json": json.dumps(sidecar).encode(), "front/00.png": _image(labels)}
    yield seed("mask_folder", "folder", files | {"front/00_sky.png": _image(masks[0].astype(np.uint8) * 255)})
