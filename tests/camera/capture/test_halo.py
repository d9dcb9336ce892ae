"""Light beyond the window of a measured PSF, taken from the design: photographs by a simulator of its own."""

from __future__ import annotations

import numpy as np
import pytest
from capture_simulator import Dots, Optics, picture
from scipy import signal

import maskfab as mf
from maskfab.api.restoring import blurs_of
from maskfab.base.errors import MaskfabError
from maskfab.camera.record import Noise, Record
from maskfab.camera.restorers.wiener import Wiener
from maskfab.camera.scenes import dead_leaves
from maskfab.mask.formats.exr import write_channels
from maskfab.optics.colour import light_of_code

LENS = {"stop": "2 mm", "pixel": "4 um", "wavelengths": ["610 nm", "530 nm", "470 nm"], "window": "400 um"}
SIDE, PIXELS, WINDOW, ROOM, WHITE_E = 256, 193, 41, 96, 1e4
FITTED = {"holds": "fitted_psf", "die": "A", "sensor_pixel_um": 4.0}


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


def written(path, planes, names="RGB", **facts):
    write_channels(np.stack(planes, axis=2).astype(np.float32), tuple(names), path, facts)
    return path


def inside(spread, window):
    first = (PIXELS - window) // 2
    return spread[:, first : first + window, first : first + window]


def psnr(record, blur, light):
    """Restored by the Wiener filter at a strength that suits them all, in linear light."""
    inner = (slice(None), slice(32, -32), slice(32, -32))
    found = Wiener().prepare(record, blur)(0.003)
    return -10 * np.log10(np.square(found[inner].astype(np.float64) - light[inner]).mean())


def undone(psf, **job):
    """The blur that a photograph is restored by, and sentences on it."""
    asked = {"job": None, "camera": None, "die": None, "pixel": None, "stands": None, **job}
    ((blur, said, _),) = blurs_of(1, psf=psf, **asked)
    return blur, " ".join(said)


@pytest.mark.parametrize("kind", ["fitted", "captured"])
def test_a_measured_psf_with_its_job_loses_nothing_by_its_window(tmp_path, spread, kind):
    draw = np.random.default_rng(1)
    scene = light_of_code(dead_leaves(1, 512, 512).values[:, : SIDE + 2 * ROOM, : SIDE + 2 * ROOM])
    seen = np.stack([signal.fftconvolve(*pair, mode="valid") for pair in zip(scene, spread, strict=True)])
    counts = (draw.poisson(np.maximum(seen, 0) * WHITE_E) / WHITE_E).astype(np.float32)
    record, truth = Record(counts, Noise(WHITE_E, 1.0)), scene[:, ROOM:-ROOM, ROOM:-ROOM]
    facts, light = FITTED, spread
    if kind == "captured":
        rate = 64 * (1e4 * light / light.max() + 1)
        facts, light = {"mosaic": "none"}, (draw.poisson(rate) + 4.87 * draw.standard_normal(rate.shape)) / 64
    by_all = psnr(record, undone(written(tmp_path / "all.exr", light, **facts))[0], truth)
    psf = written(tmp_path / "psf.exr", inside(light, WINDOW), **facts)
    alone, said = undone(psf)
    assert by_all - psnr(record, alone, truth) > 1
    assert "not undone; with the job" in said
    both, said = undone(psf, job=panel(), camera=mf.Camera("10 mm", **LENS))
    assert by_all - psnr(record, both, truth) < 0.1
    assert "the light beyond the window of 41 x 41 pixels is the design's: " in said


@pytest.mark.parametrize(
    ("code", "names", "facts"), [("MF352", "RGB", {"sensor_pixel_um": 3.0}), ("MF353", "Y", {"mosaic": "RGGB"})]
)
def test_a_psf_that_a_job_cannot_go_with_is_refused(tmp_path, spread, code, names, facts):
    facts = {**FITTED, **facts} if code == "MF352" else facts
    psf = written(tmp_path / "psf.exr", inside(spread, 64)[: len(names)], names, **facts)
    with pytest.raises(MaskfabError, match=code):
        undone(psf, job=panel(), camera=mf.Camera("10 mm", **LENS))
