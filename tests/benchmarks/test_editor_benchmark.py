"""The editor's benchmark on a small street: every figure is there and can be true."""

import pytest

from benchmarks import editor, editor_scene, workload
from benchmarks.editor import Options, main
from instdrive_app.render.offscreen import GraphicsError

KEYS = {
    *(
        "fps_200k_720p",
        "fps_1m_720p",
        "fps_1m_720p_elsewhere",
        "fps_1m_720p_moving",
        "click_ms_1m",
        "delete_ms_1m",
        "recolor_ms_1m",
        "paint_ms_1m",
    ),
    *("undo_ms_1m", "open_s_1m", "export_s_1m", "max_freeze_ms", "help_s", "brush_ms_1m", "range_ms_1m"),
    *("fps_5m_720p_moving", "click_ms_5m", "open_s_5m", "draft_psnr_1m", "draft_psnr_5m"),
}


@pytest.mark.skipif(not workload.SCRIPT.is_file(), reason="shared/ does not lie beside the repository")
def test_every_figure_is_measured(monkeypatch, tmp_path):
    monkeypatch.setattr(workload, "CACHE", tmp_path)
    for module in (editor, editor_scene):
        monkeypatch.setattr(module, "SIZE", (160, 90))
    options = Options(small=2000, large=3000, huge=4000, frames=2, actions=2, moving_seconds=0.5, window=False)
    try:
        figures = main(options)
    except GraphicsError as error:
        pytest.skip(str(error))
    assert figures.keys() == KEYS
    assert all(0 <= value < 1e5 for value in figures.values())
    assert figures["fps_1m_720p_moving"] > 0
    assert figures["click_ms_1m"] < 60_000, "milliseconds"
