"""A sweep that was checked: every case with its job, known by a hash, before any is begun.

Fields say where in a job values stand, and which they take.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from itertools import chain, product
from math import prod
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeAlias, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator
from pydantic.fields import FieldInfo

from maskfab.base.errors import Faults, JobError
from maskfab.base.findings import STAGE_OF_QUANTITY, Need
from maskfab.base.model import Opening
from maskfab.base.units import to_nm
from maskfab.designs.rules.families import FAMILIES
from maskfab.job.faults import JobFaults
from maskfab.job.read import check_windows, validate
from maskfab.job.reference import USES, covered, keys_of, named, unused
from maskfab.job.sections import JobSpec
from maskfab.job.sweep_file import FieldSection, LimitSection, Scalar, SweepSpec, Value, read_sweep
from maskfab.job.values import AnySection, sections_of
from maskfab.mask.job import Job, load_job, resolve
from maskfab.mask.opening_file import opening_text
from maskfab.runs.store import fingerprint, of_installation


def by_psf(names: Sequence[str]) -> bool:
    """Whether any of the quantities is of the PSF in the camera's window."""
    return any(Need.WINDOW in STAGE_OF_QUANTITY[name].needs for name in names)


def require_known(names: Sequence[str], where: str) -> None:
    """Refuse quantities that no case has. Raises JobError MF161, with those that look like it."""
    for name in names:
        if name not in STAGE_OF_QUANTITY:
            near = get_close_matches(name, STAGE_OF_QUANTITY, n=3) or list(STAGE_OF_QUANTITY)
            what = f"a sweep cannot find the quantity {name!r}"
            raise JobError("MF161", what, where=where, cure=f"Use one of {', '.join(near)}")
    if len(set(names)) < len(names):
        raise JobError("MF161", "a quantity is named twice", where=where, cure="Name each once")


KeyPath: TypeAlias = tuple[str, ...]
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

    @property
    def shown(self) -> Scalar:
        """The value in one cell of a table."""
        return ", ".join(map(str, self.stated)) if isinstance(self.stated, tuple) else self.stated


@dataclass(frozen=True, eq=False)
class Field:
    """A key of the job, or several that take the same value.

    Attributes:
        unit: of its numbers; empty for numbers without one, and where values are no numbers.
        levels: values, of a drawn field one for each draw.
    """

    name: str
    paths: tuple[KeyPath, ...]
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
            listed = isinstance(level.stated, tuple) or holds_list(path)
            value = level.stated if isinstance(level.stated, tuple) or not listed else (level.stated,)
            document = _placed(document, path, list(value) if isinstance(value, tuple) else value)
        if level.text is None:
            return document
        return {**document, "openings": {**document.get("openings", {}), str(level.stated): level.text}}


def fields_of(spec: SweepSpec, job: JobSpec, dies: Sequence[str], where: str) -> tuple[Field, ...]:
    """The fields of a study, with every value that they take.

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
    fields = []
    for i, section in enumerate(spec.field):
        place = f"{where}: field[{i}]"
        paths = tuple(dict.fromkeys(chain.from_iterable(_paths(key, job, dies, f"{place}.key") for key in section.key)))
        levels, unit = _levels(section, next(rows) if section.drawn else None, paths, job, place)
        numeric = all(level.number is not None for level in levels)
        fields.append(Field(", ".join(section.key), paths, unit, numeric, levels, section.drawn))
    seen: dict[KeyPath, str] = {}
    for path, name in ((path, field.name) for field in fields for path in field.paths):
        if path in seen:
            what = f"{'.'.join(path)} is varied twice, by {seen[path]} and by {name}"
            raise JobError("MF109", what, where=f"{where}: field", cure="Remove it from one of the fields")
        seen[path] = name
    return tuple(fields)


def _paths(key: str, job: JobSpec, dies: Sequence[str], where: str) -> list[KeyPath]:
    """Places in a job's document that a key names."""
    path = tuple(key.split("."))
    if path[0] != "die":
        _known(key, where)
        return [path]
    if len(path) != 3:
        cure = f"Write die.{dies[0]}.{path[-1]}, or die.*.{path[-1]} for every die"
        raise JobError("MF105", f"{key!r} does not name a die and a key of it", where=where, cure=cure)
    _known(f"die.{path[2]}", where)
    if path[1] != _EVERY and path[1] not in dies:
        what = f"the sweep has no die {path[1]!r}"
        raise JobError("MF105", what, where=where, cure=f"Use one of {', '.join(dies)}, or die.*")
    return [("die", name, path[2]) for name in (dies if path[1] == _EVERY else [path[1]])]


def _known(key: str, where: str) -> None:
    """Refuse a key that no job has."""
    kind: type[AnySection] | None = JobSpec
    for name in key.split("."):
        kind, matched = _inner(kind, name)
        if not matched:
            break
    if matched and kind is None:
        return
    try:
        near = keys_of(key)
    except JobError as unknown:
        raise JobError(unknown.code, unknown.what, where=where, cure=unknown.cure) from None
    listed = ", ".join(likely.path for likely in near[:4])
    raise JobError("MF105", f"{key!r} is a table, not a key", where=where, cure=f"Use a key of it: {listed}")


@cache
def holds_list(path: KeyPath) -> bool:
    """Whether a key of a job holds a list of any length, which a single item may stand for."""
    kind: type[AnySection] | None = JobSpec
    field: FieldInfo | None = None
    for part in (path[0], path[-1]) if path[0] == "die" else path:
        if kind is None or part not in kind.model_fields:
            return False
        field = kind.model_fields[part]
        kind = next(sections_of(field), None)
    return kind is None and field is not None and _is_list(field.annotation, field.metadata)


def _is_list(annotation: Any, marks: Sequence[object]) -> bool:
    """Whether a type, or one that it may be, is a list of any length that no reader makes of something else."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _is_list(inner[0], inner[1:])
    if origin is tuple:
        return inner[-1:] == (Ellipsis,) and not any(isinstance(mark, BeforeValidator) for mark in marks)
    return origin in (Union, UnionType) and any(_is_list(kind, ()) for kind in inner)


def _inner(kind: type[AnySection] | None, name: str) -> tuple[type[AnySection] | None, bool]:
    """The table that a key of a table holds, None for a value, and whether there is such a key."""
    if kind is None or name not in kind.model_fields:
        return None, False
    return next(sections_of(kind.model_fields[name]), None), True


def _draws(fields: int, count: int, seed: int, *, latin: bool) -> NDArray[np.float64]:
    """Numbers between 0 and 1, [fields, count]; in a Latin hypercube each field has one in every count-th part."""
    draw = np.random.default_rng(seed)
    if not latin:
        return draw.random((fields, count))
    ranks = np.array([draw.permutation(count) for _ in range(fields)]).reshape(fields, count)
    return np.asarray((ranks + draw.random((fields, count))) / max(count, 1))


def _levels(
    section: FieldSection, draws: NDArray[np.float64] | None, paths: Sequence[KeyPath], job: JobSpec, where: str
) -> tuple[tuple[Level, ...], str]:
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
    """Number and unit of a value, of a list those of its only item; None for what has none."""
    if isinstance(value, tuple):
        return _number(value[0]) if len(value) == 1 else (None, "")
    if isinstance(value, bool):
        return None, ""
    if isinstance(value, str):
        match = _WRITTEN.fullmatch(value)
        return (None, "") if match is None else (float(match[1]), match[2])
    return float(value), ""


def _ends(first: Value, last: Value, where: str) -> tuple[tuple[float, float], str, bool]:
    """Two numbers of one unit, the unit, and whether both are whole numbers without one."""
    (low, unit), (high, other) = _number(first), _number(last)
    if low is None or high is None or not np.isfinite([low, high]).all():
        wrong = first if low is None or not np.isfinite(low) else last
        raise JobError("MF103", f"{wrong!r} is no number with its unit", where=where, cure='Write it as "0.5 um"')
    if unit != other:
        numbers = [
            f"{end!r} has {f'the unit {name!r}' if name else 'no unit'}" for end, name in ((first, unit), (last, other))
        ]
        raise JobError("MF103", " and ".join(numbers), where=where, cure="Give both the same unit")
    return (low, high), unit, isinstance(first, int) and isinstance(last, int)


def _stated(numbers: NDArray[np.float64], unit: str, *, whole: bool) -> tuple[Level, ...]:
    levels = []
    for number in numbers.tolist():
        rounded: int | float = round(number) if whole else float(f"{number:.12g}") + 0.0
        levels.append(Level(f"{rounded:.12g} {unit}" if unit else rounded, float(rounded)))
    return tuple(levels)


def _shapes(
    section: FieldSection, draws: NDArray[np.float64], paths: Sequence[KeyPath], job: JobSpec, where: str
) -> tuple[Level, ...]:
    asked = section.shapes
    assert asked is not None
    dies = {die.name: die for die in job.die}
    if not all(path[0] == "die" and path[-1] == _OF_DRAWING for path in paths):
        cure = 'Use key = "die.NAME.opening"'
        raise JobError("MF160", f"shapes are openings, and {section.key[0]} is none", where=where, cure=cure)
    dot_nm = to_nm(dies[paths[0][1]].dot, where=f"{where}.key", name="dot")
    every = [
        drawn for name in asked.families for count in asked.clear_dots for drawn in FAMILIES[name](asked.dots, count)
    ]
    levels = []
    for u in draws.tolist():
        shape = every[min(int(u * len(every)), len(every) - 1)]
        mark = hashlib.sha256(np.packbits(shape.unit).tobytes()).hexdigest()[:12]
        opening = Opening(f"shape_{mark}", shape.unit, dot_nm, provenance={"shape": shape.name})
        levels.append(Level(opening.name, None, opening_text(opening)))
    return tuple(levels)


def _placed(document: Document, path: KeyPath, value: object) -> Document:
    """A copy of a job's document in which one place has another value; tables on the way are made."""
    if path[0] == "die":
        _, name, key = path
        dies = [{**die, key: value} if die["name"] == name else die for die in document["die"]]
        return {**document, "die": dies}
    first, *rest = path
    if not rest:
        return {**document, first: value}
    return {**document, first: _placed(document.get(first) or {}, tuple(rest), value)}


MOST_CASES = 100_000
"""Cases of one sweep: their jobs take some kilobytes each, and their files a folder that other programs can open."""
_OF_THE_STUDY = frozenset({"MF101", "MF102", "MF103", "MF105"})
"""Faults of the study file itself, where others are of one case."""
_NAMING_FILES = frozenset({"opening", "others", "map", "spectrum", "illuminant", "shop"})
"""Keys that name files, which are read before the first case."""


@dataclass(frozen=True, eq=False)
class Case:
    """One job of a sweep.

    Attributes:
        key: SHA-256 of its job, of the quantities wanted, and of the code that finds them.
        document: of the job, self-contained; None if there is no such job.
        refused: why there is none; None if there is one.
    """

    key: str
    levels: tuple[Level, ...]
    document: Document | None
    refused: str | None = None

    @property
    def stated(self) -> tuple[Scalar, ...]:
        """Values as a job file writes them, lists as text."""
        return tuple(level.shown for level in self.levels)


@dataclass(frozen=True, eq=False)
class Plan:
    """A sweep that was checked and can be made."""

    spec: SweepSpec
    where: str
    job: Job
    fields: tuple[Field, ...]
    cases: tuple[Case, ...]

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of those that are wanted."""
        return self.spec.sweep.quantities

    @property
    def unused(self) -> tuple[str, ...]:
        """Names of all that the job states, or the study varies, and the quantities wanted do not depend on."""
        spec = self.job.spec
        works = {STAGE_OF_QUANTITY[name].name for name in self.quantities}
        uses = [key for use in ("sweep", *(f"sweep {work}" for work in works)) for key in USES[use]]
        if "surrogate" in works and getattr(spec.design, "protocol", None) != "f1":
            uses += USES["design by its own light"]
        if "photographs" in works and (spec.scene is not None or any(field.of("scene") for field in self.fields)):
            uses += USES["simulate a scene"]
        varied = [path for field in self.fields for path in field.keys if not covered(path, uses)]
        return tuple(dict.fromkeys((*unused(spec, *uses), *map(named, varied))))

    @property
    def limits(self) -> tuple[LimitSection, ...]:
        """Limits of the study, beside the job's own."""
        return self.spec.limit

    @property
    def digest(self) -> str:
        """SHA-256 of all cases in their order."""
        return fingerprint(tuple(case.key for case in self.cases), self.spec)


def planned(study: Path) -> Plan:
    """Check all of a study before any work.

    Raises:
        SourceError, JobError: for a study or a job file that cannot be read; MF105 for a key, a die or a table that is
            not there; MF103 for units; MF160 for fields without values, and for too many cases; MF161 for a quantity
            that no case has; MF162 for two cases that are one.
    """
    spec, faults, loaded = read_sweep(study), Faults(), None
    path = study.parent / spec.sweep.job
    with faults:
        require_quantities(spec, str(study))
    with faults:
        loaded = load_job(path, faults_of_plate)
    faults.refuse()
    assert loaded is not None
    return planned_of(spec, loaded, path, str(study))


def faults_of_plate(job: Job, faults: JobFaults) -> None:
    """Tell what :func:`maskfab.display.feasibility.plate_of` refuses with the faults of a job's file."""
    # Laying out takes longer to import than a sweep that is kept to read, and a job without faults is not asked.
    from maskfab.display.feasibility import plate_of

    plate_of(job, faults)


def require_quantities(spec: SweepSpec, where: str) -> None:
    """Refuse quantities that no case has, and limits of others. Raises JobError MF161."""
    sweep = spec.sweep
    require_known(sweep.quantities, f"{where}: sweep.quantities")
    for i, limit in enumerate(spec.limit):
        if limit.quantity not in sweep.quantities:
            cure = f"Use one of {', '.join(sweep.quantities)}"
            what = f"the sweep does not find {limit.quantity!r}"
            raise JobError("MF161", what, where=f"{where}: limit[{i}].quantity", cure=cure)


def planned_of(spec: SweepSpec, loaded: Job, path: Path, where: str) -> Plan:
    """:func:`planned` for a job that is loaded already.

    Args:
        path: that names of files in the study's values are relative to, as of the job's file.
    """
    sweep = spec.sweep
    job = _of_dies(loaded, sweep.dies, path, where)
    fields = fields_of(spec, job.spec, [die.name for die in job.spec.die], where)
    listed = [field for field in fields if not field.drawn]
    count = prod(len(field.levels) for field in listed) * (sweep.cases or 1)
    if count > MOST_CASES:
        what = f"the sweep has {count} cases, more than the limit of {MOST_CASES}"
        cure = "Give fields fewer values, or draw them: uniform = [...], and cases = 1000 in [sweep]"
        raise JobError("MF160", what, where=f"{where}: field", cure=cure)
    document = job.spec.dump()
    cases = tuple(
        _case(document, fields, levels, sweep.quantities, path, where) for levels in _points(fields, sweep.cases)
    )
    _distinct(cases, fields, where)
    if all(case.refused for case in cases):
        what = f"no case can be: {cases[0].refused}"
        raise JobError("MF160", what, where=where, cure="Change the values of the fields")
    return Plan(spec, where, job, fields, cases)


def _of_dies(job: Job, names: tuple[str, ...] | None, path: Path, where: str) -> Job:
    """The job with some of its dies, and with what these need alone: nothing else may change a case's hash."""
    every = {die.name: die for die in job.spec.die}
    for name in names or ():
        if name not in every:
            cure = f"Use some of {', '.join(every)}"
            raise JobError("MF105", f"the job has no die {name!r}", where=f"{where}: sweep.dies", cure=cure)
    if not every:
        raise JobError("MF105", "the job has no [[die]]", where=str(path), cure="Add one")
    chosen = tuple(every[name] for name in names or every)
    openings = {name for die in chosen for name in (die.opening, *(die.others or ()))}
    maps = {die.map for die in chosen}
    spec = job.spec.model_copy(
        update={
            "die": chosen,
            "openings": {name: text for name, text in job.spec.openings.items() if name in openings},
            "maps": {name: text for name, text in job.spec.maps.items() if name in maps},
        }
    )
    return replace(job, spec=spec, openings={die.name: job.openings[die.name] for die in chosen})


def _points(fields: tuple[Field, ...], cases: int | None) -> list[tuple[Level, ...]]:
    """The values of every case: listed ones each with each, and these with every draw."""
    listed = [range(len(field.levels)) if not field.drawn else (None,) for field in fields]
    return [
        tuple(field.levels[draw if i is None else i] for field, i in zip(fields, point, strict=True))
        for draw in range(cases or 1)
        for point in product(*listed)
    ]


def _case(
    document: Document,
    fields: tuple[Field, ...],
    levels: tuple[Level, ...],
    quantities: tuple[str, ...],
    path: Path,
    where: str,
) -> Case:
    """A case, refused if its values make no job."""
    for field, level in zip(fields, levels, strict=True):
        document = field.placed(document, level)
    try:
        spec = validate(document, where=where)
        if by_psf(quantities):
            check_windows(spec, where)
        if any(
            field.levels[0].text is None and any(path[-1] in _NAMING_FILES for path in field.paths) for field in fields
        ):
            spec = resolve(spec, path).spec
    except JobError as refusal:
        if refusal.code in _OF_THE_STUDY:
            raise
        reason = f"{refusal.code} {refusal.what}"
        return Case(_key(document, quantities), levels, None, reason)
    # Openings that another was put in place of do not count.
    used = {name for die in spec.die for name in (die.opening, *(die.others or ()))}
    stated = spec.model_copy(update={"openings": {k: v for k, v in spec.openings.items() if k in used}}).dump()
    return Case(_key(stated, quantities), levels, stated)


def _key(document: Mapping[str, Any], quantities: tuple[str, ...]) -> str:
    text = json.dumps(document, sort_keys=True)
    return fingerprint(of_installation(), text, tuple(sorted(quantities)))


def _distinct(cases: tuple[Case, ...], fields: tuple[Field, ...], where: str) -> None:
    """Refuse two cases that ask for one job. Raises JobError MF162."""
    first: dict[str, Case] = {}
    for case in cases:
        other = first.setdefault(case.key, case)
        if other is not case and not any(level.text for level in case.levels):
            named = [
                f"{field.name} = {one!r} and {two!r}"
                for field, one, two in zip(fields, other.stated, case.stated, strict=True)
                if one != two
            ] or [f"{field.name} = {one!r}" for field, one in zip(fields, other.stated, strict=True)]
            cure = "Remove one of the values, or a field that changes nothing in these dies"
            raise JobError("MF162", f"two cases are one job: {', '.join(named)}", where=f"{where}: field", cure=cure)
