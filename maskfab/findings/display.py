"""Rows of a die's display: emitters, borders, circuits, wires and light, and what wires do to the picture.

Of that counts the light that wires leave, and the change of the PSF. The band of a footprint is that over the displays
that are made: a wider opening leaves the emitters less room. Emitters are drawn once, and openings are written wider or
narrower about them. Of the emitters counts what keeps its gap to the openings as written. That falls as the bias grows,
so that the edges of the band are those of the bias: two full cases, without an expansion. Rounder corners of openings
leave more room, which is not counted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import scipy

from maskfab.base.model import COLOURS, ORIENTATIONS, Die, Quantity
from maskfab.base.units import NM_PER_UM, UM_PER_INCH, UM_PER_MM
from maskfab.display.drive import AT_MA_PER_CM2, FIXED_V, RISING_V, LightDemand
from maskfab.display.emitter_rules import EmitterRules
from maskfab.display.eye import FINE_CPD, SLOW_CPD
from maskfab.display.feasibility import Feasibility, footprint_of
from maskfab.display.polygon_check import Violation, left_of_emitters
from maskfab.findings.bands import SHARE, ProcessSpread
from maskfab.job.camera import Camera
from maskfab.job.process import Process
from maskfab.optics.metrics import relative_difference
from maskfab.optics.psf import point_psf
from maskfab.optics.pupil import cut, panel_aperture, veil


def wired_quantities(die: Die, camera: Camera) -> tuple[Quantity, ...]:
    """Transmission and change of the PSF by the wires over the openings; nothing where no wire covers any.

    The mask has no wires: all else that is told of the die is without them.
    """
    panel = die.panel
    if not any(track.transmission < 1 for track in panel.tracks):
        return ()
    patterns = panel.patterns
    _, power = veil(panel)
    cells = panel.orientations.ravel()
    passed = (patterns * power[[k % ORIENTATIONS for k in range(len(patterns))]]).sum(axis=(1, 2))[cells].sum()
    share = float(passed / patterns.sum(axis=(1, 2))[cells].sum())
    if share > 1 - 1e-12:
        return ()
    wavelength = camera.middle_nm
    bare, wired = (
        point_psf(cut(panel_aperture(version, camera.stop.diameter_um / 2), camera.stop), camera, wavelength)
        for version in (replace(panel, tracks=()), panel)
    )
    return (
        Quantity(
            "wired_transmission",
            share,
            "light that the wires leave over the light through the openings, exact from their outlines",
        ),
        Quantity(
            "wired_psf_change",
            relative_difference(wired, bare),
            "relative L2 of the point PSF with the wires against that without, each over the light it holds: mean "
            "amplitude and mean power of every dot",
            wavelength_nm=wavelength,
        ),
    )


def display_quantities(
    die: Die, feasibility: Feasibility, camera: Camera | None = None, *, exempt: bool = False
) -> tuple[Quantity, ...]:
    """The numbers of one die's display; limits that the job states are judged, broken rules always.

    Args:
        camera: what looks through its wires; without one nothing is told of what they do to the picture.
        exempt: whether it is the die that others are compared with, which no limit of the job is held against.
    """
    through = () if camera is None else wired_quantities(die, camera)
    rows = (_resolution(feasibility), *_emitters(die, feasibility), *_judged_rows(feasibility), *through)
    return tuple(replace(_exempted(row) if exempt else row, die=die.name) for row in rows)


_EXEMPT = frozenset(
    ("led_footprint", "flat_delta_e_mean", "grain_slow", "edge_fringe", "reference_life", "reference_power")
)


def _exempted(row: Quantity) -> Quantity:
    """A row that is not held against its limit."""
    if row.passed is None or row.name not in _EXEMPT:
        return row
    return replace(row, passed=None, method=f"{row.method}; not held against the reference die")


def _resolution(feasibility: Feasibility) -> Quantity:
    """Resolution over the camera: what is shared and left out, and whether circuits are placed."""
    ppi, judged = feasibility.resolution_ppi, feasibility.judged
    seen = ""
    if judged is not None:
        minutes = math.degrees(UM_PER_INCH / ppi / judged.distance_um) * 60
        seen = f"; {minutes:.2g} arc minutes each from {judged.distance_um / UM_PER_MM:g} mm, where 1 is resolved"
    return Quantity(
        "local_resolution",
        ppi,
        f"pixels that have circuits of their own, area for area; {feasibility.resolution}{seen}",
    )


def _emitters(die: Die, feasibility: Feasibility) -> Iterator[Quantity]:
    footprint, required = feasibility.footprint, feasibility.required
    yield Quantity(
        "led_footprint",
        feasibility.share,
        "share of a pixel, gutter included, that one colour of the emitters drawn covers; areas counted in cells",
        limit=required or None,
        passed=feasibility.share >= required - 1e-12 if required else None,
    )
    yield Quantity(
        "led_footprint_largest",
        footprint.found_share,
        f"the largest share that was found ({footprint.method}); the emitters drawn may be smaller and better centred",
    )
    why = "" if footprint.certificate is None else f": {footprint.certificate.statement}"
    yield Quantity("led_footprint_bound", footprint.bound_share, f"no placement under the rules has more{why}")
    yield Quantity(
        "led_footprint_rectangles",
        footprint.rectangles_share,
        "the largest share of three rectangles, exact: window table and two straight cuts",
    )
    room = feasibility.room
    yield Quantity(
        "circuit_room",
        room.area_um2,
        f"closed area of a pixel wide enough for circuits, which need {room.need_um2:.0f} um^2; counted in cells: a "
        f"bound, {'not placed' if feasibility.circuits is None else 'for their boxes decide'}",
    )
    yield from _circuit_rows(feasibility)
    yield from _wire_rows(feasibility)
    if feasibility.emitters is None:
        return
    for colour, own in zip(COLOURS, feasibility.own_rooms, strict=False):
        yield Quantity(
            f"circuit_room_{colour}",
            own.area_um2,
            f"the same under the {colour} emitter, where a circuit of its own needs {own.need_um2:.0f} um^2",
        )
    if feasibility.reaches:
        yield Quantity(
            "emitters_stranded",
            len(feasibility.stranded),
            f"of {len(feasibility.reaches)} connected emitters, those from which no chain of closed dots that share "
            "sides leads to the pixel's side, and no transparent wire does",
        )
    yield Quantity(
        "emitter_rules_broken",
        len(feasibility.broken),
        "rules of gap and width that the emitters' polygons break, measured by KLayout on a tile in which all pairs of "
        f"neighbours meet{_first_of(feasibility.broken)}",
        limit=0,
        passed=not feasibility.broken,
    )
    yield Quantity(
        "luminance_centroid",
        (feasibility.centroid_px[0] ** 2 + feasibility.centroid_px[1] ** 2) ** 0.5,
        "distance of the light's centroid from the pixel's centre, colours weighted with their share of white",
    )
    light, usual = feasibility.light, LightDemand()
    assumed = light.efficacy_cd_per_a == usual.efficacy_cd_per_a
    judged = " (a judgement; no source was found)" if assumed else ""
    claimed = light.ageing_exponent == usual.ageing_exponent
    source = ", from a vendor's claim of three times the life at 60 % emitting area instead of 28 %" if claimed else ""
    for number, colour in enumerate(COLOURS):
        if feasibility.density_ma_per_cm2 is not None and feasibility.life is not None:
            yield Quantity(
                f"current_density_{colour}",
                feasibility.density_ma_per_cm2[number],
                f"luminance of white, {light.luminance_cd_per_m2:g} cd/m2, x the share {light.shares[number]:g} that "
                f"{colour} has of it (BT.709) / (efficacy, {light.efficacy_cd_per_a[number]:g} cd/A{judged}, x share "
                "of the pixel)",
            )
            yield Quantity(
                f"relative_life_{colour}",
                feasibility.life[number],
                "life over that of an emitter of 9.3 % of the pixel (a vendor's claim for panels of 300 DPI) at the "
                f"same luminance, (J / J')^-n with n = {light.ageing_exponent:g}{source}",
            )


def _first_of(broken: Sequence[Violation]) -> str:
    """The first broken rules, in words."""
    return "".join(
        f"{'; ' if number else ': '}{one.rule}, {one.area_um2:g} um^2" for number, one in enumerate(broken[:3])
    )


def _circuit_rows(feasibility: Feasibility) -> Iterator[Quantity]:
    circuits = feasibility.circuits
    if circuits is None:
        return
    yield Quantity(
        "circuit_boxes_placed",
        len(circuits.boxes),
        f"of {circuits.wanted} boxes of {circuits.area_um2:g} um^2 together; places on a grid of "
        f"{circuits.cell_nm / NM_PER_UM:g} um, found by rules of thumb and by search, or excluded by a proof",
    )
    yield Quantity(
        "circuit_rules_broken",
        len(circuits.broken),
        "rules of gap and size that the polygons of circuits break, measured by KLayout on a tile in which all pairs "
        f"of neighbours meet{_first_of(circuits.broken)}",
        limit=0,
        passed=not circuits.broken,
    )


JUDGED_ROWS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "delta_e": ("flat_delta_e_mean", "mean S-CIELAB ΔE, CIE 1976, of even white"),
        "delta_e_95": ("flat_delta_e_95", "95th percentile of S-CIELAB ΔE of even white"),
        "grain": ("grain_slow", f"rms luminance contrast of even white up to {SLOW_CPD:g} cycles per degree"),
        "fine_grain": ("grain_fine", f"the same from {SLOW_CPD:g} to {FINE_CPD:g} cycles per degree"),
        "fringe": (
            "edge_fringe",
            "largest S-CIELAB difference in a* and b* at an edge of black and white, the common shift removed",
        ),
        "luminance": ("reference_luminance", "white, every colour at its current density: the least share of its area"),
        "life": ("reference_life", "(J / J')^-n of the colours of the densest current, at equal luminance"),
        "power": (
            "reference_power",
            f"voltage of the supply at equal luminance, {FIXED_V:g} V + {RISING_V:g} V "
            f"(J / {AT_MA_PER_CM2:g} mA/cm²)^½ at the densest current (judged values; square law of Mott and Gurney)",
        ),
    }
)
"""Rows of a report, and how they are found, by the names of numbers that limits are held against."""


def _judged_rows(feasibility: Feasibility) -> Iterator[Quantity]:
    """Numbers of the eye and of life; limits that the job states are judged, and defaults are told."""
    judged = feasibility.judged
    if judged is None:
        return
    if judged.reference_shares is not None:
        yield Quantity(
            "reference_footprint",
            min(judged.reference_shares),
            f"share of a pixel that the least of the colours covers in {judged.layout}, the regular display around "
            "it, without openings, drawn by the rules of the emitters",
        )
    for number in (*judged.looks, *judged.lives):
        row, how = JUDGED_ROWS[number.name]
        seen = number in judged.looks
        place = f"; {judged.where}" if seen else f", over {judged.layout} without openings"
        beside = f"; {judged.layout}: {number.reference:.3g}" if seen and number.reference is not None else ""
        limit = "" if number.limit is None else f"; limit {number.sign} {number.limit:.3g}, {number.source}"
        yield Quantity(
            row,
            number.value,
            f"{how}{place}{beside}{limit}",
            limit=number.limit if number.stated else None,
            passed=number.passed if number.stated else None,
        )


def _wire_rows(feasibility: Feasibility) -> Iterator[Quantity]:
    wires = feasibility.wiring
    if wires is None:
        return
    how = (
        f"{wires.in_gutter} in every gutter, the others through closed area"
        if wires.laid is None
        else "laid across the whole panel, each within a pixel of its own"
    )
    for axis, lines in zip("xy", wires.lines, strict=True):
        yield Quantity(
            f"wire_lines_{axis}",
            lines,
            f"lines along {axis} drawn for every pixel, of {wires.wanted} asked for: {wires.transparent} transparent, "
            f"{how}",
        )


_ROUNDING_UM = 1 / NM_PER_UM


def footprint_band(
    die: Die, feasibility: Feasibility, rules: EmitterRules, process: Process, spread: ProcessSpread
) -> tuple[Quantity, ...]:
    """The band of a die's footprint, as a row of a report; none without emitters or a spread of the bias."""
    drawn = feasibility.emitters
    if drawn is None or not spread.bias_um:
        return ()
    pixel_um2 = die.panel.cell_size.pitch_um**2

    def footprint(bias_um: float) -> float:
        left = left_of_emitters(die.panel, rules, round(bias_um / 2 * NM_PER_UM))
        red, green, blue = (share * area / pixel_um2 for share, area in zip(left, drawn.areas_um2, strict=True))
        return footprint_of((red, green, blue), rules)

    off = float(scipy.special.ndtri((1 + SHARE) / 2)) * spread.bias_um
    wide, narrow = (footprint(process.cd_bias_um + change) for change in (off, -off))
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
