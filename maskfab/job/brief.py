"""A display engineer's answers, moved to one grid, and the job that they ask for.

An answer that is left out has a default by the pitch, the camera and the answers before it. Lengths are then moved so
that dots and emitter rules are whole numbers of cells, of which a pixel has at most 128 along its side: the pitch to
the nearest, least lengths upwards, so that what keeps the moved rules keeps the maker's.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from string import Template
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from maskfab.base import resources, units
from maskfab.base.cell_size import MOST_CELLS
from maskfab.base.errors import JobError
from maskfab.base.units import NM_PER_UM, UM_PER_MM
from maskfab.job.camera import REFERENCE_TRANSMISSION, Camera, Stop, white_electrons
from maskfab.job.read import check_lens, parse_section
from maskfab.job.sections import EmittersSection, JobSpec
from maskfab.job.values import Length, LengthOrZero, LookedFrom, Name, Pitch, Section, Time, parsed, um_text

LINES_NM = (610.0, 530.0, 470.0)
"""Wavelengths of red, green and blue of every job written from answers."""
_FILLED = 0.8
"""Share of a full well that an automatic exposure lets white fill."""
_FEWEST_DOTS, _USUAL_DOTS, _MOST_DOTS = 16, 22, 64
"""Along a pixel: fewer draw no shape that restores well, more cost time; shipped displays have 21."""
_FEWEST_ACROSS, _FEWEST_LAGS = 64, 32
"""Dots across the stop, and dots of lag to one cycle per pixel, that photographs are judged through."""
_STEP_NM = 50
"""Cells are whole steps, unless the answers share another grid: what a plotter's address grid divides."""
_MOST_PITCH_MOVE, _MOST_RAISE = 0.01, 0.1


class Module(Section):
    """A camera: its lens, its sensor, and where the numbers are from."""

    title: str = "your camera"
    focal: Length
    f_number: float = Field(gt=0, allow_inf_nan=False)
    """Focal length over the diameter of the stop, which is in the plane of the openings."""
    pixel: Length
    full_well: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Electrons; 3400 for each square micrometre of a pixel if left out."""
    read_noise: float = Field(default=3.0, ge=0, allow_inf_nan=False)
    quantum_efficiency: float = Field(default=0.5, gt=0, le=1, allow_inf_nan=False)
    time: Time = 1 / 30
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
        return white_electrons(
            lux / math.pi, time_s, self.quantum_efficiency, self.focal / self.stop_um, self.pixel, transmission
        )


@cache
def modules() -> Mapping[str, Module]:
    """Cameras of the bundled list, by the names that answers give."""
    text = resources.path("layouts/cameras/modules.toml").read_text(encoding="utf-8")
    return MappingProxyType({name: Module.model_validate(table) for name, table in tomllib.loads(text).items()})


_NUMBERS = re.compile(r"(.+?)\s+f/\s*([\d.]+)\s+(.+)")


def _module(value: object) -> Module:
    """A camera by its name, by a table of its numbers, or by ``"4.38 mm f/1.73 1.4 um"``."""
    if isinstance(value, Module):
        return value
    if isinstance(value, str) and value in modules():
        return modules()[value]
    if isinstance(value, str) and (match := _NUMBERS.fullmatch(value.strip())):
        try:
            value = {"focal": match[1], "f_number": float(match[2]), "pixel": match[3]}
        except ValueError:
            value = str(value)
    if not isinstance(value, Mapping):
        near = get_close_matches(str(value).lower(), modules(), n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}? The list: " if near else "the list: "
        cure = f'{hint}{", ".join(modules())}; or numbers, such as "4.38 mm f/1.73 1.4 um"'
        raise JobError("MF105", f"there is no camera {value!r}", cure=cure[0].upper() + cure[1:])
    return parse_section(Module, dict(value), where="camera")


_SHARE = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+))\s*(%?)\s*")
_LUX = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*")


def _share(value: object, *, where: str = "") -> float:
    match = _SHARE.fullmatch(str(value))
    if match is None:
        raise JobError("MF103", f"{value!r} is no share", where=where, cure='Write it as "28 %" or 0.28')
    share = float(match[1]) / (100 if match[2] else 1)
    if not 0 < share < 1:
        raise JobError("MF104", f"{value!r} is not between 0 and 100 %", where=where, cure='Write it as "28 %" or 0.28')
    return share


def _lux(value: object) -> float:
    match = _LUX.fullmatch(str(value))
    if match is None or match[2] not in ("lux", "lx"):
        raise JobError("MF103", f"{value!r} is no illuminance with its unit", cure='Write it as "200 lux"')
    if not 0 < float(match[1]) < math.inf:
        raise JobError("MF104", f"{value!r} is no light", cure='Write what falls on the scene, such as "200 lux"')
    return float(match[1])


def _number(value: object) -> object:
    """Text of a terminal as a number; anything else is left to its own check."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _count(value: object) -> object:
    return int(value) if isinstance(value, str) and value.strip().isdigit() else value


Share = Annotated[float, parsed(_share)]
_Limit = Annotated[float | None, Field(default=None, gt=0, allow_inf_nan=False), parsed(_number)]


class Brief(Section):
    """Answers about a display and its camera, lengths in micrometres, shares of 1.

    Make one by :meth:`of`, which fills in defaults and refuses answers that contradict each other.
    """

    pitch: Pitch
    layout: Literal["stripe", "pentile", "delta"]
    emitters: Share
    """Least share of the pixel that its emitters cover, all colours together."""
    open: Share
    """Share of the pixel that is to be clear."""
    gap_to_opening: LengthOrZero
    colour_gap: LengthOrZero
    min_width: Length
    line: Length
    space: Length
    clearance: LengthOrZero
    lines: Annotated[int, Field(ge=1, le=64), parsed(_count)]
    camera: Annotated[Module, parsed(_module)]
    lux: Annotated[float, parsed(_lux)]
    time: Time | None = None
    """Exposure time; None for one that fills the pixels, up to the camera's longest."""
    distance: LookedFrom
    """From the eye to the display."""
    delta_e: _Limit
    grain: _Limit
    life: Annotated[float | None, parsed(_share)] = None
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
        if missing := [question.key for question in QUESTIONS if question.needed and question.key not in stated]:
            what = f"no answer says {' and '.join(missing)}"
            cure = f"Add {' and '.join(missing)}; the answers are {', '.join(question.key for question in QUESTIONS)}"
            raise JobError("MF105", what, where="answers", cure=cure)
        for question in QUESTIONS:
            default = question.default(stated)
            if question.key not in stated and default:
                stated[question.key] = default
        brief = parse_section(cls, stated, where="answers")
        _refuse(brief)
        return brief

    @property
    def time_s(self) -> float:
        """Exposure time: as stated, or at most the camera's longest so that white does not fill the pixels."""
        if self.time is not None:
            return self.time
        per_s = self.camera.white(self.lux, 1.0, max(self.open, REFERENCE_TRANSMISSION))
        return float(f"{min(self.camera.time, _FILLED * self.camera.well / per_s):.3g}")

    @property
    def crossing_um(self) -> float:
        """Width of all lines of one direction, with their spaces and the clearance to the opening on both sides."""
        return self.lines * self.line + (self.lines - 1) * self.space + 2 * self.clearance


def merged(answers: Mapping[str, object]) -> dict[str, object]:
    """Answers without those that are blank, a density in dots per inch as the pitch that it is.

    Raises:
        JobError: MF103 or MF104 for a density or a pitch; MF151 for two that differ by more than 1 %.
    """
    stated = {key: value for key, value in answers.items() if value is not None and value != ""}
    if "dpi" in stated:
        stated["pitch"] = _of_both(str(stated.pop("dpi")), stated.get("pitch"))
    return stated


def _of_both(density: str, pitch: object) -> str:
    """The pitch of a density in dots per inch, which must agree with a pitch that is stated too."""
    density = density if density.strip().lower().endswith(("dpi", "ppi")) else f"{density} dpi"
    asked = units.parse_pitch_um(density, where="answers: dpi")
    if pitch is None:
        return density
    stated = units.parse_pitch_um(pitch, where="answers: pitch")
    if abs(stated / asked - 1) > _MOST_PITCH_MOVE:
        what = f"dpi = {density} is a pitch of {asked:.4g} um, and pitch = {pitch}"
        raise JobError("MF151", what, where="answers: dpi", cure="Answer one of the two")
    return str(pitch)


@dataclass(frozen=True)
class Question:
    """One question of a display engineer's brief.

    Attributes:
        key: of the answer.
        text: the question, with its unit.
        default: answer for none, from the answers so far; empty for none that is stated.
        why: reason of the default.
    """

    key: str
    text: str
    default: Callable[[Mapping[str, object]], str]
    why: str
    needed: bool = False
    """Whether an answer must be given where nobody sees the default."""


def _by_pitch(part: float, least: float, most: float) -> Callable[[Mapping[str, object]], str]:
    """A part of the pitch in half micrometres, within limits."""

    def length(stated: Mapping[str, object]) -> str:
        pitch = units.parse_pitch_um(stated["pitch"], where="answers: pitch")
        return f"{min(max(math.floor(2 * pitch * part) / 2, least), most):g} um"

    return length


def _shared(pitch_um: float) -> int:
    """Pixels that must take turns at circuits of the usual area, so that these take at most half of a pixel."""
    usual = EmittersSection.model_validate({"colour_gap": "8 um", "min_width": "8 um"})
    return max(1, min(16, math.ceil(2 * usual.circuit * usual.circuits / pitch_um**2 - 0.05)))


def _lines(stated: Mapping[str, object]) -> str:
    return str(max(2, math.ceil(4 / _shared(units.parse_pitch_um(stated["pitch"], where="answers: pitch")))))


def _open(stated: Mapping[str, object]) -> str:
    share = _share(stated["emitters"], where="answers: emitters")
    return f"{min(0.2, (1 - share) / 2):.3g}"


def _distance(stated: Mapping[str, object]) -> str:
    density = units.dpi(units.parse_pitch_um(stated["pitch"], where="answers: pitch"))
    return "300 mm" if density > 300 else "500 mm" if density > 200 else "700 mm"


def _fixed(answer: str) -> Callable[[Mapping[str, object]], str]:
    return lambda stated: answer


QUESTIONS: tuple[Question, ...] = (
    Question("pitch", "pitch of the pixels, as a length or in dpi", _fixed("400 dpi"), "a phone", True),
    Question("layout", "the maker's layout: stripe, pentile or delta", _fixed("stripe"), "of most laptops and cars"),
    Question("emitters", "least share of the pixel that emits, all colours", _fixed("28 %"), "displays sold today"),
    Question("open", "clear share of the pixel that is wanted", _open, "that of the published display"),
    Question("gap_to_opening", "least gap from emitter to opening", _by_pitch(1 / 20, 1.5, 4), "half the colour gap"),
    Question(
        "colour_gap", "least gap between colours", _by_pitch(1 / 10, 3, 8), "a judgement: up to 8 um, by the pitch"
    ),
    Question("min_width", "least width of an emitter", _by_pitch(1 / 10, 3, 8), "as the colour gap"),
    Question("line", "width of a line", _by_pitch(1 / 28, 1.5, 3), "a judgement: up to 3 um, by the pitch"),
    Question("space", "least space between lines", _by_pitch(1 / 28, 1.5, 3), "as the line"),
    Question("clearance", "least distance from line to opening", _by_pitch(1 / 32, 1, 2.5), "less than the space"),
    Question("lines", "lines that cross a pixel, each way", _lines, "four, over the pixels that share a circuit"),
    Question(
        "camera", "camera: a name of the list, or focal length f/number pixel", _fixed("phone_main"), "a phone", True
    ),
    Question("lux", "light on the scene in lux", _fixed("200 lux"), "a living room"),
    Question("time", "exposure time", _fixed(""), "white fills 80 % of the pixels, up to the camera's longest"),
    Question(
        "distance", "distance from the eye to the display", _distance, "a phone, laptop or dashboard, by the pitch"
    ),
    Question("delta_e", "largest mean colour difference of even white, delta E", _fixed(""), "a default, not stated"),
    Question("grain", "largest grain of even white, rms contrast", _fixed(""), "a default, not stated"),
    Question("life", "least life over that of the maker's display, as a share", _fixed(""), "a default, not stated"),
    Question("name", "name of the design", _fixed("advised"), "of the files"),
    Question("house", "mask shop whose rules are asked, or none", _fixed(""), "none"),
)


def _refuse(brief: Brief) -> None:
    """Refuse a lens, a light and answers that contradict each other.

    Raises:
        JobError: MF131, MF141 or MF151.
    """
    module, pitch = brief.camera, brief.pitch
    check_lens(Camera(module.focal, Stop("circle", module.stop_um), LINES_NM, module.pixel), where="answers: camera")
    if not 64 * pitch / _MOST_DOTS <= module.stop_um:
        what = f"pitch = {pitch:g} um is wider than the stop of {module.stop_um:g} um of the camera"
        raise JobError("MF151", what, where="answers: pitch", cure="Give a finer display, or a camera of a wider stop")
    if brief.emitters + brief.open >= 1:
        what = f"emitters = {brief.emitters:.1%} and open = {brief.open:.1%} are the whole pixel or more"
        raise JobError("MF151", what, where="answers: emitters", cure="Give fewer emitters, or open less")
    if brief.crossing_um >= pitch:
        what = (
            f"lines = {brief.lines} take {brief.crossing_um:g} um with spaces and clearance, and pitch = {pitch:g} um"
        )
        raise JobError("MF151", what, where="answers: lines", cure="Give fewer or narrower lines, or a wider pitch")
    if brief.open > (1 - brief.crossing_um / pitch) ** 2:
        what = (
            f"open = {brief.open:.1%}, and lines = {brief.lines} take {brief.crossing_um:g} um of {pitch:g} um each way"
        )
        raise JobError("MF151", what, where="answers: open", cure="Open less, or give fewer or narrower lines")
    for key in ("min_width", "colour_gap", "gap_to_opening"):
        if not getattr(brief, key) < pitch / 2:
            what = (
                f"{key} = {getattr(brief, key):g} um, and pitch = {pitch:g} um: two colours would not fit side by side"
            )
            raise JobError("MF151", what, where=f"answers: {key}", cure=f"Give less than {pitch / 2:g} um")
    electrons = module.white(brief.lux, brief.time_s, brief.open)
    if electrons < module.read_noise:
        enough = brief.lux * module.read_noise / electrons
        what = (
            f"in {brief.lux:g} lux for {brief.time_s:g} s white is {electrons:.2g} electrons behind the display, below "
            f"the read noise of {module.read_noise:g}: nothing can be recorded"
        )
        raise JobError("MF141", what, where="answers: lux", cure=f"Give {enough:.2g} lux or more, or a longer time")
    most = module.white(brief.lux, brief.time_s, max(brief.open, REFERENCE_TRANSMISSION))
    if most > module.well:
        what = (
            f"in {brief.lux:g} lux for {brief.time_s:g} s white is {most:.3g} electrons; a pixel holds {module.well:g}"
        )
        cure = f"Give a time of {brief.time_s * module.well / most * 1e3:.2g} ms or less, or leave it out"
        raise JobError("MF141", what, where="answers: time", cure=cure)


@dataclass(frozen=True)
class Move:
    """One number that differs from what was answered.

    Attributes:
        name: key of the answer.
        asked, got: in ``unit``.
        why: it had to move.
    """

    name: str
    asked: float
    got: float
    unit: str
    why: str

    def __str__(self) -> str:
        by = f", {self.got / self.asked - 1:+.1%}" if self.asked else ""
        return f"{self.name} {self.asked:.5g} {self.unit} -> {self.got:.5g} {self.unit}{by}: {self.why}"


RULES = ("gap_to_opening", "colour_gap", "min_width")


@dataclass(frozen=True)
class Snapped:
    """A brief whose lengths lie on one grid.

    Attributes:
        brief: with the lengths as moved.
        dots: along the pixel.
        cell_nm: side of the cells on which dots and rules are whole numbers.
        slit: width and height of a plain slit in dots, which has as many clear dots as the design.
        moves: what was moved, and by how much.
    """

    brief: Brief
    dots: int
    cell_nm: int
    slit: tuple[int, int]
    moves: tuple[Move, ...]

    @property
    def pitch_nm(self) -> int:
        return round(self.brief.pitch * NM_PER_UM)

    @property
    def dot_nm(self) -> int:
        return self.pitch_nm // self.dots

    @property
    def clear_dots(self) -> int:
        return self.slit[0] * self.slit[1]


@dataclass(frozen=True)
class _Grid:
    dots: int
    cell_nm: int
    pitch_nm: int
    rules_nm: tuple[int, ...]


def snapped(brief: Brief) -> Snapped:
    """The brief with its lengths on the best grid of at most 128 cells along a pixel.

    Answers that share a grid stay as they are. Otherwise the pitch moves by at most 1 %, and a rule grows by at most a
    tenth or a hundredth of the pitch. Of the grids that do so the best has the least sum of: cells over 128, for time;
    |ln(dots / 22)|, for finer dots help a display to fit and coarser ones are fast; and fifty times the share of the
    pitch by which all lengths move together, so that 1 % weighs half as much as the coarsest grid against the finest.

    Raises:
        JobError: MF151 for a camera so coarse that no dots of such a pixel are fine enough for it.
    """
    asked_nm = [round(getattr(brief, key) * NM_PER_UM) for key in ("pitch", *RULES)]
    grids = list(_grids(brief, asked_nm[0], asked_nm[1:]))
    if not grids:
        what = f"pitch = {brief.pitch:g} um takes dots too coarse for camera pixels of {brief.camera.pixel:g} um"
        raise JobError("MF151", what, where="answers: camera", cure="Give a camera of finer pixels, or a finer display")
    best = min(grids, key=lambda grid: _cost(grid, asked_nm))
    got_um = [length / NM_PER_UM for length in (best.pitch_nm, *best.rules_nm)]
    rounded = {key: round(getattr(brief, key) * NM_PER_UM) / NM_PER_UM for key in ("line", "space", "clearance")}
    lengths = {**dict(zip(("pitch", *RULES), got_um, strict=True)), **rounded}
    cells = f"whole cells of {best.cell_nm / NM_PER_UM:g} um"
    moves = [
        Move(key, getattr(brief, key), got, "um", cells if key not in rounded else "whole nanometres")
        for key, got in lengths.items()
        if abs(got - getattr(brief, key)) > 1e-9
    ]
    room = best.dots - math.ceil(brief.crossing_um * NM_PER_UM / (best.pitch_nm // best.dots) - 1e-9)
    slit = _slit(brief.open * best.dots**2, max(1, room))
    share = slit[0] * slit[1] / best.dots**2
    if abs(share - brief.open) > 1e-9:
        moves.append(Move("open", 100 * brief.open, 100 * share, "%", f"a slit of {slit[0]} x {slit[1]} whole dots"))
    return Snapped(brief.model_copy(update={**lengths, "open": share}), best.dots, best.cell_nm, slit, tuple(moves))


def _slit(clear_dots: float, room: int) -> tuple[int, int]:
    """Width and height of the slit nearest to a number of clear dots, at least four fifths as tall as there is room."""
    heights = range(room, math.ceil(0.8 * room) - 1, -1)
    slits = [(max(1, min(room, round(clear_dots / height))), height) for height in heights]
    return min(slits, key=lambda slit: abs(slit[0] * slit[1] - clear_dots))


def _grids(brief: Brief, pitch_nm: int, rules_nm: list[int]) -> Iterator[_Grid]:
    """Grids of at most 128 cells a pixel, whose dots the camera can be judged through."""
    camera = brief.camera
    dot_um = min(camera.stop_um / _FEWEST_ACROSS, min(LINES_NM) * 1e-3 * camera.focal / camera.pixel / _FEWEST_LAGS)
    finest = math.ceil(pitch_nm / (MOST_CELLS + 0.5))
    shared = math.gcd(pitch_nm, *rules_nm)
    steps = range(-(-finest // _STEP_NM) * _STEP_NM, pitch_nm // _FEWEST_DOTS + _STEP_NM, _STEP_NM)
    for cell in sorted({*steps, *(shared // n for n in range(1, shared // finest + 1) if shared % n == 0)}):
        cells = round(pitch_nm / cell)
        if cells > MOST_CELLS:
            continue
        for dots in range(_FEWEST_DOTS, min(_MOST_DOTS, cells) + 1):
            if cells % dots == 0 and cells * cell <= dots * dot_um * NM_PER_UM:
                yield _Grid(dots, cell, cells * cell, tuple(-(-rule // cell) * cell for rule in rules_nm))


def _cost(grid: _Grid, asked_nm: list[int]) -> tuple[bool, bool, float]:
    pitch_nm, *rules_nm = asked_nm
    by = [got - rule for got, rule in zip(grid.rules_nm, rules_nm, strict=True)]
    moved = abs(grid.pitch_nm - pitch_nm) + sum(by)
    far = abs(grid.pitch_nm / pitch_nm - 1) > _MOST_PITCH_MOVE or any(
        more > max(_MOST_RAISE * rule, pitch_nm / 100) for more, rule in zip(by, rules_nm, strict=True)
    )
    cells = grid.pitch_nm // grid.cell_nm
    cost = cells / MOST_CELLS + abs(math.log(grid.dots / _USUAL_DOTS)) + 50 * moved / pitch_nm
    return moved > 0, far, cost


def job_text(made: Snapped) -> str:
    """A commented job, as ``check``, ``design`` and ``run`` take it; equal answers give equal text.

    The plate has two dies for one camera: a plain slit in every pixel, and the design, with as many clear dots.
    """
    brief, module = made.brief, made.brief.camera
    stop, dot = module.stop_um, made.dot_nm / NM_PER_UM
    # As a usual panel, 2.1 stops wide and at most 100 pixels, for larger ones take time; but it must hold the stop.
    die = math.ceil(max(1.25 * stop, min(2.1 * stop, 100 * brief.pitch)) / 100) * 100
    window = min(256.0, math.floor(min(LINES_NM) * 1e-3 * module.focal / dot))
    slit = [[False] * made.dots for _ in range(made.dots)]
    left, top = (made.dots - made.slit[0]) // 2, (made.dots - made.slit[1]) // 2
    for row in slit[top : top + made.slit[1]]:
        row[left : left + made.slit[0]] = [True] * made.slit[0]
    own = "as answered" if brief.time is not None else "as the camera exposes, white within the full well"
    text = Template(resources.template("advised.toml")).substitute(
        {key: um_text(getattr(brief, key)) for key in ("pitch", *RULES, "line", "space", "clearance")},
        title=f"{brief.name}: {units.dpi(brief.pitch):.0f} DPI".upper(),
        name=brief.name.lower(),
        plate=brief.name.upper(),
        file="job.toml",
        moved="".join(f"# moved: {move}\n" for move in made.moves),
        dots=made.dots,
        dot=um_text(dot),
        dpi=f"{units.dpi(brief.pitch):.0f}",
        clear=made.clear_dots,
        open=f"{brief.open:.1%}",
        camera=module.title,
        focal=um_text(module.focal),
        stop=um_text(stop),
        f_number=f"{module.f_number:g}",
        pixel=um_text(module.pixel),
        window=um_text(window),
        full_well=f"{module.well:g}",
        read_noise=f"{module.read_noise:g}",
        lux=f"{brief.lux:g}",
        luminance=f"{brief.lux / math.pi:.6g}",
        time=f"{brief.time_s:.6g} s",
        time_why=own,
        efficiency=f"{module.quantum_efficiency:g}",
        die=f"{die / UM_PER_MM:g} mm",
        across=f"{die / stop:.2g}",
        apart=f"{math.ceil(die / UM_PER_MM + 12):g} mm",
        required=f"{brief.emitters / 3:.4g}",
        emitters=f"{brief.emitters:.1%}",
        shared=_shared(brief.pitch),
        lines=brief.lines,
        limits=_limits(brief),
        export="" if brief.house is None else f'\n[export]\nshop = "{brief.house}"\n',
        slit="\n".join("".join("#" if clear else "." for clear in row) for row in slit),
    )
    return text


def _limits(brief: Brief) -> str:
    """Limits of the eye and of life; those that are not answered are left to their defaults."""
    seen = "looks" if "looks" in JobSpec.model_fields else "eye"
    lines = [f"[{seen}]", f'distance = "{brief.distance / UM_PER_MM:g} mm"']
    lines += [f"{key} = {value:g}" for key in ("delta_e", "grain") if (value := getattr(brief, key)) is not None]
    if "lives" in JobSpec.model_fields:
        lines.append(f'reference = "{brief.layout}"')
        lines += ["", "[lives]"] + ([] if brief.life is None else [f"life = {brief.life:g}"])
    return "\n".join([*lines, "", ""])
