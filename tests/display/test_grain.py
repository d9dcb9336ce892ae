"""The one formula that matters, against rendered fields."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.model import Emitters, Tiling, orient
from maskfab.display import emitted_light, eye, pictures
from maskfab.display.emitted_light import Viewing, series
from maskfab.optics.colour import luminance_centroid


def measured(panel, viewing, low=0.0, high=eye.SLOW_CPD, count=100) -> float:
    light = emitted_light.show(panel, pictures.flat(count), 14)
    return eye.measured_rms(series(light, viewing, 31.0), low, high)


@pytest.mark.parametrize("order", [(1, 3, 2), (2, 1, 3), (3, 1, 2), (3, 2, 1)])
def test_the_formula_agrees_with_the_picture_within_a_tenth(slit_panel, telephone, order):
    panel = slit_panel(order)
    _, offset = eye.centroids(panel)
    assert offset >= 0.05
    assert measured(panel, telephone) == pytest.approx(eye.predicted_rms(offset, telephone), rel=0.10)


def test_the_constant():
    assert pytest.approx(5.57, abs=0.005) == eye.CONSTANT
    assert eye.predicted_rms(0.138, Viewing(25400 / 300, 300e3)) == pytest.approx(0.0201, abs=1e-4)


def test_a_periodic_panel_has_no_grain(slit_panel, telephone):
    panel = slit_panel(tiling=Tiling.PERIODIC, count=40)
    mean, offset = eye.centroids(panel)
    assert offset == 0
    assert np.hypot(*mean) == pytest.approx(0.196, abs=1e-3)
    assert measured(panel, telephone, count=40) < 1e-12
    assert measured(panel, telephone, 10, 30, count=40) < 1e-12


def test_the_centroid_turns_with_the_pixel_and_keeps_its_distance(slit_panel):
    emitters = slit_panel().emitters
    places = [luminance_centroid(Emitters(orient(emitters.labels, k), emitters.cell_nm), 84_672) for k in range(8)]
    np.testing.assert_allclose(np.hypot(*np.array(places).T), np.hypot(*places[0]))
    np.testing.assert_allclose(np.sum(places, axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(places[4], places[0] * np.array([-1, 1]), atol=1e-12)  # mirrored left-right


def test_point_emitters_have_the_centroid_of_their_luminance(make_panel):
    labels = np.zeros((5, 5), dtype=np.int8)
    labels[2, 0], labels[2, 4], labels[0, 2] = 1, 2, 3
    panel = make_panel(np.zeros((5, 5), dtype=np.bool_), labels, 1000)
    x, y = luminance_centroid(panel.emitters, 5000)
    assert x == pytest.approx((-0.2126 + 0.7152) * 0.4)
    assert y == pytest.approx(-0.0722 * 0.4)


def test_a_pixel_with_its_centroid_in_the_middle_has_little_slow_grain(make_panel, telephone):
    """Emitters in concentric rings: every centroid is the centre, whatever the orientation."""
    radius = np.hypot(*(np.mgrid[0:21, 0:21] - 10))
    labels = np.select([radius < 4, radius < 7, radius < 10], [1, 2, 3], 0).astype(np.int8)
    panel = make_panel(np.zeros((21, 21), dtype=np.bool_), labels, 4032)
    assert eye.centroids(panel)[1] < 1e-12
    assert measured(panel, telephone) < 1e-10


def test_colour_does_not_make_grain_of_luminance_from_one_orientation_in_two(slit_panel):
    """Two orientations, half and half: the offset is half the distance between the centroids."""
    panel = slit_panel(count=10)
    turns = np.zeros((10, 10), dtype=np.int8)
    turns[:, ::2] = 4
    mean, offset = eye.centroids(replace(panel, orientations=turns))
    assert np.abs(mean[0]) < 1e-12
    assert offset == pytest.approx(0.1958, abs=1e-4)


def test_grain_in_a_band_adds_in_power(slit_panel, telephone):
    panel = slit_panel(count=40)
    parts = [measured(panel, telephone, low, high, count=40) for low, high in ((0, 10), (10, 30), (0, 30))]
    assert np.hypot(*parts[:2]) == pytest.approx(parts[2], rel=1e-12)


def test_a_known_wave_has_its_own_contrast(telephone):
    """1 + 0.2 cos: rms 0.2 / sqrt 2, in the band that holds it and in no other."""
    count = 60
    wave = 0.5 * (1 + 0.2 * np.cos(2 * np.pi * 3 * (np.arange(count) + 0.5) / count))
    light = emitted_light.ideal(np.broadcast_to(wave[None, :, None], (count, count, 3)), 1, 84.67)
    frequency = 3 / count * telephone.pixels_per_degree  # 3.09 cycles per degree
    found = series(light, telephone, 30.0)
    assert eye.measured_rms(found, 0, frequency + 0.1) == pytest.approx(
        0.2 / np.sqrt(2) * np.sinc(3 / count), rel=1e-12
    )
    assert eye.measured_rms(found, frequency + 0.1, 30) < 1e-14


def test_the_offset_is_what_the_layout_calls_wander(slit_panel):
    from maskfab.display.placement import wander

    for order in ((1, 2, 3), (3, 1, 2)):
        panel = slit_panel(order, count=200)
        assert eye.centroids(panel)[1] == pytest.approx(wander(panel.emitters, panel.pitch_nm), rel=1e-3)


def test_a_panel_of_two_openings_wanders_between_both_centroids(slit_panel):
    panel = slit_panel(count=2)
    labels = panel.emitters.labels
    second = replace(panel.opening, name="second", emitters=labels[:, ::-1].copy(), mask=panel.opening.mask[:, ::-1])
    first = replace(panel.opening, emitters=labels)
    cells = np.array([[0, 8], [8, 0]], dtype=np.int8)
    both = replace(panel, emitters=None, opening=first, others=(second,), orientations=cells)
    mean, offset = eye.centroids(both)
    place = luminance_centroid(panel.emitters, panel.pitch_nm)
    assert offset == pytest.approx(abs(place[0]))
    np.testing.assert_allclose(mean, [0, place[1]], atol=1e-12)
