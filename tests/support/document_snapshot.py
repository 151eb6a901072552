"""Everything of a document that an edit may change."""

from instdrive_core.edits.document.fingerprint import Part, fingerprint


def snapshot(document):
    """Digest of each part of a document by the part's name, so that a failing comparison names the part."""
    return {part.name: fingerprint(document, (part,)) for part in Part}
