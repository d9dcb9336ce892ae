"""A die as a camera saw it beside the die as designed: which it is, how it stands, how it was written."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maskfab.camera.exposure import F1_SENSOR
from maskfab.camera.sensor import Sensor
from maskfab.capture.cost import COST_METHOD, Cost, costs
from maskfab.capture.designed_edge import Light
from maskfab.capture.die_image import BIAS, DieImage, Pixels, Setting
from maskfab.capture.fit import Fit, expecting, fitted
from maskfab.capture.frame_scatter import with_frames
from maskfab.capture.identify import Hypothesis, Identified, identified
from maskfab.capture.light_width import LightWidth, with_width_and_terms
from maskfab.capture.merge import Merged
from maskfab.capture.mtf_band import MtfBand, mtf_bands
from maskfab.capture.promise import Promise
from maskfab.capture.taken import Taken, brightest, taken_of
from maskfab.capture.verdict import NORMAL_95, TERM_NAMES, cause, verdict
from maskfab.errors import JobError, SourceError
from maskfab.model import Camera, Panel, Quantity
from maskfab.optics.image.spectrum import Band, Spectrum, line_spectrum
from maskfab.progress import Progress, silent
from maskfab.units import UM_PER_NM

_SPECKLES_PER_PANEL = 3.0
_UNLIKE = 3.0
"""Root of chi² per pixel from which a fit is held to be none: the light, the camera or the die is another."""
_NOTHING = Promise()
_STRETCHED = 0.1
"""Change of scale from which camera or light are others than the job's."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A capture and what it tells of the plate.

    Attributes:
        merged: the exposures.
        taken: their pixels about the light, with the noise that the fit expects.
        identified: the die.
        image: of it.
        fit: of it, with as many of the lens's errors as the residuals ask for.
        bands: MTF of every grid of pixels.
        costs: of what is not as drawn.
        quantities: the numbers.
        verdict: sentences, the most important first.
        mirrored: whether the plate stands the other way round than the job says.
    """

    merged: Merged
    taken: tuple[Taken, ...]
    identified: Identified
    image: DieImage
    fit: Fit
    bands: tuple[MtfBand, ...]
    costs: tuple[Cost, ...]
    quantities: tuple[Quantity, ...]
    verdict: tuple[str, ...]
    mirrored: bool


def measured(
    merged: Merged,
    panels: Mapping[str, Panel],
    camera: Camera,
    light: Mapping[str, Spectrum],
    *,
    seen_mirrored: bool = False,
    promise: Promise = _NOTHING,
    sensor: Sensor = F1_SENSOR,
    seed: int = 0,
    progress: Progress = silent,
) -> Measured:
    """Measure a die from exposures of a point light behind it.

    Args:
        merged: exposures, cropped about the light.
        panels: of the dies that it may be, by name.
        camera: its lens and its pixel.
        light: what each colour of pixels sees of the light.
        seen_mirrored: whether the lens sees the job's design as in a mirror, by the side of the chrome and its order.
        promise: how wide the job and its mask house say that features are.
        sensor: that takes the photographs by which disagreements are priced.
        seed: of the noise that bands are drawn with.
        progress: told where the work stands.

    Raises:
        SourceError: MF339 if nothing in the picture is like any of the dies.
    """
    taken = taken_of(merged, camera.pixel_um, brightest(merged.planes))
    found = identified(panels, camera, light, taken, progress)
    best = found.best
    _check_like(found.fit.setting, best.die, panels[best.die])
    image = DieImage.of(panels[best.die], best.way_round, camera, light, [each.pixels for each in taken])
    setting = found.fit.setting
    # Noise of the light that is expected: that of what was measured favours what came out dark.
    taken = expecting(image, taken, setting)
    image, fit, width = with_width_and_terms(image, taken, fitted(image, taken, setting, progress), progress)
    fit = with_frames(image, taken, fit)
    if fit.inflation > _UNLIKE and not found.certain:
        raise SourceError(
            "MF339",
            f"the light is like none of the dies {', '.join(panels)}: the best of them leaves residuals of "
            f"{fit.inflation:.1f} standard deviations",
            cure="Check the camera and the light of the job, and that this is a point light behind its plate",
        )
    mirrored = (found.best.way_round >= 4) != seen_mirrored
    bands = mtf_bands(taken, fit, seed)
    width_um = panels[best.die].dot_nm * UM_PER_NM
    drawn = 4 if seen_mirrored else 0
    prices = costs(image, fit.setting, _seen(fit), drawn if found.certain else best.way_round, sensor)
    numbers = _quantities(best, fit, _outside(merged, image, fit.setting), promise, width_um)
    numbers += (*_priced(best, prices), *([] if width is None else [_wide(best, width)]))
    said = verdict(found, fit, bands, prices, promise, width, mirrored=mirrored, width_um=width_um)
    return Measured(merged, taken, found, image, fit, bands, tuple(prices), numbers, said, mirrored)


def _seen(fit: Fit) -> list[str]:
    """Names of the values that are above their errors."""
    values = dict(zip(fit.setting.names, fit.setting.values.tolist(), strict=True))
    return [name for name, error in fit.errors.items() if abs(values[name]) > NORMAL_95 * error]


def _priced(best: Hypothesis, prices: Sequence[Cost]) -> Iterator[Quantity]:
    for each in prices:
        detail = cause(each.of)
        for name, lost, against in (
            ("captured_cost", each.by_design, "against restoring them by the PSF of that die"),
            ("captured_loss", each.for_good, "by the PSF of that die, against a die as drawn restored as drawn"),
        ):
            yield Quantity(name, lost.mean, f"{COST_METHOD}; {against}", lost.half_width, die=best.die, detail=detail)


def _wide(best: Hypothesis, width: LightWidth) -> Quantity:
    told = "Gauss-Newton steps of a Gaussian's variance beside all that the fit holds; 95 % by Fisher's information"
    return Quantity("captured_light_width", width.um, told, NORMAL_95 * width.error_um, die=best.die)


def _check_like(setting: Setting, die: str, panel: Panel) -> None:
    """Refuse a fit that had to bend the die beyond what a writer or a camera does."""
    dot_um = panel.dot_nm * UM_PER_NM
    if abs(setting.bias_um) >= dot_um or abs(setting.scale) >= _STRETCHED:
        raise SourceError(
            "MF339",
            f"the light is like none of the dies: the nearest, {die}, would have features {setting.bias_um:+.1f} um "
            f"wider than drawn, its dots being {dot_um:g} um, and a picture {setting.scale:+.0%} larger",
            cure="Check the camera and the light of the job, and that this is a point light behind its plate",
        )


def light_of(
    colours: tuple[str, ...], camera: Camera, bands: tuple[Band, ...], half_um: float, line_nm: float | None = None
) -> dict[str, Spectrum]:
    """Light that each colour of pixels sees, as lines.

    Args:
        colours, camera, bands, line_nm: as :func:`seen_light`.
        half_um: half the side of the window, for which as many lines stand for a band as its speckles ask for.

    Raises:
        JobError: as :func:`seen_light`.
    """
    seen = seen_light(colours, camera, bands, line_nm)
    return {
        colour: _lines(light, camera, half_um)
        if isinstance(light, Band)
        else line_spectrum([light], name=f"{light:g} nm")
        for colour, light in seen.items()
    }


def seen_light(
    colours: tuple[str, ...], camera: Camera, bands: tuple[Band, ...], line_nm: float | None = None
) -> dict[str, Light]:
    """Light that each colour of pixels sees, a band or a line.

    Args:
        colours: of the pixels, ``R G B`` or ``-``.
        camera: whose lines are red, green and blue where there are no bands.
        bands: of the job's scene, red, green and blue, or the one of a sensor without colours.
        line_nm: of a light of one line, whatever the pixel; None to take the job's.

    Raises:
        JobError: MF105 where the job does not say what these pixels see.
    """
    if line_nm is not None:
        return dict.fromkeys(colours, line_nm)
    known: tuple[Light, ...] = bands or camera.wavelengths_nm
    wanted = ("-",) if colours == ("-",) else ("R", "G", "B")
    if len(known) != len(wanted):
        raise JobError(
            "MF105",
            f"the job has light of {len(known)} colours, and the sensor has {len(wanted)}",
            where="camera.wavelengths",
            cure="State the line of the light, such as --line '530 nm', or the scene's spectrum",
        )
    return {colour: light for colour, light in zip(wanted, known, strict=True) if colour in colours}


def _lines(band: Band, camera: Camera, half_um: float) -> Spectrum:
    low, high = band.range_nm
    middle_um = (low + high) / 2 * UM_PER_NM
    speckle_um = middle_um * camera.focal_um / camera.stop.diameter_um
    moved = half_um * (high - low) * UM_PER_NM / middle_um / speckle_um
    return band.quadrature(max(1, math.ceil(moved / _SPECKLES_PER_PANEL)))


def _outside(merged: Merged, image: DieImage, setting: Setting) -> dict[str, float]:
    """Share of every colour's light beyond the window, as if all of its pixels were of that colour: the pixels of one
    alone hit or miss a peak that is as narrow as a pixel."""
    rows, columns = merged.shape
    pixel_um = image.camera.pixel_um
    x, y = (pixel_um * (np.arange(count, dtype=np.float64) - (count - 1) / 2) for count in (columns, rows))
    whole = image.on([Pixels(colour, np.asarray(x), np.asarray(-y)) for colour in image.light])
    pictures = whole.pictures(replace(setting, x_um=0.0, y_um=0.0))
    return {each.colour: 1 - float(picture.sum()) for each, picture in zip(whole.pixels, pictures, strict=True)}


def _quantities(
    best: Hypothesis, fit: Fit, outside: Mapping[str, float], promise: Promise, width_um: float
) -> tuple[Quantity, ...]:
    half = {name: NORMAL_95 * error for name, error in fit.errors.items()}
    setting, die = fit.setting, best.die
    method = {name: _method(fit, name) for name in setting.names}
    bias = Quantity(
        "captured_cd_bias",
        setting.bias_um,
        method[BIAS],
        half[BIAS],
        limit=promise.tolerance_um(width_um),
        passed=promise.kept(width_um, setting.bias_um, half[BIAS]),
        die=die,
    )
    degrees = math.degrees(setting.turn_rad), method["turn_rad"], math.degrees(half["turn_rad"])
    turn = Quantity("captured_turn", *degrees, die=die)
    scale = Quantity("captured_scale", setting.scale, method["scale"], half["scale"], die=die)
    found = [bias, turn, scale]
    for term, waves in setting.terms:
        told = f"{term}, {TERM_NAMES.get(term, 'Zernike')}"
        name = f"z{term}"
        found.append(Quantity("captured_term", waves, method[name], half[name], die=die, detail=told))
    told = "1 less the sum of the fitted die's picture over all pixels of the window, the light in its middle"
    found += [Quantity("captured_outside", each, told, die=die, detail=colour) for colour, each in outside.items()]
    found.append(
        Quantity(
            "captured_misfit", fit.chi2 / fit.freedom, "squared residuals over variance, mean over pixels", die=die
        )
    )
    return (*found,)


def _method(fit: Fit, name: str) -> str:
    """Method by which a value and its error were found."""
    told = "weighted least squares on the pixels, 95 % by Fisher's information"
    told += " x root of chi² per pixel" if fit.inflation > 1 else ""
    return told + (" and the scatter between exposures" if fit.scatters(name) else "")
