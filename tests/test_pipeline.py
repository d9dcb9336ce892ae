"""The chain as a whole: equal jobs give equal bytes, a failure leaves nothing, the hash follows the content."""

from __future__ import annotations

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from klayout import db
from small_job import OPENING, command, finished, listing, write_job

import maskfab
from maskfab import resources
from maskfab.errors import JobError
from maskfab.layout.job import load
from maskfab.pipeline import draw_files
from maskfab.provenance import sha256_of_file

PITCH = 'dot = "8 um"\npitch = "56 um"'
LIMITS = '[limits]\ncorner_touches = {}\nmin_feature = "{}"\nmin_space = "{}"\n\n[plate]'


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    return finished(tmp_path_factory.mktemp("pipeline"))


@pytest.fixture(scope="module")
def report(out) -> dict:
    return json.loads((out / "report.json").read_text(encoding="utf-8"))


def quantities(report: dict, name: str) -> list[dict]:
    found = [q for die in report["dies"] for q in die["quantities"] if q["name"] == name]
    assert found, name
    return found


# --- the same again --------------------------------------------------------------------------------------------------


def test_a_run_repeated_gives_the_same_bytes(capsys, out, tmp_path):
    """Elsewhere, and from nothing but the job that the first run kept."""
    alone, again = tmp_path / "job.json", tmp_path / "again"
    alone.write_bytes((out / "job.json").read_bytes())
    assert command(capsys, "run", alone, "--out", again, "--quiet").code == 0
    first, second = listing(out), listing(again)
    assert first.keys() == second.keys()
    timed = {"report.json", "manifest.json"}
    for name in first.keys() - timed:
        assert first[name] == second[name], name
    reports = [json.loads(content["report.json"]) for content in (first, second)]
    for one in reports:
        assert one.pop("time")["seconds"].keys() >= {"layout", "write", "read back", "optics"}
    assert reports[0] == reports[1]
    manifests = [json.loads(content["manifest.json"]) for content in (first, second)]
    for one in manifests:
        one["files"] = [file for file in one["files"] if file["path"] != "report.json"]
    assert manifests[0] == manifests[1]


def test_no_file_holds_the_place_it_was_made_in(out):
    for name, content in listing(out).items():
        assert str(out.parent).encode() not in (content or b""), name


def test_no_file_holds_the_time_it_was_made_at(out):
    header = (out / "SMALL.gds").read_bytes()[:40]
    assert header[6:10] == b"\x00\x1c\x01\x02"  # BGNLIB: six numbers of modification, six of access
    assert header[10:34] == bytes(24)


def test_the_manifest_lists_every_other_file_with_its_hash(out):
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    assert {file["path"] for file in manifest["files"]} == {p.name for p in out.iterdir()} - {"manifest.json"}
    for file in manifest["files"]:
        assert file["sha256"] == sha256_of_file(out / file["path"])
        assert file["bytes"] == (out / file["path"]).stat().st_size
    assert manifest["seeds"] == {"TURNED": 3}
    assert manifest["versions"]["maskfab"] == maskfab.__version__


@pytest.mark.parametrize("name", ["SMALL.gds", "SMALL.oas", "SMALL_R12.dxf", "SMALL_R2010.dxf", "report.html"])
def test_every_artefact_names_its_job(out, report, name):
    assert report["job_hash"][:16].encode() in (out / name).read_bytes()


# --- what is in the files --------------------------------------------------------------------------------------------


def test_every_mask_file_is_the_plate(out):
    """All four, read by klayout alone, against the dots themselves, of both dies."""
    job = load(out / "job.json")
    plate = job.plate()
    assert {path.name for path in out.iterdir()} >= {product.name for product in draw_files(job, plate).products}
    for die in plate.dies:
        (x0, y0, _, _), panel = die.box_nm, die.panel
        wanted = db.Region()
        for row, line in enumerate(panel.orientations):
            for column, orientation in enumerate(line):
                mask = np.rot90(panel.opening.mask[:, :: -1 if orientation >= 4 else 1], -(orientation % 4))
                x, y = x0 + column * panel.pitch_nm, y0 + row * panel.pitch_nm
                for j, i in np.argwhere(mask).tolist():
                    wanted.insert(db.Box(x + i * 8000, y + j * 8000, x + (i + 1) * 8000, y + (j + 1) * 8000))
        assert wanted.area() == 100 * 15 * 8000**2
        for name in ("SMALL.gds", "SMALL.oas"):
            layout = db.Layout()
            layout.read(str(out / name))
            shapes = layout.top_cell().begin_shapes_rec_touching(layout.layer(1, 0), db.Box(*die.box_nm))
            assert (db.Region(shapes).merged() ^ wanted.merged()).is_empty(), name


def test_what_was_read_back_is_what_was_designed(report):
    for quantity in quantities(report, "readback_psf_difference"):
        assert 0 < quantity["value"] < 1e-6
        assert quantity["uncertainty"] == pytest.approx(1e-8)
    xor = quantities(report, "readback_xor_area")
    assert len(xor) == 2 * 4  # dies x files
    assert {q["value"] for q in xor} == {0}
    assert {q["value"] for q in quantities(report, "readback_wrong_dots")} == {0}
    of_plate = [q for q in report["plate"] if q["name"] == "readback_xor_area"]
    assert [q["value"] for q in of_plate] == [0, 0, 0, 0]


def test_corner_touches_are_counted(report):
    """The opening alone has one pair of dots that meet by a corner: '#.' over '.#' in the middle of its lower half."""
    plain, turned = quantities(report, "corner_touches")
    mask = np.pad(load_mask(), ((1, 1), (1, 1)))
    blocks = np.lib.stride_tricks.sliding_window_view(mask, (2, 2)).reshape(-1, 4)
    touches = sum(tuple(block) in {(True, False, False, True), (False, True, True, False)} for block in blocks.tolist())
    assert touches >= 1
    # The border of the opening is opaque, so cells do not touch each other, however they are turned.
    assert plain["value"] == turned["value"] == 100 * touches


def load_mask() -> np.ndarray:
    rows = tomllib.loads(OPENING)["grid"].split()
    return np.array([[character == "#" for character in row] for row in rows])


def test_limits_make_a_check_fail_and_the_files_are_there(capsys, tmp_path):
    job = write_job(tmp_path, ("[plate]", LIMITS.format(0, "20 um", "1 um")))
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json")
    assert answer.code == 1
    assert answer.document["verdict"] == "fail"
    failed = {(q["name"], q["die"]) for q in answer.document["checks"] if q["passed"] is False}
    assert failed == {(name, die) for name in ("corner_touches", "min_feature") for die in ("PLAIN", "TURNED")}
    (feature, _) = quantities(answer.document, "min_feature")
    assert (feature["value"], feature["limit"], feature["unit"]) == (8.0, 20.0, "um")
    assert (tmp_path / "out" / "SMALL.gds").stat().st_size > 0
    assert "fail" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8").lower()
    answer = command(capsys, "verify", tmp_path / "out", "--quiet")
    assert answer.code == 1
    assert "FAIL min_feature [PLAIN]" in answer.stderr
    assert "sha256" not in answer.stderr


# --- a failure in the middle -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", ["write_files", "read_back", "measure_dies", "figures.pictures"])
def test_a_crash_in_the_middle_leaves_nothing(tmp_path, monkeypatch, step):
    def crash(*_: object) -> None:
        raise RuntimeError(step)

    monkeypatch.setattr(f"maskfab.pipeline.{step}", crash)
    job = write_job(tmp_path)
    before = listing(tmp_path)
    with pytest.raises(RuntimeError, match=step):
        maskfab.run(job, tmp_path / "out")
    assert listing(tmp_path) == before


def test_a_crash_in_the_middle_leaves_an_earlier_result(out, tmp_path, monkeypatch):
    shutil.copytree(out, tmp_path / "out")
    before = listing(tmp_path / "out")

    def crash(*_: object) -> None:
        raise RuntimeError("half way")

    monkeypatch.setattr("maskfab.pipeline.measure_dies", crash)
    with pytest.raises(RuntimeError, match="half way"):
        maskfab.run(write_job(tmp_path), tmp_path / "out", force=True)
    assert listing(tmp_path / "out") == before
    assert {path.name for path in tmp_path.iterdir()} == {"job.toml", "ring.toml", "out"}


# --- the hash of a job -----------------------------------------------------------------------------------------------


def digest(folder: Path, *edits: tuple[str, str], opening: str = OPENING) -> str:
    return load(write_job(folder, *edits, opening=opening)).digest


SAME = {
    "comment": [("[plate]", "# a remark\n[plate]")],
    "unit": [('pitch = "56 um"', 'pitch = "0.056 mm"'), ('"5 mm"', '"0.5 cm"'), ('"530 nm"', '"0.53 um"')],
    "spelling": [('dot = "8 um"', 'dot = "8.0µm"'), ('pixel = "2 um"', 'pixel = "2e3 nm"')],
    "order": [('focal = "5 mm"\n', ""), ('pixel = "2 um"\n', 'pixel = "2 um"\nfocal = "5 mm"\n')],
    "default": [('shape = "circle", ', "")],
    "default written out": [('tiling = "periodic"', 'tiling = "periodic"\ngutter = "0 um"')],
    "table": [
        ('stop = { shape = "circle", diameter = "400 um" }\n', ""),
        ("[plate]", '[camera.stop]\ndiameter = "0.4 mm"\n[plate]'),
    ],
}  # fmt: skip

OTHER = {
    "seed": ("seed = 3", "seed = 4"),
    "title": ("SMALL PLATE", "SMALL PLATES"),
    "tiling": ('tiling = "random"', 'tiling = "paper4"'),
    "wavelength": ('"530 nm"', '"530.001 nm"'),
    "limit": ("[plate]", "[limits]\ncorner_touches = 0\n[plate]"),
    "window": ('"64 um"', '"66 um"'),
}


@pytest.mark.parametrize("case", SAME)
def test_the_hash_of_a_job_does_not_depend_on_how_it_is_written(tmp_path, case):
    assert digest(tmp_path / "a", *SAME[case]) == digest(tmp_path / "b")


@pytest.mark.parametrize("case", OTHER)
def test_the_hash_of_a_job_depends_on_what_it_says(tmp_path, case):
    assert digest(tmp_path / "a", OTHER[case]) != digest(tmp_path / "b")


def test_168_um_in_any_unit_is_one_length(tmp_path):
    hashes = {
        digest(
            tmp_path,
            (PITCH, f'dot = "24 um"\npitch = "{text}"'),
            (PITCH, f'dot = "24 um"\npitch = "{text}"'),
            ('die_size = "560 um"', 'die_size = "1008 um"'),
            ('window = "64 um"', 'window = "60 um"'),
        )
        for text in ("168 um", "0.168 mm", "168000 nm", "1.68e-4 m", "168µm")
    }
    assert len(hashes) == 1


def test_the_hash_follows_every_dot_and_no_remark_of_an_opening(tmp_path):
    first = digest(tmp_path)
    assert digest(tmp_path, opening="# a remark\n" + OPENING) == first
    assert digest(tmp_path, opening=OPENING.replace(".##.#..", ".##.##.", 1)) != first
    assert digest(tmp_path, opening=OPENING.replace('"ring"', '"rang"')) != first


def test_the_hash_does_not_depend_on_where_the_opening_lies(tmp_path):
    moved = write_job(tmp_path / "a", ('"ring.toml"', '"deep/ring.toml"'), ('"ring.toml"', '"deep/ring.toml"'))
    (moved.parent / "deep").mkdir()
    (moved.parent / "ring.toml").rename(moved.parent / "deep" / "ring.toml")
    assert load(moved).digest == digest(tmp_path / "b")


def test_the_kept_job_is_the_job(out, report, tmp_path):
    kept = load(out / "job.json")
    assert kept.digest == report["job_hash"] == digest(tmp_path)
    assert kept.spec.dump() == json.loads((out / "job.json").read_text(encoding="utf-8"))
    assert kept.seeds == {"TURNED": 3}


def test_two_openings_of_one_name_are_refused_if_they_differ(tmp_path):
    job = write_job(tmp_path)
    head, plain, turned = job.read_text().split("[[die]]")
    job.write_text("[[die]]".join([head, plain, turned.replace("ring.toml", "other.toml")]))
    (tmp_path / "other.toml").write_text(OPENING)
    assert len(load(job).openings) == 2
    (tmp_path / "other.toml").write_text(OPENING.replace(".##.#..", ".##.##.", 1))
    with pytest.raises(JobError, match="MF109 two different openings have the name 'ring'"):
        load(job)


# --- from Python -----------------------------------------------------------------------------------------------------


def test_run_takes_a_loaded_job_and_tells_where_it_stands(tmp_path):
    job = maskfab.load_job(write_job(tmp_path))
    one_die = replace(job, spec=job.spec.model_copy(update={"die": job.spec.die[:1]}))
    told: list[tuple[str, int, int]] = []
    result = maskfab.run(one_die, tmp_path / "out", progress=lambda *step: told.append(step))
    assert result.directory == tmp_path / "out"
    assert result.report.passed
    assert list(result.report.dies) == ["PLAIN"]
    stages = [name for name, _, _ in told]
    assert list(dict.fromkeys(stages)) == ["write files", "read back", "optics", "figures"]
    for name in set(stages):
        steps = [(done, total) for stage, done, total in told if stage == name]
        assert steps[-1][0] == steps[-1][1]
        assert steps == sorted(steps)


def test_the_shipped_plate_is_laid_out():
    job = load(resources.path("layouts/upc12.toml"))
    plate = job.plate()
    assert len(plate.dies) == 12
    assert len({die.name for die in plate.dies}) == 12
    boxes = [die.box_nm for die in plate.dies]
    half = plate.writable_nm // 2
    for number, (x0, y0, x1, y1) in enumerate(boxes):
        assert max(abs(x0), abs(x1), abs(y0), abs(y1)) < half
        for a0, b0, a1, b1 in boxes[:number]:
            assert x0 >= a1 or a0 >= x1 or y0 >= b1 or b0 >= y1


SCENE = """\
[scene]
accuracy = 0.4
gap = "60 um"
field = "3 mm"
depth = ["100 mm", "inf"]

[plate]"""


def test_a_scene_is_planned_modelled_and_reported(capsys, tmp_path):
    job, out, again = write_job(tmp_path, ("[plate]", SCENE)), tmp_path / "out", tmp_path / "again"
    answer = command(capsys, "run", job, "--out", out)
    assert answer.code == 0
    assert [line for line in answer.stderr.splitlines() if line.startswith("PLAIN: optics ") and ", scene " in line]
    document = json.loads((out / "report.json").read_text(encoding="utf-8"))
    for die in document["dies"]:
        scene = die["scene"]
        assert (scene["asked"]["nearest_um"], scene["asked"]["farthest_um"]) == (1e5, None)
        rows = {row["name"]: row for row in scene["plan"]["ingredients"]}
        assert rows["shift through the gap"]["modelled"]
        assert not rows["diffraction over the gap"]["modelled"]
        judged = [quantity for quantity in scene["quantities"] if quantity["passed"] is not None]
        assert {quantity["name"] for quantity in judged} == {"plan_error", "plan_error_measured"}
        assert all(quantity in document["checks"] for quantity in judged)
        assert len(scene["field"]) == 5
        assert len(scene["depth"]) == 2
        # The plate's own numbers stay what they are without a scene.
        assert not {"plan_error", "field_residual"} & {quantity["name"] for quantity in die["quantities"]}
    assert document["time"]["seconds"].keys() >= {"plan", "scene", "scene PLAIN", "scene TURNED"}
    assert command(capsys, "verify", out, "--quiet").code == 0
    assert command(capsys, "run", out / "job.json", "--out", again, "--quiet").code == 0
    assert (out / "report.html").read_bytes() == (again / "report.html").read_bytes()


@pytest.mark.parametrize(
    ("scene", "code"),
    [('accuracy = "certify"\ngap = "100 um"', "MF115"), ('accuracy = 0.5\ngap = "1 mm"\nfield = "2 mm"', "MF114")],
)
def test_a_scene_that_cannot_be_modelled_is_refused_before_anything_is_written(capsys, tmp_path, scene, code):
    job, out = write_job(tmp_path, ("[plate]", f"[scene]\n{scene}\n\n[plate]")), tmp_path / "out"
    answer = command(capsys, "run", job, "--out", out, "--json", "--quiet")
    assert answer.code == 2
    assert answer.document["error"]["code"] == code
    assert "die PLAIN" in answer.document["error"]["where"]
    assert not out.exists()


def test_without_a_scene_nothing_is_planned_or_shown(out, report):
    assert all("scene" not in die for die in report["dies"])
    assert "<h3>Scene</h3>" not in (out / "report.html").read_text(encoding="utf-8")
