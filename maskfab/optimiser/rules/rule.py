"""One rule of an opening: everything that the machine knows of it, in one object."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic.fields import FieldInfo

from maskfab.base.arrays import Mask
from maskfab.display.emitters.placement import Certificate
from maskfab.errors import JobError
from maskfab.jobfile.section import Section
from maskfab.jobfile.sections import DesignSection, RulesSection

if TYPE_CHECKING:
    from maskfab.optimiser.rules.constraints import Constraints


_PRICE = "price_", "_db"


@dataclass(frozen=True)
class Conflict:
    """Rules that no opening keeps together.

    Attributes:
        rules: their names; without any of them this proof falls.
        statement: why, with the numbers.
        certificate: what the layout's own bound says; None where counting is enough.
    """

    rules: tuple[str, ...]
    statement: str
    certificate: Certificate | None = None


def as_stated(value: Any, section: DesignSection, where: str) -> Any:
    """The value that a rule has if nothing is made of its key."""
    return value


def as_given(constraints: Constraints, value: Any) -> Any:
    """The value of a rule that has nothing to check but its range."""
    return value


@dataclass(frozen=True)
class Rule:
    """A rule of an opening, beside the count of its clear dots.

    Its form, range, default and meaning are those of its key in [design.rules], which stand in the job's section. The
    functions are given the constraints that the rule is one of, in which ``constraints[name]`` is its value; only a
    rule whose value differs from the default is asked anything.

    Attributes:
        name: its key.
        unit: of its value; empty for a word or a drawing.
        check: what the opening, bool [dots, dots], breaks and by how much; None if it keeps the rule.
        quick: the same for the search, and no laxer; None where ``check`` is quick enough.
        proof: that no opening keeps the rule, by itself or with others; its docstring says when. None where that is
            only found by looking.
        free: dots that may be clear, bool [dots, dots]: no search opens others. None for all.
        linked: sets of dots, as flat indices, that are clear or closed together: a search changes whole sets.
        beside: whether openings [units, dots, dots], any of which may be the neighbour of any, break it where they
            meet.
        one_place: whether it is proved for cells that all hold the opening at the same place only.
        counted: it and the count of clear dots contradict each other by counting dots (MF204).
        slow: takes milliseconds to judge rather than microseconds.
        read: value from that of the key, the section and the place for errors.
        checked: value from the one that was given, refused if it does not suit the cell.
        section: the table of the job that has its key.
        key: in that table, where several rules have one; its name if left out.
        asker: what of the job asks for it, where that is more than its key.
    """

    name: str
    unit: str
    check: Callable[[Constraints, Mask], str | None]
    quick: Callable[[Constraints, Mask], str | None] | None = None
    proof: Callable[[Constraints], Conflict | None] | None = None
    free: Callable[[Constraints], Mask] | None = None
    linked: Callable[[Constraints], Sequence[NDArray[np.intp]]] | None = None
    beside: Callable[[Constraints, Mask], bool] | None = None
    one_place: Callable[[Constraints], bool] = lambda _: False
    counted: bool = False
    slow: bool = False
    read: Callable[[Any, DesignSection, str], Any] = as_stated
    checked: Callable[[Constraints, Any], Any] = as_given
    section: type[Section] = RulesSection
    key: str = ""
    asker: str = ""

    @property
    def stated(self) -> FieldInfo:
        """The field of the job that asks for it."""
        return self.section.model_fields[self.key or self.name]

    @property
    def default(self) -> Any:
        """The value that asks for nothing."""
        return self.stated.default

    @property
    def told(self) -> str:
        """Its name where no opening keeps it."""
        return self.asker or self.name

    @property
    def where(self) -> str:
        """Its key in a job."""
        return (
            f"design.rules.{self.name}" if issubclass(self.section, RulesSection) else f"design.{self.key or self.name}"
        )

    @property
    def refused_if(self) -> str:
        """When no opening keeps it, by its proof; empty where that is only found by looking."""
        return "" if self.proof is None else inspect.getdoc(self.proof) or ""

    @property
    def range(self) -> tuple[float, float] | None:
        """Least and largest value; None for a rule that is no number."""
        limits = self.stated.metadata
        least, most = (
            [float(getattr(each, end)) for each in limits for end in ends if hasattr(each, end)]
            for ends in (("ge", "gt"), ("le", "lt"))
        )
        return (least[0], most[0] if most else math.inf) if least else None

    @property
    def words(self) -> tuple[str, ...]:
        """Those that it may be; empty for a rule that is no word."""
        kind = self.stated.annotation
        return next((get_args(each) for each in (kind, *get_args(kind)) if get_origin(each) is Literal), ())

    def value(self, constraints: Constraints, given: Any) -> Any:
        """The value that constraints hold, from the one that they were given.

        Raises:
            JobError: MF104 for a number out of range, MF105 for a word that is none of its key's, and as ``checked``.
        """
        if self.words and given not in self.words:
            what = f"{self.name} = {given!r} is not a rule"
            raise JobError("MF105", what, where=self.where, cure=f"Use {', '.join(self.words)}")
        if (limits := self.range) is not None and not limits[0] <= given <= limits[1]:
            raise out_of_range(self.name, given, *limits, where=self.where)
        return self.checked(constraints, given)

    def asks(self, value: Any) -> bool:
        """Whether a value asks for something."""
        return value is not None and (isinstance(value, np.ndarray) or bool(value != self.default))


def out_of_range(name: str, value: float, low: float, high: float, *, where: str) -> JobError:
    """MF104 for a number of a design."""
    what = f"{name} = {value} must lie between {low:g} and {high:g}"
    return JobError("MF104", what, where=where, cure=f"Choose {name} in that range")


def price_key(rule: str) -> str:
    """Key of a rule's price in the provenance of an opening."""
    return rule.join(_PRICE)


def priced_rule(key: str) -> str | None:
    """The rule whose price stands under a key of a provenance; None for any other key."""
    start, end = _PRICE
    return key[len(start) : -len(end)] if key.startswith(start) and key.endswith(end) else None
