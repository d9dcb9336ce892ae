"""Photographs to look at: what is shown is what was scored."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.camera.protocol import evaluate
from maskfab.camera.quality import psnr
from maskfab.camera.scenes import dead_leaves
from maskfab.camera.shots import Crop, shots, truth_of
from maskfab.camera.transfer import lay
from maskfab.errors import JobError

SCENE = dead_leaves(1, 832, 832)
SENSOR = Crop(320, 320)


@pytest.fixture(scope="module")
def design():
    unit = np.zeros((7, 7), dtype=bool)
    unit[:2, :5] = True
    return lay("bar", unit)


@pytest.fixture(scope="module")
def taken(design):
    return shots(design, SCENE, (40, 24), SENSOR)


def test_the_picture_shown_has_the_psnr_told(taken):
    true = truth_of(SCENE, SENSOR)
    assert [shot.score.level_db for shot in taken] == [24, 40]
    for shot in taken:
        assert psnr(shot.picture, true) == pytest.approx(shot.score.psnr, abs=1e-9)
        assert psnr(shot.picture[:, 64:-64, 64:-64], true[:, 64:-64, 64:-64]) == pytest.approx(shot.score.psnr_inner)
    assert taken[0].score.psnr < taken[1].score.psnr


def test_showing_changes_no_score(design, taken):
    assert evaluate([design], [SCENE], [SCENE], (24, 40)).scores == tuple(shot.score for shot in taken)


def test_a_crop_is_the_middle_and_a_copy():
    picture = np.arange(3 * 6 * 8, dtype=np.float32).reshape(3, 6, 8)
    cut = Crop(2, 4).of(picture)
    assert np.array_equal(cut, picture[:, 2:4, 2:6])
    cut[:] = 0
    assert picture[0, 2, 2] == 18


@pytest.mark.parametrize("sides", [(0, 3), (3, 0), (7, 3), (3, 9), (-1, 3)])
def test_a_crop_that_is_empty_or_too_large_is_refused(sides):
    with pytest.raises(JobError, match="8 x 6") as caught:
        Crop(*sides).of(np.zeros((3, 6, 8), dtype=np.float32))
    assert caught.value.code == "MF104"
