"""A blur held against a record: where it fits, and whether the record could tell it from another.

Of a Gaussian scene with the record's own spectrum the gain of likelihood by a blur is known, if the panel is this one
and if it is another: its structure turned by angles that no camera has stands for others. Real scenes scatter more, as
edges put much into a few frequencies of all colours. By how much tell scenes that are drawn with the record's spectrum,
its blur and noise, and the record's own scatter. Below a limit a record is another's, and the share of others' records
that lie below it is its power.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import optimize, special

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.imaging import Blur
from maskfab.camera.noise_spectrum import tapered_power
from maskfab.camera.panel_spectrum import Sample, Seen, Shape, plane_of, smooth_spectrum, smoothed, turned, warped
from maskfab.camera.restorers.wiener import PRIOR_CY_PER_PX
from maskfab.camera.scenes import dead_leaves

SCALE, TURN = 0.06, math.radians(4)
"""Bounds of what is fitted: of scale to either side of 1, and of the angle."""
_SHARE, WHOLE = 0.6, 0.98
"""Share of a structure, of power, by which settings are compared, and the most that there ever is."""
_STEPS_SCALE, _STEPS_TURN = 19, 11
DECOYS = tuple((scale, math.radians(turn)) for turn in (-43, -31, -22, -13, 13, 22, 31, 43) for scale in (0.93, 1.07))
_SURE, _POWER, _SURELY = 2.6, 0.9, 0.97
"""Standard deviations below what is expected, from which a blur is another; the power from which that is said; and the
share of others that gain less, from which it is this one."""
FAR_SCALES = np.geomspace(0.15, 2.0, 60)
"""Scales of a camera that was guessed."""
_LEAST = 10.0
"""Log-likelihood from which it is evidence."""
_STRONGEST = 1e6
"""ε of a record in which nothing is seen."""
_DRAWN_PX = 256
"""Pixels along a side of a record that is drawn."""


@dataclass(frozen=True)
class Fitted:
    """A blur beside its design: its frequencies' scale and turn in radians, and what log-likelihood that gains."""

    scale: float = 1.0
    turn: float = 0.0
    gain: float = 0.0

    @property
    def as_drawn(self) -> bool:
        """Whether the blur lies as it was designed."""
        return self.scale == 1 and self.turn == 0


@dataclass(frozen=True)
class Power:
    """Gains of log-likelihood that tell a blur from another.

    Attributes:
        expected, deviation: of a record of this very blur, mean and standard deviation.
        others: means and standard deviations of records of others.
    """

    expected: float = 0.0
    deviation: float = 0.0
    others: tuple[tuple[float, float], ...] = ()

    @property
    def of_another(self) -> float:
        """Mean gain of records of others."""
        return float(np.mean([mean for mean, _ in self.others])) if self.others else 0.0

    @property
    def limit(self) -> float:
        """Gain below which a record is of another; none where nothing can be told."""
        return min(self.expected - _SURE * self.deviation, (self.expected + self.of_another) / 2)

    def below(self, gain: float) -> float:
        """Probability that a record of another gains less."""
        return float(np.mean([special.ndtr((gain - mean) / spread) for mean, spread in self.others] or [0.0]))

    @property
    def told(self) -> float:
        """Probability that the blur is told from another."""
        return self.below(self.limit)

    @property
    def known(self) -> bool:
        """Whether the record could tell."""
        return self.told >= _POWER

    def surely(self, gain: float) -> bool:
        """Whether hardly any record of another gains as much."""
        return self.below(gain) >= _SURELY


@dataclass(frozen=True, eq=False)
class Comparison:
    """A blur held against a record's spectrum."""

    seen: Seen
    shape: Shape

    def factor(self, at: Sample, setting: Fitted, share: float = _SHARE) -> Floats:
        """|H|² of a setting with so much of its structure, the rest smooth, [3, n]."""
        power = warped(self.shape.power, at.y, at.x, setting.scale, setting.turn)
        cos, sin = turned(at.cos, at.sin, setting.turn)
        smooth = np.stack([smooth_spectrum(setting.scale * at.f, cos, sin, values) for values in self.shape.smooth])
        return np.asarray(smooth + share * (power - smooth))

    def gain(self, at: Sample, setting: Fitted) -> float:
        """Of log-likelihood by the structure of a setting."""
        return at.gain(self.factor(at, setting))

    def drawn(self) -> Fitted:
        """The blur as it was designed."""
        return Fitted(gain=self.gain(self.seen.at, Fitted()))

    def expected(self, setting: Fitted) -> tuple[float, float]:
        """Mean and standard deviation of the gain that a record of this very setting would have."""
        at = self.seen.at
        return at.told(self.factor(at, setting), at.fitted(self.factor(at, setting, WHOLE)))

    def power(self, setting: Fitted, blur: Blur) -> Power:
        """Gains of a setting, and of a blur that is another: they tell what the record could."""
        at, tested = self.seen.at, self.factor(self.seen.at, setting)
        expected, deviation = self.expected(setting)
        wrongs = [at.told(tested, at.fitted(self.factor(at, Fitted(*decoy), WHOLE))) for decoy in DECOYS[::2]]
        drawn = (
            _scattered(blur, at.scene(self.factor(at, setting, WHOLE))[:, : at.table.shape[1]], self.seen)
            if expected > _LEAST
            else 1.0
        )
        spread = max(drawn, at.scatter(tested) / deviation)
        return Power(expected, spread * deviation, tuple((mean, spread * each) for mean, each in wrongs))

    def share(self, setting: Fitted) -> float:
        """The likeliest share of a setting's structure."""
        at, none, whole = self.seen.at, self.factor(self.seen.at, setting, 0.0), self.factor(self.seen.at, setting, 1.0)
        found = optimize.minimize_scalar(
            lambda share: -at.gain(none + share * (whole - none)), bounds=(0.0, WHOLE), method="bounded",
            options={"xatol": 0.01},
        )  # fmt: skip
        return float(found.x)

    def best(self) -> Fitted:
        """The likeliest scale and angle within bounds, by some low frequencies first."""
        tried = [
            (self.gain(self.seen.low, Fitted(scale, turn)), scale, turn)
            for scale in np.linspace(1 - SCALE, 1 + SCALE, _STEPS_SCALE).tolist()
            for turn in np.linspace(-TURN, TURN, _STEPS_TURN).tolist()
        ]
        _, scale, turn = max(tried)
        step = SCALE / _STEPS_SCALE, TURN / _STEPS_TURN
        simplex = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])

        def setting(place: Floats) -> Fitted:
            return Fitted(
                float(np.clip(scale + place[0] * step[0], 1 - SCALE, 1 + SCALE)),
                float(np.clip(turn + place[1] * step[1], -TURN, TURN)),
            )

        found = optimize.minimize(
            lambda place: -self.gain(self.seen.at, setting(place)),
            np.zeros(2),
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 30, "xatol": 0.02, "fatol": 0.5},
        )
        return replace(setting(found.x), gain=-float(found.fun))

    def far(self) -> Fitted:
        """The likeliest of scales that a guessed camera may be off by; none at the ends of what is tried."""
        gains = [self.gain(self.seen.low, Fitted(scale)) for scale in FAR_SCALES.tolist()]
        best = int(np.argmax(gains[1:-1])) + 1
        if gains[best] < max(gains[0], gains[-1]):
            return Fitted()
        setting = Fitted(float(FAR_SCALES[best]))
        return replace(setting, gain=self.gain(self.seen.at, setting))

    def strength(self) -> float:
        """ε of the 1/f² prior that goes with the scene behind the blur as drawn, where light and noise are equal."""
        at = self.seen.at if self.seen.enough else self.seen.everywhere
        passed = self.factor(at, Fitted(), WHOLE)
        scene, dark = at.parts(passed)
        light = passed * scene
        equal = light * dark / np.square(light + dark)
        ratio = np.log(dark / scene) - 2 * np.log(at.f / PRIOR_CY_PER_PX)
        return min(math.exp(float((equal * ratio).sum() / equal.sum())), _STRONGEST)


@lru_cache(maxsize=1)
def _leaves() -> tuple[tuple[NDArray[np.complex64], Floats], ...]:
    """Spectra of drawn scenes, with half of their side round a record, and values of their smooth spectra."""
    side, plane = 2 * _DRAWN_PX, plane_of(_DRAWN_PX)
    light = dead_leaves(1, 2 * side, 2 * side).light
    scenes = [light[:, top : top + side, left : left + side] for top in (0, side) for left in (0, side)]
    powers = [tapered_power(_cut(scene))[:, plane.use] for scene in scenes]
    spectra = [np.asarray(scipy.fft.rfft2(scene, axes=(1, 2), workers=1)) for scene in scenes]
    values = [np.stack([smoothed(plane, one) for one in power]) for power in powers]
    return tuple(zip(spectra, values, strict=True))


def _cut(scene: Singles) -> Singles:
    around = slice(_DRAWN_PX // 2, -_DRAWN_PX // 2)
    return scene[:, around, around]


def _scattered(blur: Blur, values: Floats, seen: Seen) -> float:
    """Factor by which gains scatter more than a Gaussian scene's, of drawn scenes with a spectrum's [3, values]."""
    side, draw, plane = 2 * _DRAWN_PX, np.random.default_rng(0), plane_of(_DRAWN_PX)
    shape = Shape.of(blur, plane)
    y, x = np.broadcast_arrays(scipy.fft.fftfreq(side)[:, None], scipy.fft.rfftfreq(side)[None])
    f = np.maximum(np.hypot(y, x), 1e-4)
    dark = np.sqrt([one.on(f) for one in seen.noise]).astype(np.float32)
    off = []
    for number, (spectrum, own) in enumerate(_leaves()):
        true = Fitted() if number % 2 else Fitted(*DECOYS[number])
        level = np.stack([smooth_spectrum(f, x / f, y / f, row) for row in (values - own) / 2]).astype(np.float32)
        passed = shape.transfer if true.as_drawn else warped(shape.transfer, y, x, true.scale, true.turn)
        noise = scipy.fft.rfft2(draw.standard_normal((3, side, side), dtype=np.float32), axes=(1, 2), workers=1)
        lit = scipy.fft.irfft2(spectrum * level * passed + noise * dark, axes=(1, 2), workers=1)
        mine = Comparison(Seen.of(_cut(lit), seen.noise), shape)
        at = mine.seen.at
        if mine.seen.enough:
            tested = mine.factor(at, Fitted())
            mean, deviation = at.told(tested, at.fitted(mine.factor(at, true, WHOLE)))
            off.append((at.gain(tested) - mean) / deviation)
    return float(np.sqrt(np.mean(np.square(off)))) if off else 1.0
