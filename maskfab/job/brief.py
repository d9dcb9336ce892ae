"""A display engineer's answers, moved to one grid, and the job that they ask for.

An answer that is left out has a default, which may follow the pitch. Lengths are then moved so that dots and emitter
rules are whole numbers of cells: the pitch to the nearest, least lengths upwards, so that what keeps the moved rules
keeps the maker's.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from maskfab.base import resources, units
from maskfab.base.errors import JobError
from maskfab.base.units import NM_PER_UM, UM_PER_MM, UM_PER_NM
from maskfab.job.camera import REFERENCE_TRANSMISSION, Camera, Stop, white_electrons
from maskfab.job.devices import of_device
from maskfab.job.die import check_lens
from maskfab.job.faults import parse_section
from maskfab.job.grid import Grid, finer_grid, nearest_grid, widest_dot_nm
from maskfab.job.sections import CircuitsSection, EmittersSection
from maskfab.job.toml import value_text
from maskfab.job.values import Area, FieldReach, Length, LengthOrZero, LookedFrom, Name, Pitch, Section, Time, parsed

LINES_NM = (610.0, 530.0, 470.0)
"""Wavelengths of red, green and blue of every job written from answers."""
RULES = ("gap_to_opening", "colour_gap", "min_width")
_USUAL = EmittersSection.model_validate({"colour_gap": "8 um", "min_width": "8 um"})
_MOST_OPEN = 0.65
"""Largest share of the pixel that may be chosen, for which an automatic exposure leaves room."""
_FINEST_BOX_NM = 1000
"""Sides of circuits' boxes are whole parts of a cell, of no less."""
_FILLED = 0.8
"""Share of a full well that an automatic exposure lets white fill."""
_MOST_PITCH_MOVE = 0.01
"""Share by which two answers that say the same may differ."""


class Module(Section):
    """A camera: its lens, its sensor, and where the numbers are from."""

    title: str = Field(default="your camera", max_length=80, pattern=r"^[^\x00-\x1f\x7f]*$")
    """In one line, for a comment of the job."""
    focal: Length
    f_number: float = Field(gt=0, allow_inf_nan=False)
    """Focal length over the diameter of the stop, which is in the plane of the openings."""
    pixel: Length
    full_well: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Electrons; 3400 for each square micrometre of a pixel if left out."""
    read_noise: float = Field(default=3.0, ge=0, allow_inf_nan=False)
    quantum_efficiency: float = Field(default=0.5, gt=0, le=1, allow_inf_nan=False)
    time: Time = 0.033
    """Longest exposure."""
    source: str = "answers"

    @property
    def stop_um(self) -> float:
        """Diameter of the stop, to the micrometre."""
        return max(1.0, round(self.focal / self.f_number))

    @property
    def well(self) -> float:
        """Electrons of the full well."""
        return round(3400 * self.pixel**2) if self.full_well is None else self.full_well

    def white(self, lux: float, time_s: float, transmission: float) -> float:
        """Electrons of white of reflectance 1 in so many lux, behind a panel that passes a share of the light."""
        ratio = self.focal / self.stop_um
        return white_electrons(lux / math.pi, time_s, self.quantum_efficiency, ratio, self.pixel, transmission)


@cache
def modules() -> Mapping[str, Module]:
    """Cameras of the bundled list, by the names that answers give."""
    text = resources.path("layouts/cameras/modules.toml").read_text(encoding="utf-8")
    return MappingProxyType({name: Module.model_validate(table) for name, table in tomllib.loads(text).items()})


_NUMBERS = re.compile(r"\s*(.+?)\s+f/\s*(\d+\.?\d*|\.\d+)\s+(.+?)\s*")


def _module(value: object) -> Module:
    """A camera by its name, by a table of its numbers, or by ``"4.38 mm f/1.73 1.4 um"``."""
    if isinstance(value, Module):
        return value
    if isinstance(value, str) and value in modules():
        return modules()[value]
    if match := _NUMBERS.fullmatch(str(value)):
        value = {"focal": match[1], "f_number": float(match[2]), "pixel": match[3]}
    if isinstance(value, Mapping):
        return parse_section(Module, dict(value), where="camera")
    asked = str(value).strip().lower()
    near = [name for name in modules() if asked in name] or get_close_matches(asked, modules(), n=1, cutoff=0.4)
    hint = f"Did you mean {near[0]!r}? The list" if near else "The list"
    cure = f'{hint}: {", ".join(modules())}; or numbers, such as "4.38 mm f/1.73 1.4 um"'
    raise JobError("MF105", f"there is no camera {value!r}", cure=cure)


_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*")


def _amount(value: object, units_of: Mapping[str, float], below: float, example: str) -> float:
    match = _NUMBER.fullmatch(str(value))
    if match is None or match[2] not in units_of:
        raise JobError("MF103", f"{value!r} is no number with its unit", cure=f"Write it as {example}")
    if not 0 < (amount := float(match[1]) * units_of[match[2]]) < below:
        raise JobError("MF104", f"{value!r} is not above 0 and below {below:g}", cure=f"Write it as {example}")
    return amount


def _typed(value: object) -> object:
    """Text of a terminal as a number where it is one; anything else is left to its own check."""
    match = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    return value if match is None or match[2] else int(match[1]) if match[1].isdigit() else float(match[1])


_SHARES, _EXAMPLE = MappingProxyType({"": 1.0, "%": 0.01}), '"28 %" or 0.28'
Share = Annotated[float, parsed(_amount, units_of=_SHARES, below=1.0, example=_EXAMPLE)]
Lux = Annotated[float, parsed(_amount, units_of={"lux": 1.0, "lx": 1.0}, below=1e7, example='"200 lux"')]
_Limit = Annotated[float | None, Field(default=None, gt=0, allow_inf_nan=False), parsed(_typed)]


class Brief(Section):
    """Answers about a display and its camera: lengths in micrometres, times in seconds, shares of 1.

    Make one by :meth:`of`, which fills in defaults and refuses answers that contradict each other.
    """

    pitch: Pitch
    camera: Annotated[Module, parsed(_module)]
    layout: Literal["stripe", "pentile", "delta"]
    open: Share | None = None
    """Of the pixel, to be clear; None where that is chosen."""
    emitters: Share
    """Least of the pixel that its emitters cover, all colours together."""
    gap_to_opening: LengthOrZero
    colour_gap: LengthOrZero
    min_width: Length
    line: Length
    space: Length
    clearance: LengthOrZero
    lines: Annotated[int, Field(ge=1, le=64), parsed(_typed)]
    circuit: Area | None = None
    """Area of one drive circuit with its lines; None for a third of the pixel, and at most that of a usual one."""
    sharing: Annotated[int | None, Field(ge=1, le=16), parsed(_typed)] = None
    """Pixels over the camera that share a circuit; None where that is chosen."""
    lux: Lux
    time: Time | None = None
    """Exposure time; None for one that fills the pixels, up to the camera's longest."""
    distance: LookedFrom
    """From the eye to the display."""
    delta_e: _Limit
    grain: _Limit
    life: Annotated[float | None, parsed(_amount, units_of=_SHARES, below=1000.0, example=_EXAMPLE)] = None
    """Least, over that of the maker's display."""
    gap: LengthOrZero
    """From the display to the lens; not modelled, as the field."""
    field: FieldReach | None = None
    """Largest angle off the axis, or image height; None for the axis alone."""
    name: Name
    house: str | None = None

    @classmethod
    def of(cls, answers: Mapping[str, object]) -> Brief:
        """The brief of answers by their keys, as text with units; defaults stand for the others.

        Raises:
            JobError: MF102 to MF105 for an answer; MF131, MF141 for a lens or a light that cannot be; MF151 for answers
                that contradict each other.
        """
        stated = merged(answers)
        if missing := [question.key for question in questions() if question.needed and question.key not in stated]:
            what = f"no answer says {' and '.join(missing)}"
            cure = f"Add {' and '.join(missing)}; the answers are {', '.join(question.key for question in questions())}"
            raise JobError("MF105", what, where="answers", cure=cure)
        defaults = {question.key: question.default_of(stated) for question in questions()}
        brief = parse_section(cls, {**{key: text for key, text in defaults.items() if text}, **stated}, where="answers")
        _refuse(brief)
        return brief

    @property
    def time_s(self) -> float:
        """Exposure time: as stated, or at most the camera's longest so that white does not fill the pixels."""
        if self.time is not None:
            return self.time
        per_s = self.camera.white(self.lux, 1.0, max(self.open or _MOST_OPEN, REFERENCE_TRANSMISSION))
        return float(f"{min(self.camera.time, _FILLED * self.camera.well / per_s):.3g}")

    @property
    def slit(self) -> float:
        """Clear share of the plain slits beside the design: as stated, or that of the published display, as far as
        lines and emitters leave room."""
        return self.open or min(REFERENCE_TRANSMISSION, self.room**2, 1 - self.emitters)

    @property
    def circuit_um2(self) -> float:
        """Area of one circuit: as stated, or so that the pixel around is as full as that of a panel on sale."""
        return self.circuit or min(_USUAL.circuit, self.pitch**2 / _USUAL.circuits)

    @property
    def room(self) -> float:
        """Share of the pixel's side that the lines leave."""
        return max(0.0, 1 - self.crossing_um / self.pitch)

    @property
    def crossing_um(self) -> float:
        """Width of all lines of one direction, with their spaces and the clearance to the opening on both sides."""
        return self.lines * self.line + (self.lines - 1) * self.space + 2 * self.clearance


@dataclass(frozen=True)
class Question:
    """One question of a display engineer's brief.

    Attributes:
        default: answer for none; empty for none that is stated.
        of_pitch: part, least, most and step of a default that follows the pitch; ``unit`` is its unit.
        needed: whether it must be answered where nobody sees the default.
    """

    key: str
    text: str
    why: str
    default: str = ""
    of_pitch: tuple[float, float, float, float] | None = None
    unit: str = ""
    needed: bool = False

    def default_of(self, stated: Mapping[str, object]) -> str:
        """The answer for none, where these are the answers so far."""
        if self.of_pitch is None:
            return self.default
        part, least, most, step = self.of_pitch
        pitch = units.parse_pitch_um(stated["pitch"], where="answers: pitch")
        return f"{min(max(math.floor(pitch * part / step + 1e-9) * step, least), most):g} {self.unit}".strip()


@cache
def questions() -> tuple[Question, ...]:
    """All questions, in the order in which they are asked."""
    tables = tomllib.loads(resources.template("questions.toml"))
    return tuple(Question(key, **table) for key, table in tables.items())


def merged(answers: Mapping[str, object]) -> dict[str, object]:
    """Answers without those that are blank, a device by its numbers, and a density as the pitch that it is.

    Raises:
        JobError: MF103 or MF104 for a density or a pitch; MF105 for a device, as :func:`of_device`; MF151 for two that
            differ by more than 1 %.
    """
    stated = {key: value for key, value in answers.items() if value is not None and value != ""}
    if "device" in stated:
        stated = of_device(stated)
    if "dpi" not in stated:
        return stated
    density = str(stated.pop("dpi")).strip()
    density = density if density.lower().endswith(("dpi", "ppi")) else f"{density} dpi"
    asked = units.parse_pitch_um(density, where="answers: dpi")
    pitch = units.parse_pitch_um(stated.setdefault("pitch", density), where="answers: pitch")
    if abs(pitch / asked - 1) > _MOST_PITCH_MOVE:
        what = f"dpi = {density} is a pitch of {asked:.4g} um, and pitch = {stated['pitch']}"
        raise JobError("MF151", what, where="answers: dpi", cure="Answer one of the two")
    return stated


def _refuse(brief: Brief) -> None:
    """Refuse a lens and a light that cannot be, and answers that contradict each other (MF131, MF141, MF151)."""
    module, pitch, stop = brief.camera, brief.pitch, brief.camera.stop_um
    check_lens(_lens(module), where="answers: camera")
    wide = f", and pitch = {pitch:g} um"
    crossing = f"lines = {brief.lines} take {brief.crossing_um:g} um with spaces and clearance"
    both = f"emitters = {brief.emitters:.1%} and open = {brief.slit:.1%} are all of the pixel or more"
    clear = brief.open or 0.0
    pairs = [
        ("pitch", pitch > stop, f"the camera's stop is {stop:g} um{wide}", "Give a finer display, or a wider stop"),
        ("emitters", brief.emitters + clear >= 1, both, "Give less of one"),
        ("lines", brief.room == 0, crossing + wide, "Give fewer or narrower lines, or a wider pitch"),
        ("open", clear > brief.room**2, f"open = {clear:.1%}, and {crossing}{wide}", "Open less, or give fewer lines"),
    ]
    for key in RULES:
        length = getattr(brief, key)
        pairs.append((key, length >= pitch / 2, f"{key} = {length:g} um{wide}", f"Give less than {pitch / 2:g} um"))
    for key, broken, what, cure in pairs:
        if broken:
            raise JobError("MF151", what, where=f"answers: {key}", cure=cure)
    electrons = module.white(brief.lux, brief.time_s, brief.slit)
    light = f"in {brief.lux:g} lux for {brief.time_s:g} s white is"
    if electrons < module.read_noise:
        what = f"{light} {electrons:.2g} electrons, below the read noise of {module.read_noise:g}: nothing is recorded"
        cure = f"Give {brief.lux * module.read_noise / electrons:.2g} lux or more, or a longer time"
        raise JobError("MF141", what, where="answers: lux", cure=cure)
    most = module.white(brief.lux, brief.time_s, max(brief.slit, REFERENCE_TRANSMISSION))
    if most > module.well:
        cure = f"Give a time of {brief.time_s * module.well / most * 1e3:.2g} ms or less, or leave it out"
        what = f"{light} {most:.3g} electrons, and a pixel holds {module.well:g}"
        raise JobError("MF141", what, where="answers: time", cure=cure)


def _lens(module: Module) -> Camera:
    return Camera(module.focal, Stop("circle", module.stop_um), LINES_NM, module.pixel)


@dataclass(frozen=True)
class Move:
    """A number that differs from what was answered, both in ``unit``."""

    name: str
    asked: float
    got: float
    unit: str
    why: str

    def __str__(self) -> str:
        by = self.got / self.asked - 1
        return f"{self.name} {self.asked:.5g} {self.unit} -> {self.got:.5g} {self.unit}, {by:+.1%}: {self.why}"


@dataclass(frozen=True)
class Snapped:
    """A brief whose lengths lie on one grid.

    Attributes:
        brief: with the lengths as moved, and the clear share of whole dots.
        slit: width and height of a plain slit in dots, which has as many clear dots as the design.
        finer: lengths as near as these that have a grid of finer dots, in words; empty where there are none.
    """

    brief: Brief
    dots: int
    cell_nm: int
    slit: tuple[int, int]
    moves: tuple[Move, ...]
    finer: str = ""

    @property
    def dot_um(self) -> float:
        return round(self.brief.pitch * NM_PER_UM) // self.dots / NM_PER_UM

    @property
    def clear_dots(self) -> int:
        return self.slit[0] * self.slit[1]


def snapped(brief: Brief) -> Snapped:
    """The brief on the grid of :func:`maskfab.job.grid.nearest_grid`; MF151 for a camera too coarse for any."""
    asked_nm = [round(getattr(brief, key) * NM_PER_UM) for key in RULES]
    widest_nm = widest_dot_nm(_lens(brief.camera), LINES_NM)
    found = nearest_grid(round(brief.pitch * NM_PER_UM), asked_nm, widest_nm=widest_nm)
    if found is None:
        what = f"camera pixels of {brief.camera.pixel:g} um need finer dots than pitch = {brief.pitch:g} um allows"
        raise JobError("MF151", what, where="answers: camera", cure="Give a camera of finer pixels, or a finer display")
    dots, cell_nm, lengths = found.dots, found.cell_nm, _lengths(found)
    whole = {key: round(getattr(brief, key) * NM_PER_UM) / NM_PER_UM for key in ("line", "space", "clearance")}
    moves = _moves(brief, lengths, f"whole cells of {cell_nm / NM_PER_UM:g} um")
    moves += _moves(brief, whole, "whole nanometres")
    room = max(1, dots - math.ceil(brief.crossing_um * NM_PER_UM * dots / found.pitch_nm - 1e-9))
    slits = [
        (max(1, min(room, round(brief.slit * dots**2 / h))), h) for h in range(room, math.ceil(0.8 * room) - 1, -1)
    ]
    width, height = min(slits, key=lambda slit: abs(slit[0] * slit[1] - brief.slit * dots**2))
    share = width * height / dots**2
    if brief.open is not None and abs(share - brief.open) > 1e-9:
        moves.append(Move("open", 100 * brief.open, 100 * share, "%", f"a slit of {width} x {height} whole dots"))
    moved = brief.model_copy(update={**lengths, **whole, **({} if brief.open is None else {"open": share})})
    finer = finer_grid(round(brief.pitch * NM_PER_UM), asked_nm, found, widest_nm=widest_nm)
    return Snapped(moved, dots, cell_nm, (width, height), tuple(moves), (finer and _finer(brief, found, finer)) or "")


def _lengths(grid: Grid) -> dict[str, float]:
    return {key: nm / NM_PER_UM for key, nm in zip(("pitch", *RULES), (grid.pitch_nm, *grid.rules_nm), strict=True)}


def _moves(brief: Brief, lengths: Mapping[str, float], why: str) -> list[Move]:
    asked = {key: (getattr(brief, key), got) for key, got in lengths.items()}
    return [Move(key, was, got, "um", why) for key, (was, got) in asked.items() if abs(got - was) > UM_PER_NM / 2]


def _finer(brief: Brief, found: Grid, finer: Grid) -> str:
    moves = _moves(brief, _lengths(finer), "")
    answers = ", ".join(f'{one.name} = "{one.got:.10g} um" ({one.got / one.asked - 1:+.1%})' for one in moves)
    near, own = (f"{grid.dots} dots of {grid.dot_nm / NM_PER_UM:g} um" for grid in (finer, found))
    return f"A finer grid is near, {near} beside {own}: answer {answers}. What finer dots gain is not estimated here."


def job_text(made: Snapped) -> str:
    """A commented job, as ``check``, ``design`` and ``run`` take it; equal answers give equal text.

    The plate has two dies for one camera: a plain slit in every pixel, and the design, with as many clear dots.
    """
    brief, camera = made.brief, made.brief.camera
    # As a usual panel, 2.1 stops wide and at most 100 pixels, for larger ones take time; but it must hold the stop.
    die_um = max(1.25 * camera.stop_um, min(2.1 * camera.stop_um, 100 * brief.pitch))
    die_mm = math.ceil(die_um / 100) / 10
    (width, height), dots = made.slit, made.dots
    clear = range((dots - height) // 2, (dots + height) // 2)
    limits = [(key, getattr(brief, key)) for key in ("delta_e", "grain", "life")]
    row = f"{'#' * width:.^{dots}}"
    return resources.template("advised.toml").format(
        made=made,
        brief=brief,
        camera=camera,
        plate=brief.name.upper(),
        dpi=units.dpi(brief.pitch),
        cell_um=made.cell_nm / NM_PER_UM,
        moved="".join([*(f"# moved: {move}\n" for move in made.moves), *(f"# {made.finer}\n" for _ in made.finer[:1])]),
        window=min(256, math.floor(min(LINES_NM) * UM_PER_NM * camera.focal / made.dot_um)),
        luminance=brief.lux / math.pi,
        exposed="as answered" if brief.time is not None else "up to the camera's longest, white within the full well",
        die_mm=die_mm,
        gap_mm=brief.gap / UM_PER_MM,
        field=0
        if brief.field is None
        else value_text(brief.field if isinstance(brief.field, str) else f"{brief.field:g} um"),
        apart=math.ceil(die_mm + 12),
        required=brief.emitters / 3,
        share=_share_line(made),
        slit_dots=made.clear_dots,
        circuits=_circuits(made),
        sharing="" if brief.sharing is None else f"sharing = {brief.sharing}\n",
        distance_mm=brief.distance / UM_PER_MM,
        seen="".join(f"{key} = {value:g}\n" for key, value in limits[:2] if value is not None),
        lives="".join(f"{key} = {value:g}\n" for key, value in limits[2:] if value is not None),
        export="" if brief.house is None else f"\n[export]\nshop = {value_text(brief.house)}\n",
        slit="\n".join(row if line in clear else "." * dots for line in range(dots)),
    )


def _share_line(made: Snapped) -> str:
    """The key of clear dots where the share is stated; a comment where it is chosen."""
    if made.brief.open is None:
        return "# clear_dots is left out: chosen by what photographs gain"
    return f"clear_dots = {made.clear_dots}              # {made.brief.open:.1%} of the pixel; fewer where no more fit"


def _circuits(made: Snapped) -> str:
    """Lines of [circuits]: the usual boxes, smaller where circuits are, in whole parts of a cell."""
    usual, scale = CircuitsSection(), math.sqrt(made.brief.circuit_um2 / _USUAL.circuit)
    whole = [parts for parts in range(1, made.cell_nm // _FINEST_BOX_NM + 1) if made.cell_nm % parts == 0]
    part_um = made.cell_nm / max(whole, default=1) / NM_PER_UM

    def drawn(length_um: float) -> str:
        return f'"{max(1, round(length_um * scale / part_um)) * part_um:.10g} um"'

    boxes = ",\n".join(
        f'  {{ name = "{box.name}", width = {drawn(box.width)}, height = {drawn(box.height)}, count = {box.count} }}'
        for box in usual.boxes
    )
    gaps = f"gap = {drawn(usual.gap)}\ngap_to_opening = {drawn(usual.gap_to_opening)}"
    return f"boxes = [\n{boxes},\n]\n{gaps}"
