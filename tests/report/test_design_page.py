"""The page of a design: from its document alone, twice alike, inert, and in sight on a desk and on a telephone."""

from __future__ import annotations

import copy
import html as markup
import json
import re
from pathlib import Path
from typing import Any

import pytest
from browser import DESK, TELEPHONE, Browser, faults
from once import leaves
from report.conftest import MARKUP
from small_job import command, listing

import maskfab as mf
from maskfab.camera import scenes
from maskfab.report.pages.design import design_page, search_drawing, stages

JOB = """
[design]
name = "small"
dots = 8
pitch = "168 um"
clear_dots = 12
anneal = 20
families = ["bars", "discs", "l_shapes"]

[design.rules]
min_feature_dots = 2
kissing = "cell"

[camera]
focal = "10 mm"
stop = { shape = "circle", diameter = "4 mm" }
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job, and the folder ``out`` of its design."""
    place = tmp_path_factory.mktemp("design")
    (place / "job.toml").write_text(JOB)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "bundled", lambda count=4: (leaves(1),))
        mf.design(place / "job.toml").save(place / "out")
    return place


@pytest.fixture
def told(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "out" / "design.json").read_text())


def test_the_page_is_made_of_the_document_alone(folder: Path, told: dict[str, Any]) -> None:
    page = (folder / "out" / "design.html").read_text()
    assert design_page(told) == page
    assert design_page({**told, "clear_dots": 123}) != page
    assert "<script" not in page
    assert re.findall(r"""(?:src|href)=["'](?!data:|#|%23)[^"']*""", page) == []


def test_the_document_says_how_it_was_found(told: dict[str, Any]) -> None:
    search = told["search"]
    judged = {stage["what"]: stage["count"] for stage in search["stages"]}
    assert judged["shapes judged"] + judged["steps of annealing"] == told["evaluated"]
    assert judged["steps of annealing"] == 20
    values = [value for _, value in search["bettered"]]
    assert max(values) >= told["alternatives"]["chosen"]["expected_psnr_db"]
    assert (search["seed"], search["scenes"], search["budget_s"]) == (0, "1 synthetic scene", None)
    assert [rule["rule"] for rule in search["rules"]] == ["kissing", "min_feature_dots"]
    assert search["rules"][1]["asked"] == "2 dots"
    assert told["prices_db"].keys() == {"min_feature_dots", "kissing"}
    assert told["rows"] == [row for row in told["rows"] if set(row) <= {"#", "."}]
    assert sum(row.count("#") for row in told["rows"]) == told["clear_dots"] == 12
    assert sum(row.count("#") for row in told["panel"]["rows"]) == 36 * 12


def test_the_page_names_every_cost_and_every_alternative(folder: Path, told: dict[str, Any]) -> None:
    page = (folder / "out" / "design.html").read_text()
    for rule, cost in told["prices_db"].items():
        row = page[page.index(f'<th scope="row">{rule.replace("_", " ")}<small>') :][:200]
        assert f"{cost['last']:.3f}" in row
        assert f"{cost['alone']:.3f}" in row
    near = told["alternatives"]
    assert near["others"]
    for each in [near["chosen"], *near["others"]]:
        assert f'<th scope="row">{each["shape"]}</th>' in page
    assert told["head_room_db"]
    for level, room in told["head_room_db"].items():
        assert (f"{room:.2f} dB at {level}" in page) == (room <= 1)
    assert "not judged: the design has to hold none" in page


def test_what_is_not_known_is_told_and_no_number(told: dict[str, Any]) -> None:
    none = {**told, "alternatives": None, "alternatives_absent": "None was visited.", "prices_db": {}}
    page = design_page({**none, "rules_cost_db": None, "head_room_db": None, "bounds": None, "time": None})
    for said in (
        "None was visited.",
        "Not priced",
        "No limit was proved to 1 dB: the budget is shorter than that takes.",
    ):
        assert said in page
    lone = {**told["alternatives"], "others": [], "judged_within": 0, "kinds": 0}
    assert "no other opening that was judged lies within 0.1 dB" in design_page({**told, "alternatives": lone})


def test_equal_jobs_leave_equal_files_but_for_the_time(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scenes, "bundled", lambda count=4: (leaves(1),))
    first = listing(folder / "out")
    assert first.keys() == {"small.toml", "design.json", "design.html", "manifest.json"}
    job, out = folder / "job.toml", folder / "out"
    answer = command(capsys, "design", job, "-o", out, "--quiet")
    assert (answer.code, "MF402" in answer.stderr) == (2, True)
    again = command(capsys, "design", job, "-o", out, "--force", "--quiet", "--json")
    assert again.code == 0
    second = listing(out)
    assert first["small.toml"] == second["small.toml"]
    one, two = (json.loads(each["design.json"]) for each in (first, second))
    pages = []
    for each, page in ((one, first["design.html"]), (two, second["design.html"])):
        time = each.pop("time")
        pages.append(page.decode().replace(f"{time['wall_s']} s, {time['processor_s']} s of processor", ""))
    assert one == two
    assert pages[0] == pages[1]
    assert {**again.document, "path": two["path"], "time": None} == {**two, "time": None}
    assert again.document["path"] == str(out / "small.toml")


def test_a_file_that_is_no_toml_is_refused_before_work(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = command(capsys, "design", folder / "job.toml", "-o", folder / "page.html", "--quiet")
    assert (answer.code, "MF430" in answer.stderr) == (2, True)


def test_hostile_texts_are_words_and_nothing_runs_or_scrolls_sideways(browser: Browser, told: dict[str, Any]) -> None:
    hostile = copy.deepcopy(told)
    name = MARKUP + "W" * 300
    hostile |= {"name": name, "shape": name, "notes": [MARKUP], "designed_for": MARKUP, "job_hash": MARKUP}
    hostile["search"] |= {"method": MARKUP, "scenes": name, "rules": [{"rule": MARKUP, "asked": name}]}
    hostile["provenance"]["command"] = name
    hostile["alternatives"]["chosen"]["shape"] = name
    page = design_page(hostile)
    assert "<script" not in page
    assert page.count(markup.escape(MARKUP, quote=False).replace("'", "&#39;")) >= 10
    for size in (DESK, TELEPHONE):
        looked = browser.seen(page, size)
        assert looked.pop("wide") <= size[0]
        assert looked == {"scripts": 0, "broken": 0, "fetched": 0}


def test_the_page_opens_anywhere(browser: Browser, folder: Path) -> None:
    assert faults(browser, folder / "out" / "design.html") == []


def test_rules_are_priced_by_annealing_without_each_where_that_is_asked_for(
    folder: Path, told: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told["search"]["annealed_without_db"] is None
    assert "Not asked for; <code>--price-rules</code>" in design_page(told)
    monkeypatch.setattr(scenes, "bundled", lambda count=4: (leaves(1),))
    again = mf.design(folder / "job.toml", price_rules=True, budget="10 min").to_dict()
    gains = again["search"]["annealed_without_db"]
    assert gains.keys() == {"kissing", "min_feature_dots"}
    assert min(gains.values()) >= 0
    assert max(gains.values()) > 0
    assert again["rows"] == told["rows"]
    assert again["time"]["annealed_without_s"] <= again["time"]["processor_s"]
    page = design_page(again)
    assert "Not asked for" not in page
    assert f"{gains['min_feature_dots']:.3f}</td></tr>" in page


def test_a_stage_that_begins_anew_has_a_stair_of_its_own() -> None:
    scan, annealing = [(1, 30.0), (10, 31.0), (85, 31.2)], [(900, 30.5), (950, 30.9), (960, 31.5)]
    assert stages([*scan, *annealing]) == [scan, annealing]
    losses = [(10, 5.0), (20, 4.0), (30, 3.5)]
    assert stages(losses) == [losses]
    drawing = search_drawing([*scan, *annealing], 1000, "expected restored PSNR, dB", "openings judged")
    assert drawing is not None
    ends = [max(line.get_xdata()) for line in drawing.figure.axes[0].lines if line.get_linestyle() == "-"]
    assert ends == [900, 1000]
    assert search_drawing(scan[:1], 1000, "loss", "steps of descent") is None
