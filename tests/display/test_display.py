"""Light goes where the emitters are, and none is lost or won by their areas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.base.model import Emitters, Opening, Tiling, orient
from maskfab.display import emitted_light, pictures


def test_every_pixel_sends_the_colour_asked_for_whatever_the_areas(slit_panel):
    panel = slit_panel(count=5)
    image = np.random.default_rng(0).random((5, 5, 3))
    for samples in (1, 4, 21, 42):  # 4 does not divide the cells
        light = emitted_light.show(panel, image, samples).rgb
        mean = light.reshape(3, 5, samples, 5, samples).mean(axis=(2, 4))
        np.testing.assert_allclose(np.moveaxis(mean, 0, -1), image, rtol=1e-12)


def test_openings_and_gutters_are_dark(slit_panel):
    panel = slit_panel(count=1, tiling=Tiling.PERIODIC, gutter_nm=8064)
    light = emitted_light.show(panel, pictures.flat(1, 1.0), 46).rgb  # a sample is half a dot here
    lit = light.sum(axis=0) > 0
    assert not lit[:2].any()
    assert not lit[-2:].any()
    assert not lit[:, :2].any()
    clear = np.kron(panel.opening.mask, np.ones((2, 2), dtype=bool))
    assert not lit[2:-2, 2:-2][clear].any()
    assert (lit[2:-2, 2:-2] == (panel.emitters.labels > 0)).all()


def test_samples_that_cells_do_not_divide_hold_exact_areas(slit_panel):
    """Averaging the fine raster over coarse samples is the coarse raster."""
    panel = slit_panel(count=3)
    image = np.random.default_rng(1).random((3, 3, 3))
    fine = emitted_light.show(panel, image, 42).rgb.reshape(3, 9, 14, 9, 14).mean(axis=(2, 4))
    coarse = emitted_light.show(panel, image, 3).rgb
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=1e-12)


def test_emitters_turn_as_openings_do(slit_panel):
    panel = slit_panel()
    tiles = np.stack([tile.samples(42) for tile in emitted_light.tiles_of(panel)])
    assert tiles.shape == (8, 3, 42, 42)
    for turn in range(8):
        for colour in range(3):
            assert ((tiles[turn, colour] > 0) == (orient(panel.emitters.labels, turn) == colour + 1)).all()


def test_a_picture_keeps_its_orientation(slit_panel):
    image = np.zeros((4, 4, 3))
    image[3, 0] = 1.0  # upper left
    light = emitted_light.show(slit_panel(count=4), image, 2).rgb
    assert light[:, 6:, :2].sum() == pytest.approx(light.sum()) != 0


def test_the_ideal_display_shines_evenly():
    image = np.random.default_rng(2).random((2, 3, 3))
    light = emitted_light.ideal(image, 3, 84.0)
    assert light.pixels == (2, 3)
    assert (light.rgb[:, 3:6, 6:9] == image[1, 2][:, None, None]).all()


def test_what_cannot_be_shown_is_refused_with_the_cure(slit_panel):
    panel = slit_panel(count=3)
    grey = pictures.flat(3)
    with pytest.raises(JobError, match=r"MF121 the panel has no emitters.*Say in the job"):
        emitted_light.show(replace(panel, emitters=None), grey, 3)
    with pytest.raises(JobError, match=r"MF121.*4 x 4 pixels and the panel 3 x 3"):
        emitted_light.show(panel, pictures.flat(4), 3)
    with pytest.raises(JobError, match="MF115"):
        emitted_light.show(panel, grey, 10_000)
    with pytest.raises(JobError, match="MF121 0 samples"):
        emitted_light.show(panel, grey, 0)
    labels = np.where(panel.emitters.labels == 3, 0, panel.emitters.labels).astype(np.int8)
    with pytest.raises(JobError, match=r"MF121.*blue"):
        emitted_light.show(replace(panel, emitters=Emitters(labels, 2016)), grey, 3)
    over = np.ones((42, 42), dtype=np.int8)
    with pytest.raises(JobError, match=r"MF119.*over an opening"):
        emitted_light.show(replace(panel, emitters=Emitters(over, 2016)), grey, 3)
    with pytest.raises(JobError, match="MF119"):
        emitted_light.show(replace(panel, emitters=Emitters(panel.emitters.labels, 1000)), grey, 3)
    other = Opening("other", np.ones((21, 21), dtype=np.bool_), 4032)
    with pytest.raises(JobError, match=r"MF119.*opening other"):
        emitted_light.show(replace(panel, others=(other,)), grey, 3)


def test_an_opening_may_bring_its_emitters_and_each_of_several_its_own(slit_panel):
    panel = slit_panel(count=4)
    labels = panel.emitters.labels
    brought = replace(panel, emitters=None, opening=replace(panel.opening, emitters=labels))
    image = pictures.flat(4)
    assert (emitted_light.show(brought, image, 14).rgb == emitted_light.show(panel, image, 14).rgb).all()
    swapped = np.array([0, 3, 2, 1], dtype=np.int8)[labels]
    second = replace(panel.opening, name="second", emitters=swapped)
    cells = np.zeros((4, 4), dtype=np.int8)
    cells[:, 2:] = 8
    both = replace(brought, others=(second,), orientations=cells)
    light = emitted_light.show(both, image, 14).rgb
    assert (light[0, :14, :14] == light[2, :14, 28:42]).all()
    assert (light[0] > 0).sum() > 0
    alone = replace(brought, others=(replace(second, emitters=None),))
    with pytest.raises(JobError, match=r"MF121.*opening second"):
        emitted_light.show(alone, image, 14)
