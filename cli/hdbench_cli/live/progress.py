"""Progress of a long command: a bar on a terminal, nothing elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from hdbench_cli.output import Output


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[str, float], None]]:
    """Show a bar on stderr where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _what, _share: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.text import Text

    columns = (
        TextColumn("{task.fields[title]}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
    )
    console = Output.console(stderr=True)
    bar = Progress(*columns, console=console, transient=True)
    task = bar.add_task("", total=1.0, title=title)

    def show(what: str, share: float) -> None:
        # bar, share, elapsed time and gaps take 41 columns
        room = max(10, console.width - 41 - len(title))
        with suppress(OSError):
            bar.update(task, completed=share, description=Text(what).plain[:room])

    # a terminal that is closed meanwhile takes nothing with it: not the run, and not its exit code
    with suppress(OSError):
        bar.start()
    try:
        yield show
    finally:
        with suppress(OSError):
            bar.stop()
