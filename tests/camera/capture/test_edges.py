"""Slanted edges against transfer functions that are known: to rounding without noise, within their bands with it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from optics_cases import camera, panel, pupil
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr
from slanted_edges import (
    Floats,
    blurred_edge,
    gaussian,
    noisy,
    rendered,
    second_integral,
    true_mtf,
    windowed_mtf,
)

from maskfab.base.errors import SourceError
from maskfab.camera.inspection.edge_mtf import measured_edges
from maskfab.camera.inspection.edge_regions import Region, fitted_line, found_edges
from maskfab.camera.inspection.slanted_edge import FLAT, FREQUENCIES, EdgeMtf, Grid, rice_interval
from maskfab.optics.psf import point_psf

PIXEL_UM = 2.0
SENSOR = FREQUENCIES <= 0.5


def only(values: Floats, **stated: object) -> EdgeMtf:
    (found,) = measured_edges(values, PIXEL_UM, **stated).edges
    return found.edge


@settings(max_examples=8)
@given(
    st.sampled_from([2.0, 5.0, -5.0, 15.0, 22.0, -33.0, 85.0, 95.0, 107.0]),
    st.floats(0.35, 1.5),
    st.floats(-0.5, 0.5),
)
def test_an_edge_without_noise_has_the_mtf_of_its_blur_and_its_pixel(normal_deg, sigma, at):
    edge = only(rendered(150, 150, normal_deg, blurred_edge(sigma), at=at))
    expected = true_mtf(FREQUENCIES, normal_deg, gaussian(sigma))
    assert abs(edge.mtf - expected)[SENSOR].max() < 4e-4
    assert abs(edge.mtf - expected).max() < 2e-3
    assert edge.normal_deg == pytest.approx(normal_deg, abs=1e-3)
    assert edge.direction == ("horizontal" if abs(normal_deg) < 45 else "vertical")
    lean = -normal_deg if edge.direction == "horizontal" else 90 - normal_deg
    assert edge.angle_deg == pytest.approx(lean, abs=1e-3)


def errors_and_cover(rows: int, columns: int, sigma: float, draws: int) -> tuple[Floats, float, Floats]:
    """Of an edge at 5 degrees and 40 dB: errors [draws, n], share of truths within the bands, and angles [draws]."""
    light, truth = (
        rendered(rows, columns, 5.0, blurred_edge(sigma), at=0.3),
        true_mtf(FREQUENCIES, 5.0, gaussian(sigma)),
    )
    errors, held, normals = [], [], []
    for seed in range(draws):
        edge = only(noisy(light, seed), seed=seed)
        errors.append((edge.mtf - truth)[SENSOR])
        normals.append(edge.normal_deg)
        held.append(((edge.low <= truth) & (truth <= edge.high))[SENSOR][1:])
    return np.array(errors), float(np.mean(held)), np.array(normals)


def test_at_40_db_an_edge_of_300_lines_errs_by_less_than_a_hundredth():
    errors, cover, _ = errors_and_cover(300, 64, 0.7, 12)
    assert abs(errors).max() < 0.01
    assert abs(errors.mean(axis=0)).max() < 0.003
    assert 0.88 < cover < 0.99


def test_bands_hold_the_truth_about_as_often_as_they_claim():
    _, cover, normals = errors_and_cover(100, 50, 0.7, 24)
    assert 0.9 < cover < 0.98
    # Centroids alone leave twice as much.
    assert np.sqrt(np.mean((normals - 5.0) ** 2)) < 0.0035


@pytest.mark.slow
@pytest.mark.parametrize(("rows", "sigma"), [(300, 0.7), (100, 0.7), (40, 0.7), (300, 1.5), (400, 0.4)])
def test_bands_hold_the_truth_in_92_to_98_of_100(rows, sigma):
    errors, cover, _ = errors_and_cover(rows, 64, sigma, 200)
    assert 0.92 < cover < 0.98
    assert abs(errors.mean(axis=0)).max() < 0.003
    if rows >= 300:
        assert np.quantile(abs(errors).max(axis=1), 0.95) < 0.01


@pytest.mark.parametrize("modulus", [0.0, 0.5, 2.0, 5.0, 20.0])
def test_rice_intervals_hold_the_modulus_that_noise_was_added_to(modulus):
    random = np.random.default_rng(1)
    seen = abs(modulus + random.normal(size=(20_000, 2)) @ np.array([1, 1j]))
    low, high = rice_interval(seen, np.ones(seen.size))
    assert np.mean((low <= modulus) & (modulus <= high)) == pytest.approx(0.95, abs=0.006 if modulus else 0.031)
    assert (low <= high).all()


def test_a_bowed_edge_is_followed_and_a_straight_one_is_not_bent():
    light = rendered(300, 80, 5.0, blurred_edge(0.7), bow=1.5)
    truth = true_mtf(FREQUENCIES, 5.0, gaussian(0.7))
    bent, straight = only(light, order=2), only(light, order=1)
    assert only(noisy(light, 1)).order >= 2
    assert abs(bent.mtf - truth)[SENSOR].max() < 2e-3
    assert abs(straight.mtf - truth)[SENSOR].max() > 0.05
    assert only(noisy(rendered(300, 80, 5.0, blurred_edge(0.7)), 3)).order == 1


def test_one_colour_of_a_mosaic_gives_the_mtf_of_whole_pixels():
    light, truth = rendered(240, 120, 5.0, blurred_edge(0.5)), true_mtf(FREQUENCIES, 5.0, gaussian(0.5))
    plane = only(light[1::2, 0::2], grid=Grid((1, 0), 2))
    assert abs(plane.mtf - truth)[SENSOR].max() < 1e-3
    assert plane.region.top == 1
    assert plane.region.bottom > 200
    green = np.indices(light.shape).sum(axis=0) % 2 == 1
    assert abs(only(np.where(green, light, np.nan)).mtf - truth)[SENSOR].max() < 1e-3


def test_light_that_grows_across_the_edge_is_taken_out_and_spread_light_is_not():
    light, truth = rendered(300, 120, 5.0, blurred_edge(0.7)), true_mtf(FREQUENCIES, 5.0, gaussian(0.7))
    growth = 1 + 6e-4 * (np.arange(120) - 60)
    edge = only(noisy(light, 4) * growth)
    assert edge.half_px < 12
    assert abs(edge.mtf - truth)[SENSOR].max() < 0.01
    assert abs(edge.mtf - truth)[FREQUENCIES < 0.1].max() < 0.003
    # A third of the light spread widely tilts both fields alike.
    wide = 0.7 * light + 0.3 * rendered(300, 120, 5.0, blurred_edge(20.0))
    assert only(wide).half_px > 40
    assert only(wide * growth).mtf == pytest.approx(only(wide).mtf, abs=3e-3)


def test_faulty_pixels_and_dust_do_not_move_the_edge():
    light = rendered(200, 64, 5.0, blurred_edge(0.7))
    truth, clean = true_mtf(FREQUENCIES, 5.0, gaussian(0.7)), noisy(light, 2)
    random = np.random.default_rng(5)
    hot = random.random(light.shape) < 0.01
    masked = only(np.where(hot, 30.0, clean), valid=~hot)
    assert abs(masked.mtf - truth)[SENSOR].max() < 0.015
    dusty = clean.copy()
    dusty[90:94] *= 0.7
    assert only(dusty).normal_deg == pytest.approx(5.0, abs=0.02)


def test_the_four_edges_of_a_square_are_told_apart():
    """Blurred by a Gaussian alone, without a pixel, the square is a product along its sides."""
    y, x = np.mgrid[:260, :300].astype(float)
    angle = np.radians(6.0)
    u, v = (x - 150) * np.cos(angle) + (y - 130) * np.sin(angle), (y - 130) * np.cos(angle) - (x - 150) * np.sin(angle)
    square = np.prod([ndtr((side + 70) / 0.8) - ndtr((side - 70) / 0.8) for side in (u, v)], axis=0)
    found = measured_edges(1 - square, PIXEL_UM)
    assert sorted(each.edge.direction for each in found.edges) == ["horizontal"] * 2 + ["vertical"] * 2
    for each in found.edges:
        assert abs(each.edge.mtf - gaussian(0.8)(FREQUENCIES))[SENSOR].max() < 2e-3
        assert abs(each.edge.angle_deg) == pytest.approx(6.0, abs=0.01)
    left = found.edges[0].edge.region
    for each in found.edges:
        assert 0 <= each.edge.region.top < each.edge.region.bottom <= 260
        assert 0 <= each.edge.region.left < each.edge.region.right <= 300
    alone = measured_edges(1 - square, PIXEL_UM, region=left).edges
    assert [each.edge.direction for each in alone] == [found.edges[0].edge.direction]


def test_every_square_of_a_row_is_found():
    """A step beside a stronger one is not its stair's if it is out of its reach."""
    values = np.full((120, 230), 0.1)
    values[30:90, 30:90] = values[30:90, 140:200] = 0.9
    values = gaussian_filter(values, 1.0)
    found, refused = found_edges(values, np.ones(values.shape, np.bool_))
    assert not refused
    places = sorted((each.direction, round(each.offset + 0.5), each.lines[0] > 100) for each in found)
    upright = [("horizontal", place, False) for place in (30, 90, 140, 200)]
    assert places == upright + [("vertical", place, right) for place in (30, 90) for right in (False, True)]
    for each in found:
        # No longer than a side, and no farther than what is next: the border, 30 away, or an edge, 50 or more.
        assert 40 <= each.lines[1] - each.lines[0] <= 60
        assert 20 <= each.reach < 50


def test_the_stair_behind_a_display_is_one_edge_seen_through_its_window():
    """Rendered from the point PSF, whose orders are 22 pixels apart, and compared with its own transform."""
    stripes = np.zeros((3, 3), np.bool_)
    stripes[:, 1] = True
    setting = camera(1000.0, window_um=900.0)
    psf = point_psf(pupil(panel(stripes, dot_nm=40_000, cells=10), setting.stop), setting, 530.0)
    second = second_integral(psf, setting.pixel_um, 5.0)
    edge = only(rendered(150, 240, 5.0, second))
    assert edge.half_px > 60
    expected = windowed_mtf(FREQUENCIES, 5.0, second, edge.half_px, FLAT)
    assert abs(edge.mtf - expected).max() < 1e-3
    narrow = only(rendered(150, 240, 5.0, second), window_px=24.0)
    assert narrow.half_px <= 24
    assert abs(narrow.mtf - windowed_mtf(FREQUENCIES, 5.0, second, narrow.half_px, FLAT)).max() < 1e-3


def test_the_polynomial_follows_most_places_and_not_the_few_that_are_off():
    lines = np.arange(200.0)
    places = 30 + 0.1 * lines + np.random.default_rng(0).normal(0, 0.02, 200)
    places[::9] += 3.0
    places[50] = np.nan
    line = fitted_line(lines, places)
    assert line.order == 1
    assert line.slopes(lines)[0] == pytest.approx(0.1, abs=2e-4)
    assert line.places(np.array([100.0]))[0] == pytest.approx(40.0, abs=0.02)


def flat(rows: int, columns: int) -> Floats:
    return np.random.default_rng(0).normal(1, 0.1, (rows, columns))


@pytest.mark.parametrize(
    ("code", "values", "stated"),
    [
        ("MF340", flat(80, 80), {}),
        ("MF340", np.ones((80, 80)), {}),
        ("MF340", np.full((80, 80), np.nan), {}),
        ("MF341", rendered(120, 80, 1e-6, blurred_edge(0.7)), {}),
        ("MF341", rendered(120, 120, 45.0, blurred_edge(0.7)), {}),
        ("MF341", rendered(120, 120, np.degrees(np.arctan(0.5)), blurred_edge(0.7)), {}),
        ("MF342", rendered(16, 80, 5.0, blurred_edge(0.7)), {}),
        ("MF342", rendered(120, 80, 5.0, blurred_edge(0.7)), {"region": Region(10, 25, 10, 70)}),
        ("MF342", rendered(120, 80, 5.0, blurred_edge(0.7)), {"region": Region(200, 300, 0, 80)}),
        ("MF342", rendered(120, 80, 5.0, blurred_edge(0.7)), {"valid": np.indices((120, 80)).sum(axis=0) % 9 == 0}),
        ("MF343", np.minimum(noisy(rendered(120, 80, 5.0, blurred_edge(0.7)), 0), 0.97), {"clipped_at": 0.97}),
    ],
)
def test_what_cannot_be_measured_is_refused_with_its_reason(code, values, stated):
    with pytest.raises(SourceError) as caught:
        measured_edges(values, PIXEL_UM, where="edge.tif", **stated)
    assert caught.value.code == code, caught.value
    assert caught.value.where.startswith("edge.tif")
    assert caught.value.cure


def test_edges_that_cannot_be_measured_are_named_beside_those_that_can():
    light = np.vstack(
        [rendered(130, 130, 5.0, blurred_edge(0.7)), np.zeros((30, 130)), rendered(130, 130, 0.0001, blurred_edge(0.7))]
    )
    found = measured_edges(light, PIXEL_UM)
    assert any(each.edge.normal_deg == pytest.approx(5.0, abs=0.05) for each in found.edges)
    assert any("MF341" in reason for reason in found.left_out)
