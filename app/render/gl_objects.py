"""How many objects are alive on the GPU, asked of the driver itself: what is made and never freed shows, whoever made
it."""

from __future__ import annotations

import ctypes
import ctypes.util

from instdrive_app.render.gl_state import GraphicsError

KINDS = ("Texture", "Buffer", "Framebuffer", "Renderbuffer", "VertexArray", "Program", "Shader", "Sampler", "Query")
_NAMES = 4096
"""Drivers give away the lowest free number, so names beyond this would mean as many objects alive at once."""


def live_objects(names: int = _NAMES) -> dict[str, int]:
    """Number of GL objects of each kind in the current context, among the first `names` names.

    The driver keeps the program used last, and its shaders, until another is used: compare counts taken after drawing.
    Raises GraphicsError where the driver's library does not export OpenGL 3 (anything but Linux).
    """
    library_name = ctypes.util.find_library("GL")
    if library_name is None:
        raise GraphicsError("there is no libGL to ask for live objects; install one (Debian: apt install libgl1)")
    library = ctypes.CDLL(library_name)
    try:
        questions = {kind: getattr(library, f"glIs{kind}") for kind in KINDS}
    except AttributeError as error:
        raise GraphicsError(
            f"{library_name} does not export OpenGL 3 ({error}); live objects cannot be counted"
        ) from error
    for question in questions.values():
        question.restype = ctypes.c_ubyte
    return {kind: sum(question(name) for name in range(1, names)) for kind, question in questions.items()}
