"""A fixed part of the hunt for error bars below the truth; all of it is ``python tests/bar_hunt.py``."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from bar_hunt import Drawn, Finding, hunted, table
from brute_optics import Boxes, Outline, Picture, Slices

SMALL_UM = 125.0


def small_scenes(count: int) -> list[int]:
    """The first scenes of small stops and one line, each checked in a third of a second."""
    drawn = (Drawn.of(0, number) for number in itertools.count())
    small = (one for one in drawn if one.camera.stop.diameter_um < SMALL_UM and len(one.camera.wavelengths_nm) == 1)
    return [one.number for one in itertools.islice(small, count)]


@pytest.mark.parametrize("number", small_scenes(40))
def test_no_bar_is_below_the_truth(number: int) -> None:
    found = hunted(0, number, quick=True)
    assert len({finding.name for finding in found}) > 9
    assert [finding for finding in found if finding.below] == []


def test_a_bar_below_the_truth_is_told() -> None:
    honest, short = (Finding(1, "number", bar, 1e-3, 0.0, 1.0) for bar in (2e-3, 5e-4))
    assert (honest.below, short.below) == (False, True)
    assert honest.ratio == pytest.approx(2.0, rel=1e-4)
    assert list(table([honest, short]))[2].split(" | ")[1:3] == ["2", "1"]


def test_brute_force_is_that_of_a_clear_square_and_disc() -> None:
    """sinc² and the chat function (Goodman, Fourier Optics, 6.3)."""
    open_sky = Boxes(*2 * (np.array([-200.0, 200.0]),), np.ones((1, 1), dtype=bool))
    square, disc = (Slices(open_sky, Outline.of(shape, 100.0, 100.0, 0.0, ())) for shape in ("square", "circle"))
    u = np.array([0.0, 0.003, 0.011])
    np.testing.assert_allclose(square.field(u, u), 1e4 * np.outer(np.sinc(100 * u), np.sinc(100 * u)), atol=1e-9)
    lag = np.array([0.0, 30.0, 77.0])
    chat = 2 / np.pi * (np.arccos(lag / 100) - lag / 100 * np.sqrt(1 - (lag / 100) ** 2))
    np.testing.assert_allclose(disc.overlaps(lag, 0 * lag), chat * np.pi * 2500, rtol=1e-9)
    np.testing.assert_allclose(square.overlaps(lag, lag), (100 - lag) ** 2, rtol=1e-12)
    picture = Picture.of(10.0, np.ones((30, 30)))
    assert picture.in_circle(3.0) == pytest.approx(9 * np.pi, rel=1e-12)
    assert picture.in_square(3.0) == pytest.approx(9.0, rel=1e-12)
