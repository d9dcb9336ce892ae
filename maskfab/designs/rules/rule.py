"""Rules of an opening, each with everything that the machine knows of it in one object; those of a display have a file.

Which dots may be clear: a drawing of those that stay closed, a closed rim, a symmetry. Widths and spaces, which the
mask writer sets: corners, clear runs, closed runs. Symmetric ports: where lines cross a cell so that they meet those of
any neighbour, however it is turned.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args, get_origin

import numpy as np
from pydantic.fields import FieldInfo

from maskfab.base.arrays import Indices, Mask
from maskfab.base.errors import JobError
from maskfab.base.model import Opening, frozen
from maskfab.designs.rules.families import orbits, sums
from maskfab.display.emitter_rules import Certificate
from maskfab.display.pixel_lines import ports
from maskfab.job.sections import DesignSection, RulesSection
from maskfab.job.values import Section
from maskfab.mask.dots import corner_touches, smallest_runs

_PRICE = "price_", "_db"


@dataclass(frozen=True)
class Conflict:
    """Rules that no opening keeps together.

    Attributes:
        rules: their names; without any of them this proof falls.
        certificate: what the layout's own bound says; None where counting is enough.
    """

    rules: tuple[str, ...]
    statement: str
    certificate: Certificate | None = None


class Constrained(Protocol):
    """Constraints as the rules read them that they are made of; :class:`maskfab.designs.rules.constraints.Constraints`
    says what each part is."""

    @property
    def clear_dots(self) -> int: ...
    @property
    def dots(self) -> int: ...
    @property
    def gutter_nm(self) -> int: ...
    @property
    def dot_nm(self) -> int: ...
    @property
    def orientations(self) -> tuple[int, ...]: ...
    @property
    def orbits(self) -> tuple[Indices, ...]: ...
    @property
    def members(self) -> list[Indices]: ...
    @property
    def closing(self) -> tuple[str, ...]: ...
    @property
    def nothing(self) -> Mask: ...
    def __getitem__(self, rule: str) -> Any: ...
    def opening(self, unit: Mask) -> Opening: ...
    def turned(self, units: Mask) -> Mask: ...


@dataclass(frozen=True)
class Rule:
    """A rule of an opening, beside the count of its clear dots.

    Its form, range, default and meaning are those of its key in [design.rules], which stand in the job's section. The
    functions are given the constraints that the rule is one of, in which ``constraints[name]`` is its value; only a
    rule whose value differs from the default is asked anything.

    Attributes:
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
        key: in that table, where several rules have one; its name if left out.
        asker: what of the job asks for it, where that is more than its name.
    """

    name: str
    unit: str
    check: Callable[[Constrained, Mask], str | None]
    quick: Callable[[Constrained, Mask], str | None] | None = None
    proof: Callable[[Constrained], Conflict | None] | None = None
    free: Callable[[Constrained], Mask] | None = None
    linked: Callable[[Constrained], Sequence[Indices]] | None = None
    beside: Callable[[Constrained, Mask], bool] | None = None
    one_place: Callable[[Constrained], bool] = lambda _: False
    counted: bool = False
    slow: bool = False
    read: Callable[[Any, DesignSection, str], Any] = lambda value, section, where: value
    checked: Callable[[Constrained, Any], Any] = lambda constraints, value: value
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
    def where(self) -> str:
        """Its key in a job."""
        table = "design.rules" if issubclass(self.section, RulesSection) else "design"
        return f"{table}.{self.key or self.name}"

    @property
    def refused_if(self) -> str:
        """When no opening keeps it, by its proof; empty where that is only found by looking."""
        return "" if self.proof is None else inspect.getdoc(self.proof) or ""

    @property
    def range(self) -> tuple[float, float] | None:
        """Least and largest value; None for a rule that is no number."""
        limits = self.stated.metadata
        least, most = (
            [float(getattr(limit, end)) for limit in limits for end in ends if hasattr(limit, end)]
            for ends in (("ge", "gt"), ("le", "lt"))
        )
        return (least[0], most[0] if most else math.inf) if least else None

    @property
    def words(self) -> tuple[str, ...]:
        """Words that it may be; empty for a rule that is no word."""
        form = self.stated.annotation
        return next((get_args(part) for part in (form, *get_args(form)) if get_origin(part) is Literal), ())

    def value(self, constraints: Constrained, given: Any) -> Any:
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


def _kept_out(drawing: Any, section: DesignSection, where: str) -> Mask | None:
    """Dots that stay closed, row 0 the lowest; MF105 for anything but ``dots`` rows of as many x and dots."""
    if drawing is None:
        return None
    rows, dots = drawing.split(), section.dots
    if len(rows) != dots or any(len(row) != dots or set(row) - {"x", "."} for row in rows):
        what = f"the drawing is not {dots} rows of {dots} signs, each x or ."
        cure = "Draw the cell, the top row first: x stays closed, . is free"
        raise JobError("MF105", what, where=f"{where}.rules.keep_out", cure=cure)
    return np.array([[sign == "x" for sign in row] for row in reversed(rows)])


def _of_the_cell(constraints: Constrained, given: Any) -> Mask:
    drawing = np.asarray(given, dtype=np.bool_)
    if drawing.shape != (constraints.dots, constraints.dots):
        what = f"the keep-out is {drawing.shape}, the cell {constraints.dots} x {constraints.dots} dots"
        raise JobError("MF105", what, where=KEEP_OUT.where, cure="Give one value per dot")
    return frozen(drawing)


def _in_keep_out(constraints: Constrained, unit: Mask) -> str | None:
    inside = int((unit & constraints["keep_out"]).sum())
    return f"{inside} clear dots where none may be" if inside else None


def _inside_rim(constraints: Constrained) -> Mask:
    rim, dots = constraints["rim_dots"], constraints.dots
    inside = np.zeros((dots, dots), dtype=np.bool_)
    inside[rim : dots - rim, rim : dots - rim] = True
    return inside


def _in_rim(constraints: Constrained, unit: Mask) -> str | None:
    inside = int((unit & ~_inside_rim(constraints)).sum())
    return f"{inside} clear dots within {constraints['rim_dots']} of a side" if inside else None


def _orbits(constraints: Constrained) -> tuple[Indices, ...]:
    return orbits(constraints.dots, constraints["symmetry"])


def _uneven(constraints: Constrained, unit: Mask) -> str | None:
    flat = unit.ravel()
    uneven = sum(len(set(flat[orbit].tolist())) > 1 for orbit in constraints.orbits)
    return f"{uneven} sets of dots differ from their images under {constraints['symmetry']}" if uneven else None


def _by_orbits(constraints: Constrained) -> Conflict | None:
    """The sets of dots that the symmetry maps onto each other never sum to the count."""
    wanted, symmetry = constraints.clear_dots, constraints["symmetry"]
    reached = sums([len(orbit) for orbit in constraints.members])[-1]
    if reached >> wanted & 1:
        return None
    below = (reached & ((1 << wanted) - 1)).bit_length() - 1
    above = next((k for k in range(wanted + 1, constraints.dots**2 + 1) if reached >> k & 1), None)
    nearest = f"{below}" if above is None else f"{below} and {above}"
    return Conflict(
        ("clear_dots", "symmetry", *constraints.closing),
        f"sets of dots that {symmetry} maps onto each other never sum to {wanted}; the nearest counts are {nearest}",
    )


KEEP_OUT = Rule(
    "keep_out",
    "",
    _in_keep_out,
    free=lambda constraints: ~constraints["keep_out"],
    counted=True,
    read=_kept_out,
    checked=_of_the_cell,
)
RIM = Rule("rim_dots", "dots", _in_rim, free=_inside_rim, counted=True)
SYMMETRY = Rule("symmetry", "", _uneven, proof=_by_orbits, linked=_orbits, counted=True)


def _kisses(constraints: Constrained, unit: Mask) -> str | None:
    if inside := corner_touches(unit):
        return f"{inside} corners touch inside the cell"
    touch = _kiss_beside(constraints, unit[None])
    return "corners of neighbouring cells can touch" if touch else None


def _among_neighbours(constraints: Constrained) -> bool:
    return bool(constraints["kissing"] == "neighbours")


def _kiss_beside(constraints: Constrained, units: Mask) -> bool:
    """Whether cells of these openings, any beside any, can touch at corners along a border or where four meet."""
    if constraints.gutter_nm > 0 or not _among_neighbours(constraints):
        return False
    turned = constraints.turned(units)
    for here, there in ((turned[:, :, -1], turned[:, :, 0]), (turned[:, -1], turned[:, 0])):
        low, high = here[:, None, :-1], here[:, None, 1:]
        across_low, across_high = there[None, :, :-1], there[None, :, 1:]
        rising = low & across_high & ~high & ~across_low
        falling = high & across_low & ~low & ~across_high
        if bool((rising | falling).any()):
            return True
    # Around a vertex: lower left, lower right, upper left and upper right cell, with the corner each has there.
    corners = [set(turned[:, y, x].tolist()) for y, x in ((-1, -1), (-1, 0), (0, -1), (0, 0))]
    crossings = (True, False, False, True), (False, True, True, False)
    return any(all(value in corner for value, corner in zip(four, corners, strict=True)) for four in crossings)


def _narrow(constraints: Constrained, unit: Mask) -> str | None:
    least, wanted = smallest_runs(unit).clear, constraints["min_feature_dots"]
    return f"a clear width of {least:g} dots, least {wanted}" if least < wanted else None


def _by_width(constraints: Constrained) -> Conflict | None:
    """No opening of the count is so wide everywhere, or the cell is narrower."""
    least, count, dots = constraints["min_feature_dots"], constraints.clear_dots, constraints.dots
    if count and least > dots:
        return Conflict(("min_feature_dots",), f"a clear width of {least} dots in a cell of {dots} x {dots}")
    # A row that is not closed holds a run, hence `least` columns of runs, hence `least` rows of `least` dots; any
    # further row or column adds a run.
    if 0 < count < least**2 or least**2 < count < least * (least + 1):
        return Conflict(
            ("clear_dots", "min_feature_dots"),
            f"openings of no width below {least} dots have {least**2}, or at least {least * (least + 1)} clear "
            f"dots, not {count}",
        )
    return None


def _close(constraints: Constrained, unit: Mask) -> str | None:
    least, wanted = min(smallest_runs(unit).opaque, _space(constraints, unit[None])), constraints["min_space_dots"]
    return f"a space of {least:g} dots, least {wanted}" if least < wanted else None


def _close_beside(constraints: Constrained, units: Mask) -> bool:
    return bool(_space(constraints, units) < constraints["min_space_dots"])


def _space(constraints: Constrained, units: Mask) -> float:
    """Least closed run in dots that crosses a border between cells [kinds, dots, dots]; inf where there is none."""
    turned, gutter = constraints.turned(units), constraints.gutter_nm / constraints.dot_nm
    least = math.inf
    for cells in (turned, turned.transpose(0, 2, 1)):
        used = cells.any(axis=2)
        first = np.where(used, cells.argmax(axis=2), np.inf)
        last = np.where(used, cells[:, :, ::-1].argmax(axis=2), np.inf)
        runs = last[:, None] + gutter + first[None]
        least = min(least, float(runs[runs > 0].min(initial=np.inf)))
    return least


KISSING = Rule("kissing", "", _kisses, beside=_kiss_beside, one_place=_among_neighbours)
FEATURE = Rule("min_feature_dots", "dots", _narrow, proof=_by_width, counted=True)
SPACE = Rule("min_space_dots", "dots", _close, beside=_close_beside, one_place=lambda _: True)


def _few_ports(constraints: Constrained, unit: Mask) -> str | None:
    wanted = constraints["ports"]
    most = ports(~unit, enough=wanted)
    more = "" if most.exact else " were found"
    return f"{most.count} symmetric ports{more}, least {wanted}" if most.count < wanted else None


def _by_lines(constraints: Constrained) -> Conflict | None:
    """A line through every port closes a dot of each row, and the count leaves fewer."""
    wanted, dots = constraints["ports"], constraints.dots
    most = dots * (dots - min(wanted, dots))
    if wanted <= dots and constraints.clear_dots <= most:
        return None
    return Conflict(
        ("ports", "clear_dots") if wanted <= dots else ("ports",),
        f"{wanted} lines close {wanted} dots of every row, so that at most {most} of {dots} x {dots} are clear",
    )


PORTS = Rule("ports", "ports", _few_ports, proof=_by_lines, one_place=lambda _: True, slow=True)

DOT_RULES = KEEP_OUT, RIM, SYMMETRY, KISSING, FEATURE, SPACE, PORTS
"""In the order in which they are judged: a microsecond first."""
