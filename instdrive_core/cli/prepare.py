"""``instdrive prepare``: a video or a folder of photos becomes a clip."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from instdrive_core.datasets.capture.prepare import Preparation, prepare_clip
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.colmap.clips import load_colmap
from instdrive_core.wording import format_count


def prepare(
    source: Positional[Path],
    out: Annotated[Path, arg(aliases=["-o"])],
    *,
    most: int = 200,
    lens: Literal["simple", "opencv", "fisheye"] = "simple",
) -> None:
    """Make a clip of a video or a folder of photos: pictures are chosen and their poses found.

    What was interrupted goes on where it stopped when the same command is given again. Needs `instdrive[capture]`.

    Args:
        source: Video, or folder of photos.
        out: Folder of the clip; `instdrive info` and `train` open it.
        most: Photos at most. Of a video, and of a folder with more, sharp ones from places apart are chosen.
        lens: Distortion that is looked for: `simple` (one number), `opencv` (four) or `fisheye`.
    """
    from rich.progress import MofNCompleteColumn, Progress, TaskID

    with Progress(*Progress.get_default_columns(), MofNCompleteColumn(), transient=True) as progress:
        tasks: dict[str, TaskID] = {}

        def show(title: str, done: int, total: int) -> None:
            if title not in tasks:
                tasks[title] = progress.add_task(title)
            progress.update(tasks[title], completed=done, total=total or None)

        found = prepare_clip(Preparation(source, out, most, lens), show)
    photos = len(load_colmap(out, ClipOptions()).frames)
    if found is None:
        print(f"{out} was finished before: {format_count(photos, 'photo')} with poses")
        return
    listed = sum(1 for _ in (out / "images").iterdir())
    print(f"{found.photos} of {listed} photos have poses, {found.points:,} points, {found.error:.2f} px mean error")
    if found.photos < listed:
        print("The others show too little of what these show, or are blurred; they are left out")
    print(f"clip: {out} (train it with: instdrive train {out} -o RUN)")
