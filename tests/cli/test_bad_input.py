"""Bad input is refused before any work: exit 2, a code, the value with its unit, the limit, the place, the cure."""

from __future__ import annotations

import os
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from klayout import db
from small_job import DRAWING, JOB, LOOK, OPENING, Answer, command, listing, look, write_job

import maskfab as mf
from maskfab.base.errors import catalogue
from maskfab.mask.job import load_job
from maskfab.mask.opening_file import load_opening

PITCH = 'dot = "8 um"\npitch = "56 um"'
OPENING_KEY = 'opening = "ring.toml"'
SOLID = '[export]\nformats = ["gdsii", "glb"]\nchrome = "{chrome}"\nexaggeration = {times}\n[plate]'


def refused(answer: Answer, code: str, *said: str) -> dict[str, str]:
    """Check a refusal, told on stderr in one line a fault and on stdout as one JSON document; the fault of a code."""
    assert answer.code == 2, answer
    error = answer.document["error"]
    assert error.keys() == {"code", "what", "where", "cure", "faults"}
    faults = {fault["code"]: fault for fault in reversed(error["faults"])}
    assert code in faults, error["faults"]
    assert code in catalogue()
    fault, message = faults[code], answer.stderr.strip()
    assert error["code"] == (code if len(error["faults"]) == 1 else "MF153")
    (line,) = (line for line in message.split("\n") if f"{code} {fault['what']}" in line)
    assert fault["cure"]
    assert fault["cure"] in line
    for part in said:
        assert part in line
    return fault


def refused_run(capsys, tmp_path: Path, job: Path, code: str, *said: str) -> dict[str, str]:
    """Check that a run is refused, and that nothing at all is left behind."""
    before = listing(tmp_path)
    error = refused(command(capsys, "run", job, "--out", tmp_path / "out", "--json"), code, *said)
    assert listing(tmp_path) == before
    return error


# What is edited in the job, the code, the key that is named, and what the message must say.
JOBS = {
    "unknown key": ("pixel =", "pixle =", "MF102", "camera.pixle", ["unknown key 'camera.pixle'"]),
    "unknown section": ("[plate]", "[plates]\n[plate]", "MF102", "plates", ["unknown key 'plates'"]),
    "unknown key of a die": ("seed = 3", "seeds = 3", "MF102", "die[1].seeds", ["unknown key"]),
    "missing key": ('focal = "5 mm"', "", "MF105", "camera.focal", ["'camera.focal' is missing"]),
    "missing section": (JOB[JOB.index("[camera]") : JOB.index("[plate]")], "", "MF105", "camera", ["missing"]),
    "no dies": (JOB[JOB.index("[[die]]") :], "", "MF105", "", ["no [[die]] section"]),
    "no plate": (JOB[JOB.index("[plate]") : JOB.index("[[die]]")], "", "MF105", "", ["no [plate] section"]),
    "no heading": (JOB[: JOB.index("[camera]")], "", "MF105", "", ["no [job] section"]),
    "no unit": (PITCH, 'dot = "8"', "MF103", "die[0].dot", ["'8' has no unit", "um, mm"]),
    "number": (PITCH, "dot = 8", "MF103", "die[0].dot", ["8 has no unit"]),
    "wrong unit": (PITCH, 'dot = "8 kg"', "MF103", "die[0].dot", ["'8 kg'", "no unit of length"]),
    "density for a length": (PITCH, 'dot = "300 dpi"', "MF103", "die[0].dot", ["'dpi'"]),
    "no number": (PITCH, 'dot = "eight um"', "MF103", "die[0].dot", ["'eight um'"]),
    "truth for a length": (PITCH, "dot = true", "MF103", "die[0].dot", ["True"]),
    "negative": (PITCH, 'dot = "-8 um"', "MF104", "die[0].dot", ["'-8 um'", "finite", "positive"]),
    "zero": ('focal = "5 mm"', 'focal = "0 mm"', "MF104", "camera.focal", ["'0 mm'", "positive"]),
    "NaN": ('pixel = "2 um"', 'pixel = "nan um"', "MF104", "camera.pixel", ["'nan um'", "finite"]),
    "infinite": ('die_size = "560 um"', 'die_size = "inf um"', "MF104", "plate.die_size", ["'inf um'", "finite"]),
    "overflow": ('blank = "27 mm"', 'blank = "1e400 mm"', "MF104", "plate.blank", ["'1e400 mm'"]),
    "beyond GDSII": ('blank = "27 mm"', 'blank = "5 m"', "MF104", "plate.blank", ["'5 m'", "2 m"]),
    "astronomic": ('focal = "5 mm"', 'focal = "1e9 m"', "MF104", "camera.focal", ["'1e9 m'", "1 km"]),
    "negative gutter": (PITCH, PITCH + '\ngutter = "-1 um"', "MF104", "die[0].gutter", ["'-1 um'", "at least 0"]),
    "negative density": ('pitch = "56 um"', 'pitch = "-300 dpi"', "MF104", "die[0].pitch", ["'-300 dpi'"]),
    "no columns": ("columns = 2", "columns = 0", "MF104", "plate.columns", ["= 0", "greater than or equal to 1"]),
    "half a column": ("columns = 2", "columns = 1.5", "MF105", "plate.columns", ["= 1.5", "whole number"]),
    "negative seed": ("seed = 3", "seed = -3", "MF104", "die[1].seed", ["= -3"]),
    "no seed": ("seed = 3", "", "MF111", "die[1].seed", ["'TURNED'", "random", "seed = 1"]),
    "no such tiling": ('tiling = "random"', 'tiling = "spiral"', "MF105", "die[1].tiling", ["'spiral'", "'paper4'"]),
    "no such stop": ('"circle"', '"hexagon"', "MF105", "camera.stop.shape", ["'hexagon'", "'square'"]),
    "dots are not the pitch": (
        'pitch = "56 um"', 'pitch = "63 um"', "MF106", "die[0].pitch", ["7 dots x 8 um", "56 um", "63 um", '"9 um"'],
    ),
    "dots and gutter are not the pitch": (
        PITCH, 'dot = "8 um"\ngutter = "6 um"\npitch = "56 um"', "MF107", "die[0].pitch", ["56 um", "7 dots"],
    ),
    "300 DPI off the grid": (
        'pitch = "56 um"', 'pitch = "300 dpi"', "MF107", "die[0].pitch",
        ["84.66666667 um", 'pitch = "84.665 um", dot = "12.095 um"'],
    ),
    "dot off the grid": (PITCH, 'dot = "8.0004 um"', "MF107", "die[0].dot", ["8.000400 um", "1 nm", "+0.400 nm"]),
    "blank off the grid": ('blank = "27 mm"', 'blank = "27000.0005 um"', "MF107", "plate.blank", ["1 nm"]),
    "half gutter off the grid": (
        'pitch = "56 um"', 'gutter = "0.001 um"', "MF107", "die[0].gutter", ["0.001 um", "0.002 um"],
    ),
    "die larger than its slot": (
        'die_size = "560 um"', 'die_size = "1.5 mm"', "MF108", "plate.die_size", ["1500 um", "1400 um", "slot"],
    ),
    "dies beyond the writable area": (
        'die_pitch = "2 mm"', 'die_pitch = "11 mm"', "MF108", "plate.die_pitch", ["11560 um", "11000 um", "writable"],
    ),
    "dies beyond it however close": (
        'die_size = "560 um"', 'die_size = "10 mm"', "MF108", "plate.die_size", ["20600 um", "11000 um", "fewer dies"],
    ),
    "bias wider than a dot": (
        "[plate]", '[process]\ncd_bias = "30 um"\n[plate]', "MF127", "process, die PLAIN",
        ["30 um", "a cd_bias of more than -8 um and less than 8 um"],
    ),
    "film too thin for a solid": (
        "[plate]", SOLID.format(chrome="9.9 nm", times=1), "MF104", "export.chrome", ["0.0099 um", "10 nm", "solids"],
    ),
    "film too thick for a solid": (
        "[plate]", SOLID.format(chrome="5 mm", times=201), "MF104", "export.exaggeration", ["1 m", "at most 200"],
    ),
    "chrome too thick for a solid": (
        "[plate]", SOLID.format(chrome="2 m", times=1), "MF104", "export.chrome", ['chrome = "1 m" or less'],
    ),
    "writable area beyond the blank": (
        'writable = "22 mm"', 'writable = "28 mm"', "MF108", "plate.writable", ["28000 um", "27000 um", "blank"],
    ),
    "no room for marks": ('writable = "22 mm"', 'writable = "15 mm"', "MF108", "plate.writable", ["15 mm", "20.3 mm"]),
    "cell larger than its die": (
        'die_size = "560 um"', 'die_size = "50 um"', "MF108", "die[0]", ["'PLAIN'", "56 um", "50 um"],
    ),
    "stop larger than the panel": ('"400 um"', '"600 um"', "MF114", "die[0]", ["'PLAIN'", "560 um", "600 um"]),
    "stop that sees nothing": ('"400 um"', '"20 um"', "MF309", "die[0]", ["'ring'", "20 um", "11.3137 um"]),
    "two dies of one name": ('"TURNED"', '"PLAIN"', "MF109", "die", ["2 dies", "'PLAIN'"]),
    "name with a blank": ('"TURNED"', '"TUR NED"', "MF110", "die[1].name", ["'TUR NED'"]),
    "name with a digit first": ('"TURNED"', '"1A"', "MF110", "die[1].name", ["'1A'", "letter"]),
    "long name": ('"TURNED"', f'"{"X" * 25}"', "MF110", "die[1].name", ["25 characters", "23"]),
    "empty name": ('"TURNED"', '""', "MF110", "die[1].name", ["''"]),
    "name of a mask house's own cell": ('"SMALL"', '"Main_1"', "MF110", "job.name", ["'Main_1'", "main"]),
    "title without letters for it": ('"SMALL PLATE"', '"PLÄTE"', "MF110", "job.title", ["'Ä'", "ASCII"]),
    "label without letters for it": ('label = "random"', 'label = "8 µm"', "MF110", "die[1].label", ["'µ'"]),
    "long title": ('"SMALL PLATE"', f'"{"X" * 81}"', "MF105", "job.title", ["at most 80"]),
    "empty label": ('label = "random"', 'label = ""', "MF105", "die[1].label", ["at least 1"]),
    "short wavelength": ('"530 nm"', '"199.9 nm"', "MF112", "camera.wavelengths[0]", ["199.9 nm", "200 nm"]),
    "long wavelength": ('"530 nm"', '"2.1 um"', "MF112", "camera.wavelengths[0]", ["2100 nm", "2000 nm"]),
    "no wavelength": ('["530 nm"]', "[]", "MF105", "camera.wavelengths", ["at least 1"]),
    "one wavelength twice": ('["530 nm"]', '["530 nm", "0.53 um"]', "MF105", "camera.wavelengths", ["530 nm", "once"]),
    "aliased window": (
        '"64 um"', '"332 um"', "MF113", "camera.window", ["332 um", "λf/dot = 331.2 um", "530 nm", "dot of 8 um"],
    ),
    "window within a pixel": ('"64 um"', '"1 um"', "MF104", "camera.window", ["1 um", "2 um"]),
    "too many samples": ('pixel = "2 um"', 'pixel = "1 nm"', "MF115", "camera.window", ["128000 samples", "4096"]),
    "too many cells": (PITCH, 'dot = "0.07 um"', "MF115", "die[0]", ["1142 cells", "1000"]),
    "too many dots in the stop": (PITCH, 'dot = "0.05 um"', "MF115", "die[0]", ["8000 dots", "6000"]),
    "missing opening": (OPENING_KEY, 'opening = "none.toml"', "MF301", "none.toml", ["does not exist"]),
    "opening is a directory": (OPENING_KEY, 'opening = "."', "MF301", "", ["directory"]),
}  # fmt: skip


@pytest.mark.parametrize("case", JOBS)
def test_a_job_that_cannot_be_made_is_refused(capsys, tmp_path, case):
    old, new, code, key, said = JOBS[case]
    error = refused_run(capsys, tmp_path, write_job(tmp_path, (old, new)), code, *said)
    assert str(tmp_path) in error["where"]
    assert error["where"].endswith(key)


@pytest.mark.parametrize("old", ['["530 nm"]', '"2 um"', '"64 um"', '"400 um"', '"560 um"', '"2 mm"', '"27 mm"'])
@pytest.mark.parametrize("value", ['"0 um"', '"-1 um"', '"nan um"', '"inf um"', '"1"', "1", '"1 s"', "true", "[]"])
def test_no_length_of_a_job_is_let_through_unchecked(capsys, tmp_path, old, value):
    job = write_job(tmp_path, (old, f"[{value}]" if old.startswith("[") else value))
    before = listing(tmp_path)
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json")
    assert answer.code == 2
    assert answer.document["error"]["code"] in {"MF103", "MF104", "MF112"}
    assert listing(tmp_path) == before


def test_a_misspelt_key_is_not_missing_too_and_two_are_told_at_once(capsys, tmp_path):
    job = write_job(tmp_path, ("pixel =", "pixle ="))
    assert refused_run(capsys, tmp_path, job, "MF102")["cure"] == 'Write pixel = "2 um"'
    job = write_job(tmp_path, ("pixel =", "pixle ="), ("focal =", "fcal ="))
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json")
    assert [fault["where"] for fault in answer.document["error"]["faults"]] == [
        f"{job}: camera.fcal",
        f"{job}: camera.pixle",
    ]
    head, first, second = answer.stderr.splitlines()
    assert head == f"error: MF153 2 faults ({job}). Write what each of them says"
    assert (first[:8], second[:8]) == ("  MF102 ", "  MF102 ")


def test_the_window_that_the_cure_names_is_accepted(capsys, tmp_path):
    # λf/dot is 331.25 um: rounded to the nearest it would be too wide.
    job = write_job(tmp_path, ('"64 um"', '"340 um"'))
    cure = refused_run(capsys, tmp_path, job, "MF113")["cure"]
    width = cure.split("at most ")[1]
    assert command(capsys, "analyse", tmp_path / "ring.toml", *look(window=width)).code == 0


WIDE = (('"64 um"', '"300 um"'), ('["530 nm"]', '["610 nm", "530 nm", "470 nm"]'))
"""A window wider than λf/dot at 470 nm."""


@pytest.mark.parametrize(
    "words",
    [["run", "JOB", "--out", "OUT"], ["run", "JOB", "--out", "OUT", "--dry-run"], ["check", "--optics", "JOB"],
     ["verify", "MASK", "--against", "JOB"], ["self", "bench", "JOB"]],
    ids=" ".join,
)  # fmt: skip
def test_what_shows_a_psf_refuses_a_window_with_replicas_in_it(capsys, tmp_path, words):
    stands = {"JOB": write_job(tmp_path, *WIDE), "OUT": tmp_path / "out", "MASK": tmp_path / "mask.gds"}
    error = command(capsys, *(stands.get(word, word) for word in words), "--json").document["error"]
    assert (error["code"], "at 470 nm" in error["what"]) == ("MF113", True)
    assert not stands["OUT"].exists()


@pytest.mark.parametrize("verb", ["simulate", "learn"])
def test_a_verb_that_shows_no_psf_takes_a_camera_of_any_window(capsys, tmp_path, verb):
    """It comes to a die that is not there, which is looked for in the job."""
    out = ["--out", tmp_path / "out.pt"] if verb == "learn" else []
    error = command(capsys, verb, write_job(tmp_path, *WIDE), *out, "--die", "NONE", "--json").document["error"]
    assert (error["code"], error["what"]) == ("MF105", "the job has no die 'NONE'")


STUDY = """[sweep]
title = "S"
job = "{job}"
quantities = ["open_ratio", "none"]
[[field]]
key = "camera.pixel"
values = ["1 um", "2 um"]
"""


@pytest.mark.parametrize(
    "words",
    [["run", "JOB", "--out", "OUT"], ["run", "JOB", "--out", "OUT", "--dry-run"], ["simulate", "JOB"],
     ["order", "compare", "JOB"], ["order", "fill", "JOB", "--shop", "generic-chrome"],
     ["order", "pack", "JOB", "--shop", "generic-chrome"], ["sweep", "STUDY", "--out", "OUT"]],
    ids=" ".join,
)  # fmt: skip
def test_verbs_tell_the_faults_of_a_job_and_of_its_layout_at_once(capsys, tmp_path, words):
    job = write_job(tmp_path, ("columns = 2", "columns = 0"), ('"400 um"', '"600 um"'))
    stands = {"JOB": job, "OUT": tmp_path / "out", "STUDY": tmp_path / "study.toml"}
    stands["STUDY"].write_text(STUDY.format(job=job.name), encoding="utf-8")
    error = command(capsys, *(stands.get(word, word) for word in words), "--json").document["error"]
    told = {"MF104", "MF114"} | ({"MF161"} if "sweep" in words else set())
    assert (error["code"], {fault["code"] for fault in error["faults"]}) == ("MF153", told)
    assert not stands["OUT"].exists()


def test_what_the_light_and_the_layout_of_a_sound_file_refuse_is_told_at_once(capsys, tmp_path):
    job = write_job(tmp_path, ('"400 um"', '"600 um"'), ("[plate]", "[exposure]\nwhite = 1e9\n[plate]"))
    error = command(capsys, "simulate", job, "--json").document["error"]
    assert {fault["code"] for fault in error["faults"]} == {"MF114", "MF141"}


# --- the job file itself ---------------------------------------------------------------------------------------------


def test_a_syntax_error_is_told_with_line_and_column(capsys, tmp_path):
    job = write_job(tmp_path, ("[plate]", "[plate"))
    error = refused_run(capsys, tmp_path, job, "MF101", "']'")
    line = JOB.splitlines().index("[plate]") + 1
    assert error["where"] == f"{job}:{line}:7"


def test_a_syntax_error_at_the_end_is_told_as_such(capsys, tmp_path):
    job = tmp_path / "job.toml"
    job.write_text(JOB + 'label = "open', encoding="utf-8")
    assert str(job) in refused_run(capsys, tmp_path, job, "MF101")["where"]


FILES = {
    "missing": (None, "MF301", "no job file"),
    "empty": (b"", "MF302", "is empty"),
    "blank": (b" \n\t\n", "MF302", "is empty"),
    "binary": (b"\x89PNG\r\n\x1a\n\xff\xfe\x00", "MF304", "not text"),
    "truncated": (JOB[: JOB.index('"56 um"') + 4].encode(), "MF101", "TOML"),
    "UTF-16": (JOB.encode("utf-16"), "MF304", "not text"),
}


@pytest.mark.parametrize("case", FILES)
def test_a_job_file_that_is_none_is_refused(capsys, tmp_path, case):
    content, code, said = FILES[case]
    job = tmp_path / "job.toml"
    if content is not None:
        job.write_bytes(content)
    assert "job.toml" in str(refused_run(capsys, tmp_path, job, code, said))


def test_a_directory_is_no_job_file(capsys, tmp_path):
    (tmp_path / "job.toml").mkdir()
    refused_run(capsys, tmp_path, tmp_path / "job.toml", "MF301", "job.toml")


@pytest.mark.parametrize(("name", "code"), [("job.yaml", "MF308"), ("job", "MF308"), ("job.json", "MF303")])
def test_a_job_file_of_another_kind_is_refused(capsys, tmp_path, name, code):
    job = write_job(tmp_path).rename(tmp_path / name)
    refused_run(capsys, tmp_path, job, code, name)


@pytest.mark.parametrize("content", ["[]", "3", '"job"', "null"])
def test_json_that_is_no_job_is_refused(capsys, tmp_path, content):
    job = tmp_path / "job.json"
    job.write_text(content, encoding="utf-8")
    refused_run(capsys, tmp_path, job, "MF105", "job.json")


# --- openings --------------------------------------------------------------------------------------------------------


OPENINGS = {
    "ragged": (OPENING.replace(".##.#..", ".##.#.", 1), "MF201", ["line 2", "6 dots", "7"]),
    "not square": (OPENING.replace(".......\n", "", 1), "MF201", ["6 rows of 7"]),
    "no lines": (OPENING.replace(DRAWING, ""), "MF201", ["0 lines"]),
    "another character": (OPENING.replace(".##.#..", ".##x#..", 1), "MF202", ["line 2, column 4", "'x'"]),
    "closed": (OPENING.replace("#", "."), "MF203", ["0 of 49", "at least 1"]),
    "stated dots": (OPENING.replace("dots = 7", "dots = 8"), "MF206", ["dots = 8", "7 x 7"]),
    "stated ratio": ("open_ratio = 0.5\n" + OPENING, "MF206", ["0.5", "15 of 49", "0.3061"]),
    "ratio beyond 1": ("open_ratio = 1.5\n" + OPENING, "MF104", ["1.5", "between 0 and 1"]),
    "pitch of no whole dots": (OPENING.replace('"56 um"', '"56.003 um"'), "MF106", ["56.003 um", "7 dots", "nm"]),
    "pitch off the grid": (OPENING.replace('"56 um"', '"300 dpi"'), "MF107", ["84.666667 um", "1 nm"]),
    "no unit": (OPENING.replace('"56 um"', '"56"'), "MF103", ["'56'", "no unit"]),
    "unknown key": ("colour = 1\n" + OPENING, "MF102", ["'colour'", "provenance"]),
    "missing key": (OPENING.replace("dots = 7", ""), "MF105", ["'dots'"]),
    "syntax": (OPENING.replace("dots = 7", "dots = "), "MF101", ["line 3, column 8"]),
    "name": (OPENING.replace('"ring"', '"do main"'), "MF110", ["'do main'"]),
    "empty": ("", "MF302", ["0 bytes"]),
}


@pytest.mark.parametrize("case", OPENINGS)
def test_an_opening_that_is_none_is_refused(capsys, tmp_path, case):
    text, code, said = OPENINGS[case]
    job = write_job(tmp_path, opening=text)
    assert str(tmp_path / "ring.toml") in refused_run(capsys, tmp_path, job, code, *said)["where"]
    answer = command(capsys, "analyse", tmp_path / "ring.toml", *LOOK, "--json")
    refused(answer, code, *said, "ring.toml")


@pytest.mark.usefixtures("drawn_in_words", "read_here")
def test_a_cell_that_is_clear_all_over_is_a_reference(capsys, tmp_path):
    clear = OPENING.replace(".", "#").replace('"ring"', '"clear"')
    job = write_job(tmp_path, ("columns = 2", "columns = 1"), opening=clear)
    job.write_text(job.read_text().split('[[die]]\nname = "TURNED"')[0])
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--quiet", "--json")
    assert answer.code == 0, answer.stderr
    found = {q["name"]: q["value"] for q in answer.document["dies"][0]["quantities"]}
    assert found["open_ratio"] == 1
    assert found["stop_open_ratio"] == pytest.approx(1, abs=1e-6)
    assert found["peak_strehl"] == pytest.approx(1, abs=1e-5)
    assert found["corner_touches"] == 0


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["blobs", "--clear-dots", "0"], "MF203", ["0 of 441", "at least 1"]),
        (["diamond-discs", "--clear-dots", "2"], "MF204", ["2 of 441", "0.0045", "1 (open ratio 0.0023)"]),
        (["stripe", "--clear-dots", "91"], "MF204", ["91 of 441", "0.2063", "90 (open ratio 0.2041)"]),
        (["stripe", "--set", "width_dots=22"], "MF104", ["width_dots = 22", "1 and 21"]),
        (["blobs"], "MF105", ["--clear-dots"]),
        (["spiral", "--clear-dots", "9"], "MF105", ["'spiral'", "diamond-discs"]),
        (["stripe", "--name", "1st"], "MF110", ["'1st'", "--name"]),
        (["stripe", "--dots", "-1"], "MF104", ["dots = -1"]),
        (["stripe", "--dots", "5000"], "MF104", ["5000", "4096"]),
    ],
)
def test_a_shape_that_cannot_be_drawn_is_refused(capsys, tmp_path, arguments, code, said):
    answer = command(capsys, "new", tmp_path / "drawn.toml", "--shape", *arguments)
    assert answer.code == 2
    assert answer.stderr.startswith(f"error: {code} ")
    for part in said:
        assert part in answer.stderr
    assert listing(tmp_path) == {}


@pytest.mark.parametrize(
    ("old", "new", "code", "key"),
    [
        ("clear_dots = 14", "clear_dots = 0", "MF104", "design.clear_dots"),
        ("clear_dots = 14", "clear_dots = 14.5", "MF105", "design.clear_dots"),
        ("clear_dots = 14", "", "MF105", "design.clear_dots"),
        ("clear_dots = 14", "clear_dots = 14\nopen_ratio = 0.3", "MF102", "design.open_ratio"),
        ("clear_dots = 14", "clear_dots = 14\nfamilies = ['bars']", "MF102", "design.families"),
        ('method = "relax"', 'method = "guess"', "MF105", "design.method"),
        ('method = "relax"', 'method = "search"', "MF102", "design.iterations"),
        ('tiling = "periodic"', 'tiling = "random"', "MF111", "design.tiling_seed"),
        ('tiling = "periodic"', 'tiling = "hexagonal"', "MF122", "design.tiling"),
        ('pitch = "56 um"', 'pitch = "55 um"', "MF106", "design.pitch"),
        ("dots = 7", "dots = 1000000", "MF104", "design.dots"),
        ("iterations = 3", "iterations = 0", "MF104", "design.iterations"),
        ("iterations = 3", 'iterations = 3\nrecipe = "paper-l2"', "MF105", "design.iterations"),
        ("iterations = 3", "epochs = 3", "MF105", "design.epochs"),
        ("iterations = 3", "objectives = { area = 1.0 }", "MF105", "design.objectives"),
        ("iterations = 3", "objectives = { beauty = 1.0 }", "MF105", "design.objectives.beauty.[key]"),
        ("iterations = 3", "objectives = { top_residual = -1.0 }", "MF104", "design.objectives.top_residual"),
        ("iterations = 3", "rules = { rim_dots = -1 }", "MF104", "design.rules.rim_dots"),
        ("iterations = 3", "rules = { rim = 1 }", "MF102", "design.rules.rim"),
    ],
)
def test_a_design_that_cannot_be_made_is_refused(capsys, tmp_path, old, new, code, key):
    job = design_job(tmp_path, (old, new))
    before = listing(tmp_path)
    error = refused(command(capsys, "design", job, "--out", tmp_path / "o.toml", "--json"), code)
    assert error["where"] == f"{job}: {key}"
    assert listing(tmp_path) == before


@pytest.mark.parametrize(
    ("added", "code", "key"),
    [
        ('tiling = "paper4"', "MF122", "tiling"),
        ("positions = 4", "MF105", "positions"),
        ("joint = 2", "MF105", "joint"),
        ("density = 0.4", "MF105", "density"),
        ("cluster = 2", "MF102", "cluster"),
        ('map = "equal_light"\ndensity = 0.4\npositions = 2', "MF105", "positions"),
        ('map_output = "m.toml"', "MF105", "map_output"),
        ('map = "equal_light"\ntiling = "periodic"', "MF105", "map"),
        ('protocol = "beauty"', "MF105", "protocol"),
        ("families = []", "MF105", "families"),
        ('recipe = "paper-l2"', "MF102", "recipe"),
    ],
)
def test_a_search_that_cannot_be_made_is_refused(capsys, tmp_path, added, code, key):
    job = design_job(
        tmp_path, ('method = "relax"', added), ('tiling = "periodic"\nseed', "seed"), ("iterations = 3", "")
    )
    before = listing(tmp_path)
    error = refused(command(capsys, "design", job, "--out", tmp_path / "o.toml", "--json"), code)
    assert error["where"] == f"{job}: design.{key}"
    assert listing(tmp_path) == before


def test_a_map_without_a_place_is_refused(capsys, tmp_path):
    job = design_job(
        tmp_path,
        ('method = "relax"', 'map = "equal_light"\noutput = "o.toml"'),
        ('tiling = "periodic"\nseed', "seed"),
        ("iterations = 3", ""),
    )
    before = listing(tmp_path)
    error = refused(command(capsys, "design", job, "--json"), "MF105")
    assert error["where"] == f"{job}: design.map_output"
    assert listing(tmp_path) == before


def test_rules_that_no_opening_keeps_are_refused(capsys, tmp_path):
    job = design_job(tmp_path, ("iterations = 3", "iterations = 3\nrules = { rim_dots = 3 }"))
    refused(command(capsys, "design", job, "--out", tmp_path / "o.toml", "--json", "--quiet"), "MF204", "rim_dots")
    assert not (tmp_path / "o.toml").exists()


def design_job(folder: Path, *edits: tuple[str, str]) -> Path:
    text = JOB[JOB.index("[camera]") : JOB.index("[plate]")] + (
        '[design]\nname = "found"\nmethod = "relax"\ndots = 7\npitch = "56 um"\nclear_dots = 14\n'
        'tiling = "periodic"\nseed = 1\niterations = 3\n'
    )
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    job = folder / "design.toml"
    job.write_text(text, encoding="utf-8")
    return job


# --- files that are read ---------------------------------------------------------------------------------------------


@pytest.fixture
def gds(tmp_path) -> Path:
    """Two top cells, each with a square of 8 um on layers 1/0 and 2/0."""
    layout = db.Layout()
    layout.dbu = 0.001
    for name in ("ONE", "OTHER"):
        cell = layout.create_cell(name)
        for number in (1, 2):
            cell.shapes(layout.layer(number, 0)).insert(db.Box(8000, 8000, 16000, 16000))
    path = tmp_path / "two.gds"
    layout.write(str(path))
    return path


def test_two_top_cells_are_refused(capsys, gds):
    refused(command(capsys, "analyse", gds, *LOOK, "--json"), "MF305", "2 top cells", "ONE, OTHER", str(gds))


def test_no_such_layer_is_refused(capsys, gds):
    answer = command(capsys, "analyse", gds, "--cell", "ONE", "--layer", "7/1", *LOOK, "--json")
    refused(answer, "MF306", "'7/1'", "1/0", "2/0", str(gds))


def test_no_such_cell_is_refused(capsys, gds):
    answer = command(capsys, "analyse", gds, "--cell", "NONE", *LOOK, "--json")
    refused(answer, "MF307", "'NONE'", "ONE, OTHER", str(gds))


@pytest.mark.parametrize(
    ("keys", "code"),
    [("", "MF305"), ('opening_cell = "NONE"', "MF307"), ('opening_cell = "ONE"\nopening_layer = "7/1"', "MF306")],
)
def test_the_same_of_a_job_whose_opening_is_a_layout(capsys, tmp_path, gds, keys, code):
    job = write_job(tmp_path, (OPENING_KEY, f'opening = "{gds.name}"\n{keys}'))
    told = refused_run(capsys, tmp_path, job, code)
    assert str(gds) in told["where"]
    assert told["cure"] == f"Give opening_{'layer' if code == 'MF306' else 'cell'} one of these"


def test_polygons_off_the_dot_grid_are_refused(capsys, tmp_path, gds):
    keys = f'opening = "{gds.name}"\nopening_cell = "ONE"'
    job = write_job(tmp_path, (OPENING_KEY, keys), (PITCH, 'dot = "7 um"\npitch = "49 um"'))
    refused_run(capsys, tmp_path, job, "MF205", "7 um")


def test_a_job_states_the_unit_of_a_drawing_that_does_not(capsys, tmp_path):
    drawing = ezdxf.new("R2010", units=0)
    drawing.modelspace().add_lwpolyline([(0, 0), (0.008, 0), (0.008, 0.008), (0, 0.008)], close=True)
    drawing.saveas(tmp_path / "x.dxf")
    job = write_job(tmp_path, (OPENING_KEY, 'opening = "x.dxf"'))
    refused_run(capsys, tmp_path, job, "MF205", "one was taken for 1 um")
    job = write_job(tmp_path, (OPENING_KEY, 'opening = "x.dxf"\nopening_unit = "mm"'))
    assert 1 in {opening.clear_dots for (opening,) in load_job(job).openings.values()}
    job = write_job(tmp_path, (OPENING_KEY, f'{OPENING_KEY}\nopening_unit = "mm"'))
    refused_run(capsys, tmp_path, job, "MF105", "is no DXF")


KINDS = ["png", "npy", "txt", "gds", "oas", "dxf", "tif", "exr"]


@pytest.mark.parametrize("suffix", KINDS)
@pytest.mark.parametrize(
    ("content", "codes"),
    [
        (None, {"MF301"}),
        (b"", {"MF302"}),
        (b"\x00\x01\xfe\xff" * 50, {"MF304"}),
        (b"%PDF-1.7\n" * 9, {"MF304", "MF202"}),
    ],
)
def test_a_file_that_is_none_is_refused(capsys, tmp_path, suffix, content, codes):
    path = tmp_path / f"o.{suffix}"
    if content is not None:
        path.write_bytes(content)
    answer = command(capsys, "analyse", path, "--dot", "8 um", "--out", tmp_path / "out", *LOOK, "--json")
    assert answer.document["error"]["code"] in codes
    refused(answer, answer.document["error"]["code"], f"o.{suffix}")
    assert not (tmp_path / "out").exists()


def test_truncated_files_are_refused(capsys, tmp_path, gds):
    np.save(tmp_path / "whole.npy", np.eye(7, dtype=bool))
    for whole in (gds, tmp_path / "whole.npy"):
        cut = tmp_path / f"cut{whole.suffix}"
        cut.write_bytes(whole.read_bytes()[:-20])
        answer = command(capsys, "analyse", cut, "--dot", "8 um", *LOOK, "--json")
        refused(answer, "MF303", cut.name)


def test_a_file_of_unknown_kind_is_refused(capsys, tmp_path):
    path = tmp_path / "photo.jpg"
    path.write_bytes(b"\xff\xd8\xff\xe0")
    refused(command(capsys, "analyse", path, *LOOK, "--json"), "MF308", "'.jpg'", ".png", str(path))


ANALYSES = {
    "no dot": (["o.txt"], "MF105", ["--dot"]),
    "pitch of no whole dots": (["o.txt", "--pitch", "57 um"], "MF107", ["57.000000 um", "445.61 DPI", "ppm"]),
    "dots are not the pitch": (["o.txt", "--dot", "8 um", "--pitch", "57 um"], "MF106", ["57 um", "8 um", "'56 um'"]),
    "more dots than drawn": (["o.txt", "--dot", "8 um", "--pitch", "64 um"], "MF206", ["dots = 8", "7"]),
    "gutter beyond the pitch": (["ring.toml", "--pitch", "9 um", "--gutter", "9 um"], "MF106", ["9 um", "--gutter"]),
    "odd gutter": (["ring.toml", "--gutter", "1 nm"], "MF107", ["0.001 um", "--gutter"]),
    "no seed": (["ring.toml", "--tiling", "random"], "MF111", ["random", "--seed"]),
    "negative seed": (["ring.toml", "--tiling", "random", "--seed", "-1"], "MF104", ["-1", "--seed"]),
    "no such tiling": (["ring.toml", "--tiling", "spiral"], "MF105", ["'spiral'", "paper4"]),
    "no such stop": (["ring.toml", *look(stop={"shape": "hexagon", "diameter": "4 mm"})], "MF105", ["'hexagon'"]),
    "stop that sees nothing": (["ring.toml", *look(stop={"diameter": "20 um"})], "MF309", ["20 um"]),
    "no unit": (["ring.toml", *look(stop={"diameter": "4"})], "MF103", ["'4' has no unit", "stop.diameter"]),
    "no unit of the dot": (["o.txt", "--dot", "8"], "MF103", ["'8' has no unit", "--dot"]),
    "negative pitch": (["o.txt", "--pitch", "-8 um"], "MF104", ["'-8 um'", "--pitch"]),
    "wavelength": (["ring.toml", *look(wavelengths=["530 nm", "100 nm"])], "MF112", ["100 nm", "200 nm"]),
    "window": (["ring.toml", *look(window="400 um")], "MF113", ["400 um", "331.2 um"]),
    "too many dots": (
        ["ring.toml", *look(stop={"diameter": "50 mm"}, focal="50 mm")], "MF115", ["6250 dots", "6000"],
    ),
    "too many cells": (
        ["dot.txt", "--dot", "8 um", *look(stop={"diameter": "40 mm"}, focal="5 cm")], "MF115",
        ["5000 cells", "1000"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ANALYSES)
def test_an_analysis_that_cannot_be_made_is_refused(capsys, tmp_path, case):
    (name, *options), code, said = ANALYSES[case]
    write_job(tmp_path)
    (tmp_path / "o.txt").write_text(DRAWING)
    (tmp_path / "dot.txt").write_text("#\n")
    before = listing(tmp_path)
    answer = command(capsys, "analyse", tmp_path / name, *LOOK, *options, "--out", tmp_path / "out", "--json")
    refused(answer, code, *said)
    assert listing(tmp_path) == before


# --- where results go ------------------------------------------------------------------------------------------------


def test_out_below_a_regular_file_is_refused(capsys, tmp_path):
    job = write_job(tmp_path)
    for verb, subject in (("run", job), ("analyse", tmp_path / "ring.toml")):
        before = listing(tmp_path)
        answer = command(capsys, verb, subject, "--out", job / "out", "--json", *(LOOK if verb == "analyse" else ()))
        refused(answer, "MF401", str(job), "--out")
        assert listing(tmp_path) == before


def test_out_that_is_a_file_is_refused(capsys, tmp_path):
    job = write_job(tmp_path)
    (tmp_path / "out").write_text("mine")
    for force in ([], ["--force"]):
        refused(
            command(capsys, "run", job, "--out", tmp_path / "out", "--json", *force), "MF401", str(tmp_path / "out")
        )
        assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="to root every directory is writable")
def test_out_without_permission_is_refused(capsys, tmp_path):
    job = write_job(tmp_path / "job")
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    refused(command(capsys, "run", job, "--out", locked / "out", "--json"), "MF401", str(locked))


def test_a_parent_that_may_not_be_written_is_refused(capsys, tmp_path, monkeypatch):
    job = write_job(tmp_path)
    allowed = os.access
    monkeypatch.setattr("maskfab.base.folders.os.access", lambda path, mode: path != tmp_path and allowed(path, mode))
    refused_run(capsys, tmp_path, job, "MF401", str(tmp_path), "permissions")


@pytest.mark.parametrize("force", [[], ["--force"]])
@pytest.mark.parametrize("name", ["thesis.tex", ".hidden", "sub/report.json"])
def test_a_directory_of_other_things_is_never_replaced(capsys, tmp_path, force, name):
    job = write_job(tmp_path)
    (tmp_path / "out" / name).parent.mkdir(parents=True)
    (tmp_path / "out" / name).write_text("mine")
    before = listing(tmp_path)
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json", *force)
    refused(answer, "MF402", str(tmp_path / "out"), "no maskfab result")
    assert listing(tmp_path) == before


def test_a_manifest_of_something_else_does_not_make_a_result(capsys, tmp_path):
    # Browser extensions and web applications have a manifest.json too.
    job = write_job(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "manifest.json").write_text('{"name": "My extension", "manifest_version": 3}')
    (tmp_path / "out" / "code.js").write_text("mine")
    before = listing(tmp_path)
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--force", "--json")
    refused(answer, "MF402", str(tmp_path / "out"))
    assert listing(tmp_path) == before


def test_the_job_s_own_directory_is_not_replaced(capsys, tmp_path):
    job = write_job(tmp_path)
    before = listing(tmp_path)
    refused(command(capsys, "run", job, "--out", tmp_path, "--force", "--json"), "MF402")
    assert listing(tmp_path) == before


def test_an_opening_is_not_overwritten_without_force(capsys, tmp_path):
    target = tmp_path / "o.toml"
    assert command(capsys, "new", target, "--shape", "stripe").code == 0
    first = target.read_bytes()
    answer = command(capsys, "new", target, "--shape", "stripe", "--set", "width_dots=7")
    assert answer.code == 2
    assert answer.stderr.startswith("error: MF402 ")
    assert target.read_bytes() == first
    assert command(capsys, "new", target, "--shape", "stripe", "--set", "width_dots=7", "--force").code == 0
    assert load_opening(target).clear_dots == 7 * 21
    assert listing(tmp_path).keys() == {"o.toml"}


@pytest.mark.parametrize("name", ["folder.toml", "folder.png", "folder.gds", "folder.exr"])
@pytest.mark.parametrize(
    "words",
    [["analyse", "IT"], ["edge", "IT"], ["restore", "IT", "--job", "JOB", "--die", "PLAIN", "--out", "OUT"],
     ["run", "IT", "--out", "OUT"]],
    ids=lambda words: words[0],
)  # fmt: skip
def test_a_folder_in_place_of_a_file_is_refused_as_such(capsys, tmp_path, words, name):
    job = write_job(tmp_path, ('["530 nm"]', '["610 nm", "530 nm", "470 nm"]'))
    stands = {"JOB": job, "OUT": tmp_path / "out", "IT": tmp_path / name}
    stands["IT"].mkdir()
    error = command(capsys, *(stands.get(word, word) for word in words), "--json").document["error"]
    assert error["code"] == "MF301"
    assert "is a folder" in error["what"] or "is a directory" in error["what"]
    assert name in error["what"] + error["where"]
    assert not stands["OUT"].exists()


@pytest.mark.parametrize(
    ("words", "code"),
    [(["run", "JOB", "--out", "IT"], "MF401"), (["simulate", "JOB", "--images", "IT"], "MF301"),
     (["view", "IT"], "MF403"), (["analyse", "JOB", "--out", "IT"], "MF401")],
)  # fmt: skip
def test_a_file_in_place_of_a_folder_is_refused_as_such(capsys, tmp_path, words, code):
    stands = {"JOB": write_job(tmp_path, ('["530 nm"]', '["610 nm", "530 nm", "470 nm"]')), "IT": tmp_path / "it.txt"}
    stands["IT"].write_text("no folder", encoding="utf-8")
    error = command(capsys, *(stands.get(word, word) for word in words), "--json").document["error"]
    assert (error["code"], "it.txt" in error["what"]) == (code, True), error
    assert stands["IT"].read_text(encoding="utf-8") == "no folder"


def test_a_stop_is_stated_by_its_number_and_its_key_is_explained():
    assert mf.Camera("9 mm", stop="f/1.8", pixel="2 um").model.stop.diameter_um == 5000
    answer = mf.explain("camera.stop")
    assert [key["name"] for key in answer.to_dict()["keys"]][:2] == ["shape", "diameter"]
    assert '"f/1.8"' in answer.text
