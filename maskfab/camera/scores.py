"""Scores of restored photographs, and paired gains of designs over one of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from maskfab.camera.intervals import MeanDifference
from maskfab.errors import JobError


@dataclass(frozen=True)
class Score:
    """One design, level of light, scene and restorer.

    Attributes:
        design: its name.
        level_db: signal-to-noise ratio of white behind the published display.
        scene: its name.
        epsilon: strength of the restorer's prior.
        psnr: of the whole frame, dB.
        ssim: of the whole frame; NaN where nobody asked for it.
        psnr_inner, ssim_inner: of the inner frame.
        delta_e, delta_e_inner: mean colour difference of S-CIELAB, NaN likewise; about 2.3 is just noticeable.
        restorer: what restored it.
        chosen: restorer that was chosen, where ``restorer`` says that one was.
    """

    design: str
    level_db: float
    scene: str
    epsilon: float
    psnr: float
    ssim: float
    psnr_inner: float
    ssim_inner: float
    delta_e: float = math.nan
    delta_e_inner: float = math.nan
    restorer: str = "wiener"
    chosen: str = ""


@dataclass(frozen=True)
class Gain:
    """Mean gain of a design over another at one level behind one restorer: PSNR in dB, SSIM, and fall of S-CIELAB."""

    design: str
    level_db: float
    restorer: str
    psnr: MeanDifference
    psnr_inner: MeanDifference
    ssim: MeanDifference
    delta_e: MeanDifference


@dataclass(frozen=True)
class ScoreTable:
    """All scores, by design, level, restorer and scene."""

    scores: tuple[Score, ...]

    @cached_property
    def _by_case(self) -> dict[tuple[str, float, str, str], Score]:
        return {(each.design, each.level_db, each.restorer, each.scene): each for each in self.scores}

    def regret(self, chosen: Score) -> float:
        """Decibels by which the best restorer of the same photograph is better than the one that was chosen."""
        case = chosen.design, chosen.level_db, chosen.scene
        others = [each.psnr for each in self.scores if (each.design, each.level_db, each.scene) == case]
        return max(others) - chosen.psnr

    def winners(self, scores: Sequence[Score]) -> str:
        """The restorer of scores of one case; where each was chosen, how often, and by how much others were better."""
        chosen = Counter(score.chosen for score in scores if score.chosen)
        if not chosen:
            return scores[0].restorer
        regret = sum(map(self.regret, scores)) / len(scores)
        listed = ", ".join(f"{count} {name}" for name, count in chosen.items())
        return f"{scores[0].restorer}: {listed}; regret {regret:.2f} dB"

    def gains(self, reference: str) -> tuple[Gain, ...]:
        """Paired gains of every other design over the reference, behind the same restorer.

        Raises:
            JobError: MF105 if there is no such design.
        """
        if not any(each.design == reference for each in self.scores):
            raise JobError(
                "MF105",
                f"no design is called {reference}",
                where="reference",
                cure="Give as reference the name of one of the designs",
            )
        cases: dict[tuple[str, float, str], list[tuple[Score, Score]]] = {}
        for each in self.scores:
            if each.design != reference:
                pair = each, self._by_case[reference, each.level_db, each.restorer, each.scene]
                cases.setdefault((each.design, each.level_db, each.restorer), []).append(pair)
        return tuple(
            Gain(
                *case,
                MeanDifference.of([one.psnr - other.psnr for one, other in pairs]),
                MeanDifference.of([one.psnr_inner - other.psnr_inner for one, other in pairs]),
                MeanDifference.of([one.ssim - other.ssim for one, other in pairs]),
                MeanDifference.of([other.delta_e - one.delta_e for one, other in pairs]),
            )
            for case, pairs in cases.items()
        )
