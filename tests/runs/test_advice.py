"""Advice on a display: one page that answers six questions, a job of the same plate, and when not to build it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from html import unescape

import numpy as np
import pytest
from browser import faults
from once import leaves

import maskfab as mf
from maskfab.api import advising
from maskfab.base import workers
from maskfab.base.errors import JobError, OutputError
from maskfab.base.model import Tiling
from maskfab.base.work import Clock
from maskfab.cli.program import run_command_line
from maskfab.designs.search import held
from maskfab.designs.search.share import ShareCurve, SharePoint
from maskfab.display.eye_and_life import Limited
from maskfab.findings import photographs
from maskfab.job.read import read
from maskfab.job.sections import SceneSection
from maskfab.mask.job import resolve
from maskfab.report.pages import advice as page_of_advice
from maskfab.report.pages.advice import NOTE_CHARACTERS, WORTH_DB, AdvicePart, advice_document, schema
from maskfab.runs import advice
from maskfab.runs.advice import job_files, off_axis

JOB = """
[job]
name = "TINY"
title = "TINY"

[design]
name = "tiny"
dots = 11
pitch = "88 um"
clear_dots = 25
families = ["bars"]
shortlist = 1
map = "equal_light"
fit = true
output = "tiny.toml"
map_output = "tiny_map.toml"

[camera]
focal = "5 mm"
stop = { diameter = "800 um" }
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"
window = "128 um"

[exposure]
white = 1600

[plate]
template = "5in"
die_size = "1760 um"
die_pitch = "22 mm"
columns = 2

[emitters]
required = 0.08
colour_gap = "8 um"
min_width = "8 um"
circuit = "100 um^2"

[wires]
lines = 2

[[die]]
name = "AS_IS"
label = "plain slits"
opening = "slit.toml"
dot = "8 um"
tiling = "periodic"

[pareto]
clear_dots = [25]
"""
SLIT = 'name = "{name}"\npitch = "88 um"\ndots = 11\ngrid = """\n{grid}\n"""\n'
WITHOUT_MAP = ('map = "equal_light"\n', ""), ('map_output = "tiny_map.toml"\n', "")
"""Edits that take away what most of a design's time goes into."""
QUESTIONS = ["build", "photographs", "costs", "houses", "others", "when_not"]
NO_END = "20 min"
"""A budget that cuts nothing, however busy the machine."""


def write(folder, *edits):
    text = JOB
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "tiny.toml"
    path.write_text(text, encoding="utf-8")
    for name, row in (("slit", "....##....."), ("wide", ".##########")):
        grid = "\n".join(["." * 11, *[row] * 10])
        (folder / f"{name}.toml").write_text(SLIT.format(name=name, grid=grid), encoding="utf-8")
    return path


@pytest.fixture(scope="module", autouse=True)
def four_small_scenes():
    """As many scenes as a run takes, a sixth as large, and few openings tried, by this process, which alone knows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photographs, "drawn_scenes", lambda **_: tuple(leaves(seed, 704, 768) for seed in range(1, 5)))
        patch.setattr(workers, "cores", lambda: 1)
        patch.setattr(advice, "_DENSER_S", 3600.0)
        for tried in ("_TRIED", "_TRIED_OF_FEWER"):
            patch.setattr(held, tried, 4)
        for judged in ("MOST_JUDGED", "_JUDGED_OF_FEWER"):
            patch.setattr(held, judged, 60)
        yield


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    """Without finer dots, which take most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(advice, "_MOST_DOTS", 11)
        return mf.advise(write(tmp_path_factory.mktemp("job")), budget=NO_END)


@pytest.fixture(scope="module")
def answer_with_finer_dots(tmp_path_factory):
    return mf.advise(write(tmp_path_factory.mktemp("job")), budget=NO_END)


@pytest.fixture(scope="module")
def folder(answer, tmp_path_factory):
    out = tmp_path_factory.mktemp("answer") / "out"
    answer.save(out)
    return out


@pytest.fixture
def alone(monkeypatch):
    """No mask houses, no larger openings, and no search under limits of the eye, which take most of the time."""
    monkeypatch.setattr(advice, "_UNDER_S", 3600.0)
    monkeypatch.setattr(advice, "compare_shops", lambda *_: ())
    monkeypatch.setattr(advice, "reaches", lambda *_: ())


def rows_of(document, key):
    return {row["name"]: row for answer in document["answers"] if answer["key"] == key for row in answer["rows"]}


def test_six_questions_are_answered_with_units_and_errors(answer, folder):
    document = json.loads((folder / "advice.json").read_text())
    assert document == json.loads(json.dumps(answer.to_dict()))
    AdvicePart.model_validate(document)
    assert set(schema()["required"]) == set(document)
    assert [each["key"] for each in document["answers"]] == QUESTIONS
    for each in document["answers"]:
        assert each["sentence"].endswith(".")
        assert each["rows"], each["key"]
        for row in each["rows"]:
            assert row["how"] or each["method"] or row["name"] in each["sentence"], row
            assert row["unit"] or not isinstance(row["value"], float), row
    assert document["build"] is True
    assert document["why_not"] == []
    taken = rows_of(document, "photographs")
    gain = next(row for name, row in taken.items() if name == "gain at 32 dB of light")
    assert gain["value"] - gain["error"] > WORTH_DB
    assert f"{gain['value']:.1f} ± {gain['error']:.1f} dB" in document["verdict"]
    assert [name for name in taken if name.startswith("gain")] == ["gain at 21.4 dB of light", gain["name"]]
    assert any("[pareto]" in note for note in document["left_out"])


def test_the_headline_says_what_the_opening_brings_and_what_turning_it_does(answer):
    document = answer.to_dict()
    build = next(told for told in document["answers"] if told["key"] == "build")
    whole, turned, by_map, own = map(float, re.findall(r"[-+]\d+\.\d", build["sentence"].partition("Of the ")[2]))
    assert round(turned + by_map + own, 1) == whole == round(answer.found.gain(answer.found.level_db).mean, 1)
    rows = rows_of(document, "build")
    mapped, random = (rows[f"gain by cells turned {way}"]["value"] for way in ("by their map", "at random"))
    assert mapped - random == pytest.approx(answer.found.designed.designed.gain_db[answer.found.at])
    assert "in dots of 8 µm" in build["method"]


def fitting(answer):
    return [point for point in answer.found.curve.points if point.shape]


def test_what_else_there_is_was_computed(answer):
    rows = rows_of(answer.to_dict(), "others")
    curve = answer.found.curve
    gains = [row["value"] for name, row in rows.items() if name.startswith("gain at")]
    assert max(gains) == pytest.approx(max(curve.gain_db(point) for point in curve.points if point.shape))
    assert max(gains) - gains[0] > 1
    assert rows["gain by emitters of 2% of the pixel less"]["value"] > 0
    assert rows["gain by more light in the middle of the stop"]["value"] is None
    assert "--budget" in rows["gain by more light in the middle of the stop"]["how"]


def test_the_answer_names_what_decided_it(answer):
    document = answer.to_dict()
    assert document["verdict"].startswith("Build this, 21% of the pixel clear, as stated, and 289 ppi of circuits")
    first = next(iter(rows_of(document, "costs").values()))
    assert (first["name"], first["unit"]) == ("local resolution", "ppi")
    assert first["value"] == pytest.approx(25400 / 88)
    assert "counted by area, not placed" in first["how"]
    costs = next(each for each in document["answers"] if each["key"] == "costs")
    assert costs["sentence"].startswith("289 ppi of circuits over the camera")
    others = next(each for each in document["answers"] if each["key"] == "others")
    assert "the rule's choice beside what the job states" in others["sentence"]
    assert not any(row["how"].startswith("chosen") for row in others["rows"])
    assert any(row["how"].startswith("the rule's choice") for row in others["rows"])


def curve_of(*points):
    """A curve whose points have so many dots, pixels to a circuit, and restored photographs; broken ones are grainy."""
    grain = Limited("grain", 2.0, None, 1.0, False, "")
    return ShareCurve(
        tuple(
            SharePoint(dots, 11, sharing, 1, "bar", psnr, numbers=(grain,) * broken)
            for dots, sharing, psnr, broken in points
        )
    )


def test_pixels_to_a_circuit_that_are_chosen_beside_a_stated_share_are_told(tmp_path):
    spec = read(write(tmp_path, ("[wires]", "[display]\n[wires]")))
    curve = curve_of((25, 4, 20.0, False), (36, 4, 21.0, False))
    job, section, stated, notes = advice._as_stated(spec, spec, curve, 25)
    assert (job.display.sharing, section.clear_dots, stated) == (4, 25, True)
    assert any("4 pixels to a circuit was chosen" in note for note in notes)


def test_the_chosen_point_has_a_row_though_one_that_breaks_a_limit_restores_more():
    curve = curve_of((25, 1, 21.0, True), (25, 4, 20.5, False))
    assert curve.best in page_of_advice._points(curve)


def test_a_point_that_is_laid_as_it_is_keeps_its_name(tmp_path, monkeypatch):
    @dataclass
    class Found:
        shape: str

    monkeypatch.setattr(advice._Work, "_design", lambda *_, **__: Found("start"))
    work = advice._Work(None, read(write(tmp_path)).design, *[None] * 7)
    point = replace(curve_of((25, 1, 20.0, False)).points[0], unit=np.ones((11, 11), dtype=np.bool_))
    assert work.of_point(point).shape == "bar"


@pytest.mark.usefixtures("alone")
def test_a_share_that_is_not_stated_is_chosen_and_so_are_pixels_to_a_circuit(tmp_path):
    boxes = '[[circuits.boxes]]\nname = "all"\nwidth = "40 um"\nheight = "24 um"\n\n[display]\nnormal = "88 um"\n\n'
    edits = ("clear_dots = 25\nfam", "fam"), ("[wires]", boxes + "[wires]")
    found = mf.advise(write(tmp_path, *edits, *WITHOUT_MAP), budget=NO_END)
    curve, display, spec = found.found.curve, found.found.display, found.found.job.spec
    best = curve.best
    assert spec.design.clear_dots == found.found.designed.opening.clear_dots == best.clear_dots > 12
    assert spec.display.sharing == best.sharing == display.zone.sharing
    assert display.resolution_ppi == pytest.approx(25400 / 88 / best.sharing**0.5)
    assert f"{best.share:.0%} of the pixel clear, chosen" in found.verdict
    assert f"sharing = {best.sharing}" in job_files(found.found.job)["job.toml"]
    assert any(note == curve.told for note in found.to_dict()["left_out"])


@pytest.mark.usefixtures("alone")
def test_a_stated_share_that_gains_nothing_gives_way_to_one_that_does(tmp_path):
    found = mf.advise(write(tmp_path, ("clear_dots = 25\nfam", "clear_dots = 6\nfam"), *WITHOUT_MAP), budget=NO_END)
    curve = found.found.curve
    (stated,) = {point.clear_dots: point for point in curve.points if point.clear_dots == 6}.values()
    assert curve.gain_db(stated) < WORTH_DB < curve.gain_db(curve.best)
    assert found.found.designed.opening.clear_dots == curve.best.clear_dots
    assert any("5% that the job states" in note for note in found.found.notes)


@pytest.mark.slow
def test_finer_dots_leave_room_for_more(answer_with_finer_dots):
    rows = rows_of(answer_with_finer_dots.to_dict(), "others")
    largest = fitting(answer_with_finer_dots)[-1]
    assert int(rows["gain by dots of 4 µm"]["how"].split()[0]) > 4 * largest.clear_dots


def test_the_largest_opening_is_one_that_a_design_finds(answer, tmp_path):
    most = fitting(answer)[-1].clear_dots
    job = write(tmp_path, ("clear_dots = 25\nfam", f"clear_dots = {most}\nfam"))
    found = mf.design(job)
    assert found.passed
    assert found.found.fit is not None


@pytest.mark.usefixtures("drawn_in_words")
def test_the_job_that_is_written_makes_the_photographs_of_the_page(answer, folder, tmp_path):
    report = mf.run(folder / "job.toml", out=tmp_path / "out")
    document = answer.to_dict()
    gain = next(row for row in rows_of(document, "photographs").values() if row["name"] == "gain at 32 dB of light")
    assert report["TINY"]["restored_gain"].value == pytest.approx(gain["value"], abs=1e-9)
    assert report["TINY"]["restored_gain"].uncertainty == pytest.approx(gain["error"], abs=1e-9)
    assert json.loads((tmp_path / "out" / "report.json").read_text())["job_hash"] == document["job_hash"]
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        [*document["files"], "advice.html", "advice.json", "manifest.json"]
    )


def test_the_page_is_one_sheet_and_needs_nothing_else(answer, folder, chromium):
    page = (folder / "advice.html").read_text()
    assert answer.verdict in page.replace("&#39;", "'")
    assert page.count("photograph'") + page.count('class="photograph"') >= 3
    assert not re.search(r"(src|href)=.?https?:", page)
    assert answer._repr_html_() == page
    paper = chromium.printed(folder / "advice.html")
    assert len(re.findall(rb"/Type\s*/Page[^s]", paper)) == 1


def test_long_notes_stand_once_below_their_table_and_every_table_scrolls(answer, folder):
    page = unescape((folder / "advice.html").read_text())
    beside = re.findall(r'<td class="how">(.*?)</td>', page)
    assert max(map(len, beside)) <= NOTE_CHARACTERS
    for told in answer.to_dict()["answers"]:
        section = page[page.index(f'<section id="{told["key"]}">') :].partition("</section>")[0]
        long = {row["how"] for row in told["rows"] if len(row["how"]) > NOTE_CHARACTERS}
        assert sorted(re.findall(r"<li>(.*?)</li>", section)) == sorted(long)
        numbers = re.findall(r"<sup>(\d+)</sup>", section)
        assert len(numbers) == sum(row["how"] in long for row in told["rows"])
        assert set(numbers) == {str(number) for number in range(1, len(long) + 1)}
        assert section.count("<table") == section.count('<div class="scroll"><table') == 1
    # A telephone gets one column.
    assert re.search(
        r"@media screen and \(max-width: 760px\) \{ \.two \{ grid-template-columns: minmax\(0, 1fr\)", page
    )


def test_a_photograph_that_a_reader_can_judge_stands_beside_the_drawn_scenes(answer, folder):
    page = unescape((folder / "advice.html").read_text())
    assert re.search(
        r"A photograph at 32 dB of light, in no mean: [-+]\d+\.\d dB\. Grace Hopper by the U\.S\. Navy, in the public",
        page,
    )
    before, after = map(float, re.findall(r"restored, (\d+\.\d\d) dB", page)[2:4])
    told = float(re.search(r"in no mean: ([-+]\d+\.\d) dB", page)[1])
    assert told == pytest.approx(after - before, abs=0.06)
    assert page.count('class="photograph"') + page.count("class='photograph'") == 6


def test_no_photograph_is_no_fault(answer, monkeypatch):
    monkeypatch.setattr(page_of_advice, "portrait", lambda: None)
    assert "portrait_told" not in page_of_advice.pictures(answer.found)


def test_a_scene_that_takes_its_time_gets_no_photograph_more(answer):
    job = answer.found.job
    seen = replace(job, spec=job.spec.model_copy(update={"scene": SceneSection()}))
    assert "portrait_told" not in page_of_advice.pictures(replace(answer.found, job=seen))


def test_the_verdict_says_what_it_is_no_verdict_on(answer):
    (told,) = answer.to_dict()["caveats"]
    assert (
        told == "judged with the display at the lens and along the axis alone, for [scene] states no gap and no field"
    )
    assert str(answer).lower().count(told) == 1
    assert answer._repr_html_().lower().count(told) == 1


@pytest.mark.parametrize(
    ("field", "rows", "said"),
    [
        (None, {"diffraction over the gap"}, "a gap of 0.5 mm is not modelled, which changes"),
        (
            "10 deg",
            {"diffraction over the gap", "shift through the gap", "oblique light"},
            "and a field of 10 deg are not",
        ),
        (200.0, {"diffraction over the gap", "shift through the gap"}, "and a field of 0.2 mm are not modelled"),
        ("80 deg", set(), "by how much that tells is not known: "),
    ],
)
def test_gap_and_field_are_told_as_the_check_estimates_them(answer, field, rows, said):
    found = answer.found
    caveat = off_axis(found.job, found.name, 500.0, field)
    assert said in caveat
    told = dict(re.findall(r"(\S+) \(([^)]+)\)", caveat))
    assert rows <= set(told.values())
    hurried = off_axis(found.job, found.name, 500.0, field, Clock(0.0))
    assert caveat.partition(" not modelled")[0] == hurried.partition(" not modelled")[0]
    assert "--optics tells what that changes" in hurried
    document = advice_document(replace(found, notes=(*found.notes, caveat)), "maskfab advise", [])
    assert document["caveats"] == [caveat]
    assert caveat not in document["left_out"]


def test_a_reference_that_does_not_fit_is_said_to_be_none(answer, tmp_path):
    def told(found):
        return advice_document(found, "maskfab advise", [])["answers"][1]["sentence"]

    assert "But plain slits could not be built: by the job's rules, " in told(answer.found)
    small = read(write(tmp_path, ('opening = "slit.toml"', 'opening = "small.toml"')))
    grid = "\n".join(["....##....."] * 2 + ["." * 11] * 9)
    (tmp_path / "small.toml").write_text(SLIT.format(name="small", grid=grid), encoding="utf-8")
    spec = answer.found.job.spec
    job = resolve(spec.model_copy(update={"die": (small.die[0], *spec.die[1:])}), tmp_path / "tiny.toml")
    assert "could not be built" not in told(replace(answer.found, job=job))


def test_a_reference_has_the_lines_of_its_own_pixels_where_those_of_the_design_are_wider(answer, tmp_path):
    """Twice as many lines pass a pixel beside which others are left out."""
    edits = ('opening = "slit.toml"', 'opening = "small.toml"'), ("[wires]", '[display]\nnormal = "88 um"\n[wires]')
    small = read(write(tmp_path, *edits, ("lines = 2", "lines = 16")))
    grid = "\n".join(["....##....."] * 2 + ["." * 11] * 9)
    (tmp_path / "small.toml").write_text(SLIT.format(name="small", grid=grid), encoding="utf-8")
    spec = answer.found.job.spec
    for dot_um, fits in ((8.0, False), (16.0, True)):
        dies = small.die[0], spec.die[1].model_copy(update={"dot": dot_um, "tiling": Tiling.PERIODIC, "map": None})
        parts = {"die": dies, "display": small.display, "wires": small.wires}
        job = resolve(spec.model_copy(update=parts), tmp_path / "tiny.toml")
        found = replace(answer.found, job=job)
        sentence = advice_document(found, "maskfab advise", [])["answers"][1]["sentence"]
        assert ("could not be built" in sentence) == (not fits)


def test_limits_that_the_point_of_the_curve_keeps_are_not_told_as_broken(monkeypatch):
    first, point = (advice._Laid(name, None, name) for name in ("searched", "of the curve"))
    monkeypatch.setattr(advice, "_limits", lambda built: ({}, ["slow grain"] if built == "searched" else []))
    monkeypatch.setattr(advice, "laid_db", {"searched": 20.0, "of the curve": 19.5}.get)
    monkeypatch.setattr(advice._Work, "under", lambda *_: ("searched", "--budget '3 min' looks for one"))
    monkeypatch.setattr(advice._Work, "of_point", lambda *_: "of the curve")
    monkeypatch.setattr(advice._Work, "laid", lambda _, designed: point)
    held = advice._Work(*[None] * 9).within_limits(first, None)
    assert (held.designed, held.cost_db) == ("of the curve", 0.5)
    assert "breaks slow grain, and the curve's own opening does not" in held.unkept


def test_the_page_opens_anywhere_and_runs_nothing(browser, folder):
    assert faults(browser, folder / "advice.html") == []
    assert browser.run("return document.scripts.length") == 0


def test_words_for_a_terminal_say_what_the_page_says(answer):
    text = str(answer)
    assert text.startswith(answer.verdict)
    for each in answer.to_dict()["answers"]:
        assert f"{each['question']}: {each['sentence']}" in text


ONE_PROCESSOR = "import os; os.sched_getaffinity = lambda _: {0}\n"
COMMAND = "import sys; from maskfab.cli.program import run_command_line; sys.exit(run_command_line(sys.argv[1:]))"


@pytest.mark.slow
def test_one_process_finds_what_two_find(tmp_path):
    found = []
    for first in ("", ONE_PROCESSOR):
        words = [sys.executable, "-c", first + COMMAND, "advise", str(write(tmp_path)), "--budget", NO_END, "--json"]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        found.append({**json.loads(done.stdout), "time": None})
    assert found[0] == found[1]


@pytest.mark.usefixtures("alone")
def test_too_little_light_is_told_from_blur(tmp_path):
    edits = ("white = 1600", "white = 30"), ('opening = "slit.toml"', 'opening = "wide.toml"')
    found = mf.advise(write(tmp_path, *edits, *WITHOUT_MAP), budget=NO_END)
    document = found.to_dict()
    assert not found.build
    assert "at 12.2 dB of light photographs gain -" in found.verdict
    assert "starved of light, not blurred" in found.verdict
    ideal = rows_of(document, "when_not")["gain by a clear stop of as much light"]
    assert ideal["value"] < WORTH_DB
    assert document["answers"][0]["question"] != "Build this"
    assert "[[die]]" in job_files(found.found.job)["job.toml"]


@pytest.mark.usefixtures("alone")
def test_a_display_that_fits_nothing_is_an_answer(tmp_path):
    found = mf.advise(write(tmp_path, ("required = 0.08", "required = 0.30"), *WITHOUT_MAP), budget=NO_END)
    assert not found.build
    assert "no display fits it" in found.why_not[0]
    assert "30" in found.why_not[0]
    assert "Without that, restored photographs" in found.verdict
    assert job_files(found.found.job)["job.toml"].count("fit = true") == 0


@pytest.mark.parametrize("searched", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.usefixtures("alone")
def test_a_limit_that_nothing_keeps_is_named_with_the_best_design_without_it(tmp_path, monkeypatch, searched):
    """Whether a search finds that out, which takes most of the time, or is told to have."""
    monkeypatch.setattr(advice, "_UNDER_S", 0.1)
    look = advice.design

    def refusing(spec, *given, **named):
        if spec.design.rules.delta_e is not None:
            raise JobError("MF123", "25 dots do not fit", where="job", cure="none")
        return look(spec, *given, **named)

    if not searched:
        monkeypatch.setattr(advice, "design", refusing)
    path = write(tmp_path, ("[pareto]", "[looks]\ndelta_e = 0.001\n\n[pareto]"))
    # Seconds of this process alone, and a clock that refuses nothing, however busy the machine.
    clock = Clock(12.0, now=time.process_time)
    document = advice_document(
        advice.advise(read(path), "maskfab advise", path=path, clock=clock), "maskfab advise", []
    )
    assert not document["build"]
    assert "ΔE of even white" in document["verdict"]
    assert "none was found that keeps ΔE of even white" in document["verdict"]
    assert "Without that, restored photographs" in document["verdict"]
    assert rows_of(document, "costs")["ΔE of even white"]["passed"] is False


@pytest.mark.slow
@pytest.mark.usefixtures("alone")
def test_a_limit_that_the_freest_design_breaks_is_kept_at_a_price(tmp_path, monkeypatch, answer):
    monkeypatch.setattr(advice, "_UNDER_S", 1.0)
    assert next(number for number in answer.found.display.judged.looks if number.name == "grain").value > 0.008
    found = mf.advise(write(tmp_path, ("[pareto]", "[looks]\ngrain = 0.008\n\n[pareto]")), budget="100 s")
    costs = rows_of(found.to_dict(), "costs")
    assert costs["slow grain"]["passed"] is True
    assert costs["loss by keeping its limits"]["value"] == pytest.approx(found.found.limit_cost_db)
    assert "breaks slow grain" in costs["loss by keeping its limits"]["how"]


@pytest.mark.slow
@pytest.mark.usefixtures("alone")
def test_emitters_are_as_large_as_the_limit_of_life_asks(tmp_path):
    found = mf.advise(write(tmp_path, ("[pareto]", "[lives]\nlife = 0.62\n\n[pareto]")), budget=NO_END)
    document = found.to_dict()
    assert rows_of(document, "costs")["life at equal luminance"]["passed"] is True
    assert rows_of(document, "costs")["emitters of each colour"]["limit"] > 8
    assert any("limit of life" in note for note in document["left_out"])


@pytest.mark.usefixtures("alone")
def test_ctrl_c_keeps_the_best_so_far_and_photographs_it(tmp_path):
    path, clock, stages = write(tmp_path), Clock(100.0), []

    def watch(stage, *_):
        stages.append(stage)
        if stage.startswith("scan"):
            clock.halt.set()

    found = advice.advise(read(path), "maskfab advise", path=path, progress=watch, clock=clock)
    document = advice_document(found, "maskfab advise", [])
    assert "photographs" in stages
    assert found.gain(found.level_db).count == 4
    assert any("Ctrl-C" in note for note in document["left_out"])
    assert "ended before" in rows_of(document, "others")["gain with a rule eased"]["how"]


@pytest.mark.parametrize(
    ("edits", "code", "said"),
    [
        ([('[emitters]\nrequired = 0.08\ncolour_gap = "8 um"\nmin_width = "8 um"\ncircuit = "100 um^2"\n', ""),
          ("[wires]\nlines = 2\n", "")], "MF105", "[emitters]"),
        ([('[plate]\ntemplate = "5in"\ndie_size = "1760 um"\ndie_pitch = "22 mm"\ncolumns = 2\n', "")], "MF105",
         "[plate]"),
        ([("white = 1600", "white = 1e9")], "MF141", "full well"),
        ([('opening = "slit.toml"', 'opening = "tiny.toml"')], "MF105", "no die to compare"),
    ],
)  # fmt: skip
def test_bad_jobs_are_refused_before_any_work(tmp_path, edits, code, said):
    def never(stage, *_):
        raise AssertionError(stage)

    with pytest.raises(JobError, match=code) as refusal:
        mf.advise(write(tmp_path, *edits), progress=never)
    assert said in str(refusal.value)


def test_a_mask_house_that_there_is_not_is_refused_before_any_work(tmp_path):
    def never(stage, *_):
        raise AssertionError(stage)

    own = write(tmp_path)
    own.write_text(own.read_text(encoding="utf-8") + '\n[export]\nshop = "nosuch"\n', encoding="utf-8")
    with pytest.raises(OutputError, match="MF420"):
        mf.advise(own, progress=never)


def test_a_folder_that_exists_is_refused_before_any_work_or_question(tmp_path, capsys):
    job = write(tmp_path)
    assert run_command_line(["advise", str(job), "-o", str(tmp_path)]) == 2
    assert run_command_line(["advise", "-o", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("MF402") == 2
    assert run_command_line(["advise", str(job)]) == 2
    assert "-o" in capsys.readouterr().err


def test_answers_stand_in_place_of_a_job(tmp_path, monkeypatch):
    asked = {}

    def engine(spec, command, **more):
        asked.update(spec=spec, **more)
        raise OutputError("MF401", "that is enough", cure="none")

    monkeypatch.setattr(advising, "advise_spec", engine)
    with pytest.raises(OutputError, match="enough"):
        mf.advise(answers={"pitch": "400 dpi", "camera": "phone_main", "lux": "20 lux"})
    assert asked["spec"].design.fit
    assert asked["spec"].exposure.luminance == pytest.approx(20 / 3.14159265, rel=1e-4)
    assert any("pitch 63.5 um -> 63 um" in note for note in asked["notes"])
    with pytest.raises(JobError, match="MF105"):
        mf.advise(write(tmp_path), answers={"pitch": "400 dpi"})
    with pytest.raises(JobError, match="MF105"):
        mf.advise()


def test_reasons_come_with_the_limit_and_whose_it_is(answer):
    found = answer.found
    display = found.display
    looks = [replace(number, limit=number.value / 2) if number.limit else number for number in display.judged.looks]
    broken = replace(display, judged=replace(display.judged, looks=tuple(looks)))
    worse = replace(found, displays=replace(found.displays, displays={found.name: broken}))
    document = advice_document(worse, "maskfab advise", [])
    assert not document["build"]
    assert "slow grain" in document["verdict"]
    assert "(default)" in document["verdict"]
    assert "breaks" in document["answers"][2]["sentence"]


@pytest.mark.usefixtures("alone")
def test_photographs_that_there_is_no_time_for_are_left_out_and_that_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(Clock, "affords", lambda clock, seconds: False)
    found = mf.advise(write(tmp_path, *WITHOUT_MAP), budget=NO_END).found
    (level,) = found.photographs.conditions.levels
    assert level == found.level_db
    assert all({score.level_db for score in die.scores} == {level} for die in found.photographs.dies.values())
    assert any("left no time for photographs in other light" in note for note in found.notes)
