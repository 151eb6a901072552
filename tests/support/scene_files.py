"""A small scene in every format and version that is read, each made by a function of the folder to write into."""

import json
from dataclasses import replace

import numpy as np
from plyfile import PlyData
from random_scene import random_scene
from sog_files import files_of, legacy_meta_of, meta_of, random_bytes, write_archive, write_folder

from instdrive_core.formats.ksplat.sample_files import build_ksplat
from instdrive_core.formats.lcc.sample_files import build_lcc, write_lcc
from instdrive_core.formats.registry import save_scene
from instdrive_core.formats.spz.scenes import write_spz

COUNT = 60


def still_scene():
    """Splats with codewords and an extra column, at one moment: what every format keeps."""
    return replace(random_scene(seed=3, count=COUNT, instances=4, actors=0), sky=None, views=())


def _save(folder, name):
    save_scene(folder / name, still_scene())
    return folder / name


def _save_folder(folder):
    save_scene(folder / "run", random_scene(seed=3, count=COUNT, instances=4))
    return folder / "run"


def _save_ply_as(folder, name, **changes):
    """The .ply in another byte order or as text, by another library."""
    data = PlyData.read(_save(folder, "native.ply"))
    for attribute, value in changes.items():
        setattr(data, attribute, value)
    data.write(folder / name)
    return folder / name


def _save_spz(folder, version):
    path = folder / f"v{version}.spz"
    write_spz(path, still_scene(), version)
    return path


def _sog_files(count, legacy=False):
    rng = np.random.default_rng(5)
    meta, content = meta_of(rng, count), random_bytes(rng, count)
    return files_of(content, legacy_meta_of(meta) if legacy else meta)


def _save_sog(folder):
    write_archive(folder / "street.sog", _sog_files(COUNT))
    return folder / "street.sog"


def _save_sog_folder(folder, legacy):
    write_folder(folder / "street", _sog_files(COUNT, legacy))
    return folder / "street" / "meta.json" if legacy else folder / "street"


def _save_sog_levels(folder, tree):
    """Chunks of a streamed scene, with or without the file that says which part of which shows what."""
    street = folder / "street"
    for name, count in (("0_0", 60), ("1_0", 20), ("env", 12)):
        write_folder(street / name, _sog_files(count))
    leaves = [
        {"lods": {"0": {"file": 0, "offset": 0, "count": 40}}},
        {"lods": {"1": {"file": 1, "offset": 5, "count": 9}}},
    ]
    names = ["0_0/meta.json", "1_0/meta.json"]
    levels = {"lodLevels": 2, "filenames": names, "environment": "env/meta.json", "tree": {"children": leaves}}
    if tree:
        (street / "lod-meta.json").write_text(json.dumps(levels))
    return street


def _save_ksplat(folder):
    path = folder / "street.ksplat"
    path.write_bytes(build_ksplat(np.random.default_rng(6), [(40, 2), (20, 1)]))
    return path


def _save_lcc(folder):
    return write_lcc(folder / "street", build_lcc(np.random.default_rng(7), environment=4))


SCENE_FILES = {
    "ply": lambda folder: _save(folder, "street.ply"),
    "ply-big-endian": lambda folder: _save_ply_as(folder, "big.ply", byte_order=">"),
    "ply-text": lambda folder: _save_ply_as(folder, "text.ply", text=True),
    "sibr-ply": lambda folder: _save(folder, "street.sibr.ply"),
    "compressed-ply": lambda folder: _save(folder, "street.compressed.ply"),
    "splat": lambda folder: _save(folder, "street.splat"),
    **{f"spz-{version}": lambda folder, version=version: _save_spz(folder, version) for version in (1, 2, 3, 4)},
    "glb": lambda folder: _save(folder, "street.glb"),
    "gltf": lambda folder: _save(folder, "street.gltf"),
    "sog": _save_sog,
    "sog-folder": lambda folder: _save_sog_folder(folder, legacy=False),
    "sog-folder-old": lambda folder: _save_sog_folder(folder, legacy=True),
    "sog-levels": lambda folder: _save_sog_levels(folder, tree=True),
    "sog-chunks": lambda folder: _save_sog_levels(folder, tree=False),
    "ksplat": _save_ksplat,
    "lcc": _save_lcc,
    "scene-folder": _save_folder,
}
"""By name, what writes the scene and returns the path to open."""
