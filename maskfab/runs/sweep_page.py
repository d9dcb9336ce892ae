"""The page of a sweep: figures, spread, sensitivities, yield, and the cases that failed.

There is one figure for each quantity, with a field of the sweep along each axis and a curve for each die.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from textwrap import fill

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maskfab.base.arrays import Floats
from maskfab.base.quantities import registered
from maskfab.base.resources import template
from maskfab.camera.scores import CONFIDENCE
from maskfab.report.figures.die import MARKS, OKABE_ITO
from maskfab.report.figures.sheet import QUIET, Drawing, place, styled
from maskfab.report.pages.template import page_environment, style
from maskfab.report.text import rounded, short
from maskfab.runs.sweep_numbers import Of, Sensitivity, Series, Swept, axis
from maskfab.runs.sweep_plan import Field

BAND = (0.05, 0.95)
"""Shares of the cases between which a band lies."""
_LEFT, _WIDE, _HIGH, _FOOT, _TOP, _GAP, _LEGEND = 0.75, 2.9, 2.1, 0.5, 0.3, 0.7, 1.9
_MOST_AXES = 4
_LABEL = 30
"""Characters in a line of a label."""


def shown(swept: Swept, name: str) -> list[Series]:
    """Series of one quantity for every die: at the middle one of its wavelengths, and of its levels of light."""
    own = [series for series in swept.series if series.of.name == name]
    lines = sorted({series.of.wavelength_nm or 0.0 for series in own})
    levels = sorted({series.of.level_db or 0.0 for series in own})
    if not own:
        return []
    wanted = lines[len(lines) // 2], levels[len(levels) // 2]
    return [series for series in own if (series.of.wavelength_nm or 0.0, series.of.level_db or 0.0) == wanted]


@styled
def quantity_figure(swept: Swept, name: str) -> Drawing | None:
    """One quantity along every numeric field, or, if there is none, how its values are spread; None without values."""
    own = [series for series in shown(swept, name) if series.known.size]
    if not own:
        return None
    plan = swept.plan
    axes = {
        field.name + (f" ({field.unit})" if field.unit else ""): numbers
        for i, field in enumerate(plan.fields)
        if (numbers := axis(field, [case.levels[i] for case in plan.cases])) is not None and np.ptp(numbers) > 0
    }
    along: list[tuple[str, Floats | None]] = [*list(axes.items())[:_MOST_AXES]] or [("share of the cases", None)]
    figure = Figure(figsize=(_LEFT + len(along) * (_WIDE + _GAP) + _LEGEND, _TOP + _HIGH + _FOOT))
    entry = registered(name)
    unit = own[0].unit if own[0].unit not in ("", "1") else ""
    for column, (label, numbers) in enumerate(along):
        sheet = place(figure, (_LEFT + column * (_WIDE + _GAP), _FOOT, _WIDE, _HIGH))
        for number, series in enumerate(own):
            _curve(sheet, numbers, series, number)
        sheet.set_xlabel(label)
        sheet.grid(color=QUIET, alpha=0.2, linewidth=0.5)
        sheet.spines[["top", "right"]].set_visible(False)
        if column == 0:
            sheet.set_ylabel(fill(f"{entry.title}{f' ({unit})' if unit else ''}", _LABEL))
    handles, names = figure.axes[0].get_legend_handles_labels()
    beside = (1 - _LEGEND / figure.get_size_inches()[0], 0.5)
    figure.legend(handles, names, loc="center left", bbox_to_anchor=beside, borderaxespad=0, fontsize=7.5)
    return Drawing(figure, f"{entry.title} of {len(own)} dies in {len(plan.cases)} cases")


def _curve(sheet: Axes, numbers: Floats | None, series: Series, number: int) -> None:
    """Median and band where several cases share a value, points where hardly any do, or the sorted values."""
    colour, mark = OKABE_ITO[number % len(OKABE_ITO)], MARKS[number % len(MARKS)]
    label = series.of.die or ""
    finite = np.isfinite(series.values)
    values = series.values[finite]
    if numbers is None:
        share = (np.arange(values.size) + 0.5) / values.size
        sheet.plot(share, np.sort(values), marker=mark, markersize=2.5, linewidth=0.9, color=colour, label=label)
        return
    at = numbers[finite]
    places = np.unique(at)
    if (places.size > max(2, values.size // 2) and places.size < values.size) or places.size == values.size > 40:
        sheet.plot(at, values, mark, markersize=2.5, alpha=0.6, markeredgewidth=0, color=colour, label=label)
        return
    groups = [values[at == here] for here in places]
    sheet.plot(places, _quantiles(groups, 0.5), marker=mark, markersize=3, linewidth=1.1, color=colour, label=label)
    if any(group.size > 1 for group in groups):
        low, high = (_quantiles(groups, share) for share in BAND)
        sheet.fill_between(places, low, high, color=colour, alpha=0.15, linewidth=0)


def _quantiles(groups: Sequence[Floats], share: float) -> list[float]:
    return [float(np.quantile(group, share)) for group in groups]


_MOST_FAILED = 40
"""Failed cases that the page lists; the table has all."""


def sweep_page(swept: Swept) -> str:
    """The page, with nothing from outside it; equal sweeps give equal pages."""
    plan = swept.plan
    figures = {name: quantity_figure(swept, name) for name in plan.quantities}
    strongest = {series.of for name in plan.quantities for series in shown(swept, name)}
    page = page_environment(number=rounded, short=short).from_string(template("sweep.html.j2"))
    return page.render(
        style=style(),
        sweep=plan.spec.sweep,
        version=plan.job.signature,
        job=plan.job,
        cases=len(plan.cases),
        fields=[(field.name, _values_text(field)) for field in plan.fields],
        failed=swept.failed[:_MOST_FAILED],
        many_failed=len(swept.failed),
        plan=plan,
        figures=[Markup(figure.img()) for figure in figures.values() if figure is not None],
        series=swept.series,
        sensitivities=[effect for effect in swept.sensitivities if effect.of in strongest],
        yields=swept.yields,
        limits=plan.limits,
        confidence=f"{CONFIDENCE:.0%}",
        band=BAND,
        of_text=of_text,
        slope_text=slope_text,
        title=lambda name: registered(name).title,
    )


def of_text(of: Of) -> str:
    """The die, wavelength and level that a number is of."""
    parts = [of.die or ""]
    parts += [] if of.wavelength_nm is None else [f"{of.wavelength_nm:g} nm"]
    parts += [] if of.level_db is None else [f"{of.level_db:g} dB"]
    return ", ".join(part for part in parts if part)


def slope_text(effect: Sensitivity) -> str:
    """A slope with its interval."""
    if math.isnan(effect.slope):
        return "–"
    half = "" if math.isnan(effect.half_width) else f" ± {rounded(effect.half_width, 2)}"
    unit = effect.unit.removeprefix("1/") if effect.unit.startswith("1/") else effect.unit.strip("1")
    per = f" per {unit}" if effect.unit.startswith("1/") else f" {unit}" if unit else ""
    return f"{rounded(effect.slope)}{half}{per}"


def _values_text(field: Field) -> str:
    ways = "drawn" if field.drawn else "values"
    numbers = [level.number for level in field.levels if level.number is not None]
    if len({level.stated for level in field.levels}) == 1:
        return f"{short(numbers[0])} {field.unit}".rstrip() if field.numeric else str(field.levels[0].stated)
    if field.numeric:
        return f"{len(numbers)} {ways}, {short(min(numbers))} to {short(max(numbers))} {field.unit}".rstrip()
    first, last = field.levels[0].shown, field.levels[-1].shown
    return f"{len({level.stated for level in field.levels})} {ways}, {first} to {last}"
