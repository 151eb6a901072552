"""Checkpoints of torch are read without torch, and nothing in them is run."""

import pickle
import zipfile

import numpy as np
import pytest

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.files.torch_checkpoint import ALLOWED, open_torch_checkpoint
from instdrive_core.formats.checkpoints.sample_files import write_checkpoint


def archive_of(path, pickled, members=(), method=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("a/data.pkl", pickled)
        for name, data in members:
            archive.writestr(name, data)
    return path


def test_what_torch_saves_is_read_without_it(tmp_path):
    torch = pytest.importorskip("torch")
    content = {
        "plain": torch.arange(12.0).reshape(3, 4),
        "parameter": torch.nn.Parameter(torch.arange(3.0)),
        "turned": torch.arange(12.0).reshape(3, 4).t(),
        "part": torch.arange(20, dtype=torch.int64)[5:9],
        "half": torch.tensor([1.5, -2.0], dtype=torch.float16),
        "bfloat": torch.tensor([1.5, -2.0], dtype=torch.bfloat16),
        "flags": torch.tensor([True, False]),
        "scalar": torch.tensor(3.0),
        "none": torch.zeros(0, 3),
    }
    optimizer = torch.optim.Adam([content["parameter"]])
    content["parameter"].sum().backward()
    optimizer.step()
    torch.save((content, 7, optimizer.state_dict(), torch.nn.Linear(2, 2).state_dict()), tmp_path / "a.pth")
    file = open_torch_checkpoint(tmp_path / "a.pth")
    items, number, state, linear = file.content
    assert number == 7
    assert state["param_groups"][0]["lr"] == 0.001
    assert set(file.find_items(linear)) == {"weight", "bias"}
    for name, tensor in content.items():
        found = file.find_tensor(items[name]).read()
        expected = tensor.detach().float() if tensor.dtype in (torch.float16, torch.bfloat16) else tensor.detach()
        assert found.dtype == expected.numpy().dtype, name
        np.testing.assert_array_equal(found, expected.numpy(), err_msg=name)
    np.testing.assert_array_equal(file.find_tensor(items["turned"]).read(1, 3), content["turned"][1:3].numpy())


def test_files_of_these_tests_are_torchs(tmp_path):
    torch = pytest.importorskip("torch")
    values = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "b": np.array([True, False])}
    write_checkpoint(tmp_path / "a.pth", values)
    found = torch.load(tmp_path / "a.pth", map_location="cpu", weights_only=True)
    assert {name: tensor.numpy().tolist() for name, tensor in found.items()} == {
        k: v.tolist() for k, v in values.items()
    }


def test_storages_stay_in_the_file_until_asked_for(tmp_path):
    path = write_checkpoint(tmp_path / "a.pth", {"a": np.arange(6, dtype=np.float32)})
    data = bytearray(path.read_bytes())
    place = data.find(np.float32(3).tobytes())
    data[place] ^= 1
    path.write_bytes(data)
    file = open_torch_checkpoint(path)
    with pytest.raises(DataError, match=r"a\.pth: the numbers of '0' do not have their checksum"):
        file.find_tensor(file.content["a"]).read()


class Calls:
    def __reduce__(self):
        return print, ("never",)


def test_names_that_are_not_listed_are_refused(tmp_path, capsys):
    path = archive_of(tmp_path / "a.pth", pickle.dumps({"a": Calls()}, 2))
    with pytest.raises(UntrustedDataError, match=r"asks for '__builtin__\.print', .*nothing of it was run.*state_dict"):
        open_torch_checkpoint(path)
    assert capsys.readouterr().out == ""


def test_no_listed_name_stands_for_something_that_acts():
    assert all(record.__module__.startswith("instdrive_core.files.") for record in ALLOWED.values())
    assert not any(module in ("os", "posix", "subprocess") for module, _ in ALLOWED)


def promise(count, path, *, offset=0, shape=(2,), stride=(1,), kind="FloatStorage"):
    """A pickle of one tensor whose storage of 8 bytes is promised to hold `count` numbers."""
    storage = f"(X\x07\x00\x00\x00storagectorch\n{kind}\n".encode() + b"X\x01\x00\x00\x000X\x03\x00\x00\x00cpu"
    storage += b"\x8a" + bytes([8]) + count.to_bytes(8, "little", signed=True) + b"tQ"
    unpacked = b"".join(pickle.dumps(value, 2)[2:-1] for value in (offset, shape, stride))
    code = b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n(" + storage + unpacked + b"\x89}tR."
    return archive_of(path, code, [("a/data/0", bytes(8))])


def test_lying_sizes_are_refused(tmp_path):
    assert open_torch_checkpoint(promise(2, tmp_path / "good.pth")).content is not None
    for count in (3, -1, 1 << 60):
        with pytest.raises(DataError, match=r"the numbers '0' take 8 bytes"):
            open_torch_checkpoint(promise(count, tmp_path / "a.pth"))
    for lie in (
        {"shape": (3,)},
        {"offset": 1},
        {"stride": (2,)},
        {"shape": (10**9,), "stride": (0,)},
        {"stride": (1, 1)},
    ):
        file = open_torch_checkpoint(promise(2, tmp_path / "b.pth", **lie))
        with pytest.raises(DataError, match=r"b\.pth: a tensor of "):
            file.find_tensor(file.content)


def test_other_formats_are_named(tmp_path):
    old = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03."
    cases = {
        old: r"format of torch before 1\.6, which is no zip archive\. If you trust it, load it with torch",
        pickle.dumps([1], 2): r"it is a pickle, not what torch\.save writes",
        b"hello": "no zip archive",
        b"": "no zip archive",
    }
    for content, message in cases.items():
        path = tmp_path / "old.pth"
        path.write_bytes(content)
        with pytest.raises(DataError, match=rf"old\.pth: .*{message}"):
            open_torch_checkpoint(path)


def test_the_old_format_of_torch_itself_is_named(tmp_path):
    torch = pytest.importorskip("torch")
    torch.save({"a": torch.zeros(3)}, tmp_path / "a.pth", _use_new_zipfile_serialization=False)
    with pytest.raises(DataError, match=r"before 1\.6"):
        open_torch_checkpoint(tmp_path / "a.pth")


def test_archives_that_torch_does_not_write_are_refused(tmp_path):
    empty = pickle.dumps({}, 2)
    packed = archive_of(tmp_path / "a.pth", empty, method=zipfile.ZIP_DEFLATED)
    with pytest.raises(DataError, match="compressed, which torch never does"):
        open_torch_checkpoint(packed)
    with pytest.raises(DataError, match=r"holds 2 files called data\.pkl"):
        open_torch_checkpoint(archive_of(tmp_path / "b.pth", empty, [("b/data.pkl", empty)]))
    with pytest.raises(DataError, match="TorchScript"):
        open_torch_checkpoint(archive_of(tmp_path / "c.pth", empty, [("a/code/x.py", b"")]))
    with pytest.warns(UserWarning, match="Duplicate"):
        archive_of(tmp_path / "d.pth", empty, [("a/x", b"1"), ("a/x", b"2")])
    with pytest.raises(UntrustedDataError, match="twice"):
        open_torch_checkpoint(tmp_path / "d.pth")


def test_missing_numbers_are_named(tmp_path):
    path = promise(2, tmp_path / "a.pth")
    with zipfile.ZipFile(path) as archive:
        code = archive.read("a/data.pkl")
    with pytest.raises(DataError, match="the numbers '0' of a tensor are missing"):
        open_torch_checkpoint(archive_of(tmp_path / "b.pth", code))
