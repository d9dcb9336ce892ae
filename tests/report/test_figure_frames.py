"""Figures that fill a frame show what the figures themselves show."""

from __future__ import annotations

import base64
import io
import re
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image

import maskfab as mf
from maskfab.report.figures.die import mtf, psf
from maskfab.report.figures.report import mtf_image, psf_image

LINES = ("610 nm", "530 nm", "470 nm")


@pytest.fixture(scope="module")
def camera() -> mf.Camera:
    return mf.Camera("10 mm", stop="2 mm", pixel="2 um", wavelengths=list(LINES), window="128 um")


@pytest.fixture(scope="module")
def panels() -> list[mf.Panel]:
    bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
    return [mf.Panel.tile(bar, tiling, seed=1, size="2.2 mm") for tiling in ("random", "periodic")]


def svg(image: str) -> str:
    return unquote(image).replace('<g id="curve">', "<g>")


def points(path: str) -> np.ndarray:
    """Corners of a path of straight lines, absolute or by steps."""
    at, found = np.zeros(2), []
    for letter, numbers in re.findall(r"([MLlhv])([^MLlhvz]*)", path.strip(' d="')):
        values = [float(number) for number in numbers.split()]
        step = {"h": [*values, 0.0], "v": [0.0, *values]}.get(letter, values)
        at = np.array(step) if letter in "ML" else at + step
        found.append(at)
    return np.array(found)


def off(corners: np.ndarray, line: np.ndarray) -> float:
    """Largest distance of corners from a line."""
    start, step = line[:-1], np.diff(line, axis=0)
    along = np.einsum("cse,se->cs", corners[:, None] - start, step) / np.maximum(np.sum(step**2, axis=1), 1e-12)
    nearest = start + np.clip(along, 0, 1)[..., None] * step
    return float(np.linalg.norm(corners[:, None] - nearest, axis=2).min(axis=1).max())


@pytest.mark.parametrize("lines", [LINES, LINES[1:2]])
def test_curves_of_every_die_lie_where_the_figure_draws_them(camera, panels, lines):
    for panel in panels:  # the second fills the frame of the first
        mtfs = [camera.mtf(panel, line) for line in lines]
        own, filled = svg(mtf(mtfs).img()), svg(mtf_image(mtfs))
        shape = re.compile(r' d="[^"]*"')
        assert shape.sub("", filled) == shape.sub("", own)
        for one, other in zip(shape.findall(own), shape.findall(filled), strict=True):
            if one != other:
                # What is simplified lies within a ninth of a point, and rounding, of where it was.
                assert off(points(one), points(other)) < 0.15
                assert off(points(other), points(one)) < 0.15


@pytest.mark.parametrize("lines", [LINES, LINES[1:2]])
def test_pictures_of_every_die_are_those_of_the_figure(camera, panels, lines):
    picture = re.compile(r"data:image/png;base64,([A-Za-z0-9+/=]+)")
    for panel in panels:
        psfs = [camera.psf(panel, line) for line in lines]
        own, filled = svg(psf(psfs).img()), svg(psf_image(psfs))
        assert picture.sub("", filled) == picture.sub("", own)
        assert len(picture.findall(own)) == len(lines) + 1
        for one, other in zip(picture.findall(own), picture.findall(filled), strict=True):
            shown = (Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB") for png in (one, other))
            colours = [np.asarray(image, dtype=np.int64) for image in shown]
            assert abs(colours[0] - colours[1]).max() <= 5  # a step of 256 of the colours
