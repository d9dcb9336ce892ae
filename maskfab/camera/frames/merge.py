"""Exposures of one light merged into one, colour by colour, each pixel where it is.

    x = sum of w_k y_k / sum of w_k a_k,       w_k = a_k / v_k(x),       v_k(x) = a_k x + c_k,

y_k the electrons of exposure k above the dark, a_k its time with drift and the pixel's response, c_k the variance
without light: read noise, rounding and dark current (Granados, Ajdin, Wand, Theobalt, Seidel, Lensch, CVPR 2010). The
weights are those of the merged light, found by repetition from those of pure shot noise: weights that knew the noise of
one exposure would favour what came out dark. Full pixels and their neighbours have weight 0. The variance,

    var x = shot x + floor + (relative x)²,    shot = sum of w_k² a_k / (sum of w_k a_k)²,    floor alike with c_k,

is linear in the light but for the noise of the flat field; a fit puts the light of its model into it.

Light drifts from one exposure to the next. The ratio of two is that of sums over the pixels that both of them see,
weighted by the light beside each: weights that knew a pixel's own noise would favour what came out bright. Pixels are
left out near full by the sum of both exposures: given the sum of two Poisson numbers their ratio is what it is without,
given one of them it is not.

Notes:
    Of readings within noise of white those below count, so light there is told too dark, by up to 0.4 standard
    deviations of the longer exposure, until a model tells which they are (:meth:`Plane.expecting`).
    Dark frames tell hot pixels and the level of the dark. They are not taken off pixel by pixel, which would add
    their noise.
    Pixels that stand alone among their neighbours may be dust, hot, or a fine peak; they stay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base import __version__
from maskfab.base.arrays import Floats, Mask, Singles
from maskfab.base.errors import SourceError
from maskfab.camera.frames.frame import PLANE_COLOURS, Colour, Frame, Lattice, Pattern, letters, same_sensor
from maskfab.camera.frames.stack import SIGMA_OF_MAD, check_stack, mean_beside, require_gain
from maskfab.mask.formats.exr import Fact, write_channels

_HOT, _ALONE = 6.0, 8.0
_DUST, _PROVEN = 0.05, 5.0
_SURROUNDINGS = 31
_BLIND = 0.5
_ALIKE = 2.0


def _dark(frames: Sequence[Frame], times_s: Sequence[float], place: int) -> tuple[Mask, list[float]]:
    """Hot pixels (six robust standard deviations) in dark frames, and mean counts above black of the others by time."""
    stack = np.stack([frame.signal(place) for frame in frames])
    middle = np.median(stack, axis=0)
    usual = float(np.median(middle))
    spread = max(SIGMA_OF_MAD * float(np.median(np.abs(middle - usual))), 1 / np.sqrt(12))
    hot = middle > usual + _HOT * spread
    times = [frame.exposure_s for frame in frames if frame.exposure_s is not None]
    levels = stack[:, ~hot].mean(axis=1)
    if len(times) == len(frames):
        per_second = float(levels.sum() / sum(times))
        return hot, [per_second * time for time in times_s]
    return hot, [float(levels.mean())] * len(times_s)


_Response = tuple[Floats, Floats, Mask, Mask]
"""Of pixels [rows, columns] to even light: share of their mean, its relative error, those that are darker than their
surroundings as under dust, and those that are too dark to be divided by their share."""


def _response(
    frames: Sequence[Frame], place: int, lattice: Lattice, electrons_per_count: float, dark_e2: float
) -> _Response:
    """Response of one colour's pixels from frames of even light."""
    full = lattice.at(np.any([frame.full for frame in frames], axis=0))
    electrons = electrons_per_count * np.sum([frame.signal(place) for frame in frames], axis=0)
    mean = float(electrons[~full].mean()) if not full.all() else 0.0
    if full.mean() > _DUST or mean < _HOT * np.sqrt(dark_e2 * len(frames)):
        what = f"the flat field {frames[0].name} is {100 * full.mean():.0f} % full and has {mean:.3g} electrons a pixel"
        cure = "Expose an evenly lit surface to half of the white level"
        raise SourceError("MF334", what, where=frames[0].name, cure=cure)
    share = electrons / mean
    error = np.sqrt(np.maximum(electrons, 0.0) + dark_e2 * len(frames)) / np.maximum(electrons, 1.0)
    around = ndimage.uniform_filter(share, _SURROUNDINGS, mode="nearest")
    dust = share < (1 - _DUST) * around - _PROVEN * error * around
    return share, error, dust, (share < _BLIND * around) | full


def alone(light: Floats, sigma: Floats, valid: Mask) -> Mask:
    """Pixels eight standard deviations from neighbours that agree: dust, a hot pixel, or a fine peak."""
    beside = mean_beside(light, valid)
    expected = mean_beside(np.where(valid, sigma, 0.0) ** 2, valid)
    agreed = mean_beside(light**2, valid) - beside**2 < _ALIKE**2 * expected
    own = np.where(valid, sigma, 0.0) ** 2
    return np.asarray(valid & agreed & ((light - beside) ** 2 > _ALONE**2 * (own + expected / 8)))


_DRIFT_PROVEN = 3.0
"""Standard errors from 1 beyond which a drift is taken out; less is noise, and would be put in."""
_CLEAR = 0.9
"""Of full, up to which a pixel is used."""
_TOLD = 0.25
_MOST = 2.0


@dataclass(frozen=True, eq=False)
class Exposed:
    """One colour in all exposures.

    Attributes:
        electrons: [frames, rows, columns], the level of the dark taken off.
        usable: of the same shape, what is neither full nor hot.
        hot: [rows, columns] pixels far above the others in dark frames.
        dark: [frames] variance without light, in electrons squared.
        full: [frames] electrons of a full pixel; infinite where white is not known.
    """

    electrons: Floats
    usable: Mask
    hot: Mask
    dark: Floats
    full: Floats


@dataclass(frozen=True)
class Drift:
    """Light of one exposure in that of the longest; ``taken_out`` is 1 where no drift is proven."""

    factor: float
    error: float
    taken_out: float


def drifts(colours: Sequence[Exposed], times_s: Sequence[float], names: Sequence[str]) -> tuple[Drift, ...]:
    """Drift of each exposure against the longest, from each to the next shorter."""
    order = sorted(range(len(times_s)), key=lambda place: -times_s[place])
    drifted = {order[0]: Drift(1.0, 0.0, 1.0)}
    for longer, shorter in pairwise(order):
        ratio, error = _ratio(colours, times_s, longer, shorter)
        before = drifted[longer]
        if not error < _TOLD:
            drifted[shorter] = Drift(before.taken_out, math.inf, before.taken_out)
            continue
        factor = before.factor * ratio
        total = factor * math.hypot(error, 0.0 if math.isinf(before.error) else before.error / before.factor)
        off = max(ratio, 1 / ratio) if ratio > 0 else math.inf
        if off > _MOST * (1 + _DRIFT_PROVEN * error):
            what = (
                f"{names[shorter]} has {ratio:.3g} times the light of {names[longer]} for their times of "
                f"{times_s[shorter]:g} s and {times_s[longer]:g} s; a lamp drifts by less than {_MOST:g}"
            )
            cure = "State the true times with --times, in the order of the files"
            raise SourceError("MF332", what, where=names[shorter], cure=cure)
        drifted[shorter] = Drift(factor, total, factor if abs(factor - 1) > _DRIFT_PROVEN * total else 1.0)
    return tuple(drifted[place] for place in range(len(times_s)))


def _ratio(colours: Sequence[Exposed], times_s: Sequence[float], longer: int, shorter: int) -> tuple[float, float]:
    """Light of the shorter exposure in that of the longer, and its standard error; infinite where there is none."""
    sums, variances = np.zeros(2), np.zeros(2)
    times = times_s[longer], times_s[shorter]
    for colour in colours:
        both = colour.electrons[longer] + colour.electrons[shorter]
        clear = both < _CLEAR * colour.full[longer] * (1 + times[1] / times[0])
        common = colour.usable[longer] & colour.usable[shorter] & clear
        rate = np.maximum(mean_beside(colour.electrons[longer] / times[0], common), 0.0)
        weights = np.where(common, rate / (rate + colour.dark[shorter] / times[1]), 0.0)
        for place, frame in enumerate((longer, shorter)):
            sums[place] += (weights * colour.electrons[frame]).sum() / times[place]
            noise = rate * times[place] + colour.dark[frame]
            variances[place] += (weights**2 * noise).sum() / times[place] ** 2
    if not (sums > 0).all():
        return 1.0, math.inf
    return float(sums[1] / sums[0]), float(np.sqrt((variances / sums**2).sum()))


Places = NDArray[np.int64]

_ROUNDS = 3
_BELOW = 4.0
"""Standard deviations by which light must stay below full for its readings to be all there."""
_DISAGREES = 6.0
_LEVERAGE = 0.98
_SEEN, _BRIGHT, _MOST_DISAGREEING, _ENOUGH = 6.0, 20.0, 0.2, 50
_MOST_FULL = 0.9


@dataclass(frozen=True, eq=False)
class Plane:
    """Merged light of one colour.

    Attributes:
        step: rows and columns from one pixel to the next, 1 or 2.
        electrons_per_s: [rows, columns] the light; electrons of the one exposure where its time is not known; 0 where
            not valid.
        sigma: [rows, columns] its standard deviation; infinite where not valid.
        valid: [rows, columns] whether any exposure tells it and no defect forbids it.
        shot: [rows, columns] variance of each electron a second.
        share: [rows, columns] the pixels' response.
        relative: [rows, columns] standard deviation of the response, of itself; 0 without a flat field.
        exposed: what it was merged of, in the order of the frames.
        scales: [frames] times with drift, 1 where they are not known.
    """

    colour: Colour
    first: tuple[int, int]
    step: int
    electrons_per_s: Floats
    sigma: Floats
    valid: Mask
    shot: Floats
    floor: Floats
    share: Floats
    relative: Floats
    exposed: Exposed
    scales: Floats

    def variance(self, light: Floats) -> Floats:
        """Variance of what was measured if ``light`` [rows, columns] is the truth, as of a model."""
        return np.asarray(self.shot * np.maximum(light, 0.0) + self.floor + (self.relative * light) ** 2)

    def expecting(self, light: Floats) -> Plane:
        """Plane without readings that this light, [rows, columns], brings within noise of full.

        Of those the ones that came out dark alone would count, and tell the light too dark.
        """
        electrons = self.scales[:, None, None] * self.share * np.maximum(light, 0.0)
        noise = np.sqrt(electrons + self.exposed.dark[:, None, None])
        usable = self.exposed.usable & (electrons + _BELOW * noise < self.exposed.full[:, None, None])
        if (usable == self.exposed.usable).all():
            return self
        return replace(self, exposed=replace(self.exposed, usable=usable)).rescaled(self.scales)

    def rescaled(self, scales: Floats) -> Plane:
        """Plane of these exposures merged with other times, [frames]; what was not valid stays so."""
        light = _light(self.exposed, scales, self.share)
        valid = self.valid & light.seen
        plane = replace(self, shot=light.shot, floor=light.floor, valid=valid, scales=scales)
        sigma = np.where(valid, np.sqrt(plane.variance(light.electrons_per_s)), np.inf)
        return replace(plane, electrons_per_s=np.where(valid, light.electrons_per_s, 0.0), sigma=sigma)


@dataclass(frozen=True)
class Used:
    """One exposure as it was used."""

    name: str
    sha256: str
    exposure_s: float | None
    drift: Drift
    full: int


@dataclass(frozen=True, eq=False)
class Merged:
    """Merged exposures, and what was left out of them or is to be doubted.

    Places are int64 [n, 2], row and column in the files.

    Attributes:
        hot: places that dark frames tell as hot; not valid.
        disagreeing: places where exposures disagree by six standard deviations, hot pixels or hits among them; not
            valid.
        full: places that are full, or beside one, in every exposure; not valid.
        dust: places darker than their surroundings in the flat field; divided out, not valid below half.
        alone: places that stand out from neighbours which agree: dust, a hot pixel or a fine peak, which one frame
            cannot tell; they stay valid.
    """

    planes: tuple[Plane, ...]
    shape: tuple[int, int]
    corner: tuple[int, int]
    pattern: Pattern | None
    used: tuple[Used, ...]
    electrons_per_count: float
    read_noise_e: float
    hot: Places
    disagreeing: Places
    full: Places
    dust: Places
    alone: Places


def merged(
    frames: Sequence[Frame],
    *,
    electrons_per_count: float,
    read_noise_e: float,
    dark: Sequence[Frame] = (),
    flat: Sequence[Frame] = (),
) -> Merged:
    """One light from a stack.

    Args:
        frames: of exposures that differ, in any order, or a single one.
        read_noise_e: in electrons, without what rounding adds.
        dark: frames without light, of the same sensor and crop.
        flat: frames of even light, of the same sensor and crop.

    Raises:
        SourceError: as :func:`check_stack`; MF331 for dark or flat frames of another sensor, MF332 for light that
            differs twofold from what the times say, MF334 if all is full or dark, MF335 for a gain or a read noise
            that no sensor has, MF336 if the exposures do not show one light.
    """
    check_stack(frames)
    same_sensor([frames[0], *dark, *flat])
    require_gain(electrons_per_count, read_noise_e)
    well = electrons_per_count * (frames[0].white - max(frames[0].black))
    if well < _SEEN * read_noise_e:
        what = (
            f"{electrons_per_count:g} electrons per count fill a pixel with {well:.3g} electrons at the white of "
            f"{frames[0].white:g}, under {_SEEN:g} times the read noise of {read_noise_e:g}"
        )
        cure = f"Give the gain in electrons for each count of the file: full well over {frames[0].white:g}, less black"
        raise SourceError("MF335", what, where=frames[0].name, cure=cure)
    times = [1.0 if frame.exposure_s is None else frame.exposure_s for frame in frames]
    lattices = list(enumerate(frames[0].lattices))
    dark_e2 = read_noise_e**2 + (electrons_per_count**2 / 12 if all(frame.whole for frame in frames) else 0.0)
    flats = [
        _response(flat, place, lattice, electrons_per_count, dark_e2) if flat else None for place, lattice in lattices
    ]
    fulls = np.stack([frame.full for frame in frames])
    if fulls.all(axis=0).mean() > _MOST_FULL:
        what = f"{100 * fulls.all(axis=0).mean():.0f} % of the pixels are full in all {len(frames)} frames"
        cure = "Give shorter exposures, or state the white level in the counts of the files"
        raise SourceError("MF334", what, where=frames[0].name, cure=cure)
    exposed = [
        _exposed(frames, fulls, times, place, lattice, electrons_per_count, dark_e2, dark)
        for place, lattice in lattices
    ]
    drifted = drifts(exposed, times, [frame.name for frame in frames])
    scales = np.array([time * drift.taken_out for time, drift in zip(times, drifted, strict=True)])
    colours = [_merged(lattice, exposed[place], scales, flats[place], frames[0].name) for place, lattice in lattices]
    planes = tuple(plane for plane, _ in colours)
    _check_light(planes, frames[0].name)
    corner = frames[0].corner

    def places(name: str) -> Places:
        found = [
            np.argwhere(doubts[name]) * plane.step + np.array(plane.first) + np.array(corner)
            for plane, doubts in colours
        ]
        return np.unique(np.concatenate(found), axis=0).astype(np.int64)

    return Merged(
        planes=planes,
        shape=frames[0].shape,
        corner=corner,
        pattern=frames[0].pattern,
        used=tuple(
            Used(frame.name, frame.sha256, frame.exposure_s, drift, int(full.sum()))
            for frame, drift, full in zip(frames, drifted, fulls, strict=True)
        ),
        electrons_per_count=electrons_per_count,
        read_noise_e=read_noise_e,
        **{name: places(name) for name in colours[0][1]},
    )


def _exposed(
    frames: Sequence[Frame],
    fulls: Mask,
    times: Sequence[float],
    place: int,
    lattice: Lattice,
    electrons_per_count: float,
    dark_e2: float,
    dark: Sequence[Frame],
) -> Exposed:
    usable = ~lattice.at(fulls)
    hot, levels = _dark(dark, times, place) if dark else (np.zeros_like(usable[0]), [0.0] * len(times))
    signals = [frame.signal(place) - level for frame, level in zip(frames, levels, strict=True)]
    electrons = electrons_per_count * np.stack(signals)
    shot = np.maximum(levels, 0.0) * electrons_per_count
    full = [
        electrons_per_count * (frame.white - frame.black[place] - level)
        for frame, level in zip(frames, levels, strict=True)
    ]
    return Exposed(electrons, usable & ~hot, hot, dark_e2 + shot, np.array(full))


def _merged(
    lattice: Lattice, exposed: Exposed, scales: Floats, response: _Response | None, name: str
) -> tuple[Plane, dict[str, Mask]]:
    """One colour, and marks [rows, columns] of what is to be doubted of it, by the names of :class:`Merged`."""
    nowhere = np.zeros_like(exposed.hot)
    share, relative, dust, blind = response or (
        np.ones(nowhere.shape),
        np.broadcast_to(0.0, nowhere.shape),
        nowhere,
        nowhere,
    )
    share = np.maximum(share, 1e-3 * float(share.max()))  # pixels below are blind
    light = _light(exposed, scales, share)
    x, seen = light.electrons_per_s, light.seen
    a = scales[:, None, None] * share
    c = np.broadcast_to(exposed.dark[:, None, None], exposed.electrons.shape)
    disagreeing = _disagreeing(exposed.electrons, a, c, exposed.usable, x)
    valid = seen & ~disagreeing & ~blind & ~exposed.hot
    where = lattice.colour, lattice.first, lattice.step
    plane = Plane(*where, x, x, valid, light.shot, light.floor, share, relative, exposed, scales)
    sigma = np.where(valid, np.sqrt(plane.variance(x)), np.inf)
    plane = replace(plane, electrons_per_s=np.where(valid, x, 0.0), sigma=sigma)
    _check_one_light(plane, seen, disagreeing, x, name)
    full = ~exposed.usable.any(axis=0) & ~exposed.hot
    lonely = alone(plane.electrons_per_s, sigma, valid)
    return plane, {"hot": exposed.hot, "disagreeing": disagreeing, "full": full, "dust": dust, "alone": lonely}


@dataclass(frozen=True, eq=False)
class _Light:
    """Light of one colour, [rows, columns], the parts of its variance, and whether any exposure tells it."""

    electrons_per_s: Floats
    shot: Floats
    floor: Floats
    seen: Mask


def _light(exposed: Exposed, scales: Floats, share: Floats) -> _Light:
    y, usable = exposed.electrons, exposed.usable.astype(np.float64)
    a = scales[:, None, None] * share
    c = np.broadcast_to(exposed.dark[:, None, None], y.shape)
    w = usable
    x = _quotient((w * y).sum(axis=0), (w * a).sum(axis=0))
    for _ in range(_ROUNDS):
        w = usable * a / (a * np.maximum(x, 0.0) + c)
        total = (w * a).sum(axis=0)
        x = _quotient((w * y).sum(axis=0), total)
    shot, floor = _quotient((w**2 * a).sum(axis=0), total**2), _quotient((w**2 * c).sum(axis=0), total**2)
    return _Light(x, shot, floor, np.asarray(total > 0))


def _quotient(one: Floats, other: Floats) -> Floats:
    return np.divide(one, other, out=np.zeros_like(one), where=other > 0)


def _disagreeing(y: Floats, a: Floats, c: Floats, usable: Mask, x: Floats) -> Mask:
    """Pixels where any exposure is off the merged light by six standard deviations.

    Shot noise is skewed: of a few electrons six standard deviations are common. The limit is raised by the skewness
    (Cornish and Fisher, Rev. Inst. Int. Stat. 5 (1938) 307).
    """
    light = a * np.maximum(x, 0.0)
    variance = light + c
    precision = usable * a**2 / variance
    total = precision.sum(axis=0)
    leverage = np.divide(precision, total, out=np.ones_like(precision), where=total > 0)
    limit = _DISAGREES * np.sqrt(variance) + (_DISAGREES**2 - 1) / 6 * light / variance
    off = np.abs(y - a * x) > limit * np.sqrt(np.maximum(1 - leverage, 0.0))
    return np.asarray((off & usable & (leverage < _LEVERAGE)).any(axis=0))


def _check_one_light(plane: Plane, seen: Mask, disagreeing: Mask, x: Floats, name: str) -> None:
    bright = seen & (x > _BRIGHT * np.sqrt(plane.variance(x)))
    off, count = int((bright & disagreeing).sum()), int(bright.sum())
    if off > _ENOUGH and off > _MOST_DISAGREEING * count:
        what = (
            f"the exposures disagree at {off} of {count} bright pixels by more than {_DISAGREES:g} standard deviations"
        )
        cure = "Take the stack again with camera and light at rest; or correct gain, read noise and black level"
        raise SourceError("MF336", what, where=name, cure=cure)


def _check_light(planes: Sequence[Plane], name: str) -> None:
    """Refuse a stack without light: fewer pixels than four above noise, and none of all pixels together."""
    above = sum(int((plane.valid & (plane.electrons_per_s > _SEEN * plane.sigma)).sum()) for plane in planes)
    total = sum(float(plane.electrons_per_s.sum()) for plane in planes)
    noise = float(np.sqrt(sum(float((plane.sigma[plane.valid] ** 2).sum()) for plane in planes)))
    if above < 4 and not total > _SEEN * noise > 0:
        what = f"{above} pixels are {_SEEN:g} standard deviations above black, and all together are not"
        cure = "Expose longer, or state the true black level, or the gain in electrons for each count of the file"
        raise SourceError("MF334", what, where=name, cure=cure)


_HIDDEN = 0.1
"""Share of the brightest light that is left beside full pixels where the peak is among them; a stuck one is alone."""


def check_centre(merged: Merged) -> None:
    """Refuse a light whose centre is full in every exposure: a fit would tell its peak by its foot."""
    for plane in merged.planes:
        full = ~plane.exposed.usable.any(axis=0) & ~plane.exposed.hot
        beside = ndimage.binary_dilation(full, iterations=2) & plane.valid
        light = plane.electrons_per_s
        if beside.any() and light[beside].max() >= _HIDDEN * light.max() > 0:
            name = min(merged.used, key=lambda used: used.exposure_s or 0.0).name
            what = f"{int(full.sum())} pixels at the centre of the light are full in all {len(merged.used)} frames"
            cure = f"Add an exposure four times shorter than {name}, or state the true white level"
            raise SourceError("MF334", what, where=name, cure=cure)


def write_merged(merged: Merged, light: Path, sigma: Path) -> None:
    """Write two files of float32, [rows, columns] of the frames: one channel ``Y`` (a mosaic stays one), or R, G and B.

    Pixels that are not valid have light 0 and an infinite standard deviation.

    Raises:
        OutputError: MF401 if a file cannot be written; nothing is left under its name.
    """
    timed = all(used.exposure_s is not None for used in merged.used)
    facts: dict[str, Fact] = {
        "maskfab_version": __version__,
        "unit": "electrons/s" if timed else "electrons",
        "axes": "the first row of pixels is the uppermost of the sensor, as the files of the camera hold it",
        "mosaic": letters(merged.pattern) if merged.pattern else "none",
        "corner": f"row {merged.corner[0]}, column {merged.corner[1]} of the files",
        "electrons_per_count": merged.electrons_per_count,
        "read_noise_e": merged.read_noise_e,
        "frames": ", ".join(used.name for used in merged.used),
        "frames_sha256": ", ".join(used.sha256 or "none" for used in merged.used),
        "exposures_s": ", ".join(
            "unknown" if used.exposure_s is None else repr(used.exposure_s) for used in merged.used
        ),
        "drifts": ", ".join(f"{used.drift.taken_out:.9g}" for used in merged.used),
        "hot_pixels": float(len(merged.hot)),
        "disagreeing_pixels": float(len(merged.disagreeing)),
        "full_pixels": float(len(merged.full)),
        "dusty_pixels": float(len(merged.dust)),
        "lonely_pixels": float(len(merged.alone)),
    }
    for path, name in ((light, "electrons_per_s"), (sigma, "sigma")):
        pixels = _laid_out(merged, name)
        channels = PLANE_COLOURS if pixels.shape[2] == 3 else ("Y",)
        write_channels(pixels, channels, path, {**facts, "holds": name}, f"maskfab {__version__}")


def _laid_out(merged: Merged, name: str) -> Singles:
    """[rows, columns, channels] of the planes."""
    if all(plane.step == 1 for plane in merged.planes):
        return np.stack([getattr(plane, name) for plane in merged.planes], axis=2).astype(np.float32)
    mosaic = np.empty((*merged.shape, 1), dtype=np.float32)
    for plane in merged.planes:
        mosaic[plane.first[0] :: plane.step, plane.first[1] :: plane.step, 0] = getattr(plane, name)
    return mosaic
