"""The table of what a measured capture claims, and how often it is right, measured here and now: ``make bench``.

Captures come of another path than the fit's: polygons as a writer makes them, or a phase on exact dots. One argument,
the draws of each row, 5 by default; 50 takes an hour.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from camera.capture.captured_dies import BLACK, GAIN, READ_NOISE, exposed, phased_picture, polygon_picture
from numpy.typing import NDArray

from maskfab.base.model import Panel
from maskfab.camera.frames.frame import Frame
from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.die_image import DieImage, Setting
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


def disturbed(kind: str, draws: int) -> Iterator[tuple[Fit, Setting]]:
    """Five frames whose light drifts, or with another lamp of a fiftieth, or with dust: told by chi², or made good."""
    truth = replace(STARTED, bias_um=0.1, turn_rad=0.001)
    picture = polygon_picture(PANELS["FITS_M150"], CAMERA, {530.0: 1.0}, bias_um=0.1, turn_rad=0.001)
    drift = (1.0, 1.03, 0.97, 1.02, 0.99) if kind == "drift" else (1.0,) * 5
    if kind == "lamp":
        picture = picture + 0.02 * np.roll(picture, (25, -31), (0, 1))
    if kind == "dust":
        picture[60:64, 80:84] *= 0.6
    for draw in range(draws):
        frames = exposed(picture, STACK, PEAK_E, draw)
        moved = [
            replace(each, counts=((each.counts - BLACK) * factor + BLACK).astype(np.float32))
            for each, factor in zip(frames, drift, strict=True)
        ]
        yield fit_of(PANELS["FITS_M150"], moved, truth), truth


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


def main(draws: int) -> None:
    for times, name in ((STACK, "stack of five"), (SINGLE, "one frame")):
        print(row(f"polygons, {name}", written(times, draws)), flush=True)
        print(row(f".08 waves out of focus, {name}", out_of_focus(times, draws)), flush=True)
        print(f"die and way round, {name}: {told(times, draws)}", flush=True)
        print(row(f".02 waves of Z5 to Z11, {name}", untold(times, draws, tuple(range(5, 12)))), flush=True)
        print(row(f".02 waves of Z12 to Z15, {name}", untold(times, draws, tuple(range(12, 16)))), flush=True)
    for kind in ("drift", "lamp", "dust"):
        print(row(f"{kind}, stack of five", disturbed(kind, draws)), flush=True)
    print(row("31 lines, stack of five", spread(STACK, draws)), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
