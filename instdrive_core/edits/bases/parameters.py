"""Checks of edits' parameters. Edits are read from files, so a parameter may be anything that JSON can hold."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import TypeGuard

from instdrive_core.errors import EditError
from instdrive_core.maths.vectors import Vector
from instdrive_core.wording import phrase


def is_whole(value: object) -> TypeGuard[int]:
    """Whether this is a whole number: true and false are none."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_number(value: object) -> TypeGuard[float]:
    """Whether this is a number that a float can hold, none of NaN, infinity, true and false."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return bool(abs(value) <= sys.float_info.max)


def check_ids(ids: Iterable[int]) -> tuple[int, ...]:
    """Instance IDs as a rising tuple without repeats. Raises EditError where one is no positive whole number."""
    unique = set()
    for instance_id in ids:
        if not is_whole(instance_id) or instance_id < 1:
            raise EditError(
                phrase("instance ID {instance_id!r} is not a whole number above 0", instance_id=instance_id)
            )
        unique.add(instance_id)
    if not unique:
        raise EditError("no instance IDs were given; name at least one")
    return tuple(sorted(unique))


def check_switch(value: bool, what: str) -> bool:
    """Return a switch as it is. Raises EditError where it is not true or false."""
    if not isinstance(value, bool):
        raise EditError(phrase("{what} is {value!r}, not true or false", what=what, value=value))
    return value


def check_number(value: float, what: str) -> float:
    """The value as a float. Raises EditError unless it is a finite number."""
    if not is_number(value):
        raise EditError(phrase("{what} {value!r} is not a finite number", what=what, value=value))
    return float(value)


def check_number_list(values: Sequence[float], what: str, length: int) -> tuple[float, ...]:
    """The values as floats. Raises EditError unless they are `length` finite numbers."""
    if isinstance(values, str) or len(values) != length or not all(is_number(value) for value in values):
        raise EditError(
            phrase("{what} {values!r} is not {length} finite numbers", what=what, values=values, length=length)
        )
    return tuple(float(value) for value in values)


def check_vector(values: Sequence[float], what: str) -> Vector:
    """Three floats. Raises EditError unless they are finite numbers."""
    x, y, z = check_number_list(values, what, 3)
    return x, y, z
