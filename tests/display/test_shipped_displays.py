"""Displays that ship: one answer by every verb, and the seeds of dies that they fit."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from klayout import db
from small_job import command

from maskfab.api.checking import check
from maskfab.base.model import EMITTERS, Panel
from maskfab.designs.design import display_of
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import display_rules, displays, feasibility
from maskfab.job.read import read
from maskfab.mask.job import Job, load_job
from maskfab.mask.opening_file import load_opening
from maskfab.mask.panels import DieSeeds, die_panels, read_map
from maskfab.runs.sweep_cases import measured

LAYOUTS = Path(__file__).parents[2] / "layouts"
DISPLAYS = [path for path in sorted(LAYOUTS.glob("*.toml")) if (spec := read(path)).emitters is not None and spec.die]
MAPS = sorted((LAYOUTS / "maps").glob("*.toml"))
NAMING = [path.stem for path in MAPS if DieSeeds.of(read_map(path).provenance) is not None]
TRIED = range(8)


@cache
def job(path: Path) -> Job:
    return load_job(path)


def panel_of_seed(path: Path, name: str, seed: int) -> Panel:
    """A die of a shipped job, drawn from another seed."""
    (die,) = (die for die in job(path).spec.die if die.name == name)
    spec = job(path).spec.model_copy(update={"die": (die.model_copy(update={"seed": seed}),)})
    return die_panels(spec, job(path).openings, where=str(path))[name]


def die_with(map_name: str) -> tuple[Path, str]:
    """A shipped job with emitters, and its die that is laid by a map."""
    return next((path, die.name) for path in DISPLAYS for die in job(path).spec.die if die.map == f"{map_name}_map")


def verdict_on(name: str, seed: int) -> Verdict:
    """Answer on the die that a map was designed for, or else on one that is laid by it, drawn from a seed."""
    designed = LAYOUTS / f"design_{name}.toml"
    display = display_of(read(designed), name) if designed.exists() else None
    if display is None:
        path, die = die_with(name)
        return feasibility(panel_of_seed(path, die, seed), display_rules(job(path))).verdict
    opening, cells = load_opening(LAYOUTS / "openings" / f"{name}.toml"), read_map(LAYOUTS / "maps" / f"{name}.toml")
    return display.on(replace(display, seed=seed).die(opening.mask, opening.dot_nm, cells)).verdict


def test_there_are_displays_that_ship():
    assert {path.stem for path in DISPLAYS} >= {"display_that_fits", "display_cluster", "upc12", "first_plate"}
    assert {"fits", "fits_gutter", "fits_packed"} <= set(NAMING)


def areas_read(path: Path, die: str) -> dict[str, float]:
    """Area of each colour in one pixel of a die, um^2, as KLayout reads it from a file of the plate."""
    layout = db.Layout()
    layout.read(str(path))
    units = [cell for cell in layout.each_cell() if cell.name.startswith(f"{die}_") and "UNIT" in cell.name.upper()]
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
    for die, areas in told.items():
        assert areas_read(tmp_path / "out" / "FITS.gds", die) == pytest.approx(areas, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMING)
def test_a_shipped_map_names_every_seed_that_was_tried_and_none_wrongly(name: str) -> None:
    known = DieSeeds.of(read_map(LAYOUTS / "maps" / f"{name}.toml").provenance)
    assert known is not None
    verdicts = {seed: verdict_on(name, seed) for seed in TRIED}
    assert known.fit == tuple(seed for seed in TRIED if verdicts[seed] is Verdict.FITS)
    assert known.unfit == tuple(seed for seed in TRIED if verdicts[seed] is not Verdict.FITS)


def test_every_map_that_was_designed_to_fit_names_its_seeds_or_what_lies_beyond_it():
    fitted = {
        path.stem.removeprefix("design_") for path in LAYOUTS.glob("design_*.toml") if display_of(read(path), "job")
    }
    regular = {path.stem for path in MAPS if read_map(path).beyond is not None}
    assert fitted <= {*NAMING, *regular}


@pytest.mark.parametrize("path", DISPLAYS, ids=lambda path: path.stem)
def test_shipped_jobs_take_seeds_that_their_maps_name(path: Path) -> None:
    assert job(path).seed_notes == {}


def with_seed(tmp_path: Path, stated: str) -> Path:
    """The shipped plate's die of the opening that does not fit every die, alone, with another line for its seed."""
    text = (LAYOUTS / "upc12.toml").read_text(encoding="utf-8")
    head, *dies = text.split("[[die]]")
    *_, rules = dies[-1].partition("\n# A display round")
    (die,) = (each for each in dies if 'name = "GUT8_M150"' in each)
    own = tmp_path / "job.toml"
    body = die.replace("seed = 1\n", stated)
    text = f"{head}[[die]]{body.split(chr(10) + '#')[0]}\n# A display round{rules}"
    own.write_text(
        text.replace('"openings/', f'"{LAYOUTS}/openings/').replace('"maps/', f'"{LAYOUTS}/maps/'), encoding="utf-8"
    )
    return own


def test_a_die_without_a_seed_takes_the_first_that_its_map_names(tmp_path: Path) -> None:
    found = load_job(with_seed(tmp_path, ""))
    assert (found.seeds, found.seed_notes) == ({"GUT8_M150": 1}, {})


@pytest.mark.parametrize(
    ("seed", "told"), [(3, "does not fit a die of seed 3"), (9, "was not tried on a die of seed 9")]
)
def test_a_job_with_another_seed_is_told(capsys, tmp_path: Path, seed: int, told: str) -> None:
    own = with_seed(tmp_path, f"seed = {seed}\n")
    (note,) = load_job(own).seed_notes.values()
    assert note.passed is None
    assert told in note.method
    assert "fits_gutter_map it fits with 1, 2, 5, 6 and 7, and not with 0, 3 and 4" in note.method
    if seed == 3:
        answer = command(capsys, "check", own, "--quiet")
        assert (answer.code, told in answer.stdout) == (1, True)
        (die,) = command(capsys, "check", own, "--json", "--quiet").document["dies"]
        (row,) = (each for each in die["quantities"] if each["name"] == "display_seed")
        assert (row["value"], told in row["method"]) == (3, True)


def test_what_is_no_list_of_seeds_names_none():
    assert DieSeeds.of({"die_seeds_fit": "any"}) is None
    assert DieSeeds.of({"die_seeds_fit": 2}) == DieSeeds((2,))
    assert DieSeeds.of({"die_seeds_unfit": "1"}) is None
    known = DieSeeds((5, 1), (0,))
    assert DieSeeds.of(known.facts) == DieSeeds((1, 5), (0,))
    assert DieSeeds((1,)).against(7, "m") is None
