"""The answer to what should be built for a display and its camera: its document, which ``--json`` prints, and one page.

Six questions are answered, each by a sentence and by rows of numbers with their units, errors and methods. Whether
anything should be built is decided here: photographs must gain what they would by a third of a stop more light, and
the display must fit and keep its limits.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from pydantic import Field

from maskfab.base import __version__
from maskfab.base.errors import JobError
from maskfab.base.folders import Place
from maskfab.base.model import Tiling
from maskfab.base.units import NM_PER_UM, decimals_of
from maskfab.camera.protocol import evaluate
from maskfab.camera.scenes import PORTRAIT, portrait
from maskfab.camera.scores import CONFIDENCE, Crop, MeanDifference, Shot, truth_of
from maskfab.designs.rules.display_fit import misfit
from maskfab.designs.rules.families import explained
from maskfab.designs.search.result import Designed
from maskfab.designs.search.share import ShareCurve, SharePoint
from maskfab.display.emitter_rules import Verdict
from maskfab.display.feasibility import Feasibility, PlateWithDisplays, display_rules, feasibility
from maskfab.findings.optics import plate_as_seen
from maskfab.findings.photographs import NOISE_DB, Photographs, Restored, Surroundings
from maskfab.mask.job import Job
from maskfab.mask.package.pack import Bid
from maskfab.report.documents.display import display_document
from maskfab.report.documents.shape import Document, Part, Record, document_text, titled_schema, written
from maskfab.report.figures import display as display_figures
from maskfab.report.figures import scene as scene_figures
from maskfab.report.pages.breaches import NOTHING
from maskfab.report.pages.template import page_template, style, write_folder
from maskfab.report.text import USEFUL_DB, short

SCHEMA_VERSION = 1
DOCUMENT, PAGE = "advice.json", "advice.html"
WORTH_DB = 10 * math.log10(2 ** (1 / 3))
"""Least gain that is worth a mask: photon noise falls as much by a third of a stop more light, the smallest step by
which cameras set their exposure."""
_FEW = 8
"""Pixels along a side in which the display of a reference is looked at, which takes less than a second."""
_MODEL = "estimate by the expected PSNR of restored photographs"


def laid_db(designed: Designed) -> float:
    """Expected restored PSNR of what is laid, with its map if it has one, dB, mean over the levels."""
    return float(np.mean(designed.psnr if designed.designed is None else designed.designed.psnr))


class Caveat(str):
    """A note that stands beside the verdict: what it is no verdict on."""

    __slots__ = ()


@dataclass(frozen=True)
class Reach:
    """The largest opening that was found to fit a display, its rules as they stand or with one of them eased.

    Attributes:
        clear_dots: in a pixel; None where none was found.
        shape: of the opening; empty where the display holds no more than without easing.
        psnr: expected restored PSNR by level, dB, before a map; none likewise.
        alike: whether lines were found only where all cells lie alike.
        mapped: whether ``psnr`` is with a map.
        complete: whether every number of dots was tried that the clock allowed to.
        why: there is none; None where it was looked for.
    """

    name: str
    clear_dots: int | None = None
    dots: int = 0
    shape: str = ""
    psnr: tuple[float, ...] = ()
    alike: bool = False
    mapped: bool = False
    complete: bool = True
    why: str | None = None


@dataclass(frozen=True, eq=False)
class Advised:
    """Everything that an answer is made of.

    Attributes:
        job: of two dies, the reference and the design, which ``run`` takes.
        designed: the design; without a display's rules where no display fits.
        alike_psnr: expected restored PSNR of its opening with all cells laid alike, dB, by level.
        misfit: why no display fits; None where one does.
        level_db: the job's light, or the middle one of several.
        unobstructed: gain over the reference of a clear stop of the design's light.
        reaches: larger openings; none where time was over.
        curve: shares of the pixel and levels of sharing, of which the design's was chosen, unless the job states it.
        stated: whether the design has the share that the job states.
        unkept: limits of the eye that an earlier, freer design breaks, and what became of one that keeps them; None
            where the first design keeps all.
        limit_cost_db: expected restored PSNR that keeping them costs; None where no design was found that does.
        budget_s: seconds that were asked for; None for no end.
    """

    job: Job
    designed: Designed
    alike_psnr: tuple[float, ...]
    misfit: str | None
    displays: PlateWithDisplays
    photographs: Photographs
    level_db: float
    unobstructed: MeanDifference
    bids: tuple[Bid, ...]
    reaches: tuple[Reach, ...]
    curve: ShareCurve
    stated: bool = False
    unkept: str | None = None
    limit_cost_db: float | None = None
    notes: tuple[str, ...] = ()
    budget_s: float | None = None

    @property
    def name(self) -> str:
        """Die of the design."""
        return self.job.spec.die[-1].name

    @property
    def reference(self) -> str:
        """Label of the die that gains are over."""
        return self.job.spec.die[0].label

    @property
    def display(self) -> Feasibility | None:
        """The display of the design; None for a sheet without pixels."""
        return self.displays.displays.get(self.name)

    @property
    def at(self) -> int:
        """Place, among the levels that the design is for, of the one nearest to the job's light."""
        return min(range(len(self.designed.levels)), key=lambda k: abs(self.designed.levels[k] - self.level_db))

    def gain(self, level_db: float) -> MeanDifference:
        """Restored PSNR over the reference's, dB."""
        return next(gain.psnr for gain in self.photographs.gains[self.name] if gain.level_db == level_db)

    def gained(self, level_db: float) -> bool:
        """Whether photographs gain what is worth a mask at a light."""
        gain = self.gain(level_db)
        return not gain.tie and gain.mean >= WORTH_DB

    def light(self, level_db: float) -> str:
        """Light in words: lux on white of reflectance 1 where the job states a luminance, else the level."""
        exposure, kind = self.job.spec.exposure, self.photographs.conditions.protocol
        if exposure is None or exposure.luminance is None:
            return f"{level_db:.3g} dB of light"
        times = kind.exposure(level_db).electrons / kind.exposure(self.level_db).electrons
        return f"{short(math.pi * exposure.luminance * times, 3)} lux"

    def electrons(self, level_db: float) -> str:
        """Electrons of white behind the design, in words."""
        white = self.photographs.conditions.protocol.exposure(level_db).behind(self.designed.opening.open_ratio)
        return f"{short(white, 3)} electrons of white"


class _Row(Part):
    name: str
    value: float | str | None = Field(description="null: not tried, for the reason in `how`")
    unit: str
    error: float | None = Field(description="half width; null where `how` says what the value is worth")
    reference: float | None = Field(description="of the display or die that it is compared with")
    limit: float | None
    least: bool = Field(description="whether the limit is the least that is allowed")
    passed: bool | None
    how: str


class _Answer(Part):
    key: str
    question: str
    sentence: str
    method: str = Field(description="of all rows; empty where each says its own")
    rows: list[_Row]


class AdvicePart(Part):
    """The content of advice.json."""

    schema_version: int
    maskfab_version: str
    job_hash: str
    command: str
    time: dict[str, float] | None = written("seconds: wall_s, processor_s")
    budget_s: float | None
    build: bool
    verdict: str
    why_not: list[str]
    caveats: list[str] = Field(description="what the verdict is no verdict on")
    answers: list[_Answer]
    assumes: list[str]
    left_out: list[str]
    files: list[str]


def schema() -> Document:
    """The JSON Schema of advice.json."""
    return titled_schema("maskfab advice", AdvicePart)


def _row(name: str, value: float | str | None, unit: str = "", how: str = "", **more: Any) -> Document:
    empty = {"error": None, "reference": None, "limit": None, "least": False, "passed": None}
    return _Row.document(name=name, value=value, unit=unit, how=how, **{**empty, **more})


def gain_words(gain: MeanDifference) -> str:
    """A difference with its interval, to the digits that this allows; reasons say what holds 0."""
    return gain.told().removesuffix(" tie")


def why_not(advised: Advised) -> list[str]:
    """Reasons not to build the design, the strongest first; none where it should be built."""
    display, level = advised.display, advised.level_db
    reasons = [] if advised.misfit is None else [f"no display fits it: {advised.misfit}"]
    if advised.misfit is None and display is not None and display.verdict is not Verdict.FITS:
        reasons.append(f"the display was not found to fit: {misfit(display)}")
    for row in _limits(advised):
        if row["passed"] is False:
            whose = row["how"].partition(":")[0]
            reasons.append(f"{row['name']} is {shown(row)}, and may be {bound(row)} ({whose})")
    reasons += [advised.unkept] if reasons and advised.unkept else []
    if not advised.gained(level):
        gain = advised.gain(level)
        held = "which may be chance" if gain.tie else f"less than {WORTH_DB:.1f} dB"
        reasons.append(f"at {advised.light(level)} photographs gain {gain_words(gain)}, {held}; {_starved(advised)}")
    return reasons


def _starved(advised: Advised) -> str:
    """Whether light or blur is what photographs lack, by a clear stop of as much light; what would help."""
    ideal, dots = advised.unobstructed, advised.designed.opening.clear_dots
    gains = f"a clear stop of as much light would gain {gain_words(ideal)}"
    if ideal.mean < WORTH_DB:
        why = f"{gains}: they are starved of light, not blurred, and no opening of {dots} dots is worth a mask"
    elif ideal.tie:
        why = f"{gains}, so that {ideal.count} scenes do not tell blur from want of light"
    else:
        why = f"{gains}: they are blurred, and this opening is no cure"
    best = advised.curve.best
    more = 0.0 if best is None else advised.curve.gain_db(best) - advised.gain(advised.level_db).mean
    if best is None or more < WORTH_DB:
        return why
    return f"{why}; try {_asked(best)}, which fits and is expected to gain {more:.1f} dB more"


def caveats(advised: Advised) -> list[str]:
    """Conditions of the lens and its distance that the verdict is no verdict on, in words that go on after a comma."""
    scene, answered = advised.job.spec.scene, [note for note in advised.notes if isinstance(note, Caveat)]
    lacks = [key for key in ("gap", "field") if scene is None or not getattr(scene, key)]
    if answered or not lacks:
        return list(answered)
    held = {"gap": "with the display at the lens", "field": "along the axis alone"}
    return [f"judged {' and '.join(held[key] for key in lacks)}, for [scene] states no {' and no '.join(lacks)}"]


def _verdict(advised: Advised, reasons: Sequence[str]) -> str:
    level, gain = advised.level_db, advised.gain(advised.level_db)
    better = (
        f"restored photographs at {advised.light(level)} are {gain_words(gain).lstrip('+')} better than behind "
        f"{advised.reference}"
    )
    if reasons:
        apart = f". Without that, {better}" if advised.gained(level) else ""
        return f"Do not build this: {'; '.join(reasons)}{apart}."
    limits = [row for row in _limits(advised) if row["limit"] is not None]
    names = ", ".join(f"{row['name']} {shown(row)} ({bound(row)})" for row in limits)
    kept = f"keeps its limits: {names}" if limits else "fits round it"
    power = 100 / 10 ** (gain.mean / 10)
    better = f"{_decided(advised)}: {better}"
    apart = "".join(f" {caveat[:1].upper()}{caveat[1:]}." for caveat in caveats(advised))
    better = f"{better}, with {power:.0f}\N{NO-BREAK SPACE}% of the error's power"
    return f"Build this, {better}, and the display {kept}.{apart}"


def _decided(advised: Advised) -> str:
    """Share of the pixel and circuits over the camera, in words, and whether they were chosen or stated."""
    display, opening = advised.display, advised.designed.opening
    by = "less than" if advised.designed.shortfall is not None else "as" if advised.stated else ""
    by = f"{by} {'stated' if advised.stated else 'chosen'}".lstrip()
    if advised.curve.best is None and not advised.stated:
        by = "the least that is looked at"
    share = f"{opening.open_ratio:.0%} of the pixel clear, {by}"
    return share if display is None else f"{share}, and {display.resolution_ppi:.0f} ppi of circuits over the camera"


def _asked(point: SharePoint) -> str:
    """Keys of a job that ask for a point of the curve."""
    dots = f"clear_dots = {point.clear_dots}"
    return f"{dots} with {point.zone}" if point.across > 1 else f"{dots}, sharing = {point.sharing}"


def _limits(advised: Advised) -> list[Document]:
    """Numbers of the eye and of life, beside the reference display and their limits."""
    display = advised.display
    if display is None or display.judged is None:
        return []
    parts = display_document(display)
    numbers = [number for part in ("looks", "lives") if part in parts for number in parts[part]["numbers"]]
    judged = (*display.judged.looks, *display.judged.lives)
    keys = ("reference", "limit", "passed")
    return [
        _row(own.title, own.value, number["unit"], own.source, least=own.least, **{key: number[key] for key in keys})
        for own, number in zip(judged, numbers, strict=True)
    ]


def shown(row: Record) -> str:
    """Value of a row with its error and unit, as a page shows it."""
    value, error = row["value"], row["error"]
    if value is None or isinstance(value, str):
        return "not tried" if value is None else value
    decimals = 1 if not error else max(0, decimals_of(error))
    text = short(value, 2 if abs(value) < 10 else 3)
    if row["unit"] == "dB":
        text = f"{value:{'+' if row['name'].startswith(_GAIN) else '-'}z.{decimals}f}"
    unit = "" if row["unit"] == "1" else row["unit"]
    return f"{text}{'' if error is None else f' ± {error:.{decimals}f}'} {unit}".rstrip()


def bound(row: Record) -> str:
    """Limit of a row in words; a dash for none."""
    return "–" if row["limit"] is None else f"at {'least' if row['least'] else 'most'} {short(row['limit'], 2)}"


_GAIN = "gain"


def _build(advised: Advised) -> tuple[str, str, list[Document]]:
    designed, at = advised.designed, advised.at
    opening, alike = designed.opening, designed.account is not None and designed.account.tiling is Tiling.PERIODIC
    pitch_um, dot_um = opening.dots * opening.dot_nm / NM_PER_UM, opening.dot_nm / NM_PER_UM
    # Each gain is by one model: of turning, by the mean over random tilings; of the map, by the panel that is laid.
    turned = None if alike or designed.outer is not None else designed.psnr[at] - advised.alike_psnr[at]
    by_map = 0.0 if designed.designed is None else designed.designed.gain_db[at]
    ways = {} if turned is None else {"cells turned at random": turned}
    if designed.designed is not None:
        ways["cells turned by their map" if ways else "its map over cells turned at random"] = (turned or 0.0) + by_map
    laid = list(ways)[-1] if ways else "all cells laid alike"
    rows = [_row(f"gain by {way}", gain, "dB", "built" if way == laid else "") for way, gain in ways.items()]
    if designed.shortfall is not None:
        rows.append(_row("clear dots", opening.clear_dots, "", designed.shortfall.told))
    dense = "the same all over the stop" if designed.outer is None else "more in the middle of the stop"
    seed = "–" if designed.account is None else designed.account.seed
    rows.append(_row("light", dense, "", f"{designed.evaluated} openings judged, seed {seed}"))
    return (
        f"{opening.clear_dots} clear dots of {dot_um:g} µm in each pixel of {pitch_um:g} µm, {opening.open_ratio:.1%} "
        f"of it: {designed.shape}; {laid}.{_shares(advised, turned, by_map)}",
        f"Gains are over the same opening with all cells laid alike, at {designed.levels[at]:.3g} dB of light "
        f"(signal-to-noise of white): {_MODEL}. {explained(dot_um, designed.shape) or designed.shape}.",
        rows,
    )


def _shares(advised: Advised, turned: float | None, by_map: float) -> str:
    """Sentence on how much of the photographs' gain is the opening's own, and how much that of turning it.

    Args:
        turned: gain by turning cells at random, dB; None where they lie alike, or openings are two.
        by_map: gain of the map over that, dB.
    """
    if advised.job.spec.die[0].tiling is not Tiling.PERIODIC:
        return ""
    gain = round(advised.gain(advised.level_db).mean, 1)
    whole = f" Of the {gain:+.1f} dB of its photographs at {advised.light(advised.level_db)}"
    if turned is None:
        return "" if advised.designed.outer is not None else f"{whole}, all are the opening's own: no cell is turned."
    parts = [round(turned, 1), round(by_map, 1)]
    more = "" if advised.designed.designed is None else f", their map {parts[1]:+z.1f}"
    own = gain - sum(parts)
    return (
        f"{whole}, turning its cells brings about {parts[0]:+z.1f}{more}, and the opening itself the rest, {own:+z.1f}."
    )


def _photographs(advised: Advised) -> tuple[str, str, list[Document]]:
    taken, level, gain = advised.photographs, advised.level_db, advised.gain(advised.level_db)
    names = (advised.reference, "the design")
    rows = [
        _row(f"restored PSNR, {name}", die.psnr(level), "dB", die.error_told(level), error=NOISE_DB)
        for name, die in zip(names, taken.dies.values(), strict=True)
    ]
    for light in taken.conditions.levels:
        own = advised.gain(light)
        error = None if math.isnan(own.half_width) else own.half_width
        more = {"error": error, "limit": WORTH_DB, "least": True, "passed": advised.gained(light)}
        rows.append(_row(f"gain at {advised.light(light)}", own.mean, "dB", advised.electrons(light), **more))
    why = _reference_misfit(advised)
    unfit = "" if why is None else f" But {advised.reference} could not be built: by the job's rules, {why}."
    return (
        f"{gain_words(gain)} at {advised.light(level)}, {advised.electrons(level)}.{unfit}",
        f"PSNR is the distance of a restored photograph from the scene: 3 dB more is half the error's power. Gains are "
        f"means of {gain.count} drawn scenes, paired over {advised.reference}, with their {CONFIDENCE:.0%} interval.",
        rows,
    )


@lru_cache(maxsize=4)
def _reference_misfit(advised: Advised) -> str | None:
    """Why the display of the reference does not fit, as its first pixels tell; None if it does, or nothing must."""
    job, rules = advised.job, display_rules(advised.job)
    panel = job.panels()[job.spec.die[0].name]
    few = replace(panel, orientations=panel.orientations[:_FEW, :_FEW])
    if rules is None:
        return None
    try:
        # Lines of pixels that are left out pass a wider one beside it: as many fewer pass each of the reference.
        wider = rules.zone.across(job.panels()[advised.name].pitch_nm) // rules.zone.across(panel.pitch_nm)
        if rules.wires is not None and wider > 1:
            rules = replace(rules, wires=replace(rules.wires, lines=rules.wires.lines // wider))
        return misfit(feasibility(few, rules, largest=False))
    except JobError as refusal:
        return refusal.what


def _costs(advised: Advised) -> tuple[str, str, list[Document]]:
    display = advised.display
    if display is None:
        return "The design has no pixels that a display could be judged by.", "", []
    how = f"drawn by the job's rules; none can have more than {display.footprint.bound_share:.1%}"
    limit, passed = 100 * display.required, display.share >= display.required - 1e-12
    row = _row("emitters of each colour", 100 * display.share, "%", how, limit=limit, least=True, passed=passed)
    limits = _limits(advised)
    broken = [row["name"] for row in limits if row["passed"] is False]
    held = f"breaks {', '.join(broken)}" if broken else "keeps every limit that it is held against"
    wired = "" if display.wiring is None else f" and {min(display.wiring.lines)} lines each way"
    fits = (
        f"The display fits: emitters{wired}" if display.verdict is Verdict.FITS else f"It does not: {misfit(display)}"
    )
    seen = (
        "" if display.judged is None else f"Seen: {display.judged.where}. Beside {display.judged.layout}, the maker's."
    )
    placed = "circuits counted by area, not placed" if display.circuits is None else display.circuits.told
    resolution = _row("local resolution", display.resolution_ppi, "ppi", f"{display.resolution}; {placed}")
    rows = [resolution, row, *limits]
    if advised.limit_cost_db is not None:
        rows.append(_row("loss by keeping its limits", advised.limit_cost_db, "dB", f"{_MODEL}; {advised.unkept}"))
    fits = (
        f"{display.resolution_ppi:.0f} ppi of circuits over the camera ({display.zone.told(display.pitch_nm)}). {fits}"
    )
    return f"{fits}; it {held}.", seen, rows


def _houses(advised: Advised) -> tuple[str, str, list[Document]]:
    by = {answer: [bid for bid in advised.bids if bid.answer == answer] for answer in ("takes it", "ask first")}
    taking, asking, rows = by["takes it"], by["ask first"], []
    for bid in taking:
        least = next((finding for finding in bid.findings if finding.rule == "min_feature"), None)
        rule = "no least feature published" if least is None else f"features from {least.limit} {least.unit}"
        rows.append(_row(bid.title, "takes it", "", ", ".join((bid.format, rule, *bid.changes))))
    if asking:
        rows.append(_row("ask first", f"{len(asking)} houses", "", "; ".join(bid.title for bid in asking)))
    refusing = [bid for bid in advised.bids if bid not in taking and bid not in asking]
    if refusing:
        why = "; ".join(f"{bid.title} ({', '.join(dict.fromkeys(f.rule for f in bid.refusals))})" for bid in refusing)
        rows.append(_row("do not take it", f"{len(refusing)} houses", "", why))
    blanks = sorted({blank for bid in taking or asking for blank in bid.blanks})
    lacks = f"A first order still lacks {', '.join(blanks)}: maskfab order fill job.toml --shop NAME asks for them."
    sentence = f"{len(taking)} of {len(advised.bids)} mask houses take the plate by their published rules."
    return sentence, lacks if blanks else "A first order lacks nothing.", rows


def _others(advised: Advised) -> tuple[str, str, list[Document]]:
    designed, curve = advised.designed, advised.curve
    by = (
        f"photographs at {advised.light(advised.level_db)}"
        if curve.photographed
        else "estimates, too high for large shares"
    )
    before, after = float(np.mean(designed.psnr)), laid_db(designed)
    rows = [_point_row(advised, point) for point in _points(curve)]
    rows += [_reach_row(reach, after if reach.mapped else before) for reach in advised.reaches]
    if not advised.reaches:
        rows.append(_row("gain with a rule eased", None, "", "ended before it was looked for"))
    near = designed.alternatives
    if near is not None and near.others:
        own, others = near.chosen.value, [(one.name, one.unit, one.value) for one in near.others[:2]]
    else:
        own, others = before, [(one.name, one.unit, one.value) for one in designed.rivals]
    for name, unit, value in others:
        rows.append(_row(f"gain over the design by {name}", value - own, "dB", f"{unit.mean():.1%} of the pixel, too"))
    if not others:
        rows.append(_row("gain by another shape", None, "", "none of another kind was found that keeps the rules"))
    method = (
        f"Gains of shares are over {advised.reference}, by {by}; others over the design, mean over the light, before a "
        f"map unless said otherwise: {_MODEL}. A row of a share has the keys of [design] and [display] that ask for "
        "it, or what is left out, the share of each colour's emitters, and life and slow grain beside those around."
    )
    if curve.best is None:
        return "No share of the pixel was found that a display fits.", method, rows
    return (
        curve.told_as("the rule's choice beside what the job states," if advised.stated else "chosen"),
        method,
        rows,
    )


def _points(curve: ShareCurve) -> list[SharePoint]:
    """Points that are worth a row: the chosen one, and those that fit, with fewer circuits only where they gain."""
    best: dict[float, float] = {}
    points = []
    for point in curve.fitting:
        if point is curve.best or point.value > best.get(point.share, -math.inf):
            best[point.share] = point.value
            points.append(point)
    return points


def _point_row(advised: Advised, point: SharePoint) -> Document:
    numbers = {number.name: number for number in point.numbers}
    pays = [f"emitters {point.footprint:.1%}"]
    pays += [f"{key} {short(numbers[key].value, 2)}" for key in ("life", "grain") if key in numbers]
    pays += ["all cells laid alike"] * point.alike
    broken = [number.title for number in point.numbers if number.passed is False]
    pays += [f"breaks {' and '.join(broken)}"] * bool(broken)
    chosen = ["the rule's choice" if advised.stated else "chosen"] if point is advised.curve.best else []
    guessed = ["estimate"] * (advised.curve.photographed and point.error_db is None)
    how = "; ".join([*chosen, *guessed, _asked(point), point.shape, *pays])
    name, gain = f"gain at {point.share:.0%}, {point.zone}", advised.curve.gain_db(point)
    return _row(name, gain, "dB", how, error=point.error_db)


def _reach_row(reach: Reach, own: float) -> Document:
    name = f"gain by {reach.name}"
    if not reach.shape:
        if reach.why is not None:
            return _row(name, None, "", reach.why)
        return _row(name, "none found", "", f"above {reach.clear_dots} dots, which is no proof")
    share = (reach.clear_dots or 0) / reach.dots**2
    how = [f"{reach.clear_dots} dots, {share:.1%}: {reach.shape}"]
    how += ["all cells laid alike"] * reach.alike + ["with its map"] * reach.mapped
    how += [] if reach.complete else ["more may fit, for time ran out"]
    return _row(name, float(np.mean(reach.psnr)) - own, "dB", "; ".join(how))


def _when_not(advised: Advised) -> tuple[str, str, list[Document]]:
    designed, ideal, levels = advised.designed, advised.unobstructed, advised.photographs.conditions.levels
    error, at = None if math.isnan(ideal.half_width) else ideal.half_width, advised.at
    how = f"at {advised.light(advised.level_db)}: no blur but the lens's"
    rows = [_row("gain by a clear stop of as much light", ideal.mean, "dB", how, error=error)]
    proofs = (("another opening of as many dots", designed.head_room), ("another map", designed.map_head_room))
    for name, room in proofs:
        if room is not None and room[at] <= USEFUL_DB:
            rows.append(_row(f"gain by {name}, at most", room[at], "dB", "proven, far from the frame's edge"))
    method = (
        f"Worth a mask: {WORTH_DB:.1f} dB, as much as a third of a stop more light brings where photons are the noise, "
        "the smallest step by which cameras set their exposure; and an interval without 0."
    )
    poor = [level for level in levels if not advised.gained(level)]
    if not poor:
        least = min(levels)
        sentence = (
            f"Every light that was tried is enough, down to {advised.light(least)}: {gain_words(advised.gain(least))}."
        )
        return f"{sentence} In less, photograph first.", method, rows
    gains = " and ".join(f"at {advised.light(level)} ({gain_words(advised.gain(level))})" for level in poor)
    why = f": {_starved(advised)}" if advised.level_db in poor else ""
    return f"Not for photographs {gains}{why}.", method, rows


_QUESTIONS = (
    ("build", "Build this", _build),
    ("photographs", "Photographs, before and after", _photographs),
    ("costs", "What it costs the display", _costs),
    ("houses", "Who writes it", _houses),
    ("others", "What else there is", _others),
    ("when_not", "When not to build", _when_not),
)


def advice_document(
    advised: Advised, command: str, files: Sequence[str], time: Mapping[str, float] | None = None
) -> Document:
    """The content of advice.json; equal answers give equal documents but for ``time``.

    Args:
        time: seconds that it took; None where that is not told.
    """
    reasons, answers = why_not(advised), []
    for key, question, of in _QUESTIONS:
        sentence, method, rows = of(advised)
        asked = "The best that was found" if key == "build" and reasons else question
        answers.append(_Answer.document(key=key, question=asked, sentence=sentence, method=method, rows=rows))
    taken = advised.photographs
    left = [*dict.fromkeys(note for die in taken.dies.values() for note in die.left_out)]
    left += [note for note in advised.notes if not isinstance(note, Caveat)]
    # What a design and photographs do not use by themselves, others of this answer may.
    left += [note for note in advised.designed.notes if "not used of the job" not in note]
    cut = ["A search that its budget cut short is not repeated bit for bit."] if advised.designed.cut else []
    return AdvicePart.document(
        schema_version=SCHEMA_VERSION,
        maskfab_version=__version__,
        job_hash=advised.job.digest,
        command=command,
        time=time,
        budget_s=advised.budget_s,
        build=not reasons,
        verdict=_verdict(advised, reasons),
        why_not=reasons,
        caveats=caveats(advised),
        answers=answers,
        assumes=list(_assumes(advised)),
        left_out=[*left, *cut],
        files=list(files),
    )


def _assumes(advised: Advised) -> Iterator[str]:
    yield from (line for line in advised.photographs.conditions.lines if not line.startswith("not used"))
    scenes = {score.scene for score in advised.photographs.table.scores}
    yield f"photographs of {len(scenes)} drawn scenes ({', '.join(sorted(scenes))}), the same for both dies"
    account = advised.designed.account
    if account is not None:
        yield f"designed for {advised.designed.camera}, on {account.scenes}, seed {account.seed}"


def advice_lines(document: Record) -> list[str]:
    """The answer for a terminal."""
    lines = [
        document["verdict"],
        *(f"But: {one}." for one in document["caveats"] if one[1:] not in document["verdict"]),
    ]
    for answer in document["answers"]:
        lines += ["", f"{answer['question']}: {answer['sentence']}", answer["method"]]
        lines += [
            f"  {row['name']}: {shown(row)}" + (f"  ({row['how']})" if row["how"] else "") for row in answer["rows"]
        ]
    return lines


def pictures(advised: Advised) -> dict[str, str]:
    """``<img>`` elements: pixel and panel with emitters, the truth, and photographs before and after."""
    die = next(die for die in advised.displays.plate.dies if die.name == advised.name)
    before, after = advised.photographs.dies.values()
    shot = {
        f"photograph_{key}": scene_figures.front(one, advised.level_db)["front"]
        for key, one in (("before", before), ("after", after))
    }
    panel = display_figures.placement(die.panel)
    more = {"panel": panel, "curve": display_figures.shares(advised.curve)}
    return {**more, **scene_figures.truth(after), **shot, **_portraits(advised)}


def _portraits(advised: Advised) -> dict[str, str]:
    """``<img>`` elements of one photograph that a reader can judge, before, after and as it is, and a caption; none
    where brackets ask for highlights, a scene takes its time, or there is no photograph."""
    conditions, level, job, scene = advised.photographs.conditions, advised.level_db, advised.job, portrait()
    if scene is None or conditions.protocol.brackets or job.spec.scene is not None:
        return {}
    panels = {die.name: die.panel for die in plate_as_seen(job, job.plate()).dies}
    shots: list[Shot] = []
    for name in advised.photographs.dies:
        seen, _ = conditions.design(name, panels[name], Surroundings.of(job))
        evaluate(
            [seen], [scene], [scene], [level], protocol=conditions.protocol, details=False, expected=True,
            show=lambda score, picture: shots.append(Shot(score, picture)),
        )  # fmt: skip
    before, after = (scene_figures.front(Restored(shots=(shot,)), level)["front"] for shot in shots)
    rows, columns = shots[0].picture.shape[1:]
    itself = scene_figures.tile(truth_of(scene, Crop(rows, columns)), "the photograph as it is")
    gain = shots[1].score.psnr - shots[0].score.psnr
    told = f"A photograph at {advised.light(level)}, in no mean: {gain:+.1f} dB. {PORTRAIT}."
    return {"portrait_before": before, "portrait_after": after, "portrait_truth": itself, "portrait_told": told}


def _beside(value: float | None) -> str:
    return "–" if value is None else "0" if abs(value) < NOTHING else short(value, 2 if abs(value) < 10 else 3)


NOTE_CHARACTERS = 36
"""Longest note that stands in its row of a table; longer ones stand once below it, by their number."""


def _noted(answer: Record) -> dict[str, Any]:
    """An answer whose long notes are told once, below its rows, each of which has the number of its own."""
    notes = list(dict.fromkeys(row["how"] for row in answer["rows"] if len(row["how"]) > NOTE_CHARACTERS))
    numbers = {note: number for number, note in enumerate(notes, start=1)}
    rows = [{**row, "note": numbers.get(row["how"])} for row in answer["rows"]]
    return {**answer, "rows": rows, "notes": notes}


def advice_page(document: Record, drawn: Mapping[str, str]) -> str:
    """The page, with nothing from outside it."""
    return page_template("advice.html.j2", cell=shown, beside=_beside, bound=bound).render(
        style=style(),
        told=document,
        answers={answer["key"]: _noted(answer) for answer in document["answers"]},
        pictures={key: Markup(image) for key, image in drawn.items()},
    )


def write_advice(place: Place, document: Record, files: Mapping[str, str], drawn: Mapping[str, str]) -> list[Path]:
    """Write the page, its numbers, and the job with its files into a directory that appears whole; return the paths."""
    text = document_text(document)
    texts = {**files, DOCUMENT: text, PAGE: advice_page(json.loads(text), drawn)}
    return write_folder(place, texts, document["job_hash"])
