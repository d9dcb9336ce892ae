r"""Numbers of all cases of a sweep together: spread, sensitivities with intervals, and yield.

The sensitivity to a field is its coefficient b in the least-squares plane

    value = a + sum over the numeric fields of b (field - its mean),

with the 95 % interval of Student's t for the residuals' degrees of freedom. The plane's residuals are curvature and
what is drawn by chance, so an interval tells how well a plane describes the cases, not how well a case is computed.
Beside it stands the range of the means at the field's values, or in five equal parts of what was drawn, which sees
curves and valleys too; fields are ranked by it. What the plane has of the other fields is taken away first: draws
of two fields are never quite independent.

A yield of k in n has Wilson's interval (E. B. Wilson, J. Am. Stat. Assoc. 22, 209, 1927), which holds for few cases and
for all or none of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.camera.scores import CONFIDENCE
from maskfab.job.sweep_file import LimitSection
from maskfab.runs.store import Record
from maskfab.runs.sweep_plan import Field, Plan

_PARTS = 5
_SEED = "seed"


class Of(NamedTuple):
    """Identity of a number in a case."""

    name: str
    die: str | None
    wavelength_nm: float | None
    level_db: float | None


@dataclass(frozen=True, eq=False)
class Series:
    """One number in every case, float64 [cases], NaN where a case failed or has no such number."""

    of: Of
    unit: str
    values: Floats

    @cached_property
    def known(self) -> Floats:
        """Values without NaN."""
        return self.values[np.isfinite(self.values)]

    def quantile(self, share: float) -> float:
        """Value that such a share of the cases lies below."""
        return float(np.quantile(self.known, share))


@dataclass(frozen=True)
class Sensitivity:
    """Dependence of a number on a field.

    Attributes:
        unit: of the number by that of the field.
        slope: coefficient of the plane; NaN for a field that is no number.
        half_width: of its 95 % interval; NaN where there are no more cases than coefficients.
        range: of the means over the field's values.
        share: that range by the range of all cases.
    """

    of: Of
    field: str
    unit: str
    slope: float
    half_width: float
    range: float
    share: float


@dataclass(frozen=True)
class Yield:
    """Cases that keep every limit.

    Attributes:
        die: whose they are; None for all dies of a case.
        cases: number of all; those that failed have kept none.
        low, high: Wilson's 95 % interval of the share.
    """

    die: str | None
    kept: int
    cases: int
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Swept:
    """A sweep that was made; ``remade`` cases were found this time."""

    plan: Plan
    records: tuple[Record, ...]
    remade: int

    @property
    def failed(self) -> tuple[tuple[int, str], ...]:
        """Numbers of the cases that have none, and why."""
        return tuple((i, record["failed"]) for i, record in enumerate(self.records) if record["failed"] is not None)

    @cached_property
    def series(self) -> tuple[Series, ...]:
        """Every number that some case has, in the order in which quantities were asked for."""
        columns: dict[Of, tuple[str, Floats]] = {}
        for i, record in enumerate(self.records):
            for row in record["rows"]:
                if isinstance(row["value"], int | float):
                    _, values = columns.setdefault(_of(row), (row["unit"], np.full(len(self.records), math.nan)))
                    values[i] = row["value"]
        order = self.plan.quantities.index
        return tuple(Series(of, *columns[of]) for of in sorted(columns, key=lambda of: order(of.name)))

    @cached_property
    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """Sensitivities of every number to every field, of each quantity the strongest first."""
        every = [effect for series in self.series for effect in _sensitivities(series, self.plan)]
        order = self.plan.quantities.index
        return tuple(sorted(every, key=lambda effect: (order(effect.of.name), -effect.range)))

    @cached_property
    def yields(self) -> tuple[Yield, ...]:
        """Yields of all dies together and of each; none without a limit."""
        judged = [_judged(record, self.plan.limits) for record in self.records]
        if not any(judged):
            return ()
        dies = [die.name for die in self.plan.job.spec.die]
        every = [None, *dies] if len(dies) > 1 else dies
        return tuple(_yield(die, judged) for die in every)


def axis(field: Field, cases: Sequence[Any]) -> Floats | None:
    """A field's numbers, [cases]; None for one that is no scale, as seeds are none."""
    if not field.numeric or any(path[-1] == _SEED for path in field.paths):
        return None
    return np.array([level.number for level in cases], dtype=np.float64)


def wilson(passed: int, cases: int) -> tuple[float, float]:
    """Ends of Wilson's 95 % interval for the share of which so many were seen."""
    from scipy.special import ndtri  # slow to load, and few sweeps have limits

    z = float(ndtri((1 + CONFIDENCE) / 2))
    middle, spread = passed + z * z / 2, z * math.sqrt(passed * (cases - passed) / cases + z * z / 4)
    whole = cases + z * z
    return max(0.0, (middle - spread) / whole), min(1.0, (middle + spread) / whole)


def _of(row: Mapping[str, Any]) -> Of:
    return Of(row["name"], row["die"], row["wavelength_nm"], row["level_db"])


def _sensitivities(series: Series, plan: Plan) -> list[Sensitivity]:
    finite = np.isfinite(series.values)
    values = series.values[finite]
    if values.size < 2:
        return []
    whole = float(np.ptp(values))
    axes = [axis(field, [case.levels[i] for case in plan.cases]) for i, field in enumerate(plan.fields)]
    numeric = [i for i, places in enumerate(axes) if places is not None and np.ptp(places[finite]) > 0]
    slopes = _plane(np.array([axes[i][finite] for i in numeric]), values) if numeric else []  # type: ignore[index]
    by_field = dict(zip(numeric, slopes, strict=True))
    parts = {j: slope * (axes[j] - axes[j].mean()) for j, (slope, _) in by_field.items() if math.isfinite(slope)}  # type: ignore[union-attr]
    effects = []
    for i, field in enumerate(plan.fields):
        different = len({case.stated[i] for case in plan.cases})
        if different < 2:
            continue
        if axes[i] is None and different == len(plan.cases) and len(axes) > 1:
            continue  # every case has its own, so that all that differs would be its doing
        alone = series.values - sum(part for j, part in parts.items() if j != i)
        means = _means(axes[i], field, [case.levels[i].stated for case in plan.cases], alone)
        extent = float(np.ptp(means)) if means.size else 0.0
        slope, half = by_field.get(i, (math.nan, math.nan))
        unit = f"{series.unit or '1'}/{field.unit}" if field.unit else series.unit
        effects.append(Sensitivity(series.of, field.name, unit, slope, half, extent, extent / whole if whole else 0.0))
    return effects


def _plane(fields: Floats, values: Floats) -> list[tuple[float, float]]:
    """Slope of the least-squares plane along every field, and half its interval."""
    scale = np.ptp(fields, axis=1)
    centred = ((fields - fields.mean(axis=1, keepdims=True)) / scale[:, None]).T
    design = np.column_stack([np.ones(values.size), centred])
    fit, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
    free = values.size - design.shape[1]
    slopes = fit[1:] / scale
    if rank < design.shape[1]:  # fields that only vary together have no slopes of their own
        return [(math.nan, math.nan)] * len(scale)
    if free < 1:
        return [(float(slope), math.nan) for slope in slopes]
    from scipy.special import stdtrit  # slow to load, and not every sweep has slopes

    variance = float(((values - design @ fit) ** 2).sum()) / free
    errors = np.sqrt(np.diag(np.linalg.inv(design.T @ design))[1:] * variance) / scale
    half = float(stdtrit(free, (1 + CONFIDENCE) / 2)) * errors
    return [(float(slope), float(deviation)) for slope, deviation in zip(slopes, half, strict=True)]


def _means(numbers: Floats | None, field: Field, stated: Sequence[Any], values: Floats) -> Floats:
    if numbers is not None and field.drawn:
        groups = np.minimum(np.argsort(np.argsort(numbers)) * _PARTS // numbers.size, _PARTS - 1)
    else:
        _, groups = np.unique([str(value) for value in stated], return_inverse=True)
    own = [values[(groups == k) & np.isfinite(values)] for k in range(int(groups.max()) + 1)]
    return np.array([group.mean() for group in own if group.size])


def _judged(record: Record, limits: Sequence[LimitSection]) -> dict[str | None, bool] | None:
    """Whether each die keeps its limits, as far as it has any; None for a case that failed."""
    if record["failed"] is not None:
        return None
    outcome: dict[str | None, bool] = {}
    for row in record["rows"]:
        verdicts = [] if row["passed"] is None else [bool(row["passed"])]
        verdicts += [_keeps(row["value"], limit) for limit in limits if limit.quantity == row["name"]]
        for verdict in verdicts:
            outcome[row["die"]] = outcome.get(row["die"], True) and verdict
    return outcome


def _keeps(value: Any, limit: LimitSection) -> bool:
    if not isinstance(value, int | float):
        return False
    low, high = limit.at_least, limit.at_most
    return (low is None or value >= low) and (high is None or value <= high)


def _yield(die: str | None, judged: Sequence[Mapping[str | None, bool] | None]) -> Yield:
    passed = sum(
        verdicts is not None and (all(verdicts.values()) if die is None else verdicts.get(die, True))
        for verdicts in judged
    )
    return Yield(die, passed, len(judged), *wilson(passed, len(judged)))
