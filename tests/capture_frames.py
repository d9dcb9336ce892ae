"""Frames drawn as a sensor would count them, from a light that is known."""

from __future__ import annotations

import numpy as np

from maskfab.camera.frames.frame import Frame

GAIN, READ_NOISE, BLACK, WHITE = 1.7, 4.87, 64.0, 8190.0
RGGB = (("R", "G"), ("G", "B"))


def frame(light, seconds, draw, *, pattern=RGGB, exposure_s=None, added=0.0, name=None):
    """Counts of ``light`` [rows, columns] electrons a second, and of ``added`` counts."""
    electrons = draw.poisson(light * seconds) + READ_NOISE * draw.standard_normal(np.shape(light))
    counts = np.clip(np.rint(electrons / GAIN + BLACK + added), 0, WHITE).astype(np.float32)
    black = (BLACK,) * (4 if pattern else 1)
    return Frame(name or f"{seconds:g}s", counts, black, WHITE, pattern, seconds if exposure_s is None else exposure_s)


def point_light(side=96, peak=2e6):
    """Light of a spot and its diffraction on a faint ground, electrons a second."""
    y, x = np.mgrid[:side, :side] - side // 2 + 0.5
    spot = np.exp(-(x**2 + (y + 2) ** 2) / 30)
    return peak * spot + peak / 10 * np.abs(np.sinc(x / 7) * np.sinc(y / 9)) + 50
