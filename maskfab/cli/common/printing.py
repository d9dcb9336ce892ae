"""Output of the verbs: one JSON document or tables on stdout, verdicts on stderr."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import typer

if TYPE_CHECKING:
    from maskfab.base.model import Opening, Quantity
    from maskfab.report.rows.verdicts import Verdicts


class Found(Protocol):
    """Anything with a text for people, which is ``str()`` of it, and a document for machines."""

    def to_dict(self) -> Mapping[str, Any]: ...


# Controls of terminals, C1 included, marks that turn the direction of text or have no width, and breaks of lines.
_UNSEEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff\U000e0000-\U000e007f]"
)


def one_line(text: object) -> str:
    """The text in one line, as a terminal shows it: names in files from elsewhere may hold what it would obey."""
    return _UNSEEN.sub(lambda found: json.dumps(found[0])[1:-1], str(text))


def leave(passed: bool) -> None:
    """Exit code 1 unless everything passed."""
    if not passed:
        raise typer.Exit(1)


def print_json(document: Mapping[str, Any]) -> None:
    """The one JSON document of a command."""
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    typer.echo("\n".join(map(one_line, text.split("\n"))))


def print_found(found: Found, as_json: bool) -> None:
    """Print the finding of a verb: its JSON document, or its text line by line."""
    if as_json:
        print_json(found.to_dict())
        return
    for line in str(found).split("\n"):
        typer.echo(one_line(line))


def print_table(quantities: Iterable[Quantity], *, dies: bool = False) -> None:
    """One line for each quantity, in columns; with the name of its die if ``dies``."""
    from maskfab.report.rows.text import table_lines

    for line in table_lines(quantities, dies=dies):
        typer.echo(one_line(line))


def print_methods(title: str, quantities: Sequence[Quantity]) -> None:
    """A title, and one line for each quantity: name, value, how it was found; nothing without quantities."""
    rows = [(q.name, f"{q.value:.2g}" if isinstance(q.value, float) else str(q.value), q.method) for q in quantities]
    widths = [max((len(row[k]) for row in rows), default=0) for k in (0, 1)]
    for line in [f"{title}:"] if rows else []:
        typer.echo(line)
    for name, value, method in rows:
        typer.echo(one_line(f"{name.ljust(widths[0])}  {value.rjust(widths[1])}  {method}"))


def summarise(checks: Iterable[Quantity], verdicts: Verdicts) -> None:
    """Every failed check, every note, which has no verdict, and the three verdicts, on stderr."""
    for check in checks:
        if check.passed is None:
            tell_notes([check])
        elif not check.passed:
            told = f"{check.name}{_place(check)} = {check.value} {check.unit} (limit {check.limit}): {check.method}"
            typer.echo(one_line(f"FAIL {told}"), err=True)
    for line in verdicts.lines:
        typer.echo(line, err=True)


def tell_notes(notes: Iterable[Quantity]) -> None:
    """Quantities without a verdict that a user must see, on stderr."""
    for note in notes:
        told = f"{note.name}{_place(note)} = {f'{note.value} {note.unit}'.rstrip()}: {note.method}"
        typer.echo(one_line(f"NOTE {told}"), err=True)


def _place(quantity: Quantity) -> str:
    return f" [{quantity.die}]" if quantity.die else ""


def tell_opening(opening: Opening, path: Path, as_json: bool) -> None:
    """Where an opening was written, or what it is."""
    if as_json:
        facts = {"name": opening.name, "path": str(path), "clear_dots": opening.clear_dots}
        print_json({**facts, "open_ratio": opening.open_ratio, "provenance": dict(opening.provenance)})
    else:
        typer.echo(path)
