"""Restored photographs behind the dies of a plate: predicted for all that can be judged, taken for some."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from once import leaves

from maskfab.camera.laid_panel import laid_panel
from maskfab.camera.photographs import Photograph
from maskfab.camera.protocol import LEVELS, evaluate
from maskfab.job import load_job
from maskfab.measurement.restored import CROP, RESIDUAL_DB, SHOWN_LEVELS, photographer
from maskfab.model import Die, Tiling
from maskfab.optimiser.model import expected_psnr
from maskfab.optimiser.model.expected_psnr import surrogate

LAYOUTS = Path(__file__).parents[2] / "layouts"


def scenes() -> tuple[Photograph, ...]:
    return (leaves(1),)


def _values(take, die: Die) -> list[float]:
    return [row.value for row in take(die, photographs=False).quantities]


@pytest.fixture(scope="module")
def dies() -> dict[str, Die]:
    return {die.name: die for die in load_job(LAYOUTS / "toled_against_ours.toml").plate().dies}


@pytest.fixture(scope="module")
def take(dies):
    toled, small = dies["TOLED"], dies["TOLED"].panel.orientations[:23, :23]
    others = [
        replace(toled, name="RANDOM", panel=replace(toled.panel, tiling=Tiling.RANDOM, seed=1)),
        replace(toled, name="FOURS", panel=replace(toled.panel, tiling=Tiling.PAPER4, seed=1)),
        replace(toled, name="HEXAGONAL", panel=replace(toled.panel, tiling=Tiling.HEXAGONAL, seed=1)),
        replace(toled, name="SMALL", panel=replace(toled.panel, orientations=small, tiling=Tiling.RANDOM, seed=1)),
        replace(toled, name="GUTTER", slot_nm=9_200_000, panel=replace(toled.panel, gutter_nm=16000)),
    ]
    return photographer([*dies.values(), *others], scenes())


def test_a_die_is_judged_if_it_covers_the_stop_in_square_cells(take):
    assert set(take.laid) == {"TOLED", "OURS", "RANDOM", "FOURS", "GUTTER"}


def test_numbers_are_the_surrogates_of_the_repeated_and_of_the_turned_opening(take, dies):
    unit, toled = dies["TOLED"].panel.opening.mask, dies["TOLED"]
    estimate = surrogate(scenes())
    turned = replace(toled, name="RANDOM", panel=replace(toled.panel, tiling=Tiling.RANDOM, seed=1))
    assert _values(take, toled) == list(estimate(unit, periodic=True))
    assert _values(take, turned) == list(estimate(unit))
    gutter = replace(toled, name="GUTTER", slot_nm=9_200_000, panel=replace(toled.panel, gutter_nm=16000))
    wide = surrogate(scenes(), 23, dot_nm=8000)(np.pad(unit, 1), periodic=True)
    assert _values(take, gutter) == list(wide)


def test_scenes_are_looked_at_once_for_cells_of_every_size(dies, monkeypatch):
    seen, spectrum = [], expected_psnr._spectrum

    def once(given):
        seen.append(len(given))
        return spectrum(given)

    monkeypatch.setattr(expected_psnr, "_spectrum", once)
    toled = dies["TOLED"]
    wide = replace(toled, name="GUTTER", slot_nm=9_200_000, panel=replace(toled.panel, gutter_nm=16000))
    fresh = [replace(scene) for scene in scenes()]
    assert len(photographer([toled, wide], fresh).estimates) == 2
    assert seen == [1]


def test_a_layout_that_repeats_is_told_as_the_repeated_opening(take, dies):
    """The layout's own error, cut cells and all, against the closed form without them."""
    toled = dies["TOLED"]
    alike = replace(toled, name="FOURS", panel=replace(toled.panel, tiling=Tiling.PAPER4, seed=1))
    assert _values(take, alike) == pytest.approx(_values(take, toled), abs=0.3)


def test_rows_state_level_method_and_error(take, dies):
    rows = take(dies["OURS"], photographs=False).quantities
    assert [row.level_db for row in rows] == list(LEVELS)
    for row in rows:
        assert (row.name, row.unit, row.die, row.passed) == ("restored_psnr", "dB", "OURS", None)
        assert row.uncertainty == RESIDUAL_DB[row.level_db]
        assert "surrogate" in row.method
        assert "this very layout" in row.method
        assert "assumed: an opaque film and no glass" in row.method


def test_a_photograph_is_near_its_prediction(take, dies):
    """On one scene the surrogate is about as good as on all."""
    rows = {row.level_db: row for row in take(dies["OURS"], photographs=False).quantities}
    table = evaluate([laid_panel("OURS", dies["OURS"].panel)], scenes(), scenes(), (40,))
    assert table.scores[0].psnr == pytest.approx(rows[40].value, abs=2 * RESIDUAL_DB[40])


def test_photographs_are_taken_only_where_they_are_asked_for(take, dies):
    plain = take(dies["OURS"], photographs=False)
    assert (plain.scene, plain.truth, plain.shots) == (None, None, ())
    taken = take(dies["OURS"], photographs=True)
    assert taken.quantities == plain.quantities
    assert taken.scene == "leaves1"
    assert tuple(shot.score.level_db for shot in taken.shots) == SHOWN_LEVELS
    assert {shot.picture.shape for shot in taken.shots} == {taken.truth.shape} == {(3, CROP.rows, CROP.columns)}


def test_a_plate_without_a_die_to_judge_costs_nothing(dies):
    panel = dies["TOLED"].panel
    small = replace(dies["TOLED"], panel=replace(panel, orientations=panel.orientations[:5, :5]))
    assert photographer([small]) is None
    assert photographer([]) is None
