"""Hard cases of the optics, each with a known answer and the error that may remain: ``maskfab self bench --hard``.

Panels, pupils and cameras are small, with nothing left to chance. The cases are those that break transforms in
practice: nulls, cancellation, incommensurate lengths, replicas, far origins, tiny stops, and the symmetries that every
correct result must have.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from klayout import db
from numpy.typing import NDArray
from scipy.special import j1

from maskfab.base.arrays import Complexes, Floats, Mask
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, Opening, Panel, Quantity, Tiling, orient
from maskfab.base.units import NM_PER_UM, UM_PER_NM
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import direct_field, parity_field
from maskfab.optics.field.methods import prepare_cells
from maskfab.optics.field.polygons import boundary
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import aliased_mtf
from maskfab.optics.psf import ReadyPupil, image_scale_um2, point_psf, point_step_um
from maskfab.optics.pupil import Aperture, Pupil, cut, panel_aperture
from maskfab.optics.restoration import noise_gain, sensor_square, wiener_response, worst_wiener
from maskfab.optics.spectrum import line_spectrum
from maskfab.optics.stop_edges import edges_in_stop
from maskfab.optics.tiling import orientations
from maskfab.optics.tiling_mean import mean_psf


def noise(dots: int, share: float, seed: int) -> Mask:
    """An opening without any symmetry, bool [dots, dots]: each dot clear with that probability, the first for sure."""
    mask = np.random.default_rng(seed).random((dots, dots)) < share
    mask[0, 0] = True
    return mask


def example_panel(
    mask: Mask, *, dot_nm: int = 8000, gutter_nm: int = 0, cells: int = 4, seed: int | None = None
) -> Panel:
    """Cells x cells of an opening, tiled periodically without a seed and randomly with one."""
    tiling = Tiling.PERIODIC if seed is None else Tiling.RANDOM
    chosen = orientations(tiling, cells, cells, seed)
    return Panel(Opening("case", mask, dot_nm), dot_nm, gutter_nm, chosen, tiling, seed)


def example_pupil(laid_out: Panel, stop: Stop) -> Pupil:
    """The pupil that a stop about the panel's middle leaves."""
    return cut(panel_aperture(laid_out, stop.diameter_um / 2), stop)


def example_camera(
    diameter_um: float = 400.0,
    shape: Literal["circle", "square"] = "circle",
    wavelengths: tuple[float, ...] = (530.0,),
    window_um: float = 128.0,
) -> Camera:
    """A camera of 10 mm focal length and 2 um pixels."""
    return Camera(10_000.0, Stop(shape, diameter_um), wavelengths, 2.0, window_um)


def clear_region(laid_out: Panel) -> db.Region:
    """The panel's clear dots as merged polygons about its middle, in nanometres, straight from the aperture's grid."""
    aperture = panel_aperture(laid_out)
    x, y = (np.rint(NM_PER_UM * lattice.edges_um()).astype(int).tolist() for lattice in (aperture.x, aperture.y))
    region = db.Region()
    for j, i in zip(*np.nonzero(aperture.transmission), strict=True):
        region.insert(db.Box(x[i], y[j], x[i + 1], y[j + 1]))
    return region.merged(True, 1)


@dataclass(frozen=True)
class Case:
    """A problem with a known answer."""

    name: str
    method: str
    measure: Callable[[], float]
    limit: float
    slow: bool = False


@dataclass(frozen=True)
class CaseResult:
    """A case that was run."""

    case: Case
    error: float
    seconds: float

    @property
    def passed(self) -> bool:
        return bool(self.error <= self.case.limit)


def run_cases(cases: Iterable[Case]) -> Iterator[CaseResult]:
    """Run cases one by one."""
    for case in cases:
        start = time.perf_counter()
        error = case.measure()
        yield CaseResult(case, error, time.perf_counter() - start)


def relative(values: NDArray[np.number[Any]], expected: NDArray[np.number[Any]]) -> float:
    """Relative L2 distance."""
    return float(np.linalg.norm(values - expected) / np.linalg.norm(expected))


def _two_paths(panel: Panel, stop: Stop) -> float:
    """Relative L2 of the field between the matrix path and the polygon path over 65 x 65 frequencies."""
    edges, area = edges_in_stop(clear_region(panel), stop, (0.0, 0.0))
    step = 0.4e-3
    u = step * np.arange(33, dtype=np.float64)
    polygons = boundary(edges, area, float(u[-1]) * np.sqrt(2)).field(step, 65)
    return relative(parity_field(example_pupil(panel, stop), u, u).amplitude(), polygons)


def exact_nulls() -> float:
    """Slits of 5 in 21 dots overlap nothing at lags of 6 to 15 dots."""
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:, 8:13] = True
    table = lag_table(example_pupil(example_panel(mask, cells=8), Stop("square", 8 * 168.0)))
    lags = 8.0 * np.arange(6, 16, dtype=np.float64)
    return float(abs(table.otf(lags, np.zeros_like(lags))).max())


def airy(diameter_um: float, *wavelengths_nm: float) -> float:
    """PSFs of an open round stop on a grid of 8 um dots, all on one grid of the sensor; the worst of them."""
    camera = example_camera(diameter_um, wavelengths=wavelengths_nm)
    cells = 2 * int(np.ceil(diameter_um / 80))
    worst = 0.0
    pupil = example_pupil(example_panel(np.ones((5, 5), dtype=np.bool_), cells=cells), camera.stop)
    for psf in ReadyPupil.of(pupil, camera).psfs():
        scale = image_scale_um2(camera, psf.wavelength_nm)
        axis = point_step_um(camera) * (np.arange(len(psf.values), dtype=np.float64) - len(psf.values) // 2)
        argument = np.pi * diameter_um * np.hypot(axis[:, None], axis) / scale
        argument[argument == 0] = 1e-30
        expected = camera.stop.area_um2 * (2 * j1(argument) / argument) ** 2 / scale**2
        worst = max(worst, relative(psf.values, expected))
    return worst


def stop_inside_one_dot() -> float:
    """A stop smaller than the dot in front of it is an open stop."""
    stop = Stop("circle", 6.0)
    pupil = example_pupil(example_panel(np.ones((3, 3), dtype=np.bool_), cells=1), stop)
    u = np.linspace(0.0, 0.1, 21)
    argument = np.pi * 6.0 * np.hypot(u[:, None], u)
    argument[0, 0] = 1e-30
    expected = stop.area_um2 * 2 * j1(argument) / argument
    return relative(direct_field(pupil, u, u), expected.astype(np.complex128))


def stop_of_one_dot() -> float:
    """A square stop as large as a dot, in front of one whole dot and of quarters of four."""
    stop, u = Stop("square", 8.0), np.linspace(0.0, 0.05, 21)
    expected = 64.0 * np.sinc(8.0 * u) * np.sinc(8.0 * u)[:, None]
    pupils = (example_pupil(example_panel(np.ones((dots, dots), dtype=np.bool_), cells=1), stop) for dots in (3, 4))
    return max(relative(direct_field(pupil, u, u), expected.astype(np.complex128)) for pupil in pupils)


def fine_dots() -> float:
    """A round stop of 4 mm over 4011 x 4011 dots of 1 um: cell by cell against complex products, few frequencies."""
    pupil = example_pupil(example_panel(noise(21, 0.2, 1), dot_nm=1000, cells=191, seed=1), Stop("circle", 4000.0))
    u = 1.5e-2 * np.arange(3, dtype=np.float64)
    amplitude = prepare_cells(pupil, float(u[-1]), float(u[-1])).field(u, u).amplitude()
    return relative(amplitude[2:, 2:], direct_field(pupil, u, u))


def incommensurate_gutter() -> float:
    """8 um gutters on 4.03 um dots: matrix path against polygons."""
    return _two_paths(
        example_panel(noise(21, 0.2, 1), dot_nm=4030, gutter_nm=8000, cells=6, seed=1), Stop("circle", 500.0)
    )


def gutters_dot_by_dot() -> float:
    """Error of the matrix path against a sum over dots at whole nanometres, in a square stop that cuts no dot."""
    panel = example_panel(noise(21, 0.2, 1), dot_nm=4030, gutter_nm=8000, cells=6, seed=1)
    u = 0.4e-3 * np.arange(33, dtype=np.float64)
    half_nm = 3 * panel.pitch_nm
    low = (panel.pitch_nm * np.arange(6)[:, None] + panel.cell_size.dot_edges_nm[:-1]).ravel() - half_nm
    waves = 4.03 * np.sinc(4.03 * u) * np.exp(-2e-3j * np.pi * (low + panel.dot_nm / 2)[:, None] * u)
    clear = np.block([[orient(panel.opening.mask, int(k)) for k in row] for row in panel.orientations])
    row, column = np.nonzero(clear)
    amplitude = parity_field(example_pupil(panel, Stop("square", 2e-3 * half_nm)), u, u).amplitude()
    return relative(amplitude[32:, 32:], waves[row].T @ waves[column])


def half_grid_ties() -> float:
    """An odd number of odd cells puts the axis on half a nanometre: matrix path against polygons."""
    panel = example_panel(noise(5, 0.4, 2), dot_nm=4031, cells=3, seed=1)
    stop = Stop("square", 55.0)
    aperture = panel_aperture(panel)
    edge_nm = NM_PER_UM * aperture.x.edges_um()
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
    return relative(parity_field(example_pupil(panel, stop), u, u).amplitude(), polygons)


def far_origin() -> float:
    """Change of the field of polygons that lie 50 mm away from the plate's origin; 0 to the last digits."""
    panel, stop = example_panel(noise(6, 0.4, 3), cells=6, seed=1), Stop("circle", 250.0)
    region, away = clear_region(panel), (50_000_000.0, -50_000_000.0)
    fields = []
    for centre in ((0.0, 0.0), away):
        edges, area = edges_in_stop(region.moved(int(centre[0]), int(centre[1])), stop, centre)
        fields.append(boundary(edges, area, 0.02).field(1e-3, 21))
    return relative(fields[1], fields[0])


def next_to_zero_frequency() -> float:
    """Polygon field at 1e-10 to 1e-4 cycles/um, where the boundary form divides by almost nothing, over the area."""
    panel, stop = example_panel(noise(6, 0.4, 3), cells=6, seed=1), Stop("square", 288.0)
    edges, area = edges_in_stop(clear_region(panel), stop, (0.0, 0.0))
    outline, pupil = boundary(edges, area, 1e-3), example_pupil(panel, stop)
    worst = 0.0
    for step in (1e-10, 1e-7, 1e-5, 1e-4):
        u = step * np.arange(-1, 2, dtype=np.float64)
        worst = max(worst, float(abs(outline.field(step, 3) - direct_field(pupil, u, u)).max()) / area)
    return worst


def along_edges() -> float:
    """Frequencies along an edge's direction, where vertex formulas divide 0 by 0: one rectangle against its sinc."""
    region = db.Region(db.Box(-40_000, -30_000, 40_000, 30_000))
    edges, area = edges_in_stop(region, Stop("square", 200.0), (0.0, 0.0))
    amplitude = boundary(edges, area, 0.05).field(1e-3, 61)
    q = 1e-3 * np.arange(-30, 31, dtype=np.float64)
    expected = 80.0 * np.sinc(80.0 * q) * (60.0 * np.sinc(60.0 * q))[:, None]
    return relative(amplitude, expected.astype(np.complex128))


def replica() -> float:
    """At λf/dot from the axis a transform of points repeats its peak; dots have an exact zero there."""
    panel, stop = example_panel(noise(6, 0.4, 3), cells=6, seed=1), Stop("square", 288.0)
    field = direct_field(example_pupil(panel, stop), np.array([0.0, 1 / 8.0]), np.array([0.0]))
    return float(abs(field[0, 1] / field[0, 0]) ** 2)


def single_precision_far_away() -> float:
    """Single-precision products on a lattice that begins 50 mm from the axis, against double precision about it."""
    panel, u = example_panel(noise(21, 0.2, 1), cells=12, seed=1), np.linspace(-0.03, 0.03, 41)
    aperture, stop, away = panel_aperture(panel), Stop("square", 4000.0), 50_000.0
    x, y = aperture.x, aperture.y
    moved = (replace(x, start_um=x.start_um + away), replace(y, start_um=y.start_um - away))
    near = direct_field(Pupil.of_whole_dots(x, y, aperture.transmission, stop), u, u)
    far = direct_field(Pupil.of_whole_dots(*moved, aperture.transmission, stop), u, u, "single")
    cycles = away * (u - u[:, None])
    return relative(far, near * np.exp(-2j * np.pi * (cycles - np.rint(cycles))))


def million_polygons() -> float:
    """Squares of 2 um, 4 um apart, 1000 x 1000 in a square stop of 4 mm: polygons against the product of two sums."""
    low = 4000 * np.arange(-500, 500, dtype=np.int64) + 1000
    x, y = (offset.ravel() for offset in np.meshgrid(low, low))
    boxes = np.stack([x, y, x + 2000, y + 2000], axis=1)
    edges, area = edges_in_stop(boxes, Stop("square", 4000.0), (0.0, 0.0))
    step, u = 1e-4, 1e-4 * np.arange(-32, 33, dtype=np.float64)
    amplitude = boundary(edges, area, float(u[-1]) * np.sqrt(2)).field(step, 65)
    centres = (low + 1000) * UM_PER_NM
    axis = 2.0 * np.sinc(2.0 * u) * np.exp(-2j * np.pi * u[:, None] * centres).sum(axis=1)
    return relative(amplitude, axis * axis[:, None])


def aliased_samples() -> float:
    """The MTF of a PSF sampled every 2 um, at 4 x 4 sub-pixel phases: sum of aliases against the samples' transform.

    λf is 320 pixels times the dot, so point dots repeat every 320 samples; the squared sinc of the dots, summed over
    all repeats, is 1, and one period of point dots has the transform of all samples.
    """
    dots, dot, samples, phases = 21 * 16, 8.0, 320, 4
    camera = example_camera(dots * dot, "square", (512.0,))
    pupil = example_pupil(example_panel(noise(21, 0.2, 1), cells=16, seed=1), camera.stop)
    scale, pixel = image_scale_um2(camera, 512.0), camera.pixel_um
    waves = np.arange(8, samples // 2, 24, dtype=np.float64) / (samples * pixel)
    aliased = aliased_mtf(
        lag_table(pupil), camera, line_spectrum([512.0]), waves, np.zeros_like(waves), sampled="point", phases=phases
    )
    centre = dot * (np.arange(dots, dtype=np.float64) - (dots - 1) / 2)
    worst = 0.0
    for j, i in np.ndindex(phases, phases):
        along_x, along_y = (
            np.exp(-2j * np.pi / scale * pixel * (np.arange(samples)[:, None] + k / phases) * centre) for k in (i, j)
        )
        intensity = abs(along_y @ pupil.whole @ along_x.T) ** 2
        transform = abs(np.fft.fft(intensity.sum(axis=0)))
        expected = transform[np.rint(waves * pixel * samples).astype(int)] / transform[0]
        worst = max(worst, float(abs(aliased.values[j, i] - expected).max()))
    return worst


def no_noise() -> float:
    """Wiener's ε from 1e-2 to 1e-300 and 0, with nulls and without.

    Returns:
        The distance of H from its limit at the smallest ε; infinite if a number is not finite, a limit is broken, or
        ε = 0 is not refused where there are nulls.
    """
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:, 8:13] = True
    camera = example_camera(8 * 168.0, "square")
    nulls, open_ = (
        sensor_square(
            lag_table(example_pupil(example_panel(m, cells=8), camera.stop)), looking, line_spectrum([530.0]), 64
        )
        for m, looking in ((mask, camera), (np.ones_like(mask), replace(camera, pixel_um=4.0)))
    )
    for square in (nulls, open_):
        for ratio in (1e-2, 1e-6, 1e-16, 1e-100, 1e-300):
            quantities = [measure(square, ratio) for measure in (worst_wiener, noise_gain)]
            values = np.array([(_number(quantity), quantity.uncertainty) for quantity in quantities], dtype=np.float64)
            # |O| / (|O|² + ε) is largest where |O|² = ε.
            if not np.isfinite(values).all() or values[1, 0] > 0.5 / np.sqrt(ratio) * (1 + 1e-12):
                return np.inf
    for measure in (worst_wiener, noise_gain):
        try:
            measure(nulls, 0.0)
        except JobError:
            continue
        return np.inf
    if not np.array_equal(wiener_response(np.array([0.0, 1e-9, 1.0]), 0.0), [0.0, 1.0, 1.0]):
        return np.inf
    limit = float(np.sqrt(np.mean(open_.modulation**-2.0)))
    return max(abs(_number(worst_wiener(open_, 1e-300)) - 1), abs(_number(noise_gain(open_, 1e-300)) / limit - 1))


def _number(quantity: Quantity) -> float:
    assert isinstance(quantity.value, float)
    return quantity.value


def every_layout() -> float:
    """The mean PSF of two cells that draw from D4, whole and cut by the stop, against all 64 layouts one by one."""
    mask = noise(6, 0.4, 3)
    worst = 0.0
    for stop in (Stop("square", 96.0), Stop("circle", 70.0)):
        camera = Camera(10_000.0, stop, (530.0,), 2.0, 128.0)
        total, energy = np.zeros(()), 0.0
        for first, second in np.ndindex(ORIENTATIONS, ORIENTATIONS):
            pair = np.array([[first, second]], dtype=np.int8)
            panel = Panel(Opening("case", mask, 8000), 8000, 0, pair, Tiling.RANDOM, 1)
            pupil = example_pupil(panel, stop)
            total = total + point_psf(pupil, camera, 530.0).values * pupil.energy_um2
            energy += pupil.energy_um2
        worst = max(worst, relative(mean_psf(panel, camera, 530.0).psf.values, total / energy))
    return worst


def kissing_checkerboard() -> float:
    """A checkerboard, every corner of which kisses another: matrix path against polygons."""
    mask = np.indices((6, 6)).sum(axis=0) % 2 == 0
    return _two_paths(example_panel(mask, cells=6), Stop("circle", 250.0))


def extreme_open_ratios() -> float:
    """1 and 49 of 50 dots clear: energy and MTF volume against the count."""
    worst = 0.0
    for clear in (1, 49):
        mask = np.arange(100).reshape(10, 10) % 50 < clear
        pupil = example_pupil(example_panel(mask, cells=6), Stop("square", 480.0))
        area = clear / 50 * 480.0**2
        worst = max(worst, abs(pupil.energy_um2 / area - 1), abs(lag_table(pupil).volume_um2 / area - 1))
    return worst


def single_dots() -> float:
    """One clear dot in each cell, and all of them: matrix path against polygons."""
    one = np.zeros((5, 5), dtype=np.bool_)
    one[1, 3] = True
    stop = Stop("circle", 250.0)
    return max(_two_paths(example_panel(mask, cells=8, seed=1), stop) for mask in (one, np.ones_like(one)))


def subnormal_transmission() -> float:
    """A mask of transmission 1e-310 has the field of the opaque-or-clear one, scaled."""
    aperture = panel_aperture(example_panel(noise(6, 0.4, 3), cells=4))
    stop, u = Stop("circle", 150.0), np.linspace(0.0, 0.03, 11)
    dim = Aperture(aperture.x, aperture.y, 1e-310 * aperture.transmission, np.zeros_like(aperture.variance))
    exact = direct_field(cut(aperture, stop), u, u)
    return relative(direct_field(cut(dim, stop), u, u) * 1e300 * 1e10, exact)


def babinet() -> float:
    """A mask and its complement add up to the open stop."""
    mask, stop, u = noise(6, 0.4, 3), Stop("circle", 250.0), np.linspace(0.0, 0.03, 33)
    whole, part, rest = (
        parity_field(example_pupil(example_panel(m, cells=6), stop), u, u).amplitude()
        for m in (np.ones_like(mask), mask, ~mask)
    )
    return relative(part + rest, whole)


def symmetries() -> float:
    """Each of the eight orientations of a mask turns its PSF alike."""
    aperture = panel_aperture(example_panel(noise(6, 0.4, 3), cells=5, seed=7))
    stop, u = Stop("circle", 200.0), np.linspace(0.0, 0.03, 33)
    plain = parity_field(cut(aperture, stop), u, u).intensity()
    worst = 0.0
    for k in range(8):
        turned = Aperture(aperture.x, aperture.y, orient(aperture.transmission, k).copy(), orient(aperture.variance, k))
        worst = max(worst, relative(parity_field(cut(turned, stop), u, u).intensity(), orient(plain, k)))
    return worst


def shift_theorem() -> float:
    """Moving the polygons multiplies the field by a phase."""
    region, stop = clear_region(example_panel(noise(6, 0.4, 3), cells=4)), Stop("square", 400.0)
    fields = []
    for shift in (0, 37_123):
        edges, area = edges_in_stop(region.moved(shift, 0), stop, (0.0, 0.0))
        fields.append(boundary(edges, area, 0.02).field(1e-3, 21))
    u = 1e-3 * np.arange(-10, 11, dtype=np.float64)
    return relative(fields[1], fields[0] * np.exp(-2j * np.pi * u * 37.123))


def linearity() -> float:
    """Half-transparent dots have half the field of the rest of the mask."""
    aperture = panel_aperture(example_panel(noise(6, 0.4, 3), cells=4))
    stop, u = Stop("circle", 150.0), np.linspace(0.0, 0.03, 21)
    left = np.where(np.arange(aperture.transmission.shape[1]) < 12, aperture.transmission, 0.0)
    none = np.zeros_like(aperture.variance)

    def field(transmission: Floats) -> Complexes:
        return direct_field(cut(Aperture(aperture.x, aperture.y, transmission, none), stop), u, u)

    right = aperture.transmission - left
    return relative(field(0.5 * left + 0.25 * right), 0.5 * field(left) + 0.25 * field(right))


CASES = (
    Case("exact nulls of periodic slits", "MTF at lags that overlap nothing, absolute", exact_nulls, 1e-15),
    Case("round stop of 4 mm", "PSF against Airy, relative L2", lambda: airy(4000.0, 530.0), 1e-9),
    Case("round stop of 0.1 mm", "PSF against Airy, relative L2", lambda: airy(100.0, 530.0), 1e-9),
    Case("stop inside one dot", "field against Airy, relative L2", stop_inside_one_dot, 1e-6),
    Case("8 um gutters on 4.03 um dots", "matrix against polygons, relative L2", incommensurate_gutter, 1e-6),
    Case("the same, dot by dot", "matrix against a sum over dots, relative L2", gutters_dot_by_dot, 1e-14),
    Case("axis on half a nanometre", "matrix against polygons, relative L2", half_grid_ties, 1e-9),
    Case("origin 50 mm away", "polygon field against that at the origin, relative L2", far_origin, 1e-9),
    Case("next to zero frequency", "polygon field against the matrix, over the area", next_to_zero_frequency, 2e-15),
    Case("frequencies along an edge", "polygon field against a sinc, relative L2", along_edges, 1e-9),
    Case("replica at λf/dot", "intensity there over the peak", replica, 1e-30),
    Case("kissing corners everywhere", "matrix against polygons, relative L2", kissing_checkerboard, 1e-6),
    Case("open ratios 0.02 and 0.98", "energy and MTF volume against the count, relative", extreme_open_ratios, 1e-12),
    Case("single-dot and all-open cells", "matrix against polygons, relative L2", single_dots, 1e-6),
    Case("subnormal transmission", "scaled field, relative L2", subnormal_transmission, 1e-9),
    Case("Babinet's complement", "sum of fields against the open stop, relative L2", babinet, 1e-12),
    Case("eight orientations", "turned PSF, relative L2, worst", symmetries, 1e-12),
    Case("shift theorem", "moved field against a phase, relative L2", shift_theorem, 1e-7),
    Case("partial transmission", "linearity of the field, relative L2", linearity, 1e-12),
    Case("16 million dots of 1 um", "cell by cell against complex products, relative L2", fine_dots, 1e-8),
    Case("stop of one dot", "field against a sinc, relative L2, worst", stop_of_one_dot, 1e-9),
    Case("single precision 50 mm away", "field against double, relative L2", single_precision_far_away, 5e-6),
    Case(
        "a million polygons", "polygon field against a product of sums, relative L2", million_polygons, 1e-8, slow=True
    ),
    Case("MTF of samples 2 um apart", "sum of aliases against the transform, absolute", aliased_samples, 1e-12),
    Case("Wiener without noise", "H and gain from their limits, relative; inf if any breaks", no_noise, 1e-12),
    Case("200 nm", "PSF of 4 mm against Airy, relative L2", lambda: airy(4000.0, 200.0), 1e-9),
    Case("2000 nm", "PSF of 4 mm against Airy, relative L2", lambda: airy(4000.0, 2000.0), 1e-9),
    Case(
        "three colours on one grid",
        "PSFs against Airy, relative L2, worst",
        lambda: airy(4000.0, 610.0, 530.0, 470.0),
        1e-9,
    ),
    Case("mean over all layouts", "closed form against 64 layouts, relative L2, worst", every_layout, 1e-8),
)
