"""What a process of its own does with a .las or .laz: all that reading does."""

from __future__ import annotations

from instdrive_core.files.trial import run_trial

_BLOCK_POINTS = 100_000


def _read_all(path: str) -> None:
    import laspy

    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs) as reader:
        for _ in reader.chunk_iterator(_BLOCK_POINTS):
            pass


if __name__ == "__main__":
    run_trial(_read_all)
