"""A value that is worked out again where the document or its key is another one."""

from procedural_street import procedural_street

from instdrive_app.session.versioned_cache import VersionedCache
from instdrive_core.edits.document.document import Document


def test_a_value_is_worked_out_once_for_a_document_and_a_key():
    kept, asked = VersionedCache(), []
    first = Document(procedural_street(0.1))
    for document, key in ((first, (1,)), (first, (1,)), (first, (2,)), (Document(first.scene), (2,))):
        kept.get(document, key, lambda: asked.append(1))
    assert len(asked) == 3


def test_a_document_that_is_gone_is_not_kept():
    kept = VersionedCache()
    assert kept.get(Document(procedural_street(0.1)), (), lambda: "old") == "old"
    assert kept.get(Document(procedural_street(0.1)), (), lambda: "new") == "new", "even where it has the same address"
