"""What `benchmarks.fuzz` reads files with, and what it looks at in the result."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.fuzz_clip_seeds import HEIGHT, WIDTH
from benchmarks.fuzz_layout_seeds import KINDS as LAYOUTS
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.point_cloud import read_point_ply
from instdrive_core.datasets.registry import load_clip
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.serialize import edits_from_lines
from instdrive_core.errors import DataError
from instdrive_core.files.restricted_pickle import read_pickle
from instdrive_core.formats.nurec.edit_assets import read_asset_edits
from instdrive_core.formats.nurec.objects import find_asset, read_object
from instdrive_core.formats.nurec.sequence_tracks import read_sequence_tracks
from instdrive_core.formats.registry import open_scene
from instdrive_core.masks.imported.labels import READERS as MASK_READERS
from instdrive_core.masks.label_map_folder import open_masks
from instdrive_core.project.open import open_project
from instdrive_core.project.recoverable import find_pending_sessions, restore_session
from instdrive_core.scene.lint import find_defects
from instdrive_core.scene.scene import Scene


@dataclass(frozen=True)
class Read:
    """What came out of a file that was read without an error."""

    digest: str
    """Digest of everything that was read."""
    reported: tuple[str, ...] = ()
    """What the linter, or a note to the user, says of it."""
    unreported: str = ""
    """A value that nothing can be done with and nothing is said about; empty where there is none."""


def read_scene(path: Path) -> Read:
    """Any scene, and the linter's findings."""
    return _scene_facts(open_scene(path))


def _scene_facts(scene: Scene, notes: tuple[str, ...] = ()) -> Read:
    findings = find_defects(scene)
    kinds = {finding.kind for finding in findings}
    arrays = scene.gaussians.arrays()
    unreported = ""
    logits = arrays["opacity_logits"]
    is_finite = not np.isnan(logits).any() and all(
        np.isfinite(values).all() for name, values in arrays.items() if name != "opacity_logits"
    )
    if not is_finite and "not_finite" not in kinds:
        unreported = "a splat's value is not finite"
    if not (arrays["quats"] != 0).any(axis=1).all() and "zero_quaternion" not in kinds:
        unreported = "a splat's quaternion is zero"
    # The linter looks at splats only: whatever else comes with a scene must have been refused.
    others = {"origin": scene.origin}
    others |= {f"view {view.name}": _camera_numbers(view) for view in scene.views}
    for actor in scene.actors:
        others[f"track {actor.id}"] = np.r_[actor.times, actor.world_from_box.ravel(), actor.dimensions]
    if scene.sky is not None:
        others["sky"] = scene.sky.faces
    if scene.exposures is not None:
        others |= {"exposure times": scene.exposures.times, "exposures": scene.exposures.matrices}
    unreported = unreported or _not_finite(others.items())
    parts = [*arrays.values(), scene.instance_ids, scene.codewords, scene.nodes, *others.values()]
    texts = [*scene.extra, *map(repr, scene.table), scene.code_bits]
    said = tuple(f"{finding.kind} {finding.count}" for finding in findings)
    return Read(_digest([*parts, *scene.extra.values()], texts), (*said, *notes), unreported)


def _camera_numbers(view) -> np.ndarray:
    camera = view.camera
    return np.r_[camera.fx, camera.fy, camera.cx, camera.cy, view.time, camera.world_from_camera.ravel()]


def read_project(path: Path) -> Read:
    """A project, with the edits done."""
    opened = open_project(path)
    return _document_facts(opened.document, opened.notes, repr(opened.view))


def _document_facts(document: Document, notes: tuple[str, ...], view: str = "") -> Read:
    facts = _scene_facts(document.scene, notes)
    parts = [document.state.flags, document.colors.indices, document.colors.values, document.transforms.values]
    texts = [facts.digest, view, document.history.cursor, *(edit.to_json() for edit in document.history.edits)]
    return Read(_digest(parts, texts), facts.reported, facts.unreported)


def read_journal_folder(path: Path) -> Read:
    """What an editor that died has left, in a folder of sessions."""
    found = [session for session in find_pending_sessions(path.parent) if session.folder.name == path.name]
    if not found:
        return Read("", ("no session",))
    if found[0].problem:
        raise DataError(path, found[0].problem, "")
    restored = restore_session(found[0])
    return _document_facts(restored.document, restored.notes)


def read_edits(path: Path) -> Read:
    """A list of edits, as `instdrive apply` takes it."""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:  # `instdrive apply` says so
        return Read("", ("no text",))
    return Read(_digest([], [edit.to_json() for edit in edits_from_lines(text)]))


def read_clip(path: Path) -> Read:
    """A clip with all photos and sweeps."""
    clip = load_clip(str(path), ClipOptions(cameras="6"))
    numbers = [(f"photo {frame.key}", _camera_numbers(frame.view)) for frame in clip.frames]
    sweeps = [sweep.load() for sweep in clip.sweeps]
    numbers += [("sweep", sweep.points) for sweep in sweeps] + [("intensity", sweep.intensity) for sweep in sweeps]
    numbers += [("track", np.r_[track.world_from_box.ravel(), track.dimensions]) for track in clip.tracks]
    numbers += [("origin", clip.origin)]
    if clip.points is not None:
        numbers += [("points", clip.points.points)]
    parts = [values for _, values in numbers] + [frame.load_image() for frame in clip.frames]
    for sweep in sweeps:
        parts += [array for array in (sweep.classes, sweep.instance_labels, sweep.times) if array is not None]
        numbers += [] if sweep.times is None else [("time", sweep.times)]
    texts = [clip.class_names, clip.camera_names, *(track.label for track in clip.tracks)]
    return Read(_digest(parts, texts), clip.notes, _not_finite(numbers))


def read_table(path: Path) -> Read:
    """A pickled table."""
    table = read_pickle(path)
    return Read(_digest([], [(name, column.dtype, column.tolist()) for name, column in table.items()]))


def read_points(path: Path) -> Read:
    """A cloud of points."""
    found = read_point_ply(path)
    return Read(_digest([found.points, found.colors], []), (), _not_finite([("points", found.points)]))


def read_mask(path: Path) -> Read:
    """Masks of one photo."""
    return Read(_digest([MASK_READERS[path.suffix](path, WIDTH, HEIGHT)], []))


def read_mask_folder(path: Path) -> Read:
    """All masks of a folder."""
    folder = open_masks(path)
    masks = [folder.load(key) for key in folder.counts]
    parts = [array for mask in masks for array in (mask.labels, mask.sky)]
    return Read(_digest(parts, [folder.source, folder.seed, folder.faults, folder.counts]))


def read_hand_over(path: Path) -> Read:
    """A hand-over to NuRec with its objects, and the tracks beside it."""
    told, known = read_asset_edits(path / "edit-assets.json"), read_sequence_tracks(path / "sequence_tracks.json")
    names = [*(one.asset for one in told.replaced), *(asset for asset, _ in told.inserted)]
    tracks = [track for _, track in told.inserted]
    objects = [read_object(find_asset(path, name), known.tracks[0]) for name in names] if known.tracks else []
    facts = [_scene_facts(scene) for scene in objects]
    numbers = [("track", np.r_[t.times, t.world_from_box.ravel(), t.dimensions]) for t in (*tracks, *known.tracks)]
    texts = [told.removed, told.replaced, told.assets, *names, *(fact.digest for fact in facts)]
    said = tuple(sentence for fact in facts for sentence in fact.reported)
    wrong = next((fact.unreported for fact in facts if fact.unreported), "") or _not_finite(numbers)
    return Read(_digest([values for _, values in numbers], texts), said, wrong)


READERS: dict[str, Callable[[Path], Read]] = {
    **dict.fromkeys(("ply", "compressed_ply", "splat", "spz", "ksplat", "lcc", "gltf", "usd", "html"), read_scene),
    **dict.fromkeys(("cloud", "street", "splatsim"), read_scene),
    **dict.fromkeys(("sog", "sog_folder", "sog_levels", "scene_folder", "checkpoint", "training_folder"), read_scene),
    "project": read_project,
    "journal": read_journal_folder,
    "edits": read_edits,
    "pickle": read_table,
    **dict.fromkeys(("pandaset", "colmap", "nerfstudio", *LAYOUTS), read_clip),
    "point_ply": read_points,
    **dict.fromkeys(("mask_npz", "mask_rle", "mask_png"), read_mask),
    "mask_folder": read_mask_folder,
    "nurec": read_hand_over,
}
"""By `Seed.kind`."""


def _not_finite(numbers: Iterable[tuple[str, np.ndarray]]) -> str:
    return next((f"{name} is not finite" for name, values in numbers if not np.isfinite(values).all()), "")


def _digest(arrays: Iterable[np.ndarray], texts: Iterable[object]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    for text in texts:
        digest.update(repr(text).encode(errors="surrogatepass"))
    return digest.hexdigest()
