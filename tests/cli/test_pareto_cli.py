"""maskfab design --front: from a job to numbers, openings and figures, and what is refused before any work."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from browser import Chromium, Firefox, faults
from once import leaves

from maskfab.camera import scenes
from maskfab.cli.program import run_command_line
from maskfab.job.read import read
from maskfab.mask.opening_file import load_opening
from maskfab.mask.panels import read_map

JOB = """
[design]
name = "front"
dots = 8
pitch = "168 um"
clear_dots = 12
map = "equal_light"
positions = 2
shortlist = 2

[pareto]
clear_dots = { from = 9, to = 12, step = 3 }
lines = [0, 1]
compare = ["given.toml"]

[emitters]
gap_to_opening = "21 um"
colour_gap = "21 um"
min_width = "21 um"
circuit = "1 um^2"

[process.spread]
bias = "0.3 um"

[wires]
line = "8 um"
space = "8 um"
lines = 1

[camera]
focal = "10 mm"
stop = { shape = "circle", diameter = "1.6 mm" }
wavelengths = ["530 nm"]
pixel = "2 um"
"""
ROWS = ["........"] * 5 + ["####...."] * 3
GIVEN = 'name = "given"\npitch = "168 um"\ndots = 8\ngrid = """\n' + "\n".join(ROWS) + '\n"""\n'


@pytest.fixture(autouse=True)
def one_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenes, "bundled", lambda count=4: (leaves(1),))


@pytest.fixture
def job(tmp_path: Path) -> Path:
    (tmp_path / "given.toml").write_text(GIVEN)
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    return path


def test_a_sweep_is_written_whole_and_alike_each_time(
    job: Path, capsys: pytest.CaptureFixture[str], chromium: Chromium, firefox: Firefox
) -> None:
    out = job.parent / "out"
    assert run_command_line(["design", "--front", str(job), "--out", str(out), "--json", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [curve["clear_dots"] for curve in told["curves"]] == [9, 12]
    assert {**json.loads((out / "pareto.json").read_text()), "path": str(out)} == told
    found = [each for curve in told["curves"] for each in curve["designs"]]
    rows = list(csv.DictReader((out / "pareto.csv").read_text().splitlines()))
    assert [row["name"] for row in rows] == [*(each["name"] for each in found), "given"]
    for each, row in zip(found, rows, strict=False):
        assert load_opening(out / each["opening"]).clear_dots == each["clear_dots"]
        assert read_map(out / each["map"]).cells.shape
        assert read(out / each["job"]).design.fit
        assert row["lines"] == str(each["lines"])
        assert float(row["footprint"]) == pytest.approx(each["footprint"], abs=1e-6)
        assert row["best"] == str(int(each["best"]))
    (given,) = told["compared"]
    assert given["name"] == "given"
    assert given["best_gain_db"] >= 0
    (unused,) = told["notes"]
    assert all(each in unused for each in ("shortlist of [design]", "positions of [design]", "[process]"))
    for curve in told["curves"]:
        assert curve["prices_db"].keys() == {"circuits", "emitters"}
        assert curve["alternatives"]["of_the_display"]
    page = (out / "pareto.html").read_text()
    assert page.count("Together the rules cost") == len(told["curves"])
    assert f"Assumes {told['designed_for']}; 1 synthetic scene;" in page
    assert "<script" not in page
    assert [fault for browser in (chromium, firefox) for fault in faults(browser, out / "pareto.html")] == []
    for each in found:
        assert f'<a href="#{each["name"]}">' in page
        assert f'id="{each["name"]}"' in page
    assert (out / "pareto.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (out / "pareto.svg").read_text()
    listed = {file["path"] for file in json.loads((out / "manifest.json").read_text())["files"]}
    assert listed | {"manifest.json"} == {path.name for path in out.iterdir()}
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert run_command_line(["design", "--front", str(job), "--out", str(out), "--quiet"]) == 2
    assert "MF402" in capsys.readouterr().err
    assert run_command_line(["design", "--front", str(job), "--out", str(out), "--force", "--quiet"]) == 0
    assert "9 clear dots (14.1% open)" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("[pareto]", "[scene]", "MF102"),
        ("clear_dots = { from = 9, to = 12, step = 3 }", "", "MF105"),
        ("from = 9", "from = 0", "MF105"),
        ("to = 12", "to = 8", "MF105"),
        ("step = 3", "step = 0", "MF105"),
        ("step = 3", "stride = 3", "MF105"),
        ("from = 9, to = 12, step = 3", "from = 1, to = 1000000000000", "MF105"),
        ("{ from = 9, to = 12, step = 3 }", "[]", "MF105"),
        ("{ from = 9, to = 12, step = 3 }", "[9, 0]", "MF104"),
        ("{ from = 9, to = 12, step = 3 }", "[9.5]", "MF105"),
        ("{ from = 9, to = 12, step = 3 }", "[65, 66]", "MF204"),
        ('["given.toml"]', '["nowhere.toml"]', "MF301"),
        ('["given.toml"]', '["given.toml", "given.toml"]', "MF109"),
        ("dots = 8", "dots = 7", "MF105"),
        ('colour_gap = "21 um"', 'colour_gap = "200 um"', "MF117"),
        ('colour_gap = "21 um"', 'colour_gap = "21.001 um"', "MF118"),
        ('compare = ["given.toml"]', "anneal = -1", "MF104"),
        ("lines = [0, 1]", "lines = []", "MF105"),
        ("clear_dots = 12\n", "clear_dots = 12\nweights = [1, 2]\n", "MF105"),
        ("lines = [0, 1]", "lines = [-1]", "MF104"),
    ],
)
def test_bad_jobs_leave_nothing(job: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, code: str) -> None:
    assert old in JOB
    job.write_text(JOB.replace(old, new, 1))
    out = job.parent / "out"
    assert run_command_line(["design", "--front", str(job), "--out", str(out), "--quiet"]) == 2
    assert code in capsys.readouterr().err
    assert {path.name for path in job.parent.iterdir()} == {"job.toml", "given.toml"}


def test_bad_requests_are_refused(job: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plain = job.read_text()
    without = job.parent / "plain.toml"
    without.write_text(plain[: plain.index("[pareto]")] + plain[plain.index("[camera]") :])
    relaxed = job.parent / "relaxed.toml"
    relaxed.write_text(
        plain.replace('map = "equal_light"\npositions = 2\nshortlist = 2', 'method = "relax"\ntiling_seed = 1')
    )
    out = str(job.parent / "out")
    for arguments, code in (
        ([str(without), "--out", out], "MF105"),
        ([str(relaxed), "--out", out], "MF105"),
        ([str(job), "--out", out, "--budget", "60"], "MF103"),
        ([str(job), "--out", out, "--budget", "0 s"], "MF104"),
        ([str(job), "--out", out, "--images", "nowhere"], "MF301"),
        ([str(job), "--out", str(job)], "MF401"),
        ([str(job.parent / "absent.toml"), "--out", out], "MF301"),
    ):
        assert run_command_line(["design", "--front", *arguments, "--quiet"]) == 2
        assert code in capsys.readouterr().err
    assert not Path(out).exists()


@pytest.mark.usefixtures("drawn_in_words")
def test_a_budget_is_told(job: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shapes = JOB.replace("clear_dots = 12", 'clear_dots = 12\nfamilies = ["bars", "discs"]', 1)
    job.write_text(shapes.replace("lines = [0, 1]", "lines = [0]"))
    out = job.parent / "out"
    assert run_command_line(["design", "--front", str(job), "--out", str(out), "--budget", "0.001 s"]) == 0
    said = capsys.readouterr()
    assert "the budget ended it" in said.out
    assert "clear dots: shapes" in said.err
