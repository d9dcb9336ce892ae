"""Paths of SVG by their steps: as short as they are, they lead through the same points."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.image import imread
from sweeps import examples

from maskfab.report.figures.sheet import few_colours, short_path, vector

PLACES = st.integers(-99_999, 99_999).map(lambda n: n / 1000)
POINTS = st.lists(st.tuples(PLACES, PLACES), min_size=1, max_size=12)


def written(*parts: list[tuple[float, float]]) -> str:
    """As matplotlib writes it."""
    told = []
    for part in parts:
        told += [f"{'L' if k else 'M'} {x:g} {y:g}" for k, (x, y) in enumerate(part)] + ["z"]
    return " ".join(told) + " "


def places(path: str) -> list[tuple[float, float]]:
    """The points that a path by steps leads through."""
    x = y = 0.0
    start, found = (0.0, 0.0), []
    for letter, rest in re.findall(r"([Mlvhz])([^Mlvhz]*)", path):
        numbers = [float(each) for each in rest.split()]
        if letter == "z":
            x, y = start
            continue
        if letter == "M":
            x, y = start = numbers[0], numbers[1]
        elif letter == "l":
            x, y = x + numbers[0], y + numbers[1]
        else:
            x, y = (x + numbers[0], y) if letter == "h" else (x, y + numbers[0])
        found.append((x, y))
    return found


@examples(60)
@given(POINTS, POINTS)
def test_a_path_by_steps_leads_through_its_points(one, other):
    found = places(short_path(written(one, other)))
    assert np.array(found) == pytest.approx(np.array([*one, *other]), abs=0.0051)


def test_lines_along_the_axes_are_told_by_these_alone():
    square = [(1.0, 1.0), (3.456, 1.0), (3.456, 2.5), (1.0, 2.5)]
    assert short_path(written(square)) == "M1.0 1.0h2.46v1.5h-2.46z"


def test_errors_do_not_add_up():
    line = [(k * 1.004, k * 0.006) for k in range(500)]
    assert places(short_path(written(line)))[-1] == pytest.approx(line[-1], abs=0.0051)


def test_curves_keep_their_form():
    assert short_path("M 1.2345 2 Q 3.4567 4 5 6.789 ") == "M 1.23 2 Q 3.45 4 5 6.78 "


def test_a_picture_in_few_colours_is_the_picture():
    rng = np.random.default_rng(3)
    ramp = np.linspace(0, 255, 64 * 64 * 3).reshape(64, 64, 3) + 6 * rng.standard_normal((64, 64, 3))
    colours = np.clip(ramp, 0, 255).round().astype(np.uint8)
    levels, palette = few_colours(colours)
    assert len(palette) <= 256
    error = palette[levels].astype(float) - colours
    assert np.sqrt((error**2).mean()) < 5
    assert np.abs(error.mean(axis=(0, 1))).max() < 0.2
    two = np.array([[[0, 0, 0], [9, 9, 9]]], dtype=np.uint8)
    levels, palette = few_colours(two)
    assert (palette[levels] == two).all()


@pytest.mark.parametrize("kind", ["few colours", "many colours", "seen through"])
def test_a_picture_keeps_its_pixels(kind):
    pixels = np.random.default_rng(3).integers(0, 256, (40, 30, 4), dtype=np.uint8)
    if kind == "few colours":
        pixels = pixels[:1, :9][:, np.arange(30) % 9].repeat(40, axis=0)
    pixels[..., 3] = pixels[..., 3] if kind == "seen through" else 255
    figure = Figure()
    figure.add_axes((0, 0, 1, 1)).imshow(pixels, interpolation="none", resample=False)
    (address,) = re.findall(r"data:image/png;base64,([^\"]+)", vector(figure))
    read = np.rint(255 * imread(io.BytesIO(base64.b64decode(address)), format="png"))
    expected = pixels if kind == "seen through" else pixels[..., : read.shape[2]]
    assert np.array_equal(read, expected)
