"""`maskfab check --optics`, and the [scene] of a job: what it takes and refuses, and that it keeps what it took."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from small_job import command, write_job

from maskfab.job.read import read, validate
from maskfab.job.sections import SceneSection
from maskfab.mask.job import load_job
from maskfab.optics.response import GENERIC_RGB
from maskfab.optics.scene.scene import Distortion, Scene

PLATE = "[plate]"


def scene(tmp_path: Path, *lines: str) -> Path:
    return write_job(tmp_path, (PLATE, "\n".join(["[scene]", *lines, "", PLATE])))


FULL = (
    'accuracy = "draft"',
    'depth = ["10 m", "inf"]',
    'focus = "inf"',
    'field = "50 um"',
    'gap = "1 um"',
    "aberrations = [[4, 0.001], [11, 0]]",
    "saturation = true",
    'distortion = { ratio = 1e-5, height = "1 mm" }',
    'spectrum = "lines"',
)


def test_a_scene_is_read_and_kept(tmp_path: Path) -> None:
    spec = read(scene(tmp_path, *FULL))
    assert spec.scene is not None
    assert spec.scene.accuracy == 1e-2
    lens = Distortion(1e-5, 1000.0)
    assert Scene.of(spec.scene) == Scene(1e7, math.inf, math.inf, 50.0, 1.0, ((4, 0.001), (11, 0.0)), True, (), lens)
    assert validate(spec.dump(), where="again") == spec


def test_without_a_scene_nothing_extra_is_asked_for_and_old_jobs_keep_their_hash(tmp_path: Path) -> None:
    plain, empty = load_job(write_job(tmp_path / "plain")), load_job(scene(tmp_path / "empty"))
    assert plain.spec.scene is None
    assert "scene" not in plain.spec.dump()
    assert Scene.of(plain.spec.scene) == Scene.of(empty.spec.scene) == Scene()
    assert SceneSection().accuracy == 1e-3
    assert empty.digest != plain.digest


@pytest.mark.parametrize(
    ("stated", "value"), [('"draft"', 1e-2), ('"standard"', 1e-3), ('"certify"', 1e-6), ("2e-5", 2e-5)]
)
def test_accuracies(tmp_path: Path, stated: str, value: float) -> None:
    spec = read(scene(tmp_path, f"accuracy = {stated}"))
    assert spec.scene is not None
    assert spec.scene.accuracy == value


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("accuracy = 0", "MF104", "outside 0 to 1"),
        ("accuracy = 2", "MF104", "outside 0 to 1"),
        ("accuracy = nan", "MF104", "nan is outside"),
        ("accuracy = true", "MF105", "not an accuracy"),
        ('accuracy = "best"', "MF105", "'best' is not an accuracy"),
        ('depth = ["2 m", "1 m"]', "MF104", "beyond the farthest"),
        ('depth = ["inf", "1 m"]', "MF104", "beyond the farthest"),
        ('depth = ["1 kg", "inf"]', "MF103", "no unit of length"),
        ('depth = ["1", "inf"]', "MF103", "no unit"),
        ('depth = ["1 m"]', "MF105", "not a pair"),
        ('depth = "1 m"', "MF105", "not a pair"),
        ('depth = ["nan m", "inf"]', "MF104", "finite"),
        ('depth = ["-1 m", "inf"]', "MF104", "positive"),
        ('depth = ["4 mm", "inf"]', "MF104", "not beyond the focal length"),
        ('focus = "5 mm"', "MF104", "not beyond the focal length"),
        ("focus = inf", "MF103", "no unit"),
        ('field = "2"', "MF103", "no unit"),
        ('field = "-2 mm"', "MF104", "at least 0"),
        ('gap = "3 s"', "MF103", "no unit of length"),
        ('gap = "inf"', "MF103", "no unit"),
        ("aberrations = [[0, 0.1]]", "MF104", "Noll index outside 1 to 66"),
        ("aberrations = [[67, 0.1]]", "MF104", "Noll index"),
        ("aberrations = [[4, nan]]", "MF104", "not finite"),
        ("aberrations = [[4.0, 0.1]]", "MF105", "whole number"),
        ("aberrations = [[4, 0.1], [4, 0.2]]", "MF105", "repeats Noll's term 4"),
        ("aberrations = [4, 0.1]", "MF105", "not a pair"),
        ("aberrations = 4", "MF105", "not a list"),
        ("distortion = 0.02", "MF105", "not a distortion and the image height"),
        ('distortion = { ratio = 0.02, height = "2 mm", at = 1 }', "MF105", "not a distortion and the image height"),
        ('distortion = { ratio = "2 %", height = "2 mm" }', "MF105", "not a ratio"),
        ('distortion = { ratio = 0.4, height = "2 mm" }', "MF104", "beyond 0.3"),
        ('distortion = { ratio = nan, height = "2 mm" }', "MF104", "beyond 0.3"),
        ('distortion = { ratio = 0.02, height = "2" }', "MF103", "no unit"),
        ("saturation = 1", "MF105", "saturation"),
        ('spectrum = "white"', "MF105", "spectrum"),
        ('distance = "1 m"', "MF102", "unknown key"),
    ],
)
def test_bad_scenes_are_refused(capsys, tmp_path: Path, line: str, code: str, said: str) -> None:
    answer = command(capsys, "check", "--optics", scene(tmp_path, line), "--json")
    assert answer.code == 2
    error = answer.document["error"]
    assert error["code"] == code, error
    assert said in answer.stderr
    assert line.split(" ", maxsplit=1)[0] in error["where"]
    assert error["cure"]


def test_the_table_names_every_ingredient_and_the_predictions(capsys, tmp_path: Path) -> None:
    answer = command(
        capsys, "check", "--optics", scene(tmp_path, 'accuracy = "draft"', 'depth = ["10 m", "inf"]'), "--die", "PLAIN"
    )
    assert answer.code == 0
    assert answer.stderr == ""
    for word in ("PLAIN", "defocus over the depth", "left out", "path ", "samples", "wavelengths", " s, ", " MB"):
        assert word in answer.stdout
    assert "TURNED" not in answer.stdout


def test_the_document_adds_up(capsys, tmp_path: Path) -> None:
    job = scene(tmp_path, 'accuracy = "draft"', 'depth = ["10 m", "inf"]', "aberrations = [[7, 0.05]]")
    answer = command(capsys, "check", "--optics", job, "--json")
    assert answer.code == 0
    assert [die["die"] for die in answer.document["dies"]] == ["PLAIN", "TURNED"]
    for die in answer.document["dies"]:
        rows = {row["name"]: row for row in die["ingredients"]}
        assert rows["lens aberrations"]["modelled"] is True
        assert rows["lens aberrations"]["counted"] == 0
        assert die["path"] == "phased"
        assert sum(row["counted"] for row in die["ingredients"]) < die["error"] <= answer.document["accuracy"] == 1e-2
        assert die["predicted_seconds"] > 0
        assert die["predicted_bytes"] > 0
        assert all(row["method"] for row in rows.values())


def test_a_camera_of_ones_own_under_its_light(capsys, tmp_path: Path) -> None:
    """The bundled camera by way of a table plans as the bundled one does; a lamp that leaves one line needs one."""
    (tmp_path / "camera.csv").write_text(GENERIC_RGB.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "line.csv").write_text("wavelength_nm,laser\n529.99,1\n530.01,1\n", encoding="utf-8")
    found = {}
    for lit in ("rgb", "camera.csv"):
        job = scene(tmp_path, "accuracy = 0.3", f'spectrum = "{lit}"', 'illuminant = "5000 K"')
        answer = command(capsys, "check", "--optics", job, "--die", "PLAIN", "--json")
        assert answer.code == 0
        (found[lit],) = answer.document["dies"]
    assert found["rgb"] == found["camera.csv"]
    job = scene(tmp_path, 'accuracy = "draft"', 'spectrum = "camera.csv"', 'illuminant = "line.csv"')
    (lit,) = command(capsys, "check", "--optics", job, "--die", "PLAIN", "--json").document["dies"]
    rows = {row["name"]: row for row in lit["ingredients"]}
    assert rows["width of the bands"]["error_if_left_out"] < 1e-4
    assert lit["wavelengths"] == 3


def test_errors_are_said_to_be_bounds(capsys, tmp_path: Path) -> None:
    """They carry safety factors and may lie far above the truth; what is exactly nothing is no bound."""
    job = scene(tmp_path, 'accuracy = "draft"', "aberrations = [[4, 0.0001]]")
    text = command(capsys, "check", "--optics", job, "--die", "PLAIN").stdout
    assert "estimated error ≤ " in text
    left_out = [line for line in text.splitlines() if "  left out  " in line]
    assert any(line.startswith("lens aberrations") and line.count("≤") == 2 for line in left_out)
    assert any(line.startswith("defocus over the depth") and "≤" not in line for line in left_out)
    (die,) = command(capsys, "check", "--optics", job, "--die", "PLAIN", "--json").document["dies"]
    assert die["errors"] == "at most"


def test_a_scene_beyond_every_model_and_an_unknown_die(capsys, tmp_path: Path) -> None:
    job = scene(tmp_path, 'accuracy = "certify"', 'gap = "100 um"')
    answer = command(capsys, "check", "--optics", job, "--die", "PLAIN", "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF115")
    assert "no model" in answer.stderr
    answer = command(capsys, "check", "--optics", job, "--die", "NONE", "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF105")
    assert "PLAIN, TURNED" in answer.stderr


def plated(tmp_path: Path, *lines: str) -> Path:
    return write_job(
        tmp_path, ("columns = 2", "\n".join(["columns = 2", *lines])), (PLATE, f"[scene]\n{FULL[3]}\n\n{PLATE}")
    )


def test_what_no_plan_models_is_weighed_against_the_accuracy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A denser film leaks less, until it no longer matters; the phase of its leak is a scene's no more than none."""
    seen = []
    for folder, density in (("thin", 3), ("thick", 9)):
        (tmp_path / folder).mkdir()
        job = plated(tmp_path / folder, f"optical_density = {density}")
        answer = command(capsys, "check", "--optics", job, "--die", "TURNED", "--json")
        assert answer.code == 0
        (die,) = answer.document["dies"]
        rows = die["not_modelled"]
        assert [row["error"] for row in rows] == sorted((row["error"] for row in rows), reverse=True)
        assert all(row["above_accuracy"] == (row["error"] > 1e-3) for row in rows)
        seen.append({row["name"]: row for row in rows})
    assert seen[0]["chrome leak"]["above_accuracy"]
    assert not seen[1]["chrome leak"]["above_accuracy"]
    assert seen[0]["chrome leak"]["error"] > 500 * seen[1]["chrome leak"]["error"]
    assert "film walls" in seen[0]
    assert "tangent for sine" not in seen[0]
    text = command(capsys, "check", "--optics", tmp_path / "thick" / "job.toml", "--die", "TURNED").stdout
    assert re.search("^chrome leak +within ", text, re.MULTILINE)


def test_glass_away_from_the_lens_is_planned_as_a_gap(tmp_path: Path) -> None:
    glass = 'glass = { thickness = "29.2 um", index = 1.46, chrome = "away" }'
    scene_of = load_job(plated(tmp_path, glass)).scene
    assert scene_of is not None
    assert scene_of.gap_um == pytest.approx(20.0)


def test_without_a_scene_and_with_nothing_said_of_the_plate_no_bar_is_computed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = command(capsys, "check", "--optics", write_job(tmp_path), "--json")
    assert [die["not_modelled"] for die in answer.document["dies"]] == [[], []]
