"""The verbs: what they write, what they print and where, their JSON, and their exit codes."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from once import leaves
from small_job import JOB, LOOK, command, listing, write_job

import maskfab
from maskfab.base import resources
from maskfab.base.errors import catalogue
from maskfab.base.units import parse_pitch_um, to_nm
from maskfab.cli.program import VERBS
from maskfab.mask.job import load_job
from maskfab.mask.opening_file import load_opening
from maskfab.report.text import USEFUL_DB

pytestmark = pytest.mark.usefixtures("drawn_in_words", "measured_once", "bound_loosely", "read_here")

SHIPPED = sorted(resources.path("layouts/openings").glob("*.toml"))
SHAPES = [
    path
    for path in SHIPPED
    if tomllib.loads(path.read_text())["provenance"].get("command", "").startswith("maskfab new")
]
QUANTITY = {"name", "symbol", "value", "unit", "uncertainty", "method", "limit", "passed"}
OF_EVERY_DIE = {
    "open_ratio",
    "auc_radial_min",
    "mtf50",
    "psf_energy_in_window",
    "readback_psf_difference",
    "readback_xor_area",
    "strehl_invariant_error",
    "mtf_volume_invariant_error",
    "corner_touches",
}
PER_WAVELENGTH = {
    "auc_radial_min",
    "mtf50",
    "psf_energy_in_window",
    "readback_psf_difference",
    "strehl_invariant_error",
}
RELAX = """
[design]
name = "found"
method = "relax"
dots = 7
pitch = "56 um"
clear_dots = 14
tiling = "periodic"
seed = 1
iterations = 3
output = "found.toml"
"""
SEARCH = """
[design]
name = "found"
dots = 7
pitch = "42 um"
clear_dots = 10
anneal = 20
shortlist = 1
map = "equal_light"
output = "found.toml"
map_output = "found_map.toml"
"""


@pytest.fixture(scope="module")
def out(small_result) -> Path:
    return small_result


def check_quantity(quantity: dict) -> None:
    assert quantity.keys() >= QUANTITY
    assert quantity.keys() <= QUANTITY | {"wavelength_nm", "die"}
    assert quantity["name"]
    assert quantity["method"]
    assert isinstance(quantity["unit"], str)
    assert quantity["passed"] in (None, True, False)
    assert (quantity["limit"] is None) <= (quantity["passed"] is None)


# --- run -------------------------------------------------------------------------------------------------------------


def test_run_prints_paths_on_stdout_and_progress_on_stderr(capsys, tmp_path):
    (tmp_path / "new" / "out").mkdir(parents=True)  # an empty directory takes a result
    answer = command(capsys, "run", write_job(tmp_path), "--out", tmp_path / "new" / "out")
    assert answer.code == 0, answer.stderr
    printed = [Path(line) for line in answer.stdout.splitlines()]
    assert printed == sorted((tmp_path / "new" / "out").iterdir())
    assert {path.name for path in printed} >= {
        "SMALL.gds", "SMALL.oas", "SMALL_R12.dxf", "SMALL_R2010.dxf", "SMALL.lyrdb", "job.json", "layers.lyp",
        "manifest.json", "report.html", "report.json",
    }  # fmt: skip
    for stage in ("write files: 0/7", "read back: 4/4", "optics: 2/2", "figures: 1/1"):
        assert stage in answer.stderr
    files, optics, display = answer.stderr.splitlines()[-3:]
    assert files.startswith("FILES: PASS, files check; no mask house chosen: ")
    assert optics.startswith("OPTICS: PASS, proved from the files: ")
    assert display == "FITS, LOOKS, LIVES: NOT JUDGED: the job has no [emitters]"


def test_the_report_keeps_its_contract(out):
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    wanted = {"schema_version", "maskfab_version", "job_hash", "verdict", "dies", "plate", "checks", "files"}
    assert wanted <= report.keys()
    assert report["maskfab_version"] == maskfab.__version__
    assert report["verdict"] == "pass"
    assert len(report["job_hash"]) == 64
    assert [die["name"] for die in report["dies"]] == ["PLAIN", "TURNED"]
    for die in report["dies"]:
        names = [q["name"] for q in die["quantities"]]
        assert set(names) >= OF_EVERY_DIE
        for quantity in die["quantities"]:
            check_quantity(quantity)
            assert quantity["die"] == die["name"]
            assert ("wavelength_nm" in quantity) >= (quantity["name"] in PER_WAVELENGTH)
        found = {q["name"]: q for q in die["quantities"]}
        assert found["open_ratio"]["value"] == pytest.approx(15 / 49)
        assert found["mtf50"]["unit"] == "cy/mm"
        assert found["readback_xor_area"]["unit"] == "um^2"
        assert found["readback_xor_area"]["value"] == 0
        assert found["readback_psf_difference"]["value"] < found["readback_psf_difference"]["limit"] == 1e-6
    for quantity in report["plate"]:
        check_quantity(quantity)
        assert "die" not in quantity
    assert report["checks"]
    for quantity in report["checks"]:
        check_quantity(quantity)
        assert quantity["passed"] is True
    by_path = {file["path"]: file for file in report["files"]}
    for name in ("SMALL.gds", "SMALL.oas", "SMALL_R12.dxf", "SMALL_R2010.dxf", "job.json", "layers.lyp"):
        assert by_path[name].keys() == {"path", "format", "bytes", "sha256"}
        assert by_path[name]["bytes"] == (out / name).stat().st_size


def test_force_replaces_a_result_and_only_that(capsys, out, tmp_path):
    shutil.copytree(out, tmp_path / "out")
    run = ("run", write_job(tmp_path, ("SMALL PLATE", "ANOTHER PLATE")), "--out", tmp_path / "out", "--quiet", "--json")
    before = listing(tmp_path)
    answer = command(capsys, *run)
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF402")
    assert "--force" in answer.stderr
    assert listing(tmp_path) == before
    answer = command(capsys, *run, "--force")
    assert (answer.code, answer.stderr) == (0, "")
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert report | {"findings": answer.document["findings"]} == answer.document
    assert answer.document["title"] == "ANOTHER PLATE"
    after = listing(tmp_path)
    assert after.keys() == before.keys()
    assert after["out/SMALL.gds"] != before["out/SMALL.gds"]
    (tmp_path / "out" / "notes.txt").write_text("mine")
    answer = command(capsys, *run, "--force")
    assert answer.code == 2
    assert "'notes.txt'" in answer.stderr
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


def test_results_may_be_read_by_others(out):
    mask = os.umask(0)
    os.umask(mask)
    assert out.stat().st_mode & 0o777 == 0o777 & ~mask


# --- analyse ---------------------------------------------------------------------------------------------------------


def test_analyse_prints_a_table(capsys, tmp_path):
    write_job(tmp_path)
    answer = command(capsys, "analyse", tmp_path / "ring.toml", *LOOK[:-1])
    assert answer.code == 0
    rows = answer.stdout.splitlines()
    assert rows[0].split() == ["quantity", "at", "value", "error", "unit", "limit"]
    assert {row.split()[0] for row in rows[1:]} >= {"open_ratio", "mtf50", "auc_radial_min"}
    assert "optics: 1/1" in answer.stderr


def test_analyse_prints_the_same_quantities_as_json(capsys, tmp_path):
    write_job(tmp_path)
    answer = command(capsys, "analyse", tmp_path / "ring.toml", *LOOK, "--json")
    assert answer.code == 0
    assert answer.stderr == ""
    assert answer.document["name"] == "ring"
    for quantity in answer.document["quantities"]:
        check_quantity(quantity)
    names = {q["name"] for q in answer.document["quantities"]}
    assert names >= OF_EVERY_DIE - {"readback_xor_area", "corner_touches"}


def test_analyse_lists_what_it_wrote(capsys, tmp_path):
    write_job(tmp_path)
    answer = command(capsys, "analyse", tmp_path / "ring.toml", *LOOK, "--out", tmp_path / "psf")
    paths = [Path(line) for line in answer.stdout.splitlines() if line.startswith(str(tmp_path))]
    assert paths == sorted((tmp_path / "psf").iterdir())
    assert {path.suffix for path in paths} == {".exr", ".png"}


# --- verify ----------------------------------------------------------------------------------------------------------


def test_verify_tells_its_verdict_on_stderr(capsys, out):
    answer = command(capsys, "verify", out, "--quiet")
    assert answer.code == 0
    assert answer.stdout == ""
    told = [line.split(", ")[0] for line in answer.stderr.splitlines()]
    assert told == ["FILES: PASS", "OPTICS: PASS", "FITS"]


def test_verify_prints_its_checks_as_json(capsys, out):
    answer = command(capsys, "verify", out, "--json")
    assert answer.code == 0
    assert answer.document.keys() == {"verdict", "verdicts", "checks"}
    assert answer.document["verdict"] == "pass"
    for quantity in answer.document["checks"]:
        check_quantity(quantity)
        assert quantity["passed"] is True


# --- design and shape ------------------------------------------------------------------------------------------------


@pytest.fixture
def few_scenes(monkeypatch):
    monkeypatch.setattr("maskfab.camera.scenes.bundled", lambda count=4: (leaves(1),))


def design_job(folder: Path, section: str = RELAX) -> Path:
    job = folder / "design.toml"
    job.write_text(JOB[JOB.index("[camera]") : JOB.index("[plate]")] + section)
    return job


def test_a_descent_takes_no_workers(capsys, tmp_path):
    job = design_job(tmp_path)
    answer = command(capsys, "design", job, "--workers", "2", "--json", "--quiet")
    assert answer.code == 2
    assert answer.document["error"]["code"] == "MF105"
    assert answer.document["error"]["cure"] == 'Leave workers out, or method = "relax"'
    assert list(tmp_path.iterdir()) == [job]


def test_a_relaxed_design_writes_an_opening_beside_its_job(capsys, tmp_path, few_scenes):
    answer = command(capsys, "design", design_job(tmp_path))
    assert answer.code == 0
    assert answer.stdout.splitlines()[-1] == str(tmp_path / "found.toml")
    assert "3/3" in answer.stderr
    assert "best loss" in answer.stderr
    found = load_opening(tmp_path / "found.toml")
    assert (found.name, found.dots, found.dot_nm, found.clear_dots) == ("found", 7, 8000, 14)
    assert listing(tmp_path).keys() == {"design.toml", "found.toml"}
    again = ("design", tmp_path / "design.toml", "--out", tmp_path / "again.toml", "--json", "--quiet")
    answer = command(capsys, *again, "--checkpoint", tmp_path / "state.npz", "--budget", "10 min")
    assert (answer.code, answer.stderr) == (0, "")
    assert answer.document["clear_dots"] == 14
    # Photographs behind so small a stop are judged by another camera.
    note, named = answer.document["notes"]
    assert "not used of the job: " in named
    assert note.startswith("Expected PSNRs are those behind the camera of protocol F1: the stop of 400 um is 50 dots")
    assert (tmp_path / "again.toml").read_bytes() == (tmp_path / "found.toml").read_bytes()
    answer = command(capsys, *again, "--checkpoint", tmp_path / "state.npz", "--force")
    assert answer.code == 0
    assert (tmp_path / "again.toml").read_bytes() == (tmp_path / "found.toml").read_bytes()


@pytest.mark.slow
def test_a_searched_design_writes_its_map_too_and_says_what_it_found(capsys, tmp_path, few_scenes):
    answer = command(capsys, "design", design_job(tmp_path, SEARCH))
    assert answer.code == 0
    assert answer.stdout.splitlines()[-2:] == [str(tmp_path / "found.toml"), str(tmp_path / "found_map.toml")]
    for said in ("clear dots, expected restored PSNR", "gain of the designed map over a random one"):
        assert said in answer.stdout
    assert "scan, best" in answer.stderr
    told = answer.stdout
    written = {name: (tmp_path / name).read_bytes() for name in ("found.toml", "found_map.toml")}
    answer = command(capsys, "design", tmp_path / "design.toml", "--force", "--json", "--quiet")
    assert (answer.code, answer.stderr) == (0, "")
    assert {name: (tmp_path / name).read_bytes() for name in written} == written
    assert answer.document["expected_psnr_db"].keys() == {"24", "32", "40"}
    assert answer.document["map"]["path"] == str(tmp_path / "found_map.toml")
    facts = tomllib.loads(written["found.toml"].decode())["provenance"]
    assert ("proven headroom" in told) == any(facts[f"head_room_{level}"] < USEFUL_DB for level in (24, 32, 40))
    assert facts["command"] == f"maskfab design {tmp_path / 'design.toml'}"
    assert facts.keys() >= {
        "shape",
        "evaluated",
        "expected_psnr_24",
        "head_room_24",
        "rules_cost_db",
        "version",
        "seed",
    }


def test_design_refuses_to_overwrite_before_it_works(capsys, tmp_path):
    job = design_job(tmp_path, SEARCH)
    for name in ("found.toml", "found_map.toml"):
        (tmp_path / name).write_text("mine")
        answer = command(capsys, "design", job, "--json")
        assert (answer.code, answer.document["error"]["code"]) == (2, "MF402")
        assert "photographs" not in answer.stderr
        assert (tmp_path / name).read_text() == "mine"
        (tmp_path / name).unlink()


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("--budget", "60"), "MF103"),
        (("--budget", "0 s"), "MF104"),
        (("--budget", "soon"), "MF103"),
        (("--checkpoint", "nowhere/state.npz"), "MF401"),
        (("--images", "nowhere"), "MF301"),
    ],
)
def test_options_of_design_are_refused_before_it_works(capsys, tmp_path, arguments, code):
    answer = command(capsys, "design", design_job(tmp_path), *arguments, "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, code)
    assert listing(tmp_path).keys() == {"design.toml"}


@pytest.mark.parametrize("path", SHAPES, ids=lambda path: path.stem)
def test_shipped_shapes_are_what_their_commands_draw(capsys, monkeypatch, tmp_path, path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "layouts" / "openings").mkdir(parents=True)
    program, *arguments = shlex.split(tomllib.loads(path.read_text(encoding="utf-8"))["provenance"]["command"])
    assert program == "maskfab"
    assert command(capsys, *arguments).code == 0
    assert (tmp_path / "layouts" / "openings" / path.name).read_bytes() == path.read_bytes()


def test_some_shipped_openings_are_shapes():
    assert len(SHAPES) >= 3


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_openings_load_and_their_facts_hold(path):
    facts = tomllib.loads(path.read_text(encoding="utf-8"))
    opening = load_opening(path)
    assert opening.name == facts["name"] == path.stem
    assert opening.mask.shape == (facts["dots"], facts["dots"])
    assert round(opening.open_ratio, 4) == facts["open_ratio"]
    assert opening.dots * opening.dot_nm == to_nm(parse_pitch_um(facts["pitch"]))
    # The sparser of two openings passes less than the panel does, a single dot at least.
    assert (0.002 if path.stem.endswith("_outer") else 0.14) < opening.open_ratio < 0.75
    assert opening.provenance["author"]
    assert opening.provenance["version"]
    rows = facts["grid"].split()
    assert "".join(rows[0]) == "".join("#" if clear else "." for clear in opening.mask[-1])


@pytest.mark.parametrize("path", sorted(resources.path("layouts").glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_jobs_load(path):
    job = load_job(path)
    assert job.spec.die or job.spec.design or job.spec.pareto
    for name, held in job.openings.items():
        assert all(opening.mask.any() for opening in held), name
    if job.spec.die:
        assert len(job.plate().dies) == len(job.spec.die)


def test_shape_tells_its_opening_as_json(capsys, tmp_path):
    target = tmp_path / "s.toml"
    answer = command(capsys, "new", target, "--shape", "stripe", "--clear-dots", "90", "--json")
    assert answer.document["clear_dots"] == 90
    assert answer.document["path"] == str(target)
    assert answer.document["provenance"]["command"] == f"maskfab new {target} --shape stripe --clear-dots 90"
    assert load_opening(target).clear_dots == 90


# --- explain, help, and what goes wrong ------------------------------------------------------------------------------


def test_explain_prints_every_part_of_every_code(capsys):
    for code, kept in catalogue().items():
        entry = command(capsys, "explain", code.lower(), "--json").document
        assert (entry["code"], entry["meaning"]) == (code, kept["meaning"])
        told = " ".join(command(capsys, "explain", code).stdout.split())
        for part in ("code", "meaning", "example", "cause", "cure"):
            assert " ".join(entry[part].split()) in told


def test_explain_without_a_code_lists_each_once_under_its_group(capsys):
    lines = command(capsys, "explain").stdout.splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == sorted(catalogue())
    headings = [line for line in lines if line and not line.startswith(" ")]
    groups = command(capsys, "explain", "--json").document
    assert list(groups) == headings
    assert {code: meaning for group in groups.values() for code, meaning in group.items()} == {
        code: own["meaning"] for code, own in catalogue().items()
    }


@pytest.mark.parametrize(
    ("typed", "meant"), [("MF170", "MF107"), ("107", "MF107"), ("mf3001", "MF301"), ("X", "lists")]
)
def test_explain_suggests_the_code_that_was_meant(capsys, typed, meant):
    answer = command(capsys, "explain", typed, "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF105")
    assert meant in answer.document["error"]["cure"]


def test_explain_tells_what_finds_a_number_and_from_what(capsys):
    told = command(capsys, "explain", "mtf50").stdout
    assert "optics, from the panel, the camera, the camera's window, the files read back" in " ".join(told.split())
    assert command(capsys, "explain", "mtf50", "--json").document["title"] == "MTF50"
    assert command(capsys, "explain", "cd_bais", "--json").code == 2


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example_and_takes_json(capsys, verb):
    answer = command(capsys, *verb.split(), "--help")
    assert answer.code == 0
    assert answer.stderr == ""
    assert f"Usage: maskfab {verb}" in answer.stdout
    assert f"maskfab {verb}" in " ".join(answer.stdout.split("Example")[1].split())
    assert "--json" in answer.stdout


def test_the_main_help_names_the_exit_codes(capsys):
    answer = command(capsys, "--help")
    assert answer.code == 0
    assert "0 all checks pass" in answer.stdout
    assert "3 internal error" in " ".join(answer.stdout.split())


@pytest.mark.parametrize(
    "arguments",
    [[], ["nonsense"], ["run"], ["run", "job.toml"], ["run", "--nonsense"], ["new", "stripe", "--dots", "many"]],
)
def test_a_command_line_that_is_none_is_the_user_s_to_mend(capsys, arguments):
    answer = command(capsys, *arguments)
    assert answer.code == 2
    assert "Usage: maskfab" in answer.stderr
    assert "Traceback" not in answer.stderr
    assert answer.stdout == ""


def test_a_command_line_that_is_none_is_told_as_json(capsys):
    answer = command(capsys, "run", "job.toml", "--nonsense", "--json")
    assert answer.code == 2
    assert "--nonsense" in answer.document["error"]["what"]


def test_our_own_fault_is_exit_3(capsys, tmp_path, monkeypatch):
    def fail(*_: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr("maskfab.runs.pipeline.measure_dies", fail)
    job = write_job(tmp_path)
    before = listing(tmp_path)
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json")
    assert answer.code == 3
    assert answer.document["error"]["code"] == "MF901"
    assert "by nothing" in answer.document["error"]["what"]
    assert "Traceback" in answer.stderr
    assert "report this" in answer.stderr
    assert listing(tmp_path) == before


def test_an_interrupted_run_leaves_nothing(capsys, tmp_path, monkeypatch):
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("maskfab.runs.pipeline.measure_dies", interrupt)
    job = write_job(tmp_path)
    before = listing(tmp_path)
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--quiet", "--json")
    assert answer.code == 130
    assert answer.document["error"]["code"] == "MF157"
    assert "ended before it was done" in answer.stderr
    assert listing(tmp_path) == before


def test_the_installed_program_passes_its_exit_code_on():
    program = [sys.executable, "-m", "maskfab"]
    good = subprocess.run([*program, "explain", "MF106"], capture_output=True, text=True, check=False)
    assert (good.returncode, good.stderr) == (0, "")
    assert good.stdout.startswith("MF106 ")
    bad = subprocess.run([*program, "explain", "no_key", "--json"], capture_output=True, text=True, check=False)
    assert bad.returncode == 2
    assert json.loads(bad.stdout)["error"]["code"] == "MF105"
    assert bad.stderr.startswith("error: MF105 ")
