"""Every code block of README and docs runs: Python blocks whole, commands for real where that is quick, else as far as
their arguments are understood."""

import functools
import importlib
import inspect
import os
import re
import shlex
import shutil
from pathlib import Path

import pytest
import tyro

from instdrive_app.main import COMMANDS, main
from instdrive_core.project.save import capture_project_state

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "examples" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
RUN_FOR_REAL = {"apply", "convert", "info", "objects", "render"}
"""Others train, measure, open a window or need weights: seconds to minutes, and tested elsewhere."""
NOT_OURS = {"make", "npm", "pip", "hf", "python", "git", "sudo", "."}
"""Programs whose lines are not run here."""
LANGUAGES = {"python", "sh", "text", "mermaid", "json", "toml", "yaml"}


def code_blocks(page):
    """Pairs (language, text) of a page's fenced code."""
    return re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def command_lines(text):
    """The lines of a shell block without comments, continued lines joined."""
    lines = text.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(re.sub(r"(^|\s)#.*", "", line).replace("…", "")))]


WITH_PYTHON = [page for page in PAGES if any(language == "python" for language, _ in code_blocks(page))]
COMMAND_LINES = [
    pytest.param(words, id=f"{page.stem}: {' '.join(words)}")
    for page in PAGES
    for language, text in code_blocks(page)
    if language == "sh"
    for words in command_lines(text)
]


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """A folder with the sample scene under the names that the docs use; tests work on copies of it."""
    folder = tmp_path_factory.mktemp("docs")
    for name in ("SCENE", "RUN", "runs/002"):
        shutil.copytree(ROOT / "assets" / "sample_scene", folder / name)
    assert main(["convert", str(folder / "SCENE"), str(folder / "street.ply")]) == 0
    shutil.copy(folder / "street.ply", folder / "IN.ply")
    return folder


@pytest.fixture
def here(sample, tmp_path, monkeypatch):
    shutil.copytree(sample, tmp_path / "work")
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path / "work"


def test_blocks_say_their_language():
    unknown = {
        (page.name, language) for page in PAGES for language, _ in code_blocks(page) if language not in LANGUAGES
    }
    assert not unknown


@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: page.stem)
def test_python_blocks_of_a_page_run_one_after_another(page, here):
    names = {"capture_project_state": capture_project_state}
    for language, text in code_blocks(page):
        if language == "python":
            if "state)" in text and "state" not in names:
                names["state"] = capture_project_state(names["document"], {})
            exec(compile(text, str(page), "exec"), names)


def understood(name, arguments):
    """Parse a command's arguments with the command itself left out; raises SystemExit where they are not understood."""
    module, _, function = COMMANDS[name].target.partition(":")
    command = getattr(importlib.import_module(module), function)

    @functools.wraps(command)
    def nothing(*_args, **_kwargs):
        return None

    nothing.__signature__ = inspect.signature(command, eval_str=True)
    tyro.cli(nothing, args=arguments)


@pytest.mark.parametrize("words", COMMAND_LINES)
def test_commands_run_or_are_understood(words, here):
    program, *arguments = words
    if program != "instdrive":
        assert program in NOT_OURS
        return
    name, *arguments = [word for word in arguments if word not in ("[-o", "FOLDER]", "[--sheet")]
    arguments = ["exact" if word == "SOURCE" else word for word in arguments]
    if name in RUN_FOR_REAL:
        if "street.instdrive" in arguments and "-o" not in arguments[:2] and arguments[0] == "street.instdrive":
            assert main(["apply", "street.ply", "--delete", "17", "-o", "street.instdrive"]) == 0
        assert main([name, *arguments]) == 0
    else:
        understood(name, arguments)


def named_files(page):
    """Paths of source files that a page names in backticks."""
    return set(re.findall(r"`((?:[\w.]+/)*\w+\.(?:py|vert|frag|toml))`", page.read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def files():
    """Paths of all files of the checkout, each with a slash before it."""
    found = []
    for folder, folders, names in os.walk(ROOT):
        folders[:] = [name for name in folders if name != ".venv"]  # forty thousand files
        found += [f"/{(Path(folder) / name).relative_to(ROOT).as_posix()}" for name in names]
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_that_a_page_names_exist(page, files):
    missing = {name for name in named_files(page) if not any(path.endswith("/" + name) for path in files)}
    assert not missing - {"NAME.py", "instdrive_core/datasets/NAME.py"}
