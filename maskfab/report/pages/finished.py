"""The parts of a report.json that a comparison reads, a file from outside: edited ones are refused before any work.

Finished reports as they are read back to be compared.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from maskfab.base import provenance
from maskfab.base.errors import InputError, JobError, OutputError
from maskfab.base.folders import JOB_COPY, REPORT, read_manifest
from maskfab.job.values import check_name
from maskfab.report.documents.report import SCHEMA_VERSION
from maskfab.report.pages.tables import WORST

_MOST_DIES = 10_000


def check_told(document: Mapping[str, Any]) -> None:
    """Refuse a report that cannot be compared.

    Raises:
        ValueError: with the place and what is wrong with it.
    """
    try:
        _Report.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{place or 'report'}: {first['msg']}"[:300]) from error


def _name_of_a_die(name: str) -> str:
    try:
        return check_name(name)
    except InputError as error:
        raise ValueError("this is no name that a die of a job can have") from error


_Name = Annotated[str, Field(max_length=100), AfterValidator(_name_of_a_die)]
_Text = Annotated[str, Field(max_length=20_000)]


class _Told(BaseModel):
    model_config = ConfigDict(allow_inf_nan=False, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _what_may_be_absent_is_not_null(cls, told: object) -> object:
        if isinstance(told, Mapping):
            for name, field in cls.model_fields.items():
                if not field.is_required() and told.get(name, ...) is None:
                    raise ValueError(f"{name} is null")
        return told


class _Quantity(_Told):
    name: _Text
    value: float | str | None
    uncertainty: float | None
    passed: bool | None
    wavelength_nm: float | None = None
    level_db: float | None = None
    between: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _open_ratio_is_a_share(self) -> _Quantity:
        if self.name == "open_ratio" and not isinstance(self.value, float):
            raise ValueError("the open ratio is no number")
        return self

    @model_validator(mode="after")
    def _worst_mtf_is_at_a_frequency(self) -> _Quantity:
        if self.name.startswith(WORST):
            try:
                float(self.name.removeprefix(WORST))
            except ValueError as error:
                raise ValueError(f"{self.name[:40]!r} names no frequency") from error
        return self


class _Wires(_Told):
    lines: Annotated[list[float], Field(min_length=2, max_length=2)]
    wanted: int


class _Display(_Told):
    verdict: _Text
    share: float
    required: float
    bound_share: float
    emitters: dict[str, Any] | None
    wires: _Wires | None


class _Die(_Told):
    name: _Name
    quantities: list[_Quantity]
    display: _Display | None = None


class _Level(_Told):
    level_db: float
    psnr: list[float]


class _Photographed(_Told):
    name: _Name
    refused: _Text | None
    levels: list[_Level]


class _Photographs(_Told):
    levels_db: Annotated[list[float], Field(min_length=1)]
    scenes: list[_Text]
    reference: _Name | None
    dies: list[_Photographed]

    @model_validator(mode="after")
    def _of_the_same_scenes(self) -> _Photographs:
        for die in self.dies:
            if die.refused is None and [level.level_db for level in die.levels] != self.levels_db:
                raise ValueError(f"die {die.name} has not the levels of light that the report has")
            if any(len(level.psnr) != len(self.scenes) for level in die.levels):
                raise ValueError(f"die {die.name} has not one number for each scene")
        if self.reference is not None and self.reference not in {die.name for die in self.dies}:
            raise ValueError(f"the reference {self.reference} has no photographs")
        return self


class _Camera(_Told):
    wavelengths_nm: Annotated[list[float], Field(min_length=1)]


class _Spread(_Told):
    bias_um: float
    radius_um: float


class _Report(_Told):
    maskfab_version: _Text
    title: _Text
    job_hash: _Text
    camera: _Camera
    spread: _Spread | None = None
    dies: Annotated[list[_Die], Field(max_length=_MOST_DIES)]
    photographs: _Photographs | None = None

    @model_validator(mode="after")
    def _of_dies_that_there_are(self) -> _Report:
        names = [die.name for die in self.dies]
        if len(set(names)) < len(names):
            raise ValueError("two dies have one name")
        taken = [] if self.photographs is None else [die.name for die in self.photographs.dies]
        if set(taken) - set(names) or len(set(taken)) < len(taken):
            raise ValueError("photographs are not of the dies that there are")
        return self


_MOST_BYTES = 200_000_000
_AGAIN = "Name the --out of a finished maskfab run, or its report.json; of another version, run its job again"


@dataclass(frozen=True)
class FinishedReport:
    """One report.

    Attributes:
        name: told of it: of its folder.
        document: of report.json.
        job: the resolved job beside it; None for a report that stands alone.
        proved: whether the manifest beside it says that nobody changed it since.
    """

    name: str
    document: Mapping[str, Any]
    job: Mapping[str, Any] | None
    proved: bool


def read_reports(paths: list[Path]) -> tuple[FinishedReport, ...]:
    """Reports by their folders, or by their own paths; of equal names, each with a number.

    Raises:
        OutputError: MF403 for a place without a report, MF407 for one that was edited, is damaged, or of another
            version.
        JobError: MF105 for a report that is named twice, or is equal to another in all that it says.
    """
    found = [_read(path) for path in paths]
    for number, each in enumerate(found):
        earlier = next((n for n, other in enumerate(found[:number]) if other.document == each.document), None)
        if earlier is not None:
            raise JobError(
                "MF105",
                f"report {number + 1}, {each.name}, is the same as report {earlier + 1}, {found[earlier].name}",
                where="REPORT",
                cure="Name each report once; two dies of one report are compared by naming it alone",
            )
    names = [each.name for each in found]
    return tuple(
        FinishedReport(
            name if names.count(name) == 1 else f"{name}#{names[:number].count(name) + 1}",
            each.document,
            each.job,
            each.proved,
        )
        for number, (name, each) in enumerate(zip(names, found, strict=True))
    )


def _read(path: Path) -> FinishedReport:
    file = path / REPORT if os.path.isdir(path) else path
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise OutputError("MF407", f"{file} is longer than {_MOST_BYTES / 1e6:g} MB", cure=_AGAIN)
        document = json.loads(file.read_bytes())
    except OSError as error:
        raise OutputError("MF403", f"{file} cannot be read: {error.strerror or error}", cure=_AGAIN) from error
    except (ValueError, RecursionError) as error:
        raise OutputError("MF407", f"{file} is truncated or damaged: {error}", cure=_AGAIN) from error
    version = document.get("schema_version") if isinstance(document, dict) else None
    if version != SCHEMA_VERSION:
        what = f"{file} is of schema {version!r}; this version compares {SCHEMA_VERSION}"
        raise OutputError("MF407", what, cure=_AGAIN)
    proved = _proved(file)
    try:
        check_told(document)
    except ValueError as error:
        raise OutputError("MF407", f"{file} is no report that can be compared: {error}", cure=_AGAIN) from error
    return FinishedReport(_printable(file.resolve().parent.name), document, _job(file) if proved else None, proved)


def _printable(name: str) -> str:
    """A folder's name without what moves a terminal's cursor, or no text can hold."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in name)


def _proved(file: Path) -> bool:
    """Whether the manifest beside a report knows its hash; False without a manifest.

    Raises:
        OutputError: MF407 if it knows another.
    """
    try:
        rows = read_manifest(file.parent)["files"]
    except OutputError:
        return False
    known = next((row["sha256"] for row in rows if row["path"] == file.name), None)
    if known != provenance.sha256_of_file(file):
        raise OutputError("MF407", f"{file} was changed since its run finished", cure=_AGAIN)
    return True


def _job(file: Path) -> Mapping[str, Any] | None:
    try:
        job = json.loads((file.parent / JOB_COPY).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return job if isinstance(job, dict) else None
