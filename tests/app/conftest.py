"""Shared by the editor's tests: a small street, the editor with and without a window, and OpenGL without one."""

import moderngl
import pytest
from procedural_street import procedural_street
from window_driver import editor_window

from instdrive_app.actions import register_actions
from instdrive_app.session.editor_session import EditorSession
from instdrive_core.edits.document.document import Document
from instdrive_core.formats.registry import save_scene


@pytest.fixture
def street():
    """A fresh document of the procedural street."""
    return Document(procedural_street())


@pytest.fixture
def session(street):
    """An editor without a window that shows the street."""
    made = EditorSession()
    register_actions(made)
    made.show(street)
    yield made
    made.close()


@pytest.fixture(scope="session")
def street_folder(tmp_path_factory):
    """The street as a scene folder, with its cameras and its driving car; tests only read it."""
    path = tmp_path_factory.mktemp("street") / "street"
    save_scene(path, procedural_street())
    return path


@pytest.fixture
def window(street_folder, tmp_path):
    """The real window, which has opened the street."""
    with editor_window(street_folder, tmp_path) as driver:
        yield driver


@pytest.fixture(scope="session")
def gl():
    """An OpenGL context off screen; tests that need it are skipped, and say so, where there is none."""
    try:
        context = moderngl.create_context(standalone=True, backend="egl", require=330)
    except Exception as error:
        pytest.skip(f"no off-screen OpenGL 3.3 context: {error}")
    yield context
    context.release()
