"""Noise taken out of a record before its blur is undone: cosine transforms of all its 8 x 8 windows.

Light whose noise grows with it is first told as numbers whose noise does not, by the generalised Anscombe transform. n
electrons counted with read noise of variance s² become

    z = 2 √(n + 3/8 + s²),

of variance about 1 whatever their mean (Starck, Murtagh, Bijaoui, Image Processing and Data Analysis, 1998, 2.4).
A mean D of such numbers is brought back, without the bias that the root has, by

    n = D²/4 + √(3/2) / (4 D) - 11 / (8 D²) + 5 √(3/2) / (8 D³) - 1/8 - s²

(Mäkitalo, Foi, IEEE Trans. Image Process. 20, 2697, 2011, for s = 0; 22, 91, 2013, for any). Of merged exposures light
has another noise beyond every full well. There the root of that noise goes on from where the last one ended.

What little of a window's transform stands above the noise is kept; the mean of all the windows that hold a pixel is its
light (Yu, Sapiro, Image Processing On Line 1, 292, 2011). That is a first guess of the windows' spectra P, and a second
pass weighs every coefficient of the record by P² / (P² + 1), its Wiener filter (Pierazzo, Morel, Facciolo, Image
Processing On Line 7, 288, 2017). Windows count by the inverse of the noise that they let through. All happens in
brightness and two opponent colours, for colours differ less than pixels do.

The published protocol has a denoiser too, then a Wiener filter that takes all spectra for white,

    G = H* / (|H|² + ε)

with one ε whatever the light, of a record with darkness round it. The published evaluation denoises by BM3D, whose
licence is not commercial, with a variance fixed for each level; here noise goes by cosine transforms and the record's
own variance.

Notes:
    Photographs and drawn scenes behind protocol F1's camera, nine cases from 24 to 40 dB, each with its best ε, mean
    gain over the Wiener filter alone: thresholds of 2.2, 2.5, 2.8 and 3.1 give 2.08, 2.21, 2.24 and 2.22 dB; the first
    pass alone 2.08 dB at 2.7. On red, green and blue apart the first pass gives .4 to 1 dB less.
    Interpolating a mosaic correlates noise. What becomes of it in every coefficient follows from the filters alone, if
    the three colours have the same light; with that in place of 1, see :func:`mosaic_noise`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from maskfab.base.arrays import Singles
from maskfab.camera.imaging import MARGIN, Blur, Margin
from maskfab.camera.record import MergedNoise, Noise, Record, Restorer, interpolated
from maskfab.camera.restorers.least_squares import Gradient
from maskfab.camera.restorers.wiener import Wiener
from maskfab.optics.restoration import wiener_filter

_DARK = 3 / 8


def stabilised(light: Singles, noise: Noise | MergedNoise) -> Singles:
    """Light in units of white, any shape, as numbers with noise of variance 1; 0 from 3/8 + s² electrons below dark."""
    (top, first), *brighter = noise.zones
    if not brighter:
        return _root(light, first)
    stable = _root(np.minimum(light, np.float32(top)), first)
    for ceiling, zone in brighter:
        start = np.asarray(top, dtype=np.float32)
        stable += _root(np.clip(light, start, np.float32(ceiling)), zone) - _root(start, zone)
        top = ceiling
    return stable


def unbiased(stable: Singles, noise: Noise | MergedNoise) -> Singles:
    """The light, in units of white, of which ``stable`` is the mean of :func:`stabilised`."""
    (top, first), *brighter = noise.zones
    light = _light(stable, first)
    for ceiling, zone in brighter:
        start = np.asarray(top, dtype=np.float32)
        end = stabilised(start, noise)
        beyond = stable >= end
        light[beyond] = _light(stable[beyond] + (_root(start, zone) - end), zone)
        top = ceiling
    return light


def _root(light: Singles, noise: Noise) -> Singles:
    counted = light * np.float32(noise.electrons)
    counted += np.float32(_DARK + _read(noise))
    return np.asarray(2 * np.sqrt(np.maximum(counted, 0)))


def _light(stable: Singles, noise: Noise) -> Singles:
    inverse = 1 / np.maximum(stable, np.float32(2 * _DARK**0.5))  # below, the series turns back
    root = np.float32(1.5**0.5)
    series = ((5 / 8 * root * inverse - np.float32(11 / 8)) * inverse + root / 4) * inverse
    counted = 1 / (4 * inverse * inverse) + series - np.float32(1 / 8 + _read(noise))
    return np.asarray(counted / np.float32(noise.electrons))


def _read(noise: Noise) -> float:
    """s², in electrons."""
    return noise.floor * noise.electrons**2


WINDOW = 8
"""Pixels along a window's side."""
THRESHOLD = 2.8
"""In standard deviations of the noise."""

_LEFT = 1 / 16
_STRIP = 32  # rows of windows worked on at a time: what they hold stays small, whatever the picture


def _cosines(count: int) -> Singles:
    """Matrix of the orthonormal DCT-II, as scipy's, which is slow to load."""
    order, place = np.arange(count)[:, None], np.arange(count) + 0.5
    waves = np.sqrt(2 / count) * np.cos(np.pi / count * order * place)
    waves[0] /= np.sqrt(2)
    return np.asarray(waves.round(15), dtype=np.float32)


_COSINES, _OPPONENT = _cosines(WINDOW), _cosines(3)


@dataclass(frozen=True)
class Dct:
    """Takes the noise out, and has another restorer undo the blur.

    Attributes:
        then: that one. It is given a sixteenth of ε, for there is less noise left: with that, one grid of ε reaches the
            best picture with and without.
    """

    then: Restorer = field(default_factory=Wiener)
    threshold: float = THRESHOLD

    @property
    def name(self) -> str:
        return f"dct+{self.then.name}"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        calm = denoised(record, self.threshold)
        # A full well says only that there was more light; the neighbours' mean must not make it look measured.
        restored = self.then.prepare(replace(record, values=np.where(record.clipped, record.values, calm)), blur)
        return lambda epsilon: restored(_LEFT * epsilon)


def denoised(record: Record, threshold: float = THRESHOLD) -> Singles:
    """Light [3, rows, columns] of a record, in units of white, with less noise; below 0 where the dark was."""
    white = np.ones((3, WINDOW, WINDOW), dtype=np.float32)
    stable = stabilised(record.values, record.noise)
    return unbiased(smoothed(stable, mosaic_noise() if record.interpolated else white, threshold), record.noise)


def smoothed(picture: Singles, variance: Singles, threshold: float = THRESHOLD) -> Singles:
    """A picture [3, rows, columns] with less noise.

    Args:
        picture: red, green and blue, of 8 pixels or more along a side; the noise is as strong everywhere.
        variance: of every coefficient of a window in brightness and two opponent colours, [3, 8, 8].
    """
    opponents = np.tensordot(_OPPONENT, picture, axes=1)
    for colour, expected in zip(opponents, variance, strict=True):
        guess = _mean_of_windows(colour, None, expected, threshold)
        colour[:] = _mean_of_windows(colour, guess, expected, threshold)
    return np.tensordot(_OPPONENT.T, opponents, axes=1)


@cache
def mosaic_noise() -> Singles:
    """Variance of windows' coefficients after a mosaic with noise of variance 1 was interpolated; read-only.

    Returns:
        float32 [3 opponent colours, 8, 8], the mean over windows' four places on the mosaic.
    """
    reach, side = 2, WINDOW + 6
    total = np.zeros((3, WINDOW, WINDOW))
    for place in range(side**2):
        # What one pixel of the mosaic adds to every window that it is in.
        pixel = np.zeros(side**2, dtype=np.float32)
        pixel[place] = 1
        colours = np.tensordot(_OPPONENT, interpolated(pixel.reshape(side, side)), axes=1)
        for top, left in np.ndindex(2, 2):
            window = colours[:, reach + top :, reach + left :][:, :WINDOW, :WINDOW]
            total += np.square(_COSINES @ window @ _COSINES.T) / 4
    variance = total.astype(np.float32)
    variance.flags.writeable = False
    return variance


def _mean_of_windows(picture: Singles, guess: Singles | None, variance: Singles, threshold: float) -> Singles:
    """A noisy picture [rows, columns], less noisy."""
    total, weights = np.zeros_like(picture), np.zeros_like(picture)
    for top in range(0, len(picture) - WINDOW + 1, _STRIP):
        strip = slice(top, top + _STRIP + WINDOW - 1)
        guessed = None if guess is None else guess[strip]
        _add_windows(picture[strip], guessed, variance, threshold, total[strip], weights[strip])
    return np.asarray(np.divide(total, weights, out=total))


def _add_windows(
    picture: Singles, guess: Singles | None, variance: Singles, threshold: float, total: Singles, weights: Singles
) -> None:
    """Add all windows of a strip, filtered, to ``total``, and their weights to ``weights``; all [rows, columns]."""
    rows, across = len(picture), picture.shape[1] - WINDOW + 1
    wide = np.repeat(variance, across, axis=1)
    least = np.float32(threshold) * np.sqrt(wide)
    lines = _along_rows(picture)
    guessed = None if guess is None else _along_rows(guess)
    filtered, counted = np.zeros_like(lines), np.zeros((rows, across), dtype=np.float32)
    spectrum, gain, spare = (np.empty((WINDOW, WINDOW * across), dtype=np.float32) for _ in range(3))
    for y in range(rows - WINDOW + 1):
        window = slice(y, y + WINDOW)
        np.matmul(_COSINES, lines[window], out=spectrum)
        if guessed is None:
            np.greater(np.abs(spectrum, out=gain), least, out=gain, casting="unsafe")
            noise = gain
        else:
            np.matmul(_COSINES, guessed[window], out=gain)
            np.square(gain, out=gain)
            np.divide(gain, np.add(gain, wide, out=spare), out=gain)
            noise = np.square(gain, out=spare)
        weight = 1 / np.maximum(variance.ravel() @ noise.reshape(WINDOW**2, across), 1)
        spectrum *= gain
        spectrum.reshape(WINDOW**2, across)[:] *= weight
        filtered[window] += np.matmul(_COSINES.T, spectrum, out=spare)
        counted[window] += weight
    back = np.matmul(_COSINES.T, filtered.reshape(rows, WINDOW, across))
    for x in range(WINDOW):
        total[:, x : x + across] += back[:, x]
        weights[:, x : x + across] += counted


def _along_rows(picture: Singles) -> Singles:
    """Cosine transforms along the rows of all windows, [rows, 8 · (columns - 7)], coefficient by coefficient."""
    windows = sliding_window_view(picture, WINDOW, axis=1).transpose(0, 2, 1)
    lines = np.matmul(_COSINES, np.ascontiguousarray(windows))
    return np.asarray(lines.reshape(len(picture), -1))


EPSILON = (20 / 35) ** 10
"""Noise to signal of the published evaluation, 0.0037; the paper's text has ten times as much."""


@dataclass(frozen=True)
class Published:
    """The restoration of the published protocol."""

    width: int = MARGIN
    name: str = "published"

    def prepare(self, record: Record, blur: Blur) -> Callable[[float], Singles]:
        """See :class:`maskfab.camera.record.Restorer`; as published, light above white is left."""
        margin = Margin.around(record.values, self.width)
        calm = margin.dark(denoised(record))
        spectrum = np.asarray(scipy.fft.rfft2(calm, axes=(1, 2), workers=1))
        transfer = blur.on(margin.shape)

        def restored(epsilon: float) -> Singles:
            return np.maximum(margin.blurred(spectrum, wiener_filter(transfer, np.float32(epsilon))), 0)

        return restored


RESTORERS = (Dct(), Dct(Gradient()))
