"""Small files of every checkpoint that is read, written without torch as torch 2 writes them: for tests and fuzzing."""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from collections import OrderedDict
from typing import Any, ClassVar

import numpy as np

_KINDS = {
    "<f4": "FloatStorage",
    "<f8": "DoubleStorage",
    "<f2": "HalfStorage",
    "<i8": "LongStorage",
    "|b1": "BoolStorage",
}


class _Global:
    """A name of torch, pickled without torch."""

    def __init__(self, module, name):
        self.__module__, self.__qualname__ = module, name


class _Rebuilt:
    def __init__(self, arguments):
        self.arguments = arguments


_PurePickler: Any = pickle._Pickler  # pyright: ignore[reportPrivateUsage]


class _Pickler(_PurePickler):
    """Writes arrays as torch writes tensors: protocol 2, storages by persistent ID."""

    dispatch: ClassVar = dict(_PurePickler.dispatch)

    def __init__(self, file):
        super().__init__(file, protocol=2)
        self.storages = {}

    def persistent_id(self, obj):
        if not isinstance(obj, _Rebuilt):
            return None
        array = obj.arguments
        key = str(len(self.storages))
        self.storages[key] = np.ascontiguousarray(array)
        return ("storage", _Global("torch", _KINDS[array.dtype.str]), key, "cuda:0", array.size)

    def save_global_name(self, obj):
        self.write(pickle.GLOBAL + f"{obj.__module__}\n{obj.__qualname__}\n".encode())

    dispatch[_Global] = save_global_name

    def save_array(self, array):
        self.save_global_name(_Global("torch._utils", "_rebuild_tensor_v2"))
        strides = tuple(int(step) // array.itemsize for step in np.array(array, order="C").strides)
        self.save((_Rebuilt(array), 0, array.shape, strides, False, OrderedDict()))
        self.write(pickle.REDUCE)

    dispatch[np.ndarray] = save_array


def write_checkpoint(path, content):
    """Write what torch.save would, byte for byte readable by torch.load; arrays become tensors."""
    stream = io.BytesIO()
    pickler = _Pickler(stream)
    pickler.dump(content)
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        name = path.stem
        archive.writestr(zipfile.ZipInfo(f"{name}/data.pkl"), stream.getvalue())
        archive.writestr(zipfile.ZipInfo(f"{name}/byteorder"), b"little")
        for key, array in pickler.storages.items():
            archive.writestr(zipfile.ZipInfo(f"{name}/data/{key}"), array.tobytes())
        archive.writestr(zipfile.ZipInfo(f"{name}/version"), b"3\n")
    return path


def build_splat_arrays(rng, count, rest=3, scales=3):
    """Means, quaternions, log scales, opacities, constant SH and the rest, as trainers hold them."""
    shapes = {"means": (3,), "quats": (4,), "scales": (scales,), "opacities": (1,), "dc": (3,), "rest": (rest, 3)}
    return {name: rng.normal(0, 1, (count, *tail)).astype(np.float32) for name, tail in shapes.items()}


def build_gsplat_content(rng, count=40):
    arrays = build_splat_arrays(rng, count)
    splats = {name: arrays[name] for name in ("means", "quats", "scales")}
    splats |= {"opacities": arrays["opacities"][:, 0], "sh0": arrays["dc"][:, None], "shN": arrays["rest"]}
    return {"step": 6999, "splats": OrderedDict(splats)}


def build_splatfacto_content(rng, count=40, prefix="_model.gauss_params."):
    arrays = build_splat_arrays(rng, count)
    names = {"means": "means", "quats": "quats", "scales": "scales", "opacities": "opacities"}
    names |= {"features_dc": "dc", "features_rest": "rest"}
    tensors = {f"{prefix}{name}": arrays[key] for name, key in names.items()}
    tensors["_model.camera_optimizer.pose_adjustment"] = np.zeros((3, 6), np.float32)
    return {"step": 29999, "pipeline": OrderedDict(tensors), "optimizers": {"means": {"state": {0: {"step": 3}}}}}


def build_captured_content(rng, count=40):
    """INRIA's ``capture``."""
    a = build_splat_arrays(rng, count)
    zeros = np.zeros((count, 1), np.float32)
    state = {"state": {0: {"exp_avg": a["means"]}}, "param_groups": [{"lr": 0.1, "params": [0]}]}
    head = (1, a["means"], a["dc"][:, None], a["rest"], a["scales"], a["quats"], a["opacities"])
    return ((*head, zeros[:, 0], zeros, zeros, state, 5.2), 30000)


def build_hugsim_content(rng, count=30, ground=12):
    """HUGSIM's scene with its ground."""
    a, g = build_splat_arrays(rng, count), build_splat_arrays(rng, ground, scales=2)
    features = rng.normal(0, 1, (count, 20)).astype(np.float32)
    more = rng.normal(0, 1, (ground, 20)).astype(np.float32)
    head = (1, a["means"], a["dc"][:, None], a["rest"], features, a["scales"], a["quats"], a["opacities"], 10)
    road = (1, g["means"], g["dc"][:, None], g["rest"], more, g["scales"], g["quats"], g["opacities"])
    return ((*head, OrderedDict(params=features[0]), road), 30000)


def write_hugsim_scene(folder, rng, moments=5):
    """HUGSIM's exported scene: a car with a fitted motion, one with the data set's poses, one without either."""
    write_checkpoint(folder / "scene.pth", build_hugsim_content(rng))
    for name, count in (("1", 14), ("2", 9), ("3", 6)):
        a = build_splat_arrays(rng, count)
        features = np.zeros((count, 20), np.float32)
        # Scenes that were exported anew hold lists.
        saved = [1, a["means"], a["dc"][:, None], a["rest"], features, a["scales"], a["quats"], a["opacities"], 10]
        write_checkpoint(folder / f"dynamic_{name}.pth", (saved, 30000))
    times = np.arange(moments) / 2
    yaw = np.linspace(0.2, 0.9, moments)
    path = np.stack([8 * times, 1.5 + 0 * times, 20 - 3 * times])
    motion = (path[0], path[2], 0 * yaw, np.full((moments, 2), np.pi / 2), yaw, path[1], times, np.diff(times))
    write_checkpoint(folder / "unicycle_1.pth", tuple(np.ascontiguousarray(array, "<f4") for array in motion))
    corners = [[x, y, z] for x in (-2.2, 2.2) for y in (-1.6, 0.0) for z in (-0.9, 0.9)]
    frames = []
    for row in range(moments):
        pose = np.eye(4)
        pose[:3, 3] = -3, 1.4, 10 - row
        pose[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
        dynamics = {"2": pose.tolist()} if row else {}
        for camera in ("front", "left"):
            fields = {"rgb_path": f"./images/cam_{camera}/{row:06d}.png", "timestamp": row / 2, "dynamics": dynamics}
            size = {"width": 64, "height": 40, "intrinsics": np.diag([50.0, 50, 1, 1]).tolist()}
            frames.append({**fields, **size, "camtoworld": np.eye(4).tolist()})
    meta = {"camera_model": "OPENCV", "frames": frames, "verts": {"1": corners, "2": corners}}
    (folder / "meta_data.json").write_text(json.dumps(meta))
    (folder / "cfg.yaml").write_text("source_path: data\ndata_type: nuscenes\nunicycle: true\n")
    return folder


def build_class_state(rng, count, **more):
    """A class of drivestudio's Gaussians."""
    arrays = build_splat_arrays(rng, count, rest=more.pop("rest", 15))
    names = {"_means": "means", "_quats": "quats", "_scales": "scales", "_opacities": "opacities"}
    names |= {"_features_dc": "dc", "_features_rest": "rest"}
    return OrderedDict({name: arrays[key] for name, key in names.items()} | more)


def build_node_fields(rng, owners, frames, sizes):
    """What drivestudio's nodes have beside their Gaussians: instances that move along x and turn."""
    count = len(sizes)
    angles = rng.uniform(-2, 2, (frames, count))
    quats = np.stack([np.cos(angles / 2), 0 * angles, 0 * angles, np.sin(angles / 2)], axis=-1).astype(np.float32)
    trans = rng.normal(0, 10, (frames, count, 3)).astype(np.float32)
    return {
        "points_ids": np.asarray(owners, np.int64)[:, None],
        "instances_size": np.asarray(sizes, np.float32),
        "instances_fv": np.ones((frames, count), bool),
        "instances_quats": quats,
        "instances_trans": trans,
    }


def build_bending_weights(rng, embedding=4, frequencies=2, width=8, layers=4):
    """A small deformation network of drivestudio, with a head for positions and one for rotations."""
    given = embedding + 4 + 8 * frequencies
    tensors = {}
    for row in range(layers):
        size = given if row == 0 else width + (given if row == layers // 2 + 1 else 0)
        tensors[f"deform_network.linear.{row}.weight"] = rng.normal(0, 0.3, (width, size)).astype(np.float32)
        tensors[f"deform_network.linear.{row}.bias"] = rng.normal(0, 0.3, width).astype(np.float32)
    for name, size in (("gaussian_warp", 3), ("gaussian_rotation", 4)):
        tensors[f"deform_network.{name}.weight"] = rng.normal(0, 0.1, (size, width)).astype(np.float32)
        tensors[f"deform_network.{name}.bias"] = rng.normal(0, 0.1, size).astype(np.float32)
    return tensors


def build_body_buffers(rng, people, resolution=(2, 4, 4)):
    """Buffers of SMPL's template, with the canonical pose as the rest pose."""
    joints = rng.normal(0, 0.4, (people, 24, 3)).astype(np.float32)
    inverse = np.tile(np.eye(4, dtype=np.float32), (people, 24, 1, 1))
    weights = rng.uniform(0, 1, (people, 24, *resolution)).astype(np.float32)
    weights /= weights.sum(axis=1, keepdims=True)
    prefix = "template.voxel_deformer."
    return {
        "template.J_canonical": joints,
        "template.A0_inv": inverse,
        f"{prefix}lbs_voxel_base": weights,
        f"{prefix}offset": np.zeros((people, 1, 3), np.float32),
        f"{prefix}scale": np.full((people, 1, 1), 2.0, np.float32),
        f"{prefix}ratio": np.array(2.0, np.float32),
    }


def build_drivestudio_content(rng, frames=5):
    """Background, two cars, a deformable thing, a person and a sky."""
    background = build_class_state(rng, 30)
    rigid = build_class_state(
        rng, 20, **build_node_fields(rng, [0] * 12 + [1] * 8, frames, [[4.5, 1.9, 1.5], [4.2, 1.8, 1.5]])
    )
    rigid["instances_fv"][:2, 1] = False
    soft = build_class_state(
        rng, 10, **build_node_fields(rng, [0] * 10, frames, [[0.9, 0.8, 1.7]]), **build_bending_weights(rng)
    )
    soft["instances_embedding"] = rng.normal(0, 1, (1, 4)).astype(np.float32)
    person = build_class_state(rng, 14, rest=3, **build_node_fields(rng, [0] * 14, frames, [[0.6, 0.5, 1.8]]))
    person["instances_quats"] = person["instances_quats"][:, :, None]
    limbs = rng.normal(0, 0.2, (frames, 1, 23, 4)).astype(np.float32)
    limbs[..., 0] = 1
    person["smpl_qauts"] = limbs
    person |= build_body_buffers(rng, 1)
    models = {"Background": background, "RigidNodes": rigid, "DeformableNodes": soft, "SMPLNodes": OrderedDict(person)}
    models["Sky"] = OrderedDict(base=rng.uniform(0, 1, (6, 4, 4, 3)).astype(np.float32))
    models["Affine"] = OrderedDict(weight=np.zeros((2, 2), np.float32))
    return OrderedDict({"models": models, "step": 30000})


def build_street_content(rng):
    """StreetGaussians' background, an object whose colour changes, and a sky."""

    def state(count, series):
        a = build_splat_arrays(rng, count)
        dc = rng.normal(0, 1, (count, series, 3)).astype(np.float32)
        fields = {"xyz": a["means"], "feature_dc": dc, "feature_rest": a["rest"], "scaling": a["scales"]}
        return fields | {
            "rotation": a["quats"],
            "opacity": a["opacities"],
            "semantic": np.zeros((count, 0), np.float32),
        }

    sky = {"params": OrderedDict(sky_cube_map=rng.uniform(0, 1, (6, 4, 4, 3)).astype(np.float32))}
    return {"background": state(30, 1), "obj_007": state(12, 5), "actor_pose": {}, "sky_cubemap": sky, "iter": 50000}


def write_training_folder(folder, write_ply, photos=3):
    """INRIA's folder: two iterations, written by `write_ply(path)`, cameras and settings."""
    for iteration in (7000, 30000):
        (folder / "point_cloud" / f"iteration_{iteration}").mkdir(parents=True)
    write_ply(folder / "point_cloud" / "iteration_30000" / "point_cloud.ply")
    turn = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    size: dict[str, object] = {"width": 640, "height": 360, "fx": 500.0, "fy": 505.0}
    cameras = [
        {"id": row, "img_name": f"{row:05d}", "position": [row, 2.0, 3.5], "rotation": turn, **size}
        for row in range(photos)
    ]
    (folder / "cameras.json").write_text(json.dumps(cameras))
    settings = f"Namespace(data_device='cuda', images='images', sh_degree=3, source_path='{folder.parent / 'data'}')"
    (folder / "cfg_args").write_text(settings)
    return folder
