"""Hostile pickles of many kinds. Each would write `MARKER` into the working folder, take memory or never end."""

from __future__ import annotations

import pickle
import struct
from collections.abc import Callable

MARKER = "was-run"
"""The file that a pickle makes if it is run."""
_COMMAND = f"touch {MARKER}"
_LARGE = 1 << 40


class _Calls:
    """Asks to be rebuilt by calling a function."""

    def __init__(self, function: Callable[..., object], *arguments: object) -> None:
        self._call = function, arguments

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return self._call


def _text(value: str) -> bytes:
    data = value.encode()
    return b"X" + struct.pack("<I", len(data)) + data


def _global(module: str, name: str) -> bytes:
    return f"c{module}\n{name}\n".encode()


def hostile_pickles() -> dict[str, bytes]:
    """By what they try."""
    call = _text(_COMMAND) + b"\x85R."
    shell, array = _global("os", "system"), _global("numpy.core.multiarray", "_reconstruct")
    frame = _global("pandas.core.frame", "DataFrame")
    code = f"open({MARKER!r}, 'w')"
    return {
        "GLOBAL and REDUCE": b"\x80\x02" + shell + call,
        "STACK_GLOBAL": b"\x80\x04" + _text("os") + _text("system") + b"\x93" + call,
        "dotted name": b"\x80\x04" + _text("pandas") + _text("io.common.os.system") + b"\x93" + call,
        "INST": f"(S'{_COMMAND}'\nios\nsystem\n.".encode(),
        "OBJ": f"(cos\nsystem\nS'{_COMMAND}'\no.".encode(),
        "NEWOBJ": b"\x80\x02" + _global("subprocess", "Popen") + b"(" + _text(_COMMAND) + b"t\x81.",
        "NEWOBJ_EX": b"\x80\x04" + _text("subprocess") + _text("Popen") + b"\x93(" + _text(_COMMAND) + b"t}\x92.",
        "eval": pickle.dumps(_Calls(eval, code)),
        "exec": pickle.dumps(_Calls(exec, code)),
        "getattr": b"\x80\x03" + _global("builtins", "getattr") + _global("os", "x") + _text("system") + b"\x86R.",
        "code in a column": b"\x80\x03" + frame + b")\x81}" + _text("_mgr") + shell + call[:-1] + b"sb.",
        "BUILD of a class": b"\x80\x03" + array + b"}" + _text("__setstate__") + shell + b"sb.",
        "BUILD of slots": b"\x80\x03" + frame + b"N}" + _text("__new__") + shell + b"s\x86b.",
        "BUILD of a record": b"\x80\x03" + frame + b")\x81}" + _text("args") + b"Nsb.",
        "EXT1": b"\x80\x02\x82\x07.",
        "EXT4": b"\x80\x02\x84\xff\xff\xff\x7f.",
        "PERSID": b"Psomewhere\n.",
        "BINPERSID": b"\x80\x02" + _text("somewhere") + b"Q.",
        "deep tuples": b"\x80\x02N" + b"\x85" * 200_000 + b".",
        "deep lists": b"\x80\x02" + b"]" * 100_000 + b"a" * 99_999 + b".",
        "a list in itself": b"\x80\x02" + frame + b")\x81]q\x00h\x00ab.",
        "doubled lists": b"\x80\x02](" + b"".join(b"(h\x00h\x00le" for _ in range(2)) + b".",
        "doubled tuples": b"\x80\x02N" + b"".join(b"2\x86" for _ in range(60)) + b".",
        "doubled tuples in an array": b"\x80\x02" + array + b")R(K\x01K\x02\x85NI00\n]N" + b"2\x86" * 40 + b"atb.",
        "memo index": b"\x80\x02Nr\xff\xff\xff\x7f.",
        "memo of text": b"Np4294967296\n.",
        "LONG4": b"\x80\x02\x8b" + struct.pack("<i", 2**31 - 1) + b"\x01.",
        "LONG4, negative": b"\x80\x02\x8b\xff\xff\xff\xff.",
        "LONG of text": b"L" + b"9" * 400_000 + b"L\n.",
        "INT of text": b"I" + b"9" * 400_000 + b"\n.",
        "BINBYTES8": b"\x80\x04\x8e" + struct.pack("<Q", _LARGE) + b"x.",
        "BINUNICODE8": b"\x80\x04\x8d" + struct.pack("<Q", _LARGE) + b"x.",
        "BYTEARRAY8": b"\x80\x05\x96" + struct.pack("<Q", _LARGE) + b"x.",
        "BINBYTES": b"\x80\x03B\xff\xff\xff\x7fx.",
        "BINSTRING": b"\x80\x02T\xff\xff\xff\x7fx.",
        "FRAME": b"\x80\x04\x95" + struct.pack("<Q", _LARGE) + b"N.",
        "NEXT_BUFFER": b"\x80\x05\x97.",
        "READONLY_BUFFER": b"\x80\x05N\x98.",
        "large range": b"\x80\x02" + _global("builtins", "range") + b"J\xff\xff\xff\x7f\x85R.",
        "large bytes": b"\x80\x02" + _global("builtins", "bytes") + b"J\xff\xff\xff\x7f\x85R.",
        "large array": b"\x80\x02" + array + _global("numpy", "ndarray") + b"J\xff\xff\xff\x7f\x85C\x01b\x87R.",
        "array of lying shape": b"\x80\x03" + array + b")R(K\x01J\xff\xff\xff\x7f\x85NI00\nC\x01xtb.",
        "endless marks": b"\x80\x02" + b"(" * 100_000 + b".",
        "no STOP": b"\x80\x02" + frame,
        "empty": b"",
        "text": b"this is no pickle",
        "number": pickle.dumps(7),
        "dictionary": pickle.dumps({"x": [1, 2]}),
        "protocol 99": b"\x80\x63N.",
    }
