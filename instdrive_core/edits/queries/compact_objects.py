"""Compact objects among the instances, and the space they fill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC, drop_shadows
from instdrive_core.instances.interiors import DEFAULT_CONFIG, TALLEST_VEHICLE, CompactObject, fit_compact_object
from instdrive_core.instances.table import Instance
from instdrive_core.maths.activations import sigmoid

FAR_STRAYS = replace(DEFAULT_CONFIG, stray_share=0.06)
"""For an instance whose bounds are an object's though more splats than usual lie far from it."""


def select_solid_points(document: Document, members: Int64[ndarray, " m"]) -> Float64[ndarray, "k 3"]:
    """Means of the rows that are opaque enough to span a hull, metres, in the frame of their node."""
    members = drop_shadows(document, members)
    solid = members[sigmoid(document.scene.gaussians.opacity_logits[members]) >= DEFAULT_CONFIG.min_opacity]
    return document.compute_means(solid).astype(np.float64)


def keep_main_node(document: Document, rows: Int64[ndarray, " n"]) -> Int64[ndarray, " m"]:
    """Keep the rows of the node that most of them lie in: trained instances may have strays in another."""
    nodes = document.scene.nodes[rows]
    return rows[nodes == np.bincount(nodes).argmax()] if len(rows) else rows


def build_body(document: Document, instance_id: int, members: Int64[ndarray, " m"]) -> CompactObject | None:
    """The body that rows of one node span; None where they are too large, too flat or too few for one."""
    points = select_solid_points(document, members)
    if len(points) < DEFAULT_CONFIG.min_gaussians:
        return None
    body = fit_compact_object(instance_id, points)
    if body is None and instance_id in document.scene.table and is_compact(document.scene.table[instance_id]):
        # Its bounds leave out more strays than a hull does.
        body = fit_compact_object(instance_id, points, FAR_STRAYS)
    return body


def is_compact(instance: Instance) -> bool:
    """Whether an instance's bounds are those of an object, not of a surface, of a scrap or of what fills a hole."""
    low, high = np.array(instance.bounds)
    size = high - low
    large_enough = instance.count >= DEFAULT_CONFIG.min_gaussians and size[2] >= DEFAULT_CONFIG.min_height
    large_enough &= instance.class_name != SYNTHETIC
    return bool(large_enough and size[:2].max() <= DEFAULT_CONFIG.max_length)


def is_tall(instance: Instance) -> bool:
    """Whether an instance is taller than any vehicle, such as a narrow house or a tree."""
    return bool(instance.bounds[1][2] - instance.bounds[0][2] > TALLEST_VEHICLE)
