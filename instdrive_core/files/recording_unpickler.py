"""Builds records out of pickles without running anything they ask for.

A pickle is a program that may call whatever it can name. Here each name on an allow list stands for a record that only
remembers its arguments; every other name is refused, and so are sets and compound keys, because hashing nested tuples
has no limit of depth or time.
"""

from __future__ import annotations

import io
import pickle
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

from instdrive_core.errors import UntrustedDataError
from instdrive_core.files.pickled_table import Recorded

TRUST_REMEDY = "Get the file again from a source you trust"


def _check_keys(keys: list[Any]) -> None:
    """Refuse compound keys: C code hashes tuples in tuples without a limit of depth (the process dies) or time."""
    for key in keys:
        if key is not None and type(key) not in (str, bytes, int, float, bool):
            raise pickle.UnpicklingError(f"a {type(key).__name__} stands as a key")


_PLAIN: dict[int, Callable[[Any], None]] = dict(pickle._Unpickler.dispatch)  # pyright: ignore[reportPrivateUsage]
"""Actions of the opcodes in any pickle."""


class RecordingUnpickler(pickle._Unpickler):  # pyright: ignore[reportPrivateUsage]
    """Gives records instead of functions and classes.

    The Python implementation on purpose: in the C one, a forged memo index allocates memory without a limit.
    """

    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = dict(_PLAIN)
    read: Callable[[int], bytes]
    append: Callable[[Any], None]
    stack: list[Any]

    def __init__(
        self, path: Path, content: bytes, allowed: Mapping[tuple[str, str], type[Recorded]], noun: str, remedy: str
    ) -> None:
        """Prepare for reading.

        Args:
            path: the file, for messages.
            content: the pickle.
            allowed: exact (module, name) pairs that it may ask for, and the record that stands for each.
            noun: what such a file holds, for messages, e.g. ``table``.
            remedy: what to do where it asks for another name.
        """
        super().__init__(io.BytesIO(content))
        self._path, self._size = path, len(content)
        self._allowed, self._noun, self._remedy = allowed, noun, remedy

    def load_bytearray8(self) -> None:
        """Load bytes, after the length that the file claims is checked: the base class allocates it blindly."""
        (length,) = struct.unpack("<Q", self.read(8))
        if length > self._size:
            raise pickle.UnpicklingError(f"{length} bytes are announced in a file of {self._size}")
        self.append(bytearray(self.read(length)))

    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8

    def load_setitem(self) -> None:
        """Set an item after its keys are checked (`_check_keys`)."""
        _check_keys(self.stack[-2:-1])
        _PLAIN[pickle.SETITEM[0]](self)

    dispatch[pickle.SETITEM[0]] = load_setitem

    def load_setitems(self) -> None:
        """Set items after their keys are checked (`_check_keys`)."""
        _check_keys(self.stack[::2])
        _PLAIN[pickle.SETITEMS[0]](self)

    dispatch[pickle.SETITEMS[0]] = load_setitems

    def load_dict(self) -> None:
        """Build a dict after its keys are checked (`_check_keys`)."""
        _check_keys(self.stack[::2])
        _PLAIN[pickle.DICT[0]](self)

    dispatch[pickle.DICT[0]] = load_dict

    def load_set(self) -> None:
        """Refuse sets: every element would be hashed."""
        raise pickle.UnpicklingError("it holds a set")

    dispatch[pickle.EMPTY_SET[0]] = dispatch[pickle.FROZENSET[0]] = dispatch[pickle.ADDITEMS[0]] = load_set

    def find_class(self, module: str, name: str) -> type[Recorded]:
        recorded = self._allowed.get((module, name))
        if recorded is None:
            problem = f"asks for '{module[:200]}.{name[:200]}', which no {self._noun} needs; nothing of it was run"
            raise UntrustedDataError(self._path, problem, self._remedy)
        return recorded

    def get_extension(self, code: int) -> Any:
        raise UntrustedDataError(self._path, f"asks for the registered extension {code}; nothing was run", TRUST_REMEDY)

    def persistent_load(self, pid: Any) -> Any:
        raise UntrustedDataError(self._path, f"asks for the outside object {pid!r}; nothing was run", TRUST_REMEDY)
