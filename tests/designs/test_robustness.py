"""Panels that are not quite the one designed: their autocorrelation is exact, and means over them are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from estimates import surrogate
from once import leaves
from scipy import ndimage, signal

from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS
from maskfab.designs.design import check_possible
from maskfab.designs.model import panel_error
from maskfab.designs.model.appraisal import EXACT, Spread, biased_table, robustness
from maskfab.designs.model.panel_error import PupilError, pupil_error
from maskfab.job.read import read

JOB = """
[design]
name = "small"
dots = 11
pitch = "88 um"
clear_dots = 25

[camera]
focal = "10 mm"
stop = { shape = "circle", diameter = "0.512 mm" }
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"

[process.spread]
"""


def kinds_of(error: PupilError, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(ORIENTATIONS, size=(error.cells, error.cells)).astype(np.int8)


def unit() -> np.ndarray:
    mask = np.zeros((7, 7), dtype=np.bool_)
    mask[1:4, 0:4] = True
    mask[3, 0] = False
    return mask


@pytest.mark.parametrize("sign", [1, -1])
def test_a_bias_moves_every_edge_and_the_autocorrelation_is_that_of_finer_dots(coarse: PupilError, sign: int) -> None:
    parts, dot_um = 4, coarse.lattice.dot_um
    side = coarse.inside.shape[0]
    picture = ndimage.binary_opening(np.random.default_rng(3).random((side, side)) < 0.7, np.ones((2, 2)))
    fine = np.kron(picture, np.ones((parts, parts), dtype=np.bool_))
    grown = ndimage.binary_dilation if sign > 0 else ndimage.binary_erosion
    moved = grown(fine, np.ones((3, 3)), border_value=int(sign < 0)) & np.kron(
        coarse.inside, np.ones((parts, parts), bool)
    )
    found = biased_table(coarse, picture, sign * 2 / parts * dot_um)
    reach = min(5, coarse.reach)
    start = (moved.shape[0] - 1) % parts
    whole = signal.fftconvolve(moved.astype(float), moved[::-1, ::-1].astype(float))[start::parts, start::parts]
    middle = (moved.shape[0] - 1 - start) // parts
    seen = whole[middle : middle + reach + 1, middle - reach : middle + reach + 1] / parts**2
    ours = found[: reach + 1, coarse.reach - reach : coarse.reach + reach + 1]
    np.testing.assert_allclose(ours, seen, rtol=1e-5)


def test_a_panel_without_bias_is_itself_and_a_wider_one_restores_better(coarse: PupilError) -> None:
    found = robustness(
        unit()[None], kinds_of(coarse, 1), coarse, spread=Spread(2.0), seed=0, periodic=False, mapped=False
    )
    laid = coarse.laid(unit(), kinds_of(coarse, 1))
    assert found.psnr == pytest.approx(coarse.psnr(laid), abs=1e-9)
    assert found.bias is not None
    (narrow,), (wide,) = found.bias.psnr
    assert narrow < found.psnr[0] < wide
    assert found.bias.loss[0] == pytest.approx(found.psnr[0] - (narrow + wide) / 2)
    assert abs(found.bias.loss[0]) < wide - found.psnr[0]
    assert found.centre is None
    assert found.off_centre == {}


def test_a_map_is_compared_with_the_mean_of_random_tilings_in_whose_spread_they_lie(coarse: PupilError) -> None:
    found = robustness(
        unit()[None], kinds_of(coarse, 1), coarse, spread=Spread(0, 48.0), seed=0, periodic=False, mapped=True
    )
    pitch = coarse.dots * coarse.lattice.dot_um
    assert list(found.off_centre) == [0, pitch, 2 * pitch]
    assert found.tiling is not None
    assert 0 < found.tiling[0] < 1
    # These kinds are drawn, not designed: nothing is gained but what chance gives.
    assert all(abs(gain[0]) < 4 * found.tiling[0] for gain in found.off_centre.values())
    assert found.centre is not None
    assert len(found.centre.psnr) == 4
    assert found.centre.deviation_um == 48.0


def test_cells_that_are_all_alike_have_no_spread_of_tilings(coarse: PupilError) -> None:
    alike = np.zeros((coarse.cells, coarse.cells), dtype=np.int8)
    found = robustness(
        unit()[None],
        alike,
        coarse,
        spread=Spread(0, coarse.dots * coarse.lattice.dot_um),
        seed=0,
        periodic=True,
        mapped=False,
    )
    assert found.tiling is None
    assert found.centre is not None
    # A whole cell farther, a periodic panel is the same.
    assert found.centre.loss[0] == pytest.approx(0, abs=1e-6)
    assert robustness(unit()[None], alike, coarse, spread=EXACT, seed=0, periodic=True, mapped=False).bias is None


@pytest.mark.parametrize(
    ("stated", "problem"),
    [
        ('bias = "8 um"', r"MF127 a bias of 8 um.*dots of 8 um.*process\.spread\.bias.*less than 8 um"),
        ('centre = "0.3 mm"', r"MF104.*300 um off.*512 um.*process\.spread\.centre.*less than 256 um"),
    ],
)
def test_spreads_larger_than_the_feature_are_refused(tmp_path: Path, stated: str, problem: str) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB + stated)
    with pytest.raises(JobError, match=problem):
        check_possible(read(path), where=str(path))


def test_layouts_differ_by_fewer_lags_as_by_all(monkeypatch: pytest.MonkeyPatch) -> None:
    estimate, shape = surrogate([leaves(1)], 7), unit()
    every = pupil_error(estimate, (32,))
    monkeypatch.setattr(panel_error, "_MOST_FREQUENCIES", 60)
    fewer = pupil_error(estimate, (32,))
    assert fewer.of_steps.stride == 2
    kinds = np.random.default_rng(0).integers(8, size=(every.cells, every.cells)).astype(np.int8)
    own, ours = (
        robustness(shape[None], kinds, error, spread=EXACT, seed=0, periodic=False, mapped=True)
        for error in (every, fewer)
    )
    assert own.psnr == pytest.approx(ours.psnr, abs=1e-6)
    assert own.tiling is not None
    assert ours.tiling is not None
    assert ours.tiling == pytest.approx(own.tiling, abs=0.01)
    for step, gain in own.off_centre.items():
        assert ours.off_centre[step] == pytest.approx(gain, abs=0.02)
