"""Displays that ship: one answer by every verb, and the seeds of dies that they fit."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from klayout import db
from small_job import command

import maskfab as mf
from maskfab.api.checking import check
from maskfab.base.model import EMITTERS
from maskfab.designs.design import display_of
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import displays
from maskfab.job.read import read
from maskfab.job.sections import SearchSection
from maskfab.mask.job import Job, load_job
from maskfab.mask.opening_file import load_opening
from maskfab.mask.panels import DieSeeds, placed, read_map
from maskfab.runs.sweep_cases import measured

LAYOUTS = Path(__file__).parents[2] / "layouts"
DISPLAYS = [path for path in sorted(LAYOUTS.glob("*.toml")) if (spec := read(path)).emitters is not None and spec.die]
DESIGNED = {
    Path(spec.design.map_output).stem: path
    for path in sorted(LAYOUTS.glob("*.toml"))
    if isinstance((spec := read(path)).design, SearchSection) and spec.design.fit and spec.design.map_output
}
"""Maps that were designed for a display, with the jobs that ask for them."""


@cache
def job(path: Path) -> Job:
    return load_job(path)


def test_there_are_displays_that_ship():
    assert {path.stem for path in DISPLAYS} >= {"display_that_fits", "display_density", "upc12", "first_plate"}
    assert set(DESIGNED) >= {"fits", "fits_88", "fits_300", "fits_gutter", "fits_packed", "density"}


def areas_read(path: Path, die: str, opening: str) -> dict[str, float]:
    """Area of each colour in one pixel of a die, um^2, as KLayout reads it from the cells of its opening in a file."""
    layout = db.Layout()
    layout.read(str(path))
    units = [cell for cell in layout.each_cell() if cell.name.startswith(f"{opening.upper()}_D")]
    assert units, f"{path} has no cells of {die}"
    found: dict[str, float] = {}
    for layer, colour in zip(EMITTERS, ("red", "green", "blue"), strict=True):
        index = layout.find_layer(layer.number, layer.datatype)
        (area,) = {db.Region(cell.begin_shapes_rec(index)).merged().area() for cell in units}
        found[colour] = area * layout.dbu**2
    return found


@pytest.mark.slow
@pytest.mark.parametrize("path", DISPLAYS, ids=lambda path: path.stem)
def test_every_verb_gives_one_answer_on_a_shipped_display(path: Path) -> None:
    """Of all dies and of each by itself, and by a sweep: areas, shares, rooms and verdicts are the same."""
    answer = check(path)
    rows = {
        (row.die, row.name): row.value for row in measured(job(path), ("display_fits", "led_footprint", "circuit_room"))
    }
    drawn = displays(job(path)).plate
    for die in drawn.dies:
        alone = check(path, die=die.name).to_dict()["dies"]
        (same,) = (each for each in answer.to_dict()["dies"] if each["name"] == die.name)
        assert alone == [same]
        if same["display"] is None:
            continue
        placed = same["display"]["emitters"]
        assert (placed is None) == (die.panel.emitters is None)
        if die.panel.emitters is not None:
            assert list(placed["areas_um2"].values()) == list(die.panel.emitters.areas_um2)
        assert rows[die.name, "led_footprint"] == same["display"]["share"]
        assert rows[die.name, "circuit_room"] == same["display"]["circuits"]["room_um2"]
        assert (
            rows[die.name, "display_fits"]
            == {"FITS": 1, "DOES NOT FIT": 0, "UNKNOWN": None}[same["display"]["verdict"]]
        )


@pytest.mark.slow
def test_a_run_draws_the_emitters_that_check_tells(capsys, tmp_path: Path) -> None:
    """Of the shipped display whose two answers differed, read from the file that is written."""
    path = LAYOUTS / "display_that_fits.toml"
    text = (
        path.read_text(encoding="utf-8")
        .replace('"openings/', f'"{LAYOUTS}/openings/')
        .replace('"maps/', f'"{LAYOUTS}/maps/')
    )
    own = tmp_path / "job.toml"
    own.write_text(text + '\n[export]\nformats = ["gdsii"]\n', encoding="utf-8")
    answer = command(capsys, "run", own, "--out", tmp_path / "out", "--no-cache", "--quiet")
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert answer.code in (0, 1), answer.stderr
    told = {die["name"]: die["display"]["emitters"]["areas_um2"] for die in check(path).to_dict()["dies"]}
    assert {die["name"]: die["display"]["emitters"]["areas_um2"] for die in report["dies"]} == told
    openings = {"TOLED": "toled", "FITS": "fits"}
    for die, areas in told.items():
        assert areas_read(tmp_path / "out" / "FITS.gds", die, openings[die]) == pytest.approx(areas, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", DESIGNED)
@pytest.mark.parametrize("larger", [1, 2])
def test_a_shipped_design_fits_dies_of_every_size(name: str, larger: int) -> None:
    display = display_of(read(DESIGNED[name]), name)
    assert display is not None
    cells = read_map(LAYOUTS / "maps" / f"{name}.toml")
    opening, *others = (
        load_opening(path)
        for path in (LAYOUTS / "openings" / f"{name}{part}.toml" for part in ("", "_outer"))
        if path.exists()
    )
    dies = replace(display, across=larger * display.across)
    die = dies.die(opening.mask, opening.dot_nm, cells, others[0].mask if others else None)
    assert display.on(die).verdict is Verdict.FITS


@pytest.mark.parametrize("name", DESIGNED)
def test_nothing_round_a_map_that_was_designed_to_fit_is_drawn_from_a_seed(name: str) -> None:
    cells = read_map(LAYOUTS / "maps" / f"{name}.toml")
    assert cells.beyond is not None
    others = (LAYOUTS / "openings" / f"{name}_outer.toml").exists()
    panels = [placed(cells, 40, 40, seed, openings=1 + others, where=name) for seed in (0, 5)]
    assert np.array_equal(*panels)


@pytest.mark.parametrize("path", DISPLAYS, ids=lambda path: path.stem)
def test_shipped_jobs_take_seeds_that_their_maps_name(path: Path) -> None:
    assert job(path).notes == {}


def with_seed(tmp_path: Path, stated: str) -> Path:
    """A die of the shipped plate alone, drawn from a seed round its map, with another line for the seed."""
    text = (LAYOUTS / "upc12.toml").read_text(encoding="utf-8")
    head, *dies = text.split("[[die]]")
    *_, rules = dies[-1].partition("\n# A display round")
    (die,) = (each for each in dies if 'name = "GUT8_M150"' in each)
    own, given = tmp_path / "job.toml", (LAYOUTS / "maps" / "fits_gutter.toml").read_text(encoding="utf-8")
    (tmp_path / "maps").mkdir(exist_ok=True)
    drawn = given.replace("beyond = [0, 0]\n", "") + 'die_seeds_fit = "1 2 5 6 7"\ndie_seeds_unfit = "0 3 4"\n'
    (tmp_path / "maps" / "fits_gutter.toml").write_text(drawn, encoding="utf-8")
    body = die.replace("seed = 1\n", stated)
    text = f"{head}[[die]]{body.split(chr(10) + '#')[0]}\n# A display round{rules}"
    own.write_text(text.replace('"openings/', f'"{LAYOUTS}/openings/'), encoding="utf-8")
    return own


def test_a_die_without_a_seed_takes_the_first_that_its_map_names(tmp_path: Path) -> None:
    found = load_job(with_seed(tmp_path, ""))
    assert (found.seeds, found.notes) == ({"GUT8_M150": 1}, {})


@pytest.mark.parametrize(
    ("seed", "told"), [(3, "does not fit a die of seed 3"), (9, "was not tried on a die of seed 9")]
)
def test_a_job_with_another_seed_is_told(tmp_path: Path, seed: int, told: str) -> None:
    own = with_seed(tmp_path, f"seed = {seed}\n")
    (note,) = load_job(own).notes.values()
    assert note.passed is None
    assert told in note.method
    assert "fits_gutter_map it fits with 1, 2, 5, 6 and 7, and not with 0, 3 and 4" in note.method
    if seed == 3:
        found = mf.check(own)
        assert (found.passed, told in str(found)) == (False, True)
        (die,) = found.to_dict()["dies"]
        (row,) = (each for each in die["quantities"] if each["name"] == "display_seed")
        assert (row["value"], told in row["method"]) == (3, True)


def test_what_is_no_list_of_seeds_names_none():
    assert DieSeeds.of({"die_seeds_fit": "any"}) is None
    assert DieSeeds.of({"die_seeds_fit": 2}) == DieSeeds((2,))
    assert DieSeeds.of({"die_seeds_unfit": "1"}) is None
    known = DieSeeds((5, 1), (0,))
    assert DieSeeds.of(known.facts) == DieSeeds((1, 5), (0,))
    assert DieSeeds((1,)).against(7, "m") is None
