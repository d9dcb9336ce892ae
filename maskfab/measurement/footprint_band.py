"""The band of a display's footprint over the displays that are made: a wider opening leaves the emitters less room.

Emitters are drawn once, and openings are written wider or narrower about them. Of the emitters counts what keeps its
gap to the openings as written. That falls as the bias grows, so that the edges of the band are those of the bias: two
full cases, without an expansion. Rounder corners of openings leave more room, which is not counted.
"""

from __future__ import annotations

from scipy.special import ndtri

from maskfab.display.emitters.emitter_rules import EmitterRules
from maskfab.display.emitters.measure import left_of_emitters
from maskfab.display.feasibility import Feasibility, footprint_of
from maskfab.measurement.process_spread import SHARE, ProcessSpread
from maskfab.model import Die, Process, Quantity
from maskfab.units import NM_PER_UM

_ROUNDING_UM = 1 / NM_PER_UM


def footprint_band(
    die: Die, found: Feasibility, rules: EmitterRules, process: Process, spread: ProcessSpread
) -> tuple[Quantity, ...]:
    """The band of a die's footprint, as a row of a report; none without emitters or a spread of the bias.

    Args:
        die: with its emitters.
        found: of its display.
        rules: of its emitters.
        process: of the openings, as stated.
        spread: of it.
    """
    drawn = found.emitters
    if drawn is None or not spread.bias_um:
        return ()
    pixel_um2 = die.panel.cell_size.pitch_um**2

    def footprint(bias_um: float) -> float:
        left = left_of_emitters(die.panel, rules, round(bias_um / 2 * NM_PER_UM))
        red, green, blue = (share * area / pixel_um2 for share, area in zip(left, drawn.areas_um2, strict=True))
        return footprint_of((red, green, blue), rules)

    off = float(ndtri((1 + SHARE) / 2)) * spread.bias_um
    wide, narrow = (footprint(process.cd_bias_um + each) for each in (off, -off))
    rounding = abs(wide - footprint(process.cd_bias_um + off + 2 * _ROUNDING_UM))
    return (
        Quantity(
            "band_led_footprint",
            (narrow - wide) / 2,
            f"{SHARE:.0%} of displays lie from {wide:.5g} to {narrow:.5g}: emitters as drawn, less what is nearer than "
            f"the gap of {rules.gap_to_opening_nm / NM_PER_UM:g} um to the openings as written; error: edges on a grid "
            "of a nanometre",
            uncertainty=rounding,
            die=die.name,
            between=(wide, narrow),
        ),
    )
