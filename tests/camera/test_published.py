"""Protocol paper: the published evaluation, against a few lines written from its description."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import fftconvolve
from scipy.stats import norm, poisson

from maskfab.camera.protocol import F1, PAPER, WIENER, evaluate
from maskfab.camera.record import Noise, Record
from maskfab.camera.restorers.dct import denoised
from maskfab.camera.scenes import Photograph
from maskfab.camera.sensor import ELECTRONS
from maskfab.camera.stop_cells import CELLS, lay

SENSOR = slice(256, 448)


def tiles(seed: int) -> Photograph:
    """Squares of 16 pixels in colours of their own."""
    colours = np.random.default_rng(seed).uniform(0, 1, (3, 44, 44)).astype(np.float32)
    return Photograph(f"tiles{seed}", seed, colours.repeat(16, axis=1).repeat(16, axis=2))


SCENE = tiles(5)


def bar(deep: int, name: str = "bar"):
    unit = np.zeros((21, 21), dtype=np.bool_)
    unit[:deep, :17] = True
    return lay(name, unit)


@pytest.mark.parametrize("level", [24, pytest.param(40, marks=pytest.mark.slow)])
def test_the_protocol_is_what_its_description_says(level):
    """Scaled brightness, darkness round the sensor, noise, a denoiser, a Wiener filter with darkness round the record.

    The point spread is taken from the design, the denoiser from the product; all else is written out.
    """
    design = bar(6)
    (found,) = evaluate([design], [SCENE], [SCENE], (level,), protocol=PAPER, restorers=PAPER.restorers).scores
    spread = np.fft.fftshift(np.fft.irfft2(design.on((704, 704)), s=(704, 704)), axes=(1, 2))
    brightness, electrons = design.transmission / 0.2072, ELECTRONS[level]
    true = brightness * SCENE.values[:, SENSOR, SENSOR]
    blurred = np.stack([fftconvolve(*each)[352:544, 352:544] for each in zip(true, spread, strict=True)])
    draw = np.random.default_rng(1000 * SCENE.number + electrons)
    normal, read = (draw.standard_normal(true.shape, np.float32) for _ in range(2))
    counted = poisson.ppf(norm.cdf(normal.astype(float)), np.maximum(blurred, 0) * electrons) + 4.87 * read
    record = np.minimum(counted, 15506) / electrons
    calm = denoised(Record((record / brightness).astype(np.float32), Noise(electrons * brightness, 4.87))) * brightness
    wide = np.pad(calm, [(0, 0), (256, 256), (256, 256)])
    spectrum = np.fft.fft2(np.fft.ifftshift(spread, axes=(1, 2)))
    filtered = spectrum.conj() / (abs(spectrum) ** 2 + (20 / 35) ** 10)
    sharp = np.maximum(np.fft.ifft2(np.fft.fft2(wide) * filtered).real[:, SENSOR, SENSOR], 0)
    assert found.epsilon == pytest.approx(0.0037, abs=5e-5)
    assert found.psnr == pytest.approx(-10 * np.log10(np.mean((sharp - true) ** 2)), abs=0.01)
    trimmed = np.mean((sharp - true)[:, 64:-64, 64:-64] ** 2)
    assert found.psnr_inner == pytest.approx(-10 * np.log10(trimmed), abs=0.01)


def test_errors_count_as_bright_as_the_design_leaves_them():
    """Behind one blur that no light undoes, half the light restores as well, and scores 6 dB more."""
    scores = evaluate(
        [_Stripe("full", 0.2), _Stripe("half", 0.1)],
        [SCENE],
        [SCENE],
        (40,),
        protocol=PAPER,
        restorers=PAPER.restorers,
    ).scores
    by = {each.design: each.psnr for each in scores}
    assert by["half"] - by["full"] == pytest.approx(20 * np.log10(2), abs=0.1)


def test_light_from_outside_the_sensor_is_no_part_of_it():
    """Whatever lies round the sensor, the photograph is the same; of protocol F1 it is another."""
    other = tiles(6).values.copy()
    other[:, SENSOR, SENSOR] = SCENE.values[:, SENSOR, SENSOR]
    scenes = SCENE, Photograph(SCENE.name, SCENE.number, other)
    for protocol, alike in ((PAPER, True), (F1, False)):
        restorers = protocol.restorers or WIENER
        one, two = (
            evaluate([bar(6)], [s], [s], (40,), protocol=protocol, restorers=restorers, details=False).scores[0]
            for s in scenes
        )
        assert (one.psnr == two.psnr) is alike


class _Stripe:
    """A repeated stripe that passes as much light as is said."""

    def __init__(self, name: str, transmission: float) -> None:
        unit = np.zeros((21, 21), dtype=np.bool_)
        unit[:, 5:10] = True
        self.name, self.transmission = name, transmission
        laid = lay(name, unit, np.zeros((CELLS, CELLS), dtype=np.int8))
        self.on, self.blurred = laid.on, laid.blurred
