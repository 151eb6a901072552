"""Whole files of every kind that is read, small, for `benchmarks.fuzz` to damage: scenes, projects and journals."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import laspy
import numpy as np
from PIL import Image

from benchmarks.edit_street import build_edit_street
from benchmarks.fuzz_clip_seeds import list_clip_seeds
from benchmarks.fuzz_layout_seeds import list_layout_seeds
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.formats.actors.sample_files import write_street_ply, write_street_run, write_street_tracks
from instdrive_core.formats.checkpoints.sample_files import (
    build_captured_content,
    build_drivestudio_content,
    build_gsplat_content,
    build_hugsim_content,
    build_splatfacto_content,
    build_street_content,
    write_checkpoint,
    write_hugsim_scene,
    write_training_folder,
)
from instdrive_core.formats.clouds.sample_files import build_pcd
from instdrive_core.formats.ksplat.sample_files import build_ksplat
from instdrive_core.formats.lcc.sample_files import build_lcc
from instdrive_core.formats.nurec.hand_over import plan_hand_over
from instdrive_core.formats.nurec.sequence_tracks import SequenceTracks, write_sequence_tracks
from instdrive_core.formats.nurec.writing import write_hand_over
from instdrive_core.formats.registry import save_scene
from instdrive_core.formats.spz.scenes import write_spz
from instdrive_core.project.edit_log import LoggedHistory, diff_histories
from instdrive_core.project.journal import EditJournal
from instdrive_core.project.open import open_document
from instdrive_core.project.save import save_project
from instdrive_core.project.session_folder import JOURNAL, write_session
from instdrive_core.project.sources import get_sources, record_source
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky

_PAGE_DATA = b'<script type="text/plain" id="instdrive-about">'
Files = dict[str, bytes]
"""Content by name, relative to a folder, with ``/``."""


@dataclass(frozen=True)
class Seed:
    """Files that are opened together."""

    kind: str
    """Which reader opens it (`fuzz_readers.READERS`)."""
    name: str
    files: Files
    entry: str = ""
    """What is opened, relative to the folder; empty for the folder itself."""

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(map(len, self.files.values()))


@cache
def list_seeds() -> tuple[Seed, ...]:
    """At least one of each kind, always the same."""
    with TemporaryDirectory() as name:
        return (
            *_list_scene_seeds(Path(name)),
            *_list_sog_seeds(),
            *_list_edit_seeds(Path(name)),
            *list_clip_seeds(Seed),
            *list_layout_seeds(Seed),
            *_list_checkpoint_seeds(Path(name) / "checkpoints"),
            *_list_nurec_seeds(Path(name) / "handed"),
        )


def read_files_below(folder: Path) -> Files:
    """The content of a folder."""
    found = (file for file in sorted(folder.rglob("*")) if file.is_file())
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in found}


def _small_street() -> Scene:
    scene = build_edit_street(seed=3, ground=60, cars=2, actors=1, per_car=20)
    camera = Camera(40.0, 40.0, 16.0, 9.0, 32, 18, np.eye(4))
    scene.views = tuple(CameraView(camera, "front", step, 0.1 * step, f"photo{step}.jpg", False) for step in range(2))
    scene.sky = Sky(np.full((6, 2, 2, 3), 0.5, np.float32))
    matrices = np.tile(np.eye(3, 4, dtype=np.float32), (1, 1, 1))
    scene.exposures = Exposures(("front/00",), np.zeros(1), matrices)
    return scene


def _list_scene_seeds(folder: Path) -> Iterator[Seed]:
    drive = _small_street()
    still = replace(freeze_at_time(drive, 0.2), views=(), sky=None, exposures=None)

    def written(kind: str, file: str, write: Callable[[Path], None]) -> Seed:
        write(folder / file)
        return Seed(kind, file, {file: (folder / file).read_bytes()}, file)

    binary = written("ply", "binary.ply", lambda path: save_scene(path, still))
    yield binary
    yield Seed("ply", "big.ply", {"big.ply": _convert_ply(binary.files["binary.ply"], ">")}, "big.ply")
    yield Seed("ply", "ascii.ply", {"ascii.ply": _convert_ply(binary.files["binary.ply"], "=")}, "ascii.ply")
    yield written("ply", "plain.sibr.ply", lambda path: save_scene(path, still))
    yield written("compressed_ply", "packed.compressed.ply", lambda path: save_scene(path, still))
    yield written("splat", "scene.splat", lambda path: save_scene(path, still))
    for version in (1, 2, 3, 4):
        yield written("spz", f"v{version}.spz", lambda path, version=version: write_spz(path, still, version))
    for name in ("scene.glb", "scene.gltf"):
        yield written("gltf", name, lambda path: save_scene(path, still))
    moving = replace(drive, views=(), sky=None, exposures=None)
    for name in ("scene.usda", "scene.usdc", "scene.usdz"):
        yield written("usd", name, lambda path: save_scene(path, moving))
    yield written("splatsim", "scene.splatsim.usdz", lambda path: save_scene(path, moving))
    yield _strip_viewer(written("html", "page.html", lambda path: save_scene(path, still)))
    rng = np.random.default_rng(4)
    for level in (0, 1, 2):
        name = f"level{level}.ksplat"
        yield Seed("ksplat", name, {name: build_ksplat(rng, [(37, 1), (9, 0)], level)}, name)
    yield from _list_cloud_seeds(rng)
    yield Seed("lcc", "quality", build_lcc(rng, environment=5))
    yield Seed("lcc", "portable", build_lcc(rng, harmonics=False), "meta.lcc")
    save_scene(folder / "run", drive)
    yield Seed("scene_folder", "run", read_files_below(folder / "run"))


def _strip_viewer(page: Seed) -> Seed:
    """A page without the viewer's script and styles, which readers pass over and which are most of it."""
    return replace(page, files={name: page[page.index(_PAGE_DATA) :] for name, page in page.files.items()})


def _list_cloud_seeds(rng: np.random.Generator) -> Iterator[Seed]:
    points, colors = rng.normal(0, 9, (50, 3)), rng.integers(0, 255, (50, 3))
    for form in ("ascii", "binary", "binary_compressed"):
        yield Seed("cloud", f"{form}.pcd", {f"{form}.pcd": build_pcd(points, colors, form)}, f"{form}.pcd")
    for ending in ("las", "laz"):
        data: Any = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
        data.header.scales = [0.001] * 3
        data.x, data.y, data.z = points.T
        file = io.BytesIO()
        data.write(file, do_compress=ending == "laz")
        yield Seed("cloud", f"a.{ending}", {f"a.{ending}": file.getvalue()}, f"a.{ending}")


def _convert_ply(content: bytes, order: str) -> bytes:
    """A binary little-endian .ply as big-endian (``>``) or ASCII (``=``)."""
    header, mark, body = content.partition(b"end_header\n")
    kinds = {"float": "<f4", "uint": "<u4"}
    columns = [line.split()[1:] for line in header.decode().splitlines() if line.startswith("property")]
    rows = np.frombuffer(body, np.dtype([(name, kinds[kind]) for kind, name in columns]))
    form = b"ascii" if order == "=" else b"binary_big_endian"
    header = header.replace(b"binary_little_endian", form)
    if order == ">":
        return header + mark + rows.astype(rows.dtype.newbyteorder(">")).tobytes()
    return header + mark + "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()).encode()


def _list_sog_seeds() -> Iterator[Seed]:
    rng = np.random.default_rng(5)
    modern, old = _sog_files(rng, 60, version=2), _sog_files(rng, 50, version=1)
    for name, method in (("stored.sog", zipfile.ZIP_STORED), ("deflated.sog", zipfile.ZIP_DEFLATED)):
        yield Seed("sog", name, {name: zip_members(modern, method)}, name)
    yield Seed("sog_folder", "modern", modern)
    yield Seed("sog_folder", "old", old, "meta.json")
    leaves = [
        {"lods": {"0": {"file": 0, "offset": 0, "count": 40}}},
        {"lods": {"1": {"file": 1, "offset": 5, "count": 9}}},
    ]
    levels = {
        "lodLevels": 2,
        "filenames": ["0_0/meta.json", "1_0/meta.json"],
        "environment": "env/meta.json",
        "tree": {"children": leaves},
    }
    parts = {"0_0": modern, "1_0": _sog_files(rng, 20, 2), "env": _sog_files(rng, 12, 2)}
    files = {f"{folder}/{name}": data for folder, part in parts.items() for name, data in part.items()}
    yield Seed("sog_levels", "streamed", files | {"lod-meta.json": json.dumps(levels).encode()})
    yield Seed("sog_levels", "chunks", files)


def _sog_files(rng: np.random.Generator, count: int, version: int) -> Files:
    palette = 70
    labels = rng.integers(0, palette, count)
    quats = np.c_[rng.integers(0, 256, (count, 3)), rng.integers(252, 256, count)]
    pixels = {name: rng.integers(0, 256, (count, 4)) for name in ("means_l", "means_u", "scales", "sh0")}
    pixels |= {"quats": quats, "labels": np.c_[labels % 256, labels // 256, np.zeros((count, 2))]}
    files = {f"{name}.webp": _webp(_build_image(values)) for name, values in pixels.items()}
    files["centroids.webp"] = _webp(rng.integers(0, 256, (2, 64 * 3, 4)).astype(np.uint8))
    codebook = np.sort(rng.normal(-3, 1, 256)).tolist()
    meta: dict[str, dict[str, Any]] = {name: {"files": [f"{name}.webp"]} for name in ("scales", "quats", "sh0")}
    meta["means"] = {"mins": [-3.0] * 3, "maxs": [3.0] * 3, "files": ["means_l.webp", "means_u.webp"]}
    meta["shN"] = {"files": ["centroids.webp", "labels.webp"]}
    if version == 2:
        meta["shN"] |= {"count": palette, "bands": 1, "codebook": codebook}
        meta["scales"]["codebook"] = meta["sh0"]["codebook"] = codebook
        return files | {"meta.json": json.dumps({"version": 2, "count": count, **meta}).encode()}
    meta["means"]["shape"] = [count, 3]
    meta["scales"] |= {"mins": [-9.0] * 3, "maxs": [1.0] * 3}
    meta["sh0"] |= {"mins": [-1.0] * 3 + [-6.0], "maxs": [1.0] * 3 + [6.0]}
    meta["shN"] |= {"mins": -0.5, "maxs": 0.75}
    return files | {"meta.json": json.dumps(meta).encode()}


def _build_image(values: np.ndarray) -> np.ndarray:
    image = np.zeros((-(-len(values) // 16) * 16, 4), np.uint8)
    image[: len(values)] = values
    return image.reshape(-1, 16, 4)


def _webp(pixels: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", lossless=True, exact=True)
    return file.getvalue()


def zip_members(members: Mapping[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """An archive; equal content gives equal bytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name), data, method)
    return file.getvalue()


def _list_checkpoint_seeds(folder: Path) -> Iterator[Seed]:
    rng = np.random.default_rng(6)
    contents = {
        "captured.pth": build_captured_content(rng),
        "hugsim.pth": build_hugsim_content(rng),
        "drivestudio.pth": build_drivestudio_content(rng),
        "gsplat.pt": build_gsplat_content(rng),
        "splatfacto.ckpt": build_splatfacto_content(rng),
        "iteration_9.pth": build_street_content(rng),
    }
    for name, content in contents.items():
        root = folder / name.partition(".")[0]
        write_checkpoint(root / name, content)
        if name == "splatfacto.ckpt":
            fields = {"transform": np.eye(3, 4).tolist(), "scale": 0.5}
            (root / "dataparser_transforms.json").write_text(json.dumps(fields))
        if name == "iteration_9.pth":
            write_street_tracks(root)
        kind = "street" if name == "iteration_9.pth" else "checkpoint"
        yield Seed(kind, name, read_files_below(root), name)
    write_hugsim_scene(folder / "hugsim_export", rng)
    yield Seed("checkpoint", "hugsim_export", read_files_below(folder / "hugsim_export"))
    for name, order in (("street", "<"), ("street_big", ">"), ("street_ascii", "=")):
        write_street_ply(folder / name / f"{name}.ply", contents["iteration_9.pth"], order)
        write_street_run(folder / name, "data")
        write_street_tracks(folder / name)
        settings = folder / name / "cfg_args"
        settings.write_text(settings.read_text().replace(str(folder), "data"))
        yield Seed("street", name, read_files_below(folder / name), f"{name}.ply")
    still = replace(freeze_at_time(_small_street(), 0.2), views=(), sky=None, exposures=None)
    run = write_training_folder(folder / "run", lambda path: save_scene(path, still))
    settings = run / "cfg_args"  # the temporary folder's name would damage other bytes in each run
    settings.write_text(settings.read_text().replace(str(folder), "data"))
    yield Seed("training_folder", "run", read_files_below(run))


def _list_edit_seeds(folder: Path) -> Iterator[Seed]:
    scene = replace(freeze_at_time(_small_street(), 0.2), views=(), sky=None, exposures=None)
    base = folder / "kept" / "street.splat"
    base.parent.mkdir()
    save_scene(base.with_suffix(".ply"), scene)
    base = base.with_suffix(".ply")
    document, _ = open_document(base)
    rows = np.flatnonzero(np.arange(len(scene)) % 2 == 0)
    for edit in (SelectRows(rows), RecolorInstances((1,), "tint", (0.1, 0.7, 0.3)), DeleteInstances((2,))):
        document.apply(edit)
    document.undo()
    project = base.with_name("a.instdrive")
    save_project(project, document, {"camera": [1.0, 2.0], "time": 0.5})
    yield Seed("project", "project", read_files_below(base.parent), project.name)
    yield Seed(
        "journal", "session", {base.name: base.read_bytes(), **_session(folder / "session", base, document)}, "session"
    )
    lines = "".join(json.dumps(edit.to_json()) + "\n" for edit in document.history.edits)
    yield Seed("edits", "edits", {"edits.jsonl": lines.encode()}, "edits.jsonl")


def _list_nurec_seeds(folder: Path) -> Iterator[Seed]:
    before = replace(_small_street(), views=(), sky=None, exposures=None)
    after = replace(before, gaussians=before.gaussians.copy())
    after.gaussians.sh_dc[after.nodes > 0] += 0.5
    plan = plan_hand_over(before, after)
    moved = replace(before.actors[0], id="moved")
    inserted = ((plan.edits.assets[0].id, moved),)
    write_hand_over(folder, replace(plan, edits=replace(plan.edits, removed=("8",), inserted=inserted)))
    write_sequence_tracks(folder / "sequence_tracks.json", SequenceTracks(before.actors, 10**15))
    yield Seed("nurec", "handed", read_files_below(folder))


def _session(folder: Path, base: Path, document: Document) -> Files:
    """What an editor that died has left; the base scene is found in the session's folder."""
    folder.mkdir()
    journal, before = EditJournal(folder / JOURNAL), LoggedHistory()
    for done in range(1, document.history.cursor + 1):
        after = LoggedHistory(document.history.edits[:done], done)
        line = diff_histories(before, after)
        assert line is not None
        journal.append(line)
        before = after
    journal.append({"saved": None})
    journal.close()
    write_session(folder, Path(base.name), record_source(get_sources(document).base, base))
    files = {f"session/{name}": data for name, data in read_files_below(folder).items()}
    # The path is the temporary folder's otherwise, and no two runs would damage the same bytes.
    entry = json.loads(files["session/session.json"])
    entry |= {"path": base.name, "pid": 1}
    entry["base"] |= {"absolute": f"/absent/{base.name}", "relative": base.name}
    files["session/session.json"] = json.dumps(entry).encode()
    return files
