"""Limits of the eye and of life: defaults and stated ones, lives by hand, the reference die, and what is refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from small_job import command, write_job

from maskfab.base.errors import JobError
from maskfab.base.model import Tiling
from maskfab.display.drive import LightDemand, current_density, lives
from maskfab.display.emitter_rules import EmitterRules, Verdict
from maskfab.display.eye_and_life import DEFAULT_LIFE, EyeAndLife, Judgement, Limited, judgement, kept
from maskfab.job.sections import LivesSection, LooksSection
from maskfab.mask.job import load_job
from maskfab.report.documents.display import check_schema
from maskfab.report.verdicts import Verdicts

LIGHT = LightDemand()
OPENING = 'name = "column"\npitch = "56 um"\ndots = 7\ngrid = """\n' + "......#\n" * 7 + '"""\n'
EMITTERS = '[emitters]\ncolour_gap = "4 um"\nmin_width = "8 um"\ncircuit = "200 um^2"\n'


def job(tmp_path: Path, more: str = "", *edits: tuple[str, str]) -> Path:
    return write_job(tmp_path, ("[plate]", f"{EMITTERS}\n{more}\n\n[plate]"), *edits, opening=OPENING)


# Lives.


def test_lives_by_hand():
    found = lives(LIGHT, (0.1, 0.12, 0.1), (0.2, 0.2, 0.2))
    assert found.luminance == pytest.approx(0.5)
    # Blue carries most current for its area in both: J = 500 cd/m² x .0722 / (8 cd/A x area), in mA/cm².
    own, usual = (0.1 * 500 * LIGHT.shares[2] / (8 * area) for area in (0.1, 0.2))
    assert own == pytest.approx(max(current_density(LIGHT, (0.1, 0.12, 0.1))))
    assert found.life == pytest.approx(0.5**1.44)
    assert found.power == pytest.approx((5 + 1.5 * math.sqrt(own / 10)) / (5 + 1.5 * math.sqrt(usual / 10)))


def test_the_shortest_lived_colour_may_be_another_one_than_the_references():
    # Red of a fifth of its area is denser than blue: s / η is .2126 / 45 and .0722 / 8.
    found = lives(LIGHT, (0.04, 0.2, 0.2), (0.2, 0.2, 0.2))
    assert found.luminance == pytest.approx(0.2)
    assert found.life == pytest.approx(((LIGHT.shares[0] / 45 / 0.04) / (LIGHT.shares[2] / 8 / 0.2)) ** -1.44)


AREA = st.floats(0.01, 0.33)


@given(own=st.tuples(AREA, AREA, AREA), usual=st.tuples(AREA, AREA, AREA))
def test_two_displays_are_each_others_references(own, usual):
    there, back = lives(LIGHT, own, usual), lives(LIGHT, usual, own)
    assert there.life * back.life == pytest.approx(1)
    assert there.power * back.power == pytest.approx(1)
    assert there.luminance * back.luminance <= 1 + 1e-12
    assert (there.life > 1) == (there.power < 1) or there.life == pytest.approx(1)


# Limits.


def judged(panel, **stated) -> Judgement:
    looks = {key: value for key, value in stated.items() if key in LooksSection.model_fields}
    rest = {key: value for key, value in stated.items() if key not in looks}
    asked = EyeAndLife.of(LooksSection(**looks), LivesSection(**rest))
    return judgement(panel, asked, EmitterRules(2000, 2016, 2016), LIGHT)


def number(of: Judgement, name: str) -> Limited:
    return next(one for one in (*of.looks, *of.lives) if one.name == name)


def test_defaults_judge_and_fail_nothing(slit_panel):
    found = judged(slit_panel((3, 1, 2), count=40))
    grain, fringe, life = (number(found, name) for name in ("grain", "fringe", "life"))
    assert (grain.limit, grain.stated, grain.passed) == (0.015, False, False)
    assert "SEMI D31" in grain.source
    assert (fringe.limit, fringe.passed) == (None, None)
    assert (life.limit, life.stated, life.passed) == (DEFAULT_LIFE, False, life.value >= DEFAULT_LIFE)
    assert number(found, "delta_e").limit == 2.3
    assert not kept(found.looks)
    assert found.passed


@pytest.mark.parametrize(("name", "better"), [("life", 0.1), ("grain", -0.1)])
def test_a_number_at_its_limit_keeps_it(name, better):
    at = Limited(name, 0.5, None, 0.5, stated=True, source="")
    assert [replace(at, value=0.5 + more).passed for more in (better, 0.0, -better)] == [True, True, False]


@pytest.mark.parametrize(
    ("stated", "name"),
    [
        ({"delta_e": 0.01}, "delta_e"),
        ({"grain": 0.001}, "grain"),
        ({"fringe": 1.0}, "fringe"),
        ({"life": 100.0}, "life"),
        ({"power": 0.5}, "power"),
    ],
)
def test_a_limit_that_is_stated_can_be_broken(slit_panel, stated, name):
    found = judged(slit_panel((3, 1, 2), count=40), **stated)
    assert (number(found, name).stated, number(found, name).passed) == (True, False)
    assert not found.passed


def test_a_stated_limit_takes_the_place_of_the_default(slit_panel):
    found = judged(slit_panel((3, 1, 2), count=40), delta_e=5.0, grain=1.0, life=1e-6)
    assert kept(found.looks)
    assert kept(found.lives)


def test_the_display_is_seen_scaled_to_the_stated_resolution(slit_panel):
    panel = slit_panel((3, 1, 2), count=40)
    own, coarse = judged(panel), judged(panel, dpi=150)
    assert coarse.seen_pitch_um == pytest.approx(25400 / 150)
    assert number(coarse, "delta_e").value > 2 * number(own, "delta_e").value
    # Areas are those of the display as it is built.
    assert [one.value for one in coarse.lives] == [one.value for one in own.lives]


def test_a_reference_that_nobody_asked_for_may_find_no_room(make_panel):
    """Pixels too small for the regular layout are looked at, without anything beside them."""
    import numpy as np

    labels = np.zeros((6, 6), dtype=np.int8)
    labels[0, 0], labels[0, 4], labels[4, 0] = 1, 2, 3
    panel = make_panel(np.zeros((6, 6), dtype=np.bool_), labels, 4000, count=10, tiling=Tiling.PERIODIC)
    rules = EmitterRules(0, 8000, 4000)
    found = judgement(panel, EyeAndLife.of(None, None), rules, LIGHT)
    assert (found.reference_shares, found.lives) == (None, ())
    assert {one.reference for one in found.looks} == {None}
    with pytest.raises(JobError, match=r"MF117 stripe at a pitch of 24 um .*looks\.reference"):
        judgement(panel, EyeAndLife.of(LooksSection(), None), rules, LIGHT)


# Verdicts.


def answer(verdict: Verdict, *, looks: bool = True, lives: bool = True, stated: bool = False) -> SimpleNamespace:
    own = [
        Limited(name, 1.0, None, 2.0 if good else 0.5, stated, "")
        for name, good in (("delta_e", looks), ("power", lives))
    ]
    shown = Judgement("stripe", None, (own[0],), (own[1],), (1, 1), False, 3e5, 100.0)
    return SimpleNamespace(verdict=verdict, circuits_by="by area", judged=shown)


def test_verdicts_leave_out_the_reference_and_tell_of_it():
    displays = {
        "NOW": answer(Verdict.DOES_NOT_FIT, looks=False),
        "A": answer(Verdict.FITS),
        "B": answer(Verdict.FITS, lives=False),
    }
    found = Verdicts.of([], displays, 3, "NOW")
    assert found.lines[2:] == (
        "FITS: FITS: 2 of 2 fit; by area; the reference NOW: DOES NOT FIT",
        "LOOKS: KEPT: 2 of 2 keep them; default limits, for the job states none; the reference NOW: BROKEN",
        "LIVES: BROKEN: 1 of 2 keeps them: power at equal luminance; default limits, for the job states none; "
        "the reference NOW: KEPT",
    )
    assert found.to_dict()["lives"] == {"dies": 2, "kept": 1, "broken": 1, "verdict": "BROKEN", "stated": False}


def test_a_reference_that_is_alone_is_judged():
    found = Verdicts.of([], {"NOW": answer(Verdict.FITS, looks=False, stated=True)}, 1, "NOW")
    assert found.lines[3] == "LOOKS: BROKEN: 0 of 1 keep them: ΔE of even white; limits of the job"


def test_a_broken_default_is_called_so_among_limits_that_the_job_states():
    shown = answer(Verdict.FITS, looks=False)
    (broken,) = shown.judged.looks
    both = (broken, replace(broken, name="grain", stated=True))
    shown.judged = replace(shown.judged, looks=both)
    found = Verdicts.of([], {"A": shown}, 1)
    assert found.lines[3] == (
        f"LOOKS: BROKEN: 0 of 1 keep them: {both[0].title} (a default), {both[1].title}; limits of the job"
    )


def test_files_can_be_ordered_where_a_house_was_asked():
    passed = replace(_check("polygons"), passed=True)
    assert Verdicts.of([passed], {}, 1).lines[0].startswith("FILES: PASS, files check; no mask house chosen")
    asked = [passed, replace(_check("shop_grid"), passed=True)]
    assert Verdicts.of(asked, {}, 1).lines[0].startswith("FILES: PASS, can be ordered")


def _check(name: str):
    from maskfab.base.model import Quantity

    return Quantity(name, 1.0, "measured", detail="um" if name.startswith("shop_") else None)


# Jobs.


@pytest.mark.parametrize(
    ("more", "code"),
    [
        ("[looks]\ndistance = 300\n", "MF103"),
        ("[looks]\ndelta_e = 0\n", "MF104"),
        ("[looks]\ngrain = -0.1\n", "MF104"),
        ("[looks]\ndpi = 1\n", "MF104"),
        ('[looks]\nreference = "mosaic"\n', "MF105"),
        ("[lives]\nlife = 0\n", "MF104"),
        ("[lives]\npower = -1\n", "MF104"),
        ("[lives]\nyears = 10\n", "MF102"),
        ("[eye]\ndelta_e = 1\n", "MF102"),
    ],
)
def test_limits_that_cannot_be_are_refused(capsys, tmp_path, more, code):
    done = command(capsys, "check", job(tmp_path, more), "--quiet")
    assert (done.code, done.stdout) == (2, "")
    assert code in done.stderr


@pytest.mark.parametrize("verb", [("check",), ("check", "--look"), ("run", "--out", "OUT")])
def test_a_reference_without_room_is_refused_before_any_work(capsys, tmp_path, verb):
    # Three stripes of 8 um and their gaps of 12 um need 60 um.
    path = job(tmp_path, "[looks]\n", ('colour_gap = "4 um"', 'colour_gap = "12 um"'))
    verb = tuple(str(tmp_path / "out") if word == "OUT" else word for word in verb)
    done = command(capsys, *verb, path, "--quiet")
    assert done.code == 2
    assert "MF117 stripe at a pitch of 56 um with colour_gap = 12 um" in done.stderr
    assert not (tmp_path / "out").exists()


def test_an_eye_that_is_too_near_is_refused_before_emitters_are_searched(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("maskfab.display.feasibility.feasibility", lambda *_: pytest.fail("worked on"))
    done = command(capsys, "check", job(tmp_path, '[looks]\ndistance = "10 mm"\ndpi = 10\n'), "--quiet")
    assert done.code == 2
    assert "MF115 from 10 mm the eye resolves 1721 x 1721 parts of a pixel" in done.stderr


def test_a_broken_limit_of_the_job_fails_the_check_of_all_but_the_reference(capsys, tmp_path):
    path = job(tmp_path, '[looks]\ndelta_e = 1e-6\nreference = "stripe"\n')
    done = command(capsys, "check", path, "--json", "--quiet")
    Draft202012Validator(check_schema()).validate(done.document)
    assert (done.code, done.document["verdict"]) == (1, "fail")
    by_die = {die["name"]: die for die in done.document["dies"]}
    rows = {
        name: next(row for row in die["quantities"] if row["name"] == "flat_delta_e_mean")
        for name, die in by_die.items()
    }
    assert (rows["PLAIN"]["passed"], rows["TURNED"]["passed"]) == (True, False)
    looks = by_die["TURNED"]["display"]["looks"]
    assert looks["verdict"] == "BROKEN"
    first = looks["numbers"][0]
    assert {key: first[key] for key in ("name", "limit", "stated", "passed", "unit")} == {
        "name": "delta_e",
        "limit": 1e-6,
        "stated": True,
        "passed": False,
        "unit": "1",
    }
    assert by_die["TURNED"]["display"]["reference"]["layout"] == "stripe"
    # Of the other as reference, this one is judged, and repeats: nothing is seen of it.
    other = command(
        capsys, "check", job(tmp_path, '[looks]\ndelta_e = 1e-6\n\n[report]\nreference = "TURNED"\n'), "--quiet"
    )
    assert other.code == 0
    assert "LOOKS: KEPT: 1 of 1 keeps them; limits of the job; the reference TURNED: BROKEN" in other.stdout
    assert "[report]" not in other.stdout
    # By itself it is judged.
    alone = command(capsys, "check", tmp_path / "job.toml", "--die", "TURNED", "--quiet")
    assert alone.code == 1
    assert "LOOKS: BROKEN: 0 of 1 keep them: ΔE of even white; limits of the job\n" in alone.stdout


@pytest.mark.usefixtures("drawn_in_words", "read_here")
def test_a_run_tells_five_verdicts_and_fails_by_stated_limits_alone(capsys, tmp_path):
    done = command(capsys, "run", job(tmp_path, "[lives]\npower = 0.01\n"), "--out", tmp_path / "out", "--quiet")
    assert done.code == 1
    words = [line.partition(":")[0] for line in done.stderr.splitlines()[-5:]]
    assert words == ["FILES", "OPTICS", "FITS", "LOOKS", "LIVES"]
    assert "FAIL reference_power [TURNED]" in done.stderr
    assert "FAIL reference_power [PLAIN]" not in done.stderr
    rows = {
        row["name"]: row for row in json.loads((tmp_path / "out" / "report.json").read_text())["dies"][0]["quantities"]
    }
    assert rows["reference_power"]["passed"] is None
    assert "not held against the reference die" in rows["reference_power"]["method"]
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert report["verdicts"]["lives"] == {"dies": 1, "kept": 0, "broken": 1, "verdict": "BROKEN", "stated": True}
    assert report["verdicts"]["looks"]["stated"] is False
    verified = command(capsys, "verify", tmp_path / "out", "--quiet")
    assert verified.stderr.splitlines()[-1] == done.stderr.splitlines()[-1]
    assert "reported" not in verified.stderr


@pytest.mark.usefixtures("drawn_in_words", "read_here")
def test_limits_of_a_job_without_emitters_are_named_as_not_used(capsys, tmp_path):
    path = write_job(tmp_path, ("[plate]", "[looks]\ndelta_e = 1.0\n\n[lives]\nlife = 0.5\n\n[plate]"))
    done = command(capsys, "run", path, "--out", tmp_path / "out", "--quiet")
    assert done.code == 0
    assert "unused_keys = [looks], [lives]" in done.stderr


def test_a_display_is_looked_at_where_its_map_is(tmp_path):
    from maskfab.display.feasibility import map_sizes

    text = 'name = "small"\nmap = """\n01\n23\n45\n"""\n'
    (tmp_path / "small.toml").write_text(text, encoding="utf-8")
    path = job(tmp_path, "", ('tiling = "random"\nseed = 3', 'tiling = "map"\nmap = "small.toml"\nseed = 3'))
    assert map_sizes(load_job(path)) == {"TURNED": (3, 2)}
