"""Panels behind transparent and opaque wires."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from optics_cases import camera, noise, panel

from maskfab.base.errors import JobError
from maskfab.base.model import Panel, Track
from maskfab.mask.outlines import oriented_track
from maskfab.optics.psf import point_psf
from maskfab.optics.pupil import cut, panel_aperture, veil


def _box(x0: int, y0: int, x1: int, y1: int) -> tuple[tuple[int, int], ...]:
    return ((x0, y0), (x0, y1), (x1, y1), (x1, y0))


def _bare() -> Panel:
    return panel(noise(6, 0.5, 3), gutter_nm=4000, cells=10, seed=4)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_full_cover_scales_the_energy_alone(share: float) -> None:
    bare, lens = _bare(), camera()
    side = bare.pitch_nm
    wired = replace(bare, tracks=(Track("veil", "x", (_box(0, 0, side, side),), False, share),))
    before, after = (cut(panel_aperture(each), lens.stop) for each in (bare, wired))
    assert after.energy_um2 == pytest.approx(share * before.energy_um2, rel=1e-12)
    if share:
        psfs = [point_psf(each, lens, 530.0).values for each in (before, after)]
        np.testing.assert_allclose(psfs[1], psfs[0], rtol=1e-9, atol=1e-12 * psfs[0].max())


@pytest.mark.parametrize("turns", [False, True])
def test_opaque_wire_cuts_openings(turns: bool) -> None:
    bare = _bare()
    track = Track("data", "y", (_box(2000 + 8000, 0, 2000 + 16_000, bare.pitch_nm),), turns)
    found = panel_aperture(replace(bare, tracks=(track,))).transmission
    plain = panel_aperture(bare).transmission.copy()
    for (j, i), k in np.ndenumerate(bare.orientations):
        for polygon in oriented_track(track, bare.pitch_nm, int(k)):
            (x0, y0), (x1, y1) = np.clip((np.array([min(polygon), max(polygon)]) - 2000) // 8000, 0, 6)
            plain[7 * j + y0 : 7 * j + y1, 7 * i + x0 : 7 * i + x1] = 0
    np.testing.assert_array_equal(found, plain)


def test_partly_covered_dots_keep_their_power() -> None:
    bare = panel(np.ones((4, 4), dtype=bool), cells=2)
    tracks = tuple(
        Track(name, "x", (_box(*box),), True, 0.25)
        for name, box in (("a", (0, 0, 3000, 32_000)), ("b", (0, 0, 32_000, 2000)))
    )
    amplitude, power = veil(replace(bare, tracks=tracks))
    np.testing.assert_allclose(amplitude.sum(axis=(1, 2)) / 16, (1 - 3 / 64) * (1 - 2 / 64), rtol=1e-12)
    np.testing.assert_allclose(power.sum(axis=(1, 2)) / 16, (1 - 0.75 * 3 / 32) * (1 - 0.75 * 2 / 32), rtol=1e-12)


def test_slanted_wires_are_refused() -> None:
    with pytest.raises(JobError, match="MF120"):
        veil(replace(_bare(), tracks=(Track("x", "x", (((0, 0), (9, 9), (9, 0)),), False),)))
