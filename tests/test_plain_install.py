"""`pip install instdrive` without extras: the editor's packages only, in an environment of its own.

The environment's packages are links to those of the running one, so that nothing is downloaded.
"""

import os
import subprocess
import tomllib
import venv
from importlib.metadata import distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from small_clip import write_small_clip
from wheel_of_checkout import PIP, ROOT, build_wheel, copy_sources, run

from instdrive_core.extras import EXTRAS, explain_missing_module

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
IMPORT_NAMES = {
    "opencv-python-headless": "cv2",
    "scikit-image": "skimage",
    "usd-core": "pxr",
    "grpcio": "grpc",
    "protobuf": "google",
}
"""Import names that differ from the distribution's."""
SAMPLE = ROOT / "assets" / "sample_scene"
EDIT_AND_EXPORT = """
import sys
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import open_scene, save_scene

document = Document(open_scene(sys.argv[1]))
document.apply(DeleteInstances([next(iter(document.scene.table)).id]))
save_scene(sys.argv[2], bake_document(document, time=0.0))
print(len(document.scene.gaussians), len(open_scene(sys.argv[2]).gaussians))
"""


def required_distributions(requirements):
    """Names of distributions that these requirements need, those of their requirements included, without extras."""
    found, waiting = set(), [Requirement(text) for text in requirements]
    while waiting:
        requirement = waiting.pop()
        environments = [{"extra": extra} for extra in ("", *requirement.extras)]
        if requirement.marker and not any(requirement.marker.evaluate(each) for each in environments):
            continue
        name = requirement.name.lower().replace("_", "-")
        if name not in found:
            found.add(name)
            needed = (Requirement(text) for text in distribution(name).requires or ())
            waiting += [
                each
                for each in needed
                if not each.marker or any(each.marker.evaluate({"extra": extra}) for extra in ("", *requirement.extras))
            ]
    return found


def link_distribution(name, environment):
    """Link what a distribution has installed into another environment at the same places."""
    installed = distribution(name)
    packages = Path(installed.locate_file("")).resolve()
    target = next((environment / "lib").glob("python*")) / "site-packages"
    for file in installed.files or ():
        top = Path(*file.parts[: file.parts.count("..") + (2 if ".." in file.parts else 1)])
        source, link = packages / top, Path(os.path.normpath(target / top))
        if source.exists() and not link.exists() and link.parent.is_dir() and link.parent.name != "bin":
            link.symlink_to(source)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """An environment with the wheel and what it requires, without extras."""
    environment, sources = tmp_path_factory.mktemp("plain"), copy_sources(tmp_path_factory.mktemp("source"))
    wheel = build_wheel(sources, tmp_path_factory.mktemp("wheel"))
    venv.create(environment, with_pip=False, symlinks=True)
    for name in required_distributions(PROJECT["dependencies"]):
        link_distribution(name, environment)
    python = environment / "bin" / "python"
    run(*PIP, "--python", str(python), "install", "--no-deps", "--no-index", str(wheel), cwd=environment)
    return environment


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return write_small_clip(tmp_path_factory.mktemp("clip"))


def finish(environment, *command):
    """Run a command of the environment, and nothing of the running one's."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return subprocess.run(
        [str(environment / "bin" / command[0]), *map(str, command[1:])],
        cwd=environment,
        env=variables,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def test_extras_are_those_of_the_project():
    declared = {
        IMPORT_NAMES.get(requirement.name, requirement.name): extra
        for extra in (
            "capture",
            "fleet",
            "train",
            "cuda",
            "sam",
            "datasets",
            "usd",
            "clouds",
            "video",
            "mcap",
            "exr",
            "openscenario",
            "serve",
        )  # the later of two is named
        for requirement in map(Requirement, PROJECT["optional-dependencies"][extra])
        if requirement.name != "instdrive"
    }
    assert declared == EXTRAS


def test_a_module_of_no_extra_is_explained_by_none():
    assert explain_missing_module(ModuleNotFoundError("No module named 'nothing'", name="nothing")) is None
    error = explain_missing_module(ModuleNotFoundError("No module named 'torch.nn'", name="torch.nn"))
    assert "pip install 'instdrive[train]'" in str(error)


def test_no_package_of_an_extra_is_there(plain):
    code = f"from importlib.util import find_spec; print([name for name in {sorted(EXTRAS)} if find_spec(name)])"
    assert finish(plain, "python", "-c", code).stdout == "[]\n"


def test_the_command_edits_and_exports_the_sample_scene(plain, tmp_path):
    result = finish(plain, "instdrive", "apply", SAMPLE, "--delete", "1", "-o", tmp_path / "edited.ply")
    assert result.returncode == 0, result.stderr
    info = finish(plain, "instdrive", "info", tmp_path / "edited.ply")
    assert info.returncode == 0, info.stderr


def test_python_edits_and_exports_the_sample_scene(plain, tmp_path):
    result = finish(plain, "python", "-c", EDIT_AND_EXPORT, SAMPLE, tmp_path / "edited.ply")
    assert result.returncode == 0, result.stderr
    before, after = map(int, result.stdout.split())
    assert 0 < after < before


def test_the_editor_loads_without_extras(plain):
    result = finish(plain, "python", "-c", "import instdrive_app.shell.window, instdrive_app.session.editor_session")
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("module", ["evaluation.page.report", "evaluation.comparison", "datasets.registry"])
def test_runs_are_measured_without_extras(plain, module):
    result = finish(plain, "python", "-c", f"import instdrive_core.{module}")
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (["synth", "new"], "train"),
        (["demo", "--out", "demo"], "train"),
        (["train", "CLIP", "-o", "run"], "train"),
        (["fleet", "CLIP", "-o", "runs"], "fleet"),
        (["serve", "CLIP"], "serve"),
        (["masks", "CLIP", "--source", "lidar"], "train"),
        (["masks", "CLIP", "--source", "import", "--from", "CLIP"], "train"),
        (["masks", "CLIP", "--source", "sam"], "sam"),
    ],
)
def test_a_command_that_lacks_its_extra_says_which_to_install(plain, clip, arguments, extra):
    result = finish(plain, "instdrive", *(str(clip) if argument == "CLIP" else argument for argument in arguments))
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    complaint = result.stderr.splitlines()[-1]
    assert complaint.startswith(f"instdrive {arguments[0]}: ")
    assert complaint.endswith(f"Run: pip install 'instdrive[{extra}]'")
