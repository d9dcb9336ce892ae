"""The study file of a sweep: a job, keys of it that take other values, and the quantities that are wanted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from maskfab.base.errors import JobError
from maskfab.job.faults import parse_section
from maskfab.job.read import document
from maskfab.job.values import Counts, Names, Section, checks, parsed

Scalar: TypeAlias = bool | int | float | str
Value: TypeAlias = Scalar | tuple[Scalar, ...]
"""One value of a key, as a job file writes it; of a key that holds a list, the list or its only item."""


def read_value(stated: object, where: str = "") -> Value:
    """A value of a key from what a file or a caller states. Raises JobError MF105 for what is none."""
    if isinstance(stated, list | tuple) and stated and all(isinstance(item, Scalar) for item in stated):
        return tuple(stated)
    if isinstance(stated, Scalar):
        return stated
    cure = 'Write a number, text such as "2 um", true or false, or a list of these for a key that holds a list'
    raise JobError("MF105", f"{stated!r:.60} is no value of a key", where=where, cure=cure)


_Value = Annotated[Value, parsed(read_value)]
Family = Literal["bars", "discs", "l_shapes", "crosses", "blobs"]


class NormalSection(Section):
    """field.normal: values drawn from a normal distribution."""

    mean: _Value
    """Its mean."""
    sigma: _Value
    """Its standard deviation."""


class ShapesSection(Section):
    """field.shapes: openings drawn from families of compact shapes, each shape as likely as any other."""

    families: Annotated[tuple[Family, ...], Field(min_length=1, strict=False)]
    """Families that are drawn from."""
    dots: int = Field(ge=1, le=128)
    """Dots along a side of the cell."""
    clear_dots: Counts
    """Numbers of clear dots: a list, or { from, to, step }."""


class FieldSection(Section):
    """[[field]]: a key of the job, and the values that it takes, stated in one of five ways.

    Listed and ranged fields are combined with each other, every value with every other. Fields that are drawn all get
    a new value for each of ``sweep.cases`` draws, and every draw is combined with every listed value.
    """

    key: Names
    """Key of the job, such as process.cd_bias or die.TOLED_R150.seed, or keys that take the same value; die.* means
    every die of the sweep."""
    values: Annotated[tuple[_Value, ...], Field(min_length=1, strict=False)] | None = None
    """Values, one after the other; of a key that holds a list, such as camera.wavelengths, lists or single items."""
    first: _Value | None = Field(default=None, alias="from")
    """First value of a range, with its unit."""
    last: _Value | None = Field(default=None, alias="to")
    """Last value of the range, in the same unit."""
    count: int | None = Field(default=None, ge=2)
    """Number of values of the range, evenly spaced."""
    uniform: Annotated[tuple[_Value, _Value], Field(strict=False)] | None = None
    """Ends of an interval from which values are drawn."""
    normal: NormalSection | None = None
    """Normal distribution from which values are drawn."""
    shapes: ShapesSection | None = None
    """Families of shapes from which openings are drawn; the key is one of die.NAME.opening."""

    @property
    def drawn(self) -> bool:
        """Whether values are drawn by chance."""
        return self.values is None and self.first is None

    @checks
    def _one_way(self) -> None:
        ways = {"from": self.first, **{way: getattr(self, way) for way in ("uniform", "normal", "shapes")}}
        stated = [way for way, value in {"values": self.values, **ways}.items() if value is not None]
        if len(stated) != 1:
            account = f"states {' and '.join(stated)}" if stated else "states no values"
            cure = 'Give one of values, from with to and count, uniform, normal, shapes: values = ["0 um", "0.5 um"]'
            raise JobError("MF160", f"the field {' and '.join(self.key)} {account}", cure=cure)
        if (self.first is not None) != (self.last is not None) or (self.first is None) != (self.count is None):
            what = f"the field {' and '.join(self.key)} has not all of from, to and count"
            raise JobError("MF160", what, cure='Write from = "-0.5 um", to = "0.5 um", count = 11')


class LimitSection(Section):
    """[[limit]]: what a quantity must keep, beside the job's [limits]: the yield is of the cases that keep all."""

    quantity: str
    """Name of a quantity of the sweep."""
    at_least: float | None = Field(default=None, allow_inf_nan=False)
    """Least value that passes."""
    at_most: float | None = Field(default=None, allow_inf_nan=False)
    """Largest value that passes."""

    @checks
    def _some_limit(self) -> None:
        if self.at_least is None and self.at_most is None:
            raise JobError("MF105", f"{self.quantity} has no limit", cure="Add at_least or at_most")


class SweepSection(Section):
    """[sweep]: the job, the numbers wanted of it, and how values are drawn."""

    title: str = Field(max_length=200)
    """Heading of its page."""
    about: str = Field(default="", max_length=1500)
    """Its subject, in a few sentences."""
    job: str
    """Path of the job file, relative to this one."""
    quantities: Names
    """Names of the quantities wanted, as report.json has them."""
    dies: Names | None = None
    """Dies that are looked at; default: all of the job."""
    cases: int | None = Field(default=None, ge=1)
    """Number of draws, if any field is drawn."""
    sampling: Literal["latin", "random"] = "latin"
    """Draws spread evenly over every field (a Latin hypercube), or each by itself."""
    seed: int = Field(default=0, ge=0)
    """Seed of the draws."""


class SweepSpec(Section):
    """A whole study file."""

    sweep: SweepSection
    field: Annotated[tuple[FieldSection, ...], Field(min_length=1, max_length=32, strict=False)]
    limit: Annotated[tuple[LimitSection, ...], Field(max_length=64, strict=False)] = ()


def read_sweep(path: Path) -> SweepSpec:
    """Load and validate a study file; nothing that it names is read yet.

    Raises:
        SourceError, JobError: as :func:`maskfab.job.read.read`; MF160 for a field that is not stated once.
    """
    return parse_section(SweepSpec, document(path, "study"), where=str(path))
