"""Counts the objects alive on the GPU by asking the driver, which reveals whatever is created and never freed."""

from __future__ import annotations

import ctypes
import ctypes.util

from instdrive_app.render.gl.gl_state import GraphicsError

GENERATED = {
    "Texture": "Textures",
    "Buffer": "Buffers",
    "Framebuffer": "Framebuffers",
    "Renderbuffer": "Renderbuffers",
    "VertexArray": "VertexArrays",
    "Sampler": "Samplers",
    "Query": "Queries",
}
"""Kinds of objects, and the plural in their `glGen` function; programs and shaders share names of their own."""
_NAMES = 4096
"""Names that are always checked: a driver that reuses names hands out the lowest free one."""


def count_live_objects() -> dict[str, int]:
    """Count the GL objects of each kind in the current context.

    The driver keeps the program used last, and its shaders, until another is used, so compare counts taken after the
    same drawing. Raises GraphicsError if the driver's library does not export OpenGL 3 (anywhere but on Linux).
    """
    name = ctypes.util.find_library("GL")
    if name is None:
        raise GraphicsError("there is no libGL to ask for live objects; install one (Debian: apt install libgl1)")
    library = ctypes.CDLL(name)
    try:
        counts = {kind: _count(library, kind, _find_free_name(library, plural)) for kind, plural in GENERATED.items()}
        program = library.glCreateProgram()
        library.glDeleteProgram(program)
        return counts | {kind: _count(library, kind, program) for kind in ("Program", "Shader")}
    except AttributeError as error:
        raise GraphicsError(f"{name} does not export OpenGL 3 ({error}); live objects cannot be counted") from error


def _count(library: ctypes.CDLL, kind: str, free_name: int) -> int:
    question = getattr(library, f"glIs{kind}")
    question.restype = ctypes.c_ubyte
    return sum(question(name) for name in range(1, max(_NAMES, free_name)))


def _find_free_name(library: ctypes.CDLL, plural: str) -> int:
    """Find the name that the next object would get; it is above all others if the driver does not reuse names."""
    name = ctypes.c_uint()
    getattr(library, f"glGen{plural}")(1, ctypes.byref(name))
    getattr(library, f"glDelete{plural}")(1, ctypes.byref(name))
    return name.value
