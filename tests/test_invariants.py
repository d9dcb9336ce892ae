"""What no mask can change, and how results move when the mask is moved, turned, or complemented."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from optics_cases import camera, clear_region, noise, panel, pupil
from sweeps import examples

from maskfab.base.model import Panel, orient
from maskfab.job.camera import Stop
from maskfab.mask.raster import coverage
from maskfab.optics.field.matrix import direct_field, parity_field
from maskfab.optics.field.polygons import boundary
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import presampled_mtf
from maskfab.optics.psf import point_psf
from maskfab.optics.pupil import Aperture, covered_aperture, cut, panel_aperture
from maskfab.optics.stop_edges import edges_in_stop

masks = st.builds(noise, dots=st.integers(1, 7), share=st.floats(0.02, 0.98), seed=st.integers(0, 10_000))
layouts = st.builds(
    panel,
    masks,
    dot_nm=st.sampled_from([1000, 4030, 8000]),
    gutter_nm=st.sampled_from([0, 2000, 8000]),
    cells=st.integers(2, 7),
    seed=st.one_of(st.none(), st.integers(0, 100)),
)
shapes = st.sampled_from(["circle", "square"])


def stop_for(laid_out: Panel, shape: str, share: float) -> Stop:
    return Stop("square" if shape == "square" else "circle", max(3.0, laid_out.size_nm[0] / 1e3 * share))


@examples(40)
@given(layouts, shapes, st.floats(0.3, 1.0))
def test_two_paths_and_two_areas_agree(laid_out: Panel, shape: str, share: float) -> None:
    """Matrix transform of dots against the transform of polygon edges: independent from geometry to sum."""
    stop = stop_for(laid_out, shape, share)
    source = pupil(laid_out, stop)
    edges, area = edges_in_stop(clear_region(laid_out), stop, (0.0, 0.0))
    if area == 0:
        assert source.energy_um2 < 1e-3
        return
    # The circle of the polygon path has 4096 sides and nanometre-rounded corners.
    assert source.energy_um2 == pytest.approx(area, rel=1e-5, abs=1e-3)
    step, count = 0.4e-3, 41
    u = step * np.arange(count // 2 + 1)
    matrix = parity_field(source, u, u).amplitude()
    polygons = boundary(edges, area, u[-1] * np.sqrt(2)).field(step, count)
    assert np.linalg.norm(matrix - polygons) < 1e-5 * np.linalg.norm(matrix) + 1e-3


@settings(max_examples=25, deadline=None)
@given(layouts, shapes, st.floats(0.3, 1.0))
def test_invariants_of_a_binary_mask(laid_out: Panel, shape: str, share: float) -> None:
    """Peak Strehl = η² and volume under the MTF = η, the open ratio taken from polygons."""
    stop = stop_for(laid_out, shape, share)
    source = pupil(laid_out, stop)
    _, area = edges_in_stop(clear_region(laid_out), stop, (0.0, 0.0))
    if area < 1.0:
        return
    assert (source.field_integral_um2 / area) ** 2 == pytest.approx(1.0, abs=1e-4)
    table = lag_table(source)
    if table.uncertainty < 0.5:  # a stop of a dot or two is all rim, and its error bar says that nothing is known
        assert abs(table.volume_um2 / area - 1) <= max(1e-4, table.uncertainty)


@pytest.mark.parametrize("gutter_nm", [0, 8000])
def test_invariants_to_1e_6_where_the_stop_follows_the_grid(gutter_nm: int) -> None:
    laid_out = panel(noise(9, 0.3, 8), dot_nm=4030, gutter_nm=gutter_nm, cells=6, seed=5)
    stop = Stop("square", laid_out.pitch_nm * 6 / 1e3)
    source, table = pupil(laid_out, stop), lag_table(pupil(laid_out, stop))
    _, area = edges_in_stop(clear_region(laid_out), stop, (0.0, 0.0))
    peak = parity_field(source, np.zeros(1), np.zeros(1)).intensity()[0, 0]
    assert peak / stop.area_um2**2 == pytest.approx((area / stop.area_um2) ** 2, rel=1e-6)
    assert table.volume_um2 / stop.area_um2 == pytest.approx(area / stop.area_um2, rel=1e-6)


@settings(max_examples=15, deadline=None)
@given(layouts, shapes, st.lists(st.tuples(st.floats(0, 60), st.floats(-60, 60)), min_size=1, max_size=4))
def test_lag_table_is_the_overlap_of_shifted_polygons(
    laid_out: Panel, shape: str, lags: list[tuple[float, float]]
) -> None:
    stop = stop_for(laid_out, shape, 0.9)
    table = lag_table(pupil(laid_out, stop))
    if table.energy_um2 < 1.0:
        return
    from klayout import db

    from maskfab.optics.stop_edges import stop_region

    scale = 100
    cut_out = clear_region(laid_out)
    cut_out.transform(db.ICplxTrans(float(scale)))
    cut_out &= stop_region(stop, 1e3 * scale)
    for x, y in lags:
        moved = cut_out.moved(round(x * 1e3 * scale), round(y * 1e3 * scale))
        overlap = (cut_out & moved).area() / cut_out.area()
        found = table.otf(np.array([x]), np.array([y]))[0]
        assert abs(found - overlap) <= table.uncertainty + 1e-4


@settings(max_examples=20, deadline=None)
@given(layouts, st.floats(0.4, 1.0))
def test_parity_split_equals_the_direct_transform(laid_out: Panel, share: float) -> None:
    source = pupil(laid_out, stop_for(laid_out, "circle", share))
    u = np.linspace(0.0, 0.03, 9)
    quadrant = parity_field(source, u, u).amplitude()[8:, 8:]
    direct = direct_field(source, u, u)
    assert np.linalg.norm(quadrant - direct) <= 1e-12 * np.linalg.norm(direct) + 1e-12


@pytest.mark.parametrize("k", range(8))
def test_turning_the_mask_turns_the_psf_and_permutes_the_cuts(k: int) -> None:
    laid_out = panel(noise(6, 0.4, 3), cells=5, seed=7)
    setting = camera(200.0, window_um=64.0)
    aperture = panel_aperture(laid_out)
    turned = Aperture(
        aperture.x, aperture.y, np.array(orient(aperture.transmission, k)), np.zeros_like(aperture.variance)
    )
    plain, moved = (cut(a, setting.stop) for a in (aperture, turned))
    first, second = (point_psf(p, setting, 530.0).values for p in (plain, moved))
    np.testing.assert_allclose(second, orient(first, k), rtol=1e-9, atol=1e-15)
    one, another = (presampled_mtf(lag_table(p), setting, 530.0) for p in (plain, moved))
    cuts, other = one.cuts, another.cuts
    np.testing.assert_allclose(other["radial_min"], cuts["radial_min"], atol=1e-12)
    lag = np.linspace(0.0, 199.0, 40)
    tables = [lag_table(p) for p in (plain, moved)]
    along = (lag, 0 * lag) if k % 2 == 0 else (0 * lag, lag)
    np.testing.assert_allclose(tables[1].otf(lag, 0 * lag), tables[0].otf(*along), atol=1e-12)
    # Of a ring some samples are exact, not the same ones, and of a cut what errs by most.
    bar = min(1e-3, one.uncertainty + another.uncertainty)
    for name in ("radial_mean", "radial_max"):
        np.testing.assert_allclose(other[name], cuts[name], atol=bar)
    expected = "vertical" if k % 2 else "horizontal"
    np.testing.assert_allclose(other["horizontal"], cuts[expected], atol=bar)


def test_half_covered_dots_keep_energy_and_volume() -> None:
    """A grid that misses the edges: energy stays that of the binary mask, and the error bar grows to say so."""
    laid_out = panel(noise(6, 0.4, 3), cells=4)
    aperture = panel_aperture(laid_out)
    edges = 1e3 * aperture.x.edges_um()
    shifted = coverage(clear_region(laid_out).moved(3000, 0), edges, edges)
    stop = Stop("square", 192.0)
    exact, grey = cut(aperture, stop), cut(covered_aperture(aperture.x, aperture.y, shifted), stop)
    assert ((shifted > 0) & (shifted < 1)).any()
    inside = clear_region(laid_out).moved(3000, 0)
    from klayout import db

    inside &= db.Region(db.Box(-96_000, -96_000, 96_000, 96_000))
    assert grey.energy_um2 == pytest.approx(inside.area() / 1e6, rel=1e-12)
    assert lag_table(grey).uncertainty > 1e-2 > lag_table(exact).uncertainty


def test_a_stop_that_ends_on_a_cell_keeps_the_lattice_symmetric() -> None:
    """4.03 um cells and a stop of half the panel: rounding once kept a cell on one side alone."""
    laid_out = panel(np.ones((1, 1), dtype=np.bool_), dot_nm=4030, cells=4)
    lattice = panel_aperture(laid_out, laid_out.size_nm[0] / 1e3 / 4).x
    edges = lattice.edges_um()
    np.testing.assert_allclose(edges, -edges[::-1], atol=1e-9)
    assert lattice.cells in {2, 4}
