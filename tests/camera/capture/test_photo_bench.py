"""Focus, turn and scale of a die from ordinary photographs through it, drawn by a simulator that shares no optics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from capture_simulator import Dots, Optics, picture
from optics_cases import camera, noise, panel
from PIL import Image
from scipy import ndimage, signal
from small_job import command, write_job

from maskfab.camera.inspection.die_image import BIAS, DieImage
from maskfab.camera.inspection.photo_bench import FOCUS, SCALE, TURN, photo_bench, square_pixels
from maskfab.camera.noise_spectrum import noise_of
from maskfab.camera.record import Noise, Record
from maskfab.camera.scenes import dead_leaves
from maskfab.optics.spectrum import line_spectrum

CAMERA = replace(camera(diameter_um=800.0, window_um=128.0), wavelengths_nm=(610.0, 530.0, 470.0))
DIE = panel(noise(8, 0.45, 3), cells=14, seed=5)
LINES = {"R": 610.0, "G": 530.0, "B": 470.0}
LIGHT = {colour: line_spectrum([line]) for colour, line in LINES.items()}
ELECTRONS, WAVES, DEGREES = 1e4, 0.15, 1.0


@pytest.fixture(scope="module")
def photographs():
    """Two, through one die, out of focus and turned."""
    die, found = Dots.of(DIE).grown(0.2), []
    optics = Optics(800.0, CAMERA.focal_um, CAMERA.pixel_um, 257, {610.0: 1.0}, {4: WAVES})
    psf = [
        ndimage.rotate(picture(die, replace(optics, lines={line: 1.0}, terms={4: WAVES * 610 / line})), DEGREES,
                       reshape=False, order=3)
        for line in LINES.values()
    ]  # fmt: skip
    random = np.random.default_rng(2)
    for seed in (1, 2):
        scene = dead_leaves(seed, 800, 800).light
        light = np.stack(
            [signal.fftconvolve(one, spread / spread.sum(), "valid") for one, spread in zip(scene, psf, strict=True)]
        )
        seen = (random.poisson(np.maximum(light, 0) * ELECTRONS) + random.normal(0, 5, light.shape)) / ELECTRONS
        values = seen.astype(np.float32)
        found.append((values, noise_of(Record(values, Noise(ELECTRONS, 5.0), np.inf), stated=True)[0]))
    return found


def test_focus_turn_and_scale_are_told_with_errors_that_hold_and_so_is_what_is_not(photographs):
    found = photo_bench(DieImage.of(DIE, 0, CAMERA, LIGHT, square_pixels(CAMERA.pixel_um)), photographs)
    truth = {FOCUS: WAVES, TURN: np.radians(DEGREES), SCALE: 0.0, BIAS: 0.2}
    for name, value in truth.items():
        assert abs(found.values[name] - value) < 1.7 * found.errors[name], name
    assert found.errors[FOCUS] < 0.05
    assert found.errors[BIAS] > 0.2, "photographs hardly tell a width"
    assert abs(found.gain - found.expected) < 0.3 * found.expected
    seen, fitted = found.structure()
    told = np.isfinite(seen) & np.isfinite(fitted)
    assert np.corrcoef(seen[told], fitted[told])[0, 1] > 0.5


def test_what_photographs_have_no_use_for_is_refused(capsys, tmp_path):
    job = write_job(tmp_path)
    photo = tmp_path / "photo.jpg"
    for more in (("--times", "1 ms"), ("--window", "80"), ("--dark", photo)):
        answer = command(capsys, "measure", photo, "--photos", "--job", job, *more, "--json")
        assert (answer.code, answer.document["error"]["code"]) == (2, "MF105")


def test_what_of_the_job_has_no_use_is_named_and_nothing_seen_is_said(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("maskfab.api.photo_measuring.photo_bench", lambda *_: None)
    codes = np.random.default_rng(0).integers(20, 200, (256, 256, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "photo.png")
    more = ("--photos", "--job", write_job(tmp_path), "--die", "PLAIN", "--line", "530 nm", "--out", tmp_path / "out")
    answer = command(capsys, "measure", tmp_path / "photo.png", *more, "--json")
    assert (answer.code, answer.document["verdict"]["answer"]) == (1, "CANNOT TELL")
    assert any(note.startswith("Not used of the job") for note in answer.document["notes"])
    page = (tmp_path / "out" / "measure.html").read_text(encoding="utf-8")
    assert "no square shows enough" in page
    assert not (tmp_path / "out" / "fitted_psf.exr").exists()
