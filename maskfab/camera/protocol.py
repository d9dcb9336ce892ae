r"""Protocol F1: how good photographs are behind a design, compared fairly with another.

Every design sees the same scenes with light from outside the sensor, in real colours and noise for the light it lets
through, and is restored by the same filter, whose one constant ε is chosen for the design and the level on scenes kept
for that. No denoiser. Gains are paired, scene by scene.

Notes:
    Much of a difference between designs is made at the picture's edge, by halo that crosses it. Quote the inner frame,
    64 pixels trimmed, next to the whole one.
    ε is found by climbing on its grid from an estimate by Parseval's theorem: the best of all 15 if the mean PSNR has
    one peak.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from maskfab.camera.capture import ELECTRONS, capture, gain
from maskfab.camera.photographs import Photograph
from maskfab.camera.quality import Truth, inner, psnr, truth
from maskfab.camera.restore import Margin, prior, restore, spectral_error, wiener
from maskfab.camera.transfer import Laid, transfer_grid
from maskfab.errors import JobError

EPSILONS = tuple(float(e) for e in np.geomspace(0.002, 0.5, 15))
TRIM = 64
"""Pixels left out at each edge of the inner frame."""
LEVELS = (24, 32, 40)
_GREEN = slice(1, 2)
ASSUMED = "an opaque film and no glass, whatever the job says of its plate"
"""Assumptions of the photographs."""


@dataclass(frozen=True)
class Score:
    """One design, level and scene: PSNR in dB and SSIM of the whole frame and of the inner one, and the ε used.

    SSIM is NaN where nobody asked for it.
    """

    design: str
    level_db: int
    scene: str
    epsilon: float
    psnr: float
    ssim: float
    psnr_inner: float
    ssim_inner: float


@dataclass(frozen=True)
class Gain:
    """Mean gain of a design over another at one level, with its standard error (NaN for a single scene)."""

    design: str
    level_db: int
    psnr: float
    psnr_error: float
    psnr_inner: float
    psnr_inner_error: float
    ssim: float
    ssim_error: float


@dataclass(frozen=True)
class ScoreTable:
    """All scores, by design, level and scene."""

    scores: tuple[Score, ...]

    def gains(self, reference: str) -> tuple[Gain, ...]:
        """Paired gains of every other design over the reference.

        Raises:
            JobError: MF105 if there is no such design.
        """
        by = {(s.design, s.level_db, s.scene): s for s in self.scores}
        if not any(s.design == reference for s in self.scores):
            raise JobError(
                "MF105",
                f"no design is called {reference}",
                where="reference",
                cure="Give as reference the name of one of the designs",
            )
        found = []
        for design, level in dict.fromkeys((s.design, s.level_db) for s in self.scores if s.design != reference):
            pairs = [
                (s, by[reference, level, s.scene]) for s in self.scores if (s.design, s.level_db) == (design, level)
            ]
            whole = _mean_and_error([a.psnr - b.psnr for a, b in pairs])
            middle = _mean_and_error([a.psnr_inner - b.psnr_inner for a, b in pairs])
            likeness = _mean_and_error([a.ssim - b.ssim for a, b in pairs])
            found.append(Gain(design, level, *whole, *middle, *likeness))
        return tuple(found)


def evaluate(
    designs: Sequence[Laid],
    test: Sequence[Photograph],
    tuning: Sequence[Photograph],
    levels: Sequence[int] = LEVELS,
    *,
    ssim: bool = True,
    show: Callable[[Score, NDArray[np.float32]], None] | None = None,
) -> ScoreTable:
    """Score every design on every test scene at every level.

    Args:
        designs: with names of their own.
        test: scenes to score on.
        tuning: scenes to choose ε on; they may be test scenes, though that flatters by a few hundredths of a decibel.
        levels: signal-to-noise ratios of the published camera, dB; keys of :data:`maskfab.camera.capture.ELECTRONS`.
        ssim: score that too, which takes a third of the time.
        show: given every score with its restored picture, float32 [3, rows, columns] of the sensor, row 0 on top.

    Raises:
        JobError: MF105 without designs, levels or scenes, or for two of one name; MF104 for other levels, or a closed
            design; MF134 behind a camera of other than three wavelengths.
    """
    for what, names in (
        ("designs", [d.name for d in designs]),
        ("test scenes", [s.name for s in test]),
        ("tuning scenes", [s.name for s in tuning]),
        ("levels", list(map(str, levels))),
    ):
        if not names or len(set(names)) < len(names):
            problem = "some have one name" if names else "there are none"
            raise JobError("MF105", f"{what}: {problem}", where=what, cure="Give each once, with a name of its own")
    for level in levels:
        gain(level, 1.0)
    for design in designs:
        _require_light(design)
        _ = design.lattice.camera.colours_nm
    prepared = {id(s): _prepare(s) for s in (*tuning, *test)}
    likenesses = {id(s): truth(prepared[id(s)].true) for s in test} if ssim else {}
    scores: list[Score] = []
    for design in designs:
        seen = _Design(design, {p.margin.shape for p in prepared.values()})
        start = len(EPSILONS) // 2
        for level in sorted(levels):
            records = {id(s): seen.record(prepared[id(s)], level) for s in tuning}
            chosen, pictures = _best(seen, [(prepared[k], r) for k, r in records.items()], start)
            tuned, start = dict(zip(records, pictures, strict=True)), chosen
            for s in test:
                known = prepared[id(s)]
                restored = tuned.get(id(s))
                if restored is None:
                    restored = seen.restored(known, seen.record(known, level), EPSILONS[chosen])
                like = likenesses.get(id(s))
                scores.append(_score(seen.laid.name, known, restored, level, EPSILONS[chosen], like))
                if show is not None:
                    show(scores[-1], restored)
    return ScoreTable(tuple(scores))


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A scene, and its part on the sensor."""

    scene: Photograph
    margin: Margin
    true: NDArray[np.float32]

    @cached_property
    def green(self) -> NDArray[np.complex64]:
        """Spectrum of the true green picture, mirrored as a record is; [1, rows, half]."""
        return self.margin.mirrored(self.true[_GREEN])


def _prepare(scene: Photograph) -> _Prepared:
    rows, columns = scene.values.shape[1:]
    margin = Margin((rows, columns))
    return _Prepared(scene, margin, margin.sensor(scene.values))


def _require_light(design: Laid) -> None:
    """Refuse what passes nothing, before any photograph is looked at."""
    if not 0 < design.open_share <= 1:
        raise JobError(
            "MF104",
            f"the design passes {design.open_share:g} of the stop's light; it must be above 0 and at most 1",
            where=design.name,
            cure="Open some dots inside the stop",
        )


class _Design:
    """A design with its H for every size of scene."""

    def __init__(self, laid: Laid, shapes: set[tuple[int, int]]) -> None:
        self.laid = laid
        self.transfer = {shape: transfer_grid(shape, laid.lattice)(laid.pupil) for shape in shapes}
        self.prior = {shape: prior(shape) for shape in shapes}

    def record(self, known: _Prepared, level: int) -> NDArray[np.complex64]:
        electrons = gain(level, self.laid.open_share)
        blurred = known.margin.blurred(known.scene.spectrum, self.transfer[known.margin.shape])
        return known.margin.mirrored(capture(blurred, electrons, 1000 * known.scene.number + ELECTRONS[level]))

    def restored(self, known: _Prepared, record: NDArray[np.complex64], epsilon: float) -> NDArray[np.float32]:
        shape = known.margin.shape
        return restore(record, wiener(self.transfer[shape], self.prior[shape], epsilon), known.margin)

    def missed(self, known: _Prepared, record: NDArray[np.complex64], epsilon: float) -> float:
        """Squared error of the green picture with its mirrored margin, nothing clipped, in a unit of its own."""
        shape = known.margin.shape
        return spectral_error(record[_GREEN], known.green, self.transfer[shape][_GREEN], epsilon * self.prior[shape])


def _best(
    seen: _Design, records: list[tuple[_Prepared, NDArray[np.complex64]]], start: int
) -> tuple[int, list[NDArray[np.float32]]]:
    """Place of the best ε, looked for from where an estimate that takes no pictures peaks; and what it restores."""
    pictures: dict[int, list[NDArray[np.float32]]] = {}

    def estimate(k: int) -> float:
        return -sum(math.log(seen.missed(p, r, EPSILONS[k])) for p, r in records)

    def mean(k: int) -> float:
        # Those of three neighbours are all that a climb can still ask for.
        for passed in [j for j in pictures if abs(j - k) > 2]:
            del pictures[passed]
        pictures[k] = [seen.restored(p, r, EPSILONS[k]) for p, r in records]
        each = [psnr(picture, p.true) for picture, (p, _) in zip(pictures[k], records, strict=True)]
        return sum(each) / len(each)

    best = _climb(mean, _climb(estimate, start))
    return best, pictures[best]


def _climb(height: Callable[[int], float], start: int) -> int:
    """Place of an ε from which neither neighbour is higher, by steps to the better one; asks for no height twice."""
    known = cache(height)
    best, following = -1, start
    while following != best:
        best = following
        following = max((k for k in (best, best - 1, best + 1) if 0 <= k < len(EPSILONS)), key=known)
    return best


def _score(
    name: str, known: _Prepared, restored: NDArray[np.float32], level: int, epsilon: float, like: Truth | None
) -> Score:
    true, whole, middle = known.true, math.nan, math.nan
    if like is not None:
        likeness = like.ssim(restored)
        whole = float(likeness.mean(dtype=np.float64))
        middle = float(inner(likeness, TRIM - 5).mean(dtype=np.float64))
    return Score(
        name,
        level,
        known.scene.name,
        epsilon,
        psnr(restored, true),
        whole,
        psnr(inner(restored, TRIM), inner(true, TRIM)),
        middle,
    )


def _mean_and_error(values: list[float]) -> tuple[float, float]:
    mean = sum(values) / len(values)
    if len(values) < 2:
        return mean, math.nan
    return mean, math.sqrt(sum((v - mean) ** 2 for v in values) / (len(values) - 1) / len(values))
