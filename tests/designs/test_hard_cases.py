"""Hard cases of design: extreme counts, grids, pitches and cameras, bad pictures, and runs that are cut off.

Each works, or is refused before any work with what is wrong, where, and what to do.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch
from asked_displays import asked_display
from estimates import surrogate
from once import leaves

from maskfab.base.errors import InputError, MaskfabError, OpeningError, catalogue
from maskfab.base.model import Opening, Panel, Tiling, refined
from maskfab.camera.protocol import evaluate
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import MOST_DOTS, laid_panel, lattice, lay, pupil_autocorrelation, pupil_transfer
from maskfab.designs.descent.losses import ExpectedError, TopResidual, expected_error, top_residual
from maskfab.designs.descent.objective import AreaPenalty, Objective, TiledStop, Weighted, invertibility_of, tiled_stop
from maskfab.designs.descent.schedule import Descent, Outcome, descend
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.model.limits import bounds
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.families import FAMILIES, Candidate, bars, discs, orbits
from maskfab.designs.search.annealing import ExpectedPsnr, State, anneal, scan
from maskfab.job.camera import Camera, Stop
from maskfab.mask.opening_masks import diamond_discs

SMALL = Camera(1000.0, Stop("circle", 400.0), (610.0, 530.0, 470.0), 2.0, 256.0)
CELLS = np.random.default_rng(3).integers(8, size=(8, 8)).astype(np.int8)


def corner(dots: int, height: int, width: int) -> np.ndarray:
    unit = np.zeros((dots, dots), dtype=np.bool_)
    unit[:height, :width] = True
    return unit


def small_stop(camera: Camera = SMALL, precision: str = "float64") -> TiledStop:
    return tiled_stop(7, 8000, CELLS, camera, precision=precision)  # type: ignore[arg-type]


def refused(code: str, work: Callable[[], object]) -> str:
    """The error's words; it has a place and a cure."""
    with pytest.raises(InputError) as caught:
        work()
    assert caught.value.code == code, caught.value
    assert code in catalogue()
    assert caught.value.what
    assert caught.value.where
    assert caught.value.cure
    return str(caught.value)


@pytest.fixture(scope="module")
def scenes() -> tuple[Photograph, ...]:
    return (leaves(1),)


@pytest.fixture(scope="module")
def today(scenes: tuple[Photograph, ...]) -> Surrogate:
    return surrogate(scenes)


@pytest.fixture(scope="module")
def layout_error(today: Surrogate) -> ExpectedError:
    return expected_error(today, np.random.default_rng(0).integers(8, size=(24, 24)).astype(np.int8))


# Other pitches and dots


def test_cells_of_168_um_are_judged_as_they_ever_were(scenes: tuple[Photograph, ...], today: Surrogate) -> None:
    stated = surrogate(scenes, 21, dot_nm=8000)
    assert stated.lattice == today.lattice
    for name in ("lags", "clear", "folded", "weight", "signal", "inverse_prior", "near", "low", "low_truth"):
        np.testing.assert_array_equal(getattr(stated, name), getattr(today, name))
    bar = corner(21, 6, 17)
    bar[5, 15:] = False
    known = [float.fromhex(f"0x1.{v}p+4") for v in ("67b4d13e0a204", "9cb2e4885eb46", "d55cb93118ea0")]
    assert today(bar) == stated(bar) == pytest.approx(known, rel=1e-9)
    alike = [float.fromhex(f"0x1.{v}p+4") for v in ("0c70e3575c8c5", "0e56379cfca17", "0e9d30b0891f1")]
    assert stated(bar, periodic=True) == pytest.approx(alike, rel=1e-9)
    # Light of the stop is a count of dots, exact on every machine.
    old, new = lay("x", bar), lay("x", bar, dot_nm=8000)
    np.testing.assert_array_equal(old.pupil, new.pupil)
    assert old.transmission == new.transmission == float.fromhex("0x1.cf3dd7a5d8b0ep-3")
    np.testing.assert_array_equal(
        pupil_transfer(old.pupil, old.lattice, (16, 24)), pupil_transfer(new.pupil, new.lattice, (16, 24))
    )


@pytest.mark.parametrize(
    ("dots", "dot_nm", "cells"),
    [(21, 8000, 24), (21, 4000, 48), (16, 8000, 32), (1, 168000, 24), (20, 25000, 8), (15, 2000, 134), (2, 2500000, 2)],
)
def test_the_fewest_even_number_of_cells_covers_the_stop(dots: int, dot_nm: int, cells: int) -> None:
    if dot_nm > 1_175_000:
        assert "1175" in refused("MF104", lambda: lattice(dots, dot_nm))
        return
    found = lattice(dots, dot_nm)
    assert found.cells == cells
    assert found.side * dot_nm >= 4_000_000 > (cells - 2) * dots * dot_nm


def test_the_stop_is_the_same_behind_every_dot() -> None:
    for dots, dot_nm in ((21, 8000), (21, 4000), (16, 8000), (20, 25000), (23, 7304)):
        made = lattice(dots, dot_nm)
        inside = made.stop
        assert inside.sum() * made.dot_um**2 == pytest.approx(math.pi * 2000**2, rel=2e-3)
        np.testing.assert_array_equal(inside, inside[::-1, ::-1])


def test_a_grid_that_is_too_fine_is_refused_with_the_limit(scenes: tuple[Photograph, ...]) -> None:
    for work in (lambda: surrogate(scenes, 21, dot_nm=1000), lambda: lay("x", corner(21, 2, 2), dot_nm=1000)):
        assert str(MOST_DOTS) in refused("MF115", work)
    refused("MF104", lambda: lattice(0, 8000))
    refused("MF104", lambda: lattice(21, 0))


def test_splitting_dots_changes_next_to_nothing(scenes: tuple[Photograph, ...]) -> None:
    """The same opening drawn on dots half as wide; the stop's rim and the draw of long lags differ."""
    bar = corner(12, 4, 7)
    coarse, fine = surrogate(scenes, 12, dot_nm=8000), surrogate(scenes, 24, dot_nm=4000)
    assert coarse.lattice.cells == fine.lattice.cells == 42
    np.testing.assert_allclose(coarse(bar), fine(refined(bar, 2)), atol=0.08)


def test_at_300_dpi_the_mean_of_layouts_is_near_the_surrogate(scenes: tuple[Photograph, ...]) -> None:
    """Judged cell by cell, by other code: a fine pitch spreads halo over twice as many dots of lag."""
    known = surrogate(scenes, 7, dot_nm=12000)
    bar = corner(7, 3, 4)
    assert known.lattice.cells == 48
    assert len(known.near) == 2 * 14 + 1
    rng = np.random.default_rng(1)
    unit = torch.from_numpy(bar.astype(np.float64))
    found = []
    for _ in range(4):
        turned = rng.integers(8, size=(48, 48)).astype(np.int8)
        found.append(-float(expected_error(known, turned, precision="float64")(unit)))
    assert np.mean(found) == pytest.approx(np.mean(known(bar)), abs=0.25)


@pytest.mark.parametrize(("dots", "dot_nm"), [(10, 3000), (10, 50000)])
def test_compact_openings_win_at_pitches_of_30_and_500_um(
    scenes: tuple[Photograph, ...], dots: int, dot_nm: int
) -> None:
    known = surrogate(scenes, dots, dot_nm=dot_nm)
    slit = np.zeros((dots, dots), dtype=np.bool_)
    slit[:, :2] = True
    compact, random, alike = known(corner(dots, 4, 5)), known(slit), known(slit, periodic=True)
    assert all(a > b > c for a, b, c in zip(compact, random, alike, strict=True))
    found = scan(islice(bars(dots, 20), 20), ExpectedPsnr(known), Constraints(20, dots=dots, dot_nm=dot_nm))
    assert found.best.value >= np.mean(random)


def test_the_transfer_behind_84_um_cells_is_the_lag_tables(scenes: tuple[Photograph, ...]) -> None:
    design = lay("x", corner(7, 3, 4), dot_nm=12000)
    table = pupil_autocorrelation(design.pupil)
    side = len(design.pupil)
    table /= table[side - 1, side - 1]
    found = pupil_transfer(design.pupil, design.lattice, (8, 12))
    # ν = 1/8 along y: the lag of green is 530 nm x 10 mm / (2 um x 12 um) / 8 dots; sampling folds back the others.
    expected = 0.0
    for k in range(-3, 4):
        for j in range(-3, 4):
            lag_y, lag_x = ((f) * 530e-3 * 10_000 / (2 * 12) for f in (1 / 8 + k, j))
            low_y, low_x = math.floor(lag_y), math.floor(lag_x)
            for y, x in ((low_y, low_x), (low_y + 1, low_x), (low_y, low_x + 1), (low_y + 1, low_x + 1)):
                if abs(y) < side and abs(x) < side:
                    share = (1 - abs(lag_y - y)) * (1 - abs(lag_x - x)) * np.sinc(1 / 8 + k) * np.sinc(j)
                    expected += share * table[y + side - 1, x + side - 1]
    assert found[1, 1, 0] == pytest.approx(expected, rel=1e-5)


def panel_of(unit: np.ndarray, dot_nm: int, cells: int, *, gutter_nm: int = 0, tiling: Tiling = Tiling.PAPER4) -> Panel:
    turned = np.random.default_rng(2).integers(8, size=(cells, cells)).astype(np.int8)
    return Panel(Opening("u", unit, dot_nm), dot_nm, gutter_nm, turned, tiling, 2)


@pytest.mark.parametrize(("dots", "dot_nm", "cells"), [(15, 2000, 134), (21, 4000, 48), (20, 25000, 8)])
def test_a_panel_of_any_pitch_is_laid(dots: int, dot_nm: int, cells: int) -> None:
    unit = corner(dots, dots // 2, dots // 3)
    panel = panel_of(unit, dot_nm, cells + 4)
    found = laid_panel("x", panel)
    middle = panel.orientations[2:-2, 2:-2]
    np.testing.assert_array_equal(found.pupil, lay("y", unit, middle, dot_nm=dot_nm).pupil)
    assert found.transmission == pytest.approx(unit.mean(), rel=0.03)
    random = laid_panel("x", replace(panel, tiling=Tiling.RANDOM))
    np.testing.assert_array_equal(random.pupil, lay("y", unit, dot_nm=dot_nm).pupil)
    assert f"{cells} x {cells}" in refused("MF122", lambda: laid_panel("x", panel_of(unit, dot_nm, cells - 1)))


def test_gutters_are_closed_dots_halved_where_they_must_be() -> None:
    unit = corner(10, 4, 6)
    even = laid_panel("x", panel_of(unit, 8000, 60, gutter_nm=16000))
    assert (even.lattice.dot_um, len(even.pupil)) == (8.0, 12 * 42)
    assert even.transmission == pytest.approx(24 / 144, rel=0.02)
    odd = laid_panel("x", panel_of(unit, 8000, 60, gutter_nm=8000))
    assert (odd.lattice.dot_um, len(odd.pupil)) == (4.0, 22 * 46)
    assert odd.transmission == pytest.approx(24 / 121, rel=0.02)
    told = refused("MF115", lambda: laid_panel("x", panel_of(unit, 4030, 99, gutter_nm=8000)))
    assert "gutter" in told
    assert str(MOST_DOTS) in told
    refused("MF122", lambda: laid_panel("x", panel_of(unit, 8000, 60, tiling=Tiling.HEXAGONAL)))


def test_panels_of_two_pitches_are_compared_on_photographs() -> None:
    """The same opening made half as large repeats twice as often: it cannot be better, and full light is the same."""
    shown = (leaves(1, 832, 832),)
    whole = np.ones((6, 6), dtype=np.bool_)
    designs = [
        lay("open 168", whole, dot_nm=28000),
        lay("open 84", whole, dot_nm=14000),
        lay("bar 168", corner(6, 3, 3), dot_nm=28000),
        lay("bar 84", corner(6, 3, 3), dot_nm=14000),
    ]
    found = {score.design: score.psnr for score in evaluate(designs, shown, shown, (32,)).scores}
    assert found["open 168"] == pytest.approx(found["open 84"], abs=0.05)
    assert found["bar 84"] < found["bar 168"] < found["open 168"]


def test_a_design_without_light_is_refused_before_any_photograph() -> None:
    dark = replace(lay("dark", corner(3, 1, 1)), pupil=np.zeros((72, 72)))
    never_seen = [Photograph("nothing", 1, np.zeros((3, 1, 1), dtype=np.float32))]
    assert "dark" in refused("MF104", lambda: evaluate([dark], never_seen, never_seen, (24,)))


# Grids of 1, 2, 64 and prime numbers of dots; extreme counts


@pytest.mark.parametrize("dots", [1, 2, 23, 31, 64])
def test_every_number_of_dots_is_judged(scenes: tuple[Photograph, ...], dots: int) -> None:
    known = surrogate(scenes, dots)
    assert known.lattice.cells == 24
    assert len(known.near) == 2 * dots + 1
    full = known(np.ones((dots, dots), dtype=np.bool_))
    one = known(corner(dots, 1, 1))
    assert all(math.isfinite(v) for v in (*full, *one))
    if dots == 1:
        assert one == full
        return
    most = np.ones((dots, dots), dtype=np.bool_)
    most[-1, -1] = False
    assert all(a >= b > c for a, b, c in zip(full, known(most), one, strict=True))


def test_all_clear_is_the_open_stop_however_it_is_divided(scenes: tuple[Photograph, ...]) -> None:
    values = [surrogate(scenes, dots)(np.ones((dots, dots), dtype=np.bool_)) for dots in (2, 7, 23)]
    np.testing.assert_allclose(values[1:], [values[0]] * 2, atol=0.2)


@pytest.mark.parametrize("dots", [1, 2, 5, 13])
@pytest.mark.parametrize("family", ["bars", "discs", "l_shapes", "crosses"])
def test_families_have_the_exact_count_or_nothing(dots: int, family: str) -> None:
    for clear in sorted({1, dots * dots - 1, dots * dots} - {0}):
        for each in islice(FAMILIES[family](dots, clear), 20):
            assert each.unit.shape == (dots, dots)
            assert int(each.unit.sum()) == clear
    refused("MF203", lambda: list(FAMILIES[family](dots, 0)))
    refused("MF204", lambda: list(FAMILIES[family](dots, dots * dots + 1)))


def test_a_prime_count_has_bars_only_with_a_trimmed_column() -> None:
    assert all(int(each.unit.sum()) == 97 for each in bars(23, 97))
    refused("MF105", lambda: list(discs(5, 4, free=np.ones((4, 4), dtype=np.bool_))))


@pytest.mark.parametrize("dots", [1, 2, 23, 64])
def test_orbits_share_out_the_dots(dots: int) -> None:
    for symmetry in (None, "mirror", "rot180", "d4"):
        members = np.concatenate(orbits(dots, symmetry))  # type: ignore[arg-type]
        assert np.array_equal(np.sort(members), np.arange(dots * dots))


@pytest.mark.parametrize(("dots", "clear"), [(1, 1), (2, 1), (2, 3), (2, 4), (5, 24), (5, 25)])
def test_annealing_of_nearly_nothing_to_choose_ends(dots: int, clear: int) -> None:
    unit = np.zeros(dots * dots, dtype=np.bool_)
    unit[:clear] = True
    goal = np.arange(dots * dots).reshape(dots, dots)
    rules = Constraints(clear, dots=dots)
    found = anneal(unit.reshape(dots, dots), lambda u: float(goal[u].sum()), rules, evaluations=300)
    assert int(found.unit.sum()) == clear
    assert found.value == np.sort(goal.ravel())[-clear:].sum()
    assert found.complete or found.stuck
    assert found.stuck == (clear == dots * dots)


@pytest.mark.parametrize(
    ("dots", "clear"), [(1, 1), (2, 1), (2, 3), (23, 1), (23, 528), (31, 960), (64, 1), (64, 4095)]
)
def test_descents_meet_extreme_counts_on_extreme_grids(dots: int, clear: int) -> None:
    here = tiled_stop(dots, 168_000 // dots, CELLS, replace(SMALL, focal_um=10_000.0, stop=Stop("circle", 1000.0)))
    how = Descent(dots=dots, clear_dots=clear, iterations=3, judged_every=1)
    found = descend(invertibility_of(here), AreaPenalty(clear / dots**2, 20.0), how)
    assert int(found.unit.sum()) == clear
    assert -1 <= found.loss <= 0
    assert found.outcome is Outcome.FINISHED


def test_no_clear_dots_are_refused_everywhere(today: Surrogate) -> None:
    nothing = np.zeros((21, 21), dtype=np.bool_)
    for code, work in (
        ("MF203", lambda: today(nothing)),
        ("MF203", lambda: lay("x", nothing)),
        ("MF203", lambda: scan([Candidate("x", nothing)], today_mean(today), Constraints(0))),
        ("MF105", lambda: today(corner(20, 2, 2))),
        ("MF104", lambda: today(corner(21, 2, 2), levels=(33,))),
    ):
        refused(code, work)


def test_a_count_of_clear_dots_is_refused_in_the_same_words_everywhere(today: Surrogate) -> None:
    doors = lambda n: list(bars(21, n)), lambda n: bounds(today, n)
    drawn = lambda n: today(np.zeros((21, 21), dtype=np.bool_)), lambda n: lay("x", np.zeros((21, 21), dtype=np.bool_))
    ruled = lambda n: Constraints(n, dots=21).require_possible(), lambda n: diamond_discs(21, n)
    assert {refusal(door, 0) for door in (*doors, *drawn, *ruled)} == {
        ("MF203", "0 of 441 dots are clear; at least 1 must be")
    }
    assert {refusal(door, 442) for door in doors} == {("MF204", "442 of 441 dots cannot be clear")}


def refusal(door: Callable[[int], object], count: int) -> tuple[str, str]:
    with pytest.raises(OpeningError) as caught:
        door(count)
    return caught.value.code, caught.value.what


def today_mean(known: Surrogate) -> ExpectedPsnr:
    return ExpectedPsnr(known)


# Saddles, plateaus, numbers that are none


@dataclass(frozen=True, eq=False)
class Looks(Objective):
    """Sum of the squared transmissions, or something worse."""

    correlation = None
    of_none: bool = False
    spoilt_when_binary: bool = False

    def of_table(self, table: torch.Tensor, unit: torch.Tensor) -> torch.Tensor:
        if self.spoilt_when_binary and bool(((unit == 0) | (unit == 1)).all()):
            return unit.sum() * math.nan
        return (unit * 0).sum() if self.of_none else (unit**2).sum()


@pytest.mark.parametrize("logit", [-4.0, 4.0])
def test_even_starts_are_saddles_and_are_said(layout_error: ExpectedError, logit: float) -> None:
    how = Descent(dots=21, clear_dots=100, iterations=3, start_logit=logit, start_noise=0.0, settled=1.0)
    found = descend(Weighted(((1.0, layout_error),)), None, how)
    assert int(found.unit.sum()) == 100
    (note,) = found.notes
    assert "saddle" in note
    # With noise the same start is none.
    assert not descend(layout_error, None, replace(how, start_noise=0.5)).notes


def test_a_closed_start_that_the_gain_makes_dark_keeps_what_it_had(layout_error: ExpectedError) -> None:
    how = Descent(dots=21, clear_dots=100, iterations=3, start_logit=-5.0, start_noise=0.1, final_gain=20.0)
    found = descend(layout_error, None, how)
    assert found.outcome is Outcome.NOT_FINITE
    assert math.isfinite(found.loss)
    assert int(found.unit.sum()) == 100
    assert "not finite" in found.notes[-1]


@pytest.mark.parametrize("logit", [-1000.0, -100.0, 1000.0])
def test_starts_that_are_closed_or_clear_for_good_are_the_users_fault(
    layout_error: ExpectedError, logit: float
) -> None:
    how = Descent(dots=21, clear_dots=100, iterations=2, start_logit=logit, start_noise=0.0)
    for goal in (layout_error, invertibility_of(layout_error.stop), invertibility_of(layout_error.stop, own_sum=True)):
        assert "start" in refused("MF104", lambda goal=goal: descend(goal, None, how))  # type: ignore[misc]


def test_an_objective_without_slope_is_refused() -> None:
    told = refused("MF104", lambda: descend(Looks(of_none=True), None, Descent(dots=6, clear_dots=9, iterations=3)))
    assert "objectives" in told


def test_a_judgement_that_is_no_number_is_never_a_result() -> None:
    how = Descent(dots=6, clear_dots=9, iterations=20)
    with pytest.raises(MaskfabError) as caught:
        descend(Looks(spoilt_when_binary=True), None, how)
    assert caught.value.code == "MF901"
    with pytest.raises(MaskfabError) as caught:
        descend(Looks(spoilt_when_binary=True), None, replace(how, judged_every=0))
    assert caught.value.code == "MF901"


# Cameras


def test_thirty_one_equal_wavelengths_are_one() -> None:
    unit = torch.from_numpy(np.random.default_rng(5).random((7, 7)))
    one, many = (small_stop(replace(SMALL, wavelengths_nm=(530.0,) * k)) for k in (1, 31))
    assert float(invertibility_of(many)(unit)) == pytest.approx(float(invertibility_of(one)(unit)), rel=1e-12)
    spread = small_stop(replace(SMALL, wavelengths_nm=tuple(np.linspace(400, 700, 31).tolist())))
    lines = [small_stop(replace(SMALL, wavelengths_nm=(nm,))) for nm in spread.camera.wavelengths_nm]
    alone = np.mean([float(invertibility_of(line)(unit)) for line in lines])
    assert float(invertibility_of(spread)(unit)) == pytest.approx(alone, rel=1e-9)
    refused("MF105", lambda: top_residual(one, [noise()]))


def noise(side: int = 96) -> Photograph:
    return Photograph("noise", 1, np.random.default_rng(8).random((3, side, side)).astype(np.float32))


def test_a_stop_within_one_cell_sees_some_dots_only() -> None:
    within = tiled_stop(7, 8000, CELLS[:1, :1], replace(SMALL, stop=Stop("circle", 30.0)), precision="float64")
    unit = torch.from_numpy(np.random.default_rng(6).random((7, 7))).requires_grad_()
    (slope,) = torch.autograd.grad(replace(invertibility_of(within), worst_fraction=1.0)(unit), unit)
    assert bool(torch.isfinite(slope).all())
    seen = within.correlation.index.unique()
    assert set(slope.flatten().nonzero().flatten().tolist()) == set(seen[seen < 49].tolist())
    assert len(seen) - 1 == within.bare < 49
    how = Descent(dots=7, clear_dots=10, iterations=5)
    assert int(descend(invertibility_of(within), None, how).unit.sum()) == 10


def test_stops_and_layouts_that_cannot_be_are_refused() -> None:
    for diameter, cells, code in (
        (5.0, CELLS[:2, :2], "MF104"),
        (9.0, CELLS[:1, :1], "MF104"),
    ):
        camera = replace(SMALL, stop=Stop("circle", diameter))
        dots = 7 if diameter > 9 else 2
        refused(code, lambda cells=cells, camera=camera, dots=dots: tiled_stop(dots, 8000, cells, camera))  # type: ignore[misc]


def residual(scenes: tuple[Photograph, ...] | None = None, **change: float) -> TopResidual:
    options = {"side": 32, "margin": 16, "crops": 3, "batch": 2, **change}
    return top_residual(small_stop(precision="float32"), scenes or (noise(),), **options)  # type: ignore[arg-type]


# Pictures


def test_constant_pictures_are_refused_by_name(scenes: tuple[Photograph, ...]) -> None:
    for value in (0.0, 0.3, 1.0):
        grey = Photograph("fog", 7, np.full((3, 1024, 1536), value, dtype=np.float32))
        for folder in ((grey,), (*scenes, grey)):
            assert "fog" in refused("MF121", lambda folder=folder: surrogate(folder))  # type: ignore[misc]
    refused("MF121", lambda: surrogate(()))
    dull = Photograph("dull", 1, np.full((3, 96, 96), 0.5, dtype=np.float32))
    refused("MF121", lambda: residual((dull,)))


def test_contrast_alone_does_not_matter_to_the_order_of_designs(scenes: tuple[Photograph, ...]) -> None:
    faint = Photograph("faint", 1, (0.4 + 0.002 * (scenes[0].values - 0.4)).astype(np.float32))
    known = surrogate((faint,), 9)
    assert np.isfinite(known.signal).all()
    assert min(known(np.ones((9, 9), dtype=np.bool_))) > min(known(corner(9, 3, 6)))


# Rules that contradict each other


@pytest.mark.parametrize(
    ("count", "rules", "blamed"),
    [
        (10, {"symmetry": "d4", "dots": 2}, ("clear_dots",)),
        (31, {"symmetry": "d4", "dots": 12}, ("clear_dots", "symmetry")),
        (120, {"rim_dots": 6}, ("clear_dots", "rim_dots")),
        (5, {"min_feature_dots": 2}, ("clear_dots", "min_feature_dots")),
        (440, {"ports": 2}, ("ports", "clear_dots")),
        (100, {"emitters": asked_display(required=0.4)}, ("emitters", "clear_dots")),
        (1, {"emitters": asked_display(required=0.33)}, ("emitters",)),
        (9, {"keep_out": np.ones((21, 21), dtype=np.bool_)}, ("clear_dots", "keep_out")),
        (2, {"dots": 2, "kissing": "cell", "symmetry": "rot180", "rim_dots": 1}, ("clear_dots", "rim_dots")),
    ],
    ids=str,
)
def test_the_rules_to_blame_are_named_and_no_more(
    count: int, rules: dict[str, object], blamed: tuple[str, ...]
) -> None:
    asked = Constraints(count, **{"dots": 21, **rules})  # type: ignore[arg-type]
    found = asked.conflict()
    assert found is not None
    assert set(found.rules) == set(blamed)
    assert found.statement
    with pytest.raises(InputError) as caught:
        scan(bars(asked.dots, min(count, asked.dots**2)), lambda unit: 0.0, asked)
    assert caught.value.code in {"MF123", "MF204"}
    assert all(rule in str(caught.value) for rule in blamed)
    for rule in set(blamed) - {"clear_dots"}:
        freed = asked.without(rule).conflict()
        assert freed is None or set(freed.rules) != set(blamed)


def test_emitters_that_fit_no_pixel_come_with_a_certificate() -> None:
    found = Constraints(1, emitters=asked_display(required=0.33)).conflict()
    assert found is not None
    assert found.certificate is not None
    assert found.certificate.statement in found.statement


def test_rules_nobody_can_prove_impossible_say_what_broke() -> None:
    """Two wires a side and clear corners: not a conflict by any proof, but no bar keeps it."""
    rules = Constraints(100, min_space_dots=20)
    told = refused("MF123", lambda: scan(bars(21, 100), lambda unit: 0.0, rules))
    assert "min_space_dots" in told


@pytest.mark.parametrize("value", [math.nan, -1.0, 1.5, math.inf])
def test_numbers_that_are_none_are_no_rules(value: float) -> None:
    refused("MF104", lambda: Constraints(9, centroid_px=value))


# Cut off and taken up again


def test_an_annealing_in_portions_is_one_annealing(today: Surrogate) -> None:
    rules = Constraints(100, kissing="neighbours", min_feature_dots=2)
    start = next(each.unit for each in bars(21, 100) if rules.allows(each.unit))
    goal = ExpectedPsnr(today)
    whole = anneal(start, goal, rules, evaluations=90, seed=4)
    now: np.ndarray | State = start
    for until in (1, 2, 31, 64, 65, 90):
        part = anneal(now, goal, rules, evaluations=90, seed=4 if until == 1 else 99, until=until)
        assert part.complete is (until == 90)
        now = State.of(json.loads(json.dumps(part.state.plain())))
    assert np.array_equal(part.unit, whole.unit)
    assert part.value == whole.value
    assert part.state.plain() == whole.state.plain()
    again = anneal(now, goal, rules, evaluations=90)
    assert again.complete
    assert again.state.evaluations == 90


@pytest.mark.parametrize(
    "change",
    [{"unit": None}, {"unit": [1, 0]}, {"value": math.nan}, {"evaluations": -1}, {"generator": {}}, {"generator": 3}],
    ids=str,
)
def test_a_damaged_annealing_is_not_taken_up(change: dict[str, object]) -> None:
    done = anneal(corner(6, 3, 3), lambda unit: float(unit[0].sum()), Constraints(9, dots=6), evaluations=5)
    plain = {**done.state.plain(), **change}
    refused("MF105", lambda: State.of(plain))


def test_a_descent_in_portions_is_one_descent(tmp_path: Path) -> None:
    """With photographs in batches, several starts and momentum: everything that a step depends on is kept."""
    goal = Weighted(((1.0, residual()), (0.5, invertibility_of(small_stop(precision="float32")))))
    how = Descent(dots=7, clear_dots=10, iterations=9, starts=2, judged_every=2, seed=5)
    penalty = AreaPenalty(10 / 49, 20.0)
    whole = descend(goal, penalty, how)
    path = tmp_path / "state.npz"
    for portion in (1, 1, 5, 3, 7, 100):
        part = descend(goal, penalty, how, checkpoint=path, stop_after=portion)
    assert part.outcome is whole.outcome is Outcome.FINISHED
    assert torch.equal(part.unit, whole.unit)
    assert torch.equal(part.relaxed, whole.relaxed)
    assert (part.loss, part.iterations, part.notes) == (whole.loss, whole.iterations, whole.notes)
