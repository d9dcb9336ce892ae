"""A sweep that was checked: every case with its job, known by a hash, before any is begun."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from maskfab.errors import JobError
from maskfab.job import Job, load_job, resolve
from maskfab.jobfile import JobSpec, check_windows, validate
from maskfab.jobfile.sweep_file import LimitSection, SweepSpec, Value, read_sweep
from maskfab.jobfile.uses import USES, covered, named, unused
from maskfab.kept.fingerprint import fingerprint, of_installation
from maskfab.sweeps.fields import Document, Field, Level, fields_of
from maskfab.sweeps.wanted import WORKS, by_psf, require_known

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
        levels: its value of every field.
        document: of the job, self-contained; None if there is no such job.
        refused: why there is none; None if there is one.
    """

    key: str
    levels: tuple[Level, ...]
    document: Document | None
    refused: str | None = None

    @property
    def stated(self) -> tuple[Value, ...]:
        """Values as a job file writes them."""
        return tuple(level.stated for level in self.levels)


@dataclass(frozen=True, eq=False)
class Plan:
    """A sweep that was checked and can be made.

    Attributes:
        spec: of the study.
        where: the study file.
        job: that is varied, with the dies that are looked at.
        fields: that take several values.
        cases: every one, in order.
    """

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
        works = {WORKS[name] for name in self.quantities}
        uses = [key for use in ("sweep", *(f"sweep {work}" for work in works)) for key in USES[use]]
        if "surrogate" in works and getattr(spec.design, "protocol", None) != "f1":
            uses += USES["design by its own light"]
        if "photographs" in works and (spec.scene is not None or any(field.of("scene") for field in self.fields)):
            uses += USES["simulate a scene"]
        varied = [path for field in self.fields for path in field.keys if not covered(path, uses)]
        return tuple(dict.fromkeys((*unused(spec, *uses), *map(named, varied))))

    @property
    def limits(self) -> tuple[LimitSection, ...]:
        """Of the study, beside the job's own."""
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
    where = str(study)
    spec = read_sweep(study)
    sweep = spec.sweep
    require_known(sweep.quantities, f"{where}: sweep.quantities")
    for i, limit in enumerate(spec.limit):
        if limit.quantity not in sweep.quantities:
            cure = f"Use one of {', '.join(sweep.quantities)}"
            what = f"the sweep does not find {limit.quantity!r}"
            raise JobError("MF161", what, where=f"{where}: limit[{i}].quantity", cure=cure)
    path = study.parent / sweep.job
    job = _of_dies(load_job(path), sweep.dies, path, where)
    fields = fields_of(spec, job.spec, [die.name for die in job.spec.die], where)
    listed = [field for field in fields if not field.drawn]
    count = prod(len(field.levels) for field in listed) * (sweep.cases or 1)
    if count > MOST_CASES:
        raise JobError(
            "MF160",
            f"the sweep has {count} cases, more than the limit of {MOST_CASES}",
            where=f"{where}: field",
            cure="Give fields fewer values, or draw them: uniform = [...], and cases = 1000 in [sweep]",
        )
    document = job.spec.dump()
    cases = tuple(
        _case(document, fields, levels, sweep.quantities, path, where) for levels in _points(fields, sweep.cases)
    )
    _distinct(cases, fields, where)
    if all(case.refused for case in cases):
        raise JobError(
            "MF160", f"no case can be: {cases[0].refused}", where=where, cure="Change the values of the fields"
        )
    return Plan(spec, where, job, fields, cases)


def _of_dies(job: Job, names: tuple[str, ...] | None, path: Path, where: str) -> Job:
    """The job with some of its dies, and with what these need alone: nothing else may change a case's hash.

    Raises:
        JobError: MF105 for a die that is not there.
    """
    every = {die.name: die for die in job.spec.die}
    for name in names or ():
        if name not in every:
            cure = f"Use some of {', '.join(every)}"
            raise JobError("MF105", f"the job has no die {name!r}", where=f"{where}: sweep.dies", cure=cure)
    if not every:
        raise JobError("MF105", "the job has no [[die]]", where=str(path), cure="Add one")
    kept = tuple(every[name] for name in names or every)
    openings = {name for die in kept for name in (die.opening, *(die.others or ()))}
    maps = {die.map for die in kept}
    spec = job.spec.model_copy(
        update={
            "die": kept,
            "openings": {name: text for name, text in job.spec.openings.items() if name in openings},
            "maps": {name: text for name, text in job.spec.maps.items() if name in maps},
        }
    )
    return replace(job, spec=spec, openings={die.name: job.openings[die.name] for die in kept})


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
    """A case, refused if its values make no job.

    Raises:
        JobError: for what the study file itself has wrong.
    """
    for field, level in zip(fields, levels, strict=True):
        document = field.placed(document, level)
    try:
        spec = validate(document, where=where)
        if by_psf(quantities):
            check_windows(spec, where)
        if any(_names_files(field) for field in fields):
            spec = resolve(spec, path).spec
    except JobError as refusal:
        if refusal.code in _OF_THE_STUDY:
            raise
        told = f"{refusal.code} {refusal.what}"
        return Case(_key(document, quantities), levels, None, told)
    stated = _used(spec)
    return Case(_key(stated, quantities), levels, stated)


def _names_files(field: Field) -> bool:
    """Whether values of a field name files; drawn shapes bring their text along."""
    return field.levels[0].text is None and any(path[-1] in _NAMING_FILES for path in field.paths)


def _used(spec: JobSpec) -> Document:
    """Plain data of a job without openings that no die has, such as those that another was put in place of."""
    used = {name for die in spec.die for name in (die.opening, *(die.others or ()))}
    return spec.model_copy(update={"openings": {k: v for k, v in spec.openings.items() if k in used}}).dump()


def _key(document: Mapping[str, Any], quantities: tuple[str, ...]) -> str:
    text = json.dumps(document, sort_keys=True)
    return fingerprint(of_installation(), text, tuple(sorted(quantities)))


def _distinct(cases: tuple[Case, ...], fields: tuple[Field, ...], where: str) -> None:
    """Refuse two cases that ask for one job.

    Raises:
        JobError: MF162.
    """
    first: dict[str, Case] = {}
    for case in cases:
        other = first.setdefault(case.key, case)
        if other is not case and not any(level.text for level in case.levels):
            named = [
                f"{field.name} = {one!r} and {two!r}"
                for field, one, two in zip(fields, other.stated, case.stated, strict=True)
                if one != two
            ] or [f"{field.name} = {one!r}" for field, one in zip(fields, other.stated, strict=True)]
            raise JobError(
                "MF162",
                f"two cases are one job: {', '.join(named)}",
                where=f"{where}: field",
                cure="Remove one of the values, or a field that changes nothing in these dies",
            )
