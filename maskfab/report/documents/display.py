"""A die's display as documents and as text: its part of report.json, and what ``maskfab check`` tells of it and of its
look."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from maskfab.base import __version__
from maskfab.base.model import COLOURS, Die, Quantity
from maskfab.base.quantities import registered
from maskfab.base.units import NM_PER_UM, UM_PER_MM, dpi
from maskfab.display.circuits import Circuits
from maskfab.display.emitter_rules import Certificate, Verdict
from maskfab.display.eye import SeenPanel
from maskfab.display.eye_and_life import Judgement, Limited, kept
from maskfab.display.feasibility import Feasibility, PlateWithDisplays
from maskfab.display.placement import LargestGap
from maskfab.display.polygon_check import Violation
from maskfab.findings.display import JUDGED_ROWS, display_quantities
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
from maskfab.report.text import quantity_document
from maskfab.report.verdicts import BROKEN, KEPT, LIVES, LOOKS, LimitVerdict

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
    verdict: LimitVerdict
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
    kept: list[str] = written("layouts that came with maskfab and were proved again, so that no search was needed")
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
        kept=list(display.kept),
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
        and _Borders.document(borders, worst_pair=borders.worst, sufficient_margin_um=borders.margin_nm / NM_PER_UM),
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
        verdict=KEPT if kept(numbers) else BROKEN,
        seen=None if looked is None else looked.where,
        pitch_um=None if looked is None else looked.seen_pitch_um,
        distance_um=None if looked is None else looked.distance_um,
        numbers=[_Limited.document(number, unit=registered(JUDGED_ROWS[number.name][0]).unit) for number in numbers],
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
    """Document that ``maskfab check --json`` prints, largest gaps by die, and what of the job does not matter."""
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


_RENDERED_VERSION = 1


def render_document(panels: Sequence[SeenPanel], samples: int, job_hash: str, unused: Sequence[str] = ()) -> Document:
    """Everything that was measured, and what of the job was not used; what render.json and ``--json`` say."""
    viewing = panels[0].viewing
    return {
        "schema_version": _RENDERED_VERSION,
        "maskfab_version": __version__,
        "job_hash": job_hash,
        "viewing": {"distance_mm": viewing.distance_um / UM_PER_MM, "samples_per_pixel": samples},
        "dies": [
            {
                "name": panel.name,
                "pitch_um": panel.viewing.pitch_um,
                "dpi": dpi(panel.viewing.pitch_um),
                "quantities": [quantity_document(quantity) for quantity in panel.quantities],
            }
            for panel in panels
        ],
        "unused": list(unused),
    }


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
        answers = ((LOOKS, judged.looks), (LIVES, judged.lives))
        words += [f"{word}: {'KEPT' if kept(numbers) else 'BROKEN'}" for word, numbers in answers if numbers]
    yield f"{name}: {', '.join(words)}; {display.circuits_by}"
    yield f"  {'resolution':<16} {display.resolution}"
    for part in (_footprint, _placement, _circuits, _wires, _light_text, _proofs):
        for label, text in part(display):
            yield f"  {label:<16} {text}"
    if display.kept:
        yield f"  {'kept':<16} {', '.join(display.kept)}: came with maskfab, and proved again by every rule"
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
        if display.around is not None:
            yield "circuits around", f"{display.around.verdict}: {display.around.told}"
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
