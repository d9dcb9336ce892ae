r"""The restorer that suits a photograph, chosen by the record alone.

The record y is parted in two whose noise is independent, given w of the noise's own distribution:

    y₁ = y + a w,        y₂ = y - w / a        (Oliveira, Lei, Tibshirani, arXiv 2111.09447, 2021).

Every restorer sees the inner part of y₁ and makes a picture x̂ of it. With p any estimate of the whole scene, G a filter
that undoes the blur as far as it can be undone, and A = G H what it then passes,

    || A (x̂ - p) ||² - 2 < A (x̂ - p), G (y₂ - H p) >

has the expectation || A (x̂ - x) ||², the error in the true scene x, less one number that is the same for all: Stein's
unbiased risk, without its divergence (Stein, Ann. Statist. 9, 1135, 1981; Eldar, IEEE Trans. Signal Process. 57, 471,
2009, behind a blur). The smallest wins, and restores the whole record.

Where light is coded before it is shown, both products weigh every pixel by the square of the code's slope at the mean
of all x̂, of which y₂ knows nothing: an error in the dark shows, and is scored, up to a hundred times as much as one in
white. For three photographs behind three dies at three levels this takes the mean regret from 0.50 to 0.10 dB.

Notes:
    Behind a panel, much of a restored picture's error comes from light that its edges hide, and a filter that explains
    the record as if there were none looks best where it is worst. So the restorers see an inner part of which the
    record knows the surroundings. Halo that reaches from beyond these goes unseen.
    G is a Wiener filter whose ε is the noise's variance. Frequencies that the panel does not pass are not judged;
    there, nothing in the record speaks for any restorer. Behind stripes total variation lets edges go on across the
    gaps of the transfer, which gains 1 to 5 dB and counts for nothing here.
    Pixels that a full well cut off are not judged, but their halo is, of which the record has too little: with a tenth
    of them, an error of the mean level counts a tenth too much or too little.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.camera.mosaic import interpolated, sampled
from maskfab.camera.record import Record
from maskfab.camera.restorers.dct import denoised
from maskfab.camera.restorers.restorer import Blur, Restorer, Transfer
from maskfab.camera.restorers.wiener import MARGIN, Margin, prior, restore, wiener
from maskfab.errors import JobError
from maskfab.optics.numbers.colour import code_of_light

Singles = NDArray[np.float32]

_PARTING = 0.5
"""a: the restorers see 1 + a² of the noise, what judges them 1 + 1/a²."""
_SHARE = 3 / 16
"""Of the record's shorter side, what is left out at each edge."""
_LARGEST = 1024
"""Pixels along a side of what is looked at, from the record's middle."""
_PILOT = 0.01
"""ε of p."""
_STEP = 0.02
"""Of light, to either side, over which a code's slope is taken: about the errors that are judged."""


@dataclass(frozen=True, eq=False)
class Chosen:
    """A restored photograph.

    Attributes:
        name: of the restorer that won.
        epsilon: its strength.
        picture: float32 [3, rows, columns] within 0 to 1.
        criteria: for every restorer, at the best of its strengths, the mean squared error where it was judged, of
            light or of code values, white is 1, less the same unknown number for all; empty where there was nothing to
            choose.
    """

    name: str
    epsilon: float
    picture: Singles
    criteria: Mapping[str, float]


@dataclass(frozen=True)
class Choice:
    """Restores every photograph by the best of several restorers.

    Attributes:
        restorers: with names of their own; the first of equal ones wins.
        seed: of the noise that parts the record.
        width: pixels by which the record is mirrored beyond its edges to judge.
        steps: times the ε that is given, those that are tried.
        coded: errors are those of sRGB code values, as where light is coded before it is shown; otherwise of light.
    """

    restorers: Sequence[Restorer]
    seed: int = 0
    width: int = MARGIN
    steps: tuple[float, ...] = (1.0,)
    coded: bool = False

    def restore(self, record: Record, blur: Blur, epsilons: Mapping[str, float]) -> Chosen:
        """Judge every restorer on a part of the record, and restore all of it by the best.

        Args:
            record: of at least 8 pixels along a side.
            blur: that it was taken through.
            epsilons: for every restorer's name, its strength.

        Raises:
            JobError: MF105 without restorers, for two of one name, or one without an ε; MF121 for a smaller record.
        """
        names = [restorer.name for restorer in self.restorers]
        if not names or len(set(names)) < len(names) or not set(names) <= set(epsilons):
            raise JobError(
                "MF105",
                f"restorers {', '.join(names) or 'none'} with strengths for {', '.join(epsilons) or 'none'}",
                where="restorers",
                cure="Name each restorer once, with a strength",
            )
        tried = {r.name: tuple(step * epsilons[r.name] for step in self.steps) for r in self.restorers}
        winner, epsilon, criteria = self.restorers[0], tried[names[0]][0], dict[str, float]()
        if len(self.restorers) * len(self.steps) > 1:
            judge = _judge(_middle(record), blur, np.random.default_rng(self.seed), self.width)
            prepared = ((r.name, r.prepare(judge.shown, blur)) for r in self.restorers)
            pictures = {name: [restored(e) for e in tried[name]] for name, restored in prepared}
            weight = _seen(pictures.values()) if self.coded else np.float32(1)
            errors = {name: [judge.error(each, weight) for each in made] for name, made in pictures.items()}
            criteria = {name: min(each) for name, each in errors.items()}
            winner = min(self.restorers, key=lambda r: criteria[r.name])
            epsilon = tried[winner.name][errors[winner.name].index(criteria[winner.name])]
        return Chosen(winner.name, epsilon, winner.prepare(record, blur)(epsilon), criteria)


@dataclass(frozen=True, eq=False)
class _Judge:
    """A part of a record for restorers, and the rest that judges their pictures of it; all are [3, rows, columns].

    Attributes:
        shown: the inner part of y₁.
        margin: of the whole record, mirrored at its edges.
        left: pixels at each edge that are not shown.
        passed: A, at the margin's frequencies.
        pilot: p, of the whole record.
        evidence: G (y₂ - H p), of the whole record.
    """

    shown: Record
    margin: Margin
    left: int
    passed: Transfer
    pilot: Singles
    evidence: Singles

    def error(self, picture: Singles, weight: Singles | np.float32) -> float:
        """Mean weighted squared error of a picture of ``shown``, less a number that is the same for all."""
        change = np.zeros_like(self.pilot)
        differing = picture - _inner(self.pilot, self.left)
        # A full well says nothing of how much more there was: there, any light is as good.
        _inner(change, self.left)[:] = np.where(self.shown.clipped, np.float32(0), differing)
        seen = _inner(self.margin.blurred(self.margin.mirrored(change), self.passed), self.left)
        known = _inner(self.evidence, self.left)
        return float((weight * seen * (seen - 2 * known)).mean(dtype=np.float64))


def _judge(record: Record, blur: Blur, draw: np.random.Generator, width: int) -> _Judge:
    rows, columns = record.values.shape[1:]
    margin = Margin((rows + 2 * width, columns + 2 * width), width)
    transfer, inverse_prior = blur.on(margin.shape), prior(margin.shape)
    calm = denoised(record)
    variance = record.noise.variance(calm)
    noise = draw.standard_normal(calm.shape, dtype=np.float32) * np.sqrt(variance)
    if record.interpolated:
        noise = interpolated(sampled(noise))
    pilot = restore(margin.mirrored(calm), wiener(transfer, inverse_prior, _PILOT), margin)
    inverse = wiener(transfer, inverse_prior, float(variance.mean()))
    rest = record.values - noise / np.float32(_PARTING) - margin.blurred(margin.mirrored(pilot), transfer)
    evidence = margin.blurred(margin.mirrored(rest), inverse)
    left = int(_SHARE * min(rows, columns))
    below = np.nextafter(np.float32(record.ceiling), np.float32(0))
    first = np.where(record.clipped, record.values, np.minimum(record.values + np.float32(_PARTING) * noise, below))
    shown = Record(
        np.ascontiguousarray(_inner(first, left)),
        record.noise.times(1 + _PARTING**2),
        record.ceiling,
        record.interpolated,
    )
    return _Judge(shown, margin, left, transfer * inverse, pilot, evidence)


def _middle(record: Record) -> Record:
    """At most 1024 x 1024 pixels of a record, so that a large one is not restored many times."""
    rows, columns = record.values.shape[1:]
    top, left = max(0, rows - _LARGEST) // 2, max(0, columns - _LARGEST) // 2
    return replace(record, values=record.values[:, top : top + _LARGEST, left : left + _LARGEST])


def _seen(pictures: Iterable[Sequence[Singles]]) -> Singles:
    """The square of the slope of sRGB code values at the mean of all pictures, within 0 to 1."""
    each = [picture for made in pictures for picture in made]
    mean = np.asarray(sum(each) / np.float32(len(each)), dtype=np.float32)
    low, high = np.maximum(mean - np.float32(_STEP), 0), np.minimum(mean + np.float32(_STEP), 1)
    return np.asarray(np.square((code_of_light(high) - code_of_light(low)) / (high - low)))


def _inner(picture: Singles, left: int) -> Singles:
    return picture[:, left:-left, left:-left]
