"""Stops of a few dots or less, where the rim is most of the pupil: against slices of the disc summed on their own."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from optics_cases import noise, panel
from sweeps import in_turns, sweep

from maskfab.job.camera import Stop
from maskfab.optics.field.matrix import rim_orders
from maskfab.optics.field.methods import PATHS, FieldTask
from maskfab.optics.pupil import RIM_ORDERS, Aperture, cut, panel_aperture

Floats = NDArray[np.float64]


def field_of_slices(aperture: Aperture, radius: float, u: Floats) -> NDArray[np.complex128]:
    """∫∫ exp(-2πi(ux + vy)) over clear boxes ∩ disc, v along the rows, by 48 nodes between the angles of all kinks."""
    nodes, weights = leggauss(48)
    x, y = aperture.x.edges_um(), aperture.y.edges_um()
    total = np.zeros((u.size, u.size), dtype=np.complex128)
    for j, i in zip(*np.nonzero(aperture.transmission), strict=True):
        sides = np.array([x[i], x[i + 1]])
        chords = np.sqrt(np.clip(radius**2 - sides**2, 0, None))
        kinks = np.concatenate([y[[j, j + 1]], chords, -chords]).clip(y[j], y[j + 1])
        angles = np.sort(
            np.concatenate([np.arcsin((kinks / radius).clip(-1, 1)), [0.0] if y[j] < 0 < y[j + 1] else []])
        )
        for first, last in pairwise(angles):
            angle = (first + last) / 2 + (last - first) / 2 * nodes
            across = np.clip(radius * np.cos(angle) * [[-1.0], [1.0]], *sides)
            width, middle = across[1] - across[0], across.mean(axis=0)
            along_x = width[:, None] * np.sinc(width[:, None] * u) * np.exp(-2j * np.pi * middle[:, None] * u)
            slices = (last - first) / 2 * weights * radius * np.cos(angle)
            total += (slices[:, None] * np.exp(-2j * np.pi * radius * np.sin(angle)[:, None] * u)).T @ along_x
    return total


@pytest.mark.parametrize(
    ("dot_um", "diameter_um"), sweep(in_turns([40, 64, 100, 160], [6.0, 9.5, 17.0, 26.0, 38.0, 50.0]), 12)
)
def test_a_rim_that_is_most_of_the_light_keeps_the_stated_error(diameter_um: float, dot_um: int) -> None:
    seed = dot_um + int(diameter_um)
    stop = Stop("circle", diameter_um)
    laid_out = panel(noise(2, 0.7, seed), dot_nm=1000 * dot_um, gutter_nm=4000 * (seed % 2), cells=1 + seed % 3, seed=1)
    aperture = panel_aperture(laid_out, diameter_um / 2)
    source = cut(aperture, stop)
    # The widest window that a camera may have reaches half a cycle per dot.
    u = 0.5 / dot_um * np.arange(9, dtype=np.float64) / 8
    expected = field_of_slices(aperture, diameter_um / 2, np.concatenate([-u[:0:-1], u]))
    for path in PATHS:
        if path.refusal(FieldTask.of(source, u, u)) is None:
            intensity = path.intensity(source, u, u)
            assert np.linalg.norm(intensity - abs(expected) ** 2) <= path.error["double"] * np.linalg.norm(intensity)


def test_orders_follow_the_share_of_light_that_passes_the_rim() -> None:
    clear = np.ones((1, 1), dtype=np.bool_)
    large, small = (
        cut(panel_aperture(panel(clear, dot_nm=20_000, cells=cells)), Stop("circle", 19.9 * cells)) for cells in (40, 1)
    )
    needed = [[rim_orders(source, f, f) for f in np.linspace(0.0, 0.025, 26)] for source in (large, small)]
    assert all(few <= many for few, many in zip(*needed, strict=True))
    assert sum(needed[0]) < sum(needed[1])
    assert rim_orders(small, 0.025, 0.025) > RIM_ORDERS
    assert abs(small.moments(16)[:, :4, :4] - small.rim_moments[:, :4, :4]).max() < 1e-15


def test_orders_do_not_follow_the_sign_of_light_that_cancels() -> None:
    """A mask less its own mean sends nothing straight on, and its rim is no finer than the mask's."""
    lines = np.tile(np.array([1.0, -1.0]), 4)
    x = panel_aperture(panel(np.ones((8, 8), dtype=np.bool_), dot_nm=20_000, cells=1)).x
    stop = Stop("circle", 130.0)
    stripes = [
        cut(Aperture(x, x, np.outer(np.ones(8), signs), np.zeros((8, 8))), stop) for signs in (lines, abs(lines))
    ]
    assert abs(stripes[0].field_integral_um2) < 1e-12 * stripes[0].energy_um2
    frequencies = np.linspace(0.0, 0.025, 26)
    needed = [[rim_orders(source, f, f) for f in frequencies] for source in stripes]
    assert needed[0] == needed[1]
