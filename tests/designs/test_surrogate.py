"""The surrogate's pieces and its order of designs."""

from __future__ import annotations

import numpy as np
import pytest
from estimates import surrogate
from once import leaves

from maskfab.base.errors import JobError


@pytest.fixture(scope="module")
def estimate():
    return surrogate([leaves(1)])


def bar():
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:6, :17] = True
    return mask


def test_more_light_and_compact_openings_win(estimate):
    slit = np.zeros((21, 21), dtype=np.bool_)
    slit[:, :5] = True
    full, compact, repeated = estimate(np.ones_like(slit)), estimate(bar()), estimate(slit, periodic=True)
    assert all(a > b > c for a, b, c in zip(full, compact, repeated, strict=True))
    assert list(compact) == sorted(compact)


def test_turning_the_unit_changes_nothing_in_a_random_tiling(estimate):
    np.testing.assert_allclose(estimate(np.rot90(bar())), estimate(bar()), rtol=1e-6)


def test_moving_the_unit_changes_nothing_in_a_periodic_tiling(estimate):
    np.testing.assert_allclose(
        estimate(np.roll(bar(), (3, 5), (0, 1)), periodic=True), estimate(bar(), periodic=True), rtol=1e-4
    )


def test_the_weights_make_up_the_square_of_frequencies(estimate):
    assert estimate.weight.sum() == pytest.approx(1)
    assert (estimate.weight > 0).all()


def test_scenes_of_another_size_do_not_serve():
    with pytest.raises(JobError, match="MF121"):
        surrogate([leaves(1, 832, 832)])
