"""Feasibility of a display around an opening: emitters, their borders, circuits, wires and light, in one answer.

Dies of a plate get the emitters, circuits and wires of their job, or the obstacles to them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, WIRES, Die, Emitters, Mark, Opening, Panel, Plate, Tiling, refined
from maskfab.base.processes import ArgumentsFactory, Call, SerialExecutor
from maskfab.base.units import NM_PER_UM, to_nm
from maskfab.base.work import Progress, silent
from maskfab.display.camera_zone import CameraZone
from maskfab.display.circuit_boxes import BoxKind, BoxRules, check_boxes
from maskfab.display.circuits import Circuits, no_place, place_circuits
from maskfab.display.drive import (
    BOXES_ALONE,
    BY_AREA,
    BY_BOXES,
    NOT_PLACED,
    CircuitRules,
    LightDemand,
    Room,
    Triple,
    current_density,
    emitter_rooms,
    pixel_room,
    relative_life,
)
from maskfab.display.emitter_pieces import placed_in_pieces
from maskfab.display.emitter_rules import (
    Certificate,
    EmitterGrid,
    EmitterRules,
    Footprint,
    Verdict,
    check_widths,
    grid_of,
)
from maskfab.display.evenness import Evenness, evenness
from maskfab.display.eye_and_life import EyeAndLife, Judgement, judgement
from maskfab.display.free_area import Borders, borders, meetings
from maskfab.display.panel_lines import PanelLines
from maskfab.display.pixel_lines import WireRules
from maskfab.display.placement import LargestGap, centred, footprint, largest_gap, wander
from maskfab.display.polygon_check import Violation, violations
from maskfab.display.wiring import Reach, WireDemand, Wiring, check_wires, reaches, wiring
from maskfab.job.die import even_nm
from maskfab.job.faults import JobFaults
from maskfab.job.sections import (
    CircuitsSection,
    DisplaySection,
    EmittersSection,
    JobSpec,
    LightSection,
    LivesSection,
    LooksSection,
    WiresSection,
)
from maskfab.job.values import Section
from maskfab.mask.job import Job, check_die_grid
from maskfab.mask.panels import parse_map
from maskfab.optics.colour import luminance_centroid

REFERENCE_SHARE = 28 / 300
"""Area of one colour over the pixel's in a panel of today, 28 % for all three at 300 DPI (a vendor's claim for fine
metal masks); the life of emitters is told relative to it."""


@dataclass(frozen=True)
class DisplayRules:
    """Everything that a display's maker asks.

    Attributes:
        keep: share of the largest footprint that a placement with better centred light must have.
        pieces: whether a colour may lie in several pieces, for what the eye sees of turned pixels.
        zone: its pixels beside those of the display around.
    """

    emitters: EmitterRules
    keep: float
    circuit: CircuitRules
    light: LightDemand
    wires: WireDemand | None
    boxes: BoxRules | None = None
    pieces: bool = False
    zone: CameraZone = field(default_factory=CameraZone)
    eye: EyeAndLife = field(default_factory=lambda: EyeAndLife.of(None, None))

    @classmethod
    def of(
        cls,
        section: EmittersSection,
        light: LightSection | None,
        wires: WiresSection | None,
        circuits: CircuitsSection | None = None,
        looks: LooksSection | None = None,
        lives: LivesSection | None = None,
        zone: CameraZone | None = None,
        *,
        where: str = "",
    ) -> DisplayRules:
        """The rules of a job.

        Args:
            zone: pixels over the camera; by default those of the display around, which share circuits as stated.
        """
        zone = zone or CameraZone((circuits or section).shared_by)
        pieces = section.pieces == "several"
        if pieces and section.max_aspect is not None:
            what = "max_aspect is of emitters that are one rectangle each, and pieces asks for several"
            cure = 'Remove max_aspect, or pieces = "several"'
            raise JobError("MF105", what, where=f"{where}: emitters.max_aspect", cure=cure)
        if pieces and section.keep == 1:
            what = "keep = 1 leaves no room for several pieces, which have less area than whole emitters"
            cure = 'Set keep = 0.75, or remove pieces = "several"'
            raise JobError("MF105", what, where=f"{where}: emitters.keep", cure=cure)
        gap, colour, width = _nm(section, f"{where}: emitters", "gap_to_opening", "colour_gap", "min_width")
        aspect = float("inf") if section.max_aspect is None else section.max_aspect
        rules = EmitterRules(gap, colour, width, section.ratio, section.required, aspect)
        asked = light or LightSection()
        return cls(
            rules,
            section.keep,
            CircuitRules(section.circuit, section.circuits, zone.sharing, width),
            LightDemand(asked.luminance, asked.efficacy, ageing_exponent=asked.life_exponent),
            None if wires is None else _demand(wires, where),
            None if circuits is None else _boxes(circuits, zone.sharing, where),
            pieces,
            zone,
            EyeAndLife.of(looks, lives, zone),
        )

    @property
    def least_circuits_um2(self) -> float:
        """Area that the circuits of a pixel take at least."""
        return self.circuit.pixel_need_um2 if self.boxes is None else self.boxes.area_um2

    @property
    def circuits_asked(self) -> str:
        """Words on the demand."""
        many = "" if self.boxes is None else f"{self.boxes.boxes} boxes, "
        return f"{many}{self.least_circuits_um2:g} µm² for each pixel"

    def crowded(self, panel: Panel) -> Certificate | None:
        """A proof that the circuits of a panel's pixels have no room, by area, or no place, where boxes are stated."""
        if self.boxes is None:
            return pixel_room(panel.common, panel.dot_nm, self.circuit).certificate
        return no_place(panel, panel.common, self.boxes)


@dataclass(frozen=True, eq=False)
class Feasibility:
    """Display feasibility of one panel.

    Attributes:
        share: their own footprint: where ``keep`` lets better centred ones be smaller, below ``footprint.found_share``.
        circuits: their boxes in their places; None where no boxes are stated, and the area decides.
        own_rooms: under red, green and blue for a circuit each; empty without emitters, or where the circuits' width is
            no multiple of the cells of emitters that came with the opening.
        life: of each colour, relative to that of emitters of 9.3 % of the pixel each.
        wander_px: how far the centroid moves about over the orientations in use.
        even: what the eye sees of an even field whose pixels are turned at random; None without emitters.
        judged: limits of the eye and of life, held against the die as it is tiled; None where that was not asked.
        reaches: each connected emitter's way to the pixel's side through closed dots; empty if no wires were asked.
        around: boxes of a pixel of the display around, which has no opening and shares none; None where neither boxes
            nor that display are stated.
    """

    required: float
    footprint: Footprint
    room: Room
    circuits: Circuits | None
    wiring: Wiring | None
    given: bool
    light: LightDemand
    emitters: Emitters | None = None
    share: float = 0.0
    borders: Borders | None = None
    broken: tuple[Violation, ...] = ()
    own_rooms: tuple[Room, ...] = ()
    density_ma_per_cm2: Triple | None = None
    life: Triple | None = None
    centroid_px: tuple[float, float] = (0.0, 0.0)
    wander_px: float = 0.0
    reaches: tuple[Reach, ...] = ()
    even: Evenness | None = None
    judged: Judgement | None = None
    pitch_nm: int = 0
    zone: CameraZone = field(default_factory=CameraZone)
    around: Circuits | None = None

    @property
    def resolution_ppi(self) -> float:
        """Pixels per inch over the camera that have circuits of their own."""
        return self.zone.resolution_ppi(self.pitch_nm)

    @property
    def resolution(self) -> str:
        """That in words, and whether circuits are placed."""
        return f"{self.resolution_ppi:.0f} ppi: {self.zone.told(self.pitch_nm)}; {self.circuits_by}"

    @property
    def passed(self) -> bool:
        """Whether it fits; not knowing is enough as long as nothing is required and no rule is broken."""
        return self.verdict is Verdict.FITS or (
            self.verdict is Verdict.UNKNOWN and not self.required and not self.broken
        )

    @property
    def verdict(self) -> Verdict:
        """FITS if emitters and wires are there, keep every rule and leave room for circuits; any proof says no."""
        if self.certificates:
            return Verdict.DOES_NOT_FIT
        parts = [part.verdict for part in (self.circuits, self.around, self.wiring) if part is not None]
        broken = self.broken or (self.circuits is not None and self.circuits.broken)
        if broken or self.stranded or Verdict.UNKNOWN in parts:
            return Verdict.UNKNOWN
        return self.footprint.verdict

    @property
    def circuits_by(self) -> str:
        """Words on how circuits were judged."""
        return BY_AREA if self.circuits is None else BY_BOXES

    @property
    def not_modelled(self) -> str:
        """Words on what of circuits was not."""
        return NOT_PLACED if self.circuits is None else BOXES_ALONE

    @property
    def kept(self) -> tuple[str, ...]:
        """Parts of it that came with the program and were proved again, so that no search was needed."""
        laid = None if self.wiring is None or self.wiring.laid is None else self.wiring.laid[0]
        parts = {"largest emitters": self.footprint.best, "emitters drawn": self.emitters, "wires": laid}
        return tuple(name for name, part in parts.items() if part is not None and part.kept)

    @property
    def stranded(self) -> tuple[Certificate, ...]:
        """Why emitters of this placement have no way to the pixel's side; others might have one."""
        if self.wiring is not None and self.wiring.transparent:
            return ()
        return tuple(reach.certificate for reach in self.reaches if reach.certificate is not None)

    @property
    def certificates(self) -> tuple[Certificate, ...]:
        """Every proof that something cannot be."""
        proofs = [self.footprint.certificate if self.footprint.verdict is Verdict.DOES_NOT_FIT else None]
        circuits = self.room.certificate if self.circuits is None else self.circuits.certificate
        wires = None if self.wiring is None else self.wiring.failed
        around = None if self.around is None else self.around.certificate
        return tuple(proof for proof in (*proofs, circuits, wires, around) if proof is not None)


def feasibility(panel: Panel, rules: DisplayRules, *, largest: bool = True) -> Feasibility | None:
    """Emitters for the pixels of a panel, or a proof that there are none; None for a sheet that has no pixels.

    Emitters that come with the opening are taken as they are and measured; else the best that is found is placed.
    Where cells choose among several openings, emitters keep clear of all of them.

    Args:
        largest: search on for the largest emitters even if the required ones are found, as on a plate; designers try
            openings without.

    Raises:
        JobError: MF117 if a rule is wider than the pixel, MF118 if rules and dots share no grid coarse enough, MF120
            if a wire is wider than the pixel.
    """
    if panel.tiling is Tiling.HEXAGONAL:
        return None
    if rules.wires is not None:
        check_wires(panel, rules.wires)
    opening, given = panel.common, _given(panel)
    grid = grid_of(opening, panel.dot_nm, panel.gutter_nm, rules.emitters)
    found, emitters = _found(panel, grid, rules, given, largest=largest)
    answer = Feasibility(
        rules.emitters.required,
        found,
        pixel_room(opening, panel.dot_nm, rules.circuit),
        None if rules.boxes is None else place_circuits(panel, opening, rules.boxes),
        None if rules.wires is None else wiring(panel, opening, rules.wires),
        given is not None,
        rules.light,
        pitch_nm=panel.pitch_nm,
        zone=rules.zone,
        around=_around(panel, rules),
    )
    return answer if emitters is None else _with_emitters(answer, emitters, panel, grid, rules)


def _around(panel: Panel, rules: DisplayRules) -> Circuits | None:
    """Circuits of a pixel of the display around, where it is stated: one each, and no opening."""
    if rules.boxes is None or rules.zone.normal_nm is None:
        return None
    side_nm = rules.zone.around_nm(panel.pitch_nm)
    # A cell without openings has no dots to divide it by.
    closed = Opening("around", np.zeros((1, 1), dtype=np.bool_), side_nm)
    pixel = Panel(closed, side_nm, 0, np.zeros((1, 1), dtype=np.int8), Tiling.PERIODIC, None)
    return place_circuits(pixel, closed, replace(rules.boxes, shared_by=1))


def _found(
    panel: Panel, grid: EmitterGrid, rules: DisplayRules, given: Emitters | None, *, largest: bool
) -> tuple[Footprint, Emitters | None]:
    """Footprint of a panel's emitters, and those that it takes: those given, or else the best that are found."""
    opening, used = panel.common, _used(panel)
    found = footprint(opening, panel.dot_nm, panel.gutter_nm, used, rules.emitters, largest=largest)
    if given is not None:
        return found, given
    emitters = centred(found.best, opening, grid, panel.orientations, rules.emitters, keep=rules.keep)
    # In pixels that lie alike there is nothing to see but the lattice.
    if not rules.pieces or len(used) == 1 or not (largest or found.verdict is not Verdict.FITS):
        return found, emitters
    viewing = rules.eye.viewing(panel.cell_size.pitch_um)
    return placed_in_pieces(
        found,
        emitters,
        opening,
        grid,
        used,
        rules.emitters,
        keep=rules.keep,
        viewing=viewing,
        limits=rules.eye.limits,
        larger=rules.eye.asks_evenness,
    )


def _with_emitters(
    answer: Feasibility, emitters: Emitters, panel: Panel, grid: EmitterGrid, rules: DisplayRules
) -> Feasibility:
    """The answer about a panel whose pixels have these emitters, measured."""
    opening, placed = panel.common, answer.footprint
    red, green, blue = (area / panel.cell_size.pitch_um**2 for area in emitters.areas_um2)
    shares = (red, green, blue)
    density = current_density(rules.light, shares)
    reference = current_density(rules.light, (REFERENCE_SHARE,) * 3)
    lasting = (relative_life(j, r, rules.light.ageing_exponent) for j, r in zip(density, reference, strict=True))
    red_life, green_life, blue_life = lasting
    lit = replace(panel, emitters=emitters)
    broken = violations(lit, rules.emitters)
    # Emitters that break the rules say nothing of how large those can be that keep them.
    if answer.given and not broken:
        share = footprint_of(shares, rules.emitters)
        verdict = Verdict.FITS if share >= rules.emitters.required - 1e-12 else placed.verdict
        placed = replace(placed, best=emitters, found_share=share, verdict=verdict, method="given with the opening")
    cells, own = refined(opening.mask, grid.per_dot), rules.circuit.min_width_nm % emitters.cell_nm == 0
    return replace(
        answer,
        footprint=placed,
        emitters=emitters,
        share=footprint_of(shares, rules.emitters),
        borders=None if answer.given else borders(emitters.labels, cells, grid, panel.orientations),
        broken=broken,
        own_rooms=emitter_rooms(emitters, rules.circuit) if own else (),
        density_ma_per_cm2=density,
        life=(red_life, green_life, blue_life),
        centroid_px=luminance_centroid(emitters, panel.pitch_nm),
        wander_px=wander(emitters, panel.pitch_nm, _used(panel)),
        reaches=() if answer.wiring is None else reaches(~opening.mask, emitters),
        # White can be shown where every colour emits.
        even=evenness(lit, rules.eye.viewing(panel.cell_size.pitch_um)) if min(emitters.areas_um2) > 0 else None,
    )


def _used(panel: Panel) -> tuple[int, ...]:
    """The orientations of the panel's pixels."""
    return tuple(int(k) for k in np.unique(panel.orientations % ORIENTATIONS))


def _nm(section: Section, where: str, *names: str) -> tuple[int, ...]:
    """Lengths of a section in whole nanometres."""
    return tuple(to_nm(getattr(section, name), where=f"{where}.{name}", name=name) for name in names)


def _demand(section: WiresSection, where: str) -> WireDemand:
    line, transparent = (
        0 if value is None else even_nm(value, where=f"{where}: wires.{name}", name=name)
        for name, value in (("line", section.line), ("transparent", section.transparent))
    )
    space, clearance = _nm(section, f"{where}: wires", "space", "clearance")
    return WireDemand(WireRules(line, space, clearance), section.lines, transparent, section.transmission)


def _boxes(section: CircuitsSection, sharing: int, where: str) -> BoxRules:
    where = f"{where}: circuits"
    kinds = []
    for number, box in enumerate(section.boxes):
        width, height = _nm(box, f"{where}.boxes[{number}]", "width", "height")
        kinds.append(BoxKind(box.name, width, height, box.count))
    gap, to_opening = _nm(section, where, "gap", "gap_to_opening")
    return BoxRules(tuple(kinds), gap, to_opening, section.turnable, section.per_pixel, sharing)


def _given(panel: Panel) -> Emitters | None:
    drawn = panel.opening.emitters
    return None if drawn is None else Emitters(drawn, panel.dot_nm * panel.opening.dots // drawn.shape[0])


def footprint_of(shares: tuple[float, ...], rules: EmitterRules) -> float:
    """The footprint of emitters: the least area, as a share of the pixel, over its ratio."""
    return min(area / ratio for area, ratio in zip(shares, rules.ratio, strict=True))


NO_MAPS: Mapping[str, tuple[int, int]] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class PlateWithDisplays:
    """A plate with its displays, and the feasibility of each by die; none of dies that have no pixels."""

    plate: Plate
    displays: Mapping[str, Feasibility]


def populate(
    plate: Plate,
    rules: DisplayRules,
    progress: Progress = silent,
    *,
    maps: Mapping[str, tuple[int, int]] = NO_MAPS,
    executor: SerialExecutor | None = None,
) -> PlateWithDisplays:
    """Emitters, circuits and wires for every die, and what the eye sees of it.

    Dies of equal pixels, in which equal orientations meet, are worked on once.
    Wires that every pixel has alike are drawn with it, those that are laid across a die are marks of the plate.

    Args:
        maps: rows and columns of the orientation map, by die, of those that have one.

    Raises:
        JobError: MF117, MF118 as :func:`maskfab.display.feasibility.feasibility`; MF117 also for a reference display
            that is asked for and cannot be, MF115 for an eye too near to be modelled.
    """
    for pitch_nm in sorted({die.panel.pitch_nm for die in plate.dies if die.panel.tiling is not Tiling.HEXAGONAL}):
        rules.eye.refuse(pitch_nm, rules.emitters)
    dies: list[Die] = []
    lines: list[Mark] = []
    answers: dict[str, Feasibility] = {}
    keys = [(_key(die.panel), None if rules.wires is None else die.panel.orientations.tobytes()) for die in plate.dies]
    panels = {key: die.panel for key, die in zip(reversed(keys), reversed(plate.dies), strict=True)}
    distinct = list(dict.fromkeys(keys))
    # What was found of emitters is kept where limits of life change, which they do not depend on.
    placing = replace(rules, eye=replace(rules.eye, lives=LivesSection(), stated=False))
    calls = [Call(feasibility, _arguments(panels[key], placing)) for key in distinct]
    progress("emitters", 0, len(calls))
    tasks = (executor or SerialExecutor()).run_all(calls, lambda done: progress("emitters", done, len(calls)))
    by_key = {key: task.result() for key, task in zip(distinct, tasks, strict=True)}
    for key, die in zip(keys, plate.dies, strict=True):
        answer = by_key[key]
        if answer is None:
            dies.append(die)
            continue
        answers[die.name] = answer
        tracks = () if answer.wiring is None else answer.wiring.tracks
        if answer.wiring is not None and answer.wiring.laid is not None and rules.wires is not None:
            lines += [_drawn(die, lines_laid, rules.wires.rules.line_nm) for lines_laid in answer.wiring.laid]
        boxes = () if answer.circuits is None else answer.circuits.boxes
        panel = replace(die.panel, emitters=answer.emitters, tracks=tracks, circuits=boxes)
        dies.append(replace(die, panel=panel))
    built = PlateWithDisplays(replace(plate, dies=tuple(dies), marks=(*plate.marks, *lines)), answers)
    return _looked_at(built, rules, progress, maps, executor or SerialExecutor())


def _looked_at(
    built: PlateWithDisplays,
    rules: DisplayRules,
    progress: Progress,
    maps: Mapping[str, tuple[int, int]],
    executor: SerialExecutor,
) -> PlateWithDisplays:
    """Every display that shows white, as the eye sees it on its die."""
    panels = {die.name: die.panel for die in built.plate.dies if die.name in built.displays}
    lit = [name for name in panels if built.displays[name].even is not None]

    def given(name: str) -> ArgumentsFactory:
        # Neither wires nor circuits are seen.
        seen = replace(panels[name], tracks=(), circuits=())
        return lambda: (seen, rules.eye, rules.emitters, rules.light, maps.get(name))

    progress("looks", 0, len(lit))
    calls = [Call(judgement, given(name)) for name in lit]
    tasks = executor.run_all(calls, lambda done: progress("looks", done, len(calls)))
    judged = {name: task.result() for name, task in zip(lit, tasks, strict=True)}
    displays = {name: replace(answer, judged=judged.get(name)) for name, answer in built.displays.items()}
    return replace(built, displays=displays)


def display_rules(job: Job) -> DisplayRules | None:
    """Rules of the display maker; None if the job has no [emitters]."""
    spec = job.spec
    if spec.emitters is None:
        return None
    return rules_of(spec, spec.emitters, job.where)


def rules_of(spec: JobSpec, emitters: EmittersSection, where: str) -> DisplayRules:
    """Rules of a display that has these [emitters], and all else as a job says; MF105 for two answers on sharing."""
    stated = spec.display or DisplaySection()
    keys = {"display.sharing": stated.sharing, "emitters.shared_by": emitters.shared_by}
    keys |= {} if spec.circuits is None else {"circuits.shared_by": spec.circuits.shared_by}
    others = {
        key: many for key, many in keys.items() if many not in (None, spec.sharing, *((1,) if "by" in key else ()))
    }
    for key, many in others.items():
        what = f"{many} pixels share a circuit by {key}, and {spec.sharing} by another key"
        raise JobError("MF105", what, where=f"{where}: {key}", cure="State sharing of [display] alone")
    # A pitch in DPI is seldom of whole nanometres, and nothing is drawn by it.
    zone = CameraZone(spec.sharing, None if stated.normal is None else round(stated.normal * NM_PER_UM))
    return DisplayRules.of(emitters, spec.light, spec.wires, spec.circuits, spec.looks, spec.lives, zone, where=where)


def plate_of(job: Job, faults: JobFaults) -> Plate | None:
    """The plate of a job, and what no pixel of its dies can hold of the display, before any is looked at.

    Args:
        faults: gets MF105, MF107 and MF116 of the rules; MF106, MF117 and MF118 of a die; and what refuses the plate.
    """
    with faults:
        _check_display(job, faults)
    with faults:
        return job.plate()
    return None


def _check_display(job: Job, faults: JobFaults) -> None:
    rules = display_rules(job)
    if rules is None:
        return
    for number, die in enumerate(job.spec.die):
        with faults:
            opening = job.openings[die.name][0]
            check_die_grid(die, opening, job.spec.emitters, f"{job.where}: ", f"die[{number}]", pitch_alone=False)
            with faults.of_die(die.name):
                side_nm = CellSize(opening.dots, to_nm(die.dot)).dots_nm
                check_widths(rules.emitters, side_nm, where=f"{job.where}: emitters")
                if rules.boxes is not None:
                    check_boxes(rules.boxes, side_nm)


def displays(
    job: Job, plate: Plate | None = None, progress: Progress = silent, *, executor: SerialExecutor | None = None
) -> PlateWithDisplays:
    """The job's plate with the emitters, circuits and wires that the job asks for; by an executor, if there is one."""
    rules = display_rules(job)
    plate = job.plate() if plate is None else plate
    if rules is None:
        return PlateWithDisplays(plate, {})
    return populate(plate, rules, progress, maps=map_sizes(job), executor=executor)


def map_sizes(job: Job) -> dict[str, tuple[int, int]]:
    """Rows and columns of the orientation map, by die, of those that have one."""
    named = {die.name: die.map for die in job.spec.die if die.map is not None}
    cells = {name: parse_map(job.spec.maps[text]).cells for name, text in named.items()}
    return {name: (len(own), len(own[0])) for name, own in cells.items()}


def widest_gaps(plate: Plate, rules: DisplayRules, progress: Progress = silent) -> dict[str, LargestGap]:
    """Widest gaps between colours, by die; dies without pixels are left out."""
    by_key: dict[object, LargestGap | None] = {}
    gaps: dict[str, LargestGap] = {}
    for done, die in enumerate(plate.dies):
        progress("colour gaps", done, len(plate.dies))
        key = _key(die.panel)
        if key not in by_key:
            by_key[key] = _widest_gap(die.panel, rules)
        answer = by_key[key]
        if answer is not None:
            gaps[die.name] = answer
    progress("colour gaps", len(plate.dies), len(plate.dies))
    return gaps


def _widest_gap(panel: Panel, rules: DisplayRules) -> LargestGap | None:
    """Widest gap between the colours of a panel, other rules unchanged; None for a sheet that has no pixels."""
    if panel.tiling is Tiling.HEXAGONAL:
        return None
    return largest_gap(panel.common, panel.dot_nm, panel.gutter_nm, _used(panel), rules.emitters)


def _arguments(panel: Panel, rules: DisplayRules) -> ArgumentsFactory:
    return lambda: (panel, rules)


def _drawn(die: Die, laid: PanelLines, line_nm: int) -> Mark:
    """Lines across a die, where they lie on the plate."""
    x0, y0 = die.origin_nm
    outlines = tuple(
        tuple((point.x + x0, point.y + y0) for point in outline.each_point_hull()) for outline in laid.polygons(line_nm)
    )
    return Mark(f"{die.name}_WIRES_{laid.axis.upper()}", "wires", WIRES[laid.axis == "y"], outlines)


def _key(panel: Panel) -> object:
    masks = tuple(opening.mask.tobytes() for opening in panel.openings)
    drawn = panel.opening.emitters
    given = None if drawn is None else drawn.tobytes()
    return masks, given, panel.dot_nm, panel.gutter_nm, meetings(panel.orientations)
