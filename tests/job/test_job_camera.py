"""The job's camera at the command line: every verb that judges by photographs answers for it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from maskfab.api.designing import _targets
from maskfab.base.model import Tiling
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import F1, PhotoCamera, camera_line
from maskfab.cli.program import run_command_line
from maskfab.job.read import read
from maskfab.mask import opening_file, panels
from maskfab.mask.formats.exr import write_png
from maskfab.mask.job import load_job
from maskfab.report.documents.die import camera_notes

pytestmark = pytest.mark.usefixtures("bound_loosely", "drawn_in_words", "read_here")

ROOT = Path(__file__).parents[2]
PHONE = 'focal = "5.56 mm"\nstop = { shape = "circle", diameter = "1 mm" }\npixel = "5 um"\n'
FAST = 'focal = "3.7 mm"\nstop = { shape = "circle", diameter = "1.85 mm" }\npixel = "3.8 um"\n'
JOB = """\
[job]
name = "CAMERA"
title = "CAMERA"

[camera]
{camera}wavelengths = ["610 nm", "530 nm", "470 nm"]
window = "64 um"

[plate]
blank = "27 mm"
writable = "22 mm"
die_size = "2.1 mm"
die_pitch = "3 mm"
columns = 2

[design]
name = "found"
dots = 7
pitch = "98 um"
clear_dots = 12
families = ["bars"]
output = "found.toml"

[pareto]
clear_dots = [12]

[[die]]
name = "BAR"
label = "bar"
opening = "bar.toml"
dot = "14 um"
pitch = "98 um"
tiling = "periodic"
"""
ROUND = '\n[process]\ncorner_radius = "0.5 um"\n'
EMITTERS = """
[emitters]
colour_gap = "14 um"
min_width = "14 um"
circuit = "1 um^2"
"""
DRAWING = ".......\n" * 3 + "####...\n" * 3 + ".......\n"
BAR = f'name = "bar"\npitch = "98 um"\ndots = 7\ngrid = """\n{DRAWING}"""\n'
DESIGNED = '\n[provenance]\nauthor = "maskfab"\nexpected_psnr_24 = 20.0\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two jobs that differ in their cameras alone, and a photograph for them."""
    place = tmp_path_factory.mktemp("cameras")
    (place / "bar.toml").write_text(BAR)
    for name, camera in (("phone", PHONE), ("fast", FAST)):
        (place / f"{name}.toml").write_text(JOB.format(camera=camera) + "\n[exposure]\nsnr = [24, 32, 40]\n")
    for name, part in (("photographs", picture().values), ("small", picture().values[:, :832, :832])):
        (place / name).mkdir()
        write_png(part, place / name / "noise.png", white=1.0)
        (place / name / "by_whom.txt").write_text("somebody")
    return place


def picture() -> Photograph:
    draw = np.random.default_rng(2).standard_normal((1024, 1536))
    distance = np.hypot(np.fft.fftfreq(1024)[:, None], np.fft.rfftfreq(1536))
    values = np.fft.irfft2(np.fft.rfft2(draw) / np.maximum(distance, 1e-3) ** 1.5)
    values = np.clip(0.4 + 0.15 * values / values.std(), 0, 1).astype(np.float32)
    return Photograph("noise", 1, np.repeat(values[None], 3, axis=0))


def with_map(job: str) -> str:
    lines = 'map = "equal_light"\noutput = "found.toml"\nmap_output = "found_map.toml"\n'
    return job.replace('output = "found.toml"\n', lines)


def told(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> dict[str, object]:
    assert run_command_line([*map(str, arguments), "--json", "--quiet"]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def require_notes(notes):
    """What is not used, by its name: a section of the job, and a file of the folder."""
    assert any("not used of the job: " in note and "[exposure]" in note and "protocol F1" in note for note in notes)
    assert any("by_whom.txt" in note for note in notes)


def test_photographs_are_taken_by_the_jobs_camera_and_by_f1s_where_that_is_asked_for(folder, capsys):
    images = "--images", folder / "small", "--level", "32"
    by = {name: told(capsys, "simulate", folder / f"{name}.toml", *images) for name in ("phone", "fast")}
    psnr = {name: [score["psnr"] for score in found["scores"]] for name, found in by.items()}
    assert min(abs(np.subtract(psnr["phone"], psnr["fast"]))) > 0.1
    assert by["phone"]["protocol"] == "camera"
    assert by["phone"]["camera"] == camera_line(load_job(folder / "phone.toml").camera)


def test_a_die_that_does_not_cover_the_stop_of_f1_is_not_judged_by_it(folder, capsys):
    arguments = ["simulate", str(folder / "phone.toml"), "--protocol", "f1", "--quiet"]
    assert run_command_line([*arguments, "--die", "BAR"]) == 2
    assert "MF122" in capsys.readouterr().err


def test_a_design_follows_the_camera_and_states_it(folder, capsys):
    found = {}
    for name in ("phone", "fast"):
        target = folder / f"only_{name}.toml"
        arguments = folder / f"{name}.toml", "--out", target, "--images", folder / "photographs"
        document = told(capsys, "design", *arguments)
        (unused,) = [note for note in document["notes"] if "not used" in note]
        assert not any(each in unused for each in ("[exposure]", "[sensor]", "focal"))
        facts = opening_file.load_opening(target).provenance
        assert facts["camera"] == camera_line(load_job(folder / f"{name}.toml").camera)
        assert facts["protocol"].startswith("protocol camera: full well 15506 electrons, read noise 4.87 electrons")
        assert document["designed_for"] == f"{facts['camera']}; {facts['protocol']}"
        found[name] = facts["expected_psnr_32"]
    assert abs(found["phone"] - found["fast"]) > 0.1


def test_a_design_that_names_f1_is_by_its_light_behind_the_jobs_lens(folder, capsys):
    job, target = folder / "named_f1.toml", folder / "only_f1.toml"
    job.write_text((folder / "phone.toml").read_text().replace("[design]\n", '[design]\nprotocol = "f1"\n') + ROUND)
    notes = told(capsys, "design", job, "--out", target, "--images", folder / "photographs")["notes"]
    require_notes(notes)
    assert any("[process]" in note for note in notes)
    facts = opening_file.load_opening(target).provenance
    assert facts["camera"] == camera_line(load_job(job).camera)
    assert facts["protocol"] == "another camera at the levels of F1"


@pytest.mark.slow
def test_a_map_has_the_cells_of_its_camera_and_lies_beside_its_opening(folder, capsys):
    found = {}
    (folder / "found_map.toml").write_text("somebody else's")
    for name in ("phone", "fast"):
        target, job = folder / f"by_{name}.toml", folder / f"map_{name}.toml"
        job.write_text(with_map((folder / f"{name}.toml").read_text()))
        told(capsys, "design", job, "--out", target, "--images", folder / "photographs")
        opening, cells = opening_file.load_opening(target), panels.read_map(folder / f"by_{name}_map.toml")
        camera = load_job(folder / f"{name}.toml").camera
        for facts in (opening.provenance, cells.provenance):
            assert facts["camera"] == camera_line(camera)
        found[name] = len(cells.cells)
    assert found == {"phone": 12, "fast": 20}
    assert (folder / "found_map.toml").read_text() == "somebody else's"


def test_files_given_a_place_lie_there_whatever_the_job_says(folder):
    place = folder / "placed.toml"
    place.write_text(with_map((folder / "phone.toml").read_text()))
    kept = _targets(read(place), place, None)
    assert kept == {"opening": folder / "found.toml", "map": folder / "found_map.toml"}
    moved = _targets(read(place), place, folder / "there" / "x.toml")
    assert moved == {"opening": folder / "there" / "x.toml", "map": folder / "there" / "x_map.toml"}


def test_a_sweep_judges_behind_the_jobs_camera_and_in_its_light(folder, capsys):
    images = "--images", folder / "photographs"
    best = {}
    for name in ("phone", "fast"):
        job, out = folder / f"{name}_display.toml", folder / f"pareto_{name}"
        job.write_text((folder / f"{name}.toml").read_text() + EMITTERS)
        notes = told(capsys, "design", "--front", job, "--out", out, *images)["notes"]
        unused, skipped = notes
        assert skipped == "Skipped, as no photographs: by_whom.txt."
        assert unused.startswith("Openings are compared by the job's camera, sensor and light; not used of the job: ")
        assert not any(each in unused for each in ("[exposure]", "[sensor]", "[emitters]", "focal"))
        assert json.loads((out / "pareto.json").read_text())["notes"] == notes
        files = [opening_file.load_opening(path) for path in sorted(out.rglob("*.toml")) if "_job" not in path.name]
        best[name] = max(each.provenance["expected_psnr_32"] for each in files)
        assert all(each.provenance["camera"] == camera_line(load_job(job).camera) for each in files)
        assert all("linear light" in each.provenance["protocol"] for each in files)
    assert abs(best["phone"] - best["fast"]) > 0.1


def test_a_run_says_which_camera_its_dies_were_designed_for_and_why_none_is_judged(folder, tmp_path, capsys):
    """One colour of light: everything else is reported, and nothing fails."""
    (tmp_path / "bar.toml").write_text(BAR + DESIGNED)
    small = PHONE.replace('"1 mm"', '"450 um"')
    lines = JOB.format(camera=small).replace('["610 nm", "530 nm", "470 nm"]', '["530 nm"]')
    (tmp_path / "job.toml").write_text(lines.replace('"2.1 mm"', '"686 um"'))
    assert run_command_line(["run", str(tmp_path / "job.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    rows = {row["name"]: row for die in report["dies"] for row in die["quantities"]}
    assert rows["designed_for"]["value"] == camera_line(F1)
    assert rows["designed_for"]["passed"] is None
    assert "MF134" in rows["photographs_refused"]["value"]
    assert "restored_psnr" not in rows
    assert rows["photographs_refused"]["value"] in capsys.readouterr().err


@pytest.mark.parametrize(
    ("facts", "noted"),
    [
        ("", None),
        ('\n[provenance]\nauthor = "somebody"\nshape = "bar"\n', None),
        (DESIGNED, camera_line(F1)),
        (DESIGNED + "loss = 0.1\n", None),
        (DESIGNED + 'camera = "a box"\n', "a box"),
    ],
    ids=["drawn", "by others", "before cameras were stated", "by an old descent", "stated"],
)
def test_an_opening_for_another_camera_is_noted(folder, tmp_path, facts, noted):
    (tmp_path / "bar.toml").write_text(BAR + facts)
    (tmp_path / "job.toml").write_text((folder / "phone.toml").read_text())
    found = camera_notes(load_job(tmp_path / "job.toml"))
    assert found.get("BAR") is None if noted is None else found["BAR"].value == noted
    same = DESIGNED + f'camera = "{camera_line(load_job(tmp_path / "job.toml").camera)}"\n'
    (tmp_path / "bar.toml").write_text(BAR + same)
    assert camera_notes(load_job(tmp_path / "job.toml")) == {}


def test_shipped_openings_of_f1_are_at_home_in_shipped_jobs():
    job = load_job(ROOT / "layouts" / "upc12.toml")
    assert PhotoCamera.of(job.camera) == F1
    assert camera_notes(job) == {}
    assert any(die.tiling is Tiling.MAP for die in job.spec.die)


@pytest.mark.parametrize("verb", [("design",), ("design", "--front", "--out", "none")], ids=["one", "front"])
def test_dots_too_coarse_for_the_camera_are_refused_before_any_scene_is_drawn(folder, capsys, verb, monkeypatch):
    monkeypatch.setattr("maskfab.camera.scenes.bundled", None)
    job = folder / "coarse.toml"
    job.write_text((folder / "phone.toml").read_text().replace('"1 mm"', '"800 um"') + EMITTERS)
    assert run_command_line([verb[0], str(job), *verb[1:], "--quiet"]) == 2
    refusal = capsys.readouterr().err
    assert "MF135" in refusal
    assert "coarse.toml: design.dots" in refusal
