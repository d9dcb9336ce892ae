"""Every path to the far field against every other, and each against answers that are known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from optics_cases import noise, panel, pupil
from scipy.special import j1, jv

from maskfab.base.errors import InternalError
from maskfab.base.model import Panel
from maskfab.job.camera import Stop
from maskfab.optics.field.matrix import direct_field, parity_field, prepare
from maskfab.optics.field.methods import (
    DIRECT,
    PARITY,
    PATHS,
    STRUCTURE,
    FieldTask,
    admissible,
    field,
    prepare_cells,
)
from maskfab.optics.field.polygons import boundary
from maskfab.optics.field.waves import NODE_TOLERANCE, node_count, nodes_for, point_sources, right_half
from maskfab.optics.pupil import Lattice, Pupil, covered_aperture, cut, panel_aperture

masks = st.builds(noise, dots=st.integers(1, 7), share=st.floats(0.02, 0.98), seed=st.integers(0, 10_000))
layouts = st.builds(
    panel,
    masks,
    dot_nm=st.sampled_from([1000, 4030, 8000]),
    gutter_nm=st.sampled_from([0, 0, 2000, 8000]),
    cells=st.integers(1, 7),
    seed=st.one_of(st.none(), st.integers(0, 100)),
)


def relative(found: NDArray[np.complex128], expected: NDArray[np.complex128]) -> float:
    return float(np.linalg.norm(found - expected) / max(np.linalg.norm(expected), 1e-300))


def grid(highest: float, count: int, on_axis: bool) -> NDArray[np.float64]:
    return highest / count * (np.arange(count, dtype=np.float64) + (0.0 if on_axis else 0.5))


def commensurate(lattice: Lattice, size: int, count: int, on_axis: bool) -> NDArray[np.float64]:
    """Frequencies that a discrete transform of that many dots has."""
    return (np.arange(count, dtype=np.float64) + (0.0 if on_axis else 0.5)) / (lattice.dot_um * size)


@settings(max_examples=30, deadline=None)
@given(layouts, st.sampled_from(["circle", "square"]), st.floats(0.1, 1.1), st.booleans(), st.integers(1, 40))
def test_all_paths_agree(laid_out: Panel, shape: str, share: float, on_axis: bool, count: int) -> None:
    stop = Stop("square" if shape == "square" else "circle", max(2.0, laid_out.size_nm[0] / 1e3 * share))
    source = pupil(laid_out, stop)
    u, v = grid(0.03, count, on_axis), grid(0.021, count + 2, on_axis)
    # A dot without light gives every path zeros of its own.
    scale = max(float(source.energy_um2), 1e-9)
    expected = DIRECT.amplitude(source, u, v)
    for path in admissible(FieldTask.of(source, u, v)):
        assert np.linalg.norm(path.amplitude(source, u, v) - expected) <= 1e-12 * scale * np.sqrt(expected.size)
        single = path.intensity(source, u, v, "single")
        error = np.linalg.norm(single - abs(expected) ** 2)
        assert error <= path.error["single"] * max(np.linalg.norm(abs(expected) ** 2), scale**2)


@pytest.mark.parametrize("gutter_nm", [0, 8000])
@pytest.mark.parametrize("cells", [5, 6])
def test_cells_of_many_dots_reduce_exactly(gutter_nm: int, cells: int) -> None:
    source = pupil(panel(noise(60, 0.4, 3), dot_nm=1000, gutter_nm=gutter_nm, cells=cells, seed=1), Stop("circle", 290))
    u = grid(0.03, 33, True)
    assert STRUCTURE.flops(FieldTask.of(source, u, u)) < DIRECT.flops(FieldTask.of(source, u, u))
    assert relative(STRUCTURE.amplitude(source, u, u), PARITY.amplitude(source, u, u)) < 1e-13
    assert relative(PARITY.amplitude(source, u, u), DIRECT.amplitude(source, u, u)) < 1e-13


@pytest.mark.parametrize("path", PATHS, ids=lambda p: p.name)
def test_open_stop_gives_airy(path: object) -> None:
    """A stop of 100 µm, whose rim is all that a staircase would get wrong: πD²/4 2 J1(πDq) / (πDq), Goodman 4.4.2."""
    source = pupil(panel(np.ones((5, 5), dtype=np.bool_), cells=4), Stop("circle", 100.0))
    u = grid(0.03, 64, True)
    radius = np.pi * 100.0 * np.hypot(u, u[:, None])
    radius[0, 0] = 1.0
    expected = np.pi * 2500.0 * 2 * j1(radius) / radius
    expected[0, 0] = np.pi * 2500.0
    found = path.amplitude(source, u, u)[63:, 63:]  # type: ignore[attr-defined]
    assert relative(found, expected.astype(np.complex128)) < 1e-10


@pytest.mark.parametrize("turns", range(4))
def test_turning_the_pupil_turns_the_field(turns: int) -> None:
    laid_out = panel(noise(6, 0.4, 3), gutter_nm=4000, cells=5, seed=7)
    aperture = panel_aperture(laid_out)
    stop = Stop("circle", 200.0)
    plain = cut(aperture, stop)
    turned = cut(covered_aperture(aperture.x, aperture.y, np.rot90(aperture.transmission, turns).copy()), stop)
    u = grid(0.03, 16, False)
    for path in admissible(FieldTask.of(plain, u, u)):
        expected = np.rot90(path.amplitude(plain, u, u), turns)
        assert relative(path.amplitude(turned, u, u), expected) < 1e-13


def test_one_preparation_serves_every_wavelength() -> None:
    source = pupil(panel(noise(9, 0.4, 3), cells=6, seed=2), Stop("circle", 420.0))
    for prepared in (path.prepare(source, 0.03, 0.03, "double") for path in PATHS):
        for size in (270, 331, 407):
            u = commensurate(source.x, size, 60, True)
            assert relative(prepared.field(u, u).amplitude(), parity_field(source, u, u).amplitude()) < 1e-12


def test_frequencies_beyond_the_prepared_ones_are_refused() -> None:
    source = pupil(panel(noise(9, 0.4, 3), cells=6), Stop("circle", 420.0))
    for prepared in (prepare(source, 0.02, 0.02), prepare_cells(source, 0.02, 0.02)):
        with pytest.raises(InternalError, match="beyond"):
            prepared.field(grid(0.03, 8, True), grid(0.01, 8, True))


def test_single_precision_keeps_its_phases_far_from_the_axis() -> None:
    """With the origin 50 mm away phases are thousands of cycles; the intensity must not know."""
    source = pupil(panel(noise(21, 0.3, 1), cells=6, seed=3), Stop("circle", 900.0))
    u = grid(0.024, 64, False)
    far = replace(
        source,
        x=replace(source.x, start_um=source.x.start_um + 5e4),
        y=replace(source.y, start_um=source.y.start_um - 5e4),
    )
    expected = abs(direct_field(source, u, u)) ** 2
    assert np.linalg.norm(abs(direct_field(far, u, u)) ** 2 - expected) < 1e-9 * np.linalg.norm(expected)
    single = abs(direct_field(far, u, u, "single")) ** 2
    assert np.linalg.norm(single - expected) < DIRECT.error["single"] * np.linalg.norm(expected)


def test_single_precision_over_a_whole_stop() -> None:
    source = pupil(panel(noise(21, 0.2, 5), cells=24, seed=3), Stop("circle", 4000.0))
    u = grid(0.024, 64, False)
    expected = PARITY.intensity(source, u, u)
    for path in admissible(FieldTask.of(source, u, u)):
        error = np.linalg.norm(path.intensity(source, u, u, "single") - expected) / np.linalg.norm(expected)
        assert error < path.error["single"]


@pytest.mark.parametrize("on_axis", [False, True])
@pytest.mark.parametrize("dots", [1, 4, 20])
def test_single_precision_of_like_terms_that_round_alike(dots: int, on_axis: bool) -> None:
    """An open square of 500 dots: hundreds of equal terms a sum, whose rounding does not average out."""
    source = pupil(panel(np.ones((dots, dots), dtype=np.bool_), dot_nm=2000, cells=500 // dots), Stop("square", 1000.0))
    u = grid(0.016, 16, on_axis)
    expected = PARITY.intensity(source, u, u)
    for path in admissible(FieldTask.of(source, u, u)):
        error = np.linalg.norm(path.intensity(source, u, u, "single") - expected) / np.linalg.norm(expected)
        assert error < path.error["single"], path.name


def test_the_cheapest_path_suits_the_pupil() -> None:
    u = grid(0.024, 256, False)
    coarse = Lattice(-2016.0, 24, 21, 8.0, 168.0)
    fine = Lattice(-2016.0, 24, 168, 1.0, 168.0)
    askew = replace(coarse, start_um=-2000.0)
    assert admissible(FieldTask(coarse, coarse, 2000.0, 400, False, u, u))[0] is PARITY
    assert admissible(FieldTask(fine, fine, 2000.0, 3000, False, u, u))[0] is STRUCTURE
    assert admissible(FieldTask(askew, askew, 2000.0, 400, True, u, u)) == (DIRECT,)
    for path in PATHS:
        task = FieldTask(coarse, coarse, 2000.0, 400, False, commensurate(coarse, 1325, 256, True), u)
        assert path.flops(task) > 0 < path.memory(task)
        assert path.error["double"] < path.error["single"]


def test_paths_say_why_they_refuse() -> None:
    guttered = pupil(panel(noise(5, 0.4, 3), gutter_nm=8000, cells=4), Stop("circle", 150.0))
    u = grid(0.02, 8, True)
    lit = covered_aperture(guttered.x, guttered.y, np.full(guttered.whole.shape, 0.5))
    with pytest.raises(InternalError, match="strips between cells"):
        STRUCTURE.field(cut(lit, guttered.stop), u, u)
    askew = Pupil.of_whole_dots(replace(guttered.x, start_um=0.0), guttered.y, guttered.whole, guttered.stop)
    for path in (PARITY, STRUCTURE):
        with pytest.raises(InternalError, match="symmetric"):
            path.field(askew, u, u)


@pytest.mark.parametrize(("u", "v"), [([0.0, 0.0], [0.0, 1.0]), ([-1.0, 0.0], [0.0, 1.0]), ([0.0], [1.0]), ([], [0.0])])
def test_grids_that_are_no_quadrant_are_refused(u: list[float], v: list[float]) -> None:
    source = pupil(panel(noise(5, 0.4, 3), cells=4), Stop("circle", 150.0))
    with pytest.raises(InternalError, match="MF901"):
        PARITY.field(source, 1e-3 * np.array(u), 1e-3 * np.array(v))


def test_the_default_path_and_a_single_frequency() -> None:
    source = pupil(panel(noise(5, 0.4, 3), cells=4), Stop("circle", 150.0))
    found = field(source, np.zeros(1), np.zeros(1)).amplitude()
    assert found[0, 0] == pytest.approx(source.field_integral_um2, rel=1e-12)


@pytest.mark.parametrize("phase", [0.0, 1e-3, 1.0, 30.0, 300.0])
def test_nodes_carry_every_wave(phase: float) -> None:
    """A source anywhere on the interval, moved to the nodes, makes the same wave."""
    nodes = nodes_for(-3.0, 5.0, phase / (8 * np.pi))
    edges = np.linspace(-3.0, 5.0, 1 + max(4, int(phase)))
    shares = nodes.moments(edges[:-1], edges[1:], 1, 16)[:, 0]
    for frequency in phase / (8 * np.pi) * np.array([0.0, 0.5, 1.0]):
        size, centre = np.diff(edges), (edges[1:] + edges[:-1]) / 2
        expected = size * np.sinc(frequency * size) * np.exp(-2j * np.pi * frequency * centre)
        found = shares @ np.exp(-2j * np.pi * frequency * nodes.position_um)
        np.testing.assert_allclose(found, expected, atol=2e-13)


@pytest.mark.parametrize("phase", [0.0, 1e-4, 0.7, 5.0, 61.3, 700.0])
def test_nodes_hold_every_order_of_a_wave_that_matters_and_spare_few(phase: float) -> None:
    """Against all its Chebyshev coefficients, far beyond the last that may matter."""
    size = 2 * abs(jv(np.arange(int(2 * phase) + 100), phase))
    last = int(np.flatnonzero(size >= NODE_TOLERANCE)[-1])
    assert last < node_count(phase / np.pi, 1.0) <= last + 3


@pytest.mark.parametrize("cells", [1, 2, 5])
@pytest.mark.parametrize("dots", [1, 4, 7])
@pytest.mark.parametrize("gutter", [0.0, 3.0])
def test_waves_of_a_lattice_are_those_of_its_intervals(cells: int, dots: int, gutter: float) -> None:
    length = cells * dots * 2.0 + (cells - 1) * gutter
    lattice = Lattice(-length / 2, cells, dots, 2.0, dots * 2.0 + gutter)
    edges = lattice.edges_um()
    half = (edges.size - 1) // 2
    centre, size = ((edges[1:] + edges[:-1]) / 2)[half:], np.diff(edges)[half:]
    for u in (grid(0.1, 70, False), np.sort(np.random.default_rng(1).random(9))):
        cosine, sine = right_half(lattice).waves(u, "double")
        wave = size[:, None] * np.sinc(size[:, None] * u) * np.exp(2j * np.pi * centre[:, None] * u)
        np.testing.assert_allclose(cosine + 1j * sine, wave, atol=1e-13 * size.max())


def test_waves_of_points_do_not_depend_on_the_spacing_of_frequencies() -> None:
    where, u = point_sources(np.array([-1.0, 0.0, 2.5, 4e4])), np.linspace(0.01, 0.2, 101)
    together = np.stack(where.waves(u, "double"))
    alone = np.concatenate([np.stack(where.waves(u[k : k + 1], "double")) for k in range(u.size)], axis=2)
    np.testing.assert_allclose(together, alone, atol=2e-11)


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, 1.2])
def test_polygons_near_the_axis_and_along_edges(angle: float) -> None:
    """A turned square: sinc times sinc, also where a frequency is at right angles to an edge, and at next to 0."""
    side = 400.0
    corners = side / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = corners @ turn.T
    edges = np.concatenate([turned, np.roll(turned, -1, axis=0)], axis=1)
    for step in (1e-6, 1e-4, 5e-4):
        across = step * np.arange(-15, 16)
        found = boundary(edges, side**2, across[-1] * np.sqrt(2)).field(step, 31)
        along = across * np.cos(angle) + across[:, None] * np.sin(angle)
        right = -across * np.sin(angle) + across[:, None] * np.cos(angle)
        expected = side**2 * np.sinc(side * along) * np.sinc(side * right)
        # The sums err by 1e-9 of the perimeter, and the smallest frequency divides them.
        tolerance = 1e-9 * side**2 + 2e-9 * 4 * side / (2 * np.pi * step)
        assert abs(found - expected).max() < tolerance
        assert found[15, 15] == side**2


def test_polygons_of_a_round_stop_agree_with_the_matrix() -> None:
    turn = 2 * np.pi * np.arange(4097) / 4096
    corners = 50.0 * np.sqrt(turn[1] / np.sin(turn[1])) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    edges = np.concatenate([corners[:-1], corners[1:]], axis=1)
    source = pupil(panel(np.ones((5, 5), dtype=np.bool_), cells=4), Stop("circle", 100.0))
    u = 1e-3 * np.arange(26, dtype=np.float64)
    polygons = boundary(edges, np.pi * 2500.0, u[-1] * np.sqrt(2)).field(1e-3, 51)
    assert relative(polygons, PARITY.amplitude(source, u, u)) < 1e-7
