"""Poses are found by a process of its own. Modules that stand for pycolmap end it in all the ways there are."""

import os
import signal
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from photo_models import photo_model, write_colmap_binary
from PIL import Image

from instdrive_core.datasets.capture.poses import FoundPoses, find_poses
from instdrive_core.errors import DataError
from instdrive_core.extras import MissingExtraError

NAMES = [f"{number:06d}.png" for number in range(9)]
WORKING = """
import os, shutil, sys, time
from pathlib import Path
from unittest.mock import MagicMock

class Model:
    def __init__(self, photos):
        self.photos = photos
    def num_reg_images(self):
        return self.photos
    def num_points3D(self):
        return 40
    def compute_mean_reprojection_error(self):
        return 0.5
    def write_binary(self, folder):
        for file in Path(os.environ["MODEL"]).iterdir():
            shutil.copy(file, folder)

def incremental_mapping(database, images, work, options, next_image_callback):
    print("libraries print what they like")
    for _ in range(7):
        next_image_callback()
    EXTRA
    return {0: Model(4), 1: Model(9)}

def __getattr__(name):
    return MagicMock()
"""


class Stopped(Exception):
    """The user cancels."""


@pytest.fixture
def folder(tmp_path):
    images = tmp_path / "clip" / "images"
    images.mkdir(parents=True)
    for name in NAMES:
        Image.new("RGB", (32, 24)).save(images / name)
    return tmp_path / "clip"


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Lets a module stand for pycolmap, here and in processes that are started."""

    def install(code):
        place = tmp_path / "packages"
        place.mkdir(exist_ok=True)
        (place / "pycolmap.py").write_text(code)
        monkeypatch.syspath_prepend(str(place))
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(place), *sys.path]))
        write_colmap_binary(tmp_path / "model", photo_model())
        monkeypatch.setenv("MODEL", str(tmp_path / "model" / "sparse" / "0"))

    return install


def find(folder, on_stage=lambda title, done, total: None):
    return find_poses(folder, NAMES, "simple", False, on_stage)


def list_other_files(folder):
    """What is in a clip's folder beside photos."""
    return sorted(
        str(file.relative_to(folder)) for file in folder.rglob("*") if file.suffix != ".png" and file.is_file()
    )


def is_running(process):
    """Whether a process with this number runs; one that nobody waited for counts, too."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_the_model_with_most_photos_arrives_and_progress_is_told(folder, stand_in):
    stand_in(WORKING.replace("EXTRA", ""))
    (folder / ".poses-left").mkdir()  # by a program that was killed
    told = []
    assert find(folder, lambda *news: told.append(news)) == FoundPoses(9, 40, 0.5)
    assert list_other_files(folder) == [f"sparse/0/{name}.bin" for name in ("cameras", "images", "points3D")]
    assert sorted(entry.name for entry in folder.iterdir()) == ["images", "sparse"]
    news = list(dict.fromkeys(told))  # the last ones are told again while nothing happens
    assert news[:3] == [("finding features", done, 9) for done in (0, 8, 9)]
    assert news[3:5] == [("matching photos", done, 36) for done in (0, 36)]
    assert news[5:] == [("placing photos", done, 9) for done in (0, *range(3, 10))]


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(
    ("code", "problem"),
    [
        (
            "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
            "by the signal SIGSEGV, 12 times in a row. Run the same",
        ),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", r"SIGKILL; systems do .* memory .*\(--most\)"),
        (
            "import os; os.write(2, b'OMP: Error 15\\n'); os.abort()",
            "SIGABRT, 12 times in a row: OMP: Error 15. Run .* .python -m venv",
        ),
        ("import os; os._exit(7)", "process that finds poses .* was ended with exit code 7. Run the same command"),
        ("raise ImportError('libgomp.so.1: no such file')", r"cannot be loaded \(libgomp.so.1: no such file\). Run"),
        ("import nowhere_at_all", "pycolmap is installed but cannot be loaded .No module named 'nowhere_at_all'"),
        ("raise RuntimeError('database is\\n locked')", r"pycolmap failed \(RuntimeError: database is locked\)"),
        ("raise MemoryError", "memory ran out while poses were looked for. Close other programs"),
    ],
)
def test_what_ended_the_process_is_told(folder, stand_in, code, problem):
    stand_in(code)
    with pytest.raises(DataError, match=problem):
        find(folder)
    assert list_other_files(folder) == []


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_crash_after_half_a_model_leaves_none(folder, stand_in):
    stand_in(WORKING.replace("EXTRA", "").replace("shutil.copy(file, folder)", "shutil.copy(file, folder); os.abort()"))
    with pytest.raises(DataError, match=r"SIGABRT, .* row: libraries print what they like"):
        find(folder)
    assert sorted(entry.name for entry in folder.iterdir()) == ["images"]


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_process_that_crashed_is_started_again(folder, stand_in, tmp_path):
    crash = f"print('*** Aborted at 1'); marker = Path({str(tmp_path / 'crashed')!r})\n"
    crash += "    if not marker.exists():\n        marker.touch(); os.abort()"
    stand_in(WORKING.replace("EXTRA", crash))
    assert find(folder).photos == 9
    assert (tmp_path / "crashed").exists()
    assert sorted(entry.name for entry in folder.iterdir()) == ["images", "sparse"]


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_pair_of_photos_that_crashes_is_left_out(folder, stand_in):
    crash = """
def match_image_pairs(database, pairing_options, device):
    if "000002.png 000005.png" in Path(pairing_options).read_text():
        os.abort()

def ImportedPairingOptions(match_list_path):
    return match_list_path
"""
    stand_in(WORKING.replace("EXTRA", "") + crash)
    assert find(folder).photos == 9


def test_no_model_of_three_photos_is_told(folder, stand_in):
    stand_in(WORKING.replace("EXTRA", "return {0: Model(2)}"))
    with pytest.raises(DataError, match=r"no poses could be found: .* much overlap"):
        find(folder)
    assert not (folder / "sparse").exists()


def test_a_photo_that_cannot_be_read_is_named(folder, stand_in):
    stand_in(WORKING)
    (folder / "images" / NAMES[3]).write_bytes(b"no photo")
    with pytest.raises(DataError, match=f"{NAMES[3]}: is no readable photo"):
        find(folder)


@pytest.mark.parametrize("where", ["on loading", "while placing"])
def test_cancelling_ends_the_process_at_once(folder, stand_in, tmp_path, where):
    hang = f"import os, time; open({str(tmp_path / 'number')!r}, 'w').write(f'{{os.getpid()}} '); time.sleep(1000)"
    stand_in(hang if where == "on loading" else WORKING.replace("EXTRA", hang))

    def cancel(title, done, total):
        if (tmp_path / "number").is_file() and (tmp_path / "number").read_text().endswith(" "):
            raise Stopped

    with pytest.raises(Stopped):
        find(folder, cancel)
    assert not is_running(int((tmp_path / "number").read_text()))
    assert sorted(entry.name for entry in folder.iterdir()) == ["images"]


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_the_process_ends_with_the_program_that_started_it(folder, stand_in, tmp_path):
    number = tmp_path / "number"
    hang = f"import os, time; open({str(number)!r}, 'w').write(f'{{os.getpid()}} '); time.sleep(1000)"
    stand_in(hang)
    code = "import sys; from pathlib import Path; from instdrive_core.datasets.capture.poses import find_poses; "
    call = f"find_poses(Path(sys.argv[1]), {NAMES}, 'simple', False, lambda *news: None)"
    starter = os.posix_spawn(sys.executable, [sys.executable, "-c", code + call, str(folder)], os.environ)
    while not (number.is_file() and number.read_text().endswith(" ")):
        time.sleep(0.05)
    os.kill(starter, signal.SIGKILL)
    os.waitpid(starter, 0)
    before = time.monotonic()
    while is_running(int(number.read_text())) and time.monotonic() < before + 20:
        time.sleep(0.05)
    assert not is_running(int(number.read_text()))


def test_a_missing_pycolmap_is_named(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    monkeypatch.setattr("instdrive_core.datasets.capture.poses.find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match="pycolmap"):
        find(folder)


def test_a_missing_opencv_is_named_with_the_extra_of_the_command(folder, stand_in, monkeypatch):
    stand_in("")
    monkeypatch.setattr(
        "instdrive_core.datasets.capture.poses.find_spec", lambda name: None if name == "cv2" else find_spec(name)
    )
    with pytest.raises(MissingExtraError, match=r"OpenCV.*instdrive\[capture\]"):
        find(folder)


@pytest.mark.skipif(find_spec("pycolmap") is None, reason="pycolmap is not installed: pip install 'instdrive[capture]'")
def test_pycolmap_finds_poses_of_a_wall_with_steps(tmp_path):
    images = tmp_path / "images"
    images.mkdir()
    rng = np.random.default_rng(0)
    layers = [rng.integers(0, 256, (60, 160, 3)).astype(np.uint8).repeat(8, 0).repeat(8, 1) for _ in range(3)]
    for number, name in enumerate(NAMES):
        parts = [
            layer[160 * row : 160 * (row + 1), 20 * number * (row + 1) :][:, :640] for row, layer in enumerate(layers)
        ]
        Image.fromarray(np.concatenate(parts)).save(images / name)
    found = find(tmp_path)
    assert found.photos >= 5
    assert found.error < 2
    assert (tmp_path / "sparse" / "0" / "cameras.bin").is_file()
    assert not list(Path(tmp_path).glob(".poses-*"))
