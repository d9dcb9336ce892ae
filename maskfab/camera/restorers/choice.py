r"""The restorer that suits a photograph, chosen by the record alone.

What the record says of every restorer's error is unbiased, but noisy, and silent where the panel passes nothing
(:mod:`maskfab.camera.restorers.judge`). So the restorers are tried on an imagined record too: the mean of all their
pictures, transposed, is blurred by the same die and given the same noise, and the errors b of its restored pictures are
known, of which s at frequencies that are passed (a parametric bootstrap: Efron, Tibshirani, An introduction to the
bootstrap, 1993, 6.5). Transposed, for at frequencies that the panel hides the mean has what the restorers put there,
and would speak for whoever puts the same. The error e of a restorer is expected to be b, give or take a fifth, and the
record tells t of it, e - (b - s) with noise of covariance C, less a number that is the same for all. With differences D

    e = b + V Dᵀ (D (V + C) Dᵀ)⁻¹ D (t - s),        V = (b / 5)² on the diagonal,

is the mean of both by their precisions. The smallest wins, and restores the whole record.

Where light is coded before it is shown, errors are those of codes. What the record tells weighs every pixel by the
square of the code's slope at the mean of all x̂, of which y₂ knows nothing: an error in the dark shows, and is scored,
up to a hundred times as much as one in white.

Notes:
    Three photographs behind three dies at 24, 32 and 40 dB, regret in dB of the score against the best restorer's: by
    the record alone 0.10 in the mean and 1.11 at worst, by the imagined record alone 0.09 and 0.93, by both 0.03 and
    0.58. With the true error of what is looked at it is 0.02 and 0.58: the rest is at the edges. In what is looked at,
    over a hundred draws of the noise, it falls from 0.06 to 0.01 in the mean; in nine cases of three other scenes there
    is none either way. Scatters of 0.1 to 0.3 are alike.
    Full wells are not imagined.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.record import Record
from maskfab.camera.restorers.judge import Judge, Weight
from maskfab.camera.restorers.restorer import Blur, Restorer
from maskfab.camera.restorers.wiener import MARGIN
from maskfab.errors import JobError
from maskfab.optics.numbers.colour import code_of_light

Tried = tuple[Restorer, float]
"""A restorer at one strength."""

_LARGEST = 1024
"""Pixels along a side of what is looked at, from the record's middle."""
_SCATTER = 0.2
"""Of an error, by how much that of an imagined record is off it, beyond what is the same for all."""
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
        expected: the same of the whole error, by the record and the imagined one, by which the restorer won.
    """

    name: str
    epsilon: float
    picture: Singles
    criteria: Mapping[str, float]
    expected: Mapping[str, float]


@dataclass(frozen=True)
class Choice:
    """Restores every photograph by the best of several restorers.

    Attributes:
        restorers: with names of their own; the first of equal ones wins.
        seed: of the noise that parts the record, and of the imagined record's.
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
        tried = [(restorer, step * epsilons[restorer.name]) for restorer in self.restorers for step in self.steps]
        best, criteria, expected = 0, dict[str, float](), dict[str, float]()
        if len(tried) > 1:
            told, errors = self._judged(_middle(record), blur, tried)
            best, criteria, expected = int(np.argmin(errors)), _least(tried, told), _least(tried, errors)
        winner, epsilon = tried[best]
        return Chosen(winner.name, epsilon, winner.prepare(record, blur)(epsilon), criteria, expected)

    def _judged(self, record: Record, blur: Blur, tried: Sequence[Tried]) -> tuple[Floats, Floats]:
        """Error of each that is tried, as the record tells it and as it is expected to be."""
        draw = np.random.default_rng(self.seed)
        judge = Judge.of(record, blur, draw, self.width)
        pictures = _restored(judge.shown, blur, tried)
        weight = self._weight(pictures)
        seen = [judge.seen(each) for each in pictures]
        told = np.array([judge.error(each, weight) for each in seen])
        noise = judge.covariance(seen, weight)
        mean = np.asarray(sum(pictures) / np.float32(len(pictures)))
        imagined, passed = self._imagined(
            Judge.imagined(judge.turned(mean), record, blur, draw, self.width), blur, tried
        )
        return told, expected_errors(told, noise, imagined, passed)

    def _imagined(self, judge: Judge, blur: Blur, tried: Sequence[Tried]) -> tuple[Floats, Floats]:
        """Error of an imagined record's pictures, and what of it is passed."""
        pictures = _restored(judge.shown, blur, tried)
        weight, shown = self._weight(pictures), code_of_light if self.coded else np.asarray
        errors = [np.square(shown(each) - shown(judge.known)).mean(dtype=np.float64) for each in pictures]
        return np.array(errors), np.array([judge.error(judge.seen(each), weight) for each in pictures])

    def _weight(self, pictures: Sequence[Singles]) -> Weight:
        return _steepness(pictures) if self.coded else np.float32(1)


def _restored(record: Record, blur: Blur, tried: Sequence[Tried]) -> list[Singles]:
    """Pictures of a record; a restorer's strengths follow each other, so that it is prepared once."""
    groups = itertools.groupby(tried, key=operator.itemgetter(0))
    prepared = ((restorer.prepare(record, blur), each) for restorer, each in groups)
    return [restored(epsilon) for restored, each in prepared for _, epsilon in each]


def _least(tried: Sequence[Tried], errors: Floats) -> dict[str, float]:
    """For every restorer's name, the least of its strengths' errors."""
    found: dict[str, float] = {}
    for (restorer, _), error in zip(tried, errors.tolist(), strict=True):
        found[restorer.name] = min(error, found.get(restorer.name, error))
    return found


def expected_errors(told: Floats, noise: Floats, imagined: Floats, passed: Floats) -> Floats:
    """The mean of errors of which one imagined record and the record's own noisy differences are known.

    Args:
        told: by the record of what is passed, less a number that is the same for all, [n].
        noise: covariance of these, [n, n].
        imagined: errors of the imagined record, [n].
        passed: what of these is passed, [n].
    """
    differ = np.eye(len(told))[:-1] - np.eye(len(told))[-1]
    before = np.diag(np.square(_SCATTER * imagined))
    known = np.linalg.pinv(differ @ (before + noise) @ differ.T, hermitian=True)
    return np.asarray(imagined + before @ differ.T @ known @ differ @ (told - passed))


def _middle(record: Record) -> Record:
    """At most 1024 x 1024 pixels of a record, so that a large one is not restored many times."""
    rows, columns = record.values.shape[1:]
    top, left = max(0, rows - _LARGEST) // 2, max(0, columns - _LARGEST) // 2
    return replace(record, values=record.values[:, top : top + _LARGEST, left : left + _LARGEST])


def _steepness(pictures: Sequence[Singles]) -> Singles:
    """The square of the slope of sRGB code values at the mean of all pictures, within 0 to 1."""
    mean = np.asarray(sum(pictures) / np.float32(len(pictures)), dtype=np.float32)
    low, high = np.maximum(mean - np.float32(_STEP), 0), np.minimum(mean + np.float32(_STEP), 1)
    return np.asarray(np.square((code_of_light(high) - code_of_light(low)) / (high - low)))
