"""Blanks of an order to a house, asked line by line, and written into its job.

JobSpec + Plate + Shop -> OrderForm -> answers, each checked as it is given -> lines of the job file.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, get_args

from maskfab.errors import JobError, SourceError
from maskfab.files.atomic import partial
from maskfab.jobfile import JobSpec, parse_section, validate
from maskfab.jobfile import read as read_spec
from maskfab.jobfile.checks import check_order
from maskfab.jobfile.insertion import inserted
from maskfab.jobfile.order import Film, Glass, OrderSection, Protection, Touches
from maskfab.jobfile.shop_profile import Shop
from maskfab.jobfile.toml import loads
from maskfab.mask_shops.adapt import fitted
from maskfab.mask_shops.judge import Finding, corner_touches
from maskfab.mask_shops.offers import check_offers
from maskfab.mask_shops.order import Answer, Order, order_of
from maskfab.model import Plate

_KINDS: Mapping[str, tuple[str, ...]] = {
    "glass": get_args(Glass),
    "film": get_args(Film),
    "protection": get_args(Protection),
    "corner_touches": get_args(Touches),
}
_HINTS: Mapping[str, str] = {
    "quantity": "a whole number",
    "thickness": 'a length such as "2.3 mm"',
    "corner_width": 'of the neck or the gap there, such as "2 um"',
    "contact.name": "whom the house asks",
    "contact.organisation": "firm or institute that pays",
    "contact.address": "to which the plate is sent, in one line",
    "contact.email": "address of mail",
}


@dataclass(frozen=True)
class Question:
    """A line of an order that nobody has answered.

    Attributes:
        key: in [order], such as ``contact.name``.
        label: for people.
        choices: answers that there are; empty where any text or number may be.
        hint: to an answer without choices.
    """

    key: str
    label: str
    choices: tuple[str, ...]
    hint: str

    def __str__(self) -> str:
        return f"{self.label} ({' | '.join(self.choices) or self.hint})"


@dataclass(frozen=True, eq=False)
class OrderForm:
    """An order as far as it is filled in for a house.

    Attributes:
        spec: of the job.
        plate: laid out of it.
        shop: whom it is for.
        touches: places of the plate at which clear shapes meet by a corner only.
    """

    spec: JobSpec
    plate: Plate
    shop: Shop
    touches: int

    @classmethod
    def of(cls, spec: JobSpec, plate: Plate, shop: Shop) -> OrderForm:
        """The form of a job; its plate is drawn as a package would hold it, for corners that meet."""
        return cls(spec, plate, shop, corner_touches(fitted(plate, shop, spec.tone)))

    @property
    def order(self) -> Order:
        return order_of(self.spec, self.plate, self.shop, self.touches)

    @property
    def questions(self) -> tuple[Question, ...]:
        """Lines without an answer, in the order of the sheet."""
        return tuple(self._question(each) for each in self.order.missing)

    @property
    def refused(self) -> tuple[Finding, ...]:
        """Wishes that the house does not offer."""
        return tuple(each for each in check_offers(self.spec, self.plate, self.shop) if each.passed is False)

    def _question(self, line: Answer) -> Question:
        glasses, films, protections = self.shop.offers.glasses, self.shop.offers.films, self.shop.offers.protections
        offered = {"glass": glasses, "film": films, "protection": protections}.get(line.key)
        hint, sides = _HINTS.get(line.key, ""), self.shop.plate.glass_mm
        if line.key == "thickness" and sides is not None:
            hint = f'"{sides[0]:g} mm" to "{sides[1]:g} mm"'
        label = line.label
        if line.key == "corner_touches":
            label = f"clear shapes meet by a corner only in {self.touches} places; they must"
        return Question(line.key, label, offered or _KINDS.get(line.key, ()), hint)

    def answered(self, key: str, text: str, where: str = "") -> OrderForm:
        """The form with one more line.

        Args:
            key: in [order].
            text: of the answer, as it is typed.
            where: whence it comes, for errors.

        Raises:
            JobError: MF102 to MF110 for an answer that no job may hold, MF105 for a key that has one, MF128 for one
                that contradicts the job or that the house does not offer.
        """
        stated = {} if self.spec.order is None else self.spec.order.model_dump(mode="json", exclude_none=True)
        section = _section_with(stated, key.split("."), text, where or f"order.{key}")
        spec = self.spec.model_copy(update={"order": section})
        check_order(spec, where or "the answer")
        form = OrderForm(spec, self.plate, self.shop, self.touches)
        rules = (f"order_{key.replace('.', '_')}", f"order_{key.partition('.')[0]}")
        for each in form.refused:
            if each.rule in rules:
                what = f"{self.shop.name} offers {each.limit} {each.unit}".rstrip() + f", not {each.value}"
                raise JobError("MF128", what, where=where, cure=each.cure)
        if key == "tone" and section.tone not in self.shop.order.tones:
            tones = " and ".join(self.shop.order.tones)
            raise JobError("MF128", f"{self.shop.name} writes data that are {tones}", where=where, cure=f"Set {tones}")
        return form


def _section_with(stated: Mapping[str, Any], path: list[str], text: str, where: str) -> OrderSection:
    """[order] with one more value: the text itself, or the number that it writes where a number is meant."""
    values: dict[str, Any] = {key: dict(each) if isinstance(each, dict) else each for key, each in stated.items()}
    table: Any = values
    for name in path[:-1]:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise JobError("MF105", f"order.{path[0]} has no parts", where=where, cure=f"Set {path[0]} itself")
    if path[-1] in table:
        what = f"order.{'.'.join(path)} is stated already: {table[path[-1]]}"
        raise JobError("MF105", what, where=where, cure="Change it in the job itself")
    problems = []
    for value in _meanings(text):
        table[path[-1]] = value
        try:
            return parse_section(OrderSection, values, where=where)
        except JobError as error:
            problems.append(error)
    # A number out of its range is a number; else what is wrong is wrong with the text.
    raise next((each for each in problems if each.code == "MF104"), problems[0])


def _meanings(text: str) -> Iterator[str | int | float]:
    yield text
    for kind in (int, float):
        with suppress(ValueError):
            yield kind(text)


def write_answers(path: Path, answers: Mapping[str, str], form: OrderForm, shop: str, day: date) -> tuple[str, ...]:
    """Put answers into a job file, and the day and the house where the job names none; nothing else in it changes.

    Args:
        path: of the job, a TOML file.
        answers: to keys of [order], as they were typed; the form has them already.
        form: that they filled in.
        shop: the house, as the job is to name it.
        day: of the order.

    Returns:
        The keys that were written, with their tables.

    Raises:
        SourceError: MF308 for a job that is no TOML file.
        JobError: as :func:`maskfab.jobfile.insertion.inserted`; and as for a job, were it wrong with its new lines.
        OutputError: MF401 if the file cannot be written.
    """
    if path.suffix != ".toml":
        raise SourceError("MF308", f"{path} is no TOML file, into which lines can be put", cure="Name a job in TOML")
    said = (form.spec.order or OrderSection()).model_dump(mode="json", exclude_none=True)
    values: dict[str, object] = {
        f"order.{key}": _as_written(said, key.split("."), text) for key, text in answers.items()
    }
    if "date" not in said:
        values["order.date"] = day
    known = read_spec(path)
    if known.export is None or known.export.shop is None:
        values["export.shop"] = shop
    longer = path.read_bytes().decode("utf-8")
    for key, value in values.items():
        longer = inserted(longer, key, value, where=str(path))
    validate(loads(longer.removeprefix("\ufeff")), where=str(path))
    with partial(path) as aside:
        aside.write_bytes(longer.encode())
        shutil.copymode(path, aside)
    return tuple(values)


def _as_written(said: Any, path: list[str], text: str) -> str | int | float:
    """A number as such, and all else as it was typed."""
    for name in path:
        said = said[name]
    return text.strip() if isinstance(said, str) else said
