"""`maskfab check`: displays whose answer is known by hand, its document, its exit codes, and what it refuses."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from small_job import Answer, command, finished, listing, write_job

from maskfab.display import feasibility
from maskfab.display.drive import BY_AREA, NOT_PLACED
from maskfab.display.emitter_rules import Verdict
from maskfab.report.documents.display import check_schema

pytestmark = pytest.mark.usefixtures("drawn_in_words")

COLUMN = 'name = "column"\npitch = "56 um"\ndots = 7\ngrid = """\n' + "......#\n" * 7 + '"""\n'
"""One clear column: six columns of seven dots are left for emitters."""

GUTTER = ('pitch = "56 um"\ntiling = "periodic"', 'pitch = "64 um"\ngutter = "8 um"\ntiling = "periodic"')
"""As wide as the gap between colours, so that neighbours are far enough whatever lies in them."""

RULES = {"colour_gap": '"8 um"', "min_width": '"8 um"', "circuit": '"200 um^2"'}
PIXEL_UM2 = 64.0**2


def display(tmp_path: Path, **changed: str) -> Path:
    """The job of one clear column with rules of emitters, some of them changed."""
    lines = "\n".join(f"{name} = {value}" for name, value in {**RULES, **changed}.items())
    return write_job(tmp_path, GUTTER, ("[plate]", f"[emitters]\n{lines}\n\n[plate]"), opening=COLUMN)


def checked(capsys: pytest.CaptureFixture[str], job: Path, *more: str) -> Answer:
    """The first die of a job, as JSON that keeps to its schema."""
    answer = command(capsys, "check", job, "--die", "PLAIN", "--json", "--quiet", *more)
    assert answer.stderr == ""
    Draft202012Validator(check_schema()).validate(answer.document)
    return answer


def the_display(answer: Answer) -> dict[str, Any]:
    return answer.document["dies"][0]["display"]


# --- answers ---------------------------------------------------------------------------------------------------------


def test_a_display_that_fits(capsys, tmp_path):
    answer = checked(capsys, display(tmp_path, required="0.14"))
    assert answer.code == 0
    assert answer.document["verdict"] == "pass"
    (die,) = answer.document["dies"]
    found = die["display"]
    assert found["verdict"] == "FITS"
    # Two columns of seven beside two blocks of three by three, a dot between any two: the smallest has nine dots.
    assert found["rectangles_share"] == pytest.approx(9 / 64, rel=1e-12)
    # 42 dots are closed, and gaps take some of them.
    assert 9 / 64 <= found["found_share"] <= found["bound_share"] < 42 / 64 / 3
    areas = found["emitters"]["areas_um2"]
    assert min(areas.values()) == pytest.approx(found["found_share"] * PIXEL_UM2, rel=1e-12)
    assert found["borders"]["sufficient_margin_um"] == 0
    assert found["borders"]["side_violations"] == found["borders"]["diagonal_violations"] == 0
    assert (die["broken"], found["proofs"], die["largest_gap"]) == ([], [], None)
    # Three circuits of 200 um^2; everything closed is as wide as a dot.
    assert die["circuits"] == {
        "room_um2": 42 * 64, "closed_um2": 42 * 64, "need_um2": 600, "not_modelled": NOT_PLACED
    }  # fmt: skip
    assert die["light"]["centroid_px"] == found["emitters"]["centroid_px"]
    assert die["light"]["wander_px"] == 0
    values = {each["name"]: each["value"] for each in die["quantities"]}
    assert values["led_footprint"] == found["found_share"]
    for colour, density in die["light"]["density_ma_per_cm2"].items():
        assert density == values[f"current_density_{colour}"] > 0
        assert die["light"]["relative_life"][colour] == values[f"relative_life_{colour}"] > 0


def test_three_squares_that_do_not_fit_are_proved_not_to(capsys, tmp_path):
    """Squares of 24 um, 8 um apart, in six columns by seven rows: one fits across, and two fit along."""
    answer = checked(capsys, display(tmp_path, min_width='"24 um"'))
    assert (answer.code, answer.document["verdict"]) == (1, "fail")
    found = the_display(answer)
    assert (found["verdict"], found["emitters"], found["found_share"]) == ("DOES NOT FIT", None, 0)
    assert [proof["proof"] for proof in found["proofs"]] == ["no three squares"]
    assert answer.document["dies"][0]["light"] is None


def test_more_than_the_closed_area_is_proved_impossible(capsys, tmp_path):
    answer = checked(capsys, display(tmp_path, required="0.5"))
    assert answer.code == 1
    assert the_display(answer)["verdict"] == "DOES NOT FIT"
    assert the_display(answer)["bound_share"] < 0.5
    assert the_display(answer)["proofs"]


def test_circuits_without_room_are_a_proof_too(capsys, tmp_path):
    answer = checked(capsys, display(tmp_path, circuit='"900 um^2"'))
    assert answer.code == 1
    (proof,) = the_display(answer)["proofs"]
    assert proof["proof"] == "circuit area"
    assert proof["numbers"] == {"area_um2": 42 * 64, "closed_um2": 42 * 64, "need_um2": 2700}


@pytest.mark.parametrize(("required", "code"), [(0.0, 0), (0.1, 1)])
def test_not_knowing_fails_only_where_something_is_required(capsys, tmp_path, monkeypatch, required, code):
    judge = feasibility.feasibility

    def unsure(*arguments: Any, **named: Any) -> Any:
        found = judge(*arguments, **named)
        return replace(found, footprint=replace(found.footprint, verdict=Verdict.UNKNOWN))

    monkeypatch.setattr(feasibility, "feasibility", unsure)
    answer = checked(capsys, display(tmp_path, required=str(required)))
    assert the_display(answer)["verdict"] == "UNKNOWN"
    assert answer.code == code


def test_emitters_are_the_largest_whatever_is_required(capsys, tmp_path):
    little, much = (the_display(checked(capsys, display(tmp_path, required=each))) for each in ("0.01", "0.1"))
    assert little["found_share"] == much["found_share"] <= much["bound_share"]
    assert little["emitters"]["areas_um2"] == much["emitters"]["areas_um2"]
    assert little["found_share"] > little["rectangles_share"]


def test_the_widest_gap_fits_and_the_excluded_one_does_not(capsys, tmp_path):
    gap = checked(capsys, display(tmp_path, required="0.1"), "--largest-gap").document["dies"][0]["largest_gap"]
    assert 8 <= gap["found_um"] < gap["excluded_um"] <= 56
    for name, verdict in (("found_um", "FITS"), ("excluded_um", "DOES NOT FIT")):
        at = display(tmp_path, required="0.1", colour_gap=f'"{gap[name]:g} um"')
        assert the_display(checked(capsys, at))["verdict"] == verdict


def test_a_plate_is_made_with_the_display_that_was_checked(capsys, tmp_path):
    rules = "\n".join(f"{k} = {v}" for k, v in RULES.items())
    changes = (("[plate]", f'[emitters]\n{rules}\n\n[export]\nformats = ["gdsii"]\n\n[plate]'),)
    report = json.loads((finished(tmp_path, *changes) / "report.json").read_text(encoding="utf-8"))
    answer = command(capsys, "check", tmp_path / "job.toml", "--json", "--quiet")
    assert answer.document["job_hash"] == report["job_hash"]
    made = {die["name"]: die["display"] for die in report["dies"]}
    assert {die["name"]: die["display"] for die in answer.document["dies"]} == made


# --- what is printed -------------------------------------------------------------------------------------------------


def test_the_text_says_everything_and_nothing_is_written(capsys, tmp_path):
    job = display(tmp_path, required="0.14")
    before = listing(tmp_path)
    answer = command(capsys, "check", job, "--die", "PLAIN", "--largest-gap")
    assert answer.code == 0
    assert "emitters: 1/1" in answer.stderr
    title, *rows = answer.stdout.splitlines()
    assert title == f"PLAIN: FITS: FITS, LOOKS: KEPT, LIVES: KEPT; {BY_AREA}"
    assert rows[-4].split(": ")[:2] == ["FITS", "FITS"]
    assert rows[-3].startswith("LOOKS: KEPT: 1 of 1 keeps them; default limits, for the job states none")
    assert rows[-2].startswith("LIVES: KEPT: 1 of 1 keeps them")
    told = {row[2:18].rstrip(): row[19:] for row in rows}
    assert told.keys() >= {
        "footprint", "rectangles", "areas", "borders", "rules broken", "circuits", "light", "current density",
        "relative life", "widest gap",
    }  # fmt: skip
    assert told["rectangles"] == "14.06 %"
    assert told["footprint"].endswith("required 14.00 %")
    assert told["circuits"] == "2688 um^2 available, 600 um^2 needed (bound, not placed)"
    assert "none is placed, and no gap between circuits and openings" in told["not modelled"]
    assert told["rules broken"].startswith("none")
    assert listing(tmp_path) == before


def test_every_proof_is_printed(capsys, tmp_path):
    job = display(tmp_path, min_width='"24 um"', circuit='"900 um^2"')
    answer = command(capsys, "check", job, "--die", "PLAIN", "--quiet")
    assert (answer.code, answer.stderr) == (1, "")
    proofs = [row for row in answer.stdout.splitlines() if row.startswith("  proof ")]
    assert len(proofs) == 2
    assert "square of 24 um" in proofs[0]
    assert "need 2700 um^2" in proofs[1]


def test_dies_keep_the_order_of_the_plate(capsys, tmp_path):
    job = display(tmp_path)
    answer = command(capsys, "check", job, "--die", "TURNED", "--die", "PLAIN", "--quiet")
    *titles, unused = [row.partition(":")[0] for row in answer.stdout.splitlines() if not row.startswith(" ")]
    assert (titles, unused) == (["PLAIN", "TURNED", "FITS", "LOOKS", "LIVES"], "Not used of the job")
    assert answer.stdout == command(capsys, "check", job, "--quiet").stdout


def test_a_sheet_without_pixels_has_nothing_to_check(capsys, tmp_path):
    job = display(tmp_path)
    job.write_text(job.read_text(encoding="utf-8").replace('"random"', '"hexagonal"'), encoding="utf-8")
    answer = command(capsys, "check", job, "--die", "TURNED", "--quiet", "--largest-gap")
    assert (answer.code, answer.stdout) == (
        0,
        "TURNED: no pixels to place emitters in\nNot used of the job: [camera].\n",
    )
    document = command(capsys, "check", job, "--die", "TURNED", "--quiet", "--json").document
    Draft202012Validator(check_schema()).validate(document)
    assert document["dies"][0]["display"] is None


def test_emitters_that_came_with_the_opening_are_measured(capsys, tmp_path):
    job = display(tmp_path, gap_to_opening='"0 um"', colour_gap='"2 um"', min_width='"2 um"')
    assert command(capsys, "new", tmp_path / "ring.toml", "--shape", "rgb-stripe", "--force").code == 0
    text = job.read_text(encoding="utf-8").replace('dot = "8 um"', 'dot = "2 um"')
    text = text.replace('pitch = "64 um"\ngutter = "8 um"', 'pitch = "84 um"').replace('"56 um"', '"84 um"')
    job.write_text(text, encoding="utf-8")
    found = the_display(checked(capsys, job))
    assert (found["method"], found["verdict"], found["borders"]) == ("given with the opening", "FITS", None)
    assert sum(found["emitters"]["areas_um2"].values()) / 84**2 == pytest.approx(0.2857, abs=1e-4)


# --- what is refused -------------------------------------------------------------------------------------------------


def test_a_job_without_emitters_is_told_how_to_ask_for_them(capsys, tmp_path):
    job = write_job(tmp_path)
    answer = command(capsys, "check", job, "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF105")
    assert "[emitters]" in answer.stderr
    cure = answer.document["error"]["cure"]
    section = cure[cure.index("[emitters]") :]
    assert tomllib.loads(section)["emitters"].keys() >= {"colour_gap", "min_width"}
    job = write_job(tmp_path, ("[plate]", f"{section}\n[plate]"))
    assert command(capsys, "check", job, "--quiet").code in (0, 1)


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"ratio": "[1, 0, 1]"}, "MF116"),
        ({"ratio": "[1, 1]"}, "MF116"),
        ({"ratio": "[1, nan, 1]"}, "MF116"),
        ({"min_width": '"64 um"'}, "MF117"),
        ({"colour_gap": '"57 um"'}, "MF117"),
        ({"gap_to_opening": '"1 mm"'}, "MF117"),
        ({"min_width": '"8.1 um"'}, "MF118"),
        ({"colour_gap": '"8.0001 um"'}, "MF107"),
        ({"min_width": '"0 um"'}, "MF104"),
        ({"colour_gap": "8"}, "MF103"),
        ({"circuit": '"200 um"'}, "MF103"),
        ({"nonsense": "1"}, "MF102"),
    ],
)
def test_bad_rules_are_refused_with_their_code(capsys, tmp_path, changed, code):
    answer = command(capsys, "check", display(tmp_path, **changed), "--json", "--quiet")
    assert answer.code == 2
    error = answer.document["error"]
    assert error["code"] == code
    assert "emitters" in error["where"]
    assert error["cure"]
    assert "Traceback" not in answer.stderr


def test_a_die_that_is_not_there_is_refused(capsys, tmp_path):
    answer = command(capsys, "check", display(tmp_path), "--die", "PLAIN", "--die", "NOBODY", "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF105")
    assert "PLAIN, TURNED" in answer.document["error"]["cure"]


def test_the_schema_refuses_what_it_does_not_know(capsys, tmp_path):
    document = checked(capsys, display(tmp_path)).document
    rules = Draft202012Validator(check_schema())
    assert rules.is_valid(document)
    for part in (document, document["dies"][0], document["dies"][0]["light"]):
        part["surplus"] = 1
        assert not rules.is_valid(document)
        del part["surplus"]
