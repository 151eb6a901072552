"""Text in files that cannot be printed or shown never becomes a name."""

import json

import pytest
from random_scene import random_scene

from instdrive_core.errors import DataError
from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.files.json_value import parse_json, require_whole_text
from instdrive_core.formats.registry import open_scene, save_scene


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_half_characters_are_refused_and_whole_ones_kept(encoding):
    for good in ({"a": "ü😀\u2026"}, ["x", 1.5, None], "\\ud800 as text"):
        assert parse_json(json.dumps(good).encode(encoding)) == good
        assert parse_json(json.dumps(good, ensure_ascii=False)) == good
    for half in ('"\\ud800"', '{"\\uDFFF": 1}', '["\ud83d"]', '"\\ude00\\ud83d"'):
        with pytest.raises(ValueError, match="no character"):
            parse_json(half.encode(encoding, "surrogatepass"))


def test_names_of_files_that_are_no_text_come_through_but_are_not_shown():
    path = b"scenes/J\xfcrgen/a.ply".decode(errors="surrogateescape")
    assert parse_json(json.dumps({"path": path})) == {"path": path}
    with pytest.raises(ValueError, match="half a character"):
        require_whole_text(path)


def test_numbers_of_projects_are_finite():
    assert parse_bounded_json(b"[1e300, -2.5, 7]") == [1e300, -2.5, 7]
    for text in (b"1e400", b"[-1e999]", b"NaN", b"Infinity"):
        with pytest.raises(ValueError, match="no number"):
            parse_bounded_json(text)


@pytest.mark.parametrize("bad", ["\\ud800", "\\udcff"])
def test_names_in_scenes(tmp_path, bad):
    scene = random_scene(actors=0)
    save_scene(tmp_path / "folder", scene)
    manifest = tmp_path / "folder" / "scene.json"
    manifest.write_text(manifest.read_text().replace('"name": "', f'"name": "{bad}', 1))
    with pytest.raises(DataError, match="damaged"):
        open_scene(tmp_path / "folder")
    save_scene(tmp_path / "a.ply", scene)
    content = (tmp_path / "a.ply").read_bytes()
    comment = b'comment instdrive instance {"id":1,"name":"%b"}\nelement' % bad.encode()
    (tmp_path / "a.ply").write_bytes(content.replace(b"element", comment, 1))
    with pytest.raises(DataError, match="damaged"):
        open_scene(tmp_path / "a.ply")
