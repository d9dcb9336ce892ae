"""Lenses faster than the model is made for are told, and those that cannot be are refused before any work."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.special import j0, j1, jv
from small_job import JOB, LOOK, OPENING, command

from maskfab.errors import JobError
from maskfab.jobfile import check_lens
from maskfab.model import Camera, Stop
from maskfab.optics.numbers.metrics import FASTEST_PARAXIAL, model_notes

pytestmark = pytest.mark.usefixtures("drawn_once")


def lens(f_number: float) -> Camera:
    return Camera(5000.0, Stop("circle", 5000.0 / f_number), (530.0,), 2.0, 64.0)


def vector_error(f_number: float) -> float:
    """Relative L2 distance of Airy's pattern from an aplanatic lens' in unpolarised light, by Richards and Wolf."""
    sine = 1 / (2 * f_number)
    nodes, weights = leggauss(200)
    angle = np.arcsin(sine) * (nodes + 1) / 2
    apodised = np.sqrt(np.cos(angle)) * np.sin(angle) * weights
    radius = np.linspace(0.0, 8 / sine, 1000)
    phase = 2 * np.pi * radius[:, None] * np.sin(angle)
    fields = (
        (j0(phase) * (1 + np.cos(angle))) @ apodised,
        np.sqrt(2) * (j1(phase) * np.sin(angle)) @ apodised,
        (jv(2, phase) * (1 - np.cos(angle))) @ apodised,
    )
    vector = sum(field**2 for field in fields)
    airy = np.append(1.0, (2 * j1(2 * np.pi * radius[1:] * sine) / (2 * np.pi * radius[1:] * sine)) ** 2)
    vector, airy = (psf / (psf @ radius) for psf in (vector, airy))
    return float(np.sqrt((vector - airy) ** 2 @ radius / (airy**2 @ radius)))


@pytest.mark.parametrize("f_number", [0.8, 1.0, 1.2, 1.39])
def test_the_note_states_the_vector_field_of_an_open_stop(f_number: float) -> None:
    (note,) = model_notes(lens(f_number))
    assert note.value == pytest.approx(vector_error(f_number), rel=0.05)
    assert note.passed is None
    assert f"f/{f_number:g}" in note.method


def test_a_lens_as_slow_as_the_limit_needs_no_note() -> None:
    assert model_notes(lens(FASTEST_PARAXIAL)) == ()
    assert model_notes(lens(FASTEST_PARAXIAL * 0.999))


def test_no_lens_has_a_numerical_aperture_above_one() -> None:
    check_lens(lens(0.5), where="here")
    with pytest.raises(JobError, match=r"numerical aperture 1\.01") as refused:
        check_lens(lens(0.5 / 1.01), where="here")
    assert (refused.value.code, refused.value.where) == ("MF131", "here")


def test_an_impossible_lens_is_refused_before_the_file_is_looked_at(capsys, tmp_path):
    (tmp_path / "job.toml").write_text(JOB.replace('"400 um" }', '"10.1 mm" }'))
    for words in (
        ("analyse", tmp_path / "none.oas", *LOOK, "--focal", "3 mm", "--stop", "8 mm"),
        ("analyse", tmp_path / "none.toml", *LOOK, "--focal", "3 mm", "--stop", "8 mm"),
        ("run", tmp_path / "job.toml", "--out", tmp_path / "out"),
    ):
        answer = command(capsys, *words, "--json")
        assert (answer.code, answer.document["error"]["code"]) == (2, "MF131")
        assert "stop" in answer.document["error"]["where"]
    assert not (tmp_path / "out").exists()


def test_reports_and_verdicts_tell_of_a_fast_lens(capsys, tmp_path):
    (tmp_path / "ring.toml").write_text(OPENING)
    one_die = JOB[: JOB.rindex("[[die]]")]
    fast = one_die.replace('"5 mm"', '"0.5 mm"').replace('"64 um"', '"20 um"')
    (tmp_path / "job.toml").write_text(f'{fast}\n[export]\nformats = ["gdsii"]\n')
    told = "NOTE paraxial_model_error = 0.0352 1: this lens is f/1.25"
    assert told in command(capsys, "run", tmp_path / "job.toml", "--out", tmp_path / "out").stderr
    (row,) = [q for q in json.loads((tmp_path / "out/report.json").read_text())["plate"] if "paraxial" in q["name"]]
    assert row["value"] == pytest.approx(0.055 / 1.25**2)
    assert "Error of the paraxial model" in (tmp_path / "out/report.html").read_text()
    verified = command(capsys, "verify", tmp_path / "out")
    assert (verified.code, told in verified.stderr) == (0, True)
    analysed = command(capsys, "analyse", tmp_path / "ring.toml", *LOOK, "--focal", "0.5 mm", "--window", "20 um")
    assert told in analysed.stderr
    assert "\nparaxial_model_error " in analysed.stdout
