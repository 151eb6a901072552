"""Finding the system's fonts for scripts that the editor's own font lacks: Chinese, Japanese, Korean and others."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

FALLBACKS: tuple[tuple[str, ...], ...] = (
    (
        "NotoSansCJK-Regular.ttc",
        "NotoSansCJK-VF.otf.ttc",
        "NotoSansCJKsc-Regular.otf",
        "SourceHanSans-Regular.ttc",
        "SourceHanSansCN-Regular.otf",
        "msyh.ttc",
        "PingFang.ttc",
        "Hiragino Sans GB.ttc",
        "STHeiti Medium.ttc",
        "wqy-microhei.ttc",
        "wqy-zenhei.ttc",
        "DroidSansFallbackFull.ttf",
        "DroidSansFallback.ttf",
        "simsun.ttc",
        "uming.ttc",
    ),
    ("YuGothM.ttc", "meiryo.ttc", "msgothic.ttc", "ヒラギノ角ゴシック W3.ttc", "ipag.ttf", "TakaoGothic.ttf"),
    ("malgun.ttf", "AppleSDGothicNeo.ttc", "NanumGothic.ttf", "UnDotum.ttf"),
    ("DejaVuSans.ttf", "segoeui.ttf", "Arial Unicode.ttf"),
)
"""File names, best first, one of each group is enough: Chinese (most have the rest, too), Japanese, Korean, other."""


def list_font_folders() -> tuple[Path, ...]:
    """List the folders in which this system keeps fonts; some may not exist."""
    home = Path.home()
    if sys.platform == "win32":
        local = Path(os.environ.get("LOCALAPPDATA", home / "AppData/Local"))
        return Path(os.environ.get("WINDIR", "C:/Windows")) / "Fonts", local / "Microsoft/Windows/Fonts"
    if sys.platform == "darwin":
        return Path("/System/Library/Fonts"), Path("/Library/Fonts"), home / "Library/Fonts"
    own = Path(os.environ.get("XDG_DATA_HOME") or home / ".local/share") / "fonts"
    shared = (os.environ.get("XDG_DATA_DIRS") or "/usr/local/share:/usr/share").split(":")
    return own, home / ".fonts", *(Path(folder) / "fonts" for folder in shared if folder)


def find_fallback_fonts(folders: Iterable[Path]) -> tuple[Path, ...]:
    """Find the best font file of each group of `FALLBACKS` that these folders, or folders inside, hold."""
    files: dict[str, Path] = {}
    for folder in folders:
        for path in _walk_files(folder):
            files.setdefault(path.name, path)
    best = (next((files[name] for name in names if name in files), None) for names in FALLBACKS)
    return tuple(path for path in best if path is not None)


def _walk_files(folder: Path) -> Iterator[Path]:
    for root, _, names in os.walk(folder):
        for name in names:
            yield Path(root, name)
