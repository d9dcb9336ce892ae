"""Sentences on a measured die, the most important first."""

from __future__ import annotations

import math
from collections.abc import Sequence

from maskfab.capture.cost import ALL, Cost
from maskfab.capture.die_image import BIAS
from maskfab.capture.fit import Fit
from maskfab.capture.identify import Hypothesis, Identified
from maskfab.capture.light_width import LightWidth
from maskfab.capture.mtf_band import MtfBand
from maskfab.capture.promise import Promise
from maskfab.capture.stands import STANDS, stand_words
from maskfab.optics.wavefront.aberration import NOLL

NORMAL_95 = 1.959964
TERM_NAMES = {number: name.replace("_", " ") for name, number in NOLL.items()}
_CAUSES = {BIAS: "CD bias", "scale": "scale", "turn_rad": "turn"}


def stands(each: Hypothesis) -> str:
    """The stand of a die, in words."""
    return stand_words(each.way_round)


def verdict(
    found: Identified,
    fit: Fit,
    bands: tuple[MtfBand, ...],
    costs: Sequence[Cost],
    promise: Promise,
    width: LightWidth | None,
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
        width: of the light, where it is no point.
        mirrored: whether the plate stands the other way round than the job says.
        width_um: of the die's narrowest features.
    """
    best = found.best
    said = []
    if found.certain:
        over = ": turn the plate over" if mirrored else ""
        said.append(f"This is die {best.die}, {stands(best)}{over}.")
    else:
        others = " or ".join(f"{each.die}, {stands(each)}" for each in (best, *found.rivals[:3]))
        said.append(f"Cannot tell which die this is: {others}.")
    said.append(
        "Whether it is turned by 180 degrees beyond that cannot be told: the picture of a mask in focus is point-"
        "symmetric, and out of focus that of the other side."
    )
    said += [_told_width(fit, promise, width_um), _told_mtf(bands), _told_lens(fit), *_told_costs(costs)]
    if width is not None:
        said.append(
            f"The light is no point: on the sensor it is {width.um:.2f} ± {NORMAL_95 * width.error_um:.2f} um wide "
            "(full width at half maximum of a Gaussian), or the pixels spread what they take. The fit allows for it; a "
            "smaller pinhole, or one farther away, tells more."
        )
    if fit.inflation**2 > 1 + 4 * math.sqrt(2 / fit.freedom):
        said.append(
            f"The model leaves residuals of {fit.inflation:.2f} standard deviations of the noise: something is not in "
            "it, such as another light, dust or a light that is wider than a point. Errors are enlarged by as much."
        )
    said.append(
        "Scale is that of pitch x pixel / (wavelength x focal length): one die tells "
        f"{fit.setting.scale:+.2e}, and not which of them is off."
    )
    if found.certain and (mirrored or best.way_round % 2):
        named = next(name for name, way in STANDS.items() if way == best.way_round)
        said.append(f"As it stands, photographs and edges are held against it with --stands {named}.")
    return tuple(said)


def _told_width(fit: Fit, promise: Promise, width_um: float) -> str:
    """The CD bias beside what the job states, and what the house promises."""
    bias, half = fit.setting.bias_um, NORMAL_95 * fit.errors[BIAS]
    off = bias - promise.bias_um
    seen = f"off by {off:+.3f} um." if abs(off) > half else "no difference is seen."
    told = f"CD {bias:+.3f} ± {half:.3f} um, where the job states {promise.bias_um:+.3f} um: {seen}"
    return f"{told} {promise.told(width_um, bias, half)}"


def _told_costs(costs: Sequence[Cost]) -> list[str]:
    """Loss of restoring by the design, where it is more than its error."""
    whole = next(each.by_design for each in costs if each.of == ALL)
    if whole.tie or whole.mean < 0:
        return []
    worst = max(costs, key=lambda each: (each.of != ALL, each.by_design.mean))
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


def _told_mtf(bands: tuple[MtfBand, ...]) -> str:
    """Frequencies up to which the captured MTF is that of the fitted die, of the colour that parts first."""
    parted = {band.colour: band.parted_per_mm for band in bands if band.parted_per_mm is not None}
    if not parted:
        most = min(float(band.frequencies[-1]) for band in bands)
        return f"MTF as designed up to {most:.0f} cycles per mm, the most that the pixels of a colour tell."
    colour, first = min(parted.items(), key=lambda each: each[1])
    seen = "" if colour == "-" else f", where {colour} pixels part from it first"
    return f"MTF as designed up to {first:.0f} cycles per mm{seen}."


def _told_lens(fit: Fit) -> str:
    """Errors of the lens that are above their own error bars."""
    half = {term: NORMAL_95 * fit.errors[f"z{term}"] for term, _ in fit.setting.terms}
    seen = [
        f"{TERM_NAMES.get(term, f'Zernike {term}')} {waves:+.4f} ± {half[term]:.4f}"
        for term, waves in fit.setting.terms
        if abs(waves) > half[term]
    ]
    sought = f"of {len(half)} Zernike terms" if len(half) > 1 else "of defocus"
    return f"Lens, in waves, {sought}: {', '.join(seen) if seen else 'none above its error'}."
