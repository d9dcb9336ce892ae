"""Displays that openings must hold in tests: loose unless a test asks for something."""

from __future__ import annotations

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
