"""Pack PlayCanvas's viewer for web pages of scenes: `python -m benchmarks.pack_web_viewer PACKAGE ENGINE`.

PACKAGE is the unpacked npm package `@playcanvas/supersplat-viewer`, ENGINE that of `playcanvas`, whose licence goes
with the engine in the former's bundle. `docs/web_page.md` says how to fetch them. What this writes is committed and
packed into the wheel.
"""

from __future__ import annotations

import argparse
import gzip
import json
import re
from pathlib import Path

import instdrive_core.formats.web_page

ASSETS = Path(instdrive_core.formats.web_page.__file__).parent / "assets"
_ENGINE_VERSION = re.compile(rb'^const version\$1 = "(\d+\.\d+\.\d+)";', re.MULTILINE)


def pack_web_viewer(package: Path, engine: Path, assets: Path = ASSETS) -> None:
    """Write the viewer's script (gzip), style sheet and licences into `assets`; equal packages make equal files."""
    script = (package / "public" / "index.js").read_bytes()
    script = b"\n".join(line for line in script.splitlines() if not line.startswith(b"//# sourceMappingURL="))
    (assets / "viewer.js.gz").write_bytes(gzip.compress(script, 9, mtime=0))
    (assets / "viewer.css").write_bytes((package / "public" / "index.css").read_bytes().rstrip() + b"\n")
    found = _ENGINE_VERSION.search(script)
    if found is None:
        raise SystemExit(f"{package}: its bundle names no version of the engine; look for it and adapt this script")
    texts = []
    for folder, version in ((package, ""), (engine, found[1].decode())):
        facts = json.loads((folder / "package.json").read_text(encoding="utf-8"))
        heading = f"{facts['name']} {version or facts['version']} ({facts['license']})"
        texts.append(f"{heading}\n\n{(folder / 'LICENSE').read_text(encoding='utf-8').strip()}\n")
    (assets / "LICENSES.txt").write_text("\n\n".join(texts), encoding="utf-8")


def main() -> None:
    """Pack the two folders of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("package", type=Path)
    parser.add_argument("engine", type=Path)
    options = parser.parse_args()
    pack_web_viewer(options.package, options.engine)


if __name__ == "__main__":
    main()
