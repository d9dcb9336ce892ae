"""Spherical Bessel functions of many orders, and how many Chebyshev coefficients a wave has."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import j1, jv, spherical_jn

from maskfab.optics.polynomials import bessel_1, legendre, spherical_bessel, spherical_bessel_bounds, wave_degree


def test_the_first_bessel_function_is_the_known_one_on_either_side_of_its_two_forms() -> None:
    places = np.concatenate([[0.0, 1e-200, 24.999999, 25.0], np.linspace(0, 60, 3001), np.geomspace(60, 1e4, 3000)])
    assert abs(bessel_1(places[:, None]) - j1(places)[:, None]).max() < 1e-14


@given(st.floats(1e-9, 300.0), st.integers(1, 64))
def test_spherical_bessel_functions_are_the_known_ones_at_any_argument(argument: float, orders: int) -> None:
    """Arguments on both sides of the highest order in one array, 0 among them, where all but the first vanish."""
    places = np.array([[argument, argument / 7], [0.0, 1e-200]])
    found = spherical_bessel(places, orders)
    assert found.shape == (orders, 2, 2)
    assert abs(found - spherical_jn(np.arange(orders)[:, None, None], places)).max() < 3e-15
    assert found[:, 1, 0].tolist() == [1.0] + [0.0] * (orders - 1)


@pytest.mark.parametrize("phase", [0.3, 4.0, 19.0])
def test_a_wave_is_the_sum_of_its_legendre_polynomials(phase: float) -> None:
    """exp(izt) = Σ (2n + 1) i^n j_n(z) P_n(t) (Rayleigh; DLMF 10.60.7)."""
    places, orders = np.linspace(-1, 1, 41), 60
    weight = (2 * np.arange(orders) + 1) * 1j ** np.arange(orders)
    summed = (weight * spherical_bessel(np.array(phase), orders)) @ legendre(places, orders)
    assert abs(summed - np.exp(1j * phase * places)).max() < 5e-14


@given(st.floats(1e-3, 60.0))
def test_the_bound_of_an_order_holds_at_all_lesser_arguments_and_is_close_above_them(argument: float) -> None:
    below = spherical_bessel(argument * np.linspace(0, 1, 33), 64)
    bound = spherical_bessel_bounds(np.array(argument), 64)
    assert (bound[:, None] * (1 + 1e-13) >= abs(below)).all()
    far = np.arange(64) > argument**2
    assert (bound[far] < 2 * below[far, -1]).all()


@given(st.floats(0.0, 2000.0), st.sampled_from([1e-4, 1e-8, 1e-12]))
def test_a_plane_wave_has_the_chebyshev_coefficients_of_jacobi_and_anger(phase: float, tolerance: float) -> None:
    """2 J_n: every order above the one found is below the tolerance, and that one is not, but for rounding."""
    found = wave_degree(phase, tolerance)
    assert 2 * abs(jv(np.arange(found + 1, found + 400), phase)).max() < tolerance * 1.05
    assert found == 0 or 2 * abs(jv(found, phase)) > tolerance * 0.95
