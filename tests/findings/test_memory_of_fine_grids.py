"""Polygons on a fine grid: what their optics takes in memory, in arrays of one number per dot of the grid."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from klayout import db

from maskfab.findings import analysis
from maskfab.findings.analysis import Request
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.optics.psf import Leak
from maskfab.optics.pupil import Aperture, Lattice, cut, zeros
from maskfab.optics.scene.model_bar import model_bar

ACROSS = 500
CAMERA = Camera(2000.0, Stop("circle", 400.0), (530.0,), 2.0, 16.0)
PLACE = 8  # bytes of a dot's number


def peak_in_grids(work: Callable[[], object]) -> float:
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / (PLACE * ACROSS**2)
    finally:
        tracemalloc.stop()


def slats(path: Path) -> Path:
    """Boxes on no common grid, some of them slanted, so that most dots are clear in part."""
    random = np.random.default_rng(4)
    layout = db.Layout()
    layout.dbu = 0.001
    shapes = layout.create_cell("SLATS").shapes(layout.layer(1, 0))
    for x in range(-210_000, 210_000, 7_000):
        width, lean = (int(v) for v in random.integers(2_000, 5_000, 2))
        ends = [(x, -210_000), (x + lean, 210_000), (x + lean + width, 210_000), (x + width, -210_000)]
        shapes.insert(db.Polygon([db.Point(*end) for end in ends]))
    shapes.insert(db.Box(-201, -333, 101, 77))
    layout.write(str(path))
    return path


@pytest.mark.parametrize(("blank", "most"), [(UNSTATED, 18.5), (MaskBlank(3.0, 0.3), 26.5)])
def test_the_optics_of_a_file_takes_few_numbers_per_dot(tmp_path, monkeypatch, blank, most):
    path = slats(tmp_path / "slats.gds")
    request, leak = Request(CAMERA, blank=blank), Leak.of(blank, CAMERA.stop)
    # Where polygons tell lags exactly the grid of slanted ones is half as fine.
    monkeypatch.setattr(analysis, "_FINEST_GRID", ACROSS if leak else 2 * ACROSS)
    found = []
    peak = peak_in_grids(lambda: found.append(analysis._see(path, request, leak)))
    ((_, _, _, _, pupil, _, _),) = found
    assert pupil.whole.shape == (ACROSS, ACROSS)
    assert np.count_nonzero(pupil.whole_variance) > 0.1 * ACROSS**2
    assert peak < most


def test_the_model_bar_takes_few_numbers_per_dot():
    lattice = Lattice(-200.0, ACROSS, 1, 400 / ACROSS, 400 / ACROSS)
    clear = np.random.default_rng(5).integers(0, 2, (ACROSS, ACROSS)).astype(float)
    pupil = cut(Aperture(lattice, lattice, clear, zeros(clear.shape)), CAMERA.stop)
    bars = [model_bar(pupil, CAMERA, UNSTATED)]  # what is kept for further calls is made
    peak = peak_in_grids(lambda: bars.append(model_bar(pupil, CAMERA, UNSTATED)))
    assert {each.name for each in bars[0]} >= {"cd bias", "vector field", "glass"}
    assert peak < 4.0
