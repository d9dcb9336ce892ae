"""PSFs as OpenEXR: what a run writes, what their headers say, and that one wrong sample or entry is found."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from small_job import LOOK, command, finished, listing, write_job

import maskfab
from maskfab.base.errors import SourceError
from maskfab.base.model import Die, Opening, Panel, Psf, Tiling
from maskfab.base.provenance import sha256_of_file
from maskfab.base.work import silent
from maskfab.mask.comparison.files import read_back
from maskfab.mask.formats.exr import AXES, PsfFile, check_psf_file, psf_facts, read_psf_file, write_psf
from maskfab.runs.plate_files import draw_files, psfs_as_files
from maskfab.runs.stages import measure_dies

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

ASKED = ("[plate]", '[export]\nformats = ["gdsii", "exr"]\n\n[plate]')
LINES = ('["530 nm"]', '["530 nm", "610 nm"]')
NAMES = [f"SMALL_{die}_psf_{line}nm.exr" for die in ("PLAIN", "TURNED") for line in (530, 610)]


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    return finished(tmp_path_factory.mktemp("psfs"), ASKED, LINES)


@pytest.fixture(scope="module")
def measured(out):
    """The job, and its PSFs at points by die and wavelength, measured again."""
    job = maskfab.load_job(out / "job.json")
    made = draw_files(job, job.plate())
    layout = read_back(made, out, silent).trips[0].layout
    psfs = {
        (item.die.name, psf.wavelength_nm): psf
        for item in measure_dies(made.plate, job.camera, layout, silent)
        for psf in item.psfs
        if psf.kind == "point"
    }
    return job, psfs


def header(path: Path) -> dict[str, object]:
    image = oiio.ImageInput.open(str(path))
    entries = {entry.name: entry.value for entry in image.spec().extra_attribs}
    image.close()
    return entries


def test_there_is_one_for_each_die_and_wavelength_in_the_manifest_and_the_report(out):
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    listed = {file["path"]: file for file in manifest["files"] if file["path"].endswith(".exr")}
    assert sorted(listed) == NAMES == sorted(path.name for path in out.glob("*.exr"))
    assert all(file["sha256"] == sha256_of_file(out / name) for name, file in listed.items())
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert {file["path"] for file in report["files"]} >= set(NAMES)
    rows = [row for row in report["checks"] if row["name"].startswith("psf_file_")]
    assert len(rows) == 2 * len(NAMES)
    assert all(row["passed"] and row["value"] == row["limit"] == 0 for row in rows)
    assert {(row["die"], row["wavelength_nm"]) for row in rows} == {
        (die, line) for die in ("PLAIN", "TURNED") for line in (530, 610)
    }


def test_samples_are_those_of_the_report_upright_in_float32(out, measured):
    _, psfs = measured
    for (die, line), psf in psfs.items():
        values, facts = read_psf_file(out / f"SMALL_{die}_psf_{line:g}nm.exr")
        assert np.array_equal(values, psf.values.astype(np.float32))
        assert facts["step_um"] == np.float32(psf.step_um)
        middle = len(values) // 2
        assert values[middle, middle] == values.max()
    lopsided = psfs["PLAIN", 530].values
    assert not np.allclose(lopsided, lopsided[::-1])  # so that upside down would be seen


def test_the_header_says_what_made_it(out, measured):
    job, psfs = measured
    entries = header(out / "SMALL_TURNED_psf_610nm.exr")
    said = {name.removeprefix("maskfab:"): value for name, value in entries.items() if name.startswith("maskfab:")}
    text = json.loads((out / "job.json").read_text(encoding="utf-8"))["openings"]["ring"]
    assert said == {
        "wavelength_nm": 610.0,
        "step_um": float(np.float32(psfs["TURNED", 610].step_um)),
        "kind": "point",
        "unit": "1/um^2",
        "axes": AXES,
        "focal_um": 5000.0,
        "stop": "circle",
        "stop_um": 400.0,
        "sensor_pixel_um": 2.0,
        "die": "TURNED",
        "pitch_um": 56.0,
        "dot_um": 8.0,
        "gutter_um": 0.0,
        "tiling": "random",
        "seed": "3",
        "opening": "ring",
        "opening_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "plate": "SMALL",
        "source": "SMALL.gds",
        "job_sha256": job.digest,
        "maskfab_version": maskfab.__version__,
    }
    assert header(out / "SMALL_PLAIN_psf_610nm.exr")["maskfab:seed"] == "none"
    assert entries["Software"] == f"maskfab {maskfab.__version__}"
    assert "DateTime" not in entries


@pytest.mark.slow
def test_two_runs_write_the_same_bytes(out, tmp_path):
    again = finished(tmp_path, ASKED, LINES)
    assert [name for name in NAMES if (out / name).read_bytes() != (again / name).read_bytes()] == []


@pytest.mark.slow
def test_two_analyses_write_the_same_bytes(capsys, tmp_path):
    opening = write_job(tmp_path).parent / "ring.toml"
    for name in ("one", "two"):
        assert command(capsys, "analyse", opening, *LOOK, "--out", tmp_path / name).code == 0
    assert listing(tmp_path / "one") == listing(tmp_path / "two")
    assert "DateTime" not in header(tmp_path / "one" / "psf_point_530nm.exr")


def test_without_exr_there_is_none(tmp_path):
    job = maskfab.load_job(write_job(tmp_path))
    assert psfs_as_files(job, draw_files(job, job.plate()), ()) == ()


def test_a_finished_directory_verifies_and_a_changed_psf_does_not(capsys, out, tmp_path):
    assert command(capsys, "verify", out, "--quiet").code == 0
    changed = tmp_path / "changed"
    shutil.copytree(out, changed)
    shutil.copy(changed / NAMES[0], changed / NAMES[1])  # another wavelength
    (changed / NAMES[2]).write_bytes((changed / NAMES[2]).read_bytes()[:3000])
    (changed / NAMES[3]).unlink()
    manifest = json.loads((changed / "manifest.json").read_text(encoding="utf-8"))
    for file in manifest["files"]:
        if (changed / file["path"]).is_file():
            file.update(sha256=sha256_of_file(changed / file["path"]))
    (changed / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    answer = command(capsys, "verify", changed, "--json", "--quiet")
    assert answer.code == 1
    failed = [row for row in answer.document["checks"] if not row["passed"]]
    told = {(row["name"], row.get("die"), row.get("wavelength_nm")) for row in failed}
    assert told >= {("psf_file_wrong_samples", "PLAIN", 610), ("psf_file_wrong_facts", "PLAIN", 610)}
    unread = [row["method"] for row in failed if row["name"] == "readable"]
    assert any("MF303" in method and NAMES[2] in method for method in unread)
    assert any("MF301" in method and NAMES[3] in method for method in unread)


# --- one file --------------------------------------------------------------------------------------------------------


@pytest.fixture
def made() -> PsfFile:
    values = np.random.default_rng(0).random((9, 9)) ** 8
    values[4, 4] = 1.5
    psf = Psf(values, 0.3, 532.5, "point")
    panel = Panel(Opening("all", np.ones((1, 1), np.bool_), 8000), 8000, 0, np.zeros((1, 1)), Tiling.PERIODIC, None)
    return PsfFile("p.exr", Die("D", "", panel, (0, 0), 8000), psf, {**psf_facts(psf), "maskfab_version": "1"})


def judged(made: PsfFile, folder: Path) -> tuple[int, int]:
    samples, facts = check_psf_file(made, folder)
    for row in (samples, facts):
        assert (row.die, row.wavelength_nm, row.limit, row.passed) == ("D", 532.5, 0, row.value == 0)
    return samples.value, facts.value


def test_what_was_written_is_right(made, tmp_path):
    made.write(tmp_path / made.name)
    assert judged(made, tmp_path) == (0, 0)


@pytest.mark.parametrize("row", [0, 4, 8])
def test_one_sample_that_differs_by_a_hundred_thousandth_is_found(made, tmp_path, row):
    values = made.psf.values.copy()
    values[row, 3] = max(values[row, 3], 1e-3)
    right = replace(made, psf=Psf(values, 0.3, 532.5, "point"))
    off = values.copy()
    off[row, 3] *= 1 + 1e-5
    replace(made, psf=Psf(off, 0.3, 532.5, "point")).write(tmp_path / made.name)
    assert judged(right, tmp_path) == (1, 0)
    off[row, 3] = np.nan
    replace(made, psf=Psf(off, 0.3, 532.5, "point")).write(tmp_path / made.name)
    assert judged(right, tmp_path) == (1, 0)


def test_upside_down_and_another_size_are_found(made, tmp_path):
    replace(made, psf=replace(made.psf, values=made.psf.values[::-1])).write(tmp_path / made.name)
    assert judged(made, tmp_path)[0] > 60
    replace(made, psf=replace(made.psf, values=made.psf.values[1:-1, 1:-1])).write(tmp_path / made.name)
    assert judged(made, tmp_path)[0] == 81


@pytest.mark.parametrize(
    ("entry", "value"), [("step_um", 0.3000001), ("wavelength_nm", 532.4), ("axes", "?"), ("kind", "pixel")]
)
def test_an_entry_that_differs_or_is_missing_is_told(made, tmp_path, entry, value):
    replace(made, facts={**made.facts, entry: value}).write(tmp_path / made.name)
    assert judged(made, tmp_path) == (0, 1)
    assert f"{entry} is" in check_psf_file(made, tmp_path)[1].method
    without = {name: held for name, held in made.facts.items() if name != entry}
    replace(made, facts=without).write(tmp_path / made.name)
    assert judged(made, tmp_path) == (0, 1)
    made.write(tmp_path / made.name)
    assert judged(replace(made, facts=without), tmp_path) == (0, 1)


def test_what_is_no_psf_is_refused(made, tmp_path):
    with pytest.raises(SourceError, match="MF301"):
        check_psf_file(made, tmp_path)
    for content in (b"", b"no picture", b"\x76\x2f\x31\x01" + bytes(60)):
        (tmp_path / made.name).write_bytes(content)
        with pytest.raises(SourceError, match="MF303"):
            check_psf_file(made, tmp_path)
    write_psf(made.psf, tmp_path / made.name, {}, "somebody")
    whole = (tmp_path / made.name).read_bytes()
    (tmp_path / made.name).write_bytes(whole[:-40])
    with pytest.raises(SourceError, match="MF303"):
        check_psf_file(made, tmp_path)
