"""Reading a bundle: chunks of the street, and bodies on their tracks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.errors import DataError
from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X
from instdrive_core.formats.allocation import WHOLE, ReadOptions, check_memory, count_row_bytes
from instdrive_core.formats.instance_parts import PartCollector
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.formats.sog.store import ZipStore, open_sog_archive
from instdrive_core.formats.splatsim.assets import STRETCH, UNIFORM, Standing, parse_assets
from instdrive_core.formats.splatsim.fields import require_equal, take, take_vector
from instdrive_core.formats.splatsim.layout import (
    ASSETS,
    CHUNKS,
    FRAMES,
    MOST_MEMBERS,
    OWN_DATA,
    REMEDY,
    SCENE,
    SCENE_SCHEMAS,
    TRACKS,
)
from instdrive_core.formats.splatsim.tracks import get_length_width_height, parse_tracks
from instdrive_core.formats.spz.axes import RDF
from instdrive_core.formats.spz.scenes import decode_spz
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import transform_gaussians
from instdrive_core.wording import format_count

_LONGEST_JSON = 256 << 20
_BOX_FROM_OBJECT = np.c_[BOX_FROM_FORWARD_X, np.zeros(3)]
_KNOWN_EXTRAS = ("sequence_tracks", "actor_assets")


def read_bundle(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a bundle of splatsim, versions 2 and 3. Raises DataError where anything about it is wrong."""
    path = Path(path)
    with open_sog_archive(path) as store:
        if len(store.names) > MOST_MEMBERS:
            raise DataError(path, f"the archive has more than {MOST_MEMBERS} members", REMEDY)
        if store.compressed_names:
            problem = f"{store.compressed_names[0][:80]!r} is compressed, which USDZ does not allow"
            raise DataError(path, problem, "Pack it again without compression (zip -0)")
        about = _read_document(store, SCENE)
        if about.get("schema") not in SCENE_SCHEMAS:
            problem = (
                f"the schema of {SCENE} is {str(about.get('schema'))[:60]!r}, known are {', '.join(SCENE_SCHEMAS)}"
            )
            raise DataError(path, problem, "Export it again with a current 3dgs_io")
        world = take(path, about, "world", dict, SCENE)
        require_equal(path, world.get("frame_convention"), FRAMES, f"the frame convention of {SCENE}")
        street = take(path, about, "gaussians", dict, SCENE)
        require_equal(path, street.get("frame"), "world", f"the frame of the Gaussians of {SCENE}")
        tracks, standing, untold = _read_actors(store)
        return _join(store, about, list(_list_chunks(store, street)), tracks, standing, untold, options)


def _read_document(store: ZipStore, name: str) -> dict[str, Any]:
    try:
        content = parse_bounded_json(store.read(name, min(store.size, _LONGEST_JSON)))
    except ValueError as error:
        raise DataError(store.path, f"{name} is no JSON ({error})", REMEDY) from error
    if not isinstance(content, dict):
        raise DataError(store.path, f"{name} holds a {type(content).__name__}, not an object", REMEDY)
    return content


def _list_chunks(store: ZipStore, street: dict[str, Any]) -> Iterator[tuple[str, int | None, dict[str, Any]]]:
    """The member of each chunk, its splats where that is said, and what this program wrote of it."""
    listed = street.get("chunks")
    if listed is None:
        names = sorted(name for name in store.names if name.startswith(CHUNKS) and name.endswith(".spz"))
        yield from ((name, None, {}) for name in names)
        return
    for entry in take(store.path, street, "chunks", list, SCENE):
        own = entry.get(OWN_DATA) if isinstance(entry, dict) else None
        count = take(store.path, entry, "n_points", int, f"a chunk of {SCENE}")
        if count < 0:
            raise DataError(store.path, f"a chunk of {SCENE} has {count} splats", REMEDY)
        uri = take(store.path, entry, "uri", str, f"a chunk of {SCENE}")
        yield uri, count, own if isinstance(own, dict) else {}


def _read_actors(store: ZipStore) -> tuple[dict[str, Track], tuple[Standing, ...], list[str]]:
    """Tracks by ID, what stands on them, and what is left out."""
    tracks = parse_tracks(store.path, _read_document(store, TRACKS)) if TRACKS in store.names else ()
    bodies, standing = parse_assets(store.path, _read_document(store, ASSETS)) if ASSETS in store.names else ((), ())
    by_id = {track.id: track for track in tracks}
    untold = [
        f"{each.body.id}: it stands on track {each.track!r}, which is missing"
        for each in standing
        if each.track not in by_id
    ]
    standing = tuple(each for each in standing if each.track in by_id)
    used = {each.body.id for each in standing}
    idle = [body.id for body in bodies if body.id not in used]
    if idle:
        untold.append(f"{', '.join(idle[:5])}{' …' if len(idle) > 5 else ''}: on no track")
    bare = len(tracks) - len(standing)
    if bare:
        untold.append(f"{format_count(bare, 'track')} without splats of {'its' if bare == 1 else 'their'} own")
    return by_id, standing, untold


def _join(
    store: ZipStore,
    about: dict[str, Any],
    chunks: list[tuple[str, int | None, dict[str, Any]]],
    tracks: dict[str, Track],
    standing: tuple[Standing, ...],
    untold: list[str],
    options: ReadOptions,
) -> Scene:
    path = store.path
    total = sum(count or 0 for _, count, _ in chunks) + sum(each.body.count for each in standing)
    check_memory(path, total, 3 * count_row_bytes(REST_COUNTS[3], 0), options)
    stored = sum(count or 0 for _, count, _ in chunks) + sum(
        body.count for body in {each.body.id: each.body for each in standing}.values()
    )
    check_plausible_count(path, stored, store.size)
    collector, start, marks = PartCollector(), 0, []
    names = _Numbers([*(own for _, _, own in chunks), *(each.body.own for each in standing)])
    for number, (uri, count, own) in enumerate(chunks):
        part, antialiased = _read_splats(store, uri, count)
        marks.append(antialiased)
        collector.add(_keep(part, start, options), names.describe(own))
        start += len(part)
        report((number + 1) / (len(chunks) + len(standing) + 1))
    for node, each in enumerate(standing, 1):
        part, antialiased = _read_splats(store, each.body.uri, each.body.count)
        marks.append(antialiased)
        _put_into_box(part, each, tracks[each.track])
        fallback = {"name": each.track, "class": tracks[each.track].label}
        collector.add(_keep(part, start, options), names.describe(each.body.own, fallback), node)
        start += len(part)
        report((len(chunks) + node) / (len(chunks) + len(standing) + 1))
    if not start:
        raise DataError(path, "no chunk of it holds a splat", REMEDY)
    joined = collector.join()
    own = about.get(OWN_DATA)
    own = own if isinstance(own, dict) else {}
    origin = take_vector(path, own, "origin", 3, SCENE) if "origin" in own else np.zeros(3)
    bits = own.get("code_bits")
    return Scene(
        joined.gaussians,
        joined.instance_ids,
        joined.codewords,
        joined.nodes,
        joined.table,
        actors=tuple(tracks[each.track] for each in standing),
        origin=origin,
        code_bits=bits if isinstance(bits, int) and 0 <= bits <= 32 else 0,
        antialiased=any(marks),
        left_out=(*untold, *_list_left_out(store, about)),
    )


def _read_splats(store: ZipStore, uri: str, count: int | None) -> tuple[Gaussians, bool]:
    data = store.read(uri, store.size)
    part, antialiased = decode_spz(BytesIO(data), store.path, len(data), axes=RDF)
    if count is not None and len(part) != count:
        raise DataError(store.path, f"{uri} holds {len(part)} splats, {count} are listed", REMEDY)
    return part, antialiased


def _keep(part: Gaussians, start: int, options: ReadOptions) -> Gaussians:
    if options.keep_every == 1:
        return part
    return part.select(slice(-start % options.keep_every, None, options.keep_every)).copy()


def _put_into_box(part: Gaussians, standing: Standing, track: Track) -> None:
    """From the body's axes into its track's box, fitted as its bundle wants it."""
    ratios = np.array(get_length_width_height(track)) / standing.body.size
    factor = 1.0
    if standing.fit == UNIFORM:
        factor = float(ratios.min())
    elif standing.fit == STRETCH:  # splats cannot be sheared: they keep their shape and grow as their volume does
        part.means *= ratios.astype(np.float32)
        part.log_scales += np.float32(np.log(ratios).mean())
    transform_gaussians(part, factor * _BOX_FROM_OBJECT)


def _list_left_out(store: ZipStore, about: dict[str, Any]) -> Iterator[str]:
    extras = about.get("extras")
    for name, member in extras.items() if isinstance(extras, dict) else ():
        if member and name not in _KNOWN_EXTRAS:
            yield f"{name} ({str(member)[:80]})"
    if "skybox.png" in store.names:
        yield "skybox.png: its sky"
    if about["gaussians"].get("ext_attributes"):
        yield "what a LiDAR sees of each splat (EXT_gaussian_lidar)"
    if about["world"].get("ecef_anchor") not in (None, np.eye(4).tolist()):
        yield "its place on Earth (ecef_anchor)"


class _Numbers:
    """IDs of parts: those that this program wrote, once each, and new ones for bodies of others."""

    def __init__(self, known: Sequence[Mapping[str, Any]]) -> None:
        self._next = max([own["id"] for own in known if isinstance(own.get("id"), int)], default=0) + 1
        self._bodies: set[int] = set()

    def describe(self, own: Mapping[str, Any], fallback: dict[str, Any] | None = None) -> dict[str, Any]:
        """Describe a part as `InstancePart.describe` does; a body always gets an ID of its own."""
        if fallback is None:
            return dict(own)
        number = own.get("id")
        if isinstance(number, int) and number and number not in self._bodies:
            self._bodies.add(number)
            return dict(own)
        self._next += 1
        return {**fallback, "id": self._next - 1}
