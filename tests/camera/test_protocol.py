"""The protocol on small scenes: fair, repeatable, and it prefers what must be better."""

from __future__ import annotations

import math

import numpy as np
import pytest
from once import leaves as drawn

from maskfab.camera.photographs import folder, scene
from maskfab.camera.protocol import EPSILONS, evaluate
from maskfab.camera.scenes import dead_leaves
from maskfab.camera.transfer import CELLS, lay
from maskfab.errors import JobError, SourceError

ONE = np.zeros((CELLS, CELLS), dtype=np.int8)


@pytest.fixture(scope="module")
def leaves():
    return tuple(drawn(seed, 832, 832) for seed in (1, 2))


@pytest.fixture(scope="module")
def table(leaves):
    slit, bar = np.zeros((2, 21, 21), dtype=np.bool_)
    slit[:, 5:10] = True
    bar[:6, :17] = True
    designs = [lay("slit", slit, ONE), lay("bar", bar), lay("open", np.ones_like(bar))]
    return evaluate(designs, leaves, leaves[:1], (32,))


def test_the_open_stop_beats_the_bar_and_the_bar_beats_the_slit(table):
    gains = {g.design: g for g in table.gains("slit")}
    assert gains["open"].psnr > gains["bar"].psnr > 1
    assert gains["bar"].psnr_error > 0
    assert gains["bar"].ssim > 0


def test_the_table_holds_every_case(table):
    assert len(table.scores) == 6
    assert all(s.epsilon in EPSILONS and 0 < s.ssim < 1 and s.psnr > 10 for s in table.scores)


def test_the_same_again(leaves):
    bar = np.zeros((21, 21), dtype=np.bool_)
    bar[:6, :17] = True
    design = lay("bar", bar)
    first, again = (evaluate([design], leaves[:1], leaves[:1], (24,)) for _ in range(2))
    assert first == again
    twin = evaluate([design, lay("twin", bar)], leaves[:1], leaves[:1], (24,)).gains("bar")[0]
    assert twin.psnr == 0
    assert math.isnan(twin.psnr_error)


def test_scenes_follow_their_seed():
    a, b, c = (dead_leaves(seed, 192, 256).values for seed in (3, 3, 4))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)


def test_pictures_are_cut_to_their_middle():
    values = np.zeros((1100, 2048), dtype=np.float32)
    values[38:1062, 256:1792] = 1
    found = scene("7", values)
    assert found.values.shape == (3, 1024, 1536)
    assert found.number == 7
    assert (found.values == 1).all()
    assert scene("tall", np.zeros((2000, 900, 4), dtype=np.float32)).values.shape == (3, 1536, 896)


@pytest.mark.parametrize("values", [np.zeros((500, 2000)), np.full((900, 900), 2.0), np.full((900, 900), np.nan)])
def test_pictures_that_do_not_serve_are_refused(values):
    with pytest.raises(JobError, match="MF121"):
        scene("bad", values)


def test_a_folder_without_photographs_is_refused(tmp_path):
    with pytest.raises(SourceError, match="MF301"):
        folder(tmp_path)


def test_bad_studies_are_refused_before_any_work(leaves, table):
    design = lay("a", np.ones((21, 21), dtype=np.bool_))
    for designs, test, tuning, levels, code in (
        ([], leaves, leaves, (32,), "MF105"),
        ([design, design], leaves, leaves, (32,), "MF105"),
        ([design], (), leaves, (32,), "MF105"),
        ([design], leaves, (), (32,), "MF105"),
        ([design], leaves, leaves, (33,), "MF104"),
    ):
        with pytest.raises(JobError, match=code):
            evaluate(designs, test, tuning, levels)
    with pytest.raises(JobError, match="MF105"):
        table.gains("nobody")
