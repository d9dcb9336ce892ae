"""The parts of a report.json that a comparison reads, a file from outside: edited ones are refused before any work."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from maskfab.errors import InputError
from maskfab.jobfile.values import check_name
from maskfab.report.page.die_table import WORST

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
