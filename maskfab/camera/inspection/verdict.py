"""A die as a camera saw it beside the die as designed: which it is, how it stands, how it was written, what that costs.

Each disagreement is priced in restored photographs, alone and all together. Photographs of drawn scenes are taken
through the die as it was fitted and restored by the Wiener filter, once by the PSF of the die as drawn and once by its
own; the difference is what nobody loses who restores by the fitted PSF. What is left against a die as drawn, restored
by its own, is lost for good (or won: a wider opening has more light).

Widths are held against what the job's mask house promises. The PSF of the fitted die is written: what a capture tells
of die and lens, without the capture's noise and beyond its window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from maskfab.base import __version__
from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import Panel, Quantity
from maskfab.base.units import UM_PER_NM, decimals_of
from maskfab.base.work import Progress, silent
from maskfab.camera.blur import HOLDS, STANDS, MeasuredBlur, stand_words
from maskfab.camera.frames.merge import Merged
from maskfab.camera.imaging import Isoplanatic, RestoredBy, Transfer
from maskfab.camera.inspection.die_image import BIAS, DieImage, Pixels, Setting
from maskfab.camera.inspection.edge_mtf import Light
from maskfab.camera.inspection.fit import (
    Fit,
    MtfBand,
    Taken,
    brightest,
    expecting,
    fitted,
    mtf_bands,
    taken_of,
    with_frames,
)
from maskfab.camera.inspection.identity import Hypothesis, Identified, identified, with_width_and_terms
from maskfab.camera.protocol import STRENGTHS, Protocol, evaluate
from maskfab.camera.scenes import NARROW, SMALLEST, Photograph, dead_leaves
from maskfab.camera.scores import NORMAL_95, MeanDifference, Score
from maskfab.camera.sensor import F1_SENSOR, Exposure
from maskfab.job.camera import Camera, Sensor
from maskfab.job.shop import Shop
from maskfab.mask.formats.exr import Fact, write_channels
from maskfab.optics.phase import NOLL
from maskfab.optics.spectrum import Band, Spectrum, line_spectrum


@dataclass(frozen=True)
class Promise:
    """Of the job and of the house that it names.

    Attributes:
        bias_um: by which clear features are wider than drawn, as [process] of the job states it.
        shop: the house; None where the job names none.
    """

    bias_um: float = 0.0
    shop: Shop | None = None

    def tolerance_um(self, width_um: float) -> float | None:
        """Largest deviation from the drawn width that the house promises; None where nobody promises any."""
        return None if self.shop is None else self.shop.tolerance.of_width(width_um)

    def kept(self, width_um: float, bias_um: float, half_um: float) -> bool | None:
        """Whether a bias with its interval lies within the promise; None where it may lie on either side, or none is.

        Args:
            width_um: of the narrowest features, for which the promise is strictest.
            bias_um: as it was measured.
            half_um: half of its interval.
        """
        most = self.tolerance_um(width_um)
        if most is None or abs(abs(bias_um) - most) < half_um:
            return None
        return abs(bias_um) < most

    def account(self, width_um: float, bias_um: float, half_um: float) -> str:
        """A sentence on whether a measured bias is within the promise.

        Args:
            width_um, bias_um, half_um: as of :meth:`kept`.
        """
        if self.shop is None:
            return "The job names no mask house ([export] shop) whose tolerance it could be held against."
        most = self.tolerance_um(width_um)
        if most is None:
            return f"{self.shop.title} publishes no CD tolerance that it could be held against."
        promised = f"the ±{most:g} um that {self.shop.title} promises of features of {width_um:g} um"
        within = self.kept(width_um, bias_um, half_um)
        if within is None:
            return f"Whether that is within {promised} cannot be told: the interval holds the limit."
        return f"That is within {promised}." if within else f"That is beyond {promised}."


LEVEL_DB = 40.0
"""Signal-to-noise ratio of white behind the published display, where a full well allows it."""
COST_METHOD = (
    "photographs of 4 drawn scenes in linear light, white at 40 dB behind the published display or as near as a full "
    "well allows, through the die with this alone beside the drawn, in one line of light for each colour, restored by "
    "the Wiener filter at the strength that is best for the die as drawn; PSNR without 64 pixels at each edge; error: "
    "half the 95 % interval of the mean over the scenes by Student's t; not in it: the errors of what was fitted"
)
ALL, ORIENTATION = "all together", "way round"
_SIDE = 2 * NARROW + 1
_SCENES = (1, 2, 3, 4)
_COLOURS = 3
_FULL = 0.99


@dataclass(frozen=True)
class Cost:
    """Price of one disagreement, in dB of restored photographs.

    Attributes:
        of: the disagreement: a name of :attr:`Setting.names`, :data:`ORIENTATION` or :data:`ALL`.
        by_design: lost by restoring as drawn what was taken through the die as it is, against restoring it by its own.
        for_good: lost although it is restored by its own, against a die as drawn that is restored as drawn.
    """

    of: str
    by_design: MeanDifference
    for_good: MeanDifference


@dataclass(frozen=True, eq=False)
class _Seen(Isoplanatic):
    """A die of one setting, as photographs are taken through it."""

    blur: MeasuredBlur
    share: float

    @property
    def transmission(self) -> float:
        """See :class:`maskfab.camera.imaging.Design`."""
        return self.share

    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        return self.blur.on(shape)


def costs(image: DieImage, setting: Setting, seen: Sequence[str], drawn_way_round: int, sensor: Sensor) -> list[Cost]:
    """Costs of every disagreement between a die as fitted and as drawn, and of all together.

    Args:
        image: of the die, the way round that it stands.
        setting: that was fitted.
        seen: names of the setting's values that are above their errors; place and those below cost nothing alone.
        drawn_way_round: element of D4 by which the die would stand if it were as the job says.
        sensor: that takes the photographs.
    """
    centred = replace(setting, x_um=0.0, y_um=0.0)
    alone = [(name, _only(centred, name), drawn_way_round) for name in seen if not name.endswith("_um") or name == BIAS]
    if image.way_round != drawn_way_round:
        alone.append((ORIENTATION, Setting(), image.way_round))
    parts = [*alone, (ALL, centred, image.way_round)]
    # The die, one way round or another, in one line of light for each colour.
    axis = image.camera.pixel_um * (np.arange(_SIDE, dtype=np.float64) - _SIDE // 2)
    light = {
        colour: line_spectrum([float(lines.weights @ lines.wavelengths_nm)]) for colour, lines in image.light.items()
    }
    pixels = tuple(Pixels(colour, axis, -axis) for colour in light)
    ways = {image.way_round, drawn_way_round}
    standing = {way: DieImage.of(image.panel, way, image.camera, light, pixels) for way in ways}

    def window_light(pictures: Sequence[Floats]) -> float:
        return float(np.mean([picture.sum() for picture in pictures]))

    window_share = window_light(standing[image.way_round].pictures(Setting()))

    def standing_at(name: str, way_round: int, setting: Setting) -> _Seen:
        pictures = standing[way_round].pictures(setting)
        # Pictures are in units of the light of a die as drawn; a wider one has more.
        share = min(1.0, standing[way_round].transmission * window_light(pictures) / window_share)
        kernels = np.stack([picture / picture.sum() for picture in pictures])
        whole = np.broadcast_to(kernels, (_COLOURS, _SIDE, _SIDE)) if len(kernels) == 1 else kernels
        middle = float(_SIDE // 2)
        return _Seen(name, MeasuredBlur(whole, (middle, middle), ()), share)

    level_db = min(LEVEL_DB, Exposure.of_white(_FULL * sensor.ceiling, sensor).level_db)

    def scores(die: _Seen, restored_by: _Seen, strengths: Sequence[tuple[float, ...]]) -> list[Score]:
        """Score of every scene, restored by the blur of another die at the best of some strengths."""
        design, results = RestoredBy(die, restored_by), list[Score]()
        for scene, epsilons in zip(_scenes(), strengths, strict=True):
            protocol = Protocol("camera", sensor, strengths=epsilons)
            results += evaluate([design], [scene], [scene], [level_db], protocol=protocol, details=False).scores
        return results

    def lost(before: Sequence[Score], after: Sequence[Score]) -> MeanDifference:
        pairs = zip(before, after, strict=True)
        return MeanDifference.of([one.psnr_inner - other.psnr_inner for one, other in pairs])

    drawn = standing_at("drawn", drawn_way_round, Setting())
    right = scores(drawn, drawn, [STRENGTHS] * len(_scenes()))
    best = [(score.epsilon,) for score in right]
    prices = []
    for name, at, way in parts:
        die = standing_at(name, way, at)
        own = scores(die, die, best)
        prices.append(Cost(name, lost(own, scores(die, drawn, best)), lost(right, own)))
    return prices


def _only(setting: Setting, name: str) -> Setting:
    """A die as drawn but for one value of a setting."""
    terms = tuple(term for term in setting.terms if f"z{term[0]}" == name)
    return Setting(terms=terms) if terms else replace(Setting(), **{name: getattr(setting, name)})


@cache
def _scenes() -> tuple[Photograph, ...]:
    """Scenes in full light, of the least size: those indoors lose less, for they have less to lose."""
    return tuple(replace(dead_leaves(number, SMALLEST, SMALLEST), around=NARROW) for number in _SCENES)


TERM_NAMES = {number: name.replace("_", " ") for name, number in NOLL.items()}
_CAUSES = {BIAS: "CD bias", "scale": "scale", "turn_rad": "turn"}


def stands(hypothesis: Hypothesis) -> str:
    """The stand of a die, in words."""
    return stand_words(hypothesis.way_round)


def verdict(
    found: Identified,
    fit: Fit,
    bands: tuple[MtfBand, ...],
    costs: Sequence[Cost],
    promise: Promise,
    width: tuple[float, float] | None,
    *,
    mirrored: bool,
    width_um: float,
) -> tuple[str, ...]:
    """Sentences on a capture.

    Args:
        found: the die.
        fit: of it.
        bands: its MTF.
        costs: of what is not as drawn.
        promise: of the job and its mask house.
        width: of the light and its standard error, um, where it is no point.
        mirrored: whether the plate stands the other way round than the job says.
        width_um: of the die's narrowest features.
    """
    best = found.best
    sentences = []
    if found.certain:
        over = ": turn the plate over" if mirrored else ""
        sentences.append(f"This is die {best.die}, {stands(best)}{over}.")
    else:
        others = " or ".join(f"{hypothesis.die}, {stands(hypothesis)}" for hypothesis in (best, *found.rivals[:3]))
        sentences.append(f"Cannot tell which die this is: {others}.")
    sentences.append(
        "Whether it is turned by 180 degrees beyond that cannot be told: the picture of a mask in focus is point-"
        "symmetric, and out of focus that of the other side."
    )
    sentences += [
        _width_sentence(fit, promise, width_um),
        _mtf_sentence(bands),
        _lens_sentence(fit),
        *_cost_sentences(costs),
    ]
    if width is not None:
        sentences.append(
            f"The light is no point: on the sensor it is {width[0]:.2f} ± {NORMAL_95 * width[1]:.2f} um wide "
            "(full width at half maximum of a Gaussian), or the pixels spread what they take. The fit allows for it; a "
            "smaller pinhole, or one farther away, tells more."
        )
    if fit.inflation**2 > 1 + 4 * math.sqrt(2 / fit.freedom):
        sentences.append(
            f"The model leaves residuals of {fit.inflation:.2f} standard deviations of the noise: something is not in "
            "it, such as another light, dust or a light that is wider than a point. Errors are enlarged by as much."
        )
    sentences.append(
        "Scale is that of pitch x pixel / (wavelength x focal length): one die tells "
        f"{fit.setting.scale:+.2e}, and not which of them is off."
    )
    if found.certain and (mirrored or best.way_round % 2):
        named = next(name for name, way in STANDS.items() if way == best.way_round)
        sentences.append(f"As it stands, photographs and edges are held against it with --stands {named}.")
    return tuple(sentences)


def _width_sentence(fit: Fit, promise: Promise, width_um: float) -> str:
    """The CD bias beside what the job states, and what the house promises."""
    bias, half = fit.setting.bias_um, NORMAL_95 * fit.errors[BIAS]
    off = bias - promise.bias_um
    seen = f"off by {off:+.3f} um." if abs(off) > half else "no difference is seen."
    measured = f"CD {bias:+.3f} ± {half:.3f} um, where the job states {promise.bias_um:+.3f} um: {seen}"
    return f"{measured} {promise.account(width_um, bias, half)}"


def _cost_sentences(costs: Sequence[Cost]) -> list[str]:
    """Loss of restoring by the design, where it is more than its error."""
    whole = next(cost.by_design for cost in costs if cost.of == ALL)
    if whole.tie or whole.mean < 0:
        return []
    worst = max(costs, key=lambda cost: (cost.of != ALL, cost.by_design.mean))
    most = "" if worst.of == ALL else f", most of it by {cause(worst.of)}"
    return [f"Photographs that are restored as if the die were as drawn lose {whole.told()} of PSNR{most}."]


def cause(name: str) -> str:
    """A disagreement in words.

    Args:
        name: of a cost.
    """
    if name in _CAUSES or not name.startswith("z"):
        return _CAUSES.get(name, name)
    return TERM_NAMES.get(int(name[1:]), f"Zernike {name[1:]}")


def _mtf_sentence(bands: tuple[MtfBand, ...]) -> str:
    """Frequencies up to which the captured MTF is that of the fitted die, of the colour that parts first."""
    parted = {band.colour: band.parted_per_mm for band in bands if band.parted_per_mm is not None}
    if not parted:
        most = min(float(band.frequencies[-1]) for band in bands)
        return f"MTF as designed up to {most:.0f} cycles per mm, the most that the pixels of a colour tell."
    colour, first = min(parted.items(), key=lambda pair: pair[1])
    seen = "" if colour == "-" else f", where {colour} pixels part from it first"
    return f"MTF as designed up to {first:.0f} cycles per mm{seen}."


def _lens_sentence(fit: Fit) -> str:
    """Errors of the lens that are above their own error bars."""
    half = {term: NORMAL_95 * fit.errors[f"z{term}"] for term, _ in fit.setting.terms}
    seen = [
        f"{TERM_NAMES.get(term, f'Zernike {term}')} {_by_error(waves, half[term])}"
        for term, waves in fit.setting.terms
        if abs(waves) > half[term]
    ]
    sought = f"of {len(half)} Zernike terms" if len(half) > 1 else "of defocus"
    return f"Lens, in waves, {sought}: {', '.join(seen) if seen else 'none above its error'}."


def _by_error(value: float, error: float) -> str:
    """A number with its sign and its error, to the decimals that this allows, four at most."""
    decimals = max(0, min(4, decimals_of(error))) if error else 4
    return f"{value:+.{decimals}f} ± {error:.{decimals}f}"


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
    identity = identified(panels, camera, light, taken, progress)
    best = identity.best
    _check_like(identity.fit.setting, best.die, panels[best.die])
    image = DieImage.of(panels[best.die], best.way_round, camera, light, [capture.pixels for capture in taken])
    setting = identity.fit.setting
    # Noise of the light that is expected: that of what was measured favours what came out dark.
    taken = expecting(image, taken, setting)
    image, fit, width = with_width_and_terms(image, taken, fitted(image, taken, setting, progress), progress)
    fit = with_frames(image, taken, fit)
    if fit.inflation > _UNLIKE and not identity.certain:
        what = (
            f"the light is like none of the dies {', '.join(panels)}: the best of them leaves residuals of "
            f"{fit.inflation:.1f} standard deviations"
        )
        cure = "Check the camera and the light of the job, and that this is a point light behind its plate"
        raise SourceError("MF339", what, cure=cure)
    mirrored = (identity.best.way_round >= 4) != seen_mirrored
    bands = mtf_bands(taken, fit, seed)
    width_um = panels[best.die].dot_nm * UM_PER_NM
    drawn = 4 if seen_mirrored else 0
    values = dict(zip(fit.setting.names, fit.setting.values.tolist(), strict=True))
    seen = [name for name, error in fit.errors.items() if abs(values[name]) > NORMAL_95 * error]
    prices = costs(image, fit.setting, seen, drawn if identity.certain else best.way_round, sensor)
    numbers = _quantities(best, fit, _outside(merged, image, fit.setting), promise, width_um)
    numbers += (*_priced(best, prices),)
    if width is not None:
        method = (
            "Gauss-Newton steps of a Gaussian's variance beside all that the fit holds; 95 % by Fisher's information"
        )
        numbers += (Quantity("captured_light_width", width[0], method, NORMAL_95 * width[1], die=best.die),)
    sentences = verdict(identity, fit, bands, prices, promise, width, mirrored=mirrored, width_um=width_um)
    return Measured(merged, taken, identity, image, fit, bands, tuple(prices), numbers, sentences, mirrored)


def _priced(best: Hypothesis, prices: Sequence[Cost]) -> Iterator[Quantity]:
    for price in prices:
        detail = cause(price.of)
        for name, lost, against in (
            ("captured_cost", price.by_design, "against restoring them by the PSF of that die"),
            ("captured_loss", price.for_good, "by the PSF of that die, against a die as drawn restored as drawn"),
        ):
            yield Quantity(name, lost.mean, f"{COST_METHOD}; {against}", lost.half_width, die=best.die, detail=detail)


def _check_like(setting: Setting, die: str, panel: Panel) -> None:
    """Refuse a fit that had to bend the die beyond what a writer or a camera does."""
    dot_um = panel.dot_nm * UM_PER_NM
    if abs(setting.bias_um) >= dot_um or abs(setting.scale) >= _STRETCHED:
        what = (
            f"the light is like none of the dies: the nearest, {die}, would have features {setting.bias_um:+.1f} um "
            f"wider than drawn, its dots being {dot_um:g} um, and a picture {setting.scale:+.0%} larger"
        )
        cure = "Check the camera and the light of the job, and that this is a point light behind its plate"
        raise SourceError("MF339", what, cure=cure)


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
    light: tuple[Light, ...] = bands or camera.wavelengths_nm
    wanted = ("-",) if colours == ("-",) else ("R", "G", "B")
    if len(light) != len(wanted):
        what = f"the job has light of {len(light)} colours, and the sensor has {len(wanted)}"
        cure = "State the line of the light, such as --line '530 nm', or the scene's spectrum"
        raise JobError("MF105", what, where="camera.wavelengths", cure=cure)
    return {colour: line for colour, line in zip(wanted, light, strict=True) if colour in colours}


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
    return {grid.colour: 1 - float(picture.sum()) for grid, picture in zip(whole.pixels, pictures, strict=True)}


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
    quantities = [bias, turn, scale]
    for term, waves in setting.terms:
        detail = f"{term}, {TERM_NAMES.get(term, 'Zernike')}"
        name = f"z{term}"
        quantities.append(Quantity("captured_term", waves, method[name], half[name], die=die, detail=detail))
    how = "1 less the sum of the fitted die's picture over all pixels of the window, the light in its middle"
    quantities += [
        Quantity("captured_outside", share, how, die=die, detail=colour) for colour, share in outside.items()
    ]
    how = "squared residuals over variance, mean over pixels"
    return (*quantities, Quantity("captured_misfit", fit.chi2 / fit.freedom, how, die=die))


def _method(fit: Fit, name: str) -> str:
    """Method by which a value and its error were found."""
    method = "weighted least squares on the pixels, 95 % by Fisher's information"
    method += " x root of chi² per pixel" if fit.inflation > 1 else ""
    return method + (" and the scatter between exposures" if fit.scatters(name) else "")


SIDE = 601
"""Pixels along a side of the PSF that is written, the light in the middle one."""


def write_fitted_psf(measured: Measured, path: Path) -> None:
    """Write the PSF as EXR, channels R, G and B, or Y of a sensor without colours; shares of the light as float32.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    # Of each colour as if all pixels were its, row 0 the top.
    axis = measured.image.camera.pixel_um * (np.arange(SIDE, dtype=np.float64) - SIDE // 2)
    wide = measured.image.on([Pixels(colour, axis, -axis) for colour in measured.image.light])
    pictures = wide.pictures(replace(measured.fit.setting, x_um=0.0, y_um=0.0))
    psf = {grid.colour: picture for grid, picture in zip(wide.pixels, pictures, strict=True)}
    names = tuple("RGB" if len(psf) > 1 else "Y")
    pixels = np.stack([psf[name if len(psf) > 1 else next(iter(psf))] for name in names], axis=2).astype(np.float32)
    facts: dict[str, Fact] = {
        "maskfab_version": __version__,
        "holds": HOLDS,
        "unit": "share of the light in a pixel",
        "axes": "the first row of pixels is the uppermost of the sensor, the light in the middle pixel",
        "sensor_pixel_um": measured.image.camera.pixel_um,
        "die": measured.identified.best.die,
    }
    write_channels(pixels, names, path, facts, f"maskfab {__version__}")
