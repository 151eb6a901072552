"""Inert records of what a pickled DataFrame asks for, and the columns that they amount to.

The layouts are those of pandas' ``DataFrame.__setstate__``, ``BlockManager.__reduce__`` (1.3 and later) and
``BlockManager.__setstate__`` (before), and numpy's ``ndarray.__setstate__`` and ``dtype.__setstate__``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy import ndarray


class Recorded:
    """Remembers with which arguments and which state a pickle wanted to build an object; builds nothing.

    Subclasses add nothing but their name. All of them define `__setstate__`, so that a pickle cannot set attributes
    of the classes themselves: BUILD on a class fails for lack of an argument.
    """

    __slots__ = ("args", "state")

    args: tuple[Any, ...]
    state: Any

    def __new__(cls, *args: Any) -> Recorded:
        record = object.__new__(cls)
        record.args, record.state = args, None
        return record

    def __setstate__(self, state: Any) -> None:
        self.state = state


class Name(Recorded):
    """A class that is only mentioned, as an argument of something else."""


class Slice(Recorded):
    """``slice(start, stop, step)``."""


class EncodedText(Recorded):
    """``_codecs.encode(text, 'latin1')``: how protocols below 3 write bytes."""


class DataType(Recorded):
    """``numpy.dtype(code, align, copy)`` with state (version, byte order, …)."""


class ArrayShell(Recorded):
    """numpy's ``_reconstruct`` with state (version, shape, dtype, is_fortran, bytes or list)."""


class ArrayFromBytes(Recorded):
    """numpy's ``_frombuffer(bytes, dtype, shape, order)`` of protocol 5."""


class Scalar(Recorded):
    """numpy's ``scalar(dtype, bytes)``."""


class ExtensionArray(Recorded):
    """pandas' array around a numpy array, with state (dtype, array, …)."""


class Index(Recorded):
    """pandas' ``_new_Index(class, {'data': …, 'name': …})``."""


class Block(Recorded):
    """pandas' ``_unpickle_block(values (columns, rows), placement, ndim)``."""


class BlockManager(Recorded):
    """pandas' block manager: arguments (blocks, axes), or the state of old versions."""


class DataFrame(Recorded):
    """The table."""


def extract_columns(frame: Any) -> dict[str, ndarray]:
    """Extract the columns (n,) of a recorded DataFrame by name. Raises ValueError and its like for a bad record."""
    if not isinstance(frame, DataFrame):
        raise ValueError(f"expected a DataFrame, found {type(frame).__name__}")
    state = _expect(frame.state, dict)
    manager = _expect(state.get("_mgr", state.get("_data")), BlockManager)
    axes, blocks = _read_axes_and_blocks(manager)
    names = [_expect(name, str) for name in _read_index(axes[0])]
    columns: dict[int, ndarray] = {}
    for values, placement in blocks:
        rows = values[None] if values.ndim == 1 else values
        positions = _read_positions(placement, len(names))
        if rows.ndim != 2 or len(rows) != len(positions):
            raise ValueError(f"a block of shape {values.shape} stands for {len(positions)} columns")
        columns.update(zip(positions, rows, strict=True))
    if sorted(columns) != list(range(len(names))) or len(set(names)) != len(names):
        raise ValueError(f"blocks fill {len(columns)} of {len(names)} columns")
    if len({len(column) for column in columns.values()}) > 1:
        raise ValueError("columns differ in length")
    return {name: np.ascontiguousarray(columns[position]) for position, name in enumerate(names)}


def _read_axes_and_blocks(manager: BlockManager) -> tuple[list[Any], Iterator[tuple[ndarray, Any]]]:
    if manager.args:
        blocks, axes = manager.args[:2]
        pairs = (_expect(block, Block).args[:2] for block in blocks)
    else:
        modern = _expect(_expect(manager.state, tuple)[3], dict)["0.14.1"]
        axes = modern["axes"]
        pairs = ((block["values"], block["mgr_locs"]) for block in modern["blocks"])
    return axes, ((_read_array(values), placement) for values, placement in pairs)


def _read_index(index: Any) -> list[Any]:
    return _read_array(_expect(index, Index).args[1]["data"]).tolist()


def _read_positions(placement: Any, count: int) -> list[int]:
    if isinstance(placement, Slice):
        return list(range(count)[slice(*placement.args)])
    return _read_array(placement).tolist()


def _read_array(recorded: Any) -> ndarray:
    """The numpy array that a record stands for; a writable copy."""
    if isinstance(recorded, ExtensionArray):
        return _read_array(recorded.state[1])
    if isinstance(recorded, ArrayFromBytes):
        content, dtype, shape, order = recorded.args
        return _read_numeric(content, dtype, shape, order)
    if not isinstance(recorded, ArrayShell):
        raise ValueError(f"expected an array, found {type(recorded).__name__}")
    _, shape, dtype, is_fortran, content = recorded.state
    order = "F" if is_fortran else "C"
    if isinstance(content, list):
        return _read_objects(content, shape, order)
    return _read_numeric(content, dtype, shape, order)


def _read_numeric(content: Any, dtype: Any, shape: Any, order: str) -> ndarray:
    flat = np.frombuffer(_read_bytes(content), _read_numeric_dtype(dtype))
    native = flat.astype(flat.dtype.newbyteorder("="))
    return native.reshape(_read_shape(shape, len(native)), order=_expect_order(order))


def _read_objects(content: list[Any], shape: Any, order: str) -> ndarray:
    flat = np.empty(len(content), object)
    for position, item in enumerate(content):
        flat[position] = _read_entry(item)
    return flat.reshape(_read_shape(shape, len(flat)), order=_expect_order(order))


def _read_entry(item: Any) -> Any:
    """An entry of an object column: None, bool, int, float or str."""
    if isinstance(item, Scalar):
        dtype, content = item.args
        return np.frombuffer(_read_bytes(content), _read_numeric_dtype(dtype)).item()
    if item is None or isinstance(item, bool | int | float | str):
        return item
    raise ValueError(f"an entry is a {type(item).__name__}, expected text or a number")


def _read_bytes(content: Any) -> bytes:
    if isinstance(content, EncodedText):
        text, encoding = content.args
        if encoding not in ("latin1", "latin-1"):
            raise ValueError(f"bytes are encoded as {encoding!r}, expected latin1")
        return _expect(text, str).encode("latin-1")
    return bytes(_expect(content, bytes | bytearray))


def _read_numeric_dtype(recorded: Any) -> np.dtype:
    """bool, int, uint or float of any byte order. Others, above all structured ones, are refused: numpy would trust
    the layout that the file claims."""
    code = _expect(_expect(recorded, DataType).args[0], str)
    if not re.fullmatch(r"b1|[iu][1248]|f[248]", code):
        raise ValueError(f"a column has the data type {code!r}, expected bool, int or float")
    byte_order = recorded.state[1] if recorded.state is not None else "="
    if byte_order not in ("<", ">", "|", "="):
        raise ValueError(f"a column has the byte order {byte_order!r}")
    return np.dtype(byte_order + code)


def _read_shape(shape: Any, count: int) -> tuple[int, ...]:
    sizes = tuple(_expect(size, int) for size in _expect(shape, tuple))
    if any(size < 0 for size in sizes) or math.prod(sizes) != count:
        raise ValueError(f"an array of shape {sizes} comes with {count} values")
    return sizes


def _expect_order(order: Any) -> Any:
    if order not in ("C", "F"):
        raise ValueError(f"an array has the memory order {order!r}")
    return order


def _expect(value: Any, kind: Any) -> Any:
    if not isinstance(value, kind):
        raise ValueError(f"expected {kind}, found {type(value).__name__}")
    return value
