"""A capture and all that it tells of the plate: which die, the verdict on it, its numbers, and the PSF to restore by.

The PSF of the fitted die is written as well: what a capture tells of die and lens, without its noise and beyond its
window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from maskfab.base import __version__
from maskfab.base.arrays import Floats, Mask
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import Panel, Quantity
from maskfab.base.units import UM_PER_NM
from maskfab.base.work import Progress, silent
from maskfab.camera.blur import HOLDS
from maskfab.camera.frames.merge import Merged, check_centre
from maskfab.camera.inspection.bench import STOP
from maskfab.camera.inspection.bench_words import bench_quantities
from maskfab.camera.inspection.causes import Explanation, explained, holds_most
from maskfab.camera.inspection.costs import COST_METHOD, TERM_NAMES, Cost, costs, disagreement
from maskfab.camera.inspection.diagnosis import NAMED, Cause, Suspect
from maskfab.camera.inspection.die_image import BIAS, LAMP, DieImage, Pixels, Setting
from maskfab.camera.inspection.die_verdict import (
    SURE,
    Answer,
    Promise,
    Verdict,
    finding_sentences,
    judged_die,
    seen_sentences,
)
from maskfab.camera.inspection.edge_mtf import Light
from maskfab.camera.inspection.fit import (
    Fit,
    MtfBand,
    Taken,
    brightest,
    colours_of,
    expecting,
    judged,
    mtf_bands,
    taken_of,
)
from maskfab.camera.inspection.identity import Hypothesis, Identified, identified
from maskfab.camera.scores import NORMAL_95
from maskfab.camera.sensor import F1_SENSOR
from maskfab.job.camera import Camera, Sensor
from maskfab.mask.formats.exr import Fact, write_channels
from maskfab.optics.spectrum import Band, Spectrum, line_spectrum

_SPECKLES_PER_PANEL = 3.0
_UNLIKE = 3.0
"""Root of chi² per pixel from which a fit is held to be none: the light, the camera or the die is another."""
_NOTHING = Promise()
_CHECK = "Check the camera and the light of the job, and that this is a point light behind its plate"
_STRETCHED = 0.1
"""Change of scale, or of the stop, from which camera or light are others than the job's."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A capture and what it tells of the plate.

    Attributes:
        taken: their pixels about the light, with the noise that the fit expects.
        drifts: light of each exposure over what its time says, in that of the longest.
        fit: of it, with as many of the lens's errors as the residuals ask for.
        costs: of what is not as drawn; none where nothing can be told.
        if_numbers: numbers of the die and the lens where no verdict is; told beside a fault that was fitted, or of the
            likeliest die, or too wide to decide; none where the frames are not explained.
        holds: whether the frames are explained, with the fault that the verdict names if there is one.
        mirrored: whether the plate stands the other way round than the job says.
    """

    merged: Merged
    taken: tuple[Taken, ...]
    drifts: tuple[float, ...]
    identified: Identified
    image: DieImage
    fit: Fit
    bands: tuple[MtfBand, ...]
    costs: tuple[Cost, ...]
    verdict: Verdict
    explained: Explanation
    quantities: tuple[Quantity, ...]
    sentences: tuple[str, ...]
    if_numbers: tuple[Quantity, ...]
    if_sentences: tuple[str, ...]
    holds: bool
    mirrored: bool

    @property
    def suspects(self) -> tuple[Suspect, ...]:
        """Faults that are more than chance, the likeliest first, where nothing can be told of the die."""
        every = self.explained.suspects if self.verdict.answer is Answer.CANNOT_TELL else ()
        return tuple(each for each in every if each.gain >= NAMED)

    @property
    def if_words(self) -> str:
        """Sentence that heads the numbers of a die of which nothing is decided."""
        if self.explained.mended:
            return f"With {self.verdict.cause} fitted beside all else, though one value may not be all of it:"
        return "Told of the likeliest die, but not decided:"


def measured(
    merged: Merged,
    panels: Mapping[str, Panel],
    camera: Camera,
    light: Mapping[str, Spectrum],
    *,
    seen_mirrored: bool = False,
    promise: Promise = _NOTHING,
    others: Mapping[str, Panel] | None = None,
    sensor: Sensor = F1_SENSOR,
    priced: bool = True,
    seed: int = 0,
    progress: Progress = silent,
) -> Measured:
    """Measure a die from exposures of a point light behind it.

    Args:
        seen_mirrored: whether the lens sees the job's design as in a mirror, by the side of the chrome and its order.
        others: further dies of the plate, one of which it may be where none of the first explains the frames.

    Raises:
        SourceError: MF334 if the light's centre is full in every exposure; MF339 if nothing in the picture is like any
            of the dies.
    """
    others = {name: panel for name, panel in (others or {}).items() if name not in panels}
    identity, told = _explained(merged, panels, camera, light, others, progress)
    best, fit = identity.best, told.fit
    mirrored = (best.way_round >= 4) != seen_mirrored
    width_um = panels[best.die].dot_nm * UM_PER_NM
    cause = _cause(merged, told, {best.die: panels[best.die]}, others, progress)
    verdict = judged_die(identity, told, promise, cause=cause, mirrored=mirrored, width_um=width_um)
    findings = verdict.answer is not Answer.CANNOT_TELL
    prices = _prices(told, 4 if seen_mirrored else 0, sensor) if findings and priced else []
    # Of frames that are not explained no number is told: nothing says how far it may be off.
    holds = cause is None or (told.mended and cause is told.cause)
    of_die = (*_quantities(best, fit, promise, width_um, decided=findings), *_priced(best, prices)) if holds else ()
    outside = _outside(merged, told.image, fit.setting) if holds else {}
    seen_numbers = tuple(_seen_quantities(best, told, outside, holds=holds))
    drifts = _drifts(merged, told.taken)
    apart = max(abs(drift - 1) for drift in drifts)
    sentences = seen_sentences(identity, told, mirrored=mirrored, drift=apart, holds=holds)
    of_fit = finding_sentences(told, prices, promise, camera.wavelengths_nm[0]) if holds else ()
    return Measured(
        merged=merged,
        taken=told.taken,
        drifts=drifts,
        identified=identity,
        image=told.image,
        fit=fit,
        bands=mtf_bands(told.taken, fit, seed),
        costs=tuple(prices),
        verdict=verdict,
        explained=told,
        quantities=(*of_die, *seen_numbers) if findings else seen_numbers,
        sentences=(*of_fit, *sentences) if findings else sentences,
        if_numbers=() if findings else of_die,
        if_sentences=() if findings else of_fit,
        holds=holds,
        mirrored=mirrored,
    )


def _explained(
    merged: Merged,
    panels: Mapping[str, Panel],
    camera: Camera,
    light: Mapping[str, Spectrum],
    others: Mapping[str, Panel],
    progress: Progress,
) -> tuple[Identified, Explanation]:
    """The die, and the frames as far as it explains them. Raises SourceError MF334 and MF339 as :func:`measured`."""
    check_centre(merged)
    taken = taken_of(merged, camera.pixel_um, brightest(merged.planes))
    identity = identified(panels, camera, light, taken, progress)
    setting, panel = identity.fit.setting, panels[identity.best.die]
    # Bent beyond what a writer or a camera does.
    stop = 1 + dict(setting.bench).get(STOP, 0.0) / camera.stop.diameter_um
    if abs(setting.bias_um) >= panel.dot_nm * UM_PER_NM or max(abs(setting.scale), abs(stop - 1)) >= _STRETCHED:
        there = _other_die({identity.best.die: panel}, others, camera, light, taken, progress)
        raise _none(setting, identity.best.die, panel, stop, there)
    image = DieImage.of(panel, identity.best.way_round, camera, light, [capture.pixels for capture in taken])
    # Noise of the light that is expected: that of what was measured favours what came out dark.
    taken = expecting(image, taken, setting)
    # The die was told by one colour; light and background of the others are solved for where that one lies.
    first = identity.fit if len(colours_of(taken)) == 1 else judged(taken, image.pictures(setting), setting)
    told = explained(image, taken, first, progress, electrons_per_count=merged.electrons_per_count)
    unlike = told.factor > _UNLIKE and not told.mended
    there = _other_die({identity.best.die: panel}, others, camera, light, taken, progress) if unlike else None
    if there is not None or (unlike and not identity.certain):
        what = (
            f"the light is like none of the dies {', '.join(panels)}: the best of them leaves residuals of "
            f"{told.factor:.1f} standard deviations"
        )
        raise SourceError("MF339", what, cure=_cure(there))
    return identity, told


def _prices(told: Explanation, drawn_way_round: int, sensor: Sensor) -> list[Cost]:
    """Costs of what is above its error."""
    fit = told.fit
    values = dict(zip(fit.setting.names, fit.setting.values.tolist(), strict=True))
    bench = {*LAMP, *dict(fit.setting.bench)}
    seen = [name for name, error in fit.errors.items() if name not in bench and abs(values[name]) > NORMAL_95 * error]
    return costs(told.image, fit.setting.of_a_point, seen, drawn_way_round, sensor)


_SPILT_PX = 3
_OFF_SCALE = 2e-3
_MOST_DISAGREEING = 0.01
"""Share of pixels at which exposures may disagree, as hits and hot pixels make them."""
_TOP, _PILED_UP = 0.97, 4


def _drifts(merged: Merged, taken: Sequence[Taken]) -> tuple[float, ...]:
    plane = taken[0].plane
    assert plane is not None  # of merged exposures
    times = np.array([1.0 if used.exposure_s is None else used.exposure_s for used in merged.used])
    drifts = plane.scales / times
    return tuple((drifts / drifts[int(times.argmax())]).tolist())


def _cause(
    merged: Merged,
    told: Explanation,
    asked: Mapping[str, Panel],
    others: Mapping[str, Panel],
    progress: Progress,
) -> Cause | None:
    """The cause of what an explanation leaves; more of them than the fit itself knows."""
    if len(merged.disagreeing) > _MOST_DISAGREEING * math.prod(merged.shape):
        return Cause.DRIFT
    if told.cause is not Cause.UNKNOWN:
        return told.cause
    fit, camera = told.fit, told.image.camera
    if _other_die(asked, others, camera, told.image.light, told.taken, progress):
        return Cause.DIE
    spilt = _spilt(merged, told.taken)
    if holds_most(fit, spilt) or _flat_topped(told):
        return Cause.SATURATION
    scale = abs(fit.setting.scale)
    return Cause.SETTING if scale > max(_OFF_SCALE, SURE * fit.errors["scale"]) else Cause.UNKNOWN


def _flat_topped(told: Explanation) -> bool:
    """Whether the brightest pixels are alike, and far below what the fit expects: full below the stated white."""
    for capture, predicted, residual in zip(told.taken, told.fit.predicted, told.fit.residuals, strict=True):
        top = capture.valid & (capture.light > _TOP * capture.light.max())
        if top.sum() >= _PILED_UP and (residual[top] < -SURE).mean() >= 0.5 and predicted.max() > capture.light.max():
            return True
    return False


def _other_die(
    asked: Mapping[str, Panel],
    others: Mapping[str, Panel],
    camera: Camera,
    light: Mapping[str, Spectrum],
    taken: Sequence[Taken],
    progress: Progress,
) -> str | None:
    """Another die of the plate that explains the frames far better than the one that was asked for."""
    if not others:
        return None
    found = identified({**asked, **others}, camera, light, taken, progress)
    return found.best.die if found.certain and found.best.die not in asked else None


def _spilt(merged: Merged, taken: Sequence[Taken]) -> list[Mask]:
    """Pixels of every grid that lie near one that is full in any exposure, along its column above all."""
    masks = []
    for plane, capture in zip(merged.planes, taken, strict=True):
        full = (~plane.exposed.usable).any(axis=0)
        near = ndimage.binary_dilation(full, np.ones((2 * _SPILT_PX + 1, 3)))
        masks.append(np.asarray(near & capture.valid))
    return masks


def _priced(best: Hypothesis, prices: Sequence[Cost]) -> Iterator[Quantity]:
    for price in prices:
        detail = disagreement(price.of)
        for name, lost, against in (
            ("captured_cost", price.by_design, "against restoring them by the PSF of that die"),
            ("captured_loss", price.for_good, "by the PSF of that die, against a die as drawn restored as drawn"),
        ):
            yield Quantity(name, lost.mean, f"{COST_METHOD}; {against}", lost.half_width, die=best.die, detail=detail)


def _none(setting: Setting, die: str, panel: Panel, stop: float, there: str | None) -> SourceError:
    what = (
        f"the light is like none of the dies: the nearest, {die}, would have features {setting.bias_um:+.1f} um "
        f"wider than drawn, its dots being {panel.dot_nm * UM_PER_NM:g} um, a picture {setting.scale:+.0%} larger, and "
        f"a stop {stop:.0%} as wide"
    )
    return SourceError("MF339", what, cure=_cure(there))


def _cure(there: str | None) -> str:
    return _CHECK if there is None else f"This is die {there}: name it (--die {there})"


def light_of(
    colours: tuple[str, ...], camera: Camera, bands: tuple[Band, ...], half_um: float, line_nm: float | None = None
) -> dict[str, Spectrum]:
    """Light that each colour of pixels sees, as lines."""
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
    return {colour: 1 - float(picture.sum()) for colour, picture in _of_a_point(image, setting, rows, columns).items()}


def _of_a_point(image: DieImage, setting: Setting, rows: int, columns: int) -> dict[str, Floats]:
    """Pictures of a point in the middle of so many pixels, of each colour as if all were its; row 0 the top."""
    pixel_um = image.camera.pixel_um
    x, y = (pixel_um * (np.arange(count, dtype=np.float64) - (count - 1) / 2) for count in (columns, rows))
    whole = image.on([Pixels(colour, np.asarray(x), np.asarray(-y)) for colour in image.light])
    pictures = whole.pictures(replace(setting.of_a_point, x_um=0.0, y_um=0.0))
    return {grid.colour: picture for grid, picture in zip(whole.pixels, pictures, strict=True)}


def _quantities(best: Hypothesis, fit: Fit, promise: Promise, width_um: float, *, decided: bool) -> Iterator[Quantity]:
    """Numbers of the die and its lens; held against a tolerance where the verdict was decided by it."""
    half = {name: NORMAL_95 * error for name, error in fit.errors.items()}
    setting, die = fit.setting, best.die
    method = {name: _method(fit, name) for name in setting.names}
    limit = promise.tolerance_um(width_um)
    judged = decided and limit is not None
    kept = promise.kept(width_um, setting.bias_um, SURE * fit.errors[BIAS]) if judged else None
    bias = setting.bias_um, method[BIAS], half[BIAS]
    yield Quantity("captured_cd_bias", *bias, limit=limit, passed=kept, die=die)
    degrees = math.degrees(setting.turn_rad), method["turn_rad"], math.degrees(half["turn_rad"])
    yield Quantity("captured_turn", *degrees, die=die)
    yield Quantity("captured_scale", setting.scale, method["scale"], half["scale"], die=die)
    for term, waves in setting.terms:
        detail = f"{term}, {TERM_NAMES[term]}" if term in TERM_NAMES else str(term)
        name = f"z{term}"
        yield Quantity("captured_term", waves, method[name], half[name], die=die, detail=detail)


def _seen_quantities(
    best: Hypothesis, told: Explanation, outside: Mapping[str, float], *, holds: bool
) -> Iterator[Quantity]:
    fit, die = told.fit, best.die
    if holds:
        yield from bench_quantities(told, die)
    how = "1 less the sum of the fitted die's picture over all pixels of the window, the light in its middle"
    for colour, share in outside.items():
        yield Quantity("captured_outside", share, how, die=die, detail="all" if colour == "-" else colour)
    how = "squared residuals over variance, mean over pixels"
    yield Quantity("captured_misfit", fit.chi2 / fit.freedom, how, die=die)


def _method(fit: Fit, name: str) -> str:
    method = "weighted least squares on the pixels, 95 % by Fisher's information"
    method += " x root of chi² per pixel" if fit.inflation > 1 else ""
    return method + (" and the scatter between exposures" if fit.scatters(name) else "")


SIDE = 601
"""Pixels along a side of the PSF that is written, the light in the middle one."""


def write_fitted_psf(image: DieImage, setting: Setting, die: str, path: Path) -> None:
    """Write the PSF as EXR, channels R, G and B, or Y of a sensor without colours; shares of the light as float32.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    psf = _of_a_point(image, setting, SIDE, SIDE)
    names = tuple("RGB" if len(psf) > 1 else "Y")
    pixels = np.stack([psf[name if len(psf) > 1 else next(iter(psf))] for name in names], axis=2).astype(np.float32)
    facts: dict[str, Fact] = {
        "maskfab_version": __version__,
        "holds": HOLDS,
        "unit": "share of the light in a pixel",
        "axes": "the first row of pixels is the uppermost of the sensor, the light in the middle pixel",
        "sensor_pixel_um": image.camera.pixel_um,
        "die": die,
    }
    write_channels(pixels, names, path, facts, f"maskfab {__version__}")
