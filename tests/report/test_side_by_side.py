"""Finished reports side by side: what is ranked, what is refused, and what is said of the rest."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from browser import faults
from small_job import command, finished

import maskfab as mf
from maskfab.api.comparing import Comparison
from maskfab.base.errors import JobError, OutputError
from maskfab.base.model import Quantity
from maskfab.camera.scores import MeanDifference
from maskfab.findings.photographs import middle_level
from maskfab.report.documents.report import FinishedReport
from maskfab.report.pages.compared import Compared, compare_page, compare_reports, compare_text, verdict
from maskfab.report.text import quantity_document


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small plate with another seed, and one die of another name."""
    edits = ("seed = 3", "seed = 4"), ('name = "PLAIN"', 'name = "EVEN"')
    return finished(tmp_path_factory.mktemp("other"), *edits)


@pytest.fixture(scope="module")
def document(small_result: Path) -> Mapping[str, Any]:
    read: Mapping[str, Any] = json.loads((small_result / "report.json").read_text())
    return read


def report(name: str, document: Mapping[str, Any], **scores: list[float]) -> FinishedReport:
    """A report with photographs of these dies; every level of light has the same."""
    told = copy.deepcopy(dict(document))
    by_name = {die["name"]: die for die in told["photographs"]["dies"]}
    for die, given in scores.items():
        row = {"epsilon": 0.01, "psnr": given, "psnr_inner": given}
        by_name[die] |= {
            "refused": None,
            "levels": [{"level_db": level, **row} for level in told["photographs"]["levels_db"]],
        }
    told["photographs"]["reference"] = "PLAIN"
    told["photographs"]["scenes"] = [f"scene {number}" for number in range(len(next(iter(scores.values()))))]
    return FinishedReport(name, told, None, True)


def ranked(found: Compared) -> list[tuple[str, bool]]:
    return [(row["name"], row["best"]) for row in found.to_dict()["levels"][0]["dies"]]


def test_differences_are_paired_and_ties_are_named(document):
    """All scenes of one die are better by a decibel, give or take .1, though scenes differ by twenty."""
    base = [20.0, 30.0, 40.0, 25.0]
    one = report(
        "one",
        document,
        PLAIN=base,
        TURNED=[each + 1 + step for each, step in zip(base, (0.1, -0.1, 0, 0), strict=True)],
    )
    two = report("two", document, PLAIN=[each + 1 for each in base], TURNED=[each - 3 for each in base])
    found = compare_reports([one, two])
    assert ranked(found) == [
        ("one:TURNED", True),
        ("two:PLAIN", True),
        ("one:PLAIN", False),
        ("two:TURNED", False),
    ] or (ranked(found) == [("two:PLAIN", True), ("one:TURNED", True), ("one:PLAIN", False), ("two:TURNED", False)])
    row = next(row for row in found.to_dict()["levels"][0]["dies"] if row["name"] == "one:TURNED")
    exact = MeanDifference.of([1.1, 0.9, 1.0, 1.0])
    assert row["gain"]["mean"] == pytest.approx(exact.mean)
    assert row["gain"]["half_width"] == pytest.approx(exact.half_width)
    assert "tied with" in verdict(found)
    assert "over 4 photographs" in verdict(found)


def test_the_order_of_reports_changes_names_alone(document):
    rng = np.random.default_rng(1)
    scores = rng.uniform(20, 30, (4, 5)).tolist()
    one = report("one", document, PLAIN=scores[0], TURNED=scores[1])
    two = report("two", document, PLAIN=scores[2], TURNED=scores[3])
    there, back = (
        compare_reports(order, reference="one:PLAIN").to_dict()["levels"] for order in ([one, two], [two, one])
    )
    assert there == back


def test_other_scenes_light_or_camera_are_left_out_and_said(document):
    one = report("one", document, PLAIN=[20.0, 21.0], TURNED=[22.0, 23.0])
    two = report("two", document, PLAIN=[30.0, 31.0, 32.0], TURNED=[30.0, 31.0, 32.0])
    found = compare_reports([one, two])
    assert {name for name, _ in ranked(found)} == {"one:PLAIN", "one:TURNED"}
    assert any("scenes" in each and "not compared" in each for each in found.left_out)
    light = report("two", document, PLAIN=[30.0, 31.0], TURNED=[30.0, 31.0])
    light.document["photographs"]["sensor"]["read_noise"] = 99.0
    assert any("sensor" in each for each in compare_reports([one, light]).left_out)
    lens = report("two", document, PLAIN=[30.0, 31.0], TURNED=[30.0, 31.0])
    lens.document["camera"]["focal_um"] = 1.0
    found = compare_reports([one, lens])
    assert any("another camera" in each and "focal" in each for each in found.left_out)
    dies = {die["name"]: {row["name"] for row in die["quantities"]} for die in found.document["dies"]}
    assert dies["two:PLAIN"] <= {"open_ratio", "min_feature", "min_gap"}
    assert "auc_radial_min" in dies["one:PLAIN"]


def test_the_figure_of_runs_and_panels_shows_every_die_by_its_light_in_the_stop(document):
    one = report("one", document, PLAIN=[20.0, 21.0], TURNED=[22.0, 23.5])
    light = {die["name"]: _numbers(die, "stop_open_ratio")[0] for die in one.document["dies"]}
    mixed = Comparison(compare_reports([one]), {"PLAIN": cast(Any, None)})
    (axes,) = mixed.plot().figure.axes
    drawn = {bars.get_label(): bars[0].get_xdata()[0] for bars in axes.containers}
    assert drawn == {name: pytest.approx(100 * share) for name, share in light.items()}
    assert axes.get_xlabel() == "open ratio in the stop (%)"
    assert mixed.compared.table.columns[0] == ("Open ratio", "in the stop")
    assert len(light) == 2


def _numbers(die: Mapping[str, Any], name: str) -> list[float]:
    return [row["value"] for row in die["quantities"] if row["name"] == name]


def test_bands_stand_beside_numbers_and_gains_over_another_die_have_none(document):
    one = report("one", document, PLAIN=[20.0, 21.0], TURNED=[22.0, 23.5])
    level = middle_level(document["photographs"]["levels_db"])
    dies = [
        {**die, "quantities": [*die["quantities"], *(band(name, die["name"], level) for name in ("psnr", "gain"))]}
        for die in one.document["dies"]
    ]
    made = replace(one, document={**one.document, "dies": dies})
    for reference, gain in ((None, "1.50–1.60"), ("TURNED", "")):
        lines = {line.name: line for line in compare_reports([made], reference=reference).table.lines}
        assert {line.psnr.made for line in lines.values()} == {"1.50–1.60"}
        assert lines["PLAIN"].gain.made.lstrip("+") == gain
    assert "1.50–1.60" in compare_page(compare_reports([made]))


def band(name: str, die: str, level: float) -> dict[str, Any]:
    found = Quantity(f"band_restored_{name}", 0.05, "made up", die=die, level_db=level, between=(1.5, 1.6))
    return quantity_document(found)


def test_two_runs_from_files_to_a_page(capsys, browser, small_result, other, tmp_path):
    told = command(capsys, "compare", small_result, other, "--json", "--out", tmp_path / "page")
    assert told.code == 0
    fields = {each["field"]: each["values"] for each in told.document["job_differences"]}
    assert fields["die.TURNED.seed"] == ["3", "4"]
    assert fields["die.PLAIN"] == ["periodic", None]
    assert fields["die.EVEN"] == [None, "periodic"]
    assert len(fields) == 3
    page = (tmp_path / "page" / "compare.html").read_text()
    assert "<script" not in page
    assert faults(browser, tmp_path / "page" / "compare.html") == []
    text = command(capsys, "compare", small_result).stdout
    assert text.splitlines()[1].startswith("die ")
    assert {"PLAIN", "TURNED"} <= {line.split()[0] for line in text.splitlines()}


def test_a_report_is_not_compared_with_itself(small_result, other, tmp_path):
    """Its best would be tied with itself: by one path, by its own and its folder's, or as a copy."""
    copied = Path(shutil.copytree(small_result, tmp_path / "copy"))
    for named in ((small_result,), (small_result / "report.json",), (other, small_result), (copied,)):
        with pytest.raises(JobError, match=rf"MF105.*report {len(named) + 1}, .*, is the same as report 1, .*once"):
            mf.compare(small_result, *named)


def test_names_from_elsewhere_are_inert(document):
    wild = report("<script>alert(1)</script>", document, PLAIN=[20.0, 21.0], TURNED=[22.0, 23.5])
    page = compare_page(compare_reports([wild, report("two", document, PLAIN=[20.0, 21.0], TURNED=[22.0, 23.0])]))
    assert "<script" not in page


@pytest.mark.parametrize("damage", ["edited", "truncated", "version", "empty", "list", "long name"])
def test_what_is_no_report_any_more_is_refused(small_result, tmp_path, damage):
    folder = Path(shutil.copytree(small_result, tmp_path / "copy"))
    file = folder / "report.json"
    text = file.read_text()
    changed = {
        "edited": text.replace("SMALL PLATE", "LARGE PLATE"),
        "truncated": text[:-100],
        "version": text.replace('"schema_version": ', '"schema_version": 9'),
        "empty": "",
        "list": "[]",
        "long name": text,
    }[damage]
    file.write_text(changed)
    place = folder if damage != "long name" else tmp_path / ("x" * 300)
    with pytest.raises(OutputError, match="MF403" if damage == "long name" else "MF407"):
        mf.compare(place)


def test_a_report_of_the_version_before_is_compared(small_result, tmp_path):
    """It has no limits of the eye and of life."""
    then = json.loads((small_result / "report.json").read_text())
    assert then["schema_version"] == 6
    verdicts = {key: value for key, value in then["verdicts"].items() if key not in ("looks", "lives")}
    (tmp_path / "report.json").write_text(json.dumps({**then, "schema_version": 5, "verdicts": verdicts}))
    found, same = mf.compare(tmp_path / "report.json"), mf.compare(small_result / "report.json")
    assert found.compared.table.lines == same.compared.table.lines
    (tmp_path / "report.json").write_text(json.dumps({**then, "schema_version": 4}))
    with pytest.raises(OutputError, match=r"MF407.*compares 5 and 6"):
        mf.compare(tmp_path / "report.json")


def test_a_die_that_breaks_a_limit_is_the_highest_and_not_the_best(document):
    def shown(**verdicts: str) -> FinishedReport:
        made = report("one", document, PLAIN=[20.0, 21.0, 20.5], TURNED=[22.0, 23.0, 22.6])
        limits = {"name": "grain", "value": 0.02, "reference": 0.0, "unit": "1", "limit": 0.015, "stated": False,
                  "passed": False, "source": "SEMI"}  # fmt: skip
        dies = [
            {**die, "display": {"verdict": "FITS", "share": 0.1, "required": 0.0, "emitters": None, "wires": None,
             "bound_share": 0.3, "looks": {"verdict": verdicts[die["name"]], "numbers": [limits]}}}
            for die in made.document["dies"]
        ]  # fmt: skip
        return replace(made, document={**made.document, "dies": dies})

    told = verdict(compare_reports([shown(PLAIN="KEPT", TURNED="BROKEN")]))
    assert told.startswith("Highest PSNR: TURNED; every other die is worse over 3 photographs")
    assert "Best of those that keep FITS, LOOKS and LIVES: PLAIN." in told
    assert "The limits of the display cost 2.0" in told
    assert verdict(compare_reports([shown(PLAIN="KEPT", TURNED="KEPT")])).startswith("Best: TURNED; every other")
    none = verdict(compare_reports([shown(PLAIN="BROKEN", TURNED="BROKEN")]))
    assert "Best" not in none
    assert "No die keeps FITS, LOOKS and LIVES. What binds is LOOKS" in none


def test_a_report_alone_is_compared_but_not_vouched_for(small_result, tmp_path):
    shutil.copy(small_result / "report.json", tmp_path)
    found = mf.compare(tmp_path / "report.json")
    assert any("no manifest" in each for each in found.compared.left_out)


def test_bands_over_another_spread_are_told_apart(document, tmp_path):
    process = {"corner_radius_um": 1.0, "cd_bias_um": 0.0, "roughness": None}
    for name, bias_um in (("one", 0.1), ("two", 0.2), ("three", 0.1)):
        (tmp_path / name).mkdir()
        stated = {"title": name, "process": process, "spread": {"bias_um": bias_um, "radius_um": 0.0}}
        (tmp_path / name / "report.json").write_text(json.dumps({**document, **stated}))
    told = mf.compare(*(tmp_path / name for name in ("one", "two", "three"))).compared.left_out
    assert [each.split()[0] for each in told if "another spread" in each] == ["two"]


def test_dies_are_named_with_or_without_their_report(small_result, other):
    assert [line.name for line in mf.compare(small_result, other, dies=["PLAIN", "EVEN"]).compared.table.lines] != []
    for wrong in (["TURNED", "PLAIN"], ["NOBODY", "PLAIN"], ["PLAIN"]):
        with pytest.raises(JobError, match="MF105"):
            mf.compare(small_result, other, dies=wrong)


def _nan(document):
    document["dies"][0]["quantities"][0]["value"] = float("nan")


def _fewer(document):
    document["photographs"]["dies"][0] |= {
        "refused": None,
        "levels": [{"level_db": level, "psnr": [1.0, 2.0]} for level in document["photographs"]["levels_db"]],
    }


def _named(name):
    def edit(document):
        document["dies"][0]["name"] = document["photographs"]["dies"][0]["name"] = name

    return edit


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (lambda document: document.update(dies=5), "dies: Input should be a valid list"),
        (lambda document: document["dies"][0].pop("quantities"), "quantities: Field required"),
        (lambda document: document["dies"].append(document["dies"][0]), "two dies have one name"),
        (lambda document: document["camera"].update(wavelengths_nm=[]), "wavelengths_nm"),
        (lambda document: document["photographs"].update(reference="NOBODY"), "reference NOBODY has no photographs"),
        (lambda document: document["photographs"]["dies"].pop() and document["dies"].clear(), "not of the dies"),
        (_nan, "finite number"),
        (lambda document: document["dies"][0]["quantities"][0].update(name="mtf_worst_x"), "no frequency"),
        (lambda document: document.update(spread=0.1), "spread"),
        (lambda document: document.update(photographs=None), "photographs is null"),
        (lambda document: document["dies"][0].update(display=None), "display is null"),
        (_fewer, "one number for each scene"),
        (_named("<img src=x onerror=alert(1)>"), "no name"),
        (_named("../../A"), "no name"),
        (_named("A\nB"), "no name"),
        (_named("A" * 10_000), "at most 100 characters"),
        (lambda document: document.update(title="\ud800"), "title"),
        (lambda document: document["dies"][0]["quantities"][0].update(between=[1.0]), "between"),
    ],
)
def test_a_report_alone_that_somebody_has_edited_is_refused_with_the_place(document, tmp_path, edit, told):
    changed = copy.deepcopy(dict(document))
    edit(changed)
    (tmp_path / "report.json").write_text(json.dumps(changed))
    with pytest.raises(OutputError, match="MF407") as refused:
        mf.compare(tmp_path / "report.json")
    assert told in str(refused.value)
    assert len(str(refused.value)) < 1000


@pytest.mark.parametrize("title", ["<script>alert(1)</script>", "../..", "A\nB\x1b[2J", "T" * 10_000])
def test_titles_from_elsewhere_are_inert(document, tmp_path, title):
    folder = tmp_path / "a\n\x1b[2J<b>"
    folder.mkdir()
    (folder / "report.json").write_text(json.dumps({**document, "title": title}))
    (tmp_path / "two.json").write_text(json.dumps({**document, "title": "two"}))
    found = mf.compare(folder, tmp_path / "two.json").compared
    page = compare_page(found)
    assert "<script" not in page
    assert "<b>" not in page
    assert all(line.isprintable() for line in compare_text(found))
