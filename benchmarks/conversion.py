"""Memory and time of converting large scenes, as `instdrive convert` does it, reading back included.

`python -m benchmarks.conversion --splats 5000000` writes a random scene of SH degree 3 piece by piece, converts it in
a process of its own for each pair of formats, and prints one JSON line: by pair, the peak of resident memory above
what the program takes before (MB, and as a ratio to the larger of the two files), and seconds. Linux only.
"""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from instdrive_core.cli.convert import convert
from instdrive_core.maths.spherical_harmonics import REST_COUNTS

PAIRS = ("ply:ply", "ply:spz", "ply:compressed.ply", "ply:splat", "spz:ply", "compressed.ply:ply", "splat:ply")
BLOCK_ROWS = 65_536
WARM_UP = 2000
"""Splats converted before the baseline is taken, so that imports and compiled kernels are in it."""


@dataclass(frozen=True)
class Options:
    """Convert a large scene from format to format."""

    splats: int = 1_000_000
    pairs: tuple[str, ...] = PAIRS
    """FROM:TO, endings without the first dot."""
    folder: Path | None = None
    """Where the files go, about twice the .ply; default: the system's place for temporary files."""
    degree: int = 3
    """Degree of the spherical harmonics."""
    instances: int = 0
    """Number of instances, written as columns of IDs and codewords of the .ply."""
    measured: tuple[Path, Path] | None = None
    """Used by the program itself: convert the first file into the second in this process."""


def main(options: Options) -> Mapping[str, object]:
    """Everything the JSON line says."""
    if options.measured is not None:
        return measure_conversion(*options.measured)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        write_large_ply(folder / "in.ply", options.splats, options.degree, options.instances)
        pairs = {pair: _in_own_process(folder, *pair.split(":")) for pair in options.pairs}
    facts = {"splats": options.splats, "sh_degree": options.degree, "instances": options.instances}
    return facts | {"pairs": pairs}


def write_large_ply(path: Path, count: int, degree: int, instances: int = 0) -> None:
    """A random scene in INRIA's layout, never whole in memory."""
    rest = 3 * REST_COUNTS[degree]
    # Positions, normals, dc, rest, opacity, scales, rotation: middle and spread of each column.
    middle = np.array([0] * (9 + rest) + [1] + [-3] * 3 + [1, 0, 0, 0], np.float32)
    spread = np.array([30, 30, 5, 0, 0, 0] + [1] * 3 + [0.1] * rest + [2] + [0.7] * 3 + [0.5] * 4, np.float32)
    record = np.dtype([("floats", "<f4", len(middle))] + [("ids", "<u4", 2)] * bool(instances))
    rng = np.random.default_rng(0)
    with path.open("wb") as file:
        file.write(_header(count, rest, bool(instances)))
        for start in range(0, count, BLOCK_ROWS):
            rows = np.empty(min(BLOCK_ROWS, count - start), record)
            rows["floats"] = middle + spread * rng.standard_normal((len(rows), len(middle)), np.float32)
            if instances:
                rows["ids"] = rng.integers(1, instances + 1, len(rows))[:, None]
            file.write(rows.data)


def _header(count: int, rest: int, has_ids: bool) -> bytes:
    names = [*"xyz", "nx", "ny", "nz", *(f"f_dc_{index}" for index in range(3))]
    names += [*(f"f_rest_{index}" for index in range(rest)), "opacity"]
    names += [*(f"scale_{index}" for index in range(3)), *(f"rot_{index}" for index in range(4))]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    lines += [f"property float {name}" for name in names]
    lines += [f"property uint {name}" for name in ("instance_id", "codeword") if has_ids]
    return "\n".join([*lines, "end_header", ""]).encode()


def measure_conversion(source: Path, out: Path) -> dict[str, float]:
    """Convert in this process, which does nothing else."""
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        little = Path(name)
        suffix_in, suffix_out = ("".join(path.suffixes) for path in (source, out))
        write_large_ply(little / "in.ply", WARM_UP, 3)
        if suffix_in != ".ply":
            convert(little / "in.ply", little / f"in{suffix_in}")
        convert(little / f"in{suffix_in}", little / f"out{suffix_out}")
        before = _resident("VmRSS")
        Path("/proc/self/clear_refs").write_text("5")  # the peak starts afresh
        started = time.perf_counter()
        convert(source, out)
        seconds = time.perf_counter() - started
    peak = _resident("VmHWM") - before
    size = max(source.stat().st_size, out.stat().st_size)
    return {
        "peak_mb": round(peak / 1e6),
        "file_mb": round(size / 1e6),
        "ratio": round(peak / size, 3),
        "seconds": round(seconds, 1),
    }


def _in_own_process(folder: Path, suffix_in: str, suffix_out: str) -> dict[str, float]:
    source, out = folder / f"in.{suffix_in}", folder / f"out.{suffix_out}"
    if not source.exists():
        with contextlib.redirect_stdout(io.StringIO()):
            convert(folder / "in.ply", source)
    command = [sys.executable, "-m", "benchmarks.conversion", "--measured", str(source), str(out)]
    finished = subprocess.run(command, check=True, capture_output=True, text=True)
    out.unlink()
    return json.loads(finished.stdout)


def _resident(field: str) -> int:
    """Bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(f"{field}:"))


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Options))))
