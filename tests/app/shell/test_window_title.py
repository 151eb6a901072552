"""The title of the window."""

from procedural_street import procedural_street

from instdrive_app.session.editor_session import EditorSession
from instdrive_app.shell.window import format_window_title
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances


def test_the_title_names_the_document_and_what_is_unsaved(tmp_path):
    session = EditorSession()
    assert format_window_title(session) == "InstDrive"
    session.show(Document(procedural_street()), tmp_path / "street.ply")
    assert format_window_title(session) == "street.ply – InstDrive"
    session.history.apply(DeleteInstances(session.document.find_visible_instances()[:1]))
    assert format_window_title(session) == "street.ply • InstDrive"
    session.history.undo()
    assert format_window_title(session) == "street.ply – InstDrive"
    session.close()
