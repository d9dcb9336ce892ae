"""Bands of a die's numbers over the displays that are made, from a few full cases about the process stated.

A number f of a written die is expanded about the process stated, in standard deviations x of the bias and y of the
corner radius,

    f = f0 + a x + c x² + b y + d y²,

from full cases at two deviations either way, where the edges of a band are; where a radius cannot be less by two, from
rounder ones by one and by two. A full case wider and rounder, as far from the process stated as the edges are, tells
the error: what the expansion misses of it are products of x and y and higher powers.

A band lies between the quantiles of 2.5 and 97.5 % of the expansion over two independent normal distributions. The PSF
is expanded in the same way, point by point, and the change of its shape is the distance that the expansion goes; its
band is the quantile of 95 %.

Restored photographs have bands of a die's PSNR, and of its gain. The scenes of the report are photographed through the
die as full cases of its process make it, and restored by the filter of the die as drawn, which is all that the maker of
a camera knows of a display. They are scored as those of the report. Dies of one plate are written alike, so that the
gain is the difference of two expansions of the mean PSNR.

Notes:
    Where noise is drawn it is that of the same normal numbers in every case: whole electrons then move the mean of the
    scenes off its smooth course by 0.001 dB. Only the change from the die as drawn is kept.
    Edges that move by a share of a part of a dot make it grey. Parts of another width tell the error of that, which
    falls at least as their width does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Generic, TypeAlias, TypeVar

import numpy as np
import scipy

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.model import Die, Panel, Quantity
from maskfab.base.units import NM_PER_UM
from maskfab.camera.die_transfer import MOST_ACROSS, DieTransfer
from maskfab.camera.field_transfer import OverField
from maskfab.camera.imaging import Design, RestoredBy
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.findings.as_written import Written, WrittenOptics, fused_optics, parts_about_edges, written_openings
from maskfab.findings.photographs import Conditions, Photographs, Surroundings, drawn_scenes, middle_level, noise_told
from maskfab.findings.scene import scene_reach_um
from maskfab.job.camera import Camera
from maskfab.job.process import Process
from maskfab.mask.writer import Reading, check_process
from maskfab.optics import metrics
from maskfab.optics.mtf import area_under_radial_min, frequency_at, worst_directions
from maskfab.optics.psf import pixel_margin, pixel_psf, point_step_um

Case = TypeVar("Case")
Terms: TypeAlias = tuple[Floats, Floats, Floats, Floats]

SHARE = 0.95
"""Of the displays, within a band."""
FULL_CASES = 5
CORNER = (math.sqrt(2), math.sqrt(2))
"""Deviations of bias and radius, together as far off as an edge."""
_STEPS = 201
_SIDES = (-2.0, 2.0)


@dataclass(frozen=True)
class ProcessSpread:
    """Standard deviations over the displays that are made, of the width of clear features and of the corner radius."""

    bias_um: float = 0.0
    radius_um: float = 0.0

    def __bool__(self) -> bool:
        return bool(self.bias_um or self.radius_um)

    def moved(self, process: Process, x: float, y: float) -> Process:
        """The process so many deviations of bias and radius off."""
        bias, radius = process.cd_bias_um + x * self.bias_um, process.corner_radius_um + y * self.radius_um
        return replace(process, corner_radius_um=radius, cd_bias_um=bias)

    def deviations(self, process: Process) -> tuple[Floats, Floats]:
        """Equally likely deviations of bias and radius, [n, n] of all pairs; a radius below zero counts as zero."""
        steps = scipy.special.ndtri((np.arange(_STEPS) + 0.5) / _STEPS)
        none = np.zeros(1)
        x = steps if self.bias_um else none
        y = np.maximum(steps, -process.corner_radius_um / self.radius_um) if self.radius_um else none
        across, down = np.meshgrid(x, y)
        return across, down


@dataclass(frozen=True)
class Expansion:
    """A number about the process stated; differences of two are those of the two numbers in one process.

    Attributes:
        nominal: f0.
        terms: a, c, b and d.
        missed: by how much full cases lie above what is expanded, each for a reason of its own.
    """

    nominal: float
    terms: tuple[float, float, float, float]
    missed: tuple[float, ...]

    def __sub__(self, other: Expansion) -> Expansion:
        a, c, b, d = (one - two for one, two in zip(self.terms, other.terms, strict=True))
        missed = tuple(one - two for one, two in zip(self.missed, other.missed, strict=True))
        return Expansion(self.nominal - other.nominal, (a, c, b, d), missed)

    def edges(self, deviations: tuple[Floats, Floats]) -> tuple[float, float]:
        """The quantiles of 2.5 and 97.5 % over deviations that are equally likely."""
        (a, c, b, d), (x, y) = self.terms, deviations
        values = self.nominal + a * x + c * x**2 + b * y + d * y**2
        low, high = np.quantile(values, [(1 - SHARE) / 2, (1 + SHARE) / 2])
        return float(low), float(high)

    @property
    def error(self) -> float:
        """Error of either edge."""
        return math.fsum(map(abs, self.missed))


@dataclass(frozen=True, eq=False)
class Cases(Generic[Case]):
    """Full cases about the nominal one.

    Attributes:
        bias: narrower and wider by two deviations; the nominal one twice without a spread.
        radius: sharper and rounder likewise, or rounder twice.
        sides: their deviations.
        corner: wider and rounder.
    """

    nominal: Case
    bias: tuple[Case, Case]
    radius: tuple[Case, Case]
    sides: tuple[float, float]
    corner: Case

    @classmethod
    def about(
        cls, process: Process, spread: ProcessSpread, made: Callable[[Process], Case], nominal: Case
    ) -> Cases[Case]:
        """Cases of a process, each made by a function of it; the nominal one is known."""

        def at(x: float, y: float) -> Case:
            moved = spread.moved(process, x, y)
            return nominal if moved == process else made(moved)

        sides = _sides(process, spread)
        near, far = (at(0, side) for side in sides)
        narrow, wide = (at(side, 0) for side in _SIDES)
        return cls(nominal, (narrow, wide), (near, far), sides, at(*CORNER))

    def terms(self, number: Callable[[Case], Floats]) -> Terms:
        """a, c, b and d of a number, or of an array of them."""
        f0 = number(self.nominal)
        bias = _parabola(_SIDES, *(number(case) - f0 for case in self.bias))
        return (*bias, *_parabola(self.sides, *(number(case) - f0 for case in self.radius)))

    def expansion(self, number: Callable[[Case], Floats]) -> Expansion:
        """Expansion of a number."""
        f0, terms = number(self.nominal), self.terms(number)
        a, c, b, d = (float(term) for term in terms)
        return Expansion(float(f0), (a, c, b, d), (float(number(self.corner) - f0 - at_corner(terms)),))


def at_corner(terms: Terms) -> Floats:
    """The change that an expansion has for the case wider and rounder."""
    across, down = CORNER
    a, c, b, d = terms
    return np.asarray(a * across + c * across**2 + b * down + d * down**2)


def check_spread(process: Process, spread: ProcessSpread, panel: Panel, where: str = "") -> None:
    """Refuse a spread of which some case cannot be written on a panel's dots."""
    for x, y in ((-2, 0), (2, 0), (0, 2), CORNER):
        check_process(spread.moved(process, x, y), panel, f"{where}, with process.spread")


def _sides(process: Process, spread: ProcessSpread) -> tuple[float, float]:
    """Deviations of the radius in full cases: to either side, or rounder alone where it cannot be less by as much."""
    return (1.0, 2.0) if process.corner_radius_um < 2 * spread.radius_um else _SIDES


def _parabola(places: tuple[float, float], near: Floats, far: Floats) -> tuple[Floats, Floats]:
    """Linear and square term of the parabola through 0 at 0 and through two values at two places."""
    p, q = places
    square = (near / p - far / q) / (p - q)
    return near / p - square * p, square


BIAS_UM = 0.1
"""Of the bias, by which dies are ranked."""
_ROUNDING = 1e-12
HOW = (
    f"expansion to second order from {FULL_CASES} full cases about the process stated, kissing corners fused; error: "
    "what it misses of a case wider and rounder"
)


@dataclass(frozen=True)
class Band:
    """The band of one number.

    Attributes:
        wavelength_nm: that it holds for; None for all.
        nominal: number of the process as stated; 0 for a change.
        error: of either edge.
        by_bias, by_radius: change of the number by one standard deviation of each, to first order.
    """

    name: str
    wavelength_nm: float | None
    nominal: float
    low: float
    high: float
    error: float
    by_bias: float
    by_radius: float

    @classmethod
    def of(cls, name: str, line: float | None, expansion: Expansion, process: Process, spread: ProcessSpread) -> Band:
        """Band of a number that was expanded about a process."""
        low, high = expansion.edges(spread.deviations(process))
        return cls(name, line, expansion.nominal, low, high, expansion.error, expansion.terms[0], expansion.terms[2])

    def row(self, die: str, spread: ProcessSpread, how: str = HOW, level_db: float | None = None) -> Quantity:
        """As a row of a report; of a change the band begins at 0, and its value is the upper edge."""
        change = self.low == self.nominal == 0
        said = ", ".join(
            f"{term:+.2g} by {deviation:g} um of {what}"
            for term, deviation, what in (
                (self.by_bias, spread.bias_um, "bias"),
                (self.by_radius, spread.radius_um, "corner radius"),
            )
            if deviation
        )
        between = f"up to {self.high:.2g}" if change else f"from {self.low:.5g} to {self.high:.5g}"
        return Quantity(
            self.name,
            self.high if change else (self.high - self.low) / 2,
            f"{SHARE:.0%} of displays lie {between}, {said}: {how}",
            uncertainty=self.error,
            die=die,
            wavelength_nm=self.wavelength_nm,
            level_db=level_db,
            between=(self.low, self.high),
        )


def sensitivity(name: str, band: Band, die: str, spread: ProcessSpread, level_db: float | None = None) -> Quantity:
    """The change of a band's number by a tenth of a micrometre of bias, as a row of a report."""
    return Quantity(
        name,
        band.by_bias * BIAS_UM / spread.bias_um,
        f"first order in the bias, from full cases two deviations of {spread.bias_um:g} um narrower and wider",
        uncertainty=band.error * BIAS_UM / spread.bias_um,
        die=die,
        wavelength_nm=band.wavelength_nm,
        level_db=level_db,
    )


def band_quantities(
    written: Written, camera: Camera, spread: ProcessSpread, frequencies: Sequence[float] = (), where: str = ""
) -> tuple[Quantity, ...]:
    """The bands of a written die's numbers and the sensitivity of its PSF, as rows of a report; none without a spread.

    Args:
        frequencies: at which the MTF in its worst direction is told, cycles per millimetre of sensor.
    """
    name, named = written.die.name, bands(written, camera, spread, frequencies, where)
    rows = [band.row(name, spread) for band in named]
    if named and spread.bias_um:
        rows.append(sensitivity("sensitivity_psf_shape", named[-1], name, spread))
    return tuple(rows)


def bands(
    written: Written, camera: Camera, spread: ProcessSpread, frequencies: Sequence[float] = (), where: str = ""
) -> tuple[Band, ...]:
    """The bands of a written die's numbers, that of the PSF's shape last, for kissing corners fused; arguments and
    errors as above."""
    if not spread:
        return ()
    process, nominal = written.process, written.readings[Reading.FUSED]

    def made(moved: Process) -> WrittenOptics:
        return fused_optics(written.die, camera, moved, nominal.psf, f"{where}: process.spread")

    cases = Cases.about(process, spread, made, nominal)

    def band(name: str, line: float | None, number: Callable[[WrittenOptics], Floats]) -> Band:
        return Band.of(name, line, cases.expansion(number), process, spread)

    rows = [band("band_stop_open_ratio", None, lambda optics: np.array(optics.open_ratio))]
    for i, line in enumerate(camera.wavelengths_nm):
        rows.append(band("band_auc_radial_min", line, partial(_auc, i)))
        if all(frequency_at(optics.mtfs[i], 0.5) for optics in (nominal, *cases.bias, *cases.radius, cases.corner)):
            rows.append(band("band_mtf50", line, partial(_mtf50, i)))
        rows += [
            band(f"band_mtf_worst_{frequency:g}", line, partial(_worst, i, frequency)) for frequency in frequencies
        ]
    pixels = _inner(camera)
    if pixels is not None:
        rows.append(band("band_halo_energy", nominal.psf.wavelength_nm, partial(_halo, pixels)))
    return (*rows, _shape_band(cases, spread.deviations(process)))


def _auc(line: int, optics: WrittenOptics) -> Floats:
    return np.array(area_under_radial_min(optics.mtfs[line]))


def _mtf50(line: int, optics: WrittenOptics) -> Floats:
    frequency = frequency_at(optics.mtfs[line], 0.5)
    assert frequency is not None
    return np.array(frequency[0])


def _worst(line: int, frequency: float, optics: WrittenOptics) -> Floats:
    (modulation,) = worst_directions(optics.mtfs[line], (frequency,), None)
    # Where a direction is lost altogether, what is left of it is rounding.
    return np.array(float(modulation) if float(modulation) > _ROUNDING else 0.0)


def _halo(camera: Camera, optics: WrittenOptics) -> Floats:
    return np.array(float(metrics.halo_of(pixel_psf(optics.psf, camera), None)))


def _inner(camera: Camera) -> Camera | None:
    """The camera with a window smaller by the points that means over pixels need; None where it holds no halo."""
    window = camera.window_um - 2 * (pixel_margin(camera) * point_step_um(camera) + camera.pixel_um)
    return replace(camera, window_um=window) if metrics.holds_halo(window) else None


def _shape_band(cases: Cases[WrittenOptics], deviations: tuple[Floats, Floats]) -> Band:
    """The change of the PSF's shape: distances from lengths and angles of the expansion's four terms."""

    def to_peak(optics: WrittenOptics) -> Floats:
        return np.asarray(optics.psf.values / optics.psf.values.max())

    f0, (x, y) = to_peak(cases.nominal), deviations
    terms = cases.terms(to_peak)
    angles = np.array([[float(np.vdot(one, other)) for other in terms] for one in terms])
    size = float(np.linalg.norm(f0))
    share = np.stack([x, x**2, y, y**2]).reshape(4, -1)
    squares = np.einsum("ik,ij,jk->k", share, angles, share)
    high = float(np.quantile(np.sqrt(np.maximum(squares, 0)), SHARE)) / size
    missed = float(np.linalg.norm(to_peak(cases.corner) - f0 - at_corner(terms))) / size
    first = [math.sqrt(max(0.0, angles[k, k])) / size for k in (0, 2)]
    return Band("band_psf_shape", cases.nominal.psf.wavelength_nm, 0.0, 0.0, high, missed, *first)


DRAWN = Process(0.0)


@dataclass(frozen=True, eq=False)
class _Photographed:
    """A die whose processes are photographed, each restored by the filter of the die as drawn.

    Attributes:
        half_width_um: of the openings that light comes through; None for those in front of the stop.
        parts: of a dot.
    """

    die: Die
    camera: Camera
    drawn: DieTransfer | OverField
    conditions: Conditions
    half_width_um: float | None
    parts: int

    @cached_property
    def _level_db(self) -> float:
        return middle_level(self.conditions.levels)

    @cached_property
    def _protocol(self) -> Protocol:
        """With the strength that suits the die as drawn."""
        protocol = self.conditions.protocol
        return replace(protocol, strengths=(self._scored(protocol, self.drawn)[0],))

    def psnr(self, process: Process, parts: int | None = None) -> float:
        """Mean over the scenes in dB, by so many parts of a dot, or the usual number."""
        parts = parts or self.parts
        openings = written_openings(self.die, self.camera, process, parts, self.half_width_um)
        seen = self.drawn.through(openings, parts)
        return self._scored(self._protocol, RestoredBy(seen, self.drawn))[1]

    def _scored(self, protocol: Protocol, design: Design) -> tuple[float, float]:
        scenes = drawn_scenes(highlights=bool(protocol.brackets))
        given = [design], scenes, scenes, [self._level_db]
        scores = evaluate(*given, protocol=protocol, details=False, expected=True).scores
        return scores[0].epsilon, float(np.mean([score.psnr for score in scores]))


def restored_expansion(
    conditions: Conditions, around: Surroundings, die: Die, process: Process, spread: ProcessSpread, where: str = ""
) -> Expansion | str:
    """The change of a die's restored PSNR from the drawing to what the process makes of it, in dB.

    Returns:
        The expansion, at the middle level of light; missed are a case wider and rounder, and what the width of
        parts of dots makes of it. A sentence, with its code, where the die cannot be photographed, its dots cannot be
        divided, or they do not bear the spread.
    """
    camera, scene = conditions.camera, around.scene
    assert isinstance(camera, Camera)
    reach = None if scene is None or not scene.gap_um else scene_reach_um(camera, scene)
    try:
        drawn, _ = conditions.design(die.name, die.panel, around)
        parts, others = parts_about_edges(die, camera, spread.moved(process, 2, 0), where)
        across = max(parts, others) * camera.stop.diameter_um / (die.panel.dot_nm / NM_PER_UM)
        if across > MOST_ACROSS:
            return f"the stop is {across:.0f} parts of dots across, photographs take {MOST_ACROSS} at most"
        assert isinstance(drawn, DieTransfer | OverField)
        seen = _Photographed(die, camera, drawn, conditions, reach, parts)
        stated = seen.psnr(process)
    except JobError as refusal:
        return f"{refusal.code} {refusal.what}"
    corner = spread.moved(process, *CORNER)
    cases = Cases.about(process, spread, seen.psnr, stated)
    expansion = cases.expansion(np.array)
    by_others = seen.psnr(corner, others) - seen.psnr(process, others)
    # As of an error in proportion to the width of parts.
    by_parts = others / (parts - others) * (cases.corner - stated - by_others)
    drawn_psnr = stated if process == DRAWN else seen.psnr(DRAWN)
    return Expansion(stated - drawn_psnr, expansion.terms, (*expansion.missed, by_parts))


def restored_bands(
    photographs: Photographs, name: str, changes: Mapping[str, Expansion | str], process: Process, spread: ProcessSpread
) -> Iterator[Quantity]:
    """The bands of a die's PSNR and gain, and its sensitivity, as rows of a report."""
    own, level = changes[name], middle_level(photographs.conditions.levels)
    if isinstance(own, str):
        yield Quantity("band_restored_psnr", None, f"not found: {own}", die=name, level_db=level)
        return
    noise = noise_told(level, photographs.dies[name])
    how = (
        f"expansion to second order from {FULL_CASES} full cases about the process stated, kissing corners fused, "
        f"photographed and restored by the filter of the die as drawn, {noise}; error: what it misses of a "
        "case wider and rounder, and what the width of the parts of dots makes of it"
    )
    band = _band("band_restored_psnr", photographs.dies[name].psnr(level), own, process, spread)
    yield band.row(name, spread, how, level)
    if spread.bias_um:
        yield sensitivity("sensitivity_restored_psnr", band, name, spread, level)
    reference = photographs.reference
    of_reference = None if reference is None else changes.get(reference)
    for gain in photographs.gains[name]:
        if gain.level_db == level and isinstance(of_reference, Expansion):
            band = _band("band_restored_gain", gain.psnr.mean, own - of_reference, process, spread)
            yield band.row(name, spread, f"{how}; {reference} is written alike", level)


def _band(name: str, drawn: float, change: Expansion, process: Process, spread: ProcessSpread) -> Band:
    return Band.of(name, None, replace(change, nominal=drawn + change.nominal), process, spread)
