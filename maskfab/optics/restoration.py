r"""Restoration by a Wiener filter, from the transfer function on the sensor's square of frequencies.

With O the presampled transfer function and ε the noise-to-signal ratio, the filter O* / (|O|² + ε) restores

    H = |O|² / (|O|² + ε)                                       (Gonzalez, Woods, Digital Image Processing, 5.8)

of each frequency and amplifies white noise by the root of the mean of |O|² / (|O|² + ε)² over the square
|ν_x|, |ν_y| <= 1 / (2p).

Notes:
    As ε -> 0, H -> 1 wherever O is not zero and H -> 0 where it is, and the amplification grows without bound if O has
    a null: with ε = 0 a computed null, 1e-17 instead of 0, would decide the answer. So ε = 0 is refused as soon as |O|
    comes within its own uncertainty of zero, and no value is ever clamped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices, Singles
from maskfab.base.errors import JobError
from maskfab.base.model import Frozen, Quantity
from maskfab.job.camera import Camera
from maskfab.optics.lags import LagTable
from maskfab.optics.psf import image_scale_um2
from maskfab.optics.spectrum import Spectrum, pixel_transfer, polychromatic_otf_grid

Response = TypeVar("Response", Singles, Floats, Singles | NDArray[np.complex64])

WORST_SHARE = 0.3
"""The share of frequencies that the design's loss looks at."""

SAMPLES = 256

# Pairs of frequencies and cut dots that are made exact, no fewer frequencies, and how many standard deviations of a
# mean over these the mean over all may be off.
_EXACT_PAIRS, _FEWEST_EXACT, _SIGMAS = 50_000, 64, 3


@dataclass(frozen=True, eq=False)
class SomeExact:
    """The modulation at some of a square's frequencies, drawn at random, without the error that the others have.

    Attributes:
        places: int [k], of the flat square.
        modulation: float64 [k].
        uncertainty: bound of its error.
    """

    places: Indices
    modulation: Floats
    uncertainty: float


@dataclass(frozen=True, eq=False)
class SensorSquare(Frozen):
    """|presampled OTF| at the midpoints of a grid over the upper half of the sensor's square of frequencies.

    Attributes:
        modulation: float64 [n / 2, n]; the lower half is alike, because the PSF is real.
        wavelength_nm: the line, or None for a spectrum of several.
        exact: what is better known; None for several lines, or where all is exact.
    """

    modulation: Floats
    uncertainty: float
    wavelength_nm: float | None
    exact: SomeExact | None = None

    @property
    def before_and_after(self) -> tuple[Floats, Floats]:
        """The modulation at the frequencies that are exact: as it stands in the square, and exact, [k]."""
        exact = self.exact or SomeExact(np.zeros(0, dtype=np.intp), np.zeros(0), 0.0)
        return self.modulation.ravel()[exact.places], exact.modulation

    def mean_change(self, changes: Floats) -> tuple[float, float]:
        """Between what the mean of a change over all frequencies lies, from those at the exact ones, [k]."""
        mean, unseen = float(changes.mean()), 1 - changes.size / self.modulation.size
        error = _SIGMAS * float(changes.std()) * math.sqrt(unseen / changes.size)
        return mean - error, mean + error


def sensor_square(table: LagTable, camera: Camera, spectrum: Spectrum, samples: int = SAMPLES) -> SensorSquare:
    """The presampled modulation on samples / 2 x samples frequencies.

    Args:
        table: lags up to half a cycle per pixel at the longest wavelength.
        samples: along a side of the square, even.

    Raises:
        JobError: MF104 if the samples are odd or fewer than 4.
    """
    if samples < 4 or samples % 2:
        what = f"{samples} samples per side are not an even number of 4 or more"
        raise JobError("MF104", what, cure="Give an even number of 4 or more, such as 256")
    step = 1 / (camera.pixel_um * samples)
    axis = step * (np.arange(samples, dtype=np.float64) - (samples - 1) / 2)
    upper = axis[samples // 2 :]
    optics = polychromatic_otf_grid(table, camera, spectrum, axis, upper)
    modulation = abs(optics * pixel_transfer(camera, axis, upper[:, None]))
    line = float(spectrum.wavelengths_nm[0]) if spectrum.wavelengths_nm.size == 1 else None
    exact = (
        None
        if line is None or not table.rims or not table.affords(_FEWEST_EXACT)
        else _some_exact(table, camera, line, axis, upper)
    )
    return SensorSquare(modulation, table.coarse_uncertainty, line, exact)


def _some_exact(table: LagTable, camera: Camera, wavelength_nm: float, axis: Floats, upper: Floats) -> SomeExact:
    size, count = axis.size * upper.size, max(_FEWEST_EXACT, _EXACT_PAIRS // table.cut_dots)
    places = np.random.default_rng(0).choice(size, min(size, count), replace=False)
    nu_x, nu_y = axis[places % axis.size], upper[places // axis.size]
    scale = image_scale_um2(camera, wavelength_nm)
    modulation = abs(table.otf(scale * nu_x, scale * nu_y) * pixel_transfer(camera, nu_x, nu_y))
    return SomeExact(places, modulation, table.uncertainty)


def wiener_filter(transfer: Response, noise_to_signal: NDArray[np.floating[Any]] | np.floating[Any]) -> Response:
    """H* / (|H|² + R), any shapes that broadcast; 0 where there is neither signal nor noise.

    Designs descend along its slope by :func:`maskfab.designs.model.panel_error.wiener_tensor`, the same on tensors.
    """
    below, above = np.asarray(squared_modulus(transfer) + noise_to_signal), transfer.conj()
    out = below if below.dtype == transfer.dtype else np.empty_like(transfer)
    if below.min(initial=1) > 0:  # nearly always; nothing then needs to be asked, or filled, element by element
        return np.asarray(np.divide(above, below, out=out))
    return np.asarray(np.divide(above, below, out=np.zeros_like(transfer), where=below > 0))


def squared_modulus(transfer: NDArray[Any]) -> NDArray[Any]:
    """|H|², any shape, real or complex."""
    return transfer.real**2 + transfer.imag**2 if np.iscomplexobj(transfer) else transfer**2


def wiener_response(modulation: Floats, noise_to_signal: float) -> Floats:
    """H at each modulation, any shape, values in [0, 1]; ε = 0 gives the limit, 1 where there is any signal and else 0.

    Raises:
        JobError: MF104 for a noise-to-signal ratio that is negative or not finite.
    """
    _check(noise_to_signal)
    if noise_to_signal == 0:
        return np.asarray(modulation != 0, dtype=np.float64)
    # As 1 / (1 + ε / O²) a modulation of 1e-200 would overflow; as a ratio of the smaller to the larger nothing can.
    root = np.sqrt(noise_to_signal)
    ratio = np.minimum(modulation, root) / np.maximum(modulation, root)
    return np.where(modulation < root, ratio**2, 1.0) / (1 + ratio**2)


def restoration_gain(modulation: Floats, noise_to_signal: float) -> Floats:
    """|O| / (|O|² + ε) at each modulation: how much the filter amplifies there; at most 1 / (2 √ε).

    Raises:
        JobError: MF104 for a ratio that is negative or not finite, or for ε = 0 where a modulation is 0.
    """
    _check(noise_to_signal)
    smallest = float(np.min(modulation, initial=1.0))
    if noise_to_signal == 0:
        if smallest == 0:
            raise _unbounded(smallest, 0.0)
        return np.asarray(1 / modulation)
    return wiener_filter(modulation, np.float64(noise_to_signal))


def worst_wiener(square: SensorSquare, noise_to_signal: float, die: str | None = None) -> Quantity:
    """Mean of H over the 30 % of frequencies where it is lowest.

    The uncertainty follows H, which rises with |O|, over the error bar of |O|, and adds the change against the mean
    over every other sample along both axes. Where some of |O| is exact the mean change of H there, within three
    standard deviations, stands for the error bar of each: with t the largest of the lowest 30 %, their mean is no more
    than that of the same frequencies, and no less than t less the mean of what H lacks of t over 0.3.

    Raises:
        JobError: MF104 for a noise-to-signal ratio that is negative or not finite; for ε = 0 if a modulation is within
            its uncertainty of 0, where H is 1 or 0 for no reason.
    """
    _refuse_null(square, noise_to_signal)
    low, high = _bounds(square)
    value = _worst_mean(wiener_response(square.modulation, noise_to_signal))
    spread = max(
        _worst_mean(wiener_response(high, noise_to_signal)) - value,
        value - _worst_mean(wiener_response(low, noise_to_signal)),
    )
    if square.exact is not None:
        before, after = (wiener_response(part, noise_to_signal) for part in square.before_and_after)
        threshold = _lowest(wiener_response(square.modulation, noise_to_signal))[-1]
        of_the_same = square.mean_change(np.where(before <= threshold, after - before, 0.0))[1]
        lacking = square.mean_change(np.minimum(after, threshold) - np.minimum(before, threshold))[0]
        spread += max(of_the_same, -lacking, 0.0) / WORST_SHARE
    coarse = [
        _worst_mean(wiener_response(square.modulation[i::2, j::2], noise_to_signal)) for i in range(2) for j in range(2)
    ]
    return Quantity(
        "wiener_worst30",
        value,
        f"mean of |O|²/(|O|² + ε), ε = {noise_to_signal:g}, over the worst {WORST_SHARE:.0%} of the frequencies of the "
        "sensor's square; O is the presampled OTF from the lag table",
        uncertainty=spread + max(abs(c - value) for c in coarse),
        die=die,
        wavelength_nm=square.wavelength_nm,
    )


def noise_gain(square: SensorSquare, noise_to_signal: float, die: str | None = None) -> Quantity:
    """Root mean square by which the Wiener filter amplifies white noise of the pixels.

    Raises:
        JobError: MF104 for a noise-to-signal ratio that is negative or not finite; for ε = 0 if a modulation is within
            its uncertainty of 0, where the gain has no bound.
    """
    _refuse_null(square, noise_to_signal)
    low, high = (restoration_gain(bound, noise_to_signal) for bound in _bounds(square))
    gain = restoration_gain(square.modulation, noise_to_signal)
    most, least = np.maximum(np.maximum(low, high), gain), np.minimum(np.minimum(low, high), gain)
    if noise_to_signal > 0:
        root = np.sqrt(noise_to_signal)
        # The gain peaks where |O|² = ε, between the ends of some error bars.
        most = np.where(abs(square.modulation - root) <= _each(square), 0.5 / root, most)
    value = _root_mean_square(gain)
    power_change = (0.0, 0.0)
    if square.exact is not None:
        before, after = (restoration_gain(part, noise_to_signal) for part in square.before_and_after)
        power_change = square.mean_change(after**2 - before**2)
    coarse = [_root_mean_square(gain[i::2, j::2]) for i in range(2) for j in range(2)]
    spread = max(_root_mean_square(most) - value, value - _root_mean_square(least))
    spread += max(abs(math.sqrt(max(value**2 + change, 0.0)) - value) for change in power_change)
    return Quantity(
        "wiener_noise_gain",
        value,
        f"rms of |O|/(|O|² + ε), ε = {noise_to_signal:g}, over the sensor's square of frequencies: standard deviation "
        "of white noise after restoration over that before",
        uncertainty=spread + max(abs(c - value) for c in coarse),
        die=die,
        wavelength_nm=square.wavelength_nm,
    )


def _each(square: SensorSquare) -> float:
    """Error of every modulation that their mean change does not tell."""
    return square.uncertainty if square.exact is None else square.exact.uncertainty


def _bounds(square: SensorSquare) -> tuple[Floats, Floats]:
    return (
        np.asarray(np.clip(square.modulation - _each(square), 0, None)),
        np.asarray(square.modulation + _each(square)),
    )


def _lowest(response: Floats) -> Floats:
    """The lowest 30 % in order, and the next one."""
    return np.sort(response, axis=None)[: int(WORST_SHARE * response.size) + 1]


def _worst_mean(response: Floats) -> float:
    """Mean of the lowest 30 %, the last value counted in part so that nothing jumps with the number of samples."""
    count, lowest = WORST_SHARE * response.size, _lowest(response)
    whole = lowest.size - 1
    return float((lowest[:whole].sum() + (count - whole) * lowest[whole]) / count)


def _root_mean_square(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _check(noise_to_signal: float) -> None:
    if not (np.isfinite(noise_to_signal) and noise_to_signal >= 0):
        what = f"the noise-to-signal ratio {noise_to_signal:g} is not a finite number of at least 0"
        raise JobError("MF104", what, cure="Give one such as 0.015")


def _refuse_null(square: SensorSquare, noise_to_signal: float) -> None:
    _check(noise_to_signal)
    smallest = float(square.modulation.min())
    if noise_to_signal == 0 and smallest <= square.uncertainty:
        raise _unbounded(smallest, square.uncertainty)


def _unbounded(smallest: float, uncertainty: float) -> JobError:
    what = (
        f"a noise-to-signal ratio of 0 amplifies noise without bound: the modulation falls to {smallest:.1e}, "
        f"known to {uncertainty:.1e}"
    )
    return JobError("MF104", what, cure="Give a positive ratio such as 0.015")
