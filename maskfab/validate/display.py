"""What is told of a die's display: emitters, borders, circuits, wires and light."""

from __future__ import annotations

from collections.abc import Iterator

from maskfab.imaging.grain import SLOW_CPD, predicted_rms
from maskfab.imaging.viewing import Viewing
from maskfab.layout.feasibility import Feasibility
from maskfab.model import COLOURS, Die, Quantity
from maskfab.units import NM_PER_UM

_DISTANCE_UM = 3e5


def display_quantities(die: Die, found: Feasibility) -> tuple[Quantity, ...]:
    """The numbers of one die's display; the footprint is judged if one is required, broken rules always."""
    return tuple(_emitters(die, found))


def _emitters(die: Die, found: Feasibility) -> Iterator[Quantity]:
    footprint, name, required = found.footprint, die.name, found.required
    yield Quantity(
        "led_footprint",
        "a",
        footprint.found_share,
        "1",
        f"share of a pixel, gutter included, that one colour covers ({footprint.method}); areas counted in cells",
        limit=required or None,
        passed=footprint.found_share >= required - 1e-12 if required else None,
        die=name,
    )
    why = "" if footprint.certificate is None else f": {footprint.certificate.statement}"
    yield Quantity(
        "led_footprint_bound", "ā", footprint.bound_share, "1", f"no placement under the rules has more{why}", die=name
    )
    yield Quantity(
        "led_footprint_rectangles",
        "a□",
        footprint.rectangles_share,
        "1",
        "the largest share of three rectangles, exact: window table and two straight cuts",
        die=name,
    )
    room = found.room
    yield Quantity(
        "circuit_room",
        "A",
        room.area_um2,
        "um2",
        f"closed area of a pixel wide enough for circuits, which need {room.need_um2:.0f} um2; counted in cells",
        die=name,
    )
    yield from _wires(die, found)
    if found.emitters is None:
        return
    broken = "; ".join(f"{each.rule}, {each.area_um2:g} um2" for each in found.broken[:3])
    yield Quantity(
        "emitter_rules_broken",
        "n",
        len(found.broken),
        "1",
        "rules of gap and width that the emitters' polygons break, measured by KLayout on a tile in which all pairs of "
        f"neighbours meet{': ' if broken else ''}{broken}",
        limit=0,
        passed=not found.broken,
        die=name,
    )
    yield Quantity(
        "luminance_centroid",
        "|c|",
        (found.centroid_px[0] ** 2 + found.centroid_px[1] ** 2) ** 0.5,
        "px",
        "distance of the light's centroid from the pixel's centre, colours weighted with their share of white",
        die=name,
    )
    viewing = Viewing(die.panel.pitch_nm / NM_PER_UM, _DISTANCE_UM)
    yield Quantity(
        "grain_rms",
        "σ",
        predicted_rms(found.wander_px, viewing),
        "1",
        f"luminance contrast of an even field up to {SLOW_CPD:g} cycles per degree at {_DISTANCE_UM / 1e3:g} mm, "
        "5.57 (F/ppd)² |c|, c the centroid off its mean over the orientations",
        die=name,
    )
    for number, colour in enumerate(COLOURS):
        if found.density_ma_per_cm2 is not None and found.life is not None:
            yield Quantity(
                f"current_density_{colour}",
                "J",
                found.density_ma_per_cm2[number],
                "mA/cm2",
                "luminance of white x the colour's share / (efficacy x area share)",
                die=name,
            )
            yield Quantity(
                f"relative_life_{colour}",
                "t",
                found.life[number],
                "1",
                "life over that of an emitter of 9.3 % of the pixel at the same luminance, (J / J')^-n",
                die=name,
            )


def _wires(die: Die, found: Feasibility) -> Iterator[Quantity]:
    wires, name = found.wiring, die.name
    if wires is None:
        return
    for axis, through, bound, proof in zip("xy", wires.through, wires.bounds, wires.proofs, strict=True):
        yield Quantity(
            f"wire_lines_{axis}",
            "n",
            wires.in_gutter + through + wires.transparent,
            "1",
            f"lines along {axis} drawn across every pixel, of {wires.wanted} asked for: {wires.in_gutter} in the "
            f"gutter, {through} through closed area, {wires.transparent} transparent",
            die=name,
        )
        yield Quantity(
            f"wire_lines_{axis}_bound", "n̄", bound, "1", f"opaque lines on one metal: {proof.statement}", die=name
        )
