"""The page of reports side by side, and the same in words."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from jinja2 import Template
from markupsafe import Markup

from maskfab.camera.intervals import CONFIDENCE
from maskfab.report.page.environment import page_environment
from maskfab.report.page.html import style
from maskfab.report.page.photograph_table import best_photographed, scores
from maskfab.report.plots.compare_figure import trade
from maskfab.report.side_by_side.compared import Compared
from maskfab.resources import template

_MOST_FIELDS = 20


def compare_page(compared: Compared) -> str:
    """The page, with nothing from outside it; equal reports give equal pages."""
    table = compared.table
    return _template().render(
        style=style(),
        compared=compared,
        table=table,
        verdict=verdict(compared),
        confidence=f"{CONFIDENCE:.0%}",
        figure=None if table.level_db is None else Markup(trade(compared.document).img()),
    )


def verdict(compared: Compared) -> str:
    """Who is best, in one sentence."""
    table = compared.table
    if table.level_db is None:
        return "No photographs to rank by."
    taken, level = compared.document["photographs"], table.level_db
    known, best = scores(taken, level), best_photographed(taken, level)
    count = f"{len(taken['scenes'])} photographs at {level:g} dB of light"
    if len(known) < 2:
        return f"One die alone has photographs that can be compared: {next(iter(known), 'none')}."
    if not best:
        return f"Nobody can tell which is best: all {len(known)} dies tie over {count}."
    if len(best) == 1:
        return f"Best: {next(iter(best))}; every other die is worse over {count}."
    tied = [line.name for line in table.lines if line.name in best]
    return f"Best: {tied[0]}, tied with {', '.join(tied[1:])}, over {count}."


def compare_text(compared: Compared) -> Iterator[str]:
    """Lines for a terminal."""
    table = compared.table
    heading = ["die", "PSNR dB", f"gain over {table.reference}", "display", *(" ".join(each) for each in table.columns)]
    rows = [
        [line.name, line.psnr, line.gain, line.display or "-", *(cell.text if cell else "-" for cell in line.cells)]
        for line in table.lines
    ]
    widths = [max(len(row[column]) for row in (heading, *rows)) for column in range(len(heading))]
    for row in (heading, *rows):
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
    yield verdict(compared)
    yield from compared.left_out
    names = [each.name for each in compared.reports]
    for each in compared.differences[:_MOST_FIELDS]:
        values = (f"{name} {'-' if value is None else value}" for name, value in zip(names, each.values, strict=True))
        yield f"{each.field}: {', '.join(values)}"
    if len(compared.differences) > _MOST_FIELDS:
        yield f"{len(compared.differences) - _MOST_FIELDS} more fields differ: --json or --out lists all"


@cache
def _template() -> Template:
    return page_environment().from_string(template("compare.html.j2"))
