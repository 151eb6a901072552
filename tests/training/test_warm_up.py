"""The kernels' compilation before a first run."""

from instdrive_core.training import warm_up


def test_compiles_once_and_says_so():
    warm_up._stamp().unlink(missing_ok=True)
    notes: list[str] = []
    warm_up.compile_kernels(notes.append)
    assert len(notes) == 1
    assert "compiling" in notes[0]
    warm_up.compile_kernels(notes.append)
    assert len(notes) == 1


def test_other_sources_compile_anew(tmp_path, monkeypatch):
    before = warm_up._stamp()
    (tmp_path / "kernel.py").touch()
    monkeypatch.setattr(warm_up, "_SOURCES", tmp_path)
    assert warm_up._stamp() != before
