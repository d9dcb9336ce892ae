"""Lenses faster than the model is made for are told, and those that cannot be are refused before any work."""

from __future__ import annotations

import json

import pytest
from small_job import JOB, OPENING, command, look

from maskfab.base.errors import JobError
from maskfab.job.camera import Camera, Stop
from maskfab.job.die import check_lens
from maskfab.optics.metrics import FASTEST_PARAXIAL, fast_lens

pytestmark = pytest.mark.usefixtures("drawn_in_words")


def lens(f_number: float) -> Camera:
    return Camera(5000.0, Stop("circle", 5000.0 / f_number), (530.0,), 2.0, 64.0)


def test_a_lens_as_slow_as_the_limit_needs_no_note() -> None:
    assert fast_lens(lens(FASTEST_PARAXIAL)) == ()
    (note,) = fast_lens(lens(FASTEST_PARAXIAL * 0.999))
    assert (note.value, note.passed) == ("f/1.4", None)


def test_no_lens_has_a_numerical_aperture_above_one() -> None:
    check_lens(lens(0.5), where="here")
    with pytest.raises(JobError, match=r"numerical aperture 1\.01") as refused:
        check_lens(lens(0.5 / 1.01), where="here")
    assert (refused.value.code, refused.value.where) == ("MF131", "here")


def test_an_impossible_lens_is_refused_before_the_file_is_looked_at(capsys, tmp_path):
    (tmp_path / "job.toml").write_text(JOB.replace('"400 um" }', '"10.1 mm" }'))
    for words in (
        ("analyse", tmp_path / "none.oas", *look(focal="3 mm", stop={"diameter": "8 mm"})),
        ("analyse", tmp_path / "none.toml", *look(focal="3 mm", stop={"diameter": "8 mm"})),
        ("run", tmp_path / "job.toml", "--out", tmp_path / "out"),
    ):
        answer = command(capsys, *words, "--json")
        first = answer.document["error"]["faults"][0]
        assert (answer.code, first["code"]) == (2, "MF131")
        assert "stop" in first["where"]
    assert not (tmp_path / "out").exists()


def test_a_fast_lens_is_told_once_and_its_size_by_the_bar_alone(capsys, tmp_path):
    (tmp_path / "ring.toml").write_text(OPENING)
    one_die = JOB[: JOB.rindex("[[die]]")]
    fast = one_die.replace('"5 mm"', '"0.5 mm"').replace('"64 um"', '"20 um"')
    (tmp_path / "job.toml").write_text(f'{fast}\n[export]\nformats = ["gdsii"]\n')
    told = "NOTE fast_lens = f/1.25: above f/1.4 the scalar, paraxial model"
    assert told in command(capsys, "run", tmp_path / "job.toml", "--out", tmp_path / "out").stderr
    report = json.loads((tmp_path / "out/report.json").read_text())
    names = [row["name"] for row in (*report["plate"], *report["dies"][0]["quantities"])]
    assert not [name for name in names if "paraxial" in name or "fast" in name]
    assert (names.count("model_vector_field"), names.count("model_tangent_for_sine")) == (1, 1)
    verified = command(capsys, "verify", tmp_path / "out")
    assert (verified.code, told in verified.stderr) == (0, True)
    # Of the mask the die alone, whose middle is that of its dots: about any other a grid is fine.
    for file in ((tmp_path / "ring.toml",), (tmp_path / "out/SMALL.gds", "--cell", "PLAIN")):
        small = look(focal="0.125 mm", stop={"diameter": "100 um"}, window="8 um")
        analysed = command(capsys, "analyse", *file, *small)
        assert told in analysed.stderr
        assert "paraxial_model_error" not in analysed.stdout
        assert "vector_field" in analysed.stdout
