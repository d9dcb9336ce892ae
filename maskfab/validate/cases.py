"""Hard cases of the optics, each with an answer that is known and the error that may remain: ``maskfab bench --hard``.

The cases are those that break transforms in practice: nulls, cancellation, incommensurate lengths, replicas, far
origins, tiny stops, and the symmetries that every correct result must have.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from klayout import db
from numpy.typing import NDArray
from scipy.special import j1

from maskfab.geometry.stop import edges_in_stop
from maskfab.layout.tiling import orientations
from maskfab.model import Camera, Opening, Panel, Stop, Tiling, orient
from maskfab.optics.aperture import Aperture, panel_aperture
from maskfab.optics.field import direct_field, parity_field
from maskfab.optics.otf import lag_table
from maskfab.optics.polygons import boundary
from maskfab.optics.psf import image_scale_um2, point_psf
from maskfab.optics.pupil import Pupil, cut

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Case:
    """A problem with a known answer.

    Attributes:
        name: what is hard.
        method: what is compared with what, and how the error is measured.
        measure: runs the case and returns the error.
        limit: the largest error that passes.
    """

    name: str
    method: str
    measure: Callable[[], float]
    limit: float


@dataclass(frozen=True)
class Outcome:
    """A case that was run."""

    case: Case
    error: float
    seconds: float

    @property
    def passed(self) -> bool:
        return bool(self.error <= self.case.limit)


def run(cases: Iterable[Case]) -> Iterator[Outcome]:
    """Run cases one by one."""
    for case in cases:
        start = time.perf_counter()
        error = case.measure()
        yield Outcome(case, error, time.perf_counter() - start)


def relative(found: NDArray[np.number[Any]], expected: NDArray[np.number[Any]]) -> float:
    """Relative L2 distance."""
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def _noise(dots: int, share: float, seed: int) -> Mask:
    mask = np.random.default_rng(seed).random((dots, dots)) < share
    mask[0, 0] = True
    return mask


def _panel(mask: Mask, *, dot_nm: int = 8000, gutter_nm: int = 0, cells: int, seed: int | None = None) -> Panel:
    tiling = Tiling.PERIODIC if seed is None else Tiling.RANDOM
    chosen = orientations(tiling, cells, cells, seed)
    return Panel(Opening("case", mask, dot_nm), dot_nm, gutter_nm, chosen, tiling, seed)


def _camera(diameter_um: float, wavelength_nm: float = 530.0, window_um: float = 128.0) -> Camera:
    return Camera(10_000.0, Stop("circle", diameter_um), (wavelength_nm,), 2.0, window_um)


def _pupil(panel: Panel, stop: Stop) -> Pupil:
    return cut(panel_aperture(panel, stop.diameter_um / 2), stop)


def _region(panel: Panel) -> db.Region:
    aperture = panel_aperture(panel)
    x, y = (np.rint(1e3 * lattice.edges_um()).astype(int).tolist() for lattice in (aperture.x, aperture.y))
    found = db.Region()
    for j, i in zip(*np.nonzero(aperture.transmission), strict=True):
        found.insert(db.Box(x[i], y[j], x[i + 1], y[j + 1]))
    return found.merged(True, 1)


def _two_paths(panel: Panel, stop: Stop) -> float:
    """Relative L2 of the field between the matrix path and the polygon path over 65 x 65 frequencies."""
    edges, area = edges_in_stop(_region(panel), stop, (0.0, 0.0))
    step = 0.4e-3
    u = step * np.arange(33, dtype=np.float64)
    polygons = boundary(edges, area, float(u[-1]) * np.sqrt(2)).field(step, 65)
    return relative(parity_field(_pupil(panel, stop), u, u).amplitude(), polygons)


def exact_nulls() -> float:
    """Slits of 5 in 21 dots overlap nothing at lags of 6 to 15 dots."""
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:, 8:13] = True
    table = lag_table(_pupil(_panel(mask, cells=8), Stop("square", 8 * 168.0)))
    lags = 8.0 * np.arange(6, 16, dtype=np.float64)
    return float(abs(table.otf(lags, np.zeros_like(lags))).max())


def airy(diameter_um: float) -> float:
    """An open round stop on a grid of 8 um dots."""
    camera = _camera(diameter_um)
    cells = 2 * int(np.ceil(diameter_um / 80))
    found = point_psf(_pupil(_panel(np.ones((5, 5), dtype=np.bool_), cells=cells), camera.stop), camera, 530.0)
    scale = image_scale_um2(camera, 530.0)
    axis = found.step_um * (np.arange(found.values.shape[0], dtype=np.float64) - found.values.shape[0] // 2)
    argument = np.pi * diameter_um * np.hypot(axis[:, None], axis) / scale
    argument[argument == 0] = 1e-30
    expected = camera.stop.area_um2 * (2 * j1(argument) / argument) ** 2 / scale**2
    return relative(found.values, expected)


def stop_inside_one_dot() -> float:
    """A stop smaller than the dot in front of it is an open stop."""
    stop = Stop("circle", 6.0)
    pupil = _pupil(_panel(np.ones((3, 3), dtype=np.bool_), cells=1), stop)
    u = np.linspace(0.0, 0.1, 21)
    argument = np.pi * 6.0 * np.hypot(u[:, None], u)
    argument[0, 0] = 1e-30
    expected = stop.area_um2 * 2 * j1(argument) / argument
    return relative(direct_field(pupil, u, u), expected.astype(np.complex128))


def incommensurate_gutter() -> float:
    """8 um gutters on 4.03 um dots: matrix path against polygons."""
    return _two_paths(_panel(_noise(21, 0.2, 1), dot_nm=4030, gutter_nm=8000, cells=6, seed=1), Stop("circle", 500.0))


def half_grid_ties() -> float:
    """An odd number of odd cells puts the axis on half a nanometre: matrix path against polygons."""
    panel = _panel(_noise(5, 0.4, 2), dot_nm=4031, cells=3, seed=1)
    stop = Stop("square", 55.0)
    aperture = panel_aperture(panel)
    edge_nm = 1e3 * aperture.x.edges_um()
    lower = float(np.floor(edge_nm[0]))
    corners = [round(edge - edge_nm[0]) for edge in edge_nm]
    shape = db.Region()
    for j, i in zip(*np.nonzero(aperture.transmission), strict=True):
        shape.insert(db.Box(corners[i], corners[j], corners[i + 1], corners[j + 1]))
    middle = -float(edge_nm[0])
    edges, area = edges_in_stop(shape.merged(True, 1), stop, (middle, middle))
    assert lower != edge_nm[0]
    u = 0.4e-3 * np.arange(33, dtype=np.float64)
    polygons = boundary(edges, area, float(u[-1]) * np.sqrt(2)).field(0.4e-3, 65)
    return relative(parity_field(_pupil(panel, stop), u, u).amplitude(), polygons)


def far_origin() -> float:
    """The same polygons 50 mm away from the plate's origin have the same field to the last digits."""
    panel, stop = _panel(_noise(6, 0.4, 3), cells=6, seed=1), Stop("circle", 250.0)
    region, away = _region(panel), (50_000_000.0, -50_000_000.0)
    fields = []
    for centre in ((0.0, 0.0), away):
        edges, area = edges_in_stop(region.moved(int(centre[0]), int(centre[1])), stop, centre)
        fields.append(boundary(edges, area, 0.02).field(1e-3, 21))
    return relative(fields[1], fields[0])


def next_to_zero_frequency() -> float:
    """Polygon field at 1e-7 cycles/um against the area, where the boundary form divides by almost nothing."""
    panel, stop = _panel(_noise(6, 0.4, 3), cells=6, seed=1), Stop("square", 288.0)
    edges, area = edges_in_stop(_region(panel), stop, (0.0, 0.0))
    field = boundary(edges, area, 1e-3).field(1e-7, 3)
    exact = direct_field(_pupil(panel, stop), np.array([1e-7]), np.array([1e-7]))[0, 0]
    return float(abs(field[2, 2] - exact) / area)


def along_edges() -> float:
    """Frequencies along an edge's direction, where vertex formulas divide 0 by 0: one rectangle against its sinc."""
    region = db.Region(db.Box(-40_000, -30_000, 40_000, 30_000))
    edges, area = edges_in_stop(region, Stop("square", 200.0), (0.0, 0.0))
    found = boundary(edges, area, 0.05).field(1e-3, 61)
    q = 1e-3 * np.arange(-30, 31, dtype=np.float64)
    expected = 80.0 * np.sinc(80.0 * q) * (60.0 * np.sinc(60.0 * q))[:, None]
    return relative(found, expected.astype(np.complex128))


def replica() -> float:
    """At λf/dot from the axis a transform of points repeats its peak; dots have an exact zero there."""
    panel, stop = _panel(_noise(6, 0.4, 3), cells=6, seed=1), Stop("square", 288.0)
    field = direct_field(_pupil(panel, stop), np.array([0.0, 1 / 8.0]), np.array([0.0]))
    return float(abs(field[0, 1] / field[0, 0]) ** 2)


def kissing_corners() -> float:
    """A checkerboard, every corner of which kisses another: matrix path against polygons."""
    mask = np.indices((6, 6)).sum(axis=0) % 2 == 0
    return _two_paths(_panel(mask, cells=6), Stop("circle", 250.0))


def extreme_open_ratios() -> float:
    """1 and 49 of 50 dots clear: energy and MTF volume against the count."""
    worst = 0.0
    for clear in (1, 49):
        mask = np.arange(100).reshape(10, 10) % 50 < clear
        pupil = _pupil(_panel(mask, cells=6), Stop("square", 480.0))
        area = clear / 50 * 480.0**2
        worst = max(worst, abs(pupil.energy_um2 / area - 1), abs(lag_table(pupil).volume_um2 / area - 1))
    return worst


def single_dots() -> float:
    """One clear dot in each cell, and all of them: matrix path against polygons."""
    one = np.zeros((5, 5), dtype=np.bool_)
    one[1, 3] = True
    stop = Stop("circle", 250.0)
    return max(_two_paths(_panel(mask, cells=8, seed=1), stop) for mask in (one, np.ones_like(one)))


def subnormal_transmission() -> float:
    """A mask of transmission 1e-310 has the field of the opaque-or-clear one, scaled."""
    aperture = panel_aperture(_panel(_noise(6, 0.4, 3), cells=4))
    stop, u = Stop("circle", 150.0), np.linspace(0.0, 0.03, 11)
    dim = Aperture(aperture.x, aperture.y, 1e-310 * aperture.transmission, np.zeros_like(aperture.variance))
    exact = direct_field(cut(aperture, stop), u, u)
    return relative(direct_field(cut(dim, stop), u, u) * 1e300 * 1e10, exact)


def babinet() -> float:
    """A mask and its complement add up to the open stop."""
    mask, stop, u = _noise(6, 0.4, 3), Stop("circle", 250.0), np.linspace(0.0, 0.03, 33)
    whole, part, rest = (
        parity_field(_pupil(_panel(m, cells=6), stop), u, u).amplitude() for m in (np.ones_like(mask), mask, ~mask)
    )
    return relative(part + rest, whole)


def symmetries() -> float:
    """Each of the eight orientations of a mask turns its PSF alike."""
    aperture = panel_aperture(_panel(_noise(6, 0.4, 3), cells=5, seed=7))
    stop, u = Stop("circle", 200.0), np.linspace(0.0, 0.03, 33)
    plain = parity_field(cut(aperture, stop), u, u).intensity()
    worst = 0.0
    for k in range(8):
        turned = Aperture(aperture.x, aperture.y, orient(aperture.transmission, k).copy(), orient(aperture.variance, k))
        worst = max(worst, relative(parity_field(cut(turned, stop), u, u).intensity(), orient(plain, k)))
    return worst


def shift_theorem() -> float:
    """Moving the polygons multiplies the field by a phase."""
    region, stop = _region(_panel(_noise(6, 0.4, 3), cells=4)), Stop("square", 400.0)
    fields = []
    for shift in (0, 37_123):
        edges, area = edges_in_stop(region.moved(shift, 0), stop, (0.0, 0.0))
        fields.append(boundary(edges, area, 0.02).field(1e-3, 21))
    u = 1e-3 * np.arange(-10, 11, dtype=np.float64)
    return relative(fields[1], fields[0] * np.exp(-2j * np.pi * u * 37.123))


def linearity() -> float:
    """Half-transparent dots have half the field of the rest of the mask."""
    aperture = panel_aperture(_panel(_noise(6, 0.4, 3), cells=4))
    stop, u = Stop("circle", 150.0), np.linspace(0.0, 0.03, 21)
    left = np.where(np.arange(aperture.transmission.shape[1]) < 12, aperture.transmission, 0.0)
    none = np.zeros_like(aperture.variance)

    def field(transmission: Floats) -> NDArray[np.complex128]:
        return direct_field(cut(Aperture(aperture.x, aperture.y, transmission, none), stop), u, u)

    right = aperture.transmission - left
    return relative(field(0.5 * left + 0.25 * right), 0.5 * field(left) + 0.25 * field(right))


CASES = (
    Case("exact nulls of periodic slits", "MTF at lags that overlap nothing, absolute", exact_nulls, 1e-15),
    Case("round stop of 4 mm", "PSF against Airy, relative L2", lambda: airy(4000.0), 1e-9),
    Case("round stop of 0.1 mm", "PSF against Airy, relative L2", lambda: airy(100.0), 1e-9),
    Case("stop inside one dot", "field against Airy, relative L2", stop_inside_one_dot, 1e-6),
    Case("8 um gutters on 4.03 um dots", "matrix against polygons, relative L2", incommensurate_gutter, 1e-6),
    Case("axis on half a nanometre", "matrix against polygons, relative L2", half_grid_ties, 1e-9),
    Case("origin 50 mm away", "polygon field against that at the origin, relative L2", far_origin, 1e-9),
    Case("next to zero frequency", "polygon field against the matrix, over the area", next_to_zero_frequency, 1e-6),
    Case("frequencies along an edge", "polygon field against a sinc, relative L2", along_edges, 1e-9),
    Case("replica at λf/dot", "intensity there over the peak", replica, 1e-25),
    Case("kissing corners everywhere", "matrix against polygons, relative L2", kissing_corners, 1e-6),
    Case("open ratios 0.02 and 0.98", "energy and MTF volume against the count, relative", extreme_open_ratios, 1e-12),
    Case("single-dot and all-open cells", "matrix against polygons, relative L2", single_dots, 1e-6),
    Case("subnormal transmission", "scaled field, relative L2", subnormal_transmission, 1e-9),
    Case("Babinet's complement", "sum of fields against the open stop, relative L2", babinet, 1e-12),
    Case("eight orientations", "turned PSF, relative L2, worst", symmetries, 1e-12),
    Case("shift theorem", "moved field against a phase, relative L2", shift_theorem, 1e-7),
    Case("partial transmission", "linearity of the field, relative L2", linearity, 1e-12),
)
