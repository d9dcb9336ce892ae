"""Engine of ``advise``: a design for a job's display, photographs through it, its price, and what else there is.

    job -> design within the clock -> plate of two dies -> displays, photographs, mask houses -> Advised

A second process meanwhile looks for larger openings, as the rules stand and with one of them eased. The two dies are
the one that the job would compare with and the design; they are photographed as ``run`` photographs them, so that a run
of the job that is written has the same gain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, cast

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.base.errors import JobError
from maskfab.base.extras import require
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.base.processes import Call, SerialExecutor, Task
from maskfab.base.units import NM_PER_UM, UM_PER_MM
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.base.workers import EVERY_CORE
from maskfab.camera.imaging import Design
from maskfab.camera.protocol import evaluate
from maskfab.camera.scenes import Photograph
from maskfab.camera.scores import MeanDifference
from maskfab.camera.sensor import Exposure
from maskfab.camera.stop_cells import PhotoCamera, lattice
from maskfab.designs.design import (
    capture_settings,
    check_possible,
    design,
    scenes_of,
    section_of,
    share_curve_of,
    sharing_by,
    stated_display,
    with_choice,
)
from maskfab.designs.search.held import start_of
from maskfab.designs.search.question import Judges
from maskfab.designs.search.result import Designed, constraints_of
from maskfab.designs.search.scan import scanned
from maskfab.designs.search.share import ShareCurve, SharePoint
from maskfab.display.drive import lives
from maskfab.display.eye_and_life import DEFAULT_LIFE
from maskfab.display.feasibility import PlateWithDisplays, displays
from maskfab.findings import photographs
from maskfab.findings.optics import plate_as_seen
from maskfab.findings.photographs import Conditions, Photographs, Restored, Surroundings, middle_level, photograph_die
from maskfab.job.camera import Stop
from maskfab.job.die import DieSection
from maskfab.job.faults import JobFaults
from maskfab.job.reference import USES, in_words, unused
from maskfab.job.sections import JobSpec, ReportSection, RulesSection, SceneSection, SearchSection
from maskfab.job.toml import dumps
from maskfab.mask.houses.profiles import load_shop, shop_names, shop_of
from maskfab.mask.job import Job, resolve
from maskfab.mask.opening_file import dot_of_pitch, opening_text
from maskfab.mask.package.pack import compare_shops
from maskfab.mask.panels import map_text
from maskfab.optics.scene.plan import plan
from maskfab.optics.scene.scene import Scene
from maskfab.optics.tiling import orientations
from maskfab.report.pages.advice import WORTH_DB, Advised, Caveat, Reach, laid_db
from maskfab.runs.stages import PendingPhotographs

_TASKS = 3
"""Tasks at a time: the design, what is looked for meanwhile, and photographs."""
_AFTER, _MOST_AFTER_S, _MEANWHILE = 0.45, 60.0, 0.55
"""Share of the time, and the most of it, for all that follows the design; share for what the second process does, which
takes the photographs of the design afterwards."""
_UNDER_S, _DENSER_S = 60.0, 240.0
"""Least time for a design under limits of the eye, and for one that is denser in the middle."""
_LIGHTS = 10.0
"""Times less light, and more, that photographs are taken in beside the stated light."""
_CHOICE = 0.45
"""Share of the time in which the share of the pixel is chosen."""
_SHOWN, _LEAST_SHOWN = 0.35, 6
"""Share of the time left in which points of the curve are photographed, and the fewest of them."""
_LESS_EMITTER, _MOST_DOTS = 0.02, 128
"""Share of the pixel, all colours together, by which emitters are eased; dots along a pixel."""
_SEARCHED, _MAPS = ("delta_e", "grain"), 1.1
"""Limits of the eye that are rules of a search, too; and how much less these are, for a map may look less even."""
_NONE_FITS = "No display was found to fit any share of the pixel that was looked at: the least of them is designed."
_LONGER = "time ran out: give a longer --budget"


def searched(spec: JobSpec, where: str) -> tuple[JobSpec, SearchSection, Job]:
    """The job, whose display must fit, its [design], and the job with the die to compare with alone; what no opening
    can keep is an answer, and not refused.

    Raises:
        JobError: MF105 without [emitters], [plate], a [design] that searches, or a die to compare with; else as for
            that die, and as :func:`maskfab.designs.design.check_possible`; all at once.
    """
    require("design", what="advice on a design", where=where)
    faults, section, spare = JobFaults.of_spec(spec), spec.design, spec.design and spec.design.output
    others = [die for die in spec.die if die.opening != spare]
    with faults:
        if not isinstance(section_of(spec, where), SearchSection):
            what, cure = "advice is on openings that are searched by restored photographs", 'Set method = "search"'
            raise JobError("MF105", what, where=f"{where}: design", cure=cure)
    for name in ("emitters", "plate"):
        if getattr(spec, name) is None:
            cure = f"Add [{name}], as in layouts/display_that_fits.toml"
            faults.add(JobError("MF105", f"the job has no [{name}]", where=f"{where}: {name}", cure=cure))
    if not others:
        cure = "Add [[die]] with the opening of a display as it is"
        faults.add(JobError("MF105", "the job has no die to compare the design with", where=f"{where}: die", cure=cure))
    named = [die for die in others if spec.report is not None and die.name == spec.report.reference]
    before = None
    if section is not None and others:
        with faults:
            before = resolve(spec.model_copy(update={"die": tuple(named or others)[:1], "report": None}), Path(where))
            shop_of(before.spec, before.where)
    if isinstance(section, SearchSection):
        # What lacks a display is told above, and not again as a display that must fit.
        section = section.model_copy(update={"fit": spec.emitters is not None})
        spec = spec.model_copy(update={"design": section, "pareto": None, "study": None})
        try:
            check_possible(spec, where=where)
        except JobError as refusal:
            if any(fault.code != "MF123" for fault in refusal.faults):
                faults.add(refusal)
    faults.refuse()
    assert isinstance(section, SearchSection)
    assert before is not None
    spec = _living(spec, section, where)
    parts = {"emitters": spec.emitters, "design": section, "pareto": None, "study": None}
    return spec, section, replace(before, spec=before.spec.model_copy(update=parts))


def _living(spec: JobSpec, section: SearchSection, where: str) -> JobSpec:
    """The job with emitters as large as their limit of life asks at least: life goes with their area to a power."""
    display, emitters = stated_display(spec, section, where, key="design.fit"), spec.emitters
    rules, pitch_nm = display.rules, dot_of_pitch(section.pitch, section.dots, where=where) * section.dots
    reference = rules.eye.reference(pitch_nm, rules.emitters)
    if reference is None or emitters is None:
        return spec
    share = emitters.required or _LESS_EMITTER
    red, green, blue = (share * ratio for ratio in rules.emitters.ratio)
    life, limit = lives(rules.light, (red, green, blue), reference.shares).life, rules.eye.lives.life or DEFAULT_LIFE
    least = math.ceil(1e4 * share * (limit / life) ** (1 / rules.light.ageing_exponent)) / 1e4
    if least <= emitters.required or 3 * least >= 1:
        return spec
    return spec.model_copy(update={"emitters": emitters.model_copy(update={"required": least})})


def advise(
    stated: JobSpec,
    command: str,
    *,
    path: Path,
    images: Path | None = None,
    progress: Progress = silent,
    clock: Clock,
    notes: tuple[str, ...] = (),
) -> Advised:
    """Find what should be built for a job's display.

    Args:
        path: the job, for errors; its files are named from its folder.
        images: folder of photographs to design for; synthetic scenes if None.
        clock: of the budget; whoever ends it early gets the best so far, photographed.
    """
    spec, section, before = searched(stated, str(path))
    (reference,), stated_dots = before.spec.die, section.clear_dots
    conditions, level = _conditions(before)
    notes += in_words(unused(stated, *USES["advise"]))
    asked, held = (job.emitters.required if job.emitters else 0.0 for job in (stated, spec))
    if held > asked:
        notes += (f"Each colour covers {held:.1%} of the pixel, not {asked:.1%}, so that it keeps its limit of life.",)
    with EVERY_CORE.executor(_TASKS) as executor:
        work = _Work(spec, section, before, command, path, images, progress, clock, executor)
        taken = {reference.name: work.photographed(before, reference.name, conditions)}
        curve = share_curve_of(
            spec,
            where=str(path),
            images=images,
            over=before.panels()[reference.name],
            coarser=not stated_dots,
            clock=clock.part(_CHOICE),
            executor=executor,
            progress=progress,
        )
        curve = work.photographed_curve(curve, taken[reference.name], conditions, level)
        chosen = with_choice(spec, curve, str(path))
        spec, section, own, why = _as_stated(spec, chosen, curve, stated_dots)
        notes += why
        parts = {"display": spec.display, "wires": spec.wires}
        before = replace(before, spec=before.spec.model_copy(update=parts))
        work = replace(work, spec=spec, section=section, before=before)
        left = clock.left()
        eased = executor.submit(Call(reaches, lambda: (spec, str(path), images, left and _MEANWHILE * left)))
        designed, misfit = work.designed()
        laid = work.laid(designed)
        if misfit is None:
            laid = work.within_limits(laid, curve.best)
        designed, job, built = laid.designed, laid.job, laid.built
        plate, name = job.plate(), job.spec.die[-1].name
        houses = executor.submit(
            Call(compare_shops, lambda: (job.spec, plate, [load_shop(shop) for shop in shop_names()]))
        )
        # Those of the reference tell how long photographs take, and those of a clear stop take a level more.
        taken[reference.name].result()
        photographs_s = taken[reference.name].seconds * (1 + 1 / len(conditions.levels))
        if len(conditions.levels) > 1 and not clock.affords(photographs_s):
            notes += (f"{clock.ender} left no time for photographs in other light than {level:.3g} dB.",)
            conditions = replace(conditions, levels=(level,))
        taken[name] = work.photographed(job, name, conditions)
        shown = PendingPhotographs(conditions, taken, reference.name, executor).result(progress)
        shown = replace(shown, dies={die: _at(seen, conditions.levels) for die, seen in shown.dies.items()})
        _require(shown)
        ideal = _unobstructed(job, name, shown, level)
        bids = work.told("mask houses", houses)
        alike = work.judges(spec).estimate(designed.opening.mask, periodic=True, levels=designed.levels)
        found = () if clock.halt.is_set() and not eased.ended else work.told("larger openings", eased)
    return Advised(
        job,
        designed,
        alike,
        misfit,
        built,
        shown,
        level,
        ideal,
        bids,
        found,
        curve,
        own,
        laid.unkept,
        laid.cost_db,
        notes,
        clock.budget_s,
    )


@dataclass(frozen=True, eq=False)
class _Laid:
    """A design in its job, with its display; what became of limits that a freer one breaks, and what that cost, dB."""

    designed: Designed
    job: Job
    built: PlateWithDisplays
    unkept: str | None = None
    cost_db: float | None = None


@dataclass(frozen=True, eq=False)
class _Work:
    """Everything that the parts of an answer are made from: the job, its [design], the job of the reference alone."""

    spec: JobSpec
    section: SearchSection
    before: Job
    command: str
    path: Path
    images: Path | None
    progress: Progress
    clock: Clock
    executor: SerialExecutor

    def designed(self) -> tuple[Designed, str | None]:
        """The design; where no display fits, the one without it, and why."""
        try:
            return self._design(), None
        except JobError as refusal:
            if any(fault.code != "MF123" for fault in refusal.faults):
                raise
            return self._design(fit=False), refusal.faults[0].what

    def of_point(self, point: SharePoint | None) -> Designed | None:
        """A point of the curve laid as it is, without a map, which keeps limits on a small die; None where the design
        has another share."""
        if point is None or point.unit is None or point.clear_dots != self.section.clear_dots:
            return None
        tiling = Tiling.PERIODIC if point.alike else self.section.tiling
        with suppress(JobError):
            found = self._design(begin=point.unit, map=None, map_output=None, tiling=tiling)
            return replace(found, shape=point.shape)
        return None

    def within_limits(self, first: _Laid, point: SharePoint | None) -> _Laid:
        """The design if it keeps its limits of the eye, else one that is searched for, or a point of the curve."""
        limits, broken = _limits(first.built)
        if not broken:
            return first
        named = " and ".join(broken)
        found, unkept = self.under(limits, named, first.designed)
        best = first if found is first.designed else self.laid(found)
        if _limits(best.built)[1] and (held := self.of_point(point)) is not None:
            other = self.laid(held)
            if not _limits(other.built)[1]:
                best, unkept = (
                    other,
                    f"the best that was searched for breaks {named}, and the curve's own opening does not",
                )
        cost = None if best is first else laid_db(first.designed) - laid_db(best.designed)
        return replace(best, unkept=unkept, cost_db=cost)

    def under(self, limits: dict[str, float], named: str, first: Designed) -> tuple[Designed, str]:
        """A design that keeps limits of the eye, or the first one, and what became of the search for one that does."""
        if not self.clock.affords(_UNDER_S):
            return first, f"--budget '3 min' looks for one that keeps {named}"
        held = {name: limit / _MAPS for name, limit in limits.items()}
        try:
            found = self._design(rules=self.section.rules.model_copy(update=held), shortlist=1)
        except JobError as refusal:
            return first, f"none was found that keeps {named}: {refusal.what}"
        return found, f"the best without limits breaks {named}"

    def _design(self, begin: Mask | None = None, **asked: Any) -> Designed:
        spec = self.spec.model_copy(update={"design": self.section.model_copy(update=asked)})
        left = self.clock.left()
        early = self.clock if left is None else self.clock.before(min(_AFTER * left, _MOST_AFTER_S))
        where, images = str(self.path), self.images
        return design(
            spec,
            self.command,
            where=where,
            images=images,
            progress=self.progress,
            clock=early,
            begin=begin,
            executor=self.executor,
        )

    def laid(self, designed: Designed) -> _Laid:
        """The job of the two dies, which holds their openings and maps, and the display of the design."""
        old, opening, cells, section = self.before.spec, designed.opening, designed.cells, self.section
        own = [die for die in self.spec.die if die.opening == section.output]
        tiling = section.tiling if designed.account is None else designed.account.tiling
        name = own[0].name if own else opening.name.upper()
        seed = section.drawn_seed
        die = DieSection.model_validate(
            {
                "name": name if name != old.die[0].name else f"{name[:20]}_NEW",
                "label": own[0].label if own else "the design",
                "opening": opening.name,
                "others": None if designed.outer is None else (designed.outer.name,),
                "dot": f"{opening.dot_nm / NM_PER_UM:.15g} um",
                "tiling": tiling if cells is None else Tiling.MAP,
                "map": None if cells is None else cells.name,
                "seed": seed if designed.fit is None or designed.fit.seed is None else designed.fit.seed,
            }
        )
        asked = {
            "clear_dots": opening.clear_dots if designed.shortfall else section.clear_dots,
            "output": f"{opening.name}.toml",
            **({"map": None, "map_output": None} if cells is None else {"map_output": f"{cells.name}.toml"}),
            "tiling": tiling,
            "fit": designed.fit is not None,
        }
        texts = {one.name: opening_text(one) for one in (opening, designed.outer) if one is not None}
        report = (self.spec.report or ReportSection()).model_copy(update={"reference": old.die[0].name})
        parts = {
            "design": section.model_copy(update=asked),
            "die": (*old.die, die),
            "openings": {**old.openings, **texts},
            "maps": {**old.maps, **({} if cells is None else {cells.name: map_text(cells)})},
            "report": report,
        }
        job = resolve(old.model_copy(update=parts), self.path)
        plate = job.plate()
        alone = replace(plate, dies=tuple(each for each in plate.dies if each.name == die.name))
        return _Laid(designed, job, displays(job, alone, self.progress, executor=self.executor))

    def photographed(self, job: Job, name: str, conditions: Conditions) -> Task[Restored]:
        panel = next(die.panel for die in plate_as_seen(job, job.plate()).dies if die.name == name)
        return self.executor.submit(Call(photograph_die, lambda: (conditions, Surroundings.of(job), name, panel, True)))

    def photographed_curve(
        self, curve: ShareCurve, usual: Task[Restored], conditions: Conditions, level: float
    ) -> ShareCurve:
        """The curve by photographs at one level of light, of the best points of every level that there is time for."""
        before, one, left = usual.result(), replace(conditions, levels=(level,)), self.clock.left()
        if before.refused is not None or left == 0:
            return curve
        units = {point.panel_key: point for point in curve.best_first}
        if left is not None:
            each_s = usual.seconds / (len(conditions.levels) * self.executor.processes)
            units = dict(islice(units.items(), max(_LEAST_SHOWN, int(_SHOWN * left / each_s))))
        around, panels = Surroundings.of(self.before), {key: self._panel(point) for key, point in units.items()}
        calls = [
            Call(photograph_die, partial(tuple, (one, around, "share", panel, False))) for panel in panels.values()
        ]
        tasks = self.executor.run_all(calls, lambda done: self.progress("photographs of shares", done, len(calls)))
        seen = dict(zip(panels, (task.result() for task in tasks), strict=True))
        own = {score.scene: score.psnr for score in before.scores if score.level_db == level}

        def photographed(point: SharePoint) -> SharePoint:
            shown = seen.get(point.panel_key)
            if shown is None or not (scores := shown.scores):
                return point if shown is None else replace(point, shape="", unit=None)
            gain = MeanDifference.of([score.psnr - own[score.scene] for score in scores])
            value = float(np.mean([score.psnr for score in scores]))
            return replace(point, value=value, error_db=None if math.isnan(gain.half_width) else gain.half_width)

        return replace(curve, points=tuple(map(photographed, curve.points)), over=float(np.mean(list(own.values()))))

    def _panel(self, point: SharePoint) -> Panel:
        """A panel of a point that covers the stop, without a map."""
        assert point.unit is not None
        section, where = self.section, f"{self.path}: design.pitch"
        dot_nm = dot_of_pitch(section.pitch, section.dots, where=where) * point.across
        across = math.ceil(self.spec.camera.stop.diameter_um * NM_PER_UM / (dot_nm * section.dots)) + 2
        tiling = Tiling.PERIODIC if point.alike else section.tiling
        seed = section.drawn_seed
        cells = orientations(tiling, across, across, seed)
        return Panel(Opening("share", point.unit, dot_nm), dot_nm, 0, cells, tiling, seed)

    def judges(self, spec: JobSpec) -> Judges:
        return _judges(spec, str(self.path), scenes_of(self.images, self.section).photographs)

    def told(self, stage: str, task: Task[Any]) -> Any:
        self.progress(stage, 0, 1)
        found = task.result()
        self.progress(stage, 1, 1)
        return found


def job_files(job: Job) -> dict[str, str]:
    """Texts of a job file and of every file that it names, beside it, by their names; ``run`` takes the first."""
    spec = job.spec

    def beside(die: DieSection) -> str:
        named = {"opening": f"{die.opening}.toml", "map": die.map and f"{die.map}.toml"}
        named["others"] = die.others and tuple(f"{name}.toml" for name in die.others)  # type: ignore[assignment]
        plain = die.model_copy(update=named).model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        return f"\n[[die]]\n{dumps(plain)}"

    plain = spec.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    without = {"die", "openings", "maps", "curves", "shops", *(() if "limits" in plain else ("limits",))}
    # A section that is stated asks for something, though all that it states are defaults.
    stated = [key for key in type(spec).model_fields if key not in without and getattr(spec, key) is not None]
    text = dumps({key: plain.get(key, {}) for key in stated}) + "".join(map(beside, spec.die))
    drawn = {f"{name}.toml": content for name, content in (*spec.openings.items(), *spec.maps.items())}
    return {"job.toml": text, **drawn, **spec.curves, **spec.shops}


def _as_stated(
    spec: JobSpec, chosen: JobSpec, curve: ShareCurve, stated_dots: int
) -> tuple[JobSpec, SearchSection, bool, tuple[str, ...]]:
    """The job with the share that it states, unless that gains less than is worth a mask and another does; whether that
    is the stated one, and what was chosen, in sentences."""
    section, best = chosen.design, curve.best
    assert isinstance(section, SearchSection)
    if best is None:
        return chosen, section, bool(stated_dots), () if stated_dots else (_NONE_FITS,)
    own = [point for point in curve.points if point.clear_dots == stated_dots and point.shape]
    if not stated_dots:
        return chosen, section, False, (curve.told,)
    gain, most = (curve.gain_db(own[0]) if own else math.nan), curve.gain_db(best)
    if own and gain < WORTH_DB <= most:
        return (
            chosen,
            section,
            False,
            (f"The {own[0].share:.0%} that the job states gains {gain:+.1f} dB. {curve.told}",),
        )
    section, notes = section.model_copy(update={"clear_dots": stated_dots}), tuple[str, ...]()
    if spec.chooses_sharing:
        # Of a stated share, the most circuits that fit it; of one that does not fit, as many as the choice has.
        point, why = (own[0], "the most circuits that were found to fit") if own else (best, "as of the best that fits")
        chosen = sharing_by(chosen, point.sharing)
        notes = (f"Beside the share that the job states, {point.zone} was chosen: {why}.",)
    return chosen.model_copy(update={"design": section}), section, True, notes


def _conditions(job: Job) -> tuple[Conditions, float]:
    """Of the job's photographs, where its light is one with ten times less and more beside it as far as can be; and the
    level that stands for all that the job states, dB."""
    asked = Conditions.of(job, "camera")
    level, sensor = middle_level(asked.levels), asked.protocol.sensor
    if len(asked.levels) > 1:
        return asked, level
    stated, levels = asked.protocol.exposure(level).electrons, [level]
    for electrons in (stated / _LIGHTS, stated * _LIGHTS):
        if electrons <= sensor.ceiling and (other := Exposure.of_white(electrons, sensor).level_db) > 0:
            levels.append(other)
    return replace(asked, levels=tuple(sorted(levels))), level


def _at(seen: Restored, levels: Sequence[float]) -> Restored:
    scores = tuple(score for score in seen.scores if score.level_db in levels)
    return replace(seen, scores=scores, shots=tuple(shot for shot in seen.shots if shot.score.level_db in levels))


def _require(taken: Photographs) -> None:
    """Refuse a die that cannot be photographed, for the reason that the photographs have."""
    for name, die in taken.dies.items():
        if die.refused is not None:
            code, _, what = die.refused.partition(" ")
            raise JobError(code, what, where=name, cure="Change the camera or the plate so that it can be photographed")


def _limits(built: PlateWithDisplays) -> tuple[dict[str, float], list[str]]:
    """Limits of the eye that openings can be searched by, and in words those that the design breaks."""
    judged = [display.judged for display in built.displays.values() if display.judged is not None]
    numbers = [number for own in judged for number in own.looks if number.name in _SEARCHED]
    held = {number.name: number.limit for number in numbers if number.limit is not None}
    return held, [number.title for number in numbers if number.passed is False]


def _unobstructed(job: Job, name: str, taken: Photographs, level: float) -> MeanDifference:
    """Gain over the reference of a clear stop of the design's light, where nothing blurs but the lens, by scene."""
    conditions, around, panel = taken.conditions, Surroundings.of(job), job.panels()[name]
    seen, _ = conditions.design(name, panel, around)
    stop = Stop("circle", 2 * float(np.sqrt(seen.transmission * job.camera.stop.area_um2 / np.pi)))
    clear = Opening("clear", np.ones_like(panel.opening.mask), panel.dot_nm)
    sheet = Panel(clear, panel.dot_nm, 0, np.zeros_like(panel.orientations), Tiling.PERIODIC, None)
    small, _ = replace(conditions, camera=replace(job.camera, stop=stop)).design("an unobstructed stop", sheet, around)
    scenes = photographs.drawn_scenes(highlights=bool(conditions.protocol.brackets))
    ideal = cast(Design, _Passing(small, seen.transmission))
    found = evaluate([ideal], scenes, scenes, (level,), protocol=conditions.protocol, details=False, expected=True)
    own = {score.scene: score.psnr for score in taken.dies[str(taken.reference)].scores if score.level_db == level}
    return MeanDifference.of([score.psnr - own[score.scene] for score in found.scores])


class _Passing:
    """A design that passes another share of the stop's light: all of a smaller stop's is that of a panel's."""

    def __init__(self, seen: Design, transmission: float) -> None:
        self.seen, self.transmission = seen, transmission

    def __getattr__(self, name: str) -> Any:
        return getattr(self.seen, name)


def _judges(spec: JobSpec, where: str, scenes: Sequence[Photograph]) -> Judges:
    section = spec.design
    assert isinstance(section, SearchSection)
    dot_nm = dot_of_pitch(section.pitch, section.dots, where=f"{where}: design.pitch")
    room = lattice(section.dots, dot_nm, camera=PhotoCamera.of(spec.camera, where=where))
    return Judges(section, scenes, room, capture_settings(spec))


def reaches(spec: JobSpec, where: str, images: Path | None, budget_s: float | None) -> tuple[Reach, ...]:
    """The largest opening that was found to fit with one rule eased, for each in its share of the time.

    Args:
        spec: of the job, as :func:`searched` gives it.
        images: folder of photographs; synthetic scenes if None.
        budget_s: seconds; None for as many as it takes.
    """
    clock, found, longest = Clock(budget_s), list[Reach](), 0.0
    section = spec.design
    assert isinstance(section, SearchSection)
    scenes = scenes_of(images, section).photographs
    for name, eased, share, times in _eased(spec, section):
        began = clock.spent
        if isinstance(eased, str):
            found.append(Reach(name, why=eased))
        elif not clock.affords(times**2 * longest):
            found.append(Reach(name, why=_LONGER))
        else:
            least = section.clear_dots * times**2
            found.append(_reach(name, eased, where, scenes, clock.part(share), least))
            longest = max(longest, clock.spent - began)
    return (*found, _denser(spec, section, where, images, clock))


def _eased(spec: JobSpec, section: SearchSection) -> Iterator[tuple[str, JobSpec | str, float, int]]:
    """The job, and with one rule eased each, or why it cannot be; share of the time left, and times as many dots."""
    emitters, wires = spec.emitters, spec.wires
    assert emitters is not None
    name, why = "one line less each way", "there is no line to spare"
    fewer = None if wires is None or wires.lines < 2 else wires.model_copy(update={"lines": wires.lines - 1})
    yield name, spec.model_copy(update={"wires": fewer}) if fewer else why, 0.4, 1
    name, why = f"emitters of {_LESS_EMITTER:.0%} of the pixel less", "the job asks for fewer anyway"
    smaller = emitters.model_copy(update={"required": emitters.required - _LESS_EMITTER / 3})
    yield name, spec.model_copy(update={"emitters": smaller}) if smaller.required > 0 else why, 0.5, 1
    dot_nm, dots = dot_of_pitch(section.pitch, section.dots, where="design.pitch"), 2 * section.dots
    name, why = f"dots of {dot_nm / 2 / NM_PER_UM:g} µm", "half a dot is on no grid, or [design.rules] counts dots"
    finer = section.model_copy(update={"dots": dots, "clear_dots": 4 * section.clear_dots})
    able = dots <= _MOST_DOTS and dot_nm % 2 == 0 and section.rules == RulesSection()
    yield name, spec.model_copy(update={"design": finer}) if able else why, 1.0, 2


def _reach(name: str, spec: JobSpec, where: str, scenes: Sequence[Photograph], clock: Clock, least: int) -> Reach:
    section, emitters = spec.design, spec.emitters
    assert isinstance(section, SearchSection)
    assert emitters is not None
    if clock.over:
        return Reach(name, why=_LONGER)
    most = max(int((1 - 3 * emitters.required) * section.dots**2), least + 1)
    plain = {"clear_dots": most, "shortlist": 1, "density": None}
    asked = section.model_copy(update=plain)
    rules = constraints_of(asked, display=stated_display(spec, asked, where, key="design.fit"))
    # Crooked emitters take most of the time; without them all are compared alike.
    start = start_of(rules, asked.families, clock.part(0.7), more_than=least, crooked=False)
    if start is None and clock.over:
        return Reach(name, why=_LONGER)
    if start is None:
        return Reach(name, least or None, asked.dots, why=None if least else "no opening was found that fits")
    held = asked.model_copy(update={"clear_dots": start.rules.clear_dots, "families": start.families})
    judges = _judges(spec.model_copy(update={"design": held}), where, scenes)
    best = scanned(held, start.rules, judges.expected, clock, None, silent, start).best
    psnr = judges.estimate(best.unit, periodic=not start.any_map, levels=judges.settings.levels)
    return Reach(name, int(best.unit.sum()), asked.dots, best.name, psnr, not start.any_map, complete=not clock.over)


def _denser(spec: JobSpec, section: SearchSection, where: str, images: Path | None, clock: Clock) -> Reach:
    """More light in the middle of the stop, with its map; takes minutes."""
    name, left = "more light in the middle of the stop", clock.left()
    if section.map is None or section.density is not None:
        return Reach(name, why="the job has no map, or shares its light unevenly already")
    if left is not None and left < _DENSER_S:
        return Reach(name, why=f"takes {_DENSER_S / 60:g} minutes: give --budget '10 min'")
    asked = {"density": "search", "shortlist": 1, "positions": 1, "joint": 0}
    denser = spec.model_copy(update={"design": section.model_copy(update=asked)})
    try:
        found = design(denser, "", where=where, images=images, clock=clock)
    except JobError as refusal:
        return Reach(name, why=refusal.what)
    assert found.designed is not None
    return Reach(name, found.opening.clear_dots, section.dots, found.shape, found.designed.psnr, mapped=True)


_OFF_AXIS = frozenset({"oblique light", "shift through the gap", "diffraction over the gap"})
"""Rows of a plan that gap and field alone bring about."""
_OFF_AXIS_S = 5.0


def off_axis(job: Job, name: str, gap_um: float, field: float | str | None, clock: Clock = NO_END) -> Caveat:
    """Parts of a lens that are not modelled, and by how much they change the image of a point behind a die at most, as
    ``check --optics`` estimates it.

    Args:
        name: of the die.
        gap_um: from the display to the lens.
        field: largest image height, um, or angle off the axis; None for the axis alone.
        clock: nothing is estimated where it leaves no time.
    """
    asked = SceneSection().model_copy(update={"gap": gap_um, "field": field or 0.0})
    reach = f"{field / UM_PER_MM:g} mm" if isinstance(field, float) else field
    off = f"and a field of {reach} " if field else ""
    what = f"a gap of {gap_um / UM_PER_MM:g} mm {off}{'are' if field else 'is'} not modelled"
    words = f"judged along the axis, with the display at the lens: {what}"
    if not clock.affords(_OFF_AXIS_S):
        return Caveat(f"{words}; with them in [scene] of the job, check --optics tells what that changes")
    panel = next(die.panel for die in plate_as_seen(job, job.plate()).dies if die.name == name)
    try:
        scene = Scene.of(asked, camera=job.camera, where="answers")
        rows = plan(panel, job.camera, scene, asked.accuracy).ingredients
    except JobError as refusal:
        return Caveat(f"{words}, and by how much that tells is not known: {refusal.what}")
    told = [f"{row.error:.2g} ({row.name})" for row in rows if row.name in _OFF_AXIS and row.error]
    change = f"change{'' if field else 's'} the image of a point by at most {', '.join(told) or '0'} in relative L2"
    return Caveat(f"{words}, which {change}")
