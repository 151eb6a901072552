"""Shared by the editor's tests: a small street, an editor without a window, and OpenGL without one."""

import moderngl
import pytest
from procedural_street import procedural_street

from instdrive_app.actions import register_commands
from instdrive_app.session import EditorSession
from instdrive_core.edits.document import Document


@pytest.fixture
def street():
    """A fresh document of the procedural street."""
    return Document(procedural_street())


@pytest.fixture
def session(street):
    """An editor without a window that shows the street."""
    made = EditorSession()
    register_commands(made)
    made.show(street)
    yield made
    made.close()


@pytest.fixture(scope="session")
def gl():
    """An OpenGL context off screen; tests that need it are skipped, and say so, where there is none."""
    try:
        context = moderngl.create_context(standalone=True, backend="egl", require=330)
    except Exception as error:
        pytest.skip(f"no off-screen OpenGL 3.3 context: {error}")
    yield context
    context.release()
