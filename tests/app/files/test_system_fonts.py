"""Which of the system's fonts stand in for scripts that the editor's own font lacks."""

from instdrive_app.files.system_fonts import FALLBACKS, find_fallback_fonts, list_font_folders


def test_the_best_font_of_each_group_is_found_wherever_it_lies(tmp_path):
    deep = tmp_path / "truetype" / "some"
    deep.mkdir(parents=True)
    for name in ("wqy-zenhei.ttc", "NotoSansCJK-Regular.ttc", "malgun.ttf", "Unknown.ttf"):
        (deep / name).touch()
    found = find_fallback_fonts((tmp_path / "missing", tmp_path))
    assert found == (deep / "NotoSansCJK-Regular.ttc", deep / "malgun.ttf")


def test_the_user_s_own_fonts_come_first(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "own"))
    monkeypatch.setenv("XDG_DATA_DIRS", str(tmp_path / "shared"))
    monkeypatch.setattr("sys.platform", "linux")
    for place in ("own", "shared"):
        (tmp_path / place / "fonts").mkdir(parents=True)
        (tmp_path / place / "fonts" / FALLBACKS[0][0]).touch()
    assert find_fallback_fonts(list_font_folders())[0] == tmp_path / "own" / "fonts" / FALLBACKS[0][0]


def test_a_system_without_such_fonts_has_none(tmp_path):
    assert find_fallback_fonts((tmp_path,)) == ()
