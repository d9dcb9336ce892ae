"""The page of a sweep: figures, spread, sensitivities, yield, and the cases that failed."""

from __future__ import annotations

import math
from functools import cache

from jinja2 import Template
from markupsafe import Markup

from maskfab.camera.intervals import CONFIDENCE
from maskfab.quantities import registered
from maskfab.report.page.environment import page_environment
from maskfab.report.page.html import style
from maskfab.report.plots.number_text import rounded, short
from maskfab.report.plots.sweep_figures import BAND, quantity_figure, shown
from maskfab.resources import template
from maskfab.sweeps.fields import Field
from maskfab.sweeps.numbers import Of, Sensitivity, Swept

_MOST_FAILED = 40
"""Failed cases that the page lists; the table has all."""


def sweep_page(found: Swept) -> str:
    """The page, with nothing from outside it; equal sweeps give equal pages."""
    plan = found.plan
    figures = {name: quantity_figure(found, name) for name in plan.quantities}
    strongest = {series.of for name in plan.quantities for series in shown(found, name)}
    return _template().render(
        style=style(),
        sweep=plan.spec.sweep,
        version=plan.job.signature,
        job=plan.job,
        cases=len(plan.cases),
        fields=[(field.name, _values_text(field)) for field in plan.fields],
        failed=found.failed[:_MOST_FAILED],
        many_failed=len(found.failed),
        plan=plan,
        figures=[Markup(figure.img()) for figure in figures.values() if figure is not None],
        series=found.series,
        sensitivities=[each for each in found.sensitivities if each.of in strongest],
        yields=found.yields,
        limits=plan.limits,
        confidence=f"{CONFIDENCE:.0%}",
        band=BAND,
        of_text=of_text,
        slope_text=slope_text,
        title=lambda name: registered(name).title,
    )


def of_text(of: Of) -> str:
    """The die, wavelength and level that a number is of."""
    told = [of.die or ""]
    told += [] if of.wavelength_nm is None else [f"{of.wavelength_nm:g} nm"]
    told += [] if of.level_db is None else [f"{of.level_db:g} dB"]
    return ", ".join(each for each in told if each)


def slope_text(each: Sensitivity) -> str:
    """A slope with its interval."""
    if math.isnan(each.slope):
        return "–"
    half = "" if math.isnan(each.half_width) else f" ± {rounded(each.half_width, 2)}"
    unit = each.unit.removeprefix("1/") if each.unit.startswith("1/") else each.unit.strip("1")
    per = f" per {unit}" if each.unit.startswith("1/") else f" {unit}" if unit else ""
    return f"{rounded(each.slope)}{half}{per}"


def _values_text(field: Field) -> str:
    ways = "drawn" if field.drawn else "values"
    numbers = [level.number for level in field.levels if level.number is not None]
    if field.numeric:
        return f"{len(numbers)} {ways}, {short(min(numbers))} to {short(max(numbers))} {field.unit}".rstrip()
    first, last = field.levels[0].stated, field.levels[-1].stated
    return f"{len({level.stated for level in field.levels})} {ways}, {first} to {last}"


@cache
def _template() -> Template:
    return page_environment(number=rounded, short=short).from_string(template("sweep.html.j2"))
