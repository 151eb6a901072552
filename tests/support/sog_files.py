"""Small SOG scenes made by hand after the format's description; nothing of the reader is used."""

import io
import json
import zipfile

import numpy as np
from PIL import Image

IMAGES = ("means_l", "means_u", "quats", "scales", "sh0", "shN_centroids", "shN_labels")


def webp(pixels, **options):
    """Bytes of an RGBA image (h, w, 4) uint8."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", **{"lossless": True, "exact": True} | options)
    return file.getvalue()


def splat_image(values, fill=0):
    """(n, c ≤ 4) uint8 as an image of 4-pixel steps with unused pixels at the end."""
    width = 4 * max(int(np.ceil(np.sqrt(len(values)) / 4)), 1)
    height = 4 * max(int(np.ceil(len(values) / width / 4)), 1)
    pixels = np.full((height * width, 4), fill, np.uint8)
    pixels[:, 3] = 255
    pixels[: len(values), : values.shape[1]] = values
    return webp(pixels.reshape(height, width, 4))


def random_bytes(rng, count, bands=2, palette=70):
    """The bytes of each attribute of a random scene."""
    rest = (0, 3, 8, 15)[bands]
    return {
        "means_l": rng.integers(0, 256, (count, 3)),
        "means_u": rng.integers(0, 256, (count, 3)),
        "quats": np.column_stack([rng.integers(0, 256, (count, 3)), rng.integers(252, 256, count)]),
        "scales": rng.integers(0, 256, (count, 3)),
        "sh0": rng.integers(0, 256, (count, 4)),
        "entries": rng.integers(0, 256, (palette, rest, 3)),
        "labels": rng.integers(0, palette, count),
    }


def meta_of(rng, count, bands=2, palette=70):
    """A version 2 meta.json."""
    meta = {
        "version": 2,
        "count": count,
        "means": {"mins": [-3.0, -2.5, 0.5], "maxs": [3.0, 2.5, 0.75], "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": np.sort(rng.uniform(-9, 1, 256)).tolist(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": np.sort(rng.normal(0, 1, 256)).tolist(), "files": ["sh0.webp"]},
    }
    if bands:
        files = ["shN_centroids.webp", "shN_labels.webp"]
        codebook = np.sort(rng.normal(0, 0.2, 256)).tolist()
        meta["shN"] = {"count": palette, "bands": bands, "codebook": codebook, "files": files}
    return meta


def legacy_meta_of(meta):
    """Description of the scene in the first version of the format: ranges where codebooks stood."""
    old = {name: dict(value) for name, value in meta.items() if isinstance(value, dict)}
    old["means"]["shape"] = [meta["count"], 3]
    old["scales"] |= {"mins": [-9.0, -8.0, -7.0], "maxs": [1.0, 2.0, 3.0]}
    old["sh0"] |= {"mins": [-1.0, -2.0, -3.0, -6.0], "maxs": [1.0, 2.0, 3.0, 6.0]}
    if "shN" in old:
        old["shN"] = {"mins": -0.5, "maxs": 0.75, "files": meta["shN"]["files"]}
    return old


def files_of(content, meta):
    """File names and bytes of a scene."""
    files = {name: splat_image(content[name].astype(np.uint8)) for name in IMAGES[:5]}
    if "shN" in meta:
        entries, labels = content["entries"], content["labels"]
        rest, rows = entries.shape[1], -(-len(entries) // 64)
        image = np.full((rows * 64, rest, 4), 255, np.uint8)
        image[: len(entries), :, :3] = entries
        files["shN_centroids"] = webp(image.reshape(rows, 64 * rest, 4))
        files["shN_labels"] = splat_image(np.column_stack([labels % 256, labels // 256]).astype(np.uint8))
    return {"meta.json": json.dumps(meta).encode()} | {f"{name}.webp": data for name, data in files.items()}


def write_folder(folder, files):
    """The files beside each other."""
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


def write_archive(path, files, compression=zipfile.ZIP_STORED):
    """The files in a .sog."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
