"""Edges in colour from lags: against closed forms, finer dots and wider windows, and within their bars."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from optics_cases import camera, noise, panel, pupil
from scipy.special import ndtr, sici

from maskfab.base.errors import InternalError
from maskfab.base.model import Psf
from maskfab.job.camera import Camera
from maskfab.optics.colour import delta_e_1976, lab_of_linear_srgb
from maskfab.optics.energy import colour_distance
from maskfab.optics.lags import axis_lags, lag_table
from maskfab.optics.metrics import colour_quantities
from maskfab.optics.mtf import EdgeSpread, edge_colour_difference, edge_in_window, edge_spread, longest_lag_um
from maskfab.optics.psf import ReadyPupil, cutoff, pixel_margin, pixel_psf
from maskfab.optics.pupil import Pupil

LINES = (470.0, 530.0, 610.0)
SPOT = np.pad(np.ones((6, 5), np.bool_), ((1, 2), (1, 3)))


def edges_of(source: Pupil, setting: Camera) -> list[EdgeSpread]:
    table = lag_table(source, longest_lag_um(setting))
    lags = axis_lags(source, table.energy_um2)
    return [edge_spread(lags, table, setting, line) for line in setting.wavelengths_nm]


def pixels_of(source: Pupil, setting: Camera) -> list[Psf]:
    return [pixel_psf(points, setting) for points in ReadyPupil.of(source, setting, pixel_margin(setting)).psfs()]


def test_the_edge_of_a_clear_square_stop() -> None:
    """Its line spread function is B sinc²(Bx); the integral is that of a sine and its argument."""
    setting = camera(400.0, "square", LINES)
    for edge in edges_of(pupil(panel(np.ones((5, 5), np.bool_), cells=12), setting.stop), setting):
        pixels = np.arange(edge.values.shape[1]) - (edge.values.shape[1] - 1) / 2
        turn = np.pi * cutoff(setting, edge.wavelength_nm) * setting.pixel_um * pixels
        expected = 0.5 + (sici(2 * turn)[0] - np.sin(turn) ** 2 / turn) / np.pi
        np.testing.assert_allclose(edge.values, [expected, expected], atol=1e-10)
        assert edge.error.max() < 1e-7
        assert edge.outside == 0


@pytest.mark.parametrize(("diameter_um", "gutter_nm", "seed"), [(120.0, 0, 3), (150.0, 3000, 5), (300.0, 0, None)])
def test_an_edge_is_within_its_bar_of_that_of_finer_dots(diameter_um: float, gutter_nm: int, seed: int | None) -> None:
    """Of dots an eighth as wide a round stop cuts an eighth as much, and a gutter is a number of whole dots."""
    setting, coarse = camera(diameter_um, wavelengths=LINES), noise(5, 0.4, 6)
    cells = 2 * math.ceil((diameter_um / 2 + 20) / 40)
    fine = np.kron(coarse, np.ones((8, 8), np.bool_))
    edges = [
        edges_of(pupil(panel(mask, dot_nm=dot, gutter_nm=gutter_nm, cells=cells, seed=seed), setting.stop), setting)
        for mask, dot in ((coarse, 8000), (fine, 1000))
    ]
    for rough, exact in zip(*edges, strict=True):
        assert (abs(rough.values - exact.values) <= rough.error + exact.error).all()
        assert rough.error.max() < 0.1
        np.testing.assert_allclose(rough.values + rough.values[:, ::-1], 1, atol=1e-12)


def test_numbers_of_colours_are_within_their_bars_of_those_of_a_wide_window() -> None:
    source = pupil(panel(SPOT, cells=16, seed=2), camera(1000.0).stop)
    wide, narrow = (camera(1000.0, wavelengths=LINES, window_um=window) for window in (640.0, 60.0))
    far, near = (pixels_of(source, setting) for setting in (wide, narrow))
    true, found = (colour_distance(psfs[2], psfs[0]) for psfs in (far, near))
    assert max(psf.energy_in_window for psf in near) < 0.7
    assert true.uncertainty < found.uncertainty / 3
    assert abs(found.value - true.value) <= found.uncertainty + true.uncertainty
    # The window's own share, which used to be told, is below all that may be true.
    assert found.uncertainty < min(1 - psf.energy_in_window for psf in near)
    edge, seen = edges_of(source, narrow), [edge_in_window(psf) for psf in near]
    beyond = [edge_in_window(psf) for psf in far]
    side = (beyond[0].values.shape[1] - edge[0].values.shape[1]) // 2
    for exact, rough, best in zip(edge, seen, beyond, strict=True):
        assert (abs(exact.values - rough.values) <= exact.error + rough.error).all()
        assert (abs(exact.values - best.values[:, side:-side]) <= exact.error + best.error[side:-side]).all()
    told, lost = (edge_colour_difference(*each[::-1]) for each in (edge, seen))
    assert abs(told.value - lost.value) <= told.uncertainty + lost.uncertainty
    assert told.uncertainty < 0.25 * told.value < lost.uncertainty


def test_numbers_of_colours_are_told_only_where_their_bars_leave_them_a_meaning() -> None:
    source = pupil(panel(SPOT, cells=16, seed=2), camera(1000.0).stop)
    for window_um, told in ((60.0, False), (640.0, True)):
        setting = camera(1000.0, wavelengths=LINES, window_um=window_um)
        pixels = pixels_of(source, setting)
        distance, edge = colour_quantities(pixels, None, edges_of(source, setting))
        assert edge.uncertainty < 0.25 * edge.value
        assert (distance.value is not None) == told
        assert ("not told" in distance.method) != told
        if told:
            assert distance.uncertainty < 0.15 * distance.value
        unknown = colour_quantities(pixels, None)[1]
        assert unknown.value is None
        assert unknown.uncertainty is None
        assert "widen camera.window" in unknown.method


def test_fringe_of_known_edges() -> None:
    """Gaussian colours: an edge in colour c is Φ(x/σ_c); a red one twice as wide tints both sides."""
    x = 0.5 * (np.arange(242) - 120.5)
    edges = [EdgeSpread(np.tile(ndtr(x / s), (2, 1)), np.zeros(242), 0.0, 530.0) for s in (8.0, 4.0, 4.0)]
    channels = np.stack([ndtr(x / s) for s in (8.0, 4.0, 4.0)], axis=-1)
    grey = np.repeat(channels.mean(axis=-1, keepdims=True), 3, axis=-1)
    expected = delta_e_1976(lab_of_linear_srgb(channels), lab_of_linear_srgb(grey)).max()
    found = edge_colour_difference(*edges)
    assert found.value == pytest.approx(expected, rel=1e-12)
    assert found.uncertainty == 0
    assert edge_colour_difference(edges[0], edges[0], edges[0]).value == pytest.approx(0.0, abs=1e-10)
    # An edge that is another's, within its own bar, changes the number within that of the number.
    blurred = dataclasses.replace(edges[1], error=abs(edges[0].values - edges[1].values).max(axis=0))
    assert abs(edge_colour_difference(edges[0], blurred, edges[2]).uncertainty) >= abs(
        edge_colour_difference(edges[0], edges[0], edges[2]).value - expected
    )
    with pytest.raises(InternalError, match="MF901"):
        edge_colour_difference(edges[0], edges[1], EdgeSpread(edges[2].values[:, 1:-1], np.zeros(240), 0.0, 530.0))


def test_edges_of_pixels_are_those_of_their_sums() -> None:
    width, axis = 4.0, 0.5 * np.arange(-60, 61)
    share = np.diff(ndtr(np.append(axis - 0.25, axis[-1] + 0.25) / width))
    edge = edge_in_window(Psf(np.outer(share, share) / 0.25, 0.5, 530.0, "pixel"))
    x = 0.5 * (np.arange(122) - 60.5)
    np.testing.assert_allclose(edge.values, np.tile(ndtr(x / width), (2, 1)), atol=1e-12)
    assert edge.error.max() < 1e-12
