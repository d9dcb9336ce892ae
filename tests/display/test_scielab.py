"""S-CIELAB: equal light is equal, the filters are the published ones, and a lattice too fine to see is not seen."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.base.arrays import Floats
from maskfab.base.model import Tiling
from maskfab.display import emitted_light, eye, pictures
from maskfab.display.emitted_light import EmittedLight, Viewing


def see(light: EmittedLight, viewing: Viewing) -> Floats:
    return eye.of_series(emitted_light.series(light, viewing, eye.HIGHEST_CPD), viewing)


def test_a_periodic_panel_looks_like_even_pixels_on_an_even_field(slit_panel, telephone):
    shown = emitted_light.show(slit_panel(tiling=Tiling.PERIODIC, count=30), pictures.flat(30), 21)
    found = eye.colour_difference(
        see(shown, telephone), see(emitted_light.ideal(pictures.flat(30), 1, 84.67), telephone)
    )
    assert found.delta_e.max() < 1e-9


def test_the_same_panel_nearer_shows_its_lattice(slit_panel):
    shown = emitted_light.show(slit_panel(tiling=Tiling.PERIODIC, count=20), pictures.flat(20), 21)
    even = emitted_light.ideal(pictures.flat(20), 1, 84.67)
    near, nearer = (
        eye.colour_difference(*(see(light, Viewing(84.67, distance)) for light in (shown, even))).mean
        for distance in (150e3, 75e3)
    )
    assert 0.01 < near < nearer


def test_an_even_field_keeps_its_colour(telephone):
    """All filters pass 1 at frequency 0."""
    from maskfab.optics.colour import lab_of_linear_srgb

    colour = np.array([0.7, 0.2, 0.4])
    light = emitted_light.ideal(np.tile(colour, (6, 6, 1)), 1, 84.67)
    np.testing.assert_allclose(
        see(light, telephone), np.broadcast_to(lab_of_linear_srgb(colour), (12, 12, 3)), atol=1e-11
    )


def test_the_difference_of_a_thing_from_itself_is_zero_and_symmetric(telephone):
    first, second = (
        see(emitted_light.ideal(np.random.default_rng(k).random((9, 9, 3)), 1, 84.67), telephone) for k in (0, 1)
    )
    assert eye.colour_difference(first, first).delta_e.max() == 0
    there, back = eye.colour_difference(first, second), eye.colour_difference(second, first)
    assert (there.delta_e == back.delta_e).all()
    assert (there.colour <= there.delta_e).all()
    assert there.mean < there.worst_twentieth
    assert there.fringe == there.colour.max()


def test_the_filter_is_the_convolution_with_the_published_gaussians():
    """One channel's gain against the numerical transform of its kernel, weights scaled to sum to 1."""
    radius = np.array([0.0, 0.5, 3.0, 12.0])
    r = np.linspace(0, 3.0, 60_001)
    from scipy.special import j0

    weights, spreads = np.array([0.531, 0.330]), np.array([0.0392, 0.494])
    kernel = sum(
        w / (np.pi * s**2) * np.exp(-((r / s) ** 2)) for w, s in zip(weights / weights.sum(), spreads, strict=True)
    )
    transform = [np.trapezoid(kernel * j0(2 * np.pi * f * r) * 2 * np.pi * r, r) for f in radius]
    np.testing.assert_allclose(eye.gains(radius)[1], transform, atol=1e-6)
    # The scaled weights are those of the authors' later code.
    sums = [sum(w for w, _ in channel) for channel in eye.GAUSSIANS]
    scaled = [w / s for channel, s in zip(eye.GAUSSIANS, sums, strict=True) for w, _ in channel]
    published = [1.00327, 0.11442, -0.11765, 0.616725, 0.383275, 0.567885, 0.432115]
    np.testing.assert_allclose(scaled, published, atol=3e-4)


def test_nothing_of_note_passes_above_the_highest_frequency():
    assert np.abs(eye.gains(np.array([eye.HIGHEST_CPD]))).max() < 1.1e-12


def test_the_field_beyond_an_edge_does_not_depend_on_samples(slit_panel, telephone):
    panel = slit_panel(count=12)
    image = pictures.edge(12)
    coarse, fine = (see(emitted_light.show(panel, image, samples), telephone) for samples in (42, 84))
    np.testing.assert_allclose(coarse, fine, atol=1e-8)


def test_lab_agrees_with_a_reference():
    colour = pytest.importorskip("colour")
    from maskfab.optics.colour import XYZ_OF_RGB, delta_e_1976, lab_of_linear_srgb

    rgb = np.random.default_rng(5).random((50, 3))
    white = XYZ_OF_RGB.sum(axis=1)
    xy = white[:2] / white.sum()
    lab = colour.XYZ_to_Lab(rgb @ XYZ_OF_RGB.T, xy)
    np.testing.assert_allclose(lab_of_linear_srgb(rgb), lab, atol=1e-9)
    np.testing.assert_allclose(
        delta_e_1976(lab[:25], lab[25:]), colour.delta_E(lab[:25], lab[25:], method="CIE 1976"), atol=1e-9
    )
