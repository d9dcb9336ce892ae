"""The numbers of a panel, and how they move with distance, shift and scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.model import Emitters, Tiling
from maskfab.display import eye, pictures
from maskfab.display.emitted_light import Viewing, ideal, series, show
from maskfab.display.eye import HIGHEST_CPD, appearance


def numbers(judged) -> dict:
    return {quantity.name: quantity.value for quantity in judged.quantities}


def judge(panel, viewing, count=40, **images):
    return eye.judge("A", panel, images or {eye.FLAT: pictures.flat(count)}, 14, viewing)


def test_a_slit_panel_turned_at_random_has_the_grain_and_difference_that_were_measured_before(slit_panel, telephone):
    """T-OLED: |c| about 0.2 pixel, rms 2.96 % and S-CIELAB 2.3 by an independent program and placement."""
    found = numbers(judge(slit_panel((2, 3, 1)), telephone, 100))
    assert found["grain_slow"] == pytest.approx(0.0296, rel=0.1)
    assert found["flat_delta_e_mean"] == pytest.approx(2.3, rel=0.15)
    assert found["grain_fine"] == pytest.approx(0.239, rel=0.2)
    assert found["pixels_per_degree"] == pytest.approx(61.84, abs=0.005)


def test_grain_fades_with_distance_and_grows_with_the_pixel(slit_panel):
    panel = slit_panel()
    by_distance = [
        numbers(judge(panel, Viewing(84.67, distance)))["flat_delta_e_mean"] for distance in (200e3, 300e3, 600e3)
    ]
    assert by_distance == sorted(by_distance, reverse=True)
    assert by_distance[0] > 3 * by_distance[2]
    # Twice the pitch from twice the distance is the same picture.
    same = numbers(judge(panel, Viewing(169.34, 600e3)))["flat_delta_e_mean"]
    assert same == pytest.approx(by_distance[1], rel=1e-12)


def test_removing_the_common_shift_helps_a_periodic_panel_off_its_centre(slit_panel, telephone):
    """Once the picture has moved by the mean centroid, only the shapes of the emitters are left."""
    panel = slit_panel((1, 3, 2), tiling=Tiling.PERIODIC)
    found = numbers(judge(panel, telephone, zone=pictures.zone_plate(40)))
    assert found["zone_delta_e_aligned"] < 0.6 * found["zone_delta_e_mean"]


def test_a_centred_arrangement_is_better_than_one_off_the_centre(slit_panel, telephone):
    centred, off = (numbers(judge(slit_panel(order), telephone)) for order in ((1, 2, 3), (1, 3, 2)))
    assert centred["centroid_offset"] < 0.1 * off["centroid_offset"]
    assert centred["grain_slow"] < 0.2 * off["grain_slow"]
    assert centred["flat_delta_e_mean"] < off["flat_delta_e_mean"]


def test_areas_do_not_matter_to_a_flat_periodic_field(slit_panel, telephone):
    panel = slit_panel(tiling=Tiling.PERIODIC)
    labels = panel.emitters.labels.copy()
    labels[:30, 20:30] = 0
    thin = replace(panel, emitters=Emitters(labels, panel.emitters.cell_nm))
    assert numbers(judge(thin, telephone))["flat_delta_e_mean"] < 1e-9


def test_greys_look_grey_and_their_mean_stays(slit_panel, telephone):
    image = pictures.zone_plate(20)
    seen = appearance(series(ideal(image, 1, 84.67), telephone, HIGHEST_CPD), telephone)
    assert np.ptp(seen, axis=2).max() < 1e-12
    coloured = np.random.default_rng(0).random((20, 20, 3))
    light = show(slit_panel(count=20), coloured, 7)
    seen = appearance(series(light, telephone, HIGHEST_CPD), telephone)
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), coloured.mean(axis=(0, 1)), rtol=1e-12)


def test_every_number_is_plain_and_named_once(slit_panel, telephone):
    judged = eye.judge("A", slit_panel(count=20), eye.target_pictures(20), 6, telephone)
    names = [quantity.name for quantity in judged.quantities]
    assert len(names) == len(set(names))
    assert all(type(quantity.value) is float and np.isfinite(quantity.value) for quantity in judged.quantities)
    assert {"edge_fringe", "leaves_delta_e_mean", "grain_predicted", "centroid_offset"} <= set(names)
