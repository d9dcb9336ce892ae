"""Whether a die is as drawn: ACCEPT, REJECT or CANNOT TELL, why, what to do next, and the sentences that go with it.

Widths are held against the tolerance that the job orders, else that of its mask house; where nobody states one, against
what the job says of them. An interval of 99.9 % decides: one of 95 % would be wrong of every fortieth die at a limit.
Where the frames are not explained, or not which die this is, no finding is stated: what the fit says stands under "if".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from maskfab.camera.blur import STANDS, stand_words
from maskfab.camera.inspection.bench_words import bench_sentences, by_error
from maskfab.camera.inspection.causes import Explanation
from maskfab.camera.inspection.costs import ALL, TERM_NAMES, Cost, disagreement
from maskfab.camera.inspection.diagnosis import NAMED, Cause, Suspect, deciding_frame
from maskfab.camera.inspection.die_image import BIAS
from maskfab.camera.inspection.fit import Fit
from maskfab.camera.inspection.identity import Hypothesis, Identified
from maskfab.camera.scores import NORMAL_95
from maskfab.job.shop import Shop

SURE = 3.2905
"""Standard errors to either side that hold 99.9 % of a normal number."""


_VAGUE = 0.05
"""Share of a feature's width, beyond which an interval that holds what was drawn says nothing of it."""


@dataclass(frozen=True)
class Promise:
    """Of the job and of the house that it names.

    Attributes:
        bias_um: by which clear features are wider than drawn, as [process] of the job states it.
        ordered_um: tolerance of widths that [order.cd] of the job states; None where it does not.
    """

    bias_um: float = 0.0
    shop: Shop | None = None
    ordered_um: float | None = None

    def tolerance_um(self, width_um: float) -> float | None:
        """Largest deviation from the drawn width that is ordered or promised; None where nobody states any."""
        if self.ordered_um is not None:
            return self.ordered_um
        if self.shop is None:
            return None
        made = self.shop.order.default.cd
        if made is not None and made.tolerance is not None:
            return made.tolerance
        return self.shop.tolerance.of_width(width_um)

    def kept(self, width_um: float, bias_um: float, half_um: float) -> bool | None:
        """Whether a bias with its interval lies within the tolerance; None where it may lie on either side.

        Without a tolerance that is whether the bias is what the job states, within an interval that is not vague.
        """
        most = self.tolerance_um(width_um)
        if most is None:
            return None if half_um > _VAGUE * width_um else abs(bias_um - self.bias_um) <= half_um
        if abs(abs(bias_um) - most) < half_um:
            return None
        return abs(bias_um) < most

    def words(self, width_um: float) -> str:
        """The tolerance, or what the job says where nobody states one, in words."""
        most = self.tolerance_um(width_um)
        if most is None:
            why = "the job names no mask house" if self.shop is None else f"{self.shop.title} publishes no CD tolerance"
            return f"the error of this capture; the job states {self.bias_um:+.3f} um, and {why}"
        if self.ordered_um is not None:
            return f"the ±{most:g} um that the job orders"
        assert self.shop is not None
        return f"the ±{most:g} um that {self.shop.title} promises of features of {width_um:g} um"


class Answer(StrEnum):
    """Answers of a measurement."""

    ACCEPT = "ACCEPT"
    REJECT = "REJECT"
    CANNOT_TELL = "CANNOT TELL"


@dataclass(frozen=True)
class Verdict:
    """Answer of a measurement."""

    answer: Answer
    reason: str
    cause: str | None
    factor: float
    next_step: str

    @property
    def line(self) -> str:
        """The first line of text and page."""
        return f"{self.answer}: {self.reason}"


_NEXT = {
    Cause.LAMP: "Cover every light but the point behind the plate, and reflections of it, and take the stack again.",
    Cause.DUST: "Clean the sensor's glass, or give frames of even light (--flat), and take the stack again.",
    Cause.DRIFT: "Let the lamp warm up, lock the exposure, and take the stack again.",
    Cause.SATURATION: "Add shorter exposures, state the true white level (--white), and measure again.",
    Cause.DIE: "Put the die that was asked for before the camera, or name the one that is there (--die).",
    Cause.SETTING: "Check camera, wavelength and side of the plate against the job, and measure again.",
    Cause.NOISE: "State gain, read noise and black level of the sensor, and give frames that nothing has processed.",
    Cause.ROWS: "Take the stack again with more light, or at a setting of the sensor that adds no bands.",
    Cause.COLUMNS: "Take the stack again with more light, or at a setting of the sensor that adds no bands.",
    Cause.BLACK: "State the true black level (--black), or give dark frames (--dark).",
    Cause.GAMMA: "Give frames that nothing has developed: RAW, or linear TIFF.",
    Cause.SOFT_CLIP: "Expose shorter, or state a lower white level (--white).",
    Cause.RESPONSE: "Give frames of even light (--flat).",
    Cause.HOT: "Give dark frames (--dark), or cool the sensor.",
    Cause.DEAD: "Give frames of even light (--flat).",
    Cause.SHADING: "Give frames of even light through the lens without the plate (--flat).",
    Cause.GLARE: "Clean the lens, shade it, blacken what stands about the plate, and take the stack again.",
    Cause.INTERVAL: "Add longer and shorter exposures: four times the light halves the interval.",
    Cause.UNKNOWN: "Look at the difference picture, check camera and light of the job, and take the stack again.",
}
_LOOKS = {
    Cause.LAMP: "one more light behind the same die",
    Cause.DUST: "dust on the sensor",
    Cause.DRIFT: "a light that changes between exposures",
    Cause.SATURATION: "pixels beside full ones that took their charge",
    Cause.DIE: "another die",
    Cause.SETTING: "another camera, wavelength or distance than the job states",
    Cause.NOISE: "another gain, read noise or black level, or frames that were processed",
    Cause.ROWS: "rows of the sensor with offsets of their own",
    Cause.COLUMNS: "columns of the sensor with offsets of their own",
    Cause.BLACK: "another black level than is stated",
    Cause.GAMMA: "a tone curve",
    Cause.SOFT_CLIP: "bright pixels that are told too dark",
    Cause.RESPONSE: "pixels that differ in their response",
    Cause.HOT: "hot pixels",
    Cause.DEAD: "dead pixels",
    Cause.SHADING: "a lens that shades the window",
    Cause.GLARE: "glare about the light",
    Cause.UNKNOWN: "nothing that was looked for: another lamp, dust, drift, full pixels, another die of the job",
}


def judged_die(
    found: Identified, told: Explanation, promise: Promise, *, cause: Cause | None, mirrored: bool, width_um: float
) -> Verdict:
    """The verdict on a die."""

    def untold(why: Cause | str, reason: str, next_step: str) -> Verdict:
        return Verdict(Answer.CANNOT_TELL, reason, str(why), told.factor, next_step)

    best, fit = found.best, told.fit
    if cause is not None:
        reason = f"residuals are {told.factor:.2f} times the noise, and have a pattern"
        if told.factor > told.most:
            reason = f"the model leaves {told.factor:.2f} times the noise, where {told.most:.2f} is the most"
        elif cause is Cause.DRIFT:
            reason = "exposures disagree at more pixels than hits and hot pixels explain"
        first = told.suspects[0] if told.suspects and told.suspects[0].cause is cause else None
        if first is None:
            return untold(cause, f"{reason}; it looks like {_LOOKS[cause]}.", _NEXT[cause])
        likely = [first, *(each for each in told.suspects[1:2] if each.gain >= NAMED)]
        looks = " or ".join(f"{_LOOKS[each.cause]}, {strength(each)}" for each in likely if not first.beats(each))
        frame = deciding_frame(likely)
        decides = f" Take {frame}: it tells {first.cause} from {likely[1].cause}." if frame else ""
        return untold(cause, f"{reason}; it looks like {looks}.", _NEXT[cause] + decides)
    if not found.certain:
        others = " or ".join(f"{each.die}, {stands(each)}" for each in (best, *found.rivals[:3]))
        more = "Add longer exposures, or a larger --window, or name the die (--die)."
        return untold("which die", f"this may be {others}.", more)
    if mirrored:
        reason = f"die {best.die} stands {stands(best)}, the other way round than the job says."
        over = (
            "Turn the plate over, or give frames that were not flipped; if neither helps, the plate was written "
            "mirrored."
        )
        return untold(Cause.SETTING, reason, over)
    bias, half = fit.setting.bias_um, SURE * fit.errors[BIAS]
    kept, words = promise.kept(width_um, bias, half), promise.words(width_um)
    if kept is None:
        return untold(
            Cause.INTERVAL,
            f"the interval of the CD of die {best.die} is too wide to hold it against {words}.",
            _NEXT[Cause.INTERVAL],
        )
    number = f"CD {bias:+.3f} ± {half:.3f} um (99.9 %)"
    if kept:
        reason = f"die {best.die} is as drawn, {number}, within {words}."
        return Verdict(Answer.ACCEPT, reason, None, told.factor, "Nothing has to be done.")
    most = promise.tolerance_um(width_um)
    by = abs(bias - promise.bias_um) if most is None else abs(bias) - most
    reason = f"die {best.die} is not as drawn: {number}, {by:.3f} um beyond {words}."
    again = "Hold the plate against the order; restore with fitted_psf.exr meanwhile."
    if most is None:
        again = "State the tolerance that is allowed ([order.cd] tolerance), or restore with fitted_psf.exr."
    return Verdict(Answer.REJECT, reason, None, told.factor, again)


_STRENGTHS = {
    Cause.BLACK: ("{} counts", 1.0, True),
    Cause.GAMMA: ("counts going as light to the power 1 {}", 1.0, True),
    Cause.SOFT_CLIP: ("the brightest by {} %", 100.0, False),
    Cause.RESPONSE: ("by {} % (standard deviation)", 100.0, False),
    Cause.ROWS: ("{} electrons (standard deviation)", 1.0, False),
    Cause.COLUMNS: ("{} electrons (standard deviation)", 1.0, False),
    Cause.SHADING: ("{} % at its edge", 100.0, False),
    Cause.GLARE: ("{} % of it", 100.0, False),
}
"""Strengths in words, with their errors of 95 %, what they are multiplied by for that, and whether they have signs."""


def strength(suspect: Suspect) -> str:
    """The strength of a fault with its error, in words."""
    if suspect.cause not in _STRENGTHS:
        return f"{suspect.value:.0f} pixels"
    words, factor, sign = _STRENGTHS[suspect.cause]
    return words.format(by_error(factor * suspect.value, factor * NORMAL_95 * suspect.error, sign=sign))


def stands(hypothesis: Hypothesis) -> str:
    """The stand of a die, in words."""
    return stand_words(hypothesis.way_round)


_LEFT_OUT = {
    "hot": "are brighter alone, as hot ones are: dark frames (--dark) tell",
    "dead": "are nearly dark alone, as dead ones are: frames of even light (--flat) tell",
    "dust": "are shaded alike in all exposures, as by dust",
}
_WORTH_SAYING = 0.01
"""Drift that is told in words; less is seldom proven."""


def seen_sentences(
    found: Identified, told: Explanation, *, mirrored: bool, drift: float, holds: bool
) -> tuple[str, ...]:
    """Sentences on what was found in the frames beside the die.

    Args:
        drift: of the exposure whose light differs most from what its time says.
        holds: whether the frames are explained; else a lamp, dust or a light of some width may be none.
    """
    best, sentences = found.best, []
    if not holds:
        return (f"Of the dies it is likest {best.die}, {stands(best)}; what else the fit made of it is not told.",)
    if found.certain:
        over = ": turn the plate over" if mirrored else ""
        sentences.append(f"This is die {best.die}, {stands(best)}{over}.")
    else:
        sentences.append(f"It cannot be told which die this is: {best.die} is the most likely.")
    lamp = told.fit.setting.lamp
    if lamp is not None:
        share = by_error(100 * lamp.share, 100 * NORMAL_95 * told.fit.errors["lamp_share"], sign=False)
        sentences.append(
            f"A second lamp of {share} % of the light stands {lamp.x_um:+.1f} um to the right and {lamp.y_um:+.1f} um "
            "up on the sensor; the fit allows for it."
        )
    left_out = told.left_out.counts
    for name, what in _LEFT_OUT.items():
        if left_out[name]:
            sentences.append(f"{left_out[name]} pixels were left out, for they {what}.")
    if drift > _WORTH_SAYING:
        said = f"Light of exposures differs from what their times say by up to {100 * drift:.1f} %"
        sentences.append(f"{said}; the fit allows for it.")
    sentences += bench_sentences(told)
    sentences.append(
        "Whether it is turned by 180 degrees beyond that cannot be told: the picture of a mask in focus is point-"
        "symmetric, and out of focus that of the other side."
    )
    if found.certain and (mirrored or best.way_round % 2):
        named = next(name for name, way in STANDS.items() if way == best.way_round)
        sentences.append(f"As it stands, photographs and edges are held against it with --stands {named}.")
    return tuple(sentences)


def finding_sentences(told: Explanation, costs: Sequence[Cost], promise: Promise, line_nm: float) -> tuple[str, ...]:
    """Sentences on width, photographs, lens and scale: findings where the frames are explained."""
    fit = told.fit
    bias, half = fit.setting.bias_um, NORMAL_95 * fit.errors[BIAS]
    off = bias - promise.bias_um
    seen = "no difference is seen."
    if abs(off) > half:
        within = "" if abs(off) > SURE * fit.errors[BIAS] else ", within its error of 99.9 %"
        seen = f"off by {off:+.3f} um{within}."
    scale, scale_half = fit.setting.scale, NORMAL_95 * fit.errors["scale"]
    scaled = "one die does not tell which of them is off" if abs(scale) > scale_half else "no difference is seen"
    return (
        f"CD {bias:+.3f} ± {half:.3f} um (95 %), where the job states {promise.bias_um:+.3f} um: {seen}",
        *_cost_sentences(costs),
        _lens_sentence(fit, line_nm),
        "Scale, that of pitch x pixel / (wavelength x focal length), less 1: "
        f"{scale:+.1e} ± {scale_half:.1e}; {scaled}.",
    )


def _cost_sentences(costs: Sequence[Cost]) -> list[str]:
    if not costs:
        return []
    whole = next(cost.by_design for cost in costs if cost.of == ALL)
    if whole.tie or whole.mean < 0:
        return [
            "A photograph restored as if the die were as drawn loses nothing that can be told "
            f"({whole.told()}): restore by the job (--job)."
        ]
    worst = max(costs, key=lambda cost: (cost.of != ALL, cost.by_design.mean))
    most = "" if worst.of == ALL else f", most of it by {disagreement(worst.of)}"
    return [
        f"A photograph restored as if the die were as drawn loses {whole.told()} of PSNR{most}: "
        "restore with fitted_psf.exr, which loses none of that."
    ]


def _lens_sentence(fit: Fit, line_nm: float) -> str:
    half = {term: NORMAL_95 * fit.errors[f"z{term}"] for term, _ in fit.setting.terms}
    seen = [
        f"{TERM_NAMES.get(term, f'Zernike {term}')} {by_error(waves, half[term])}"
        for term, waves in fit.setting.terms
        if abs(waves) > half[term]
    ]
    if not seen:
        return "Lens: no error can be told from zero, defocus being sought and all that the residuals ask for."
    rest = len(half) - len(seen)
    left = f"; {rest} more cannot be told from zero" if rest else ""
    return f"Lens, in waves of {line_nm:g} nm: {', '.join(seen)}{left}."
