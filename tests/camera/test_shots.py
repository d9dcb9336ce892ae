"""Photographs to look at: what is shown is what was scored."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.fft
from once import leaves

from maskfab.camera import protocol
from maskfab.camera.expected import climb
from maskfab.camera.imaging import Margin
from maskfab.camera.protocol import evaluate
from maskfab.camera.restorers import wiener
from maskfab.camera.scores import Crop, Shot, psnr, truth_of
from maskfab.camera.stop_cells import lay

SENSOR = Crop(320, 320)


def shots(design, scene, levels, crop):
    taken = []
    evaluate(
        [design],
        [scene],
        [scene],
        levels,
        details=False,
        show=lambda score, whole: taken.append(Shot(score, crop.of(whole))),
    )
    return tuple(taken)


@pytest.fixture(scope="module")
def scene():
    return leaves(1, 832, 832)


@pytest.fixture(scope="module")
def design():
    unit = np.zeros((7, 7), dtype=bool)
    unit[:2, :5] = True
    return lay("bar", unit)


@pytest.fixture(scope="module")
def taken(design, scene):
    return shots(design, scene, (40, 24), SENSOR)


def test_the_picture_shown_has_the_psnr_told(taken, scene):
    true = truth_of(scene, SENSOR)
    assert [shot.score.level_db for shot in taken] == [24, 40]
    for shot in taken:
        assert psnr(shot.picture, true) == pytest.approx(shot.score.psnr, abs=1e-9)
        assert psnr(shot.picture[:, 64:-64, 64:-64], true[:, 64:-64, 64:-64]) == pytest.approx(shot.score.psnr_inner)
    assert taken[0].score.psnr < taken[1].score.psnr


def test_showing_changes_no_score(design, taken, scene):
    scores = evaluate([design], [scene], [scene], (24, 40)).scores
    assert all(0 < score.ssim < 1 and 0 < score.ssim_inner < 1 for score in scores)
    unlike = dict.fromkeys(("ssim", "ssim_inner", "delta_e", "delta_e_inner"), math.nan)
    assert [vars(score) | unlike for score in scores] == [vars(shot.score) for shot in taken]


def test_each_scene_is_transformed_once_and_no_picture_restored_twice(design, scene, monkeypatch):
    fresh, transforms, tried = replace(scene, name="fresh"), [], []
    transform, filtering = scipy.fft.rfft2, wiener.wiener

    def transformed(values, *given, **more):
        transforms.append(np.shares_memory(values, fresh.values))
        return transform(values, *given, **more)

    def filtered(transfer, prior, epsilon):
        tried.append(epsilon)
        return filtering(transfer, prior, epsilon)

    monkeypatch.setattr(scipy.fft, "rfft2", transformed)
    monkeypatch.setattr(wiener, "wiener", filtered)
    chosen = []
    for level in (24, 32):
        tried.clear()
        chosen.append(shots(design, fresh, (level,), SENSOR)[0].score.epsilon)
        assert len(tried) == len(set(tried)) > 2
    assert len(set(chosen)) == 2
    shots(design, fresh, (24, 32), SENSOR)
    assert sum(transforms) == 1  # all colours, for all levels and designs


def test_the_constant_is_the_best_and_few_others_are_tried(design, monkeypatch):
    """One pixel of 16 tells which, and one picture is restored with it."""
    scene, filtered, tried = leaves(1, 1024, 1536), Margin.filtered, []
    record = protocol.F1.photograph(design, scene, 40)
    prepared, true = wiener.Wiener().prepare(record, design), truth_of(scene, Crop(512, 1024))
    means = {each: psnr(prepared(each), true) for each in protocol.EPSILONS[::3]}
    monkeypatch.setattr(Margin, "filtered", lambda *given: (tried.append(1), filtered(*given))[1])
    assert shots(design, scene, (40,), SENSOR)[0].score.epsilon == max(means, key=means.__getitem__)
    assert len(tried) == 3  # colour by colour


@pytest.mark.parametrize("step", [1, 2, 4])
def test_a_sampled_picture_is_every_so_many_th_row_of_the_whole(step):
    values = np.random.default_rng(5).random((3, 40, 56)).astype(np.float32)
    margin = Margin((72, 88), 16)
    spectrum, transfer = margin.mirrored(values), np.random.default_rng(6).random((3, 72, 45), dtype=np.float32)
    found, whole = margin.blurred(spectrum, transfer, step), margin.blurred(spectrum, transfer)
    np.testing.assert_allclose(found, whole[:, ::step], atol=1e-5)


@pytest.mark.parametrize("best", range(len(protocol.EPSILONS)))
def test_a_climb_ends_on_the_peak_wherever_it_begins_and_asks_nothing_twice(best):
    for start in range(len(protocol.EPSILONS)):
        asked = []
        found = climb(lambda k, asked=asked: (asked.append(k), -abs(k - best))[1], start, len(protocol.EPSILONS))
        assert found == best
        assert len(asked) == len(set(asked)) <= abs(start - best) + 3


def test_a_scene_kept_for_the_constant_changes_no_picture_of_another(design, scene):
    """Pictures of the scenes that ε is chosen on are at hand, those of others are made."""
    other = leaves(2, 832, 832)
    both = evaluate([design], [other, scene], [scene], (32,), details=False).scores
    alone = evaluate([design], [other], [scene], (32,), details=False).scores
    assert vars(both[0]) == vars(alone[0])
    assert vars(both[1]) == vars(evaluate([design], [scene], [scene], (32,), details=False).scores[0])


def test_a_crop_is_the_middle_and_a_copy():
    picture = np.arange(3 * 6 * 8, dtype=np.float32).reshape(3, 6, 8)
    cut = Crop(2, 4).of(picture)
    assert np.array_equal(cut, picture[:, 2:4, 2:6])
    cut[:] = 0
    assert picture[0, 2, 2] == 18
