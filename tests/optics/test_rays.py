"""Samples along rays against the field itself, place by place and line by line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from optics_cases import noise, panel

from maskfab.job.camera import Stop
from maskfab.optics.field.matrix import SampledField, parity_field, prepare
from maskfab.optics.pupil import Pupil, cut, panel_aperture
from maskfab.optics.spectrum import RAYS_ERROR, Rays, beyond

HIGHEST = 0.03
SLOPES = np.array([0.02, 0.3, 0.51, 0.77, 0.99])
PLACES = np.linspace(0.05, 1.0, 23)
SCALES, WEIGHTS = np.array([33.4, 41.0, 57.7]), np.array([0.2, 0.5, 0.3])


def sampled_rays(source: Pupil) -> Rays:
    sides = source.stop.sides_um
    reach = max(sides) / math.sqrt(2) if source.stop.round else sum(sides) / 2
    end = (beyond(reach, HIGHEST),) * 2
    lattice = tuple(float(abs(axis.edges_um()).max()) for axis in (source.x, source.y))
    sampled = SampledField.of(lambda u, v: parity_field(source, u, v), (lattice[0], lattice[1]), end)
    return Rays.of(sampled, reach, HIGHEST, SLOPES)


def place_by_place(source: Pupil) -> np.ndarray:
    """[p, 4 rays for each slope], each of the three lines' own field."""
    prepared = prepare(source, 1.01 * HIGHEST, 1.01 * HIGHEST)
    found = np.zeros((PLACES.size, SLOPES.size, 4))
    for scale, weight in zip(SCALES, WEIGHTS, strict=True):
        for i, k in np.ndindex(PLACES.size, SLOPES.size):
            t = PLACES[i : i + 1] / scale
            wide, tall = ((t, t * SLOPES[k]), (t * SLOPES[k], t))
            sides = [each for u, v in (wide, tall) for each in prepared.field(u, v).quadrants()]
            found[i, k] += weight * np.array(sides).ravel()
    return found


def dots(clear: np.ndarray, stop: Stop) -> Pupil:
    """Dots of 8 um about the axis."""
    return cut(panel_aperture(panel(clear, dot_nm=8000, cells=1)), stop)


CORNERS = np.zeros((41, 41), dtype=np.bool_)
CORNERS[0, 0] = CORNERS[-1, -1] = CORNERS[0, -3] = True

PUPILS = {
    "noise in a circle": (noise(41, 0.5, 3), Stop("circle", 300.0)),
    "noise in a square": (noise(41, 0.3, 5), Stop("square", 328.0)),
    # Nothing but the longest lags that a stop has.
    "opposite corners": (CORNERS, Stop("square", 328.0)),
}


@pytest.mark.parametrize("name", PUPILS)
def test_lines_add_up_along_rays_as_place_by_place(name: str) -> None:
    source = dots(*PUPILS[name])
    found = sampled_rays(source).combined(PLACES, SCALES, WEIGHTS).reshape(PLACES.size, SLOPES.size, 4)
    exact = place_by_place(source)
    assert np.linalg.norm(found - exact) <= (RAYS_ERROR + 1e-12) * np.linalg.norm(exact)
