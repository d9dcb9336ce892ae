"""The tables of curves that a job's [scene] names: read when the job loads, kept in it, hashed, and refused by key."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_job import command, write_job

from maskfab.mask.job import Job, load_job
from maskfab.optics.scene.scene import Scene

pytestmark = pytest.mark.usefixtures("drawn_in_words")

CAMERA = "# a camera of two colours\nwavelength_nm,long,short\n400,0,1\n550,1,1\n700,1,0\n"
LAMP = "wavelength_nm,lamp\n380,1\n780,3\n"
KEYS = ('spectrum = "tables/camera.csv"', 'illuminant = "tables/lamp.csv"')


def job(folder: Path, *keys: str, **tables: str) -> Path:
    """A job with a scene of such keys, and tables by the stem of their names in a folder beside it."""
    path = write_job(folder, ("[plate]", "\n".join(["[scene]", *keys, "", "[plate]"])))
    (folder / "tables").mkdir(exist_ok=True)
    for name, text in tables.items():
        (folder / "tables" / f"{name}.csv").write_text(text, encoding="utf-8")
    return path


def kept(found: Job, folder: Path) -> Path:
    """The job as a run keeps it, in a folder of its own without any other file."""
    folder.mkdir(exist_ok=True)
    path = folder / "job.json"
    path.write_text(json.dumps(found.spec.dump()), encoding="utf-8")
    return path


def test_a_job_holds_its_tables_and_loads_from_itself_alone(tmp_path: Path) -> None:
    found = load_job(job(tmp_path / "made", *KEYS, camera=CAMERA, lamp=LAMP))
    assert dict(found.spec.curves) == {"camera.csv": CAMERA, "lamp.csv": LAMP}
    again = load_job(kept(found, tmp_path / "kept"))
    assert again.digest == found.digest
    assert again.spec == found.spec
    assert again.scene is not None
    assert found.scene is not None
    assert found.scene is found.scene
    assert [band.name for band in found.scene.bands] == ["long", "short"]
    for one, other in zip(found.scene.bands, again.scene.bands, strict=True):
        assert one.range_nm == other.range_nm
        assert one.quadrature(4).centroid_nm == other.quadrature(4).centroid_nm


def test_the_hash_covers_what_a_table_says_and_not_where_it_is(tmp_path: Path) -> None:
    found = load_job(job(tmp_path / "a", *KEYS, camera=CAMERA, lamp=LAMP)).digest
    other = LAMP.replace("780,3", "780,4")
    assert load_job(job(tmp_path / "b", *KEYS, camera=CAMERA, lamp=other)).digest != found
    assert load_job(job(tmp_path / "c", *KEYS, camera=CAMERA, lamp=LAMP.replace("\n", "\r\n"))).digest == found
    moved = job(tmp_path / "d", KEYS[0].replace("tables/", ""), KEYS[1].replace("tables", "tables/.."))
    for name, text in (("camera", CAMERA), ("lamp", LAMP)):
        (moved.parent / f"{name}.csv").write_text(text, encoding="utf-8")
    assert load_job(moved).digest == found
    assert load_job(moved).spec.scene == load_job(tmp_path / "a" / "job.toml").spec.scene


def test_only_the_tables_that_are_named_are_kept(tmp_path: Path) -> None:
    path = job(tmp_path, 'spectrum = "camera.csv"')
    text = path.read_text(encoding="utf-8") + f"\n[curves]\n'camera.csv' = '''{CAMERA}'''\n'other.csv' = 'unread'\n"
    path.write_text(text, encoding="utf-8")
    assert dict(load_job(path).spec.curves) == {"camera.csv": CAMERA}


def test_jobs_without_tables_have_no_trace_of_them(tmp_path: Path) -> None:
    plain = load_job(write_job(tmp_path / "plain"))
    assert plain.scene is None
    assert "curves" not in plain.spec.dump()
    lines = load_job(job(tmp_path / "lines", 'gap = "1 um"'))
    assert lines.scene == Scene(gap_um=1.0)
    assert "curves" not in lines.spec.dump()


@given(st.floats(1e3, 1e5))
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_temperature_survives_the_job_and_the_hash_tells_it(tmp_path: Path, kelvins: float) -> None:
    found = load_job(job(tmp_path, 'spectrum = "rgb"', f'illuminant = "{kelvins!r} K"'))
    assert found.spec.scene is not None
    assert found.spec.scene.illuminant == pytest.approx(kelvins, rel=1e-14)
    again = load_job(kept(found, tmp_path / "kept"))
    assert (again.digest, again.spec) == (found.digest, found.spec)
    assert load_job(job(tmp_path, 'spectrum = "rgb"')).digest != found.digest


@pytest.mark.parametrize(
    ("keys", "tables", "code", "key", "said"),
    [
        (KEYS[:1], {}, "MF301", "scene.spectrum", "camera.csv"),
        (KEYS, {"camera": CAMERA}, "MF301", "scene.illuminant", "lamp.csv"),
        (KEYS, {"camera": CAMERA, "lamp": CAMERA}, "MF105", "scene.illuminant", "2 curves (long, short)"),
        (KEYS, {"camera": CAMERA, "lamp": " \n"}, "MF302", "scene.illuminant", "holds no text"),
        (KEYS, {"camera": CAMERA, "lamp": "# only\n"}, "MF302", "scene.illuminant", "no table"),
        (KEYS[:1], {"camera": "500,1\n600,1\n"}, "MF303", "scene.spectrum", "header"),
        (KEYS[:1], {"camera": "wavelength_nm\n500\n600\n"}, "MF303", "scene.spectrum", "header"),
        (KEYS[:1], {"camera": CAMERA + "600,1,1\n"}, "MF303", "scene.spectrum", "ascend at 600 nm"),
        (KEYS[:1], {"camera": CAMERA + "2001,1,1\n"}, "MF112", "scene.spectrum", "2001 nm"),
        (KEYS[:1], {"camera": CAMERA + "800,-1,1\n"}, "MF104", "scene.spectrum", "weight -1"),
        (KEYS, {"camera": CAMERA, "lamp": "wavelength_nm,a\n800,1\n900,1\n"}, "MF104", "scene.illuminant", "overlap"),
        (KEYS[1:], {"lamp": LAMP}, "MF105", "scene.illuminant", "lines"),
        (('illuminant = "6500 K"',), {}, "MF105", "scene.illuminant", "lines"),
        (('spectrum = "rgb"', 'illuminant = "rgb"'), {}, "MF105", "scene.illuminant", "is not an illuminant"),
        (('spectrum = "rgb"', "illuminant = true"), {}, "MF105", "scene.illuminant", "is not an illuminant"),
        (('spectrum = "rgb"', "illuminant = []"), {}, "MF105", "scene.illuminant", "is not an illuminant"),
        (('spectrum = "rgb"', "illuminant = 6500"), {}, "MF103", "scene.illuminant", "no unit"),
        (('spectrum = "rgb"', 'illuminant = "6500"'), {}, "MF103", "scene.illuminant", "no unit"),
        (('spectrum = "rgb"', 'illuminant = "6500 C"'), {}, "MF103", "scene.illuminant", "'C'"),
        (('spectrum = "rgb"', 'illuminant = "999 K"'), {}, "MF104", "scene.illuminant", "1000 K to 100000 K"),
        (('spectrum = "rgb"', 'illuminant = "1e9 K"'), {}, "MF104", "scene.illuminant", "1000 K to 100000 K"),
        (('spectrum = "rgb"', 'illuminant = "-5000 K"'), {}, "MF104", "scene.illuminant", "1000 K to 100000 K"),
        (('spectrum = "rgb"', 'illuminant = "nan K"'), {}, "MF104", "scene.illuminant", "1000 K to 100000 K"),
        (('spectrum = ".csv"',), {}, "MF105", "scene.spectrum", "is not a spectrum"),
        (('spectrum = "camera.txt"',), {}, "MF105", "scene.spectrum", "is not a spectrum"),
        (("spectrum = 1",), {}, "MF105", "scene.spectrum", "is not a spectrum"),
        (('spectrum = "."',), {}, "MF105", "scene.spectrum", "is not a spectrum"),
    ],
)
def test_what_a_scene_cannot_use_is_refused_before_any_work(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    keys: tuple[str, ...],
    tables: dict[str, str],
    code: str,
    key: str,
    said: str,
) -> None:
    path = job(tmp_path, *keys, **tables)
    answer = command(capsys, "run", path, "--out", tmp_path / "out", "--json")
    error = answer.document["error"]
    assert (answer.code, error["code"]) == (2, code), error
    assert error["where"].startswith(f"{path}: {key}")
    assert said in error["what"]
    assert error["cure"]
    assert not (tmp_path / "out").exists()


def test_two_tables_of_one_name_are_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = job(tmp_path, 'spectrum = "tables/one.csv"', 'illuminant = "one.csv"', one=LAMP)
    (tmp_path / "one.csv").write_text(CAMERA, encoding="utf-8")
    error = command(capsys, "check", "--optics", path, "--json").document["error"]
    assert (error["code"], error["where"]) == ("MF109", f"{path}: scene.illuminant")
    (tmp_path / "one.csv").write_text(LAMP, encoding="utf-8")
    assert dict(load_job(path).spec.curves) == {"one.csv": LAMP}


def test_the_window_has_no_replicas_at_the_shortest_wavelength_of_a_band(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """λf/dot is 331 um for the camera's line of 530 nm and 125 um for 200 nm."""
    narrow = "wavelength_nm,a\n200,1\n600,1\n"
    path = job(tmp_path, 'spectrum = "tables/camera.csv"', camera=narrow)
    load_job(path)
    text = path.read_text(encoding="utf-8").replace('window = "64 um"', 'window = "126 um"')
    path.write_text(text, encoding="utf-8")
    error = command(capsys, "check", "--optics", path, "--json").document["error"]
    assert error["code"] == "MF113"
    assert error["where"].startswith(f"{path}: scene.spectrum")
    assert "125.0 um at 200 nm" in error["what"]


def test_a_finished_run_keeps_its_tables_and_verifies_without_them(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = job(tmp_path, *KEYS, "accuracy = 0.99", camera=CAMERA, lamp=LAMP)
    command(capsys, "run", path, "--out", tmp_path / "out", "--quiet")
    for name in ("camera", "lamp"):
        (tmp_path / "tables" / f"{name}.csv").unlink()
    document = json.loads((tmp_path / "out" / "job.json").read_text(encoding="utf-8"))
    assert document["curves"] == {"camera.csv": CAMERA, "lamp.csv": LAMP}
    again = load_job(tmp_path / "out" / "job.json")
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert again.digest == report["job_hash"]
    assert command(capsys, "verify", tmp_path / "out", "--quiet").code == 0
