"""StreetGaussians' .ply and data set, small: for tests and fuzzing."""

from __future__ import annotations

import numpy as np


def write_street_ply(path, content, order="<"):
    """Write a checkpoint's models as StreetGaussians' .ply: an element each, in the checkpoint's order.

    `order` is ``<``, ``>`` or ``=`` for ASCII.
    """
    names = [name for name, state in content.items() if isinstance(state, dict) and "xyz" in state]
    kind = {"<": "binary_little_endian", ">": "binary_big_endian", "=": "ascii"}[order]
    lines, bodies = ["ply", f"format {kind} 1.0"], []
    for name in names:
        columns = _list_columns(content[name])
        rows = np.stack(list(columns.values()), axis=1).astype(np.float32)
        lines += [f"element vertex_{name} {len(rows)}", *(f"property float {column}" for column in columns)]
        text = "".join(" ".join(repr(float(value)) for value in row) + "\n" for row in rows)
        bodies.append(text.encode() if order == "=" else rows.astype(f"{order}f4").tobytes())
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes("\n".join([*lines, "end_header", ""]).encode() + b"".join(bodies))
    return path


def write_street_run(folder, source, frames=(0, 198)):
    """Write the settings of a run: where its data set is, and the frames that it was trained on."""
    (folder / "configs").mkdir(parents=True)
    (folder / "cfg_args").write_text(f"Namespace(model_path='{folder}', sh_degree=1, source_path='{source}')")
    config = f"data:\n  selected_frames:\n  - {frames[0]}\n  - {frames[1]}\n  type: Waymo\nsource_path: {source}\n"
    (folder / "configs" / "config_000000.yaml").write_text(config)


def write_street_tracks(folder, frames=4):
    """The data set's folders: a car that drives on, and a box beside it."""
    (folder / "track").mkdir(parents=True)
    (folder / "ego_pose").mkdir()
    lines = ["frame_id track_id object_class alpha box_height box_width box_length box_center_x y z box_heading speed"]
    for frame in range(frames):
        pose = np.eye(4)
        pose[0, 3] = 100 + 2 * frame
        np.savetxt(folder / "ego_pose" / f"{frame:06d}.txt", pose)
        np.savetxt(folder / "ego_pose" / f"{frame:06d}_0.txt", pose)
        lines.append(f"{frame} 7 vehicle -10 1.5 1.9 4.5 8.0 {frame}.0 0.5 0.3 5.0")
    (folder / "track" / "track_info.txt").write_text("\n".join(lines) + "\n")


def _list_columns(state):
    """Columns of a model, by name; features channel by channel."""
    count = len(state["xyz"])
    tables = {"f_dc_": _spread(state["feature_dc"]), "f_rest_": _spread(state["feature_rest"])}
    tables |= {"scale_": state["scaling"], "rot_": state["rotation"], "semantic_": state["semantic"]}
    columns = {axis: state["xyz"][:, row] for row, axis in enumerate("xyz")}
    columns |= {f"n{axis}": np.zeros(count) for axis in "xyz"}
    for prefix in ("f_dc_", "f_rest_"):
        columns |= {f"{prefix}{row}": column for row, column in enumerate(tables[prefix].T)}
    columns["opacity"] = state["opacity"].reshape(count)
    for prefix in ("scale_", "rot_", "semantic_"):
        columns |= {f"{prefix}{row}": column for row, column in enumerate(tables[prefix].T)}
    return columns


def _spread(features):
    return features.transpose(0, 2, 1).reshape(len(features), -1)
