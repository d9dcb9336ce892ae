"""The fields of a sweep: where in a job they stand, and the values that they take."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import JobError
from maskfab.jobfile import JobSpec
from maskfab.jobfile.reference import keys_of
from maskfab.jobfile.section import Section
from maskfab.jobfile.sweep_file import FieldSection, SweepSpec, Value
from maskfab.model import Opening
from maskfab.opening.openings import opening_text
from maskfab.optimiser.rules.families import FAMILIES
from maskfab.units import to_nm

Path: TypeAlias = tuple[str, ...]
Document: TypeAlias = Mapping[str, Any]

_EVERY = "*"
_WRITTEN = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµμ]*)\s*")
_OF_DRAWING = "opening"


@dataclass(frozen=True)
class Level:
    """One value of a field.

    Attributes:
        stated: as a job file writes it; of a drawn shape its name.
        number: in the field's unit; None for what is no number.
        text: of the opening, where the value is a drawn shape.
    """

    stated: Value
    number: float | None = None
    text: str | None = None


@dataclass(frozen=True, eq=False)
class Field:
    """A key of the job, or several that take the same value.

    Attributes:
        name: as the study file writes it.
        paths: places in the job's document.
        unit: of its numbers; empty for numbers without one, and where values are no numbers.
        numeric: whether every value is a number.
        levels: values, of a drawn field one for each draw.
        drawn: whether they were drawn by chance.
    """

    name: str
    paths: tuple[Path, ...]
    unit: str
    numeric: bool
    levels: tuple[Level, ...]
    drawn: bool

    @property
    def keys(self) -> tuple[str, ...]:
        """Its keys of a job, without numbers of dies, each once: ``die.gutter``."""
        return tuple(dict.fromkeys(".".join(part for part in path if not part.isdigit()) for path in self.paths))

    def of(self, table: str) -> bool:
        """Whether it varies a key of a table."""
        return any(path[0] == table for path in self.paths)

    def placed(self, document: Document, level: Level) -> Document:
        """The document of a job with this value in place of its own."""
        for path in self.paths:
            document = _placed(document, path, level.stated)
        if level.text is None:
            return document
        return {**document, "openings": {**document.get("openings", {}), str(level.stated): level.text}}


def fields_of(spec: SweepSpec, job: JobSpec, dies: Sequence[str], where: str) -> tuple[Field, ...]:
    """The fields of a study, with every value that they take.

    Args:
        spec: of the study.
        job: that it varies.
        dies: names of the dies that are looked at.
        where: the study file, for errors.

    Raises:
        JobError: MF105 for a key that no job has; MF109 for one that two fields vary; MF103 for units that are missing
            or differ; MF160 for draws without their number, or shapes of what is no opening; MF203, MF204 for shapes
            that there are not.
    """
    drawn = [section for section in spec.field if section.drawn]
    if bool(drawn) != (spec.sweep.cases is not None):
        what = "fields are drawn, and sweep.cases does not say how often" if drawn else "sweep.cases, and none is drawn"
        cure = "Add cases = 200 to [sweep]" if drawn else "Remove cases, or draw a field with uniform = [...]"
        raise JobError("MF160", what, where=f"{where}: sweep.cases", cure=cure)
    count = spec.sweep.cases or 0
    rows = iter(_draws(len(drawn), count, spec.sweep.seed, latin=spec.sweep.sampling == "latin"))
    found = []
    for i, section in enumerate(spec.field):
        place = f"{where}: field[{i}]"
        paths = tuple(dict.fromkeys(chain.from_iterable(_paths(key, job, dies, f"{place}.key") for key in section.key)))
        levels, unit = _levels(section, next(rows) if section.drawn else None, paths, job, place)
        numeric = all(level.number is not None for level in levels)
        found.append(Field(", ".join(section.key), paths, unit, numeric, levels, section.drawn))
    seen: dict[Path, str] = {}
    for path, name in ((path, field.name) for field in found for path in field.paths):
        if path in seen:
            what = f"{'.'.join(path)} is varied twice, by {seen[path]} and by {name}"
            raise JobError("MF109", what, where=f"{where}: field", cure="Remove it from one of the fields")
        seen[path] = name
    return tuple(found)


def _paths(key: str, job: JobSpec, dies: Sequence[str], where: str) -> list[Path]:
    """Places in a job's document that a key names.

    Raises:
        JobError: MF105 for an unknown key or die, with those that look like it.
    """
    path = tuple(key.split("."))
    if path[0] != "die":
        _known(key, where)
        return [path]
    if len(path) != 3:
        cure = f"Write die.{dies[0]}.{path[-1]}, or die.*.{path[-1]} for every die"
        raise JobError("MF105", f"{key!r} does not name a die and a key of it", where=where, cure=cure)
    _known(f"die.{path[2]}", where)
    if path[1] != _EVERY and path[1] not in dies:
        raise JobError(
            "MF105", f"the sweep has no die {path[1]!r}", where=where, cure=f"Use one of {', '.join(dies)}, or die.*"
        )
    return [("die", name, path[2]) for name in (dies if path[1] == _EVERY else [path[1]])]


def _known(key: str, where: str) -> None:
    """Refuse a key that no job has.

    Raises:
        JobError: MF105, with those that look like it.
    """
    kind: type[Section] | None = JobSpec
    for name in key.split("."):
        kind, known = _inner(kind, name)
        if not known:
            break
    if known and kind is None:
        return
    try:
        near = keys_of(key)
    except JobError as unknown:
        raise JobError(unknown.code, unknown.what, where=where, cure=unknown.cure) from None
    listed = ", ".join(each.path for each in near[:4])
    raise JobError("MF105", f"{key!r} is a table, not a key", where=where, cure=f"Use a key of it: {listed}")


def _inner(kind: type[Section] | None, name: str) -> tuple[type[Section] | None, bool]:
    """The table that a key of a table holds, None for a value, and whether there is such a key."""
    if kind is None or name not in kind.model_fields:
        return None, False
    parts = [kind.model_fields[name].annotation]
    for part in parts:
        if isinstance(part, type) and issubclass(part, Section):
            return part, True
        parts += get_args(part)
    return None, True


def _draws(fields: int, count: int, seed: int, *, latin: bool) -> NDArray[np.float64]:
    """Numbers between 0 and 1, [fields, count]; in a Latin hypercube each field has one in every count-th part."""
    draw = np.random.default_rng(seed)
    if not latin:
        return draw.random((fields, count))
    ranks = np.array([draw.permutation(count) for _ in range(fields)]).reshape(fields, count)
    return np.asarray((ranks + draw.random((fields, count))) / max(count, 1))


def _levels(
    section: FieldSection, draws: NDArray[np.float64] | None, paths: Sequence[Path], job: JobSpec, where: str
) -> tuple[tuple[Level, ...], str]:
    """Every value of a field, and their unit."""
    if section.values is not None:
        parts = [_number(value) for value in section.values]
        units = {unit for _, unit in parts}
        if None in {number for number, _ in parts} or len(units) > 1:
            return tuple(Level(value) for value in section.values), ""
        return tuple(
            Level(v, number) for v, (number, _) in zip(section.values, parts, strict=True)
        ), units.pop()  # fmt: skip
    if section.first is not None and section.last is not None and section.count is not None:
        (low, high), unit, whole = _ends(section.first, section.last, where)
        numbers = np.linspace(low, high, section.count)
        return _stated(numbers, unit, whole=whole and (high - low) % (section.count - 1) == 0), unit
    assert draws is not None
    if section.uniform is not None:
        (low, high), unit, whole = _ends(*section.uniform, where)
        if not low < high:
            raise JobError("MF160", "an interval needs its lower end first", where=where, cure="Exchange its ends")
        numbers = np.floor(low + (high + 1 - low) * draws) if whole else low + (high - low) * draws
        return _stated(numbers, unit, whole=whole), unit
    if section.normal is not None:
        (mean, sigma), unit, _ = _ends(section.normal.mean, section.normal.sigma, where)
        if sigma <= 0:
            raise JobError("MF104", "sigma is not above 0", where=f"{where}.normal", cure="Give a positive sigma")
        from scipy.special import ndtri  # slow to load, and few sweeps need it

        return _stated(mean + sigma * ndtri(draws), unit, whole=False), unit
    return _shapes(section, draws, paths, job, where), ""


def _number(value: Value) -> tuple[float | None, str]:
    """Number and unit of a value; None for what has none."""
    if isinstance(value, bool):
        return None, ""
    if isinstance(value, int | float):
        return float(value), ""
    found = _WRITTEN.fullmatch(value)
    return (None, "") if found is None else (float(found[1]), found[2])


def _ends(first: Value, last: Value, where: str) -> tuple[tuple[float, float], str, bool]:
    """Two numbers of one unit, the unit, and whether both are whole numbers without one."""
    (low, unit), (high, other) = _number(first), _number(last)
    if low is None or high is None or not np.isfinite([low, high]).all():
        wrong = first if low is None or not np.isfinite(low) else last
        raise JobError("MF103", f"{wrong!r} is no number with its unit", where=where, cure='Write it as "0.5 um"')
    if unit != other:
        told = [
            f"{each!r} has {f'the unit {name!r}' if name else 'no unit'}"
            for each, name in ((first, unit), (last, other))
        ]
        raise JobError("MF103", " and ".join(told), where=where, cure="Give both the same unit")
    return (low, high), unit, isinstance(first, int) and isinstance(last, int)


def _stated(numbers: NDArray[np.float64], unit: str, *, whole: bool) -> tuple[Level, ...]:
    """Values as a job file writes them."""
    levels = []
    for number in numbers.tolist():
        told: Value = round(number) if whole else float(f"{number:.12g}") + 0.0
        levels.append(Level(f"{told:.12g} {unit}" if unit else told, float(told)))
    return tuple(levels)


def _shapes(
    section: FieldSection, draws: NDArray[np.float64], paths: Sequence[Path], job: JobSpec, where: str
) -> tuple[Level, ...]:
    """Openings drawn among all shapes of the families."""
    asked = section.shapes
    assert asked is not None
    dies = {die.name: die for die in job.die}
    if not all(path[0] == "die" and path[-1] == _OF_DRAWING for path in paths):
        cure = 'Use key = "die.NAME.opening"'
        raise JobError("MF160", f"shapes are openings, and {section.key[0]} is none", where=where, cure=cure)
    dot_nm = to_nm(dies[paths[0][1]].dot, where=f"{where}.key", name="dot")
    every = [
        each for name in asked.families for count in asked.clear_dots for each in FAMILIES[name](asked.dots, count)
    ]
    levels = []
    for u in draws.tolist():
        shape = every[min(int(u * len(every)), len(every) - 1)]
        mark = hashlib.sha256(np.packbits(shape.unit).tobytes()).hexdigest()[:12]
        opening = Opening(f"shape_{mark}", shape.unit, dot_nm, provenance={"shape": shape.name})
        levels.append(Level(opening.name, None, opening_text(opening)))
    return tuple(levels)


def _placed(document: Document, path: Path, value: Value) -> Document:
    """A copy of a job's document in which one place has another value; tables on the way are made."""
    if path[0] == "die":
        _, name, key = path
        dies = [{**die, key: value} if die["name"] == name else die for die in document["die"]]
        return {**document, "die": dies}
    first, *rest = path
    if not rest:
        return {**document, first: value}
    return {**document, first: _placed(document.get(first) or {}, tuple(rest), value)}
