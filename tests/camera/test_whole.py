"""Photographs of which nothing is cut off, in little memory: the same numbers, part by part."""

from __future__ import annotations

import tracemalloc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.errors import JobError
from maskfab.camera import imaging, scores
from maskfab.camera import scenes as photographs
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.camera.restorers import wiener
from maskfab.camera.scenes import Photograph, folder, scene
from maskfab.camera.scores import Truth, psnr
from maskfab.camera.stop_cells import lay
from maskfab.mask.formats.exr import write_png
from maskfab.optics import colour
from maskfab.optics.colour import code_of_light, light_of_code

BAR = np.zeros((21, 21), dtype=np.bool_)
BAR[:6, :17] = True


@pytest.fixture
def in_parts(monkeypatch):
    """Every picture is large, and worked on a few rows at a time."""
    for module in (imaging, scores):
        monkeypatch.setattr(module, "LARGE", 1)
    monkeypatch.setattr(scores, "_AT_ONCE", 5000)
    monkeypatch.setattr(colour, "_AT_ONCE", 999)


def noise(rows, columns):
    return Photograph("noise", 1, np.random.default_rng(1).random((3, rows, columns), dtype=np.float32))


def taken(scenes):
    pictures = []

    def keep(_, picture):
        pictures.append(picture)

    table = evaluate([lay("bar", BAR)], scenes, scenes, (32,), protocol=Protocol("camera"), show=keep)
    return table.scores[0], pictures[0]


def test_a_photograph_in_parts_is_the_same_photograph(request):
    scenes = (noise(704, 736),)
    score, picture = taken(scenes)
    request.getfixturevalue("in_parts")
    again, parts = taken(scenes)
    assert abs(parts - picture).max() < 1e-5
    for name in ("psnr", "psnr_inner", "ssim", "ssim_inner", "delta_e", "delta_e_inner"):
        assert getattr(again, name) == pytest.approx(getattr(score, name), rel=1e-5), name


def peak(work):
    """Most memory that work takes beyond what was there, in bytes."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_every_step_of_a_large_photograph_leaves_room_for_the_others_within_80_bytes_a_pixel(monkeypatch):
    """80 bytes for each of 50 million pixels are four gigabytes: 24 hold scene and record, 6 or 12 the transfer."""
    monkeypatch.setattr(imaging, "LARGE", 1)
    monkeypatch.setattr(scores, "LARGE", 1)
    for module in (scores, colour):
        monkeypatch.setattr(module, "_AT_ONCE", 1 << 13)
    known = noise(832, 864)
    pixels, design, kind = known.values[0].size, lay("bar", BAR), Protocol("camera")
    design.on(known.margin.shape)
    record = kind.photograph(design, known, 32)
    blur, restore, similar, differ = (
        peak(work) / pixels
        for work in (
            lambda: kind.photograph(design, known, 32),
            lambda: kind.shown(wiener.Wiener().prepare(record, design)(0.01)),
            lambda: Truth(known.true).ssim(record.values),
            lambda: Truth(known.true).delta_e(record.values),
        )
    )
    # The record is there while a photograph is restored, the picture too while it is scored.
    assert blur < 80 - 24
    assert restore < 80 - 36
    assert max(similar, differ) < 80 - 48


def test_the_record_of_a_large_photograph_is_gone_once_it_is_restored(in_parts, monkeypatch):
    """Twelve of the 80 bytes a pixel, while a score takes the most."""
    taken, held = [], []
    photograph, delta_e = Protocol.photograph, Truth.delta_e

    def watched(*arguments):
        record = photograph(*arguments)
        taken.append(weakref.ref(record))
        return record

    def scored(*arguments):
        held.append(any(record() is not None for record in taken))
        return delta_e(*arguments)

    monkeypatch.setattr(Protocol, "photograph", watched)
    monkeypatch.setattr(Truth, "delta_e", scored)
    large = noise(704, 736)
    monkeypatch.setattr(imaging, "LARGE", 680 * 680)
    small = replace(noise(672, 672), name="middle")
    evaluate([lay("bar", BAR)], [large], [small], (24, 32), protocol=Protocol("camera"))
    assert len(taken) == 2
    assert held == [False, False]


def test_curves_and_sums_do_not_depend_on_where_they_are_parted(in_parts):
    code = np.random.default_rng(1).random((3, 40, 50))[:, 3:-3, 1:]
    light = light_of_code(code)
    expected = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(light, expected, rtol=1e-14)
    np.testing.assert_allclose(code_of_light(light), code, atol=1e-7)
    other = (code + 0.1).astype(np.float32)
    assert psnr(other, code.astype(np.float32)) == pytest.approx(20.0, abs=1e-5)
    assert Truth(other).ssim(other) == pytest.approx(1.0, abs=1e-5)


def test_a_whole_scene_holds_the_picture_but_for_whole_blocks_and_its_middle_is_the_scene_of_old():
    picture = np.random.default_rng(2).random((1100, 2050, 3), dtype=np.float32)
    whole = scene("7", picture, whole=True)
    assert whole.values.shape == (3, 1088, 2048)
    np.testing.assert_array_equal(whole.values, picture[6:1094, 1:2049].transpose(2, 0, 1))
    old = scene("7", picture)
    np.testing.assert_array_equal(whole.middle.values, old.values)
    assert (whole.middle.number, whole.middle.name) == (old.number, old.name)
    bright = replace(whole, measured=2 * whole.values)
    np.testing.assert_array_equal(bright.middle.measured, 2 * old.values)


def test_whole_photographs_that_memory_does_not_hold_are_refused(tmp_path, monkeypatch):
    for name in "ab":
        write_png(np.full((3, 832, 896), 0.5), tmp_path / f"{name}.png")
    monkeypatch.setattr(photographs, "MOST_WHOLE", 832 * 896 + 1)
    with pytest.raises(JobError, match=r"MF142.*b\.png"):
        folder(tmp_path, whole=True)
    assert len(folder(tmp_path).photographs) == 2
