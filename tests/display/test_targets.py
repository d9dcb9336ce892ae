"""Targets are pictures: in range, of the asked size, and show what they say."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.display import eye, pictures


@pytest.mark.parametrize("pixels", [8, 21, 100])
def test_every_target_can_be_shown(pixels):
    for name, image in eye.target_pictures(pixels).items():
        assert image.shape == (pixels, pixels, 3), name
        assert image.min() >= 0, name
        assert image.max() <= 1, name


@pytest.mark.parametrize("pixels", [-1, 0, 7, 1001])
def test_too_few_or_too_many_pixels_are_refused(pixels):
    with pytest.raises(JobError, match="MF121"):
        eye.target_pictures(pixels)


def test_the_zone_plate_reaches_half_a_cycle_per_pixel_at_its_sides():
    row = pictures.zone_plate(400)[200, :, 0]
    phase = np.pi * (np.arange(400) - 199.5) ** 2 / 400
    np.testing.assert_allclose(row, 0.5 + 0.5 * np.cos(phase + np.pi * 0.25 / 400), atol=1e-12)
    assert (np.diff(phase)[-1]) / (2 * np.pi) == pytest.approx(0.5, abs=0.01)


def test_the_edge_is_vertical():
    image = pictures.edge(10)
    assert (image[:, :5] == 0).all()
    assert (image[:, 5:] == 1).all()


def test_text_reads_upright():
    """The first letter of the top line is an M: its upper middle is empty, its lower middle too, its sides are full."""
    letter = pictures.text(40)[::-1][2:9, 2:7, 0]
    assert (letter[:, [0, 4]] == 0).all()
    assert (letter[0, 1:4] == 1).all()
    assert (letter[1, [1, 3]] == 0).all()


def test_leaves_are_the_same_for_the_same_seed_and_have_many_colours():
    first, again, other = pictures.leaves(40), pictures.leaves(40), pictures.leaves(40, seed=2)
    assert (first == again).all()
    assert (first != other).any()
    assert len(np.unique(first[:, :, 0])) > 200
