"""Output of commands: one JSON document or lines on stdout, the rest and progress on stderr."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from maskfab.api.results import Told
    from maskfab.base.work import Progress


# Controls of terminals, C1 included, marks that turn the direction of text or have no width, and breaks of lines.
_UNSEEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff\U000e0000-\U000e007f]"
)


def one_line(text: object) -> str:
    """The text in one line, as a terminal shows it: names in files from elsewhere may hold what it would obey."""
    return _UNSEEN.sub(lambda match: json.dumps(match[0])[1:-1], str(text))


def print_json(document: Mapping[str, Any]) -> None:
    """The one JSON document of a command."""
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    typer.echo("\n".join(map(one_line, text.split("\n"))))


def tell(line: object) -> None:
    """A line on stderr."""
    typer.echo(one_line(line), err=True)


def print_told(answer: Told, *, as_json: bool) -> None:
    """An answer: its document or its lines, and what goes beside them."""
    for line in answer.asides:
        tell(line)
    if as_json:
        print_json(answer.document)
        return
    for line in answer.lines:
        typer.echo(one_line(line))
    for line in answer.remarks:
        tell(line)


class progress_bar:  # noqa: N801 - reads as a word in a with statement
    """Where the work stands: a bar on a terminal, plain lines elsewhere, on stderr."""

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
        return self._advance

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _advance(self, stage: str, done: int, total: int) -> None:
        # Begun with the first stage, so that a person can be asked before.
        self._bar.start()
        if not total:
            self._bar.console.print(one_line(stage), markup=False, highlight=False)
            return
        if stage not in self._tasks:
            self._tasks[stage] = self._bar.add_task(stage, total=total)
        self._bar.update(self._tasks[stage], completed=done, total=total)


def _plain_line(stage: str, done: int, total: int) -> None:
    """One line a stage begun and ended, and one at each tenth of a long one; of no steps, the words alone."""
    tenth = max(1, total // 10)
    if not total:
        tell(stage)
    elif done in (0, total) or done % tenth == 0:
        typer.echo(f"{stage}: {done}/{total}", err=True)
