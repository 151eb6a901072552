"""Scenes as .ply files in INRIA's layout (Kerbl et al. 2023), with instances and features as extra columns.

Reading goes by property name, in any order, type and byte order; columns that are not known are kept. Writing follows
INRIA's column order: x y z, normals, f_dc, f_rest (channel-major), opacity, scale, rot (w first), then the extra ones.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.files.atomic import open_atomically
from instdrive_core.files.ply_header import PlyHeader, find_ply_vertices, read_ply_layout
from instdrive_core.files.ply_rows import CHUNK_ROWS, read_ply_chunks
from instdrive_core.formats.allocation import WHOLE, ReadOptions, allocate_gaussians
from instdrive_core.formats.clouds.ply import is_point_cloud, read_ply_cloud
from instdrive_core.formats.export_checks import check_static
from instdrive_core.formats.ply.columns import (
    ID_LIMITS,
    NORMALS,
    TYPE_NAMES,
    check_columns,
    check_whole_numbers,
    view_columns,
    view_features,
)
from instdrive_core.formats.ply.comments import build_comments, parse_comments
from instdrive_core.formats.ply.compressed import read_compressed_ply
from instdrive_core.formats.ply.compressed_layout import PACKED
from instdrive_core.formats.ply.row_scatter import can_scatter, scatter_rows
from instdrive_core.formats.ply.start_view import build_view_comments, read_sky_picture, write_sky_picture
from instdrive_core.formats.ply.street_elements import is_street_ply, read_street_ply
from instdrive_core.instances.table import build_instance_table
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians, create_empty_gaussians
from instdrive_core.scene.scene import Scene


def read_ply(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .ply of 3D Gaussians (ASCII, binary, packed or StreetGaussians'), or of bare points as a cloud.

    Raises DataError where anything about it is wrong.
    """
    path = Path(path)
    with path.open("rb") as file:
        layout = read_ply_layout(file, path)
        if is_street_ply(layout):
            return read_street_ply(file, layout, path, options)
        header = find_ply_vertices(layout, path, path.stat().st_size)
        names = header.dtype.names or ()
        if set(PACKED) <= set(names):
            return read_compressed_ply(path, options)
        if is_point_cloud(header):
            return read_ply_cloud(file, header, path, options)
        rest, features = check_columns(names, path)
        extra_bytes = sum(header.dtype[name].itemsize for name in _find_unknown_columns(names, rest, features))
        gaussians = allocate_gaussians(path, header.count, rest, features, options, extra=extra_bytes)
        count = len(gaussians)
        ids = {name: np.zeros(count, np.uint32) for name in ID_LIMITS}
        known = view_columns(gaussians) | view_features(gaussians) | ids
        extra = {name: np.empty(count, header.dtype[name].newbyteorder("=")) for name in names if name not in known}
        targets = known | extra
        if options.keep_every == 1 and can_scatter(header):
            scatter_rows(path, header, gaussians, ids, extra)
            return assemble_ply_scene(gaussians, ids, extra, header, path)
        start = 0
        for chunk in read_ply_chunks(file, header, path):
            source, target = options.locate_rows(start, start + len(chunk))
            for name in names:
                if name in ids:
                    check_whole_numbers(chunk[name], name, path)
                targets[name][target] = chunk[name][source]
            start += len(chunk)
            report(start / header.count)
    return assemble_ply_scene(gaussians, ids, extra, header, path)


def write_ply(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment, atomically. Of its cameras only the start view has a place in a .ply.

    Where there is a start view, the sky is written as a picture beside the file.
    Raises DataError where the scene has moving actors: place them first (`edits.queries.bake.freeze_at_time`).
    """
    check_static(path, scene, ".ply")
    columns = collect_columns(scene)
    dtype = np.dtype([(name, column.dtype.newbyteorder("<")) for name, column in columns.items()])
    path = Path(path)
    if scene.start is not None and scene.sky is not None:
        write_sky_picture(path, scene.sky)
    with open_atomically(path) as file:
        file.write(_build_header(scene, dtype, path))
        for start in range(0, len(scene), CHUNK_ROWS):
            chunk = np.empty(min(CHUNK_ROWS, len(scene) - start), dtype)
            for name, column in columns.items():
                chunk[name] = column[start : start + CHUNK_ROWS]
            file.write(chunk.data)
            report(start / len(scene))


def collect_columns(scene: Scene) -> dict[str, ndarray]:
    """The columns (n,) of a scene's file, in their order there."""
    inria = view_columns(scene.gaussians)
    zeros = np.broadcast_to(np.float32(0), len(scene))
    normals = {name: scene.extra.get(name, zeros) for name in NORMALS}
    columns = {name: inria.pop(name) for name in "xyz"} | normals | inria
    if len(scene.table) or scene.code_bits:
        columns |= {"instance_id": scene.instance_ids, "codeword": scene.codewords}
    return columns | view_features(scene.gaussians) | scene.extra


def _build_header(scene: Scene, dtype: np.dtype, path: Path) -> bytes:
    assert dtype.fields is not None
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"comment {comment}" for comment in (*build_comments(scene), *build_view_comments(scene, path))]
    lines.append(f"element vertex {len(scene)}")
    lines += [f"property {TYPE_NAMES[kind.str[1:]]} {name}" for name, (kind, *_) in dtype.fields.items()]
    return "\n".join([*lines, "end_header", ""]).encode()


def _find_unknown_columns(names: tuple[str, ...], rest: int, features: int) -> set[str]:
    """Columns that are kept as they are."""
    one = create_empty_gaussians(rest, features)
    return set(names) - view_columns(one).keys() - view_features(one).keys() - ID_LIMITS.keys()


def assemble_ply_scene(
    gaussians: Gaussians, ids: dict[str, ndarray], extra: dict[str, ndarray], header: PlyHeader, path: Path
) -> Scene:
    """Make a scene of a file's columns (n,) and comments; `ids` are the instance IDs and codewords, `extra` is kept.

    Raises DataError where a comment or the sky beside the file is damaged.
    """
    # INRIA writes zero normals that nobody reads; only real ones are worth their memory.
    if not any(extra[name].any() for name in NORMALS if name in extra):
        extra = {name: column for name, column in extra.items() if name not in NORMALS}
    notes = parse_comments(header.comments, path)
    instance_ids, codewords = ids["instance_id"], ids["codeword"]
    table = build_instance_table(instance_ids, gaussians.means, codewords, None, notes.names, notes.classes)
    return Scene(
        gaussians=gaussians,
        instance_ids=instance_ids,
        codewords=codewords,
        nodes=np.zeros(len(gaussians), np.uint16),
        table=table,
        origin=notes.origin,
        code_bits=notes.code_bits,
        antialiased=notes.antialiased,
        start=notes.start,
        sky=read_sky_picture(path) if notes.start is not None and notes.has_sky else None,
        extra=extra,
    )
