"""``maskfab measure`` of a point light: from files to the verdict, the page and the merged capture, and bad input."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import tifffile
from browser import faults
from camera.capture.captured_dies import BLACK, GAIN, READ_NOISE, exposed, polygon_picture
from small_job import command, write_job

import maskfab
from maskfab.camera.blur import read_psf
from maskfab.mask.job import load_job

pytestmark = pytest.mark.usefixtures("drawn_in_words", "costs_of_two_scenes")

TIMES = (1.0, 8.0, 64.0)
SENSOR = ("--gain", GAIN, "--read-noise", READ_NOISE, "--black", BLACK, "--window", 64)
STATED = [word for time in TIMES for word in ("--times", f"{time:g} ms")]


@pytest.fixture(scope="module")
def captured(tmp_path_factory):
    """A job, and three exposures of its random die, mirrored, 0.4 um wider than drawn, well off the frame's middle."""
    folder = tmp_path_factory.mktemp("captured")
    job = load_job(write_job(folder))
    seen = replace(job.camera, window_um=300.0)
    picture = polygon_picture(job.panels()["TURNED"], seen, {530.0: 1.0}, bias_um=0.4, turn_rad=0.0)[:, ::-1]
    frames = []
    for frame in exposed(picture[20:140, 35:145], TIMES, 2e4, 1):
        frames.append(folder / f"{frame.name}")
        tifffile.imwrite(frames[-1], frame.counts.astype(np.uint16), photometric="minisblack", metadata=None)
    return folder / "job.toml", frames


def test_a_stack_tells_the_die_its_stand_and_its_width(captured, capsys, chromium, firefox, tmp_path):
    job, frames = captured
    out = tmp_path / "out"
    said = command(capsys, "measure", *frames, "--job", job, *SENSOR, *STATED, "-o", out, "--json", "--quiet")
    told = said.document
    assert said.code == 1
    assert told.get("die") == "TURNED", told
    assert told["stands"] == "mirrored"
    assert told["turn_the_plate_over"] is True
    assert (told["verdict"]["answer"], told["verdict"]["cause"]) == ("CANNOT TELL", "wrong setting")
    assert told["verdict"]["next_step"].startswith("Turn the plate over, or give frames that were not flipped")
    assert told["sentences"][0] == "This is die TURNED, mirrored: turn the plate over."
    assert told["sentences"][-1].endswith("--stands mirrored.")
    # What stands only if the plate is turned over is no finding.
    names = {"captured_cd_bias", "captured_term", "captured_cost"}
    assert not names & {each["name"] for each in told["quantities"]}
    bias = next(each for each in told["if"]["quantities"] if each["name"] == "captured_cd_bias")
    assert abs(bias["value"] - 0.4) < 2 * bias["uncertainty"] < 0.4
    assert bias["passed"] is None
    assert [each["name"] for each in told["frames"]] == [path.name for path in frames]
    assert {**json.loads((out / "measure.json").read_text()), "path": str(out)} == told
    page = (out / "measure.html").read_text()
    assert f"CANNOT TELL: {told['verdict']['reason']}" in page
    assert page.index("What to do next") < page.index("Numbers") < page.index("Appendix") < page.index("CD +0.")
    assert "<script" not in page
    assert [fault for browser in (chromium, firefox) for fault in faults(browser, out / "measure.html")] == []
    blur = read_psf([out / "fitted_psf.exr"])
    assert blur.pixel_um == 2
    assert blur.kernels[1].sum() == pytest.approx(1)
    assert np.unravel_index(blur.kernels[1].argmax(), blur.kernels[1].shape) == blur.centre == (300, 300)
    assert "die TURNED as fitted to a capture" in blur.told[0]
    listed = {each["path"] for each in json.loads((out / "manifest.json").read_text())["files"]}
    assert listed | {"manifest.json"} == {path.name for path in out.iterdir()}


@pytest.mark.slow
def test_python_measures_as_the_command_does(captured):
    job, frames = captured
    times = [f"{time:g} ms" for time in TIMES]
    found = maskfab.measure(
        frames, job, times=times, gain=GAIN, read_noise=READ_NOISE, black=BLACK, window=64, die=["TURNED"]
    )
    assert found.verdict.answer == "CANNOT TELL"
    assert found["captured_misfit"].value == pytest.approx(1, abs=0.2)
    assert 0 < found["captured_outside"].value < 1
    assert "530 nm" in found.notes[0]
    assert str(found).startswith("CANNOT TELL: die TURNED stands mirrored")
    assert not found.passed


def test_the_house_of_the_job_and_what_is_not_fitted_are_named(captured, tmp_path):
    stated = '[process]\ncorner_radius = "0.5 um"\n\n[export]\nshop = "topro_chrome"\n\n[plate]\noptical_density = 3'
    edit = ("[plate]", stated)
    times = [f"{time:g} ms" for time in TIMES]
    upright = [tifffile.imread(path)[:, ::-1] for path in captured[1]]
    found = maskfab.measure(
        upright, write_job(tmp_path, edit), times=times, gain=GAIN, read_noise=READ_NOISE, black=BLACK, window=64,
        die=["TURNED"],
    )  # fmt: skip
    *_, unused, fitted = found.notes
    assert "optical_density of [plate], " in unused
    assert "corner_radius of [process]" in unused
    assert fitted == "The die is fitted with sharp corners, smooth edges and no leak."
    assert found["captured_cd_bias"].limit == 0.1
    assert found["captured_cd_bias"].passed is False
    assert found.verdict.answer == "REJECT"
    assert "beyond the ±0.1 um" in found.verdict.line
    assert "captured_cost" in found.numbers.names
    assert any("photograph restored as if the die were as drawn" in each for each in found.found.sentences)


@pytest.mark.parametrize(
    ("more", "code"),
    [
        (("--window", 10), "MF104"),
        (("--die", "NONE"), "MF105"),
        (("--times", "4 ms"), "MF332"),
        (("--line", "530"), "MF103"),
        (("--gain", 0), "MF335"),
    ],
)
def test_bad_requests_are_refused(captured, capsys, more, code):
    job, frames = captured
    stated = () if more[0] == "--times" else STATED
    said = command(capsys, "measure", *frames, "--job", job, *SENSOR, *stated, *more, "--quiet")
    assert said.code == 2
    assert code in said.stderr


def test_the_jobs_sensor_tells_electrons_of_a_count(captured, tmp_path):
    """A full well over an analog gain of 4 and the counts from black to white."""
    well = 4 * GAIN * (65535 - BLACK)
    sensor = f"[sensor]\nfull_well = {well}\nread_noise = {READ_NOISE}\nbits = 16\ngain = 4\n\n[plate]"
    job, times = write_job(tmp_path, ("[plate]", sensor)), [f"{time:g} ms" for time in TIMES]
    found = maskfab.measure(captured[1], job, times=times, black=BLACK, window=64, die=["TURNED"])
    assert f"By [sensor], full well over analog gain: {GAIN:.3f} electrons for each count" in found.notes[1]
    assert found["captured_misfit"].value == pytest.approx(1, abs=0.2)


def test_a_sensor_must_be_stated(captured, capsys):
    job, frames = captured
    said = command(capsys, "measure", frames[0], "--job", job, "--quiet")
    assert said.code == 2
    assert "MF105" in said.stderr
    assert "--gain" in said.stderr
