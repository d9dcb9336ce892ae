"""Light beyond the window of a measured PSF, taken from the design: photographs by a simulator of its own."""

from __future__ import annotations

import numpy as np
import pytest
from capture_simulator import Dots, Optics, picture
from scipy import signal

import maskfab as mf
from maskfab.base.errors import MaskfabError
from maskfab.camera.scenes import dead_leaves
from maskfab.mask.formats.exr import write_channels
from maskfab.optics.colour import light_of_code

LENS = {"stop": "2 mm", "pixel": "4 um", "wavelengths": ["610 nm", "530 nm", "470 nm"], "window": "400 um"}
SIDE, PIXELS, WINDOW, ROOM, WHITE_E = 256, 193, 65, 96, 1e4


def panel():
    bar = mf.Opening.bar(dots=21, size=(5, 18), pitch="168 um")
    return mf.Panel.tile(bar, "random", seed=1, size="2.4 mm")


@pytest.fixture(scope="module")
def spread():
    """The PSF of a lens that is a little out of focus, and of a picture that is larger than the job's."""
    lines = [(610.0, 1.0), (530.0, 610 / 530), (470.0, 610 / 470)]
    each = [
        picture(Dots.of(panel()), Optics(2000.0, 10020.0, 4.0, PIXELS, {line: 1.0}, {4: 0.05 * times}))
        for line, times in lines
    ]
    return np.stack([one / one.sum() for one in each])


def written(path, planes, **facts):
    write_channels(np.stack(planes, axis=2).astype(np.float32), ("R", "G", "B"), path, facts)
    return path


def inside(spread, window=WINDOW):
    first = (PIXELS - window) // 2
    return spread[:, first : first + window, first : first + window]


def psnr(found, light):
    inner = (slice(None), slice(32, -32), slice(32, -32))
    return -10 * np.log10(np.square(found.photos[0].picture[inner].astype(np.float64) - light[inner]).mean())


@pytest.mark.parametrize("kind", ["fitted", "captured"])
def test_a_measured_psf_with_its_job_loses_nothing_by_its_window(tmp_path, spread, kind):
    draw = np.random.default_rng(1)
    scene = light_of_code(dead_leaves(1, 512, 512).values[:, : SIDE + 2 * ROOM, : SIDE + 2 * ROOM])
    seen = np.stack([signal.fftconvolve(*pair, mode="valid") for pair in zip(scene, spread, strict=True)])
    photo = written(tmp_path / "photo.exr", draw.poisson(np.maximum(seen, 0) * WHITE_E) / WHITE_E)
    facts, light = {"holds": "fitted_psf", "die": "A", "sensor_pixel_um": 4.0}, inside(spread)
    if kind == "captured":
        rate = 64 * (1e4 * light / light.max() + 1)
        facts, light = {"mosaic": "none"}, (draw.poisson(rate) + 4.87 * draw.standard_normal(rate.shape)) / 64
    psf = written(tmp_path / "psf.exr", light, **facts)
    whole = written(tmp_path / "whole.exr", spread, holds="fitted_psf", die="A", sensor_pixel_um=4.0)
    how = {"white": 1.0, "gain": WHITE_E, "read_noise": 1.0, "restore": "wiener"}
    job = {"job": panel(), "camera": mf.Camera("10 mm", **LENS)}
    by_all = psnr(mf.restore(photo, psf=whole, **how), scene[:, ROOM:-ROOM, ROOM:-ROOM])
    alone, both = mf.restore(photo, psf=psf, **how), mf.restore(photo, psf=psf, **job, **how)
    lost = by_all - psnr(alone, scene[:, ROOM:-ROOM, ROOM:-ROOM])
    assert lost > 0.3
    assert by_all - psnr(both, scene[:, ROOM:-ROOM, ROOM:-ROOM]) < 0.1
    assert "not undone; with the job" in " ".join(alone.photos[0].blur)
    assert "the light beyond the window of 65 x 65 pixels is the design's: " in " ".join(both.photos[0].blur)


@pytest.mark.parametrize(("code", "facts"), [("MF352", {"sensor_pixel_um": 3.0}), ("MF353", {"mosaic": "RGGB"})])
def test_a_psf_that_a_job_cannot_go_with_is_refused(tmp_path, spread, code, facts):
    kind = {"mosaic": {}, "sensor_pixel_um": {"holds": "fitted_psf", "die": "A"}}[next(iter(facts))]
    planes = inside(spread, 128) if code == "MF352" else inside(spread, 128)[:1]
    write_channels(
        np.stack(planes, axis=2).astype(np.float32), ("R", "G", "B")[: len(planes)] if len(planes) == 3 else ("Y",),
        tmp_path / "psf.exr", {**kind, **facts},
    )  # fmt: skip
    with pytest.raises(MaskfabError, match=code):
        mf.restore(
            written(tmp_path / "photo.exr", np.ones((3, 256, 256)) / 2), panel(), mf.Camera("10 mm", **LENS),
            psf=tmp_path / "psf.exr", white=2.0, bin=True,
        )  # fmt: skip
