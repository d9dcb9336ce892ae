"""The table of what a measured capture claims, and how often it is right, measured here and now: ``make bench``.

Captures come of another path than the fit's: polygons as a writer makes them, or a phase on exact dots. One argument,
the draws of each row, 5 by default; 50 takes an hour. Verdicts are drawn by the simulator, faults and all, behind a
small stop.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from camera.capture.captured_dies import BLACK, GAIN, READ_NOISE, exposed, phased_picture, polygon_picture
from capture_simulator import Dots, Optics, Stack, picture
from capture_simulator import Sensor as Simulated
from numpy.typing import NDArray
from optics_cases import camera, noise, panel

from maskfab.base.model import Panel
from maskfab.camera.frames.frame import Frame
from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.diagnosis import Cause
from maskfab.camera.inspection.die_image import DieImage, Setting
from maskfab.camera.inspection.die_verdict import Answer, Promise
from maskfab.camera.inspection.fit import (
    FIRST_TERMS,
    Fit,
    Taken,
    brightest,
    expecting,
    fitted,
    taken_of,
    with_frames,
    with_terms,
)
from maskfab.camera.inspection.identity import Hypothesis, Identified, identified
from maskfab.camera.inspection.measurement import measured
from maskfab.job.camera import Camera
from maskfab.mask.job import load_job
from maskfab.optics.spectrum import Spectrum, line_spectrum

Floats = NDArray[np.float64]

JOB = load_job(Path(__file__).parent.parent / "layouts" / "upc12.toml")
PANELS = JOB.panels()
CAMERA: Camera = replace(JOB.camera, wavelengths_nm=(530.0,), window_um=302.0)
LIGHT = {"-": line_spectrum([530.0])}
STACK, SINGLE = (1.0, 4.0, 16.0, 64.0, 256.0), (1.0,)
PEAK_E = 1e4
STARTED = replace(Setting(), terms=tuple((term, 0.0) for term in FIRST_TERMS))


def seen(frames: Sequence[Frame]) -> tuple[tuple[Taken, ...], tuple[float, float]]:
    """Pixels of merged frames, and x and y of their origin from the middle of the frame, micrometres."""
    merging = merged(frames, electrons_per_count=GAIN, read_noise_e=READ_NOISE)
    middle = brightest(merging.planes)
    half = (merging.planes[0].electrons_per_s.shape[0] - 1) / 2
    return taken_of(merging, CAMERA.pixel_um, middle), (
        CAMERA.pixel_um * (middle[1] - half),
        -CAMERA.pixel_um * (middle[0] - half),
    )


def fit_of(panel: Panel, frames: Sequence[Frame], start: Setting, light: dict[str, Spectrum] | None = None) -> Fit:
    """The fit as a measurement makes it, once the die is known; its place is that from the middle of the frame."""
    taken, origin = seen(frames)
    image = DieImage.of(panel, 0, CAMERA, light or LIGHT, [each.pixels for each in taken])
    start = replace(start, x_um=start.x_um - origin[0], y_um=start.y_um - origin[1])
    found = fitted(image, taken, start)
    taken = expecting(image, taken, found.setting)
    found = with_frames(image, taken, with_terms(image, taken, fitted(image, taken, found.setting)))
    at = found.setting
    return replace(found, setting=replace(at, x_um=at.x_um + origin[0], y_um=at.y_um + origin[1]))


@dataclass(frozen=True, eq=False)
class Row:
    """Draws of one capture.

    Attributes:
        name: what was captured.
        off: of every value of the first fit's, from the truth, in standard errors of the noise alone, [draws, values].
        stated: the same in the errors that the fits state.
        names: of the values.
        misfit: chi² per pixel of every draw.
        terms: that every fit ended with, counted.
        seconds: of processor time for a fit.
    """

    name: str
    off: Floats
    stated: Floats
    names: tuple[str, ...]
    misfit: Floats
    terms: tuple[int, ...]
    seconds: float

    def __str__(self) -> str:
        lines = [
            f"{self.name}: {len(self.off)} draws, chi² per pixel {self.misfit.mean():.3f}, terms "
            f"{sorted(set(self.terms))}, {self.seconds:.1f} s a fit"
        ]
        covered = abs(self.stated) <= 1.96
        for k, name in enumerate(self.names):
            scatter = self.off[:, k].std(ddof=1) if len(self.off) > 1 else np.nan
            lines.append(
                f"  {name:9} scatter {scatter:5.2f} x bound, mean {self.off[:, k].mean():+5.2f} standard errors, "
                f"covered {covered[:, k].mean():4.0%}"
            )
        return "\n".join([*lines, f"  all       covered {covered.mean():.1%} of {covered.size}"])


def row(name: str, draws: Iterator[tuple[Fit, Setting]]) -> Row:
    off, stated, misfit, terms, names = [], [], [], [], STARTED.names
    start = time.process_time()
    for found, truth in draws:
        wanted = dict(zip(truth.names, truth.values, strict=True))
        have = dict(zip(found.setting.names, found.setting.values, strict=True))
        error = np.array([found.errors[key] for key in names])
        away = np.array([have[key] - wanted.get(key, 0.0) for key in names])
        off.append(away / error * found.inflation)
        stated.append(away / error)
        misfit.append(found.chi2 / found.freedom)
        terms.append(len(found.setting.terms))
    spent = (time.process_time() - start) / len(off)
    return Row(name, np.array(off), np.array(stated), names, np.array(misfit), tuple(terms), spent)


def written(times: tuple[float, ...], draws: int) -> Iterator[tuple[Fit, Setting]]:
    """One die, bias and turn of polygons, in focus; only the noise is drawn."""
    truth = replace(STARTED, bias_um=0.12, turn_rad=0.002)
    picture = polygon_picture(PANELS["FITS_M150"], CAMERA, {530.0: 1.0}, bias_um=0.12, turn_rad=0.002)
    for draw in range(draws):
        yield fit_of(PANELS["FITS_M150"], exposed(picture, times, PEAK_E, draw), truth), truth


def out_of_focus(times: tuple[float, ...], draws: int) -> Iterator[tuple[Fit, Setting]]:
    """One die, out of focus and off the middle of a pixel by a tilt; only the noise is drawn."""
    waves, tilt = 0.08, (0.06, -0.04)
    per_wave = 2 / (CAMERA.stop.diameter_um / 2) * CAMERA.wavelengths_nm[0] * 1e-3 * CAMERA.focal_um
    picture = phased_picture(PANELS["FITS_M150"], CAMERA, ((2, tilt[0]), (3, tilt[1]), (4, waves)))
    truth = Setting(x_um=per_wave * tilt[0], y_um=per_wave * tilt[1], terms=((4, waves),))
    for draw in range(draws):
        yield fit_of(PANELS["FITS_M150"], exposed(picture, times, PEAK_E, draw), truth), truth


def untold(times: tuple[float, ...], draws: int, terms: tuple[int, ...]) -> Iterator[tuple[Fit, Setting]]:
    """A lens with .02 waves of every one of some errors, signs drawn, from a start that knows nothing."""
    for draw in range(draws):
        signs = np.random.default_rng(draw).choice((-1.0, 1.0), len(terms))
        errors = tuple((term, 0.02 * float(sign)) for term, sign in zip(terms, signs, strict=True))
        picture = phased_picture(PANELS["FITS_M150"], CAMERA, errors)
        yield fit_of(PANELS["FITS_M150"], exposed(picture, times, PEAK_E, draw), STARTED), Setting(terms=errors)


def spread(times: tuple[float, ...], draws: int) -> Iterator[tuple[Fit, Setting]]:
    """31 lines of a lamp, drawn as such and known to the fit."""
    lines = np.linspace(515.0, 545.0, 31)
    weights = np.exp(-(((lines - 530) / 10) ** 2))
    weights /= weights.sum()
    truth = replace(STARTED, bias_um=-0.05, turn_rad=-0.001)
    given = dict(zip(lines.tolist(), weights.tolist(), strict=True))
    picture = polygon_picture(PANELS["FITS_M150"], CAMERA, given, bias_um=-0.05, turn_rad=-0.001)
    light = {"-": Spectrum(lines, weights, "lamp")}
    for draw in range(draws):
        yield fit_of(PANELS["FITS_M150"], exposed(picture, times, PEAK_E, draw), truth, light), truth


def stood(picture: Floats, way: int) -> Floats:
    """A picture of a die as drawn, as one that stands otherwise makes it; 180 degrees change nothing in focus."""
    turned = np.rot90(picture) if way % 2 else picture
    return turned[:, ::-1] if way >= 4 else turned


def told(times: tuple[float, ...], draws: int) -> str:
    """How often the die and its way round are told among twelve, of captures of dies drawn at random."""
    right = unsure = wrong = 0
    start, misses = time.process_time(), []
    dies = tuple(PANELS)
    for draw in range(draws):
        random = np.random.default_rng(1000 + draw)
        die, way = str(random.choice(dies)), int(random.choice((0, 1, 4, 5)))
        bias, turn = random.normal(0, 0.1), random.normal(0, 0.003)
        picture = stood(polygon_picture(PANELS[die], CAMERA, {530.0: 1.0}, bias_um=bias, turn_rad=turn), way)
        taken, _ = seen(exposed(picture, times, PEAK_E, draw))
        found = identified(PANELS, CAMERA, LIGHT, taken)
        ok = found.best == Hypothesis(die, way)
        right += ok and found.certain
        unsure += not found.certain
        wrong += found.certain and not ok
        if not ok or not found.certain:
            misses.append(f"{die}/{way} -> {story(found)}")
    spent = (time.process_time() - start) / draws
    return "\n  ".join([f"right {right}, cannot tell {unsure}, wrong {wrong} of {draws}; {spent:.1f} s each", *misses])


def story(found: Identified) -> str:
    nearest = [f"{each.die}/{each.way_round} +{margin:.0f}" for each, margin in found.ahead[:3]]
    return f"{found.best.die}/{found.best.way_round}, then {', '.join(nearest)}"


TOLERANCE_UM = 0.15
SMALL: Camera = camera(diameter_um=800.0, window_um=128.0)
DIES = {name: panel(noise(8, 0.45, seed), cells=14, seed=5) for name, seed in (("ONE", 3), ("OTHER", 4))}
SIDE = 64
SEEN = Optics(800.0, SMALL.focal_um, SMALL.pixel_um, SIDE, {530.0: 1.0})
KINDS = ("clean", "dust", "drift", "lamp", "bloom", "band", "dust lamp", "drift lamp", "dust drift")


@dataclass(frozen=True, eq=False)
class Drawn:
    """One faulty capture: frames, and the values that the fit should find.

    Attributes:
        frames: as the camera hands them over.
        truth: by names of a setting's values, place from the frame's middle; those of the lamp too if there is one.
    """

    frames: Sequence[Frame]
    truth: Mapping[str, float]


def drawn(kind: str, number: int) -> Drawn:
    """A capture of die ONE, its CD bias and defocus drawn, with faults of some kinds of drawn size and place."""
    random = np.random.default_rng([sum(map(ord, kind)), number])
    bias, waves = random.normal(0, 0.12), random.normal(0, 0.03)
    die, optics = Dots.of(DIES["ONE"]).grown(bias), replace(SEEN, terms={4: waves})
    light, faults = picture(die, optics), kind.split()
    truth = {"x_um": 0.0, "y_um": 0.0, "turn_rad": 0.0, "scale": 0.0, "bias_um": bias, "z4": waves}
    dust, drift, sensor = np.ones((SIDE, SIDE)), np.ones(4), Simulated()
    if "lamp" in faults:
        far, angle = random.uniform(10, 58), random.uniform(0, 2 * np.pi)
        at = float(far * np.cos(angle)), float(far * np.sin(angle))
        share = 0.02 if number % 2 else random.uniform(0.003, 0.05)
        light = light + share * picture(die, optics, at)
        truth |= {"lamp_x_um": at[0], "lamp_y_um": at[1], "lamp_share": share}
    if "dust" in faults:
        for _ in range(random.integers(1, 5)):
            (row, column), size = random.integers(0, SIDE - 4, 2), random.integers(1, 6)
            dust[row : row + size, column : column + size] *= random.uniform(0.4, 0.9)
    if "drift" in faults:
        drift = 1 + random.normal(0, 0.03, 4)
    if "bloom" in faults:
        well = random.uniform(1.5e4, 8e4)
        sensor = Simulated(full_well_e=well, white=float(np.rint((well - 5 * READ_NOISE) / GAIN + BLACK)))
    if "band" in faults:
        sensor = Simulated(banding_e=random.uniform(0.5, 8))
    stack = Stack(light, dust=dust, drift=tuple(drift.tolist()), sensor=sensor)
    return Drawn(stack.frames(number + 1000), truth)


@dataclass
class Verdicts:
    """Verdicts on draws of one kind.

    Attributes:
        kind: of the faults.
        answers: how often each was given, with its cause.
        wrong: draws accepted or rejected against the truth.
        covered: by value, whether 95 % intervals of what was told hold the truth.
        lamps: power of every lamp told, over its own.
        missed: lamps that were not told where the frames were held to be explained.
        seconds: of processor time for a draw.
    """

    kind: str
    answers: Counter[str]
    wrong: list[int]
    covered: dict[str, list[bool]]
    lamps: list[float]
    missed: int
    seconds: float

    def __str__(self) -> str:
        answers = ", ".join(f"{count} {answer}" for answer, count in sorted(self.answers.items()))
        held = ", ".join(f"{name} {np.mean(each):.0%}" for name, each in self.covered.items())
        told = len(next(iter(self.covered.values()), []))
        lamps = f"; lamps off by {max(abs(each - 1) for each in self.lamps):.1%} at most" if self.lamps else ""
        missed = f", {self.missed} missed" if self.missed else ""
        first = f"{self.kind}: {answers}; wrong {self.wrong or 'none'}{lamps}{missed}; {self.seconds:.1f} s each"
        return f"{first}\n  covered, of {told}: {held}"


def verdicts(kind: str, draws: int, first: int = 0) -> Verdicts:
    """Verdicts on captures of one kind, against what was drawn."""
    answers, wrong, lamps, missed = Counter[str](), list[int](), list[float](), 0
    covered: dict[str, list[bool]] = {}
    start = time.process_time()
    for number in range(first, first + draws):
        case = drawn(kind, number)
        merging = merged(case.frames, electrons_per_count=GAIN, read_noise_e=READ_NOISE)
        found = measured(merging, DIES, SMALL, LIGHT, promise=Promise(ordered_um=TOLERANCE_UM), priced=False)
        answer, cause = found.verdict.answer, found.verdict.cause
        answers[f"{answer} ({cause})" if cause else answer] += 1
        inside = abs(case.truth["bias_um"]) < TOLERANCE_UM
        if answer is not Answer.CANNOT_TELL and (answer is Answer.ACCEPT) != inside:
            wrong.append(number)
        if answer is Answer.CANNOT_TELL and cause != Cause.INTERVAL:
            continue
        row, column = brightest(merging.planes)
        middle = (SIDE - 1) / 2
        values = dict(zip(found.fit.setting.names, found.fit.setting.values.tolist(), strict=True))
        values["x_um"] += SMALL.pixel_um * (column - middle)
        values["y_um"] -= SMALL.pixel_um * (row - middle)
        for name, truth in case.truth.items():
            if name in values:
                held = abs(values[name] - truth) <= 1.96 * found.fit.errors[name]
                covered.setdefault(name, []).append(held)
        if "lamp_share" in case.truth:
            missed += "lamp_share" not in values
            lamps += [values["lamp_share"] / case.truth["lamp_share"]] if "lamp_share" in values else []
    return Verdicts(kind, answers, wrong, covered, lamps, missed, (time.process_time() - start) / draws)


def main(draws: int) -> None:
    for times, name in ((STACK, "stack of five"), (SINGLE, "one frame")):
        print(row(f"polygons, {name}", written(times, draws)), flush=True)
        print(row(f".08 waves out of focus, {name}", out_of_focus(times, draws)), flush=True)
        print(f"die and way round, {name}: {told(times, draws)}", flush=True)
        print(row(f".02 waves of Z5 to Z11, {name}", untold(times, draws, tuple(range(5, 12)))), flush=True)
        print(row(f".02 waves of Z12 to Z15, {name}", untold(times, draws, tuple(range(12, 16)))), flush=True)
    print(row("31 lines, stack of five", spread(STACK, draws)), flush=True)
    for kind in KINDS:
        print(f"verdict, {verdicts(kind, 8 * draws)}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
