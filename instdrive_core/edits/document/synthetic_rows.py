"""Splats that are no surface photos showed, by the column that marks them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.instances.shadows import LEARNED_SHADOW, MIRRORED, SHADOW, SHADOWS, SYNTHETIC
from instdrive_core.scene.scene import Scene

__all__ = [
    "LEARNED_SHADOW",
    "MIRRORED",
    "SHADOW",
    "SYNTHETIC",
    "drop_shadows",
    "find_learned",
    "find_marked",
    "find_shadow",
]


def find_marked(document: Document, rows: Int64[ndarray, " n"], *values: int) -> Bool[ndarray, " n"]:
    """Find which rows the column marks by one of some values."""
    column = document.scene.extra.get(SYNTHETIC)
    return np.zeros(len(rows), bool) if column is None else np.isin(column[rows], values)


def find_shadow(document: Document, rows: Int64[ndarray, " n"]) -> Bool[ndarray, " n"]:
    """Find which rows are of shadows, whether they were laid or learned."""
    return find_marked(document, rows, *SHADOWS)


def drop_shadows(document: Document, rows: Int64[ndarray, " n"]) -> Int64[ndarray, " m"]:
    """Drop the rows of shadows, whether they were laid or learned."""
    return rows if SYNTHETIC not in document.scene.extra else rows[~find_shadow(document, rows)]


def find_learned(scene: Scene) -> Bool[ndarray, " n"]:
    """Find which splats photos were the reason for: all that no edit has made."""
    column = scene.extra.get(SYNTHETIC)
    return np.ones(len(scene), bool) if column is None else (column == 0) | (column == LEARNED_SHADOW)
