"""Where the work stands, on stderr."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from maskfab.base.work import Progress


class watched:  # noqa: N801 - reads as a word in a with statement
    """A progress bar on a terminal, plain lines elsewhere, on stderr."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._bar: Any = None
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> Progress:
        from maskfab.base.work import silent

        if self._quiet:
            return silent
        if not sys.stderr.isatty():
            return _plain_line
        from rich.console import Console
        from rich.progress import Progress as Bar

        self._bar = Bar(console=Console(stderr=True), transient=False)
        self._bar.start()
        return self._advance

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _advance(self, stage: str, done: int, total: int) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = self._bar.add_task(stage, total=total)
        self._bar.update(self._tasks[stage], completed=done, total=total)


def _plain_line(stage: str, done: int, total: int) -> None:
    """One line a stage begun and ended, and one at each tenth of a long one."""
    tenth = max(1, total // 10)
    if done in (0, total) or done % tenth == 0:
        typer.echo(f"{stage}: {done}/{total}", err=True)
