"""Wide stops: what the largest tables take in memory beside themselves, and that they are what they were."""

from __future__ import annotations

import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from optics_cases import noise, panel, pupil
from scipy import fft

from maskfab.job.camera import Stop
from maskfab.optics import lags
from maskfab.optics.lags import lag_table


@pytest.mark.parametrize(("dots", "cells", "gutter_nm"), [(1, 5, 0), (4, 1, 4000), (4, 2, 4000), (3, 6, 2000)])
def test_lags_of_either_sign_are_those_of_one_transform(dots: int, cells: int, gutter_nm: int) -> None:
    source = pupil(panel(noise(dots, 0.6, 3), gutter_nm=gutter_nm, cells=cells, seed=1), Stop("square", 1000.0))
    table = lag_table(source)
    rows, columns = source.y.dot_index().ravel(), source.x.dot_index().ravel()
    period = (cells, dots) if gutter_nm else (cells * dots, 1)
    blocks = source.whole[np.ix_(rows, columns)].reshape(*period, *period)
    power = abs(fft.fftn(blocks, table.values.shape)) ** 2
    expected = fft.ifftn(power).real * source.x.dot_um**2
    np.testing.assert_allclose(table.values, expected, atol=1e-13 * expected.max())


@pytest.mark.parametrize("gutter_nm", [0, 2000])
def test_a_table_takes_memory_for_the_lags_that_are_asked_for(gutter_nm, monkeypatch):
    source = pupil(panel(noise(20, 0.6, 3), gutter_nm=gutter_nm, cells=40, seed=1), Stop("circle", 6000.0))
    whole, reach = lag_table(source), 300.0
    tracemalloc.start()
    short = lag_table(source, reach)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    count = 2 * (np.ceil(reach / (source.x.pitch_um if gutter_nm else source.x.dot_um)) + 2) + 1
    assert short.values.size <= (count * (40 if gutter_nm else 1)) ** 2
    # Transforms along x and a few copies of what they are of; lags beyond reach would be four times as much.
    assert peak < (8 if gutter_nm else 3) * source.whole.nbytes
    x, y = np.random.default_rng(1).uniform(-reach, reach, (2, 300))
    assert abs(short.otf(x, y) - whole.otf(x, y)).max() < 1e-15
    assert short.volume_um2 == pytest.approx(whole.volume_um2, rel=1e-13)
    monkeypatch.setattr(lags, "_MOST_HELD", 20_000)
    np.testing.assert_array_equal(lag_table(source, reach).values, short.values)


WIDE = """
import resource
import numpy as np
from maskfab.base.model import Die, Opening, Panel, Tiling
from maskfab.job.camera import Camera, Stop
from maskfab.findings.optics import measure

mask = np.zeros((21, 21), dtype=bool)
mask[1:19, 8:13] = True
panel = Panel(Opening("slit", mask, 8000), 8000, 0, np.zeros((240, 240), dtype=np.int8), Tiling.PERIODIC, None)
first = 168_000 * (np.arange(240) - 120)
x, y = (each.ravel() for each in np.meshgrid(first + 64_000, first + 8_000))
slits = np.stack([x, y, x + 40_000, y + 144_000], axis=1)
camera = Camera(100_000.0, Stop("circle", 40_000.0), (530.0,), 2.0, 128.0)
found = measure(Die("WIDE", "", panel, (0, 0), 240 * 168_000), camera, slits)
assert all(quantity.passed is not False for quantity in found.quantities)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_a_stop_of_five_thousand_dots_is_measured_within_its_memory() -> None:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", WIDE], capture_output=True, text=True, check=True, timeout=600, env=environment
    )
    assert int(done.stdout) < 1.55e6  # kilobytes
