"""Quantities as people read them: a table, a look-up by name and wavelength, a dictionary, a DataFrame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, overload

from maskfab.errors import OutputError, UnknownNameError
from maskfab.model import Quantity

if TYPE_CHECKING:
    from pandas import DataFrame

_COLUMNS: Mapping[str, Callable[[Quantity], str]] = {
    # A detail of the unit is told by the unit.
    "quantity": lambda q: f"{q.name} ({q.detail})" if q.detail and q.detail in q.symbol else q.name,
    "die": lambda q: q.die or "",
    "line": lambda q: "" if q.wavelength_nm is None else f"{q.wavelength_nm:g} nm",
    "value": lambda q: f"{'≤ ' if q.at_most else ''}{_value(q.value)}",
    "error": lambda q: f"± {q.uncertainty:.1e}" if q.uncertainty else "",
    "unit": lambda q: q.unit,
    "limit": lambda q: "" if q.passed is None else f"{'pass' if q.passed else 'FAIL'} ({q.limit})",
}


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
        found = [quantity for quantity in alike if at is None or at in (quantity.wavelength_nm, quantity.level_db)]
        if len(found) == 1:
            return found[0]
        places = ", ".join(f"{p:g}" for q in alike for p in (q.wavelength_nm, q.level_db) if p is not None)
        problem = f"stands {len(found)} times in these results" if found else f"is not given at {at!r}"
        raise UnknownNameError(
            "MF432",
            f"{name!r} {problem}",
            cure=f'Ask for numbers["{name}", one of {places}]' if places else f"Look for {name!r} in the whole list",
        )

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
        """One row for each number, as report.json has it.

        Raises:
            OutputError: MF431 without pandas.
        """
        return dataframe(self.to_dict())

    def __str__(self) -> str:
        dies = len({quantity.die for quantity in self._all}) > 1
        judged = [quantity for quantity in self._all if quantity.passed is not None]
        verdict = [
            f"{'PASS' if self.passed else 'FAIL'}: {sum(map(_passes, judged))} of {len(judged)} checks pass"
        ] * bool(judged)
        return "\n".join([*table_lines(self._all, dies=dies), *verdict])

    def __repr__(self) -> str:
        return f"<Quantities: {len(self._all)} numbers, {'pass' if self.passed else 'fail'}>"

    def _repr_html_(self) -> str:
        return html_table(self._all)


def _passes(quantity: Quantity) -> bool:
    return quantity.passed is True


def table_lines(quantities: Iterable[Quantity], *, dies: bool = False) -> list[str]:
    """A heading and one line for each quantity, in columns; with the name of its die if ``dies``."""
    rows = _rows(quantities, dies)
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


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


def dataframe(rows: Sequence[Mapping[str, Any]]) -> DataFrame:
    """Rows as a DataFrame of pandas.

    Raises:
        OutputError: MF431 without pandas.
    """
    try:
        from pandas import DataFrame
    except ImportError as error:
        raise OutputError(
            "MF431",
            "a DataFrame needs pandas, which is not installed",
            cure="Run pip install 'maskfab[pandas]', or use to_dict()",
        ) from error
    return DataFrame(list(rows))


def _rows(quantities: Iterable[Quantity], dies: bool) -> list[tuple[str, ...]]:
    shown = [name for name in _COLUMNS if dies or name != "die"]
    return [tuple(shown), *(tuple(_COLUMNS[name](each) for name in shown) for each in quantities)]


def _value(value: object) -> str:
    return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def quantity_document(quantity: Quantity) -> dict[str, Any]:
    """One quantity as report.json writes it."""
    row: dict[str, Any] = {
        "name": quantity.name,
        "symbol": quantity.symbol,
        "value": quantity.value,
        "unit": quantity.unit,
        "uncertainty": quantity.uncertainty,
        "method": quantity.method,
        "limit": quantity.limit,
        "passed": quantity.passed,
    }
    if quantity.wavelength_nm is not None:
        row["wavelength_nm"] = quantity.wavelength_nm
    if quantity.level_db is not None:
        row["level_db"] = quantity.level_db
    if quantity.at_most:
        row["at_most"] = True
    if quantity.between is not None:
        row["between"] = list(quantity.between)
    if quantity.die is not None:
        row["die"] = quantity.die
    return row
