"""`maskfab check --look`: pictures, numbers, refusals, of a job of two small dies with emitters drawn by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from small_job import MASK, command, listing, write_job

from maskfab.base.errors import OutputError
from maskfab.base.model import Emitters, Plate
from maskfab.mask.formats.exr import write_exr, write_png
from maskfab.mask.job import Job
from maskfab.optics.colour import code_of_light
from maskfab.report.pages import pictures
from maskfab.report.pages.pictures import DOCUMENT, FIGURE


@pytest.fixture
def job(tmp_path, monkeypatch) -> Path:
    """Red, green and blue share what the opening leaves, in turn."""
    labels = np.where(MASK, 0, 1 + np.arange(MASK.size).reshape(MASK.shape) % 3).astype(np.int8)
    plate = Job.plate

    def with_emitters(self: Job) -> Plate:
        made = plate(self)
        dies = (
            replace(die, panel=replace(die.panel, emitters=Emitters(labels, die.panel.dot_nm))) for die in made.dies
        )
        return replace(made, dies=tuple(dies))

    monkeypatch.setattr(Job, "plate", with_emitters)
    return write_job(tmp_path / "job")


def test_pictures_and_numbers_come_out_whole(job, tmp_path, capsys):
    out = tmp_path / "seen"
    done = command(capsys, "check", "--look", job, "--out", out, "--samples", 7, "--json")
    assert done.code == 0, done.stderr
    told = done.document
    saved = json.loads((out / DOCUMENT).read_text(encoding="utf-8"))
    assert {key: saved[key] for key in told} == told
    assert [die["name"] for die in told["dies"]] == ["PLAIN", "TURNED"]
    assert told["viewing"] == {"distance_mm": 300.0, "samples_per_pixel": 7}
    assert told["dies"][0]["dpi"] == pytest.approx(25400 / 56)
    plain, turned = ({q["name"]: q["value"] for q in die["quantities"]} for die in told["dies"])
    assert plain["flat_delta_e_mean"] < 1e-9 < turned["flat_delta_e_mean"]
    names = {path.name for path in out.iterdir()}
    assert {file["path"] for file in saved["files"]} | {DOCUMENT} == names
    targets = ("flat", "edge", "zone_plate", "text", "leaves", "border")
    kinds = (".exr", ".png", "_seen.png")
    assert names == {DOCUMENT, FIGURE} | {
        f"{die}_{target}{kind}" for die in ("PLAIN", "TURNED") for target in targets for kind in kinds
    }


@pytest.mark.parametrize("count", [1, 2])
def test_words_under_the_pictures_end_within_them(job, tmp_path, capsys, monkeypatch, count):
    drawn, comparison = [], pictures.comparison
    monkeypatch.setattr(pictures, "bitmap", lambda figure: drawn.append(figure) or b"")
    monkeypatch.setattr(pictures, "comparison", lambda panels: comparison(panels[:count]))
    assert command(capsys, "check", "--look", job, "--out", tmp_path / "seen", "--samples", 7).code == 0
    (figure,) = drawn
    (words,) = figure.texts
    box, whole = words.get_window_extent(), figure.bbox
    assert box.x1 < whole.x1
    assert box.y0 > 0
    lowest = min(text.get_window_extent().y0 for axes in figure.axes for text in axes.texts)
    assert box.y1 < lowest


def test_the_light_of_a_file_is_linear_upright_and_says_its_scale(job, tmp_path, capsys):
    out = tmp_path / "seen"
    assert (
        command(capsys, "check", "--look", job, "--die", "TURNED", "--out", out, "--samples", 7, "--dpi", 200).code == 0
    )
    image = oiio.ImageInput.open(str(out / "TURNED_zone_plate.exr"))
    header = image.spec()
    pixels = np.asarray(image.read_image(oiio.FLOAT)).reshape(header.height, header.width, 3)
    image.close()
    assert header.get_float_attribute("maskfab:pitch_um") == pytest.approx(127.0)
    assert header.get_float_attribute("maskfab:dpi") == pytest.approx(200.0)
    assert header.get_float_attribute("maskfab:distance_mm") == pytest.approx(300.0)
    assert header.get_float_attribute("maskfab:samples_per_pixel") == 7
    assert header.width % 7 == 0
    count = header.width // 7
    mean = pixels.reshape(count, 7, count, 7, 3).mean(axis=(1, 3))
    from maskfab.display.pictures import zone_plate

    np.testing.assert_allclose(mean[::-1], zone_plate(count), atol=2e-3)


def test_equal_jobs_make_equal_files(job, tmp_path, capsys):
    for name in ("one", "two"):
        assert (
            command(capsys, "check", "--look", job, "--die", "TURNED", "--out", tmp_path / name, "--samples", 3).code
            == 0
        )
    assert listing(tmp_path / "one") == listing(tmp_path / "two")


def test_a_photograph_takes_the_place_of_the_leaves(job, tmp_path, capsys):
    photo = tmp_path / "photo.png"
    write_png(np.random.default_rng(0).random((3, 30, 40)), photo)
    done = command(capsys, "check", "--look", job, photo, "--die", "PLAIN", "--samples", 3)
    assert done.code == 0, done.stderr
    assert "picture_delta_e_mean" in done.stdout
    assert "leaves" not in done.stdout


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("--die", "NONE"), "MF105"),
        (("--distance", "0 mm"), "MF121"),
        (("--distance", "300"), "MF103"),
        (("--distance", "10 mm", "--dpi", "10"), "MF115"),
        (("--dpi", "0"), "MF104"),
        (("--dpi", "nan"), "MF104"),
        (("--pixels", "1"), "MF121"),
        (("--pixels", "400"), "MF121"),
        (("--samples", "0"), "MF121"),
        (("--samples", "9999"), "MF115"),
    ],
)
def test_what_cannot_be_seen_is_refused_and_leaves_nothing(job, tmp_path, capsys, arguments, code):
    out = tmp_path / "seen"
    done = command(capsys, "check", "--look", job, "--out", out, "--quiet", *arguments)
    assert done.code == 2
    assert code in done.stderr
    assert not out.exists()
    assert not list(tmp_path.glob(".*"))


def test_a_missing_photograph_is_refused(job, tmp_path, capsys):
    assert "MF301" in command(capsys, "check", "--look", job, tmp_path / "none.jpg").stderr


def test_a_job_without_emitters_is_told_the_cure(tmp_path, capsys):
    done = command(capsys, "check", "--look", write_job(tmp_path), "--json", "--quiet")
    assert done.code == 2
    assert done.document["error"]["code"] == "MF121"
    assert "emit" in done.document["error"]["cure"]


def test_pngs_are_srgb_to_the_last_code(tmp_path):
    light = np.linspace(0, 1, 256)[None, :, None].repeat(3, axis=2)
    write_png(light * 4, tmp_path / "a.png", white=4.0)
    image = oiio.ImageInput.open(str(tmp_path / "a.png"))
    codes = np.asarray(image.read_image(oiio.UINT8)).reshape(1, 256, 3)
    image.close()
    assert np.abs(codes - code_of_light(light) * 255).max() < 0.56


def test_a_place_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(OutputError, match="MF401"):
        write_exr(np.zeros((3, 4, 4)), tmp_path / "none" / "a.exr", {})
