r"""A record parted in two: one part is shown to restorers, the other judges their pictures of it.

The noise of both is independent, given w of the record's own noise distribution:

    y₁ = y + a w,        y₂ = y - w / a        (Oliveira, Lei, Tibshirani, arXiv 2111.09447, 2021).

Every restorer sees the inner part of y₁ and makes a picture x̂ of it. With p any estimate of the whole scene, G a filter
that undoes the blur as far as it can be undone, and A = G H what it then passes,

    || A (x̂ - p) ||² - 2 < A (x̂ - p), G (y₂ - H p) >

has the expectation || A (x̂ - x) ||², the error in the true scene x, less one number that is the same for all: Stein's
unbiased risk, without its divergence (Stein, Ann. Statist. 9, 1135, 1981; Eldar, IEEE Trans. Signal Process. 57, 471,
2009, behind a blur). Its noise is that of y₂ alone, so that its covariance between pictures is known.

Notes:
    Behind a panel, much of a restored picture's error comes from light that its edges hide, and a filter that explains
    the record as if there were none looks best where it is worst. So the restorers see an inner part of which the
    record knows the surroundings. Light that reaches it from beyond these is taken for its own: of a dark scene at
    40 dB behind a random panel, it turns differences of a tenth of the error.
    G is a Wiener filter whose ε is the noise's variance. Frequencies that the panel does not pass are not judged.
    Pixels that a full well cut off are not judged, but their halo is, of which the record has too little: with a tenth
    of them, an error of the mean level counts a tenth too much or too little.
    The noise of an interpolated mosaic is taken for independent where its covariance is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.mosaic import interpolated, sampled
from maskfab.camera.record import Record
from maskfab.camera.restorers.dct import denoised
from maskfab.camera.restorers.restorer import Blur, Transfer
from maskfab.camera.restorers.wiener import Margin, prior, restore, wiener

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
        shown: the inner part of y₁.
        margin: of the whole record, mirrored at its edges.
        left: pixels at each edge that are not shown.
        inverse: G, at the margin's frequencies.
        passed: A, at the same.
        pilot: p, of the whole record.
        evidence: G (y₂ - H p), of the whole record.
        variance: of y₂, of the whole record.
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
        transfer, inverse_prior = blur.on(margin.shape), prior(margin.shape)
        calm = denoised(record)
        variance = record.noise.variance(calm)
        noise = _drawn(draw, variance, mosaic=record.interpolated)
        pilot = restore(margin.mirrored(calm), wiener(transfer, inverse_prior, _PILOT), margin)
        inverse = wiener(transfer, inverse_prior, float(variance.mean()))
        rest = record.values - noise / np.float32(_PARTING) - margin.blurred(margin.mirrored(pilot), transfer)
        evidence = margin.blurred(margin.mirrored(rest), inverse)
        below = np.nextafter(np.float32(record.ceiling), np.float32(0))
        first = np.where(record.clipped, record.values, np.minimum(record.values + np.float32(_PARTING) * noise, below))
        shown = Record(
            np.ascontiguousarray(_inner(first, left)),
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
            scene: light, [3, rows, columns].
            like: a record with that noise; full wells are not imagined.
            blur: that the scene is seen through.
            draw: of the noise.
            width: as in :meth:`of`.
        """
        margin, left = _frame(scene.shape, width)
        transfer = blur.on(margin.shape)
        seen = np.maximum(margin.blurred(margin.mirrored(scene), transfer), 0)
        variance = like.noise.variance(seen)
        noisy = _inner(seen + _drawn(draw, variance, mosaic=like.interpolated), left)
        shown = Record(np.ascontiguousarray(noisy), like.noise, interpolated=like.interpolated)
        inverse = wiener(transfer, prior(margin.shape), float(variance.mean()))
        none = np.zeros_like(scene)
        return cls(shown, margin, left, inverse, transfer * inverse, scene, none, none)

    def turned(self, picture: Singles) -> Singles:
        """p with a picture of what is shown in its place: the middle square, at most 512 pixels wide, transposed."""
        scene = self.pilot.copy()
        _inner(scene, self.left)[:] = picture
        rows, columns = scene.shape[1:]
        side = min(rows, columns, _IMAGINED)
        top, left = (rows - side) // 2, (columns - side) // 2
        return np.ascontiguousarray(scene[:, top : top + side, left : left + side].transpose(0, 2, 1))

    @property
    def known(self) -> Singles:
        """p where the record is shown."""
        return _inner(self.pilot, self.left)

    def seen(self, picture: Singles) -> Singles:
        """A (x̂ - p) of a picture of ``shown``."""
        # A full well says nothing of how much more there was: there, any light is as good.
        return self._filtered(np.where(self.shown.clipped, np.float32(0), picture - self.known), self.passed)

    def error(self, seen: Singles, weight: Weight) -> float:
        """Mean weighted squared error of a picture, from :meth:`seen`, less a number that is the same for all."""
        return float((weight * seen * (seen - 2 * _inner(self.evidence, self.left))).mean(dtype=np.float64))

    def covariance(self, seen: Sequence[Singles], weight: Weight) -> NDArray[np.float64]:
        """Of the noise in the errors of several pictures, apart from a number that is the same for all."""
        middle = sum(seen) / np.float32(len(seen))
        deviation = np.sqrt(_inner(self.variance, self.left))
        weighed = (self._filtered(weight * (each - middle), self.inverse.conj()) * deviation for each in seen)
        pulls = np.array([2 / each.size * each.ravel() for each in weighed])
        return np.asarray(pulls @ pulls.T, dtype=np.float64)

    def _filtered(self, inner: Singles, filtered: Transfer) -> Singles:
        whole = np.zeros_like(self.pilot)
        _inner(whole, self.left)[:] = inner
        return _inner(self.margin.blurred(self.margin.mirrored(whole), filtered), self.left)


def _frame(shape: tuple[int, ...], width: int) -> tuple[Margin, int]:
    _, rows, columns = shape
    return Margin((rows + 2 * width, columns + 2 * width), width), int(_SHARE * min(rows, columns))


def _drawn(draw: np.random.Generator, variance: Singles, *, mosaic: bool) -> Singles:
    noise = draw.standard_normal(variance.shape, dtype=np.float32) * np.sqrt(variance)
    return interpolated(sampled(noise)) if mosaic else noise


def _inner(picture: Singles, left: int) -> Singles:
    return picture[:, left:-left, left:-left]
