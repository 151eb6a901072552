"""Long work on the terminal: a bar that fills by what the work reports, gone when it is done."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress

from instdrive_core.progress import report_to


@contextmanager
def show_share(title: str) -> Iterator[None]:
    """Show a bar on standard error for what is reported inside the block."""
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        with report_to(lambda share: bar.update(task, completed=share)):
            yield
