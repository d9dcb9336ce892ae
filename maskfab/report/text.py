"""Numbers and results as text: a value, a table of quantities, and the lines of ``maskfab design``.

A value has few digits, thin spaces between thousands, and powers of ten where they help. Quantities are looked up by
name and wavelength, and are a table, a dictionary or a DataFrame.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, overload

from maskfab.base.errors import UnknownNameError
from maskfab.base.extras import require
from maskfab.base.model import Quantity
from maskfab.base.quantities import columns
from maskfab.base.units import NM_PER_UM, UM_PER_MM, decimals_of

if TYPE_CHECKING:
    from pandas import DataFrame

    from maskfab.designs.model.appraisal import Robustness, Varied
    from maskfab.designs.rules.display_fit import DieFit
    from maskfab.designs.search.result import Designed, SceneDesign
    from maskfab.mask.panels import CellMap


_PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def rounded(value: float | str | None, digits: int = 4) -> str:
    """A value with that many significant digits, two fewer beside a power of ten; text stays as it is."""
    if value is None:
        return "–"
    if isinstance(value, bool | str):
        return str(value)
    if isinstance(value, int) or (value.is_integer() and abs(value) < 1e15):
        text = f"{int(value):,}".replace(",", "\u202f")
    elif 1e-3 <= abs(value) < 1e6:
        text = f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}"
    else:
        mantissa, exponent = f"{value:.{max(digits - 2, 0)}e}".split("e")
        text = f"{mantissa} × 10{str(int(exponent)).translate(_SUPERSCRIPTS)}"
    return text.replace("-", "−")


def short(value: float | str | None, digits: int = 4) -> str:
    """As :func:`rounded`, without zeros that say nothing: for limits and settings, which are exact."""
    text = rounded(value, digits)
    if isinstance(value, str) or "." not in text:
        return text
    mantissa, power, exponent = text.partition(" × ")
    mantissa = mantissa.rstrip("0").rstrip(".")
    return exponent if mantissa == "1" and power else mantissa + power + exponent


EXACT = "exact"
"""In place of an error that is rounding alone."""
_ROUNDING = 1e-9
"""Of a value: errors up to this share are those of rounding, and digits of it that nobody measured."""
_NOTHING = 1e-12
"""Errors up to this are rounding, whatever their unit."""
_DECIBELS = 2
"""Decimals of a value in dB at most."""


def value_and_error(
    value: float | str | None, error: float | None = None, unit: str = "1", digits: int = 4
) -> tuple[str, str]:
    """A number and its error as a reader is told them: no digit that the error does not allow, and few at most.

    Args:
        error: half width of its error bar; None or 0 for an exact number.
        unit: a number of decibels has two decimals at most.

    Returns:
        The value, and the error without its sign: "" for none, :data:`EXACT` for one of rounding alone.
    """
    if not isinstance(value, float) or isinstance(value, bool):
        return rounded(value), ""
    most = digits - 1 - _exponent(value)
    if unit == "dB":
        most = min(most, _DECIBELS)
    if not error or error <= max(_ROUNDING * abs(value), _NOTHING):
        whole = (value.is_integer() and unit != "dB") or not 1e-3 <= abs(value) < 1e6
        return rounded(value, digits) if whole else _fixed(value, most), "" if error is None else EXACT
    decimals = decimals_of(error)
    of_error = _fixed(error, decimals) if 1e-3 <= error < 1e6 else rounded(error, decimals + _exponent(error) + 2)
    if 1e-3 <= max(abs(value), error) < 1e6:
        return _fixed(value, min(decimals, most)), of_error
    allowed = decimals + _exponent(value) + 1
    return rounded(value, min(allowed, digits) + 1) if value and allowed > 0 else "0", of_error


def _exponent(value: float) -> int:
    """Power of ten of a number's first digit; 0 of zero."""
    return math.floor(math.log10(abs(value))) if value else 0


def _fixed(value: float, decimals: int) -> str:
    """With so many decimals, of which those below 0 are zeros before the point; never a zero with a sign."""
    if decimals <= 0:
        return rounded(int(round(value, decimals)))
    return f"{value:z.{decimals}f}".replace("-", "−")


class Quantities(Sequence[Quantity]):
    """Reported numbers in their order: of a die, of a plate, of an analysis, of a verification.

    ``numbers["mtf50", 530]`` is the one of that name at that wavelength (of photographs: at that level of light, in
    dB); ``numbers["open_ratio"]`` one that there is only once; ``numbers[0]`` the first.

    Raises:
        UnknownNameError: MF432 from a look-up of what is not there, or is there more than once.
    """

    def __init__(self, quantities: Iterable[Quantity]) -> None:
        self._all = tuple(quantities)

    @property
    def passed(self) -> bool:
        """Whether no check failed; numbers without a limit are no checks."""
        return all(quantity.passed is not False for quantity in self._all)

    @property
    def failed(self) -> Quantities:
        """The checks that failed."""
        return Quantities(quantity for quantity in self._all if quantity.passed is False)

    @property
    def names(self) -> tuple[str, ...]:
        """Every name once, in order."""
        return tuple(dict.fromkeys(quantity.name for quantity in self._all))

    @overload
    def __getitem__(self, key: int | str | tuple[str, float]) -> Quantity: ...
    @overload
    def __getitem__(self, key: slice) -> Quantities: ...
    def __getitem__(self, key: int | slice | str | tuple[str, float]) -> Quantity | Quantities:
        if isinstance(key, slice):
            return Quantities(self._all[key])
        if isinstance(key, int):
            return self._all[key]
        return self._named(*key) if isinstance(key, tuple) else self._named(key)

    def _named(self, name: str, at: float | None = None) -> Quantity:
        alike = [quantity for quantity in self._all if quantity.name == name]
        if not alike:
            raise UnknownNameError("MF432", f"there is no number {name!r}", cure=f"Use one of {', '.join(self.names)}")
        chosen = [quantity for quantity in alike if at is None or at in (quantity.wavelength_nm, quantity.level_db)]
        if len(chosen) == 1:
            return chosen[0]
        places = ", ".join(f"{p:g}" for q in alike for p in (q.wavelength_nm, q.level_db) if p is not None)
        problem = f"stands {len(chosen)} times in these results" if chosen else f"is not given at {at!r}"
        cure = f'Ask for numbers["{name}", one of {places}]' if places else f"Look for {name!r} in the whole list"
        raise UnknownNameError("MF432", f"{name!r} {problem}", cure=cure)

    def __len__(self) -> int:
        return len(self._all)

    def __iter__(self) -> Iterator[Quantity]:
        return iter(self._all)

    def __add__(self, others: Iterable[Quantity]) -> Quantities:
        return Quantities((*self._all, *others))

    def to_dict(self) -> list[dict[str, Any]]:
        """One dictionary for each number, as report.json has it."""
        return [quantity_document(quantity) for quantity in self._all]

    def to_dataframe(self) -> DataFrame:
        """One row for each number, as report.json has it."""
        return dataframe(self.to_dict())

    def __str__(self) -> str:
        dies = len({quantity.die for quantity in self._all}) > 1
        judged = [quantity for quantity in self._all if quantity.passed is not None]
        passed = sum(quantity.passed is True for quantity in judged)
        verdict = [f"{'PASS' if self.passed else 'FAIL'}: {passed} of {len(judged)} checks pass"] * bool(judged)
        return "\n".join([*table_lines(self._all, dies=dies), *verdict])

    def __repr__(self) -> str:
        return f"<Quantities: {len(self._all)} numbers, {'pass' if self.passed else 'fail'}>"

    def _repr_html_(self) -> str:
        return html_table(self._all)


def table_lines(quantities: Iterable[Quantity], *, dies: bool = False) -> list[str]:
    """A heading and one line for each quantity, in columns; with the name of its die if ``dies``."""
    return columns(_rows(quantities, dies))


def note_lines(notes: Iterable[Quantity]) -> list[str]:
    """Quantities without a verdict that a user must see."""
    return [
        f"NOTE {note.name}{place_text(note)} = {f'{note.value} {note.unit}'.rstrip()}: {note.method}" for note in notes
    ]


def place_text(quantity: Quantity) -> str:
    """The die that a number is of, in brackets; nothing for one of the plate."""
    return f" [{quantity.die}]" if quantity.die else ""


def html_table(quantities: Iterable[Quantity]) -> str:
    """The table with dies as HTML; a method is shown where the pointer rests on a row."""
    quantities = list(quantities)
    heading, *rows = _rows(quantities, dies=True)
    head = "".join(f"<th>{escape(cell)}</th>" for cell in heading)
    body = "".join(
        f'<tr title="{escape(quantity.method)}">{"".join(f"<td>{escape(cell)}</td>" for cell in row)}</tr>'
        for quantity, row in zip(quantities, rows, strict=True)
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def dataframe(rows: Sequence[Mapping[str, Any]] | Mapping[Any, Any]) -> DataFrame:
    """Rows, or columns by their names, as a DataFrame of pandas."""
    require("pandas", what="a DataFrame", otherwise="use to_dict()")
    from pandas import DataFrame

    return DataFrame(rows if isinstance(rows, Mapping) else list(rows))


def _rows(quantities: Iterable[Quantity], dies: bool) -> list[tuple[str, ...]]:
    """Cells under their headings; numbers that are alike but for their file have its name."""
    every = list(quantities)
    shown = [name for name in _COLUMNS if dies or name != "die"]
    rows = [{name: _COLUMNS[name](quantity) for name in shown} for quantity in every]
    alike = Counter((row["quantity"], row["at"], quantity.die) for row, quantity in zip(rows, every, strict=True))
    for row, quantity in zip(rows, every, strict=True):
        if alike[row["quantity"], row["at"], quantity.die] > 1 and (file := _FILE.search(quantity.method)):
            row["at"] = " ".join(filter(None, (row["at"], file[0])))
    return [tuple(shown), *(tuple(row.values()) for row in rows)]


def _value(quantity: Quantity) -> str:
    """With the digits that its error allows, or six where none is known."""
    value = quantity.value
    if isinstance(value, float) and quantity.uncertainty and abs(value) >= _NOTHING:
        text, error = value_and_error(value, quantity.uncertainty, quantity.unit, 6)
        return f"{value:.6g}" if error == EXACT else _plain(text)
    return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def _error(quantity: Quantity) -> str:
    _, error = value_and_error(quantity.value, quantity.uncertainty, quantity.unit)
    return error if error in ("", EXACT) else f"± {_plain(error)}"


def _plain(text: str) -> str:
    mantissa, power, exponent = text.replace("\u202f", "").replace("−", "-").partition(" × 10")
    if not power and mantissa.startswith("10") and mantissa[2:].translate(_PLAIN) != mantissa[2:]:
        mantissa, exponent = "1", mantissa[2:]
    return f"{mantissa}e{int(exponent.translate(_PLAIN)):+03d}" if exponent else mantissa


_FILE = re.compile(r"[\w-]+\.[a-z][a-z0-9]{2}\b")
"""Name of a mask file in the method of a number."""
_COLUMNS: Mapping[str, Callable[[Quantity], str]] = {
    # A detail of the unit is told by the unit.
    "quantity": lambda q: f"{q.name} ({q.detail})" if q.detail and q.detail in q.symbol else q.name,
    "die": lambda q: q.die or "",
    "at": lambda q: ", ".join(
        f"{value:g} {unit}" for value, unit in ((q.wavelength_nm, "nm"), (q.level_db, "dB")) if value is not None
    ),
    "value": lambda q: f"{'≤ ' if q.at_most else ''}{_value(q)}",
    "error": _error,
    "unit": lambda q: q.unit,
    "limit": lambda q: "" if q.passed is None else f"{'pass' if q.passed else 'FAIL'} ({q.limit})",
}


_EVERY_ROW = ("name", "symbol", "value", "unit", "uncertainty", "method", "limit", "passed")


def quantity_document(quantity: Quantity) -> dict[str, Any]:
    """One quantity as report.json writes it."""
    rare = {
        "wavelength_nm": quantity.wavelength_nm,
        "level_db": quantity.level_db,
        "at_most": quantity.at_most or None,
        "between": quantity.between and list(quantity.between),
        "die": quantity.die,
    }
    row = {key: getattr(quantity, key) for key in _EVERY_ROW}
    return row | {key: value for key, value in rare.items() if value is not None}


QUICK = "openings are compared by the mean over all random tilings, estimated without the cells that the stop cuts"
"""In what an opening's PSNR differs from that of its panel, which has a map."""
USEFUL_DB = 1.0
"""Headroom above which nothing is told of it: openings, rules and maps are decided by less."""


def designed_lines(designed: Designed, notes: Sequence[str]) -> list[str]:
    """The opening, its bound, what the rules cost, the map, and the notes."""
    from maskfab.designs.rules.families import explained

    cells = designed.designed
    psnr = _levels(designed, designed.psnr if cells is None else cells.psnr)
    lines = [f"{designed.shape}: {designed.opening.clear_dots} clear dots, expected restored PSNR {psnr}"]
    lines[0] += "" if cells is None else ", with its map"
    lines += filter(None, [explained(designed.opening.dot_nm / NM_PER_UM, designed.shape)])
    if designed.shortfall is not None:
        lines.insert(0, designed.shortfall.told)
    lines.append(f"for {designed.camera}")
    if designed.scene is not None:
        lines += _scene_lines(designed, designed.scene)
    focus = "" if designed.scene is None else ", in focus"
    if designed.head_room is not None and (most := _most(designed, designed.head_room)):
        lines.append(f"proven headroom (frame interior{focus}): {most}")
    if designed.gap is not None:
        limit, part = designed.gap.bounds, f"(frame interior{focus})"
        lines.append(f"grey filter of the same transmission: {_levels(designed, limit.grey)} {part}")
        lines.append(f"unobstructed stop with the same open area: {_levels(designed, limit.open_stop)} {part}")
        most = "" if limit.auc is None else f" of at most {limit.auc:.4f}"
        lines.append(f"area under the radial minimum of the blue MTF: {designed.gap.auc:.4f}{most}")
    if designed.prices is not None and designed.prices.each:
        lines.append(
            f"all rules together cost {_db(designed.prices.together)} ({designed.evaluated} openings evaluated)"
        )
        lines += [
            f"  {price.rule}: {_db(price.alone)} if it is the only rule, {_db(price.last)} on top of the others"
            for price in designed.prices.each
        ]
    else:
        lines.append(f"{designed.evaluated} openings evaluated")
    if cells is not None:
        gained = told_gains(by_level(designed.levels, cells.psnr), by_level(designed.levels, cells.start_psnr))
        gains, start = _levels(designed, list(gained.values()), "+"), _levels(designed, cells.start_psnr)
        light = cells.clear_dots / cells.start_clear_dots - 1
        lines.append(f"gain of the designed map over a random one: {gains}, from {start}; transmission {light:+.2%}")
        if designed.outer is None:
            lines.append(f"{QUICK}: {_levels(designed, designed.psnr)}")
    if designed.map_head_room is not None and (most := _most(designed, designed.map_head_room)):
        lines.append(f"proven headroom of the map (frame interior, same transmission of every cell): {most}")
    if designed.robust is not None:
        lines += _robust_lines(designed, designed.robust)
    if designed.fit is not None:
        lines += _fit_lines(designed.fit, designed.cells)
    return [*lines, *(f"note: {note}" for note in notes)]


def _fit_lines(fit: DieFit, cells: CellMap | None) -> list[str]:
    size = f"{fit.across} x {fit.across} pixels, {fit.side_um / UM_PER_MM:g} mm"
    if cells is not None and cells.beyond is not None:
        drawn = "regular beyond its map, whatever its seed"
    else:
        drawn = f"with seed {fit.seed} {'of its tiling' if cells is None else 'beyond its map'}"
    lines = [f"the display fits a die of {size}, {drawn} (checked in {fit.seconds:.1f} s of processor)"]
    if fit.failed:
        tried = ", ".join(map(str, fit.failed))
        lines.append(
            f"  state seed = {fit.seed} in its [[die]]: with seed {tried} it does not fit, {fit.first_failure}"
        )
    return lines


def _robust_lines(designed: Designed, robust: Robustness) -> list[str]:
    lines = []
    if robust.tiling is not None:
        lines.append(
            f"one random tiling differs from another by {_levels(designed, robust.tiling)} (standard deviation)"
        )
    for away, gains in robust.off_centre.items():
        where = f"with the stop {away:g} um off its centre" if away else "over the mean of random tilings"
        lines.append(f"gain of the designed map {where}: {_levels(designed, gains, '+')}")
    if robust.bias is not None:
        bias, (narrow, wide) = robust.bias, robust.bias.psnr
        lines.append(f"panel as drawn: {_levels(designed, robust.psnr)}")
        lines.append(f"clear features narrower by {bias.deviation_um:g} um: {_levels(designed, narrow)}")
        lines.append(f"clear features wider by {bias.deviation_um:g} um: {_levels(designed, wide)}")
        lines.append(f"expected loss over that bias: {_losses(designed, bias)}")
    if robust.centre is not None:
        away = robust.centre.deviation_um
        lines.append(f"expected loss with the stop's centre off by {away:g} um: {_losses(designed, robust.centre)}")
    return lines


def _scene_lines(designed: Designed, scene: SceneDesign) -> list[str]:
    from maskfab.findings.scene import distance
    from maskfab.optics.gap import AXIS

    seen, panel = scene.seen, scene.panel
    lines = [f"this panel over the scene (modelled: {', '.join(seen.modelled)}): {_levels(designed, panel.mean)}, mean"]
    for condition, psnr in zip(panel.conditions, panel.psnr, strict=True):
        x, y = condition.image_um
        place = "on the axis" if condition.image_um == AXIS else f"{x:.0f} um right and {y:.0f} um down from the axis"
        lines.append(
            f"  at {distance(condition.object_um)}, {place} ({condition.weight:.1%}): {_levels(designed, psnr)}"
        )
    if scene.random is not None:
        gains = [ours - random for ours, random in zip(panel.mean, scene.random.mean, strict=True)]
        lines.append(f"gain of the designed map over a random one, over the scene: {_levels(designed, gains, '+')}")
    return lines


def _losses(designed: Designed, varied: Varied) -> str:
    """To a thousandth of a decibel: most are smaller than what others are rounded to."""
    return ", ".join(
        f"{value + 0.0:.3f} dB at {level}" for level, value in by_level(designed.levels, varied.loss).items()
    )


def told_gains(with_it: Mapping[str, float], without: Mapping[str, float]) -> dict[str, float]:
    """Differences in dB of what is told to two decimals, so that all three add up as they are told."""
    return {level: round(value, 2) - round(without[level], 2) + 0.0 for level, value in with_it.items()}


def by_level(levels: Sequence[float], values: Sequence[float]) -> dict[str, float]:
    """Values by the level of light that they hold at, in dB as text."""
    return {f"{level:g}": value for level, value in zip(levels, values, strict=True)}


def _most(designed: Designed, values: Sequence[float]) -> str:
    by = by_level(designed.levels, values).items()
    return ", ".join(f"at most {value:.2f} dB at {level}" for level, value in by if value <= USEFUL_DB)


def _levels(designed: Designed, values: Sequence[float], sign: str = "") -> str:
    return ", ".join(f"{value:{sign}.2f} dB at {level}" for level, value in by_level(designed.levels, values).items())


def _db(value: float) -> str:
    return f"{value:.3f} dB" if math.isfinite(value) else "everything: no opening evaluated meets it"
