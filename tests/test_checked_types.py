"""The checker that wraps every function while tests run: what it refuses, and that modules are given to it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest
from checked_imports import CheckedFinder
from checked_types import check_types
from jaxtyping import Float, TypeCheckError
from numpy import ndarray

if TYPE_CHECKING:
    from nowhere import Unknown  # pyright: ignore[reportMissingImports]


@check_types
def halve(value: int) -> int:
    return value / 2  # pyright: ignore[reportReturnType]


@check_types
def add_rows(left: Float[ndarray, "n 3"], right: Float[ndarray, "n 3"] | None = None) -> Float[ndarray, "n 3"]:
    return left if right is None else left[:1]


@check_types
def make_rows(count: int, made: int) -> Float[ndarray, "{count} 3"]:
    return np.zeros((made, 3))


@check_types
def count_up(end: int) -> Iterator[int]:
    yield from range(end)


@check_types
def take_unknown(value: Unknown, count: int) -> None: ...


@check_types
@dataclass
class Pair:
    """Two rows of numbers of one length."""

    left: Float[ndarray, " n"]
    right: Float[ndarray, " n"]

    @check_types
    def join(self, other: Pair) -> Pair:
        """`self`; a class is known to its own methods."""
        return self


def test_arguments_and_results_are_checked():
    with pytest.raises(TypeCheckError):
        halve("1")
    with pytest.raises(TypeCheckError):
        halve(3)


def test_sizes_of_one_name_agree_within_a_call_and_are_told():
    rows = np.zeros((2, 3))
    assert add_rows(rows) is rows
    assert len(add_rows(np.zeros((1, 3)), np.zeros((1, 3)))) == 1
    with pytest.raises(TypeCheckError) as refused:
        add_rows(rows, np.zeros((4, 3)))
    assert "n=2" in "".join(refused.value.__notes__)
    with pytest.raises(TypeCheckError):
        add_rows(rows, rows)  # the result has one row


def test_sizes_computed_from_arguments_are_checked():
    assert len(make_rows(2, 2)) == 2
    with pytest.raises(TypeCheckError):
        make_rows(2, 3)


def test_generators_are_checked_when_they_are_called():
    assert list(count_up(2)) == [0, 1]
    with pytest.raises(TypeCheckError):
        count_up("2")


def test_a_type_that_only_type_checkers_know_leaves_the_others_checked():
    take_unknown(object(), 1)
    with pytest.raises(TypeCheckError):
        take_unknown(object(), "1")


def test_data_classes_are_checked_as_they_are_made_and_by_their_methods():
    pair = Pair(np.zeros(2), np.zeros(2))
    assert pair.join(pair) is pair
    with pytest.raises(TypeCheckError):
        Pair(np.zeros(2), np.zeros(3))
    with pytest.raises(TypeCheckError):
        pair.join("pair")


def test_found_modules_are_checked_and_others_are_not(tmp_path, monkeypatch):
    for name in ("watched", "free"):
        (tmp_path / f"{name}_module.py").write_text('"""Doc."""\n\n\ndef take(number: int) -> None: ...\n')
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "meta_path", [CheckedFinder(["watched_module"]), *sys.meta_path])
    import free_module  # pyright: ignore[reportMissingImports]
    import watched_module  # pyright: ignore[reportMissingImports]

    free_module.take("1")
    assert watched_module.__doc__ == "Doc."
    with pytest.raises(TypeCheckError):
        watched_module.take("1")


def test_the_product_is_checked():
    from instdrive_core.maths.rotations import normalize_quaternions  # any function of the product

    with pytest.raises(TypeCheckError):
        normalize_quaternions("none")
