"""A finished directory is checked again from its files alone, and what is wrong is found and named."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import gdstk
import pytest
from klayout import db
from matplotlib.figure import Figure
from small_job import command, listing

import maskfab
from maskfab.base.errors import JobError, OutputError
from maskfab.base.model import Quantity
from maskfab.base.provenance import sha256_of_file
from maskfab.report.documents.report import SCHEMA_VERSION
from maskfab.report.figures.sheet import bitmap
from maskfab.runs.verification import _reported

pytestmark = pytest.mark.usefixtures("drawn_in_words", "verified_once")


@pytest.fixture
def copied(small_result, tmp_path) -> Path:
    """A copy of the finished directory, for each test its own."""
    return Path(shutil.copytree(small_result, tmp_path / "out"))


@pytest.fixture
def out(copied, read_here) -> Path:
    """The same, for tests that leave its files whole."""
    return copied


def failures(directory: Path) -> list[Quantity]:
    return [check for check in maskfab.verify(directory) if not check.passed]


def correct_manifest(directory: Path) -> None:
    """Write the true hashes of all files into the manifest, as a forger would."""
    manifest = json.loads((directory / "manifest.json").read_text(encoding="utf-8"))
    for file in manifest["files"]:
        path = directory / file["path"]
        file.update(sha256=sha256_of_file(path), bytes=path.stat().st_size)
    (directory / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


def move_first_polygon(path: Path, die: str, by_nm: int) -> None:
    """Turn one die's cells into polygons of its own and move the first of them, with klayout."""
    layout = db.Layout()
    layout.read(str(path))
    cell = layout.cell(die)
    cell.flatten(True)
    shape = next(cell.shapes(layout.layer(1, 0)).each())
    shape.transform(db.Trans(by_nm, 0))
    layout.write(str(path))


def edit_report(directory: Path, edit: Callable[[dict], object], *, corrected: bool = True) -> None:
    path = directory / "report.json"
    report = json.loads(path.read_text(encoding="utf-8"))
    edit(report)
    path.write_text(json.dumps(report), encoding="utf-8")
    if corrected:
        correct_manifest(directory)


def test_an_untouched_directory_passes(out):
    before = listing(out)
    checks = maskfab.verify(out)
    assert all(check.passed for check in checks)
    names = {check.name for check in checks}
    assert names >= {"sha256", "job_hash", "readback_xor_area", "readback_psf_difference", "reported_differences"}
    hashed = [check.method for check in checks if check.name == "sha256"]
    for path in out.iterdir():
        assert any(path.name in method for method in hashed) or path.name in {"manifest.json", "timing.json"}
    assert listing(out) == before


def test_a_moved_directory_passes(out, tmp_path, monkeypatch):
    out.rename(tmp_path / "moved")
    monkeypatch.chdir(tmp_path)
    assert failures(Path("moved")) == []


@pytest.mark.parametrize(
    "names", [["SMALL.oas"], ["SMALL.gds", "SMALL_R12.dxf", "job.json", "layers.lyp", "report.html"]]
)
def test_a_changed_byte_is_found_and_named(copied, names):
    for name in names:
        content = bytearray((copied / name).read_bytes())
        if name.endswith((".oas", ".gds")):
            content[len(content) // 2] ^= 0x01
        else:
            content[content.rindex(b" ")] = ord("\t")  # changes no meaning
        (copied / name).write_bytes(content)
    found = failures(copied)
    assert sorted(check.method for check in found if check.name == "sha256") == [f"SHA-256 of {name}" for name in names]
    assert all(any(name in check.method for name in names) for check in found)


@pytest.mark.parametrize("names", [["SMALL.gds"], ["SMALL_R12.dxf", "layers.lyp", "report.html"], ["report.json"]])
def test_a_missing_file_is_found_and_named(out, names):
    for name in names:
        (out / name).unlink()
    found = failures(out)
    assert sorted(check.method for check in found if check.name == "sha256") == [f"{name} is missing" for name in names]
    assert all(any(name in check.method for name in names) for check in found)


def test_a_missing_job_is_found_and_named(out):
    (out / "job.json").unlink()
    found = failures(out)
    assert {check.name for check in found} == {"sha256", "job"}
    assert all("job.json" in check.method for check in found)


@pytest.mark.parametrize("corrected", [False, True], ids=["as found", "hashes corrected"])
def test_a_moved_polygon_is_found_and_named(capsys, out, corrected):
    move_first_polygon(out / "SMALL.gds", "TURNED", 1)
    if corrected:
        correct_manifest(out)
    found = failures(out)
    assert any(check.name == "sha256" for check in found) is not corrected
    geometry = [check for check in found if check.name == "readback_xor_area"]
    assert {check.die for check in geometry} == {None, "TURNED"}
    assert all("SMALL.gds" in check.method for check in geometry)
    (of_plate,) = (check for check in geometry if check.die is None)
    assert "TURNED: " in of_plate.method
    assert "um^2 differ on CLEAR, first at (" in of_plate.method
    assert of_plate.value > 0
    answer = command(capsys, "verify", out, "--quiet")
    assert answer.code == 1
    assert "FAIL readback_xor_area [TURNED]" in answer.stderr
    assert "SMALL.gds" in answer.stderr


def test_a_polygon_moved_within_the_stop_changes_the_optics(out):
    move_first_polygon(out / "SMALL.gds", "TURNED", 8000)
    correct_manifest(out)
    found = failures(out)
    assert {check.die for check in found} <= {None, "TURNED"}
    assert {check.name for check in found if check.die} >= {"readback_xor_area", "readback_wrong_dots"}


def test_a_moved_polygon_of_the_oasis_file_is_found_and_named(out):
    layout = db.Layout()
    layout.read(str(out / "SMALL.oas"))
    unit = next(cell for cell in layout.each_cell() if cell.name.startswith("RING_") and cell.name.endswith("_R0"))
    shape = next(unit.shapes(layout.layer(1, 0)).each())
    shape.transform(db.Trans(0, 1))
    options = db.SaveLayoutOptions()
    options.format = "OASIS"
    layout.write(str(out / "SMALL.oas"), options)
    correct_manifest(out)
    found = [check for check in failures(out) if check.name == "readback_xor_area"]
    # Both dies have cells of that orientation.
    assert {check.die for check in found} == {None, "PLAIN", "TURNED"}
    assert all("SMALL.oas" in check.method for check in found)


def test_an_added_mark_is_found_and_named(out):
    library = gdstk.read_gds(out / "SMALL.gds")
    (top,) = library.top_level()
    top.add(gdstk.rectangle((5000, 5000), (5000.01, 5000.01), layer=1))
    library.write_gds(out / "SMALL.gds")
    correct_manifest(out)
    found = failures(out)
    assert {check.name for check in found} == {"readback_xor_area", "polygons", "judged_marks"}
    assert all("SMALL.gds" in check.method for check in found)


def test_a_moved_line_of_a_dxf_file_is_found_and_named(out):
    path = out / "SMALL_R12.dxf"
    text = path.read_text(encoding="ascii")
    place = text.index("POLYLINE", text.index("RING_"))
    vertex = text.index(" 10\n", text.index("VERTEX", place))
    line = text[vertex + 4 : text.index("\n", vertex + 4)]
    path.write_text(text[: vertex + 4] + f"{float(line) + 0.5:.3f}" + text[vertex + 4 + len(line) :], encoding="ascii")
    correct_manifest(out)
    found = failures(out)
    assert found
    assert all("SMALL_R12.dxf" in check.method for check in found)


@pytest.mark.parametrize(
    ("name", "content"),
    [("SMALL.oas", b""), ("SMALL_R2010.dxf", b"nothing of the kind"), ("SMALL.gds", b"\x00\x06\x00\x02")],
)
def test_a_file_that_cannot_be_read_is_found_and_named(copied, name, content):
    (copied / name).write_bytes(content)
    correct_manifest(copied)
    (unreadable,) = (check for check in failures(copied) if check.name == "readable")
    assert unreadable.method.startswith(f"{name}: MF30")


@pytest.mark.parametrize("corrected", [False, True], ids=["as found", "hash corrected"])
def test_an_edited_number_of_the_report_is_found_and_named(out, corrected):
    edited = {}

    def edit(report: dict) -> None:
        for die in report["dies"]:
            (quantity,) = (q for q in die["quantities"] if q["name"] == "mtf50")
            quantity["value"] *= 1.0001
            edited[die["name"]] = quantity["value"]

    edit_report(out, edit, corrected=corrected)
    found = failures(out)
    assert {check.name for check in found} == {"reported", "reported_differences"} | (
        set() if corrected else {"sha256"}
    )
    reported = [check for check in found if check.name == "reported"]
    assert len(reported) == 2
    for check, (die, value) in zip(reported, edited.items(), strict=True):
        assert check.method == f"dies, {die}, quantities, {die}, mtf50, 530 nm, value: measured now against report.json"
        assert check.limit == value
        assert check.value == pytest.approx(value / 1.0001, rel=1e-9)


def test_every_other_edit_of_the_report_is_found_and_named(out):
    def edit(report: dict) -> None:
        report.update(verdict="fail", job_hash="0" * 64, remark="all is well")
        report["seeds"]["TURNED"] = 4
        report["camera"]["focal_um"] = 5001.0
        plain, _ = report["dies"]
        plain["pitch_um"] = 57.0
        plain["quantities"].pop(0)
        report["dies"].pop()
        report["plate"][1].update(value=1, limit=1)
        report["checks"][0]["passed"] = False
        report["files"][0]["sha256"] = "0" * 64

    edit_report(out, edit)
    *reported, count = failures(out)
    assert all(check.name == "reported" for check in reported)
    assert sorted(check.method.removesuffix(": measured now against report.json") for check in reported) == [
        "camera, focal_um",
        "checks, readback_xor_area, passed",
        "dies, PLAIN, pitch_um",
        "dies, PLAIN, quantities, PLAIN, open_ratio",
        "dies, TURNED",
        "files, SMALL.gds, sha256",
        "job_hash",
        "plate, polygons, limit",
        "plate, polygons, value",
        "remark",
        "seeds, TURNED",
        "verdict",
    ]
    assert (count.name, count.value) == ("reported_differences", 12)


@pytest.mark.parametrize("content", ["{", "[]"])
def test_a_report_that_is_none_is_found(out, content):
    (out / "report.json").write_text(content)
    correct_manifest(out)
    assert any("report.json" in check.method for check in failures(out))


def test_the_time_that_a_run_took_is_no_fact(out):
    path = out / "timing.json"
    path.write_text(path.read_text().replace("optics", "optics of somebody else"))
    assert failures(out) == []


def test_a_later_version_verifies_what_an_earlier_one_made(out, monkeypatch):
    for module in ("base.provenance", "runs.verification", "report.documents.report"):
        monkeypatch.setattr(f"maskfab.{module}.__version__", "99.0.0")
    assert failures(out) == []


@pytest.mark.parametrize(("stated", "earlier"), [(1, True), (SCHEMA_VERSION + 1, False)])
def test_a_report_of_an_earlier_schema_is_said_to_be_one_and_compared(out, stated, earlier):
    def edit(report: dict) -> None:
        report.update(schema_version=stated, time={"seconds": {"optics": 3.0}})
        report["camera"]["focal_um"] = 5001.0

    edit_report(out, edit)
    found = failures(out)
    notes = [check.value for check in found if check.name == "report_schema"]
    assert notes == ([stated] if earlier else [])
    reported = [check for check in found if check.name == "reported"]
    assert any("camera, focal_um" in check.method for check in reported)
    assert any("schema_version" in check.method for check in reported) is not earlier
    assert {check.name for check in found if check.passed is False} == {"reported", "reported_differences"}


def test_a_die_that_was_emptied_is_found_and_named(out):
    library = gdstk.read_gds(out / "SMALL.gds")
    cell = next(cell for cell in library.cells if cell.name == "PLAIN")
    cell.remove(*cell.references)
    library.write_gds(out / "SMALL.gds")
    correct_manifest(out)
    found = failures(out)
    assert any(check.name == "optics" and "PLAIN" in check.method for check in found)
    assert any(check.name == "readback_xor_area" and check.die == "PLAIN" for check in found)


def test_a_job_that_cannot_be_laid_out_any_more_is_found(out):
    path = out / "job.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"56 um"', '"63 um"'), encoding="utf-8")
    correct_manifest(out)
    (found,) = failures(out)
    assert found.method.startswith("job.json cannot be used: MF153 2 faults")
    assert "MF106" in found.method


def test_an_edited_job_is_found(out):
    path = out / "job.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"seed": 3', '"seed": 4'), encoding="utf-8")
    correct_manifest(out)
    found = failures(out)
    assert any(check.name == "job_hash" and "job.json" in check.method for check in found)
    assert any(check.die == "TURNED" for check in found)
    assert not any(check.die == "PLAIN" for check in found)


# --- not a result ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "manifest",
    [None, "", "{", "[]", "3", "{}", '{"files": 3}', '{"files": [3]}', '{"files": [{"path": "x"}]}',
     '{"name": "My extension", "manifest_version": 3}'],
)  # fmt: skip
def test_what_is_no_result_is_refused(capsys, tmp_path, manifest):
    if manifest is not None:
        (tmp_path / "manifest.json").write_text(manifest)
    with pytest.raises(OutputError, match="MF403"):
        maskfab.verify(tmp_path)
    answer = command(capsys, "verify", tmp_path, "--json")
    assert answer.code == 2
    assert answer.document["error"]["code"] == "MF403"
    assert str(tmp_path) in answer.stderr


def test_a_directory_that_is_not_there_is_no_result(tmp_path):
    with pytest.raises(OutputError, match="MF403"):
        maskfab.verify(tmp_path / "none")
    with pytest.raises(JobError, match=r"MF105.*test_verify"):
        maskfab.verify(__file__)


def test_a_manifest_may_not_point_out_of_its_directory(out, tmp_path):
    (tmp_path / "secret").write_text("mine")
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    manifest["files"].append({"path": "../secret", "bytes": 4, "sha256": sha256_of_file(tmp_path / "secret")})
    (out / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    assert any("../secret" in check.method for check in failures(out))


def test_a_manifest_that_lists_no_mask_hides_nothing(out):
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    manifest["files"] = [file for file in manifest["files"] if file["path"] != "SMALL.oas"]
    (out / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    (out / "SMALL.oas").unlink()
    assert any("SMALL.oas" in check.method for check in failures(out))


def forged(path: Path, edit: Callable[[str], str]) -> None:
    text = path.read_text(encoding="utf-8")
    assert edit(text) != text
    path.write_text(edit(text), encoding="utf-8")


def test_a_page_markers_colours_or_a_picture_that_were_forged_are_each_named(out):
    """All at once, with their hashes renewed: each is made again and compared."""
    forged(out / "report.html", lambda text: text.replace("SMALL PLATE", "ANOTHER PLATE", 1))
    forged(out / "appendix.html", lambda text: text.replace("SMALL PLATE", "ANOTHER PLATE", 1))
    forged(out / "numbers.csv", lambda text: text.replace("open_ratio", "closed_ratio", 1))
    forged(out / "SMALL.lyrdb", lambda text: text.replace("<items>", "<items><!-- none -->"))
    forged(out / "layers.lyp", lambda text: text.replace("<visible>true", "<visible>false"))
    forged(out / "job.json", lambda text: text + "\n")
    (out / "overview.png").write_bytes(bitmap(Figure()))
    correct_manifest(out)
    found = {check.method.split()[0]: check.value for check in failures(out) if check.name == "made_again"}
    assert found.keys() == {
        "report.html",
        "appendix.html",
        "numbers.csv",
        "SMALL.lyrdb",
        "layers.lyp",
        "job.json",
        "overview.png",
    }
    assert found["report.html"] == found["appendix.html"] == "other text"


def test_a_figure_of_the_page_that_was_forged_is_named(out):
    forged(out / "report.html", lambda text: text.replace("%3C/text%3E", "0%3C/text%3E", 1))
    correct_manifest(out)
    (found,) = failures(out)
    assert found.method.startswith("report.html made again")
    assert found.value.startswith("other ")


def test_what_other_versions_made_otherwise_is_told_and_not_judged(out):
    forged(out / "report.html", lambda text: text.replace("SMALL PLATE", "ANOTHER PLATE", 1))
    correct_manifest(out)
    path = out / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    manifest["versions"]["matplotlib"] = "0.1"
    path.write_text(json.dumps(manifest), encoding="utf-8")
    (found,) = failures(out)
    assert (found.name, found.passed) == ("made_again", None)


PHOTOGRAPHED = {
    "schema_version": SCHEMA_VERSION,
    "photographs": {"dies": [{"name": "A", "levels": [{"level_db": 24.0, "epsilon": 0.1, "psnr": [20.0, 30.0]}]}]},
    "dies": [{"name": "A", "quantities": [{"name": "restored_psnr", "level_db": 24.0, "value": 25.0}]}],
}


def told_of(folder: Path, then: dict, now: dict | None = None) -> dict[str, object]:
    (folder / "report.json").write_text(json.dumps(then))
    return {check.name: check.method for check in _reported(folder, now or PHOTOGRAPHED) if not check.passed}


def test_a_schema_that_is_no_number_is_a_difference(tmp_path):
    assert "schema_version" in told_of(tmp_path, {**PHOTOGRAPHED, "schema_version": "two"})["reported"]


@pytest.mark.parametrize(("by", "told"), [(0.1, False), (0.5, True)], ids=["another draw of noise", "a better number"])
def test_a_number_of_photographs_is_compared_as_far_as_noise_allows(tmp_path, by, told):
    then = copy.deepcopy(PHOTOGRAPHED)
    assert told_of(tmp_path, then) == {}
    then["photographs"]["dies"][0]["levels"][0]["psnr"][1] += by
    assert ("photographs, dies, A, levels, 24 dB, psnr, 1" in told_of(tmp_path, then).get("reported", "")) is told
