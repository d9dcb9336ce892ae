"""The table of what a measured capture tells of the bench, and how often it is right: ``python tests/bench_table.py``.

Captures come of the simulator, which shares no optics with the package; every draw has a CD bias, a place of the
light, a fault of the row's kind and noise of its own. Arguments are the draws of each row, 20 by default, and the
beginnings of the rows' names, all by default.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from capture_simulator import MOSAIC, Dots, Floats, Optics, Stack, flat_band, lamp_picture, mosaic, picture

from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.bench import FULL
from maskfab.camera.inspection.die_verdict import Answer, Promise
from maskfab.camera.inspection.measurement import measured
from maskfab.job.camera import Camera, Stop
from maskfab.mask.job import load_job
from maskfab.optics.spectrum import line_spectrum

JOB = load_job(Path(__file__).parent.parent / "layouts" / "upc12.toml")
PANELS = JOB.panels()
DIES = ("FITS_M150", "PACK_M150", "DENS_M150", "TOLED_R150")
SIDE, MIDDLE_NM, TOLERANCE_UM = 128, 530.0, 0.5
COLOURS = {"R": 610.0, "G": 530.0, "B": 470.0}


@dataclass
class Fault:
    """What a bench is beside what the job states."""

    off_um: tuple[float, float] = (0.0, 0.0)
    terms: Mapping[int, float] = field(default_factory=dict)
    band_nm: float = 0.0
    lamp_um: float = 0.0
    disc: bool = True
    wider: float = 0.0
    barrel: tuple[float, float, float] | None = None
    axial_waves: float = 0.0
    colours: bool = False
    truth: dict[str, float] = field(default_factory=dict)


def off_axis(off_um: float, *, colours: bool = False) -> Callable[[np.random.Generator, float], Fault]:
    def drawn(random: np.random.Generator, _: float) -> Fault:
        angle = random.uniform(0, 2 * np.pi)
        at = off_um * float(np.cos(angle)), off_um * float(np.sin(angle))
        return Fault(at, colours=colours, truth=dict(zip(("die_x_um", "die_y_um"), at, strict=True)))

    return drawn


def barrel(bend: float, *terms: int) -> Callable[[np.random.Generator, float], Fault]:
    """A second circle that leaves three quarters of the stop, its radius that of the stop over a bend."""

    def drawn(random: np.random.Generator, diameter_um: float) -> Fault:
        radius, angle = diameter_um / 2, random.uniform(0, 2 * np.pi)
        place = np.linspace(-1, 1, 801) * radius
        x, y = np.meshgrid(place, place)
        stop = np.hypot(x, y) <= radius

        def left(depth: float) -> float:
            return float(stop[np.hypot(x - (radius - depth - radius / bend), y) <= radius / bend].sum() / stop.sum())

        depths = np.linspace(0, radius, 201)
        depth = float(np.interp(-0.75, [-left(each) for each in depths], depths))
        far = radius - depth - radius / bend
        cos, sin = float(np.cos(angle)), float(np.sin(angle))
        waves = {term: float(random.choice((-1, 1))) * random.uniform(0.02, 0.06) for term in terms}
        truth = {"cut_x_um": depth * cos, "cut_y_um": depth * sin} | {f"z{t}": w for t, w in waves.items()}
        return Fault(terms=waves, barrel=(far * cos, far * sin, radius / bend), truth=truth)

    return drawn


def other_stop(random: np.random.Generator, diameter_um: float) -> Fault:
    wider = 0.01 * diameter_um * float(random.choice((-1, 1)))
    return Fault(wider=wider, truth={"stop_um": wider})


ROWS: dict[str, Callable[[np.random.Generator, float], Fault]] = {
    **{f"off {off:g} um": off_axis(off) for off in (0.0, 1.0, 5.0, 20.0, 100.0, 200.0, 500.0)},
    **{f"mosaic off {off:g} um": off_axis(off, colours=True) for off in (0.0, 20.0, 200.0)},
    "band 10 nm": lambda *_: Fault(band_nm=10.0, truth={"band_nm": 10.0}),
    "band 30 nm": lambda *_: Fault(band_nm=30.0, truth={"band_nm": 30.0}),
    "lamp 1 um": lambda *_: Fault(lamp_um=1.0, truth={"light_um": 1.0}),
    "lamp 4 um": lambda *_: Fault(lamp_um=4.0, truth={"light_um": 4.0}),
    "lamp 20 um": lambda *_: Fault(lamp_um=20.0, truth={"light_um": 20.0}),
    "bell 4 um": lambda *_: Fault(lamp_um=4.0, disc=False, truth={"light_um": 4.0}),
    "stop 1 %": lambda random, wide: Fault(
        wider=(s := 0.01 * wide * float(random.choice((-1, 1)))), truth={"stop_um": s}
    ),
    "Z5, Z11": lambda *_: Fault(terms={5: 0.04, 11: -0.03}, truth={"z5": 0.04, "z11": -0.03}),
    "barrel": barrel(1.0),
    "barrel, wide, Z5, Z11": barrel(0.75, 5, 11),
    "axial colour": lambda *_: Fault(axial_waves=0.05, colours=True, truth={"axial_waves": 0.05}),
}


def light_of(die: str, bias_um: float, stop_um: float, fault: Fault, at_um: tuple[float, float]) -> Floats:
    """The picture on the sensor."""
    dots = Dots.of(PANELS[die]).grown(bias_um).moved(*fault.off_um)

    def seen(line_nm: float, waves: Mapping[int, float]) -> Floats:
        lines = flat_band(line_nm, fault.band_nm) if fault.band_nm else {line_nm: 1.0}
        optics = Optics(stop_um + fault.wider, 1e4, 2.0, SIDE, lines, dict(waves), fault.barrel)
        if fault.lamp_um:
            return lamp_picture(dots, optics, fault.lamp_um, at_um, disc=fault.disc)
        return picture(dots, optics, at_um)

    if not fault.colours:
        return seen(MIDDLE_NM, fault.terms)
    first = COLOURS["R"]
    pictures = {}
    for name, line in COLOURS.items():
        defocus = fault.axial_waves * (line - first) / 100
        waves = {**fault.terms, 4: fault.terms.get(4, 0.0) + defocus}
        pictures[name] = seen(line, {term: value * first / line for term, value in waves.items()})
    return mosaic(pictures)


@dataclass
class Row:
    """Draws of one kind: by the name of a number, whether its 95 % held the truth, and how often it was not told."""

    name: str
    answers: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    covered: dict[str, list[bool]] = field(default_factory=dict)
    untold: Counter[str] = field(default_factory=Counter)
    halves: list[float] = field(default_factory=list)
    factors: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def __str__(self) -> str:
        told = ", ".join(f"{name} {np.mean(held):.0%} of {len(held)}" for name, held in self.covered.items())
        told += "".join(f", {name} not told in {count}" for name, count in self.untold.items() if count)
        answers = ", ".join(f"{count} {answer}" for answer, count in sorted(self.answers.items()))
        half = f"CD ± {np.median(self.halves):.3f}" if self.halves else "no CD"
        return (
            f"{self.name}: {answers}; wrong {self.wrong}; noise x {np.mean(self.factors):.2f}, {half}; "
            f"{np.median(self.seconds):.1f} s, {max(self.seconds):.1f} at most\n    covered: {told}"
        )


def row(name: str, stop_um: float, draws: int) -> Row:
    """Draws of one kind behind one stop."""
    found = Row(f"{name}, f/{1e4 / stop_um:g}")
    for draw in range(draws):
        random = np.random.default_rng([draw, *name.encode()])
        fault, die = ROWS[name](random, stop_um), str(random.choice(DIES))
        bias = float(random.choice((-1, 1)) * random.uniform(0.2, 0.8))
        at = float(random.uniform(-1, 1)), float(random.uniform(-1, 1))
        light = light_of(die, bias, stop_um, fault, at)
        pattern = MOSAIC if fault.colours else None
        merging = merged(Stack(light, pattern=pattern).frames(draw + 100), electrons_per_count=1.3, read_noise_e=4.87)
        lines = tuple(COLOURS.values()) if fault.colours else (MIDDLE_NM,)
        camera: Camera = replace(JOB.camera, stop=Stop("circle", stop_um), wavelengths_nm=lines, window_um=2.0 * SIDE)
        seen = COLOURS if fault.colours else {"-": MIDDLE_NM}
        spectra = {colour: line_spectrum([line]) for colour, line in seen.items()}
        start = time.process_time()
        told = measured(merging, {die: PANELS[die]}, camera, spectra, promise=Promise(ordered_um=0.5), priced=False)
        found.seconds.append(time.process_time() - start)
        verdict, fit = told.verdict, told.fit
        found.answers[f"{verdict.answer} ({verdict.cause})" if verdict.cause else verdict.answer] += 1
        found.factors.append(verdict.factor)
        if verdict.answer is not Answer.CANNOT_TELL:
            found.wrong += (verdict.answer is Answer.ACCEPT) != (abs(bias) < TOLERANCE_UM)
        elif verdict.cause != "interval holds the limit":
            continue
        values = dict(zip(fit.setting.names, fit.setting.values.tolist(), strict=True))
        errors = dict(fit.errors)
        for full in FULL:
            if values.get(full):
                width = FULL[full] * np.sqrt(values[full])
                short = f"{full.partition('_')[0]}_{full[-3:-1]}"
                values[short], errors[short] = width, width * errors[full] / (2 * values[full])
        found.halves.append(1.96 * errors["bias_um"])
        for value, truth in {"bias_um": bias, **fault.truth}.items():
            if value not in values:
                found.untold[value] += truth != 0
                continue
            half = 1.96 * errors[value]
            found.covered.setdefault(value, []).append(abs(values[value] - truth) <= half)
            if not found.covered[value][-1]:
                print(f"   {name} {draw} {die}: {value} {values[value]:.4f} ± {half:.4f} for {truth:.4f}")
    return found


def main(draws: int, names: list[str]) -> None:
    for stop_um in (1600.0, 4000.0):
        for name in ROWS:
            if not names or any(name.startswith(each) for each in names):
                print(row(name, stop_um, draws), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20, sys.argv[2:])
