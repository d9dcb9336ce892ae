"""Merged exposures: noise against ideal weights, no bias, and all that is wrong with pixels or frames told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from capture_frames import BLACK, GAIN, READ_NOISE, RGGB, WHITE, frame, point_light
from scipy import ndimage

from maskfab.base.errors import SourceError
from maskfab.camera.frames.merge import merged, write_merged

TIMES = (1e-3, 4e-3, 1.6e-2, 6.4e-2, 0.256)
LIGHT = point_light()
SENSOR = {"electrons_per_count": GAIN, "read_noise_e": READ_NOISE}


def stack(draw, light=LIGHT, times=TIMES, drift=(1.0,) * 5, **options):
    return [
        replace(frame(light * each, time, draw, **options), exposure_s=time)
        for time, each in zip(times, drift, strict=False)
    ]


def whole(found, name):
    """A field of the planes as the sensor is laid out."""
    laid = np.empty(found.shape)
    for plane in found.planes:
        laid[plane.first[0] :: plane.step, plane.first[1] :: plane.step] = getattr(plane, name)
    return laid


def refusal(code, frames, **options):
    with pytest.raises(SourceError) as caught:
        merged(frames, **{**SENSOR, **options})
    assert caught.value.code == code, caught.value
    assert caught.value.cure


def test_noise_is_that_of_ideal_weights_without_a_bias():
    """Ideal weights know the light: those of its own variance, of exposures that are not full."""
    full = (WHITE - BLACK) * GAIN
    around = np.ones((3, 3), dtype=bool)
    usable = np.stack([~ndimage.binary_dilation(LIGHT * time >= full, around) for time in TIMES])
    times = np.array(TIMES)[:, None, None]
    precision = (usable * times**2 / (LIGHT * times + READ_NOISE**2 + GAIN**2 / 12)).sum(axis=0)
    ideal = 1 / np.sqrt(precision)
    off, stated, told = [], [], []
    for seed in range(30):
        found = merged(stack(np.random.default_rng(seed)), **SENSOR)
        off.append((whole(found, "electrons_per_s") - LIGHT) / ideal)
        stated.append(whole(found, "sigma") / ideal)
        told.append(whole(found, "valid"))
    valid = np.all(told, axis=0)
    assert valid.mean() > 0.99
    off, stated = np.array(off)[:, valid], np.array(stated)[:, valid]
    assert np.sqrt((off**2).mean()) < 1.02
    assert np.sqrt((stated**2).mean()) == pytest.approx(1.0, abs=0.02)
    error = 1 / np.sqrt(off.size)
    assert abs(off.mean()) < 5 * error
    for part in (LIGHT < 100, (LIGHT > 300) & (LIGHT < 3000), LIGHT > 3e4):
        some = off[:, part[valid]]
        assert abs(some.mean()) < 4.5 / np.sqrt(some.size)
        assert np.sqrt((some**2).mean()) < 1.05


def test_each_colour_keeps_its_own_pixels():
    found = merged(stack(np.random.default_rng(0)), **SENSOR)
    assert [(plane.colour, plane.first, plane.step) for plane in found.planes] == [
        ("R", (0, 0), 2), ("G", (0, 1), 2), ("G", (1, 0), 2), ("B", (1, 1), 2),
    ]  # fmt: skip
    for plane in found.planes:
        own = LIGHT[plane.first[0] :: 2, plane.first[1] :: 2]
        assert np.all(abs(plane.electrons_per_s - own)[plane.valid] < 7 * plane.sigma[plane.valid])
        assert plane.variance(plane.electrons_per_s)[plane.valid] == pytest.approx(plane.sigma[plane.valid] ** 2)


def test_frames_of_three_planes_and_of_none_are_merged_at_every_pixel():
    draw = np.random.default_rng(4)
    grey = stack(draw, pattern=None)
    found = merged(grey, **SENSOR)
    assert [(plane.colour, plane.step) for plane in found.planes] == [("-", 1)]
    three = [replace(each, counts=np.stack([each.counts] * 3), black=(BLACK,) * 3) for each in grey]
    planes = merged(three, **SENSOR).planes
    assert [plane.colour for plane in planes] == ["R", "G", "B"]
    assert np.array_equal(planes[2].electrons_per_s, found.planes[0].electrons_per_s)


def test_drifted_light_is_told_and_taken_out():
    drift = (1.04, 1.0, 0.96, 1.02, 1.0)
    used = merged(stack(np.random.default_rng(1), drift=drift), **SENSOR).used
    for each, true in zip(used, drift, strict=True):
        assert each.drift.factor == pytest.approx(true, abs=4 * each.drift.error + 1e-12)
        assert each.drift.taken_out == (each.drift.factor if true != 1 else 1.0)
    assert max(each.drift.error for each in used) < 0.01


def test_no_drift_is_told_where_light_lies_about_a_full_pixel():
    """Of pixels about white those below it read low by choice, which must not be taken for drift."""
    full = (WHITE - BLACK) * GAIN
    off = []
    for seed in range(20):
        draw = np.random.default_rng(seed)
        # Few are full, or their neighbours would leave none.
        light = np.where(draw.random((128, 128)) < 0.05, draw.uniform(0.97, 1.03, (128, 128)), 0.01) * full / 0.1
        first = merged(stack(draw, light=light, times=(0.02, 0.1)), **SENSOR).used[0].drift
        off.append((first.factor - 1) / first.error)
    assert abs(np.mean(off)) < 3.5 / np.sqrt(20)


def test_readings_that_a_model_brings_near_full_favour_no_dark_pixels():
    full = (WHITE - BLACK) * GAIN
    draw = np.random.default_rng(2)
    near = draw.random((128, 128)) < 0.05
    light = np.where(near, 0.998, 0.01) * full / 0.1
    found = merged(stack(draw, light, (0.025, 0.1)), **SENSOR)
    off = []
    for plane in found.planes:
        own = (slice(plane.first[0], None, plane.step), slice(plane.first[1], None, plane.step))
        for one in (plane, plane.expecting(light[own])):
            told = near[own] & one.valid
            off.append(((one.electrons_per_s - light[own]) / one.sigma)[told].mean() * np.sqrt(told.sum()))
    assert np.mean(off[::2]) < -3
    assert abs(np.mean(off[1::2])) < 2


def test_full_pixels_and_their_neighbours_are_left_out_whatever_their_colour():
    found = merged(stack(np.random.default_rng(2))[2:], **SENSOR)
    top = LIGHT * TIMES[2] > 1.05 * (WHITE - BLACK) * GAIN
    marked = np.zeros(LIGHT.shape, dtype=bool)
    marked[tuple(found.full.T)] = True
    assert np.all(marked[ndimage.binary_dilation(top, np.ones((3, 3)))])
    assert not whole(found, "valid")[marked].any()
    assert np.isinf(whole(found, "sigma")[marked]).all()
    assert found.used[0].full == len(found.full)


def test_hot_pixels_are_found_by_dark_frames():
    added = np.zeros(LIGHT.shape)
    added[[3, 50], [9, 41]] = 200, 1500
    draw = np.random.default_rng(3)
    none = 0 * LIGHT
    frames, dark = stack(draw, added=added), [frame(none, 0.256, draw, added=added + 12)]
    found = merged(frames, dark=dark, **SENSOR)
    assert {(3, 9), (50, 41)} <= {tuple(each) for each in found.hot.tolist()}
    assert len(found.hot) < 5
    assert not whole(found, "valid")[50, 41]


def test_the_dark_that_grows_with_time_is_taken_off():
    draw = np.random.default_rng(6)
    faint = np.full((64, 64), 400.0)
    frames = [frame(faint, time, draw, added=300 * time) for time in (0.1, 0.4)]
    dark = [frame(0 * faint, 0.4, draw, added=120)]
    found = merged(frames, dark=dark, **SENSOR)
    light, sigma = (whole(found, name)[whole(found, "valid") > 0] for name in ("electrons_per_s", "sigma"))
    assert light.mean() == pytest.approx(400, abs=5 * sigma.mean() / 60)


def test_hits_in_one_exposure_are_found_by_the_others():
    frames = stack(np.random.default_rng(5))
    for place, of in (((10, 20), 4), ((70, 31), 3), ((47, 30), 1)):
        frames[of].counts[place] += 400
    found = merged(frames, **SENSOR)
    assert {(10, 20), (70, 31), (47, 30)} == {tuple(each) for each in found.disagreeing.tolist()}


def test_dust_is_told_by_the_flat_field_and_divided_out():
    draw = np.random.default_rng(7)
    y, x = np.mgrid[:96, :96]
    response = np.where((y - 30) ** 2 + (x - 60) ** 2 < 16, 0.8, 1.0) * (1 - 0.1 * ((x - 48) / 48) ** 2)
    response[80, 12] = 0.1
    even = 3e4 * np.ones(response.shape)
    flat = [frame(even * response, 0.2, draw) for _ in range(8)]
    found = merged(stack(draw, light=even * response, times=(0.05, 0.2)), flat=flat, **SENSOR)
    dusty = np.zeros(response.shape, dtype=bool)
    dusty[tuple(found.dust.T)] = True
    assert dusty[28:33, 58:63].all()
    assert dusty[80, 12]
    assert dusty.sum() < 70
    valid = whole(found, "valid") > 0
    assert not valid[80, 12]
    light, sigma = whole(found, "electrons_per_s"), whole(found, "sigma")
    off = ((light / light[valid].mean() * 3e4 - 3e4) / sigma)[valid]
    assert off.std() == pytest.approx(1.0, abs=0.05)
    assert abs(off[dusty[valid]]).mean() < 1.2


def test_what_stands_alone_is_told_but_stays():
    light = np.full((64, 64), 2e4)
    light[20, 30] = 3e4
    light[41, 11] = 1e4
    found = merged([frame(light, 0.1, np.random.default_rng(8))], **SENSOR)
    assert {tuple(each) for each in found.alone.tolist()} == {(20, 30), (41, 11)}
    assert whole(found, "valid").all()


def test_places_are_those_of_the_files_after_a_crop():
    frames = stack(np.random.default_rng(5))
    frames[4].counts[41, 20] += 400
    found = merged([each.cropped((45, 47), 60) for each in frames], **SENSOR)
    assert found.corner == (14, 16)
    assert found.disagreeing.tolist() == [[41, 20]]
    with pytest.raises(SourceError, match="MF337"):
        frames[0].cropped((20, 48), 60)


def test_stacks_that_cannot_be_merged_are_refused():
    draw = np.random.default_rng(9)
    frames = stack(draw)
    refusal("MF334", [])
    refusal("MF332", [replace(each, exposure_s=None) for each in frames])
    refusal("MF332", [replace(each, exposure_s=0.1) for each in frames])
    refusal("MF332", [replace(frames[2], exposure_s=TIMES[3]), replace(frames[3], exposure_s=TIMES[2])])
    refusal("MF331", [frames[0], replace(frames[1], pattern=(("G", "R"), ("B", "G")))])
    refusal("MF331", frames, dark=[replace(frames[0], counts=frames[0].counts[:-2])])
    refusal("MF333", [replace(each, white=65535.0) for each in frames])
    refusal("MF334", [frame(LIGHT + 1e9, time, draw) for time in TIMES[:2]])
    refusal("MF334", [frame(0 * LIGHT, time, draw) for time in TIMES])
    refusal("MF334", frames, flat=[frame(0 * LIGHT, 1.0, draw)])
    refusal("MF335", frames, electrons_per_count=0.0)
    moved = [*frames[:3], *(replace(each, counts=np.roll(each.counts, 4, axis=1)) for each in frames[3:])]
    refusal("MF336", moved)


def test_files_hold_light_and_deviation_as_the_sensor_is_laid_out(tmp_path):
    found = merged(stack(np.random.default_rng(0)), **SENSOR)
    write_merged(found, tmp_path / "light.exr", tmp_path / "sigma.exr")
    for name, field in (("light", "electrons_per_s"), ("sigma", "sigma")):
        image = oiio.ImageInput.open(str(tmp_path / f"{name}.exr"))
        spec = image.spec()
        assert np.array_equal(image.read_image("float")[..., 0], whole(found, field).astype(np.float32))
        assert spec.get_string_attribute("maskfab:mosaic") == "RGGB"
        assert spec.get_string_attribute("maskfab:unit") == "electrons/s"
        assert spec.get_string_attribute("maskfab:exposures_s") == ", ".join(map(repr, TIMES))
        assert spec.get_float_attribute("maskfab:electrons_per_count") == pytest.approx(GAIN)
        image.close()
    assert found.pattern == RGGB
