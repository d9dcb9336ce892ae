"""Bands of restored photographs: openings as written against drawings, the expansion against full cases and draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from scipy.special import ndtri

from maskfab.base.model import Die, Opening, Panel, Tiling, refined
from maskfab.camera.protocol import Protocol
from maskfab.camera.scores import Score
from maskfab.findings.as_written import written_openings
from maskfab.findings.bands import DRAWN, Expansion, ProcessSpread, _Photographed, restored_bands, restored_expansion
from maskfab.findings.photographs import Conditions, Photographs, Restored, Surroundings
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import UNSTATED, Process
from maskfab.optics.pupil import panel_aperture

CAMERA = Camera(5000.0, Stop("circle", 400.0), (610.0, 530.0, 470.0), 2.0, 64.0)
MASK = np.zeros((7, 7), dtype=bool)
MASK[1:6, 2:4] = True
TAKEN = Conditions(Protocol("camera"), CAMERA, (32.0,), "")
AROUND = Surroundings(None, None, UNSTATED)
SPREAD = ProcessSpread(0.2, 0.3)


def die(mask: np.ndarray = MASK, dot_nm: int = 8000) -> Die:
    cells = np.zeros((8, 8), dtype=np.int8)
    panel = Panel(Opening("W", mask, dot_nm), dot_nm, 0, cells, Tiling.PERIODIC, None)
    return Die("W", "W", panel, (0, 0), 8 * panel.pitch_nm)


def photographed(parts: int = 7) -> _Photographed:
    drawn, _ = TAKEN.design("W", die().panel, AROUND)
    return _Photographed(die(), CAMERA, drawn, TAKEN, None, parts)


def test_edges_that_move_by_whole_parts_are_a_drawing_on_finer_dots():
    """Of parts a fifth of a dot wide, whose middles lie on the dots' edges, a bias of 1.6 um opens half of one more."""
    grown = binary_dilation(refined(MASK, 10), np.ones((3, 3)))
    found = written_openings(die(), CAMERA, Process(0.0, 1.6), 5)
    drawn = panel_aperture(die(grown, 800).panel)
    assert found.x.edges_um()[1:] - 0.8 == pytest.approx(drawn.x.edges_um()[::2])
    shown = np.pad(drawn.transmission, 1)
    parts = shown.reshape(shown.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3))
    assert found.transmission == pytest.approx(parts, abs=1e-12)


def test_openings_that_nothing_changes_are_photographed_as_drawn():
    """Behind a stop that cuts no dots, whose shares finer parts would know better; by even parts, none of them grey."""
    camera = replace(CAMERA, stop=Stop("square", 336.0))
    drawn, _ = replace(TAKEN, camera=camera).design("W", die().panel, AROUND)
    seen = drawn.through(written_openings(die(), camera, DRAWN, 2), 2)
    assert seen.transmission == pytest.approx(drawn.transmission, rel=1e-6)
    assert abs(seen.on((704, 768)) - drawn.on((704, 768))).max() < 1e-5


def test_cases_between_the_full_ones_are_where_the_expansion_has_them():
    process, seen = Process(0.5, 0.1), photographed()
    found = restored_expansion(TAKEN, AROUND, die(), process, ProcessSpread(0.2))
    assert isinstance(found, Expansion)
    a, c, *of_radius = found.terms
    assert a > 0  # a wider opening passes more light
    assert of_radius == [0, 0]
    drawn, stated, wider = (seen.psnr(each) for each in (DRAWN, process, Process(0.5, 0.3)))
    assert found.nominal == pytest.approx(stated - drawn, abs=1e-9)
    assert a + c == pytest.approx(wider - stated, abs=0.05 * a)
    assert found.error < 0.2 * a


def test_a_gain_moves_by_what_both_dies_move_in_one_process():
    own, reference = (
        Expansion(0.1, (0.5, 0.0, 0.0, 0.0), (0.02, 0.0)),
        Expansion(0.0, (0.4, 0.0, 0.0, 0.0), (0.01, 0.0)),
    )
    psnrs = {"A": (20.0, 21.0), "B": (22.0, 24.0)}
    scores = {
        name: tuple(Score(name, 32.0, f"s{i}", 0.1, each, 0.0, each, 0.0) for i, each in enumerate(own_psnrs))
        for name, own_psnrs in psnrs.items()
    }
    seen = Photographs(TAKEN, {name: Restored(each) for name, each in scores.items()})
    changes, process, spread = {"A": reference, "B": own}, Process(0.0), ProcessSpread(0.2)
    rows = {row.name: row for row in restored_bands(seen, "B", changes, process, spread)}
    z = float(np.quantile(spread.deviations(process)[0], 0.975))
    assert rows["band_restored_psnr"].between == pytest.approx((23.1 - 0.5 * z, 23.1 + 0.5 * z))
    assert rows["band_restored_gain"].between == pytest.approx((2.6 - 0.1 * z, 2.6 + 0.1 * z))
    assert rows["band_restored_gain"].uncertainty == pytest.approx(0.01)
    assert rows["sensitivity_restored_psnr"].value == pytest.approx(0.25)
    assert "band_restored_gain" not in {row.name for row in restored_bands(seen, "A", changes, process, spread)}


def test_a_die_that_cannot_be_photographed_says_so_in_its_band():
    narrow = replace(TAKEN, camera=replace(CAMERA, stop=Stop("circle", 500.0)))
    told = restored_expansion(narrow, AROUND, die(), Process(0.5), SPREAD)
    assert isinstance(told, str)
    assert told.startswith("MF114")
    (row,) = restored_bands(Photographs(TAKEN, {}), "W", {"W": told}, Process(0.5), SPREAD)
    assert (row.name, row.value) == ("band_restored_psnr", None)
    assert told in row.method


@pytest.mark.slow
def test_edges_are_those_of_full_draws():
    process, seen, count = Process(0.5, 0.1), photographed(), 200
    found = restored_expansion(TAKEN, AROUND, die(), process, SPREAD)
    assert isinstance(found, Expansion)
    draw = np.random.default_rng(2)
    # Draws spread evenly: so few drawn each by itself have edges that lie a quarter off by chance.
    x, y = ndtri([(draw.permutation(count) + 0.5) / count for _ in range(2)])
    known = seen.psnr(DRAWN)
    drawn = [seen.psnr(Process(max(0.0, 0.5 + 0.3 * v), 0.1 + 0.2 * u)) - known for u, v in zip(x, y, strict=True)]
    edges, truth = found.edges(SPREAD.deviations(process)), np.quantile(drawn, [0.025, 0.975])
    assert np.array(edges) - found.nominal == pytest.approx(truth - found.nominal, rel=0.1)
