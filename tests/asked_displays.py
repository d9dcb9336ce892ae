"""Displays that openings must hold in tests: loose unless a test asks for something."""

from __future__ import annotations

from pathlib import Path

from maskfab.base.model import Tiling
from maskfab.designs.rules.display_fit import Display
from maskfab.display.drive import CircuitRules, LightDemand
from maskfab.display.emitter_rules import EmitterRules
from maskfab.display.feasibility import DisplayRules
from maskfab.display.pixel_lines import WireRules
from maskfab.display.wiring import WireDemand


def asked_display(
    *,
    required: float = 0.0,
    lines: int = 0,
    circuit_um2: float = 1.0,
    to_opening_nm: int = 0,
    colour_gap_nm: int = 8000,
    min_width_nm: int = 16000,
    wire_nm: int = 3000,
    clearance_nm: int = 2500,
    keep: float = 1.0,
    tiling: Tiling = Tiling.RANDOM,
    across: int = 3,
) -> Display:
    """A display of so many pixels a side, seed 0."""
    emitters = EmitterRules(to_opening_nm, colour_gap_nm, min_width_nm, required=required)
    circuit = CircuitRules(need_um2=circuit_um2, min_width_nm=min_width_nm)
    wires = WireDemand(WireRules(wire_nm, wire_nm, clearance_nm), lines) if lines else None
    return Display.of(DisplayRules(emitters, keep, circuit, LightDemand(), wires), tiling, 0, across, across)


JOB = """
[design]
name = "small"
dots = 11
pitch = "88 um"
clear_dots = 25
fit = true

[camera]
focal = "10 mm"
stop = { shape = "circle", diameter = "0.512 mm" }
wavelengths = ["610 nm", "530 nm", "470 nm"]
pixel = "2 um"

[emitters]
required = 0.1
gap_to_opening = "4 um"
colour_gap = "8 um"
min_width = "8 um"
circuit = "800 um^2"

[wires]
lines = 2
"""
DISPLAY = """
[job]
name = "SMALL"
title = "SMALL"

[plate]
template = "5in"
die_size = "0.62 mm"
die_pitch = "22 mm"
columns = 1

[[die]]
name = "SMALL"
label = "small"
opening = "small.toml"
dot = "8 um"
pitch = "88 um"
tiling = "random"
seed = 0
"""


def job_of(folder: Path, *edits: tuple[str, str], more: str = "") -> Path:
    """A job of a small design that a display must fit, edited."""
    text = JOB + more
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path = folder / "job.toml"
    path.write_text(text)
    return path
