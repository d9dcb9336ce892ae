"""A die's display: rows of its report, its part of report.json, and what ``maskfab check`` tells of it.

Rows are of emitters, borders, circuits, wires and light, and of the effect of wires on the picture: the light that they
leave, and the change of the PSF.

The band of a footprint is that over the displays that are made: a wider opening leaves the emitters less room. Emitters
are drawn once, and openings are written wider or narrower about them. Of the emitters counts what keeps its gap to the
openings as written. That falls as the bias grows, so that the edges of the band are those of the bias: two full cases,
without an expansion. Rounder corners of openings leave more room, which is not counted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field
from scipy.special import ndtri

from maskfab.base.model import COLOURS, ORIENTATIONS, Die, Quantity
from maskfab.base.quantities import registered
from maskfab.base.units import NM_PER_UM
from maskfab.display.circuits import Circuits
from maskfab.display.drive import AT_MA_PER_CM2, FIXED_V, RISING_V, LightDemand
from maskfab.display.emitter_rules import Certificate, EmitterRules, Verdict
from maskfab.display.eye import FINE_CPD, SLOW_CPD
from maskfab.display.feasibility import Feasibility, PlateWithDisplays, footprint_of
from maskfab.display.limits import Judgement, Limited, kept
from maskfab.display.placement import LargestGap
from maskfab.display.polygon_check import Violation, left_of_emitters
from maskfab.job.camera import Camera
from maskfab.job.process import Process
from maskfab.optics.metrics import relative_difference
from maskfab.optics.psf import point_psf
from maskfab.optics.pupil import cut, panel_aperture, veil
from maskfab.report.documents.shape import (
    Document,
    OneOf,
    Pair,
    Part,
    QuantityPart,
    Text,
    WholePair,
    optional,
    titled_schema,
    written,
)
from maskfab.report.rows.bands import SHARE, ProcessSpread
from maskfab.report.rows.text import quantity_document


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
            die=die.name,
        ),
        Quantity(
            "wired_psf_change",
            relative_difference(wired, bare),
            "relative L2 of the point PSF with the wires against that without, each over the light it holds: mean "
            "amplitude and mean power of every dot",
            wavelength_nm=wavelength,
            die=die.name,
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
    rows = (*_emitters(die, feasibility), *_judged_rows(feasibility, die.name), *through)
    return tuple(_exempted(row) for row in rows) if exempt else rows


_EXEMPT = frozenset(
    ("led_footprint", "flat_delta_e_mean", "grain_slow", "edge_fringe", "reference_life", "reference_power")
)


def _exempted(row: Quantity) -> Quantity:
    """A row that is not held against its limit."""
    if row.passed is None or row.name not in _EXEMPT:
        return row
    return replace(row, passed=None, method=f"{row.method}; not held against the reference die")


def _emitters(die: Die, feasibility: Feasibility) -> Iterator[Quantity]:
    footprint, name, required = feasibility.footprint, die.name, feasibility.required
    yield Quantity(
        "led_footprint",
        feasibility.share,
        "share of a pixel, gutter included, that one colour of the emitters drawn covers; areas counted in cells",
        limit=required or None,
        passed=feasibility.share >= required - 1e-12 if required else None,
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
    room = feasibility.room
    yield Quantity(
        "circuit_room",
        room.area_um2,
        f"closed area of a pixel wide enough for circuits, which need {room.need_um2:.0f} um^2; counted in cells: a "
        f"bound, {'not placed' if feasibility.circuits is None else 'for their boxes decide'}",
        die=name,
    )
    yield from _circuit_rows(feasibility, name)
    yield from _wire_rows(die, feasibility)
    if feasibility.emitters is None:
        return
    for colour, own in zip(COLOURS, feasibility.own_rooms, strict=False):
        yield Quantity(
            f"circuit_room_{colour}",
            own.area_um2,
            f"the same under the {colour} emitter, where a circuit of its own needs {own.need_um2:.0f} um^2",
            die=name,
        )
    if feasibility.reaches:
        yield Quantity(
            "emitters_stranded",
            len(feasibility.stranded),
            f"of {len(feasibility.reaches)} connected emitters, those from which no chain of closed dots that share "
            "sides leads to the pixel's side, and no transparent wire does",
            die=name,
        )
    broken = "; ".join(f"{rule.rule}, {rule.area_um2:g} um^2" for rule in feasibility.broken[:3])
    yield Quantity(
        "emitter_rules_broken",
        len(feasibility.broken),
        "rules of gap and width that the emitters' polygons break, measured by KLayout on a tile in which all pairs of "
        f"neighbours meet{': ' if broken else ''}{broken}",
        limit=0,
        passed=not feasibility.broken,
        die=name,
    )
    yield Quantity(
        "luminance_centroid",
        (feasibility.centroid_px[0] ** 2 + feasibility.centroid_px[1] ** 2) ** 0.5,
        "distance of the light's centroid from the pixel's centre, colours weighted with their share of white",
        die=name,
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
                die=name,
            )
            yield Quantity(
                f"relative_life_{colour}",
                feasibility.life[number],
                "life over that of an emitter of 9.3 % of the pixel (a vendor's claim for panels of 300 DPI) at the "
                f"same luminance, (J / J')^-n with n = {light.ageing_exponent:g}{source}",
                die=name,
            )


def _circuit_rows(feasibility: Feasibility, name: str) -> Iterator[Quantity]:
    circuits = feasibility.circuits
    if circuits is None:
        return
    yield Quantity(
        "circuit_boxes_placed",
        len(circuits.boxes),
        f"of {circuits.wanted} boxes of {circuits.area_um2:g} um^2 together; places on a grid of "
        f"{circuits.cell_nm / NM_PER_UM:g} um, found by rules of thumb and by search, or excluded by a proof",
        die=name,
    )
    broken = "; ".join(f"{rule.rule}, {rule.area_um2:g} um^2" for rule in circuits.broken[:3])
    yield Quantity(
        "circuit_rules_broken",
        len(circuits.broken),
        "rules of gap and size that the polygons of circuits break, measured by KLayout on a tile in which all pairs "
        f"of neighbours meet{': ' if broken else ''}{broken}",
        limit=0,
        passed=not circuits.broken,
        die=name,
    )


_ROWS: Mapping[str, tuple[str, str]] = MappingProxyType(
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


def _judged_rows(feasibility: Feasibility, name: str) -> Iterator[Quantity]:
    """Numbers of the eye and of life; limits that the job states are judged, and defaults are told."""
    judged = feasibility.judged
    if judged is None:
        return
    if judged.reference_shares is not None:
        yield Quantity(
            "reference_footprint",
            min(judged.reference_shares),
            f"share of a pixel that the least of the colours covers in {judged.layout}, the regular display at the "
            "die's pitch, without openings, drawn by the rules of the emitters",
            die=name,
        )
    for number in (*judged.looks, *judged.lives):
        row, how = _ROWS[number.name]
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
            die=name,
        )


def _wire_rows(die: Die, feasibility: Feasibility) -> Iterator[Quantity]:
    wires, name = feasibility.wiring, die.name
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

    off = float(ndtri((1 + SHARE) / 2)) * spread.bias_um
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


_VERDICTS = OneOf(tuple(verdict.value for verdict in Verdict))


class _Colours(Part):
    red: float
    green: float
    blue: float


class _Emitters(Part):
    cell_um: float = written()
    areas_um2: _Colours = written()
    centroid_px: Pair = written()
    wander_px: float = written()
    circuit_rooms_um2: list[float] = written()
    pieces: int = written()
    stranded: int = written()


class _Box(Part):
    name: str
    circuit: int
    box_um: Annotated[list[float], Field(min_length=4, max_length=4)]


class _Boxes(Part):
    verdict: Annotated[str, _VERDICTS]
    wanted: int
    area_um2: float
    placed: list[_Box]
    broken: list[str]


class _Circuits(Part):
    room_um2: float
    need_um2: float
    not_modelled: str = optional()
    boxes: _Boxes = optional("places in a pixel of orientation 0, its lower left corner the origin; x0, y0, x1, y1")


class _Borders(Part):
    side_pairs: int
    side_violations: int
    diagonal_pairs: int
    diagonal_violations: int
    worst_pair: WholePair | None
    sufficient_margin_um: float


class _Wires(Part):
    verdict: Annotated[str, _VERDICTS] = written()
    wanted: int
    in_gutter: int = written()
    through: Pair = written()
    transparent: int = written()
    laid: bool = written()
    lines: Pair
    broken: list[str] = written()


class _Proof(Part):
    proof: str
    statement: str
    numbers: dict[str, float]


class _Limited(Part):
    name: str
    value: float
    reference: float | None = Field(description="of the regular display; null without one")
    unit: str
    limit: float | None = Field(description="null: nothing judges it")
    stated: bool = Field(description="whether the job states the limit, which is else a default")
    passed: bool | None
    source: str = written()


class _Judged(Part):
    verdict: Literal["KEPT", "BROKEN"]
    seen: str = optional("pixels and place of the eye")
    pitch_um: float = optional("at which the display is looked at")
    distance_um: float = optional("from the eye to the display")
    numbers: list[_Limited]


class _Reference(Part):
    layout: Literal["stripe", "pentile", "delta"]
    emitter_share: float = Field(description="share of a pixel that the least of the colours covers")


class DisplayPart(Part):
    """The answer about one panel; lengths in micrometres, areas in square micrometres, shares of a pixel."""

    verdict: Annotated[Text, _VERDICTS]
    required: float
    share: float
    found_share: float = written()
    bound_share: float
    rectangles_share: float = written()
    method: str = written()
    emitters: _Emitters | None
    circuits: _Circuits = written()
    borders: _Borders | None = written()
    wires: _Wires | None
    proofs: list[_Proof] = written()
    bound_proof: _Proof | None = written()
    looks: _Judged = optional("limits of the eye")
    lives: _Judged = optional("limits of life and power, beside the reference at equal luminance")
    reference: _Reference = optional("regular display at the die's pitch, without openings, by the same rules")


def display_document(display: Feasibility) -> Document:
    """The display of a die of report.json."""
    footprint, borders, emitters, wiring = display.footprint, display.borders, display.emitters, display.wiring
    return DisplayPart.document(
        display,
        verdict=display.verdict.value,
        found_share=footprint.found_share,
        bound_share=footprint.bound_share,
        rectangles_share=footprint.rectangles_share,
        method=footprint.method,
        emitters=emitters
        and _Emitters.document(
            display,
            cell_um=emitters.cell_nm / NM_PER_UM,
            areas_um2=dict(zip(COLOURS, emitters.areas_um2, strict=True)),
            circuit_rooms_um2=[room.area_um2 for room in display.own_rooms],
            pieces=len(display.reaches),
            stranded=len(display.stranded),
        ),
        circuits=_Circuits.document(
            display,
            room_um2=display.room.area_um2,
            need_um2=display.room.need_um2,
            boxes=display.circuits and _boxes(display.circuits),
        ),
        borders=borders
        and _Borders.document(
            borders,
            worst_pair=borders.worst,
            sufficient_margin_um=borders.margin_nm / NM_PER_UM,
        ),
        wires=wiring
        and _Wires.document(
            wiring,
            verdict=wiring.verdict.value,
            laid=wiring.laid is not None,
            broken=[violation.rule for violation in wiring.broken],
        ),
        proofs=[_proof(certificate) for certificate in display.certificates],
        bound_proof=footprint.certificate and _proof(footprint.certificate),
        **_judged_parts(display.judged),
    )


def _judged_parts(judged: Judgement | None) -> dict[str, Document]:
    if judged is None:
        return {}
    parts = {"looks": _limits(judged.looks, judged)}
    if judged.reference_shares is not None:
        parts["lives"] = _limits(judged.lives)
        parts["reference"] = _Reference.document(judged, emitter_share=min(judged.reference_shares))
    return parts


def _limits(numbers: Sequence[Limited], looked: Judgement | None = None) -> Document:
    return _Judged.document(
        verdict="KEPT" if kept(numbers) else "BROKEN",
        seen=None if looked is None else looked.where,
        pitch_um=None if looked is None else looked.seen_pitch_um,
        distance_um=None if looked is None else looked.distance_um,
        numbers=[_Limited.document(number, unit=registered(_ROWS[number.name][0]).unit) for number in numbers],
    )


def _boxes(circuits: Circuits) -> Document:
    return _Boxes.document(
        circuits,
        verdict=circuits.verdict.value,
        placed=[_Box.document(box, box_um=[along / NM_PER_UM for along in box.box_nm]) for box in circuits.boxes],
        broken=[violation.rule for violation in circuits.broken],
    )


def _proof(certificate: Certificate) -> Document:
    return _Proof.document(certificate, proof=certificate.proof.value, numbers=dict(certificate.numbers))


class _Broken(Part):
    rule: str
    area_um2: float
    place_um: Pair


class _Room(Part):
    room_um2: float
    closed_um2: float
    need_um2: float
    not_modelled: str


class _Light(Part):
    density_ma_per_cm2: _Colours
    relative_life: _Colours
    centroid_px: Pair
    wander_px: float


class _Gap(Part):
    found_um: float | None
    excluded_um: float | None


class _CheckedDie(Part):
    name: str
    display: DisplayPart | None
    quantities: list[QuantityPart]
    broken: list[_Broken] | None
    circuits: _Room | None
    light: _Light | None
    largest_gap: _Gap | None


class CheckPart(Part):
    """Every die with the answer about it; ``display`` is null where a sheet has no pixels, ``unused`` names what of the
    job the answer does not depend on."""

    job_hash: str
    verdict: Literal["pass", "fail"]
    dies: list[_CheckedDie]
    unused: list[str]


def check_schema() -> Document:
    """The JSON Schema (draft 2020-12) of what ``maskfab check --json`` prints."""
    return titled_schema("maskfab check", CheckPart)


def check_document(
    built: PlateWithDisplays,
    gaps: Mapping[str, LargestGap],
    digest: str,
    unused: Sequence[str] = (),
    notes: Mapping[str, Quantity] = MappingProxyType({}),
    *,
    passed: bool,
) -> Document:
    """Document that ``maskfab check --json`` prints.

    Args:
        gaps: the largest ones that displays bear, by die.
        unused: what of the job the answer does not depend on.
    """
    return CheckPart.document(
        job_hash=digest,
        verdict="pass" if passed else "fail",
        dies=[
            _checked_die(die, built.displays.get(die.name), gaps.get(die.name), notes.get(die.name))
            for die in built.plate.dies
        ],
        unused=list(unused),
    )


def _checked_die(die: Die, display: Feasibility | None, gap: LargestGap | None, note: Quantity | None) -> Document:
    if display is None:
        return _CheckedDie.document(name=die.name, quantities=[])
    numbers = display_quantities(die, display)
    return _CheckedDie.document(
        name=die.name,
        display=display_document(display),
        quantities=[quantity_document(number) for number in (*numbers, *([note] if note else []))],
        broken=[
            _Broken.document(violation, place_um=[along / NM_PER_UM for along in violation.place_nm])
            for violation in display.broken
        ],
        circuits=_Room.document(display.room, room_um2=display.room.area_um2, not_modelled=display.not_modelled),
        light=None
        if display.density_ma_per_cm2 is None or display.life is None
        else _Light.document(
            display,
            density_ma_per_cm2=dict(zip(COLOURS, display.density_ma_per_cm2, strict=True)),
            relative_life=dict(zip(COLOURS, display.life, strict=True)),
            centroid_px=list(display.centroid_px),
        ),
        largest_gap=gap
        and _Gap.document(
            found_um=None if gap.found_nm is None else gap.found_nm / NM_PER_UM,
            excluded_um=None if gap.excluded_nm is None else gap.excluded_nm / NM_PER_UM,
        ),
    )


Line = tuple[str, str]


def display_lines(
    name: str, display: Feasibility | None, gap: LargestGap | None, seed: Quantity | None = None
) -> Iterator[str]:
    """The lines for one die; None stands for a sheet that has no pixels, ``seed`` is a note on the die's."""
    if display is None:
        yield f"{name}: no pixels to place emitters in"
        return
    words = [f"FITS: {display.verdict}"]
    if (judged := display.judged) is not None:
        answers = (("LOOKS", judged.looks), ("LIVES", judged.lives))
        words += [f"{word}: {'KEPT' if kept(numbers) else 'BROKEN'}" for word, numbers in answers if numbers]
    yield f"{name}: {', '.join(words)}; {display.circuits_by}"
    for part in (_footprint, _placement, _circuits, _wires, _light_text, _proofs):
        for label, text in part(display):
            yield f"  {label:<16} {text}"
    if seed is not None:
        yield f"  {'note':<16} {seed.method}"
    if gap is not None:
        yield f"  {'widest gap':<16} {_gap(gap)}"


def _footprint(display: Feasibility) -> Iterator[Line]:
    footprint = display.footprint
    required = f"; required {100 * display.required:.2f} %" if display.required else ""
    method = f" ({footprint.method})" if footprint.best is not None else ""
    most = f"at most {100 * footprint.bound_share:.2f} %{required}"
    yield "footprint", f"{100 * footprint.found_share:.2f} %{method}, {most}"
    yield "rectangles", f"{100 * footprint.rectangles_share:.2f} %"


def _placement(display: Feasibility) -> Iterator[Line]:
    if display.emitters is None:
        return
    yield (
        "areas",
        ", ".join(f"{letter} {area:.10g}" for letter, area in zip("RGB", display.emitters.areas_um2, strict=True))
        + " um^2",
    )
    borders = display.borders
    if borders is not None:
        yield (
            "borders",
            f"{borders.side_violations} of {borders.side_pairs} pairs at sides and {borders.diagonal_violations} of "
            f"{borders.diagonal_pairs} at corners are too close; {borders.margin_nm / NM_PER_UM:g} um of clearance "
            "along all sides would suit any neighbour",
        )
    if not display.broken:
        yield "rules broken", "none, measured from the polygons"
    for violation in display.broken:
        yield "rules broken", _broken(violation)


def _broken(violation: Violation) -> str:
    x, y = (along / NM_PER_UM for along in violation.place_nm)
    return f"{violation.rule}: {violation.area_um2:g} um^2 near ({x:g}, {y:g}) um"


def _circuits(display: Feasibility) -> Iterator[Line]:
    room, circuits = display.room, display.circuits
    area = f"{room.area_um2:.0f} um^2 available, {room.need_um2:.0f} um^2 needed"
    if circuits is None:
        yield "circuits", f"{area} (bound, not placed)"
    else:
        yield "circuits", f"{circuits.verdict}: {circuits.told}, {circuits.area_um2:g} um^2 without gaps"
        for violation in circuits.broken:
            yield "rules broken", _broken(violation)
        yield "circuit area", f"{area} (bound, which does not decide)"
    yield "not modelled", display.not_modelled


def _wires(display: Feasibility) -> Iterator[Line]:
    wires = display.wiring
    if wires is None:
        return
    if wires.laid is not None:
        drawn = f"{wires.wanted - wires.transparent} laid across the panel each way"
    else:
        along_x, along_y = wires.through
        drawn = f"{wires.in_gutter} in the gutter, {along_x} along x and {along_y} along y through closed area"
    yield "wires", f"{wires.verdict}: of {wires.wanted} lines {wires.transparent} transparent, {drawn}"
    for violation in wires.broken:
        yield "rules broken", _broken(violation)


def _light_text(display: Feasibility) -> Iterator[Line]:
    if display.emitters is None:
        return
    x, y = display.centroid_px
    yield "light", f"centroid at ({x:.4f}, {y:.4f}) px; shifts by {display.wander_px:.4f} px RMS between orientations"
    if display.density_ma_per_cm2 is not None:
        yield "current density", f"{_colours(display.density_ma_per_cm2)} mA/cm2"
    if display.life is not None:
        yield "relative life", _colours(display.life)
    judged = display.judged
    if judged is None:
        return
    yield "seen", judged.where
    for word, numbers in (("looks", judged.looks), ("lives", judged.lives)):
        for number in numbers:
            yield word, _told(number, judged.layout)


def _told(number: Limited, layout: str) -> str:
    beside = f", {layout} {number.reference:.3g}" if number.reference is not None else ""
    verdict = "" if number.passed is None else "  KEPT" if number.passed else "  BROKEN"
    whose = "" if number.limit is None or number.stated else ", a default"
    limit = "" if number.limit is None else f"; limit {number.sign} {number.limit:.3g}{whose}"
    return f"{number.title}: {number.value:.3g}{beside}{limit}{verdict}"


def _proofs(display: Feasibility) -> Iterator[Line]:
    for certificate in display.certificates:
        yield "proof", certificate.statement
    bound = display.footprint.certificate
    if bound is not None and bound not in display.certificates:
        yield "bound", bound.statement


def _gap(gap: LargestGap) -> str:
    fits = "no placement was found at any gap" if gap.found_nm is None else f"{gap.found_nm / NM_PER_UM:g} um fits"
    if gap.excluded_nm is None:
        return f"{fits}; no gap within the pixel is proven impossible"
    return f"{fits}; {gap.excluded_nm / NM_PER_UM:g} um is proven impossible"


def _colours(values: Iterable[float]) -> str:
    return ", ".join(f"{letter} {value:.4g}" for letter, value in zip("RGB", values, strict=True))
