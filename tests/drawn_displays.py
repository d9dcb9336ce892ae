"""Displays drawn at random, every second one known to fit by construction, each designed for: design, proof or neither.

``.venv/bin/python tests/drawn_displays.py 0 40`` takes half an hour of processor; each line is one display.
"""

from __future__ import annotations

import random
import sys
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import maskfab as mf
from maskfab.base.errors import MaskfabError
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.designs.rules.display_fit import every_pair
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import DisplayRules, feasibility
from maskfab.job.read import validate

CAMERA = {
    "focal": "10 mm",
    "stop": {"shape": "circle", "diameter": "4 mm"},
    "wavelengths": ["610 nm", "530 nm", "470 nm"],
    "pixel": "2 um",
}


@dataclass(frozen=True)
class Drawn:
    """A display that nobody tuned."""

    dots: int
    dot_um: float
    clear_dots: int
    emitters: dict[str, Any]
    wires: dict[str, Any]
    known: bool = False

    @property
    def pitch(self) -> str:
        return f"{self.dots * self.dot_um:g} um"


def drawn(seed: int) -> Drawn:
    """Pitch 60 to 200 um, 13 to 42 dots, 10 to 25 % clear, one to five lines; lengths on at most 128 cells a side."""
    draw = random.Random(seed)
    while True:
        dots, dot = draw.randint(13, 42), draw.choice([2, 2.5, 3, 4, 5, 6, 8, 10, 12])
        if not 60 <= dots * dot <= 200:
            continue
        cell = dot / draw.choice([1, 2])
        if dots * dot / cell > 128:
            continue
        clear = round(draw.uniform(0.10, 0.25) * dots**2)
        lines = draw.randint(1, 5)
        line, space = draw.choice([2, 3, 4]), draw.choice([2, 3, 4])
        clearance = draw.choice([1, 2, 2.5, 3, 4])
        ratio = draw.choice([[1, 1, 1], [1, 1, 2], [1, 1, 1.5], [1, 2, 2]])
        width = cell * max(1, round(draw.uniform(6, 14) / cell))
        between, beside = (cell * round(draw.uniform(*ends) / cell) for ends in ((4, 12), (0, 5)))
        emitters = {
            "required": round(draw.uniform(0.02, 0.13), 3),
            "ratio": ratio,
            "gap_to_opening": f"{beside:g} um",
            "colour_gap": f"{between:g} um",
            "min_width": f"{width:g} um",
            "circuit": "800 um^2",
        }
        wires = {"line": f"{line} um", "space": f"{space} um", "clearance": f"{clearance} um", "lines": lines}
        return Drawn(dots, dot, clear, emitters, wires)


def known(seed: int) -> Drawn:
    """A drawn display whose emitters are 95 % of those found round a rectangle that its lines pass, or fewer lines."""
    for more in range(20):
        asked, draw = drawn(seed + 100 * more), random.Random(seed + 100 * more + 1000)
        height = max(1, round((asked.clear_dots * draw.uniform(0.6, 1.6)) ** 0.5))
        width = min(asked.dots, -(-asked.clear_dots // height))
        height = -(-asked.clear_dots // width)
        if height > asked.dots:
            continue
        unit = np.zeros((asked.dots, asked.dots), dtype=np.bool_)
        y, x = draw.randint(0, asked.dots - height), draw.randint(0, asked.dots - width)
        unit[y : y + height, x : x + width] = True
        for lines in range(asked.wires["lines"], 0, -1):
            fewer = replace(asked, clear_dots=int(unit.sum()), wires={**asked.wires, "lines": lines})
            share = largest(unit, fewer)
            if share > 0.01:
                return replace(fewer, emitters={**asked.emitters, "required": round(0.95 * share, 4)}, known=True)
    return drawn(seed)


def largest(unit: np.ndarray, asked: Drawn) -> float:
    """The footprint round an opening whose pixels are turned in every way; 0 where the display does not fit."""
    sections = {"camera": CAMERA, "emitters": {**asked.emitters, "required": 0.0}, "wires": asked.wires}
    spec = validate(sections, where="drawn")
    dot_nm = round(asked.dot_um * 1000)
    assert spec.emitters is not None
    panel = Panel(Opening("unit", unit, dot_nm), dot_nm, 0, every_pair(), Tiling.RANDOM, 0)
    answer = feasibility(panel, DisplayRules.of(spec.emitters, spec.light, spec.wires, where="drawn"))
    return 0.0 if answer is None or answer.verdict is not Verdict.FITS else answer.footprint.found_share


def ended(asked: Drawn) -> str:
    """End of the design for a display, in words."""
    try:
        found = mf.design(
            dots=asked.dots,
            pitch=asked.pitch,
            clear_dots=asked.clear_dots,
            emitters=asked.emitters,
            wires=asked.wires,
            fit=True,
            families=["bars", "l_shapes"],
        )
    except MaskfabError as refusal:
        return str(refusal)
    assert found.fit is not None
    assert found.fit.why is None
    fewer = found.found.shortfall
    return f"{'FITS' if fewer is None else fewer.told}: {found.found.shape}"


if __name__ == "__main__":
    for number in range(*map(int, sys.argv[1:3])):
        display = known(number) if number % 2 else drawn(number)
        begun = time.process_time()
        told = ended(display)
        how = "known to fit" if display.known else "drawn"
        print(
            f"{number:3d} {how:12} {display.dots} dots of {display.dot_um:g} um, {display.clear_dots} clear, "
            f"{display.wires['lines']} lines, {display.emitters['required']:.1%}: {told} "
            f"({time.process_time() - begun:.0f} s of processor)",
            flush=True,
        )
