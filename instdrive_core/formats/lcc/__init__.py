"""XGRIDS' .lcc: a meta file beside splats in levels of detail."""
