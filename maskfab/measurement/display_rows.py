"""Report rows of a die's display: emitters, borders, circuits, wires and light."""

from __future__ import annotations

from collections.abc import Iterator

from maskfab.display.feasibility import Feasibility
from maskfab.display.light import LightDemand
from maskfab.eye.grain import SLOW_CPD, predicted_rms
from maskfab.eye.viewing import TELEPHONE_UM, Viewing
from maskfab.measurement.wired import wired_quantities
from maskfab.model import COLOURS, Camera, Die, Quantity
from maskfab.units import UM_PER_MM


def display_quantities(die: Die, found: Feasibility, camera: Camera | None = None) -> tuple[Quantity, ...]:
    """The numbers of one die's display; the footprint is judged if one is required, broken rules always.

    Args:
        die: with its emitters and wires.
        found: what was found of it.
        camera: what looks through its wires; without one nothing is told of what they do to the picture.
    """
    through = () if camera is None else wired_quantities(die, camera)
    return (*_emitters(die, found), *through)


def _emitters(die: Die, found: Feasibility) -> Iterator[Quantity]:
    footprint, name, required = found.footprint, die.name, found.required
    yield Quantity(
        "led_footprint",
        found.share,
        "share of a pixel, gutter included, that one colour of the emitters drawn covers; areas counted in cells",
        limit=required or None,
        passed=found.share >= required - 1e-12 if required else None,
        die=name,
    )
    yield Quantity(
        "led_footprint_largest",
        footprint.found_share,
        f"the largest share that was found ({footprint.method}); the emitters drawn may be smaller and better centred",
        die=name,
    )
    why = "" if footprint.certificate is None else f": {footprint.certificate.statement}"
    yield Quantity(
        "led_footprint_bound", footprint.bound_share, f"no placement under the rules has more{why}", die=name
    )
    yield Quantity(
        "led_footprint_rectangles",
        footprint.rectangles_share,
        "the largest share of three rectangles, exact: window table and two straight cuts",
        die=name,
    )
    room = found.room
    yield Quantity(
        "circuit_room",
        room.area_um2,
        f"closed area of a pixel wide enough for circuits, which need {room.need_um2:.0f} um^2; counted in cells, none "
        "of them placed",
        die=name,
    )
    yield from _wires(die, found)
    if found.emitters is None:
        return
    for colour, own in zip(COLOURS, found.own_rooms, strict=False):
        yield Quantity(
            f"circuit_room_{colour}",
            own.area_um2,
            f"the same under the {colour} emitter, where a circuit of its own needs {own.need_um2:.0f} um^2",
            die=name,
        )
    if found.reaches:
        yield Quantity(
            "emitters_stranded",
            len(found.stranded),
            f"of {len(found.reaches)} connected emitters, those from which no chain of closed dots that share sides "
            "leads to the pixel's side, and no transparent wire does",
            die=name,
        )
    broken = "; ".join(f"{each.rule}, {each.area_um2:g} um^2" for each in found.broken[:3])
    yield Quantity(
        "emitter_rules_broken",
        len(found.broken),
        "rules of gap and width that the emitters' polygons break, measured by KLayout on a tile in which all pairs of "
        f"neighbours meet{': ' if broken else ''}{broken}",
        limit=0,
        passed=not found.broken,
        die=name,
    )
    yield Quantity(
        "luminance_centroid",
        (found.centroid_px[0] ** 2 + found.centroid_px[1] ** 2) ** 0.5,
        "distance of the light's centroid from the pixel's centre, colours weighted with their share of white",
        die=name,
    )
    viewing = Viewing(die.panel.cell_size.pitch_um, TELEPHONE_UM)
    yield Quantity(
        "grain_rms",
        predicted_rms(found.wander_px, viewing),
        f"luminance contrast of an even field up to {SLOW_CPD:g} cycles per degree at {TELEPHONE_UM / UM_PER_MM:g} mm, "
        "5.57 (F/ppd)² |c|, c the centroid off its mean over the orientations",
        die=name,
    )
    light, usual = found.light, LightDemand()
    assumed = light.efficacy_cd_per_a == usual.efficacy_cd_per_a
    judged = " (a judgement; no source was found)" if assumed else ""
    claimed = light.ageing_exponent == usual.ageing_exponent
    source = ", from a vendor's claim of three times the life at 60 % emitting area instead of 28 %" if claimed else ""
    for number, colour in enumerate(COLOURS):
        if found.density_ma_per_cm2 is not None and found.life is not None:
            yield Quantity(
                f"current_density_{colour}",
                found.density_ma_per_cm2[number],
                f"luminance of white, {light.luminance_cd_per_m2:g} cd/m2, x the share {light.shares[number]:g} that "
                f"{colour} has of it (BT.709) / (efficacy, {light.efficacy_cd_per_a[number]:g} cd/A{judged}, x share "
                "of the pixel)",
                die=name,
            )
            yield Quantity(
                f"relative_life_{colour}",
                found.life[number],
                "life over that of an emitter of 9.3 % of the pixel (a vendor's claim for panels of 300 DPI) at the "
                f"same luminance, (J / J')^-n with n = {light.ageing_exponent:g}{source}",
                die=name,
            )


def _wires(die: Die, found: Feasibility) -> Iterator[Quantity]:
    wires, name = found.wiring, die.name
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
            die=name,
        )
