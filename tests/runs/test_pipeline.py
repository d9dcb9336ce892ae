"""The chain as a whole: equal jobs give equal bytes, a failure leaves nothing, the hash follows the content."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from klayout import db, rdb
from small_job import OPENING, command, finished, listing, with_the_die, write_job

import maskfab
from maskfab.base import resources
from maskfab.base.errors import JobError, OutputError
from maskfab.base.model import Quantity
from maskfab.base.provenance import sha256_of_file
from maskfab.base.work import silent
from maskfab.base.workers import Workers
from maskfab.mask.formats import gdsii
from maskfab.mask.job import load_job, resolve
from maskfab.runs import pipeline
from maskfab.runs.plate_files import check_rules, draw_files, write_files
from maskfab.runs.result import Result
from maskfab.runs.store import of_installation

pytestmark = pytest.mark.usefixtures("read_here")

PITCH = 'dot = "8 um"\npitch = "56 um"'
ONE_FILE = ("[plate]", '[export]\nformats = ["gdsii"]\n\n[plate]')
LIMITS = '[limits]\ncorner_touches = {}\nmin_feature = "{}"\nmin_space = "{}"\n\n[plate]'


@pytest.fixture(scope="module")
def out(small_result) -> Path:
    return small_result


@pytest.fixture(scope="module")
def report(out) -> dict:
    return json.loads((out / "report.json").read_text(encoding="utf-8"))


def quantities(report: dict, name: str) -> list[dict]:
    found = [q for die in report["dies"] for q in die["quantities"] if q["name"] == name]
    assert found, name
    return found


# --- the same again --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_run_repeated_gives_the_same_bytes(capsys, tmp_path):
    """Elsewhere, and from nothing but the job that the first run kept; figures are drawn as they are, each time."""
    out, alone, again = tmp_path / "out", tmp_path / "job.json", tmp_path / "again"
    assert command(capsys, "run", with_the_die("TURNED", write_job(tmp_path)), "--out", out, "--quiet").code == 0
    alone.write_bytes((out / "job.json").read_bytes())
    assert command(capsys, "run", alone, "--out", again, "--quiet").code == 0
    first, second = listing(out), listing(again)
    assert first.keys() == second.keys()
    for name in first.keys() - {"timing.json"}:
        assert first[name] == second[name], name
    for content in (first, second):
        times = json.loads(content["timing.json"])
        assert times["seconds"].keys() >= {"layout", "write", "read back", "optics", "figures"}


@pytest.mark.parametrize("processes", [2, pytest.param(8, marks=pytest.mark.slow)])
def test_no_number_of_processes_shows(out, tmp_path, monkeypatch, processes):
    """Against the plate that one process made."""
    monkeypatch.setattr("maskfab.runs.stages.tasks_at_once", lambda job: processes)
    again = pipeline.run(out / "job.json", tmp_path / "out", workers=Workers(processes)).directory
    for name in ("SMALL.gds", "SMALL.oas", "report.json", "numbers.csv"):
        assert (again / name).read_bytes() == (out / name).read_bytes(), name


def test_a_cluster_makes_what_one_process_makes(out, tmp_path):
    """Large arguments are sent apart, for the graph of tasks would warn of them."""
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra cluster)")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr("maskfab.base.workers._SENT_APART", 1000)
        workers = Workers(scheduler=cluster.scheduler_address, installation=of_installation)
        again = pipeline.run(out / "job.json", tmp_path / "out", workers=workers).directory
    for name in ("SMALL.gds", "SMALL.oas", "report.json", "numbers.csv"):
        assert (again / name).read_bytes() == (out / name).read_bytes(), name


def test_no_file_holds_the_place_it_was_made_in(out):
    for name, content in listing(out).items():
        assert str(out.parent).encode() not in (content or b""), name


def test_no_file_holds_the_time_it_was_made_at(out):
    header = (out / "SMALL.gds").read_bytes()[:40]
    assert header[6:10] == b"\x00\x1c\x01\x02"  # BGNLIB: six numbers of modification, six of access
    assert header[10:34] == bytes(24)


def test_the_manifest_lists_every_other_file_with_its_hash(out):
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    others = {path.name for path in out.iterdir()} - {"manifest.json", "timing.json"}
    assert {file["path"] for file in manifest["files"]} == others
    for file in manifest["files"]:
        assert file["sha256"] == sha256_of_file(out / file["path"])
        assert file["bytes"] == (out / file["path"]).stat().st_size
    assert manifest["seeds"] == {"TURNED": 3}
    assert manifest["versions"]["maskfab"] == maskfab.__version__
    assert {"klayout", "cadquery", "manifold3d", "openimageio"} <= set(manifest["versions"])
    assert not {"pytest", "dask"} & set(manifest["versions"])


@pytest.mark.parametrize("name", ["SMALL.gds", "SMALL.oas", "SMALL_R12.dxf", "SMALL_R2010.dxf", "report.html"])
def test_every_artefact_names_its_job(out, report, name):
    assert report["job_hash"][:16].encode() in (out / name).read_bytes()


# --- what is in the files --------------------------------------------------------------------------------------------


def test_every_mask_file_is_the_plate(out):
    """All four, read by klayout alone, against the dots themselves, of both dies."""
    job = load_job(out / "job.json")
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
        assert quantity["uncertainty"] == pytest.approx(4e-8)
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


@pytest.mark.usefixtures("drawn_in_words", "measured_once")
def test_limits_make_a_check_fail_and_the_files_are_there(capsys, tmp_path):
    job = write_job(tmp_path, ("[plate]", LIMITS.format(0, "20 um", "1 um")), ONE_FILE)
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


@pytest.mark.parametrize(
    "step",
    ["pipeline.write_files", "plate_files.read_back", "pipeline.measure_dies", "drawing.report_figures.pictures"],
)
def test_a_crash_in_the_middle_leaves_nothing(tmp_path, monkeypatch, step):
    def crash(*_: object, **__: object) -> None:
        raise RuntimeError(step)

    monkeypatch.setattr(f"maskfab.runs.{step}", crash)
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

    monkeypatch.setattr("maskfab.runs.pipeline.measure_dies", crash)
    with pytest.raises(RuntimeError, match="half way"):
        maskfab.run(write_job(tmp_path), tmp_path / "out", force=True)
    assert listing(tmp_path / "out") == before
    assert {path.name for path in tmp_path.iterdir()} == {"job.toml", "ring.toml", "out"}


# --- the hash of a job -----------------------------------------------------------------------------------------------


def digest(folder: Path, *edits: tuple[str, str], opening: str = OPENING) -> str:
    return load_job(write_job(folder, *edits, opening=opening)).digest


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


@pytest.mark.usefixtures("drawn_in_words", "measured_once")
@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda layout: layout.set_info(layout.find_layer(1, 0), db.LayerInfo(7, 0)), "nothing clear before the stop"),
        (lambda layout: setattr(layout, "dbu", 10 * layout.dbu), "nothing clear before the stop"),
        (lambda layout: setattr(layout, "dbu", 1000 * layout.dbu), "cannot be read back"),
    ],
    ids=["layer", "unit", "far"],
)
def test_a_writer_that_spoils_its_file_is_told_as_such(capsys, tmp_path, monkeypatch, spoil, told):
    real = gdsii.layout_bytes

    def content(layout, path, options):
        spoilt = layout.dup()
        spoil(spoilt)
        return real(spoilt, path, options)

    monkeypatch.setattr(gdsii, "layout_bytes", content)
    job = write_job(tmp_path, ("[plate]", '[export]\nformats = ["gdsii"]\n\n[plate]'))
    before = listing(tmp_path)
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json", "--quiet")
    assert (answer.code, answer.document["error"]["code"]) == (3, "MF324")
    assert told in answer.document["error"]["what"]
    assert answer.document["error"]["cure"]
    assert listing(tmp_path) == before


@pytest.mark.parametrize(
    "error",
    [MemoryError(), RuntimeError("std::bad_alloc"), OSError(errno.ENOMEM, "x"), ImportError("failed to map segment")],
    ids=lambda error: type(error).__name__,
)
def test_a_lack_of_memory_is_told_with_its_limit_and_leaves_nothing(capsys, tmp_path, monkeypatch, error):
    def full(*_):
        raise error

    monkeypatch.setattr(pipeline, "write_files", full)
    job = with_the_die("PLAIN", write_job(tmp_path))
    before = listing(tmp_path)
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json", "--quiet")
    told = answer.document["error"]
    assert (answer.code, told["code"]) == (2, "MF325")
    assert "limit" in told["what"]
    assert "ulimit -v" in told["what"] + told["cure"]
    assert listing(tmp_path) == before


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="limits of POSIX")
def test_a_limit_of_the_shell_on_memory_is_told(tmp_path):
    told = subprocess.run(
        ["sh", "-c", f"ulimit -v 600000; {sys.executable} -m maskfab run {write_job(tmp_path)} --out {tmp_path}/out"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert told.returncode == 2
    assert "MF325" in told.stderr
    assert "614 MB (ulimit -v)" in told.stderr


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
    assert load_job(moved).digest == digest(tmp_path / "b")


def test_the_kept_job_is_the_job(out, report, tmp_path):
    kept = load_job(out / "job.json")
    assert kept.digest == report["job_hash"] == digest(tmp_path)
    assert kept.spec.dump() == json.loads((out / "job.json").read_text(encoding="utf-8"))
    assert kept.seeds == {"TURNED": 3}


def test_two_openings_of_one_name_are_refused_if_they_differ(tmp_path):
    job = write_job(tmp_path)
    head, plain, turned = job.read_text().split("[[die]]")
    job.write_text("[[die]]".join([head, plain, turned.replace("ring.toml", "other.toml")]))
    (tmp_path / "other.toml").write_text(OPENING)
    assert len(load_job(job).openings) == 2
    (tmp_path / "other.toml").write_text(OPENING.replace(".##.#..", ".##.##.", 1))
    with pytest.raises(JobError, match=r"MF109 .*two different openings have the name 'ring'"):
        load_job(job)


# --- from Python -----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("drawn_in_words", "measured_once")
def test_run_takes_a_loaded_job_and_tells_where_it_stands(tmp_path):
    job = maskfab.load_job(write_job(tmp_path))
    one_die = resolve(job.spec.model_copy(update={"die": job.spec.die[:1]}), Path(job.where))
    told: list[tuple[str, int, int]] = []
    result = maskfab.run(one_die, tmp_path / "out", progress=lambda *step: told.append(step))
    assert result.directory == tmp_path / "out"
    assert result.report.passed
    assert list(result.report.dies) == ["PLAIN"]
    stages = [name for name, _, total in told if total]
    assert list(dict.fromkeys(stages)) == ["write files", "read back", "optics", "photographs", "figures"]
    for name in set(stages):
        steps = [(done, total) for stage, done, total in told if stage == name]
        assert steps[-1][0] == steps[-1][1]
        assert steps == sorted(steps)


def test_the_shipped_plate_is_laid_out():
    job = load_job(resources.path("layouts/upc12.toml"))
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
gap = "50 um"
field = "3 mm"
depth = ["100 mm", "inf"]

[plate]"""


@pytest.mark.usefixtures("drawn_in_words", "measured_once")
def test_a_scene_is_planned_modelled_and_reported(capsys, tmp_path):
    job, out = with_the_die("PLAIN", write_job(tmp_path, ("[plate]", SCENE), ONE_FILE)), tmp_path / "out"
    answer = command(capsys, "run", job, "--out", out)
    assert answer.code == 0
    assert [line for line in answer.stderr.splitlines() if line.startswith("PLAIN: optics ") and ", scene " in line]
    document = json.loads((out / "report.json").read_text(encoding="utf-8"))
    for die in document["dies"]:
        scene = die["scene"]
        assert (scene["asked"]["nearest_um"], scene["asked"]["farthest_um"]) == (1e5, None)
        rows = {row["name"]: row for row in scene["plan"]["ingredients"]}
        assert rows["shift through the gap"]["modelled"]
        assert rows["oblique light"]["modelled"]
        # Nothing needs a near scale.
        assert not rows["scale of a near focus"]["modelled"]
        judged = [quantity for quantity in scene["quantities"] if quantity["passed"] is not None]
        assert {quantity["name"] for quantity in judged} == {"plan_error", "plan_error_measured"}
        assert all(quantity in document["checks"] for quantity in judged)
        assert len(scene["field"]) == 5
        corner = scene["field"][0][0]
        assert (corner["angle_deg"] > 20) == (corner["illumination"] < 0.8) == (corner["restored_loss_db"] > 0) is True
        assert len(scene["depth"]) == 2
        # The plate's own numbers stay what they are without a scene.
        assert not {"plan_error", "field_residual"} & {quantity["name"] for quantity in die["quantities"]}
    times = json.loads((out / "timing.json").read_text(encoding="utf-8"))
    assert times["seconds"].keys() >= {"plan", "scene", "scene PLAIN"}
    assert command(capsys, "verify", out, "--quiet").code == 0


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


def test_without_a_scene_and_a_process_nothing_is_planned_or_shown(out, report):
    assert all("scene" not in die for die in report["dies"])
    assert not [q for die in report["dies"] for q in die["quantities"] if q["name"].startswith("written_")]
    page = (out / "appendix.html").read_text(encoding="utf-8")
    assert not any(f"<h3>{title}</h3>" in page for title in ("Scene", "As written"))


# --- [export] and [process] ------------------------------------------------------------------------------------------

EVERY_FORMAT = """\
[export]
formats = ["gdsii", "oasis", "cif", "dxf_r12", "dxf_r2010", "gerber", "svg", "step", "glb", "3mf", "stl", "png", "tiff"]
dots_per_um = 0.25

[plate]"""


LAYOUTS = """\
[export]
formats = ["gdsii", "oasis", "cif", "dxf_r12", "dxf_r2010", "gerber", "svg"]

[plate]"""

WRITE = """\
import locale, sys
from pathlib import Path
from maskfab.mask.job import load_job
from maskfab.runs.plate_files import draw_files, write_files
from maskfab.base.work import silent
from maskfab.base.workers import Workers

locale.setlocale(locale.LC_ALL, "")
job, folder = load_job(sys.argv[1]), Path(sys.argv[2])
folder.mkdir()
write_files(job, draw_files(job, job.plate()), folder, silent)
"""


LOCALEDEF = shutil.which("localedef") if Path("/usr/share/i18n/locales/tr_TR").exists() else None


@pytest.fixture(scope="module")
def turkish(tmp_path_factory, elsewhere):
    """Those elsewhere, with Turkish letters and decimal commas, where their locale can be compiled."""
    folder = tmp_path_factory.mktemp("locales")
    if not LOCALEDEF:
        pytest.skip("no localedef with the source of tr_TR to compile the Turkish locale from")
    subprocess.run([LOCALEDEF, "-i", "tr_TR", "-f", "UTF-8", folder / "tr_TR.UTF-8"], check=True, timeout=60)
    return {**elsewhere, "LOCPATH": str(folder), "LC_ALL": "tr_TR.UTF-8"}


@pytest.fixture(scope="module")
def elsewhere():
    """Surroundings of a process in another time zone that hashes otherwise."""
    seed = "1" if os.environ.get("PYTHONHASHSEED") != "1" else "2"
    return {"LC_ALL": "C", "PYTHONHASHSEED": seed, "TZ": "Asia/Kathmandu"}


@pytest.mark.parametrize(
    ("surroundings", "formats"),
    [
        pytest.param("turkish", LAYOUTS, id="turkish"),
        pytest.param("elsewhere", LAYOUTS, id="elsewhere", marks=[pytest.mark.slow] * bool(LOCALEDEF)),
        pytest.param("turkish", EVERY_FORMAT, id="turkish, every format", marks=pytest.mark.slow),
        pytest.param("elsewhere", EVERY_FORMAT, id="elsewhere, every format", marks=pytest.mark.slow),
    ],
)
def test_bytes_hang_on_neither_locale_nor_zone_nor_hashes(request, tmp_path, surroundings, formats):
    path, here, there = write_job(tmp_path, ("[plate]", formats)), tmp_path / "here", tmp_path / "there"
    other = subprocess.Popen(
        [sys.executable, "-c", WRITE, path, there], env={**os.environ, **request.getfixturevalue(surroundings)}
    )
    job = load_job(path)
    here.mkdir()
    write_files(job, draw_files(job, job.plate()), here, silent)
    assert other.wait(timeout=120) == 0
    first, second = listing(here), listing(there)
    assert first.keys() == second.keys()
    suffixes = {".gds", ".oas", ".cif", ".dxf", ".gbr", ".svg", ".lyrdb"}
    if formats is EVERY_FORMAT:
        suffixes |= {".step", ".glb", ".3mf", ".stl", ".png", ".tif"}
    assert {Path(name).suffix for name in first} >= suffixes
    assert [name for name in first if first[name] != second[name]] == []
    assert all(first.values())


@pytest.mark.usefixtures("drawn_in_words", "measured_once")
@pytest.mark.parametrize(("formats", "code"), [('"gdsii", "png"', 2), ('"gdsii", "tiff"', 2), ('"gdsii"', 0)])
def test_pictures_that_cannot_carry_the_design_are_refused_before_any_work(capsys, tmp_path, formats, code):
    export = f"[export]\nformats = [{formats}]\ndots_per_um = 0.0625\n\n[plate]"
    job, out = write_job(tmp_path, ("[plate]", export)), tmp_path / "out"
    answer = command(capsys, "run", job, "--out", out, "--json", "--quiet")
    assert (answer.code, out.exists()) == (code, code == 0)
    if code:
        error = answer.document["error"]
        assert (error["code"], error["where"]) == ("MF104", f"{job}: export.dots_per_um")
        assert error["cure"] == "Set it to at least 0.125"


def test_markers_place_a_thousand_violations_and_count_all(tmp_path):
    job = load_job(write_job(tmp_path, ("[plate]", '[limits]\nmin_feature = "9 um"\n\n[plate]')))
    plate = job.plate()
    results = [result for result in check_rules(job, plate) if not result.passed]
    assert max(result.count for result in results) > 100
    for result in results:
        assert len(result.places) == min(result.count, 1000)
    write_files(job, draw_files(job, plate), tmp_path, silent)
    database = rdb.ReportDatabase("read")
    database.load(str(tmp_path / "SMALL.lyrdb"))
    assert database.num_items() == sum(len(result.places) for result in results)


@pytest.fixture(scope="module")
def asked(tmp_path_factory) -> Path:
    """A job with files of several kinds, for a shop that takes it."""
    section = 'formats = ["gdsii", "svg", "glb", "png"]\ndots_per_um = 0.25\nshop = "generic-chrome"'
    return finished(tmp_path_factory.mktemp("asked"), ("[plate]", f"[export]\n{section}\n\n[plate]"))


def test_asked_for_files_are_written_and_checked(asked):
    assert {path.name for path in asked.iterdir()} == {
        "SMALL.gds", "SMALL.svg", "SMALL_PLAIN.glb", "SMALL_TURNED.glb", "SMALL_PLAIN.png", "SMALL_TURNED.png",
        "SMALL.lyrdb", "layers.lyp", "job.json", "manifest.json", "report.html", "report.json", "overview.png",
        "appendix.html", "numbers.csv", "view.html", "timing.json",
    }  # fmt: skip
    document = json.loads((asked / "report.json").read_text(encoding="utf-8"))
    checked = {check["name"] for check in document["checks"]}
    assert checked >= {"readback_xor_area", "bitmap_xor_area", "solid_wrong_cells", "shop_min_feature"}
    assert len(quantities(document, "solid_wrong_cells")) == len(quantities(document, "bitmap_xor_area")) == 2
    assert {row["name"] for row in document["plate"]} >= {"drawn_holes", "drawn_parted", "drawn_split", "shop_grid"}


def test_files_that_changed_are_found_beside_each_other(capsys, asked, tmp_path):
    """One cannot be read any more, one shows another die; the manifest is none the wiser."""
    out = tmp_path / "out"
    shutil.copytree(asked, out)
    shutil.copy(out / "SMALL_PLAIN.glb", out / "SMALL_TURNED.glb")
    (out / "SMALL.svg").write_text("<svg", encoding="utf-8")
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    for file in manifest["files"]:
        file.update(sha256=sha256_of_file(out / file["path"]), bytes=(out / file["path"]).stat().st_size)
    (out / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    answer = command(capsys, "verify", out, "--json", "--quiet")
    assert answer.code == 1
    checks = answer.document["checks"]
    failed = {(check["name"], check.get("die")) for check in checks if not check["passed"]}
    assert failed >= {("readable", None), ("solid_wrong_cells", "TURNED")}
    assert {die for _, die in failed} == {None, "TURNED"}
    assert {name for name, die in failed if die is None} == {"readable"}
    (unreadable,) = (check for check in checks if check["name"] == "readable")
    assert "SMALL.svg" in unreadable["method"]
    assert "MF303" in unreadable["method"]


@pytest.mark.usefixtures("drawn_in_words", "measured_once")
def test_verify_fails_where_the_shop_of_the_job_is_not_known(capsys, asked, tmp_path):
    """Such as a profile of one's own that stayed on another machine."""
    out = Path(shutil.copytree(asked, tmp_path / "out"))
    text = (out / "job.json").read_text(encoding="utf-8")
    (out / "job.json").write_text(text.replace('"generic-chrome"', '"own.toml"'), encoding="utf-8")
    answer = command(capsys, "verify", out, "--json", "--quiet")
    assert answer.code == 1
    failed = {check["name"]: check["method"] for check in answer.document["checks"] if not check["passed"]}
    assert failed.keys() == {"sha256", "job"}
    assert "MF420" in failed["job"]
    assert "own.toml" in failed["job"]


def without(attribute: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No work of this kind may be begun."""

    def begun(*_: object, **__: object) -> None:
        raise AssertionError(attribute)

    monkeypatch.setattr(attribute, begun)


@pytest.mark.parametrize(("shop", "code"), [("no-such-house", "MF420"), ("bad.toml", "MF421")])
def test_an_unknown_shop_is_refused_before_any_work(capsys, tmp_path, monkeypatch, shop, code):
    without("maskfab.runs.pipeline.draw_files", monkeypatch)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text("title = 3", encoding="utf-8")
    job = write_job(tmp_path, ("[plate]", f'[export]\nshop = "{shop}"\n\n[plate]'))
    before = listing(tmp_path)
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json", "--quiet")
    assert (answer.code, answer.document["error"]["code"]) == (2, code)
    assert listing(tmp_path) == before
    with pytest.raises(OutputError, match=code):
        maskfab.run(job, tmp_path / "out")


def test_a_process_that_the_dots_do_not_bear_is_refused_before_anything_is_drawn(capsys, tmp_path, monkeypatch):
    without("maskfab.runs.pipeline.draw_files", monkeypatch)
    job = write_job(tmp_path, ("[plate]", '[process]\ncorner_radius = "4.1 um"\n\n[plate]'))
    answer = command(capsys, "run", job, "--out", tmp_path / "out", "--json", "--quiet")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF127")
    assert answer.document["error"]["where"] == f"{job}: process, die PLAIN"
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("drawn_in_words", "measured_once")
def test_what_a_shop_refuses_fails_the_run_and_its_files_are_there(capsys, tmp_path):
    section = '[export]\nformats = ["gdsii"]\nshop = "gesim"\n\n[plate]'
    out = tmp_path / "out"
    answer = command(capsys, "run", write_job(tmp_path, ("[plate]", section)), "--out", out, "--json", "--quiet")
    assert answer.code == 1
    failed = [check for check in answer.document["checks"] if not check["passed"]]
    assert "shop_blank" in {check["name"] for check in failed}
    assert all(check["name"].startswith("shop_") and "die" not in check for check in failed)
    assert all("gesim" in check["method"] for check in failed)
    assert (out / "SMALL.gds").stat().st_size > 0
    assert "Shop rule: blank" in (out / "report.html").read_text(encoding="utf-8")
    again = command(capsys, "verify", out, "--quiet")
    assert again.code == 1
    assert "FAIL shop_blank" in again.stderr
    assert "reported" not in again.stderr


def one_die(folder: Path, section: str) -> Result:
    """The job's turned die alone, with a section more, run."""
    job = load_job(write_job(folder, ("[plate]", f"{section}\n\n[plate]")))
    return maskfab.run(resolve(job.spec.model_copy(update={"die": job.spec.die[1:]}), Path(job.where)), folder / "out")


def row_of(result: Result, name: str) -> Quantity:
    (rows,) = result.report.dies.values()
    (found,) = (row for row in rows if row.name == name)
    return found


def written_values(result: Result, name: str) -> list[float]:
    """A quantity of the written die, corners that only touch fused and open; the job has one wavelength."""
    return [row_of(result, f"written_{name}_{reading}").value for reading in ("fused", "open")]


@pytest.mark.slow
@pytest.mark.usefixtures("drawn_in_words", "measured_once")
def test_a_process_that_does_nothing_changes_nothing(tmp_path):
    """At zero radius and bias the written mask is the drawn one; the MTF, of greyed rims, to within its own error."""
    result = one_die(tmp_path, '[process]\ncorner_radius = "0 um"')
    assert result.report.passed
    assert max(written_values(result, "psf_difference")) < 1e-6
    for value in written_values(result, "open_ratio"):
        assert value == pytest.approx(row_of(result, "stop_open_ratio").value, rel=1e-6)
    for name in ("auc_radial_min", "mtf50"):
        drawn = row_of(result, name)
        for reading in ("fused", "open"):
            written = row_of(result, f"written_{name}_{reading}")
            assert abs(written.value - drawn.value) <= written.uncertainty + drawn.uncertainty
            assert written.value == pytest.approx(drawn.value, rel=5e-3)


@pytest.mark.slow
def test_a_bias_widens_what_is_clear_or_narrows_it_by_its_sign(tmp_path):
    ratios = []
    for name, bias in (("narrow", "-0.2 um"), ("wide", "0.2 um")):
        result = one_die(tmp_path / name, f'[process]\ncorner_radius = "1 um"\ncd_bias = "{bias}"')
        drawn = row_of(result, "stop_open_ratio").value
        ratios.append([value / drawn for value in written_values(result, "open_ratio")])
        assert min(written_values(result, "psf_difference")) > 1e-3
        assert "<h3>As written</h3>" in (result.directory / "appendix.html").read_text(encoding="utf-8")
        assert {"process", "process TURNED"} <= result.report.seconds.keys()
    assert max(ratios[0]) < 1 < min(ratios[1])
