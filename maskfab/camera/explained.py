"""Whether a blur explains a record, by the record alone, and whether it may be undone without harm.

Light is never below 0. Who undoes a halo that is not there takes from what is dark beside what is bright, light that
it does not have. So of a picture x̂ that a Wiener filter restores from a record y,

    q = (sum of min(x̂, 0)² less what noise does) / sum of (x̂ - y)²

is the share of the change that is wrong for certain, however the scene looks. Behind the right panel it is next to 0.
Noise alone makes at most half of its variance in x̂. (That light is not negative is what blind deconvolution has long
gone by: G. R. Ayers, J. C. Dainty, Opt. Lett. 13, 547, 1988.) Where a scene has nothing dark, q says nothing. It can be
told: x̂ itself is undone once more as if it were a record, and must then show what a wrong blur does.

A record shows the panel's structure too, see :mod:`maskfab.camera.panel_spectrum`, where it is held against what a
record of this panel, and what one of another, would show: :mod:`maskfab.camera.panel_power`. Its scales and angles are
fitted. Where a record could tell nothing, the blur is undone as far as q allows; where none but this blur would show
what is seen, q only tells how strongly.

Notes:
    A blur that is wrong and does no harm that light below 0 would tell is undone: another die with as much halo.
    Defocus, a wider pixel and a soft scene look alike and are not told apart.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy

from maskfab.base.arrays import Singles
from maskfab.camera.imaging import Blur, KeptBlur, Margin, Transfer
from maskfab.camera.noise_spectrum import NoiseSpectrum, WhitenedBlur, whitened
from maskfab.camera.panel_power import DECOYS, SCALE, Comparison, Fitted, Power
from maskfab.camera.panel_spectrum import LARGEST, Seen, Shape, warped
from maskfab.camera.record import Record
from maskfab.camera.restorers.wiener import prior, wiener

EXPLAINED, UNSURE, FOREIGN = "explained", "cannot tell", "not this display"

_CLEAR, _SEEN = 3.0, 2.0
"""Standard deviations over chance from which one setting is better than another, and from which a structure is seen
that hardly any other record would show."""
_LEAST = 10.0
"""Log-likelihood from which it is evidence."""
_LEAST_SHARE = 0.25
"""Share of a structure from which it is seen."""
_DOUBTFUL, _WRONG, _STILL_WRONG, _DOUBT = 0.005, 0.015, 0.04, 16.0
"""Shares of a change, as light below 0, from which ε is so many times as large (as many times as the share is larger
where only this blur's structure would show so), from which a blur is wrong where no structure is seen, and from which
it is wrong where one is."""
_FAR_GAIN, _FAR_CLEAR, _MILD = 100.0, 10.0, 0.2
"""Log-likelihood and standard deviations over chance, from which the scale of a camera that was guessed is taken; and
the least ε then, for little of the structure is known."""
_AT_ONCE = 300_000
"""Frequencies of a fitted blur that are found at a time."""
_ROOM = 128
"""Pixels by which a square is mirrored beyond its edges."""


@dataclass(frozen=True, eq=False)
class Explained:
    """Findings of a record on a blur.

    Attributes:
        verdict: :data:`EXPLAINED`, :data:`UNSURE` or :data:`FOREIGN`; then the record stays as it is.
        share: of its structure that the record shows, of power.
        power: of a record of this blur, and of others.
        chance: mean and standard deviation of the gain at angles that no camera has.
        wrong: q, and what it would be if the blur were none, see the head of this file.
        rival: name and gain of another blur that explains the record better, if one does.
    """

    verdict: str
    setting: Fitted
    share: float
    power: Power
    chance: tuple[float, float]
    wrong: tuple[float, float]
    rival: tuple[str, float] | None
    blur: Blur
    strength: float
    noise: tuple[NoiseSpectrum, ...]
    trusted: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Numbers for a document."""
        return {
            "verdict": self.verdict,
            "trusted": self.trusted,
            "told": [self.sentence],
            "next": list(self.advice),
            "scale": self.setting.scale,
            "turn_deg": math.degrees(self.setting.turn),
            "gain": self.setting.gain,
            "gain_expected": self.power.expected,
            "gain_of_another": self.power.of_another,
            "gain_limit": self.power.limit,
            "power": self.power.told,
            "gain_by_chance": list(self.chance),
            "share": self.share,
            "light_below_0": self.wrong[0],
            "light_below_0_without_display": self.wrong[1],
            "rival": None if self.rival is None else {"die": self.rival[0], "gain": self.rival[1]},
        }

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        setting = self.setting
        evidence = f"log-likelihood {setting.gain:.0f}, by chance {self.chance[0]:.0f} ± {self.chance[1]:.0f}"
        told = f"this photograph could tell this PSF from another with {100 * self.power.told:.0f} %"
        if self.verdict == EXPLAINED:
            return (
                f"The PSF explains the photograph: {100 * self.share:.0f} % of its structure is seen, at "
                f"{setting.scale:.3f} of its size and a turn of {math.degrees(setting.turn):+.2f} degrees "
                f"({evidence}; {told})."
            )
        if self.verdict == UNSURE:
            size = f"at {setting.scale:.2f} of its size, where" if abs(setting.scale - 1) > SCALE else "for"
            undone = "as it is said to be" if self.trusted else f"{size} nothing speaks against it"
            return f"Cannot tell whether the PSF explains the photograph ({evidence}; {told}). It was undone, {undone}."
        undone = "The PSF was undone as it is said to be." if self.trusted else "The picture stays as it was taken."
        why = f"the structure that the PSF makes is not there ({evidence}; {told})"
        if self.rival is not None:
            why = f"die {self.rival[0]} explains it better, by a log-likelihood of {self.rival[1]:.0f} ({evidence})"
        if self.wrong[0] > _WRONG:
            why = f"of what undoing the PSF changes, {100 * self.wrong[0]:.1f} % would be light below 0"
        return f"Not this display, as far as the photograph tells: {why}. {undone}"

    @property
    def advice(self) -> tuple[str, ...]:
        """Steps that a lab takes next."""
        off = abs(self.setting.scale - 1) > _FAR_SCALE or abs(self.setting.turn) > _FAR_TURN
        steps = ["State the pixel, the focal length and the turn that were fitted."] if off else []
        if abs(self.setting.scale - 1) > SCALE:
            steps = [f"It fits at {self.setting.scale:.2f} of its size: check pixel and focal length."]
        other = [] if self.rival is None else [f"Try --die {self.rival[0]}: it explains the photograph better."]
        if self.verdict == EXPLAINED:
            return (
                *other,
                *steps,
                "Capture a point light through the die (maskfab measure): its PSF tells lens and focus too.",
            )
        again = (
            "Where the picture is covered with waves: leave --trust out, or give a strength, --epsilon 0.1 or more."
            if self.trusted
            else "Undo the PSF as it is said to be, whatever the photograph says: --trust."
        )
        if self.verdict == UNSURE:
            return (
                *(steps if abs(self.setting.scale - 1) > SCALE else ()),
                "Photograph something with detail all over, in more light, and keep the RAW file.",
                "Or capture a point light through the die, and restore by its PSF (--psf).",
                again,
            )
        return (
            *other,
            "Check the die, the way that it stands (--stands), the camera's pixel and focal length, and the focus.",
            again,
        )


@dataclass(frozen=True, eq=False)
class FittedBlur(KeptBlur):
    """A blur at another scale and angle, on frequencies half as far apart as those of the square it was fitted to."""

    transfer: Transfer
    setting: Fitted

    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        rows, columns = shape
        found: Any = np.empty((3, rows, columns // 2 + 1), dtype=self.transfer.dtype)
        fy, fx = np.asarray(scipy.fft.fftfreq(rows)), np.asarray(scipy.fft.rfftfreq(columns))[None]
        strip = max(1, _AT_ONCE // fx.size)
        for first in range(0, rows, strip):
            part = slice(first, first + strip)
            y, x = np.broadcast_arrays(fy[part, None], fx)
            found[:, part] = warped(self.transfer, y, x, self.setting.scale, self.setting.turn)
        return found  # type: ignore[no-any-return]


def explain(
    record: Record,
    blur: Blur,
    noise: Sequence[NoiseSpectrum],
    rivals: Mapping[str, Blur] = MappingProxyType({}),
    *,
    coded: bool = False,
) -> Explained:
    """Hold a blur against a record, and fit what is usually unknown.

    Args:
        record: of at least 128 pixels along a side.
        coded: whether it was developed or compressed, which takes structure away that light had: then what is missing
            speaks against no blur.
        rivals: other blurs by name, of which one may explain it better; tried where this one does not.
    """
    square = _middle(record, LARGEST)
    seen = Seen.of(square.values, noise)
    mine = Comparison(seen, Shape.of(blur, seen.plane))
    even, strength = whitened(square, seen.noise), mine.strength()
    tried, chance, clear, power = [Fitted()], (0.0, 0.0), False, Power()
    if seen.enough:
        by_chance = [mine.gain(seen.at, Fitted(scale, turn)) for scale, turn in DECOYS]
        chance = float(np.mean(by_chance)), float(np.std(by_chance))
        drawn, best = mine.drawn(), mine.best()
        # A scene has structure of its own, which lies better somewhere by as much as chance has it.
        tried = [drawn, best] if best.gain > drawn.gain + _CLEAR else [drawn]
        tried = [best] if best.gain > drawn.gain + _CLEAR * (1 + chance[1]) else tried
    blurs = [blur if one.as_drawn else FittedBlur(mine.shape.transfer, one) for one in tried]
    wrongs = [_wrong(even, WhitenedBlur(undone, seen.noise), strength) for undone in blurs]
    wrong, setting, undone = min(zip(wrongs, tried, blurs, strict=True), key=lambda one: one[0][0])
    share = 0.0
    if seen.enough:
        power = mine.power(setting, blur)
        clear = setting.gain > max(_LEAST, chance[0] + _SEEN * chance[1], power.limit) and power.surely(setting.gain)
        share = mine.share(setting)
    missing = power.known and setting.gain < power.limit and not coded
    if wrong[0] > _WRONG or missing:
        far = mine.far()
        if far.gain > max(_FAR_GAIN, chance[0] + _FAR_CLEAR * chance[1]):
            blur_far = FittedBlur(mine.shape.transfer, far)
            wrong_far = _wrong(even, WhitenedBlur(blur_far, seen.noise), strength)
            if wrong_far[0] == 0:
                setting, undone, wrong, strength = far, blur_far, wrong_far, max(strength, _MILD)
                clear, share, missing = True, mine.share(far), False
    seen_clearly = clear and share >= _LEAST_SHARE
    verdict = EXPLAINED if seen_clearly else UNSURE
    if seen_clearly and power.known and setting.gain >= power.limit:
        # No other would show it: what falls below 0 is for light from beyond the edges, or a lens that is not known.
        strength *= max(1.0, wrong[0] / _DOUBTFUL)
        wrong = _wrong(even, WhitenedBlur(undone, seen.noise), strength) if wrong[0] > _STILL_WRONG else wrong
    elif setting.gain < power.limit or wrong[0] > _DOUBTFUL:
        strength *= _DOUBT
    if missing or wrong[0] > (_STILL_WRONG if seen_clearly else _WRONG):
        verdict = FOREIGN
    rival = _rival(record, blur, noise, rivals, mend=verdict == FOREIGN)
    if rival is not None and verdict == UNSURE:
        verdict = FOREIGN
    return Explained(verdict, setting, share, power, chance, wrong, rival, undone, strength, seen.noise)


def _wrong(square: Record, blur: Blur, strength: float) -> tuple[float, float]:
    """q of a record, and of the picture that is restored from it."""
    side = square.values.shape[1]
    margin = Margin((side + 2 * _ROOM, side + 2 * _ROOM), _ROOM)
    inverse = wiener(blur.on(margin.shape), prior(margin.shape), strength)
    inner = (slice(None), *(slice(side // 4, -(side // 4)),) * 2)
    variance = square.variance.mean(axis=(1, 2), dtype=np.float64)
    noise = float((np.square(abs(inverse)).mean(axis=(1, 2), dtype=np.float64) * variance).mean())

    def share(seen: Singles) -> tuple[float, Singles]:
        picture = margin.blurred(margin.mirrored(seen), inverse)
        # At the edges light that came from beyond them is missing.
        below = float(np.square(np.minimum(picture, 0)[inner]).mean(dtype=np.float64)) - noise / 2
        change = float(np.square((picture - seen)[inner]).mean(dtype=np.float64))
        return max(below, 0.0) / max(change, 1e-30), picture

    first, picture = share(square.values)
    return first, share(np.maximum(picture, 0))[0]


def _middle(record: Record, most: int) -> Record:
    side = min(*record.values.shape[1:], most) // 2 * 2
    top, left = ((whole - side) // 2 for whole in record.values.shape[1:])
    return replace(record, values=record.values[:, top : top + side, left : left + side])


def _rival(
    record: Record,
    blur: Blur,
    noise: Sequence[NoiseSpectrum],
    rivals: Mapping[str, Blur],
    *,
    mend: bool,
) -> tuple[str, float] | None:
    """Name and gain, over that of a blur, of the one that explains a smaller square of the record best and better.

    Args:
        mend: whether scales and angles are fitted, too.
    """
    seen = Seen.of(_middle(record, LARGEST // 2).values, noise) if rivals else None
    if seen is None or not seen.enough:
        return None
    made = {"": Comparison(seen, Shape.of(blur, seen.plane))}
    made |= {name: Comparison(seen, Shape.of(other, seen.plane)) for name, other in rivals.items()}
    found = {name: one.best() if mend else one.drawn() for name, one in made.items()}
    best = max(found, key=lambda name: found[name].gain)
    gain, own, one = found[best].gain, found[""].gain, made[best]
    by_chance = [one.gain(seen.at, Fitted(*decoy)) for decoy in DECOYS]
    expected = one.expected(found[best])[0]
    clear = max(expected / 2, own + max(_LEAST, expected / 5), float(np.mean(by_chance) + _CLEAR * np.std(by_chance)))
    return (best, gain - own) if best and gain > clear else None


_FAR_SCALE, _FAR_TURN = 0.01, math.radians(0.5)
