"""Pickles are read as data: whatever else they ask for is refused, named, and not run."""

import gzip
import os
import pickle
import pickletools
import re
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.files import restricted_pickle
from instdrive_core.files.restricted_pickle import ALLOWED, read_pickle

pd.options.mode.string_storage = "python"  # pickles are the same whether or not pyarrow is there

COLUMNS = {
    "x": np.array([1.5, -2.0, np.inf]),
    "d": np.array([0, 1, 0]),
    "class": np.array([7, 13, 255], np.uint8),
    "stationary": np.array([True, False, True]),
    "label": np.array(["Car", "Größe", ""], object),
    "motion": np.array([float("nan"), "Moving", 3], object),
}


class Calls:
    """Asks to be rebuilt by calling a function."""

    def __init__(self, function, *args):
        self.call = function, args

    def __reduce__(self):
        return self.call


@pytest.fixture
def marker(tmp_path):
    """A file that only a pickle that runs would create."""
    path = tmp_path / "was-run"
    yield path
    assert not path.exists(), "the pickle was run"


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(gzip.compress(content, 1) if path.suffix == ".gz" else content)
    return path


def same(found: np.ndarray, expected: np.ndarray) -> bool:
    return len(found) == len(expected) and all(
        a == b or (a != a and b != b) for a, b in zip(found, expected, strict=True)
    )


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("name", ["table.pkl", "table.pkl.gz"])
def test_tables_read_as_pandas_wrote_them(tmp_path, protocol, name):
    path = tmp_path / name
    frame = pd.DataFrame(COLUMNS)
    frame.to_pickle(path, protocol=protocol)
    table = read_pickle(path)
    assert list(table) == list(COLUMNS)
    for column, expected in COLUMNS.items():
        assert same(table[column], frame[column].to_numpy()), column
        assert table[column].dtype.kind == expected.dtype.kind


def test_pandas_own_strings_and_filtered_rows_are_read(tmp_path):
    frame = pd.DataFrame(COLUMNS).iloc[::2]
    frame["label"] = frame["label"].astype("str")
    frame.to_pickle(tmp_path / "table.pkl")
    table = read_pickle(tmp_path / "table.pkl")
    assert table["label"].tolist() == ["Car", ""]
    assert table["class"].tolist() == [7, 255]


@pytest.mark.parametrize("order", ["C", "F"])
def test_memory_and_byte_order_are_respected(tmp_path, order):
    values = np.asarray(np.arange(12.0).reshape(3, 4), order=order)
    pd.DataFrame(values.astype(">f4"), columns=list("abcd")).to_pickle(tmp_path / "table.pkl", protocol=4)
    table = read_pickle(tmp_path / "table.pkl")
    assert [table[name].tolist() for name in "abcd"] == values.T.tolist()


def test_real_tables_are_those_that_pandas_reads(pandaset_clip):
    for name in ("annotations/cuboids/30.pkl.gz", "annotations/semseg/30.pkl.gz", "lidar/30.pkl.gz"):
        table, expected = read_pickle(pandaset_clip / name), pd.read_pickle(pandaset_clip / name)
        assert list(table) == list(expected.columns)
        for column in table:
            assert same(table[column], expected[column].to_numpy()), (name, column)


def test_a_shell_command_is_refused_and_named(tmp_path, marker):
    path = write(tmp_path / "30.pkl.gz", pickle.dumps(Calls(os.system, f"touch {marker}")))
    with pytest.raises(UntrustedDataError, match=r"30\.pkl\.gz.*asks for '(posix|nt)\.system'"):
        read_pickle(path)


@pytest.mark.parametrize("function", [eval, exec, getattr, pd.eval, np.load, open, print])
def test_functions_that_run_code_or_read_files_are_refused(tmp_path, marker, function):
    code = f"open({str(marker)!r}, 'w')"
    path = write(tmp_path / "table.pkl", pickle.dumps(Calls(function, code)))
    with pytest.raises(UntrustedDataError, match="asks for"):
        read_pickle(path)


def test_a_command_hidden_in_an_object_column_is_refused(tmp_path, marker):
    column = np.array([Calls(os.system, f"touch {marker}"), 1], object)
    pd.DataFrame({"label": column}).to_pickle(tmp_path / "table.pkl")
    with pytest.raises(UntrustedDataError, match="system"):
        read_pickle(tmp_path / "table.pkl")


@pytest.mark.parametrize("module", ["pandas", "numpy", "builtins"])
def test_attributes_behind_an_allowed_module_are_refused(tmp_path, marker, module):
    command = f"touch {marker}"
    dotted = (
        b"\x80\x04" + pickle_text(module) + pickle_text("io.common.os.system") + b"\x93"  # STACK_GLOBAL
        + pickle_text(command) + b"\x85R."
    )  # fmt: skip
    with pytest.raises(UntrustedDataError, match=r"io\.common\.os\.system"):
        read_pickle(write(tmp_path / "table.pkl", dotted))


@pytest.mark.parametrize("opcode", [b"(S'%s'\nios\nsystem\n.", b"(cos\nsystem\nS'%s'\no."])
def test_old_opcodes_that_call_are_refused(tmp_path, marker, opcode):
    content = opcode % f"touch {marker}".encode()
    with pytest.raises(UntrustedDataError, match=r"os\.system"):
        read_pickle(write(tmp_path / "table.pkl", content))


def test_registered_extensions_and_outside_objects_are_refused(tmp_path):
    with pytest.raises(UntrustedDataError, match="extension 7"):
        read_pickle(write(tmp_path / "table.pkl", b"\x80\x02\x82\x07."))
    with pytest.raises(UntrustedDataError, match="outside object"):
        read_pickle(write(tmp_path / "table.pkl", b"Psomewhere\n."))


@pytest.mark.parametrize(("module", "name"), sorted(ALLOWED))
def test_allowed_names_cannot_be_changed_by_a_file(tmp_path, module, name):
    """BUILD on the class itself, with a state for its attributes, or for its slots."""
    recorded = ALLOWED[module, name]
    before = dict(vars(recorded))
    get = f"c{module}\n{name}\n".encode()
    for state in (b"}S'__setstate__'\nNs", b"N}S'__new__'\nNs\x86"):
        with pytest.raises(DataError):
            read_pickle(write(tmp_path / "table.pkl", b"\x80\x03" + get + state + b"b."))
    assert dict(vars(recorded)) == before


def test_nothing_that_is_allowed_runs_code_of_numpy_or_pandas():
    for record in ALLOWED.values():
        assert record.__module__ == "instdrive_core.files.pickled_table"


@pytest.mark.parametrize("code", ["O8", "V8", "V12", "M8[ns]", "c16", "S4"])
def test_data_types_whose_layout_would_be_trusted_are_refused(tmp_path, code):
    """Above all structured ones, in which a file may declare bytes of its own to be references to objects."""
    content = pickle.dumps(pd.DataFrame({"x": np.zeros(4)}), protocol=3)
    forged = content.replace(b"X\x02\x00\x00\x00f8", b"X" + struct.pack("<I", len(code)) + code.encode())
    assert forged != content
    with pytest.raises(DataError, match=f"has the data type '{re.escape(code)}'"):
        read_pickle(write(tmp_path / "table.pkl", forged))


def test_a_shape_beyond_the_data_is_refused(tmp_path):
    content = pickle.dumps(pd.DataFrame({"x": np.arange(5.0)}), protocol=3)
    forged = content.replace(b"K\x01K\x05\x86", b"K\x01J\xff\xff\xff\x7f\x86")
    assert forged != content
    with pytest.raises(DataError, match="5 values"):
        read_pickle(write(tmp_path / "table.pkl", forged))


def test_announced_lengths_allocate_nothing(tmp_path):
    for content in (
        b"\x80\x05\x96" + struct.pack("<Q", 2**40) + b"x.",  # BYTEARRAY8
        b"\x80\x05\x8e" + struct.pack("<Q", 2**40) + b"x.",  # BINBYTES8
        b"\x80\x05Nr" + struct.pack("<I", 2**32 - 1) + b".",  # LONG_BINPUT
    ):
        with pytest.raises(DataError):
            read_pickle(write(tmp_path / "table.pkl", content))


def test_a_gzip_bomb_is_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(restricted_pickle, "MAX_DECOMPRESSED_BYTES", 2**20)
    path = write(tmp_path / "bomb.pkl.gz", b"]" * 2**22)
    assert path.stat().st_size < 2**16
    with pytest.raises(DataError, match="unpacks to more than 1 MB"):
        read_pickle(path)


@pytest.mark.parametrize("keep", [0, 5, 30, -1])
def test_files_cut_off_are_reported(tmp_path, keep):
    frame = pickle.dumps(pd.DataFrame(COLUMNS))
    packed = gzip.compress(frame)
    (tmp_path / "30.pkl.gz").write_bytes(packed[:keep])
    with pytest.raises(DataError, match=r"30\.pkl\.gz"):
        read_pickle(tmp_path / "30.pkl.gz")
    with pytest.raises(DataError, match=r"30\.pkl: holds no readable table"):
        read_pickle(write(tmp_path / "30.pkl", frame[:keep]))


def test_files_that_are_no_gzip_or_missing_are_reported(tmp_path):
    (tmp_path / "table.pkl.gz").write_bytes(pickle.dumps(1))
    with pytest.raises(DataError, match=r"cannot be unpacked \(Not a gzipped file"):
        read_pickle(tmp_path / "table.pkl.gz")
    with pytest.raises(DataError, match="does not exist"):
        read_pickle(tmp_path / "nothing.pkl")


@pytest.mark.parametrize("content", [1, [1, 2], {"x": 1}, "text", None])
def test_other_objects_are_no_table(tmp_path, content):
    with pytest.raises(DataError, match="expected a DataFrame"):
        read_pickle(write(tmp_path / "table.pkl", pickle.dumps(content)))


def test_damaged_files_are_reported_whatever_the_damage(tmp_path):
    content = bytearray(pickle.dumps(pd.DataFrame(COLUMNS), protocol=4))
    rng = np.random.default_rng(0)
    path, refused = tmp_path / "table.pkl", 0
    for _ in range(400):
        damaged = bytearray(content)
        for position in rng.integers(0, len(content), 3):
            damaged[position] = rng.integers(0, 256)
        try:
            read_pickle(write(path, bytes(damaged)))
        except DataError:
            refused += 1
    assert refused > 100


def pickle_text(text: str) -> bytes:
    """The opcodes that push a text."""
    content = pickle.dumps(text, protocol=4)
    opcodes = [(code.name, position) for code, _, position in pickletools.genops(content)]
    start = next(position for name, position in opcodes if name == "SHORT_BINUNICODE")
    end = next(position for name, position in opcodes if name == "MEMOIZE")
    return content[start:end]
