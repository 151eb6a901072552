"""GLSL programs from the files in shaders/, with ``#include "name.glsl"`` resolved."""

from __future__ import annotations

import re
from importlib import resources

import moderngl

from instdrive_core.errors import InstDriveError

_INCLUDE = re.compile(r'^#include "([\w.]+)"$', re.MULTILINE)


class ShaderError(InstDriveError):
    """The graphics driver refused a shader."""


def load_shader_source(name: str) -> str:
    """The text of a shader file, included files in place."""
    text = resources.files("instdrive_app.shaders").joinpath(name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda match: load_shader_source(match[1]).rstrip(), text)


def build_program(
    ctx: moderngl.Context, vertex: str, fragment: str | None = None, captured: tuple[str, ...] = ()
) -> moderngl.Program:
    """Compile and link shader files; `captured` names the vertex outputs that transform feedback keeps.

    Raises ShaderError with the driver's message.
    """
    source = load_shader_source(fragment) if fragment else None
    try:
        return ctx.program(vertex_shader=load_shader_source(vertex), fragment_shader=source, varyings=captured)
    except moderngl.Error as error:
        names = vertex if fragment is None else f"{vertex} + {fragment}"
        raise ShaderError(
            f"{names}: the OpenGL driver ({ctx.info['GL_RENDERER']}) refused the shader: {error}. "
            "OpenGL 3.3 is needed; update the graphics driver, or set LIBGL_ALWAYS_SOFTWARE=1"
        ) from error


def set_uniforms(program: moderngl.Program, **values: object) -> None:
    """Set uniforms by name; names that the compiler removed as unused are left out."""
    for name, value in values.items():
        member = program.get(name, None)
        if isinstance(member, moderngl.Uniform):
            member.value = value
