"""A denoiser as the prior of a blurred scene, for the table of restorers: half-quadratic splitting, plug and play.

Least squares behind the blur and a denoiser take turns (Venkatakrishnan, Bouman, Wohlberg, GlobalSIP 2013, 945; Zhang,
Li, Zuo, Zhang, Van Gool, Timofte, IEEE Trans. Pattern Anal. Mach. Intell. 44, 6360, 2022):

    x = argmin || H x - y ||² + β || x - v ||²,        v = denoised(x, s),        β = σ² / s²,

σ the noise of the record and s that which the denoiser takes out, smaller from turn to turn. The first is a division of
spectra. The denoiser is that of :mod:`maskfab.camera.restorers.dct`, on code values: noise that the division leaves is
as strong in the dark as in bright light, where windows of light have the larger contrast. Light from beyond the sensor
is solved for once, with small gradients, and the answer's blur stands for the record there.

Notes:
    The s of the last turn that suits five photographs behind four dies, in linear light from 24 to 40 dB, falls from
    0.2 to 0.1 while the best ε of the Wiener filter falls from 0.1 to 0.001, as its sixth root does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.fft

from maskfab.base.arrays import Singles
from maskfab.camera.imaging import MARGIN, Blur
from maskfab.camera.record import Record
from maskfab.camera.restorers.dct import WINDOW, smoothed
from maskfab.camera.restorers.least_squares import START, Smooth, Spectrum, on_frame
from maskfab.optics.colour import code_of_light, light_of_code

_TURNS = 8
_FIRST, _LAST = 0.3, 0.3
"""s of the first turn and, for an ε of 1, of the last, in code values."""
_WEAKEST = 1e-6
"""ε for less than that, and β, for the denoiser must have its way where the blur passes nothing."""
_AROUND = 16
"""Pixels beyond the sensor that are denoised with it."""


@dataclass(frozen=True)
class PlugAndPlay:
    """Least squares with a denoiser in place of a penalty.

    Attributes:
        width: of the surroundings, pixels on every side; less than the sensor's sides.
    """

    width: int = MARGIN
    name: str = "pnp"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """See :class:`maskfab.camera.record.Restorer`."""
        problem = Smooth.of(record, blur, self.width)
        margin, transfer = problem.seen.margin, problem.seen.transfer
        start = problem.solve(START)
        light, scene = on_frame(margin, start * transfer), on_frame(margin, start)
        on_sensor = margin.sensor(light)
        on_sensor[:] = np.where(problem.clipped, np.maximum(on_sensor, record.values), record.values)
        pulled = _spectrum(light) * transfer.conj()
        passed = np.square(abs(transfer))
        noise = math.sqrt(float(record.noise.variance(np.minimum(record.values, 1)).mean(dtype=np.float64)))
        near = slice(self.width - _AROUND, _AROUND - self.width)

        def restored(epsilon: float) -> Singles:
            last = _LAST * max(epsilon, _WEAKEST) ** (1 / 6)
            turn = scene.copy()
            for strength in np.geomspace(max(_FIRST, last), last, _TURNS).astype(np.float32):
                turn[:, near, near] = _calm(turn[:, near, near], strength)
                pull = np.float32(max((noise / float(strength)) ** 2, _WEAKEST))
                calm = margin.sensor(turn)
                turn = on_frame(margin, (pulled + pull * _spectrum(turn)) / (passed + pull))
            return np.ascontiguousarray(calm)

        return restored


def _spectrum(picture: Singles) -> Spectrum:
    return np.asarray(scipy.fft.rfft2(picture, axes=(1, 2), workers=1))


def _calm(light: Singles, strength: np.float32) -> Singles:
    """Light within 0 to 1 without noise of that strength in its code values."""
    variance = np.full((3, WINDOW, WINDOW), strength**2, dtype=np.float32)
    return light_of_code(np.clip(smoothed(code_of_light(light), variance), 0, 1))
