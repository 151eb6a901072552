"""The ``instdrive`` program: finds the named command, imports only that one, and runs it."""

from __future__ import annotations

import importlib
import io
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class CliCommand:
    """Where a command is implemented, and the first line of its docstring, repeated so that help imports nothing."""

    target: str
    """``module:function``"""
    help: str


COMMANDS = {
    "demo": CliCommand(
        "instdrive_app.cli.demo:demo", "Train a synthetic drive, evaluate it, and open the editor on it."
    ),
    "edit": CliCommand("instdrive_app.cli.edit:edit", "Open a scene in the editor window."),
    "synth": CliCommand(
        "instdrive_core.cli.synth:record_synthetic_drive",
        "Write a synthetic driving clip in PandaSet's layout, with exact instance labels.",
    ),
    "prepare": CliCommand(
        "instdrive_core.cli.prepare:prepare",
        "Make a clip of a video or a folder of photos: pictures are chosen and their poses found.",
    ),
    "masks": CliCommand(
        "instdrive_core.cli.masks:create_masks", "Write instance masks for the training photos of a clip."
    ),
    "tracks": CliCommand(
        "instdrive_core.cli.tracks:tracks",
        "Find what moves in a clip's LiDAR sweeps, without cuboids or classes.",
    ),
    "make": CliCommand(
        "instdrive_core.cli.making.make:make_scene",
        "Make a scene of photos, a video or a drive: poses, masks, training and evaluation in one go.",
    ),
    "improve": CliCommand(
        "instdrive_core.cli.making.improve:improve_scene",
        "Train on from an edited scene: what was deleted stays deleted, what was moved or painted stays so.",
    ),
    "find-objects": CliCommand(
        "instdrive_core.cli.making.find_objects:find_objects_in_photos",
        "Find the objects of a finished scene in photos and their masks.",
    ),
    "fleet": CliCommand(
        "instdrive_core.cli.fleets.fleet:train_fleet",
        "Make measured scenes of many clips side by side: masks, tracks, training, evaluation, recording.",
    ),
    "train": CliCommand("instdrive_core.cli.train:train", "Train a driving clip into Gaussians with instance IDs."),
    "eval": CliCommand("instdrive_core.cli.eval:evaluate", "Measure a trained run against held-out photos and labels."),
    "compare": CliCommand("instdrive_core.cli.compare:compare", "Put measured runs side by side."),
    "apply": CliCommand("instdrive_core.cli.apply:apply", "Edit a scene without a window and export it."),
    "convert": CliCommand(
        "instdrive_core.cli.convert:convert", "Convert a scene into the format that the new name ends in."
    ),
    "objects": CliCommand(
        "instdrive_core.cli.objects:export_objects",
        "Write boxes or hulls of a scene's instances as .json or .glb, or the ways of what drives as .xosc.",
    ),
    "id-masks": CliCommand(
        "instdrive_core.cli.id_masks:export_id_masks",
        "Write instance masks as the cameras of a scene's photos see them.",
    ),
    "render": CliCommand(
        "instdrive_core.cli.render:render_pictures", "Draw a scene into PNG pictures without a window."
    ),
    "simulate": CliCommand(
        "instdrive_core.cli.recording.simulate:simulate_drive",
        "Record the edited drive as sensor data: pictures, masks, depth and boxes of every camera and moment.",
    ),
    "serve": CliCommand(
        "instdrive_core.cli.recording.serve:serve_drive",
        "Answer a simulator's requests for cameras and LiDAR of the edited drive, over gRPC, until Ctrl+C.",
    ),
    "info": CliCommand("instdrive_core.cli.info:print_info", "Print what a scene file or a driving clip holds."),
    "doctor": CliCommand(
        "instdrive_app.cli.doctor:doctor", "Print versions and the state of OpenGL and CUDA, and test a render."
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 2 after an error that is the user's to read, 130 after Ctrl+C."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Names of files need not be text, and not every terminal knows every character.
        sys.stdout.reconfigure(errors="backslashreplace")
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in ("-h", "--help"):
        print(_format_help())
        return 0
    if arguments[0] in ("-V", "--version"):
        print(f"instdrive {_find_version()}")
        return 0
    name, rest = arguments[0], arguments[1:]
    if name not in COMMANDS:
        print(f"instdrive: there is no command {name!r}. Commands: {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    if "" in rest:
        # As a path it would be the current folder, into which nobody meant to write a scene.
        problem = "an argument is empty, perhaps an unset shell variable. To name the current folder, give ."
        print(f"instdrive {name}: {problem}", file=sys.stderr)
        return 2
    return _run(name, rest)


def gui(argv: Sequence[str] | None = None) -> int:
    """Open the editor as a double click does, on the paths of the command line; returns the exit status."""
    from instdrive_app.cli.desktop import start_from_desktop

    return start_from_desktop(sys.argv[1:] if argv is None else argv)


def _run(name: str, arguments: list[str]) -> int:
    from instdrive_core.errors import InstDriveError
    from instdrive_core.extras import explain_missing_module

    try:
        import tyro

        module, function = COMMANDS[name].target.split(":")
        command = getattr(importlib.import_module(module), function)
        tyro.cli(command, prog=f"instdrive {name}", args=arguments)
    except InstDriveError as error:
        print(f"instdrive {name}: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        missing = explain_missing_module(error)
        if missing is None:
            raise
        print(f"instdrive {name}: {missing}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"instdrive {name}: stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader, `head` for one, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    return 0


def _format_help() -> str:
    width = max(len(name) for name in COMMANDS)
    lines = [
        "usage: instdrive COMMAND [OPTIONS]",
        "",
        "Turn a drive into a 3D scene whose objects can be clicked and edited.",
    ]
    lines += ["", "commands:", *(f"  {name:<{width}}  {command.help}" for name, command in COMMANDS.items())]
    return "\n".join([*lines, "", "Options of a command: instdrive COMMAND --help. Version: instdrive --version."])


def _find_version() -> str:
    from importlib.metadata import version

    return version("instdrive")


if __name__ == "__main__":
    sys.exit(main())
