"""Gauss rules of points: what they must sum alike, and rules known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss
from sweeps import examples

from maskfab.optics.polynomials import gauss_rules


@given(st.integers(0, 10_000), st.integers(1, 5), st.floats(0.01, 1.0), st.floats(-10, 10))
@examples(60)
def test_polynomials_have_the_same_sums(seed: int, nodes: int, width: float, middle: float) -> None:
    """In every run, up to degree 2n - 1, whether its points are spread out or bunched."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(nodes, 40, 3)
    places = middle + width * rng.uniform(-1, 1, sizes.sum()) ** 3
    weights = rng.exponential(1.0, sizes.sum()) ** 3
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    found, shares = gauss_rules(places, weights, starts, nodes)
    for run, start in enumerate(starts):
        part = slice(start, start + sizes[run])
        assert (found[run] >= places[part].min()).all()
        assert (found[run] <= places[part].max()).all()
        for degree in range(2 * nodes):
            powers, expected = (((x - middle) / width) ** degree for x in (found[run], places[part]))
            assert shares[run] @ powers == pytest.approx(weights[part] @ expected, abs=1e-9 * weights[part].sum())


def test_of_an_even_weight_they_are_those_of_legendre() -> None:
    dense, weights = leggauss(40)
    places, shares = gauss_rules(5 + 2 * dense, weights, np.zeros(1, dtype=np.intp), 4)
    nodes, expected = leggauss(4)
    np.testing.assert_allclose(places[0], 5 + 2 * nodes, rtol=1e-13)
    np.testing.assert_allclose(shares[0], expected, rtol=1e-12)


@pytest.mark.parametrize("apart", [0.0, 1e-15, 50.0])
def test_fewer_points_than_nodes_keep_their_places_and_weights(apart: float) -> None:
    found, shares = gauss_rules(np.array([500.0, 500 + apart]), np.array([1.0, 3.0]), np.zeros(1, dtype=np.intp), 4)
    assert shares.sum() == pytest.approx(4.0, rel=1e-14)
    assert (shares[0] * found[0]).sum() == pytest.approx(500 + 3 * (500 + apart), rel=1e-14)
    assert np.isfinite(found).all()
