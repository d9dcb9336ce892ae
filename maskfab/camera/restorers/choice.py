"""The restorers that suit a photograph, and their strengths, chosen by the record alone: no truth is known.

A record is parted in two: one part is shown to restorers, the other judges their pictures of it. The noise of both is
independent, given w of the record's own noise distribution:

    y₁ = y + a w,        y₂ = y - w / a        (Oliveira, Lei, Tibshirani, arXiv 2111.09447, 2021).

Every restorer sees the inner part of y₁ and makes a picture x̂ of it. With p any estimate of the whole scene, G a
filter that undoes the blur as far as it can be undone, and A = G H what it then passes,

    || A (x̂ - p) ||² - 2 < A (x̂ - p), G (y₂ - H p) >

has the expectation || A (x̂ - x) ||², the error in the true scene x, less one number that is the same for all: Stein's
unbiased risk, without its divergence (Stein, Ann. Statist. 9, 1135, 1981; Eldar, IEEE Trans. Signal Process. 57, 471,
2009, behind a blur). Its noise is that of y₂ alone, so that its covariance between pictures is known.

What the record says is unbiased, but noisy, and silent where the panel passes nothing. So the restorers are tried on an
imagined record too: the mean of all their pictures, transposed, is blurred by the same die and given the same noise,
and the errors b of its restored pictures are known, of which s at frequencies that are passed (a parametric bootstrap:
Efron, Tibshirani, An introduction to the bootstrap, 1993, 6.5). Transposed, for at frequencies that the panel hides the
mean has what the restorers put there, and would speak for whoever puts the same. The error e of a restorer is expected
to be b, give or take a fifth, and the record tells t of it, e - (b - s) with noise of covariance C, less a number that
is the same for all. With differences D

    e = b + V Dᵀ (D (V + C) Dᵀ)⁻¹ D (t - s),        V = (b / 5)² on the diagonal,

is the mean of both by their precisions. Of two pictures whose mean square apart is d, the mean with shares s and 1 - s
has the error s e₁ + (1 - s) e₂ - s (1 - s) d (Krogh, Vedelsby, NIPS 7, 231, 1995). The least of all pairs of restorers
restores the whole record, or one restorer alone where no mean is better. A mean also hedges where the errors are wrong.

Where light is coded before it is shown, errors are those of codes. What the record tells weighs every pixel by the
square of the code's slope at the mean of all x̂, of which y₂ knows nothing: an error in the dark shows, and is scored,
up to a hundred times as much as one in white.

The strength is first looked for with the Wiener filter on a grid of seven decades, which costs little; the others are
tried at it and beside it, for one ε is about right for all.

Notes:
    Behind a panel, much of a restored picture's error comes from light that its edges hide, and a filter that explains
    the record as if there were none looks best where it is worst. So the restorers see an inner part of which the
    record knows the surroundings, and p solves for the light beyond these, as small gradients do.
    G is a Wiener filter whose ε is the noise's variance. Frequencies that the panel does not pass are not judged.
    Pixels that a full well cut off are not judged, but their halo is, of which the record has too little: with a tenth
    of them, an error of the mean level counts a tenth too much or too little. Full wells are not imagined.
    The noise of an interpolated mosaic is taken for independent where its covariance is computed.
    As ``make bench`` has it, three photographs of these at 32 dB in light with tuned strengths, behind a T-OLED and a
    bar: -0.06 in the mean (-0.13 to 0.05) and 0.28 at worst.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.imaging import MARGIN, Blur, Margin, Transfer
from maskfab.camera.record import Record, Restorer, interpolated, sampled
from maskfab.camera.restorers.dct import denoised
from maskfab.camera.restorers.least_squares import Smooth, on_sensor
from maskfab.camera.restorers.wiener import Wiener, prior, wiener
from maskfab.camera.scores import inner
from maskfab.optics.colour import code_of_light, light_of_code

Weight = Singles | np.float32

_PARTING = 0.5
"""a: the restorers see 1 + a² of the noise, what judges them 1 + 1/a²."""
_SHARE = 3 / 16
"""Of the record's shorter side, what is left out at each edge."""
_PILOT = 0.01
"""ε of p."""
_IMAGINED = 512
"""Pixels along a side of an imagined record, at most."""


@dataclass(frozen=True, eq=False)
class Judge:
    """A part of a record for restorers, and the rest that judges their pictures of it; all are [3, rows, columns].

    Attributes:
        pilot: p, of the whole record.
        evidence: G (y₂ - H p), of the whole record.
    """

    shown: Record
    margin: Margin
    left: int
    inverse: Transfer
    passed: Transfer
    pilot: Singles
    evidence: Singles
    variance: Singles

    @classmethod
    def of(cls, record: Record, blur: Blur, draw: np.random.Generator, width: int) -> Judge:
        """Part a record; ``width`` are the pixels by which it is mirrored beyond its edges."""
        margin, left = _frame(record.values.shape, width)
        calm = denoised(record)
        variance = record.noise.variance(calm)
        noise = _drawn(draw, variance, mosaic=record.interpolated)
        problem = Smooth.of(replace(record, values=np.where(record.clipped, record.values, calm)), blur, width)
        scene, transfer = problem.solve(_PILOT), problem.seen.transfer
        pilot = on_sensor(margin, scene)
        inverse = wiener(transfer, problem.prior, float(variance.mean()))
        rest = record.values - noise / np.float32(_PARTING) - margin.blurred(scene, transfer)
        evidence = margin.blurred(margin.mirrored(rest), inverse)
        below = np.nextafter(np.float32(record.ceiling), np.float32(0))
        first = np.where(record.clipped, record.values, np.minimum(record.values + np.float32(_PARTING) * noise, below))
        shown = Record(
            np.ascontiguousarray(inner(first, left)),
            record.noise.times(1 + _PARTING**2),
            record.ceiling,
            record.interpolated,
        )
        judging = np.float32(1 + 1 / _PARTING**2) * variance
        return cls(shown, margin, left, inverse, transfer * inverse, pilot, evidence, judging)

    @classmethod
    def imagined(cls, scene: Singles, like: Record, blur: Blur, draw: np.random.Generator, width: int) -> Judge:
        """A record of a scene that is known, as p, with the noise of another: its evidence is nothing but right.

        Args:
            like: a record with that noise; full wells are not imagined.
        """
        margin, left = _frame(scene.shape, width)
        transfer = blur.on(margin.shape)
        seen = np.maximum(margin.blurred(margin.mirrored(scene), transfer), 0)
        variance = like.noise.variance(seen)
        noisy = inner(seen + _drawn(draw, variance, mosaic=like.interpolated), left)
        shown = Record(np.ascontiguousarray(noisy), like.noise, interpolated=like.interpolated)
        inverse = wiener(transfer, prior(margin.shape), float(variance.mean()))
        none = np.zeros_like(scene)
        return cls(shown, margin, left, inverse, transfer * inverse, scene, none, none)

    def turned(self, picture: Singles) -> Singles:
        """p with a picture of what is shown in its place: the middle square, at most 512 pixels wide, transposed."""
        scene = np.clip(self.pilot, 0, 1)
        inner(scene, self.left)[:] = picture
        rows, columns = scene.shape[1:]
        side = min(rows, columns, _IMAGINED)
        top, left = (rows - side) // 2, (columns - side) // 2
        return np.ascontiguousarray(scene[:, top : top + side, left : left + side].transpose(0, 2, 1))

    @property
    def known(self) -> Singles:
        """p where the record is shown."""
        return inner(self.pilot, self.left)

    def seen(self, picture: Singles) -> Singles:
        """A (x̂ - p) of a picture of ``shown``."""
        # A full well says nothing of how much more there was: there, any light is as good.
        return self._filtered(np.where(self.shown.clipped, np.float32(0), picture - self.known), self.passed)

    def error(self, seen: Singles, weight: Weight) -> float:
        """Mean weighted squared error of a picture, from :meth:`seen`, less a number that is the same for all."""
        return float((weight * seen * (seen - 2 * inner(self.evidence, self.left))).mean(dtype=np.float64))

    def covariance(self, seen: Sequence[Singles], weight: Weight) -> NDArray[np.float64]:
        """Covariance of the noise in the errors of several pictures, apart from a number that is the same for all."""
        middle = sum(seen) / np.float32(len(seen))
        deviation = np.sqrt(inner(self.variance, self.left))
        weighed = (self._filtered(weight * (picture - middle), self.inverse.conj()) * deviation for picture in seen)
        pulls = np.array([2 / picture.size * picture.ravel() for picture in weighed])
        return np.asarray(pulls @ pulls.T, dtype=np.float64)

    def _filtered(self, part: Singles, filtered: Transfer) -> Singles:
        whole = np.zeros_like(self.pilot)
        inner(whole, self.left)[:] = part
        return inner(self.margin.blurred(self.margin.mirrored(whole), filtered), self.left)


def _frame(shape: tuple[int, ...], width: int) -> tuple[Margin, int]:
    _, rows, columns = shape
    return Margin((rows + 2 * width, columns + 2 * width), width), int(_SHARE * min(rows, columns))


def _drawn(draw: np.random.Generator, variance: Singles, *, mosaic: bool) -> Singles:
    noise = draw.standard_normal(variance.shape, dtype=np.float32) * np.sqrt(variance)
    return interpolated(sampled(noise)) if mosaic else noise


Tried = tuple[Restorer, float]
"""A restorer at one strength."""

_LARGEST = 1024
"""Pixels along a side of what is looked at, from the record's middle; half of it where strength alone is chosen."""
_SCATTER = 0.2
"""Of an error, by how much that of an imagined record is off it, beyond what is the same for all."""
_STEP = 0.02
"""Of light, to either side, over which a code's slope is taken: about the errors that are judged."""


@dataclass(frozen=True, eq=False)
class Chosen:
    """A restored photograph.

    Attributes:
        picture: float32 [3, rows, columns] within 0 to 1.
        criteria: for every restorer, at the best of its strengths, the mean squared error where it was judged, of
            light or of code values, white is 1, less the same unknown number for all; empty where there was nothing to
            choose.
        expected: the same of the whole error, by the record and the imagined one, from which shares follow.
    """

    name: str
    epsilon: float
    picture: Singles
    criteria: Mapping[str, float]
    expected: Mapping[str, float]
    shares: Mapping[str, float] = field(default_factory=dict)

    @property
    def makers(self) -> str:
        """Restorers whose pictures it is made of, the larger share first."""
        if len(self.shares) < 2:
            return self.name
        ordered = sorted(self.shares.items(), key=lambda named: -named[1])
        return " and ".join(f"{100 * share:.0f} % {name}" for name, share in ordered)


@dataclass(frozen=True)
class Choice:
    """Restores every photograph by the best of several restorers.

    Attributes:
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
        """
        tried = [(restorer, step * epsilons[restorer.name]) for restorer in self.restorers for step in self.steps]
        shares, criteria, expected = {0: 1.0}, dict[str, float](), dict[str, float]()
        if len(tried) > 1:
            by_halves, errors, apart = self._judged(
                _middle(record, _LARGEST if len(self.restorers) > 1 else _LARGEST // 2), blur, tried
            )
            shares, criteria, expected = mixed(errors, apart, tried), _least(tried, by_halves), _least(tried, errors)
        pictures = {each: tried[each][0].prepare(record, blur)(tried[each][1]) for each in shares}
        first = max(shares, key=shares.__getitem__)
        picture = pictures[first]
        if len(shares) > 1:
            scored = sum(np.float32(share) * self._scored(pictures[each]) for each, share in shares.items())
            picture = light_of_code(np.asarray(scored)) if self.coded else np.asarray(scored)
        (winner, epsilon), named = tried[first], {tried[each][0].name: share for each, share in shares.items()}
        return Chosen(winner.name, epsilon, picture, criteria, expected, named)

    def _scored(self, picture: Singles) -> Singles:
        return code_of_light(picture) if self.coded else picture

    def _judged(self, record: Record, blur: Blur, tried: Sequence[Tried]) -> tuple[Floats, Floats, Floats]:
        """Errors of all that are tried, as the record tells them and as expected, and mean squares between pictures."""
        draw = np.random.default_rng(self.seed)
        judge = Judge.of(record, blur, draw, self.width)
        pictures = _restored(judge.shown, blur, tried)
        weight = self._weight(pictures)
        seen = [judge.seen(picture) for picture in pictures]
        by_halves = np.array([judge.error(passed, weight) for passed in seen])
        noise = judge.covariance(seen, weight)
        scored = np.array([self._scored(picture).ravel() for picture in pictures])
        apart = np.array([np.square(scored - each).mean(axis=1, dtype=np.float64) for each in scored])
        mean = np.asarray(sum(pictures) / np.float32(len(pictures)))
        # Of an imagined record errors are known, and what of them is passed.
        judge = Judge.imagined(judge.turned(mean), record, blur, draw, self.width)
        pictures = _restored(judge.shown, blur, tried)
        weight, known = self._weight(pictures), self._scored(judge.known)
        imagined = [np.square(self._scored(picture) - known).mean(dtype=np.float64) for picture in pictures]
        passed = [judge.error(judge.seen(picture), weight) for picture in pictures]
        return by_halves, expected_errors(by_halves, noise, np.array(imagined), np.array(passed)), apart

    def _weight(self, pictures: Sequence[Singles]) -> Weight:
        """Weight of squared errors: of codes the square of their slope at the mean of all pictures, within 0 to 1."""
        if not self.coded:
            return np.float32(1)
        mean = np.asarray(sum(pictures) / np.float32(len(pictures)), dtype=np.float32)
        low, high = np.maximum(mean - np.float32(_STEP), 0), np.minimum(mean + np.float32(_STEP), 1)
        return np.asarray(np.square((code_of_light(high) - code_of_light(low)) / (high - low)))


COUNTED = 0.5
"""Of what pictures of a part are apart: those of the whole record, whose surroundings are farther off, are less so."""


def mixed(errors: Floats, apart: Floats, tried: Sequence[Tried]) -> dict[int, float]:
    """Shares of the one picture, or of the two by different restorers, of which the mean's error is least.

    Args:
        apart: mean squares of the differences between their pictures, [n, n].
    """
    first = int(np.argmin(errors))
    least, shares = float(errors[first]), {first: 1.0}
    for one, other in itertools.combinations(range(len(tried)), 2):
        square = COUNTED * float(apart[one, other])
        if square <= abs(errors[one] - errors[other]) or tried[one][0] is tried[other][0]:
            continue  # the better one alone is best, or nearly all that they differ in is strength
        share = 0.5 + float(errors[other] - errors[one]) / (2 * square)
        error = share * errors[one] + (1 - share) * errors[other] - share * (1 - share) * square
        if error < least:
            least, shares = float(error), {one: share, other: 1 - share}
    return shares


def _restored(record: Record, blur: Blur, tried: Sequence[Tried]) -> list[Singles]:
    """Pictures of a record; a restorer's strengths follow each other, so that it is prepared once."""
    groups = itertools.groupby(tried, key=operator.itemgetter(0))
    prepared = ((restorer.prepare(record, blur), group) for restorer, group in groups)
    return [restored(epsilon) for restored, group in prepared for _, epsilon in group]


def _least(tried: Sequence[Tried], errors: Floats) -> dict[str, float]:
    least: dict[str, float] = {}
    for (restorer, _), error in zip(tried, errors.tolist(), strict=True):
        least[restorer.name] = min(error, least.get(restorer.name, error))
    return least


def expected_errors(told: Floats, noise: Floats, imagined: Floats, passed: Floats) -> Floats:
    """The mean of errors of which one imagined record and the record's own noisy differences are known.

    Args:
        told: by the record of what is passed, less a number that is the same for all, [n].
        noise: covariance of these, [n, n].
    """
    differ = np.eye(len(told))[:-1] - np.eye(len(told))[-1]
    before = np.diag(np.square(_SCATTER * imagined))
    precision = np.linalg.pinv(differ @ (before + noise) @ differ.T, hermitian=True)
    return np.asarray(imagined + before @ differ.T @ precision @ differ @ (told - passed))


def _middle(record: Record, most: int) -> Record:
    """At most so many pixels along a side of a record, so that a large one is not restored many times."""
    rows, columns = record.values.shape[1:]
    top, left = max(0, rows - most) // 2, max(0, columns - most) // 2
    return replace(record, values=record.values[:, top : top + most, left : left + most])


GRID = tuple(float(each) for each in np.geomspace(1e-5, 1e2, 15))
_BESIDE = (0.5, 1.0, 2.0)


def restored(
    record: Record,
    blur: Blur,
    restorers: Sequence[Restorer],
    epsilon: float | None = None,
    least: float = 0.0,
    *,
    known: bool = False,
) -> Chosen:
    """A record restored by the best of several restorers at the best of several strengths.

    Args:
        record: of at least 128 pixels along a side.
        epsilon: strength of all; None for the one that the record speaks for.
        least: of the strengths to begin from, as a blur that may be another than is said leaves no smaller one.
        known: whether that is about the strength, so that none is looked for.
    """
    if epsilon is not None:
        return Choice(restorers, coded=True).restore(record, blur, {restorer.name: epsilon for restorer in restorers})
    epsilon = least
    if not known:
        first = Wiener()
        steps = (*(step for step in GRID if step > least), *((least,) if least > 0 else ()))
        epsilon = Choice((first,), steps=steps, coded=True).restore(record, blur, {first.name: 1.0}).epsilon
    strengths = {restorer.name: epsilon for restorer in restorers}
    return Choice(restorers, steps=_BESIDE, coded=True).restore(record, blur, strengths)
