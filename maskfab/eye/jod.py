"""ColorVideoVDP's judgement of two pictures, for whoever has it: ``pip install 'maskfab[eye]'``.

Mantiuk, Hanji, Ashraf, Asano and Chapiro, "ColorVideoVDP: a visual difference predictor for image, video and display
distortions", ACM Trans. Graph. 43 (2024). 10 JOD is no difference; 1 JOD less is seen by three of four observers.
"""

from __future__ import annotations

import importlib
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.eye.display_light import EmittedLight
from maskfab.eye.fourier_light import series
from maskfab.eye.scielab import carrying
from maskfab.eye.viewing import Viewing

WHITE_CD_M2 = 500.0
_PASS_CPD, _STOP_CPD = 40.0, 50.0


def metric() -> ModuleType:
    """The installed ``pycvvdp``.

    Raises:
        JobError: MF121 if it is not installed, or cannot be imported.
    """
    try:
        return importlib.import_module("pycvvdp")
    except ImportError as problem:
        raise JobError(
            "MF121",
            f"JOD needs ColorVideoVDP, which cannot be imported ({problem})",
            where="--jod",
            cure="Run pip install 'maskfab[eye]', or leave --jod out",
        ) from None


def jod(test: EmittedLight, reference: EmittedLight, viewing: Viewing, white_cd_m2: float = WHITE_CD_M2) -> float:
    """Quality of a display in just-objectionable differences, at most 10.

    Args:
        test: what the display shows.
        reference: the same picture on an ideal display, of as many pixels.
        viewing: where the eye is.
        white_cd_m2: luminance of the display's white, on the mean over a pixel.

    Notes:
        The metric takes the pixel lattice at some 60 cycles per degree for a visible pattern, so frequencies from 40 to
        50 are faded out and higher ones removed before it sees the light. It wants absolute luminance (relative light
        is below its threshold everywhere, and all is 10.00), a linear EOTF, and a peak that clips nothing.

    Raises:
        JobError: MF121 if ColorVideoVDP is not installed.
    """
    library = metric()
    shown = [_absolute(light, viewing, white_cd_m2) for light in (test, reference)]
    rows, columns = shown[0].shape[:2]
    samples_per_degree = carrying(_STOP_CPD, viewing) * viewing.pixels_per_degree
    photometry = library.vvdp_display_photo_eotf(
        float(max(light.max() for light in shown)), contrast=1e6, source_colorspace="BT.709", EOTF="linear"
    )
    geometry = library.vvdp_display_geometry((columns, rows), ppd=samples_per_degree)
    judge = library.cvvdp(display_photometry=photometry, display_geometry=geometry)
    quality, _ = judge.predict(*shown, dim_order="HWC")
    return float(quality)


def _absolute(light: EmittedLight, viewing: Viewing, white_cd_m2: float) -> NDArray[np.float32]:
    """Luminous light [y, x, 3] in cd/m2, top row first, without what is finer than the eye resolves."""
    passed = series(light, viewing, _STOP_CPD).filtered(_fade)
    values = passed.values(carrying(_STOP_CPD, viewing))
    # Fading out rings a little; light is never negative.
    lit = np.maximum(np.moveaxis(values, 0, -1)[::-1], 0.0) * white_cd_m2
    return np.ascontiguousarray(lit, dtype=np.float32)


def _fade(radius_cpd: Floats) -> Floats:
    part = np.clip((radius_cpd - _PASS_CPD) / (_STOP_CPD - _PASS_CPD), 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * part))
