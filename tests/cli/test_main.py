"""The dispatcher: its table matches the commands, help is quick, errors are short."""

import ast
import os
import resource
import subprocess
import sys
import types
from importlib.metadata import version
from pathlib import Path

import pytest
from random_scene import random_scene

from instdrive_app import main as dispatcher
from instdrive_app.main import COMMANDS, CliCommand, main
from instdrive_core.errors import OptionError
from instdrive_core.formats.registry import save_scene

ROOT = Path(__file__).resolve().parents[2]


def source_of(target):
    """The function a command names, found without importing it."""
    module, name = target.split(":")
    path = ROOT / (module.replace("instdrive_app", "app", 1).replace(".", "/") + ".py")
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return next(node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_table_repeats_the_commands_docstrings(name):
    docstring = ast.get_docstring(source_of(COMMANDS[name].target))
    assert docstring is not None
    assert docstring.splitlines()[0] == COMMANDS[name].help


def test_help_lists_every_command(capsys):
    for arguments in ([], ["--help"], ["-h"]):
        assert main(arguments) == 0
        text = capsys.readouterr().out
        assert all(f"  {name} " in text and command.help in text for name, command in COMMANDS.items())


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"instdrive {version('instdrive')}\n"


def test_help_and_version_cost_little_more_than_starting_python():
    """Importing numpy alone would cost seven times as much as starting; tests/test_imports.py names what is not."""
    start = cpu_seconds("-c", "pass")
    for option in ("--help", "--version"):
        assert cpu_seconds("-m", "instdrive_app.main", option) < 5 * start


def cpu_seconds(*arguments):
    """The least of some tries: what others do on the machine counts for little."""
    tries = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        tries.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(tries)


def test_unknown_commands_are_named(capsys):
    assert main(["trian"]) == 2
    message = capsys.readouterr().err
    assert "'trian'" in message
    assert "train" in message


def raising(error):
    def command(word: str = "x") -> None:
        """Fail.

        Args:
            word: Anything.
        """
        raise error

    return command


@pytest.fixture
def fake(monkeypatch):
    """Puts a function in the table under the name ``fake``."""

    def install(function):
        module = types.ModuleType("fake_command")
        module.fake = function
        monkeypatch.setitem(sys.modules, "fake_command", module)
        monkeypatch.setitem(dispatcher.COMMANDS, "fake", CliCommand("fake_command:fake", "Fail."))

    return install


def test_errors_for_the_user_are_one_line(fake, capsys):
    fake(raising(OptionError("there is no instance 7; near it is 6")))
    assert main(["fake"]) == 2
    assert capsys.readouterr().err == "instdrive fake: there is no instance 7; near it is 6\n"


def test_interrupts_and_bugs(fake, capsys):
    fake(raising(KeyboardInterrupt()))
    assert main(["fake"]) == 130
    fake(raising(ZeroDivisionError("a bug")))
    with pytest.raises(ZeroDivisionError):
        main(["fake"])


def test_wrong_options_exit_with_2_and_command_help_with_0(fake, capsys):
    fake(raising(OptionError("never run")))
    assert main(["fake", "--volume", "11"]) == 2
    assert main(["fake", "--help"]) == 0
    assert "Anything." in capsys.readouterr().out


def test_a_reader_that_has_seen_enough_gets_no_traceback():
    command = f"{sys.executable} -m instdrive_app.main train --help | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, cwd=ROOT, timeout=300, check=False)
    assert done.stdout.startswith("usage: instdrive train")
    assert done.stderr == ""


def test_names_that_are_no_text_are_printed_all_the_same(tmp_path):
    name = tmp_path / b"J\xfcrgen.ply".decode(errors="surrogateescape")
    save_scene(tmp_path / "a.ply", random_scene(count=9, actors=0))
    command = [sys.executable, "-m", "instdrive_app.main", "convert", tmp_path / "a.ply", name]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    finished = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert finished.returncode == 0, finished.stderr
    assert b"9 splats" in finished.stdout
