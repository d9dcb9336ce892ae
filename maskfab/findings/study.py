"""A study: photographs through the dies of a job under every protocol and in every case, their optics, and claims.

A claim is held against the numbers: it agrees, does not, or cannot be told from so many photographs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.base.errors import JobError
from maskfab.base.findings import Need, origins
from maskfab.base.model import Mtf, Panel, Psf
from maskfab.base.processes import Call, release_memory
from maskfab.base.work import Progress, one_thread, silent
from maskfab.base.workers import EVERY_CORE, Workers
from maskfab.camera import scenes as surroundings
from maskfab.camera.imaging import Design, RestoredBy
from maskfab.camera.protocol import AUTO, Protocol, evaluate
from maskfab.camera.record import Restorer
from maskfab.camera.scenes import Folder, Photograph, drawn
from maskfab.camera.scores import Crop, MeanDifference, Score, truth_of
from maskfab.findings.photographs import Conditions, Surroundings, uses_of
from maskfab.job.camera import Camera
from maskfab.job.faults import JobFaults, parse_section
from maskfab.job.reference import USES, unused
from maskfab.job.sections import CaseSection, ClaimSection, SceneSection, StudySection
from maskfab.mask.job import Job, with_masks
from maskfab.mask.panels import laid_out
from maskfab.optics.lags import lag_table
from maskfab.optics.metrics import auc_radial_min, relative_difference
from maskfab.optics.mtf import longest_lag_um, presampled_mtf
from maskfab.optics.psf import pixel_margin, pixel_psf, point_psf
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.optics.restoration import sensor_square
from maskfab.optics.spectrum import line_spectrum


class Verdict(StrEnum):
    """Outcome of a claim."""

    AGREES = "agrees"
    DISAGREES = "does not agree"
    OPEN = "cannot be told"


def verdict(difference: MeanDifference, at_least: float | None, at_most: float | None) -> Verdict:
    """Whether an interval lies within limits, outside them, or across one; across one too where it is not known."""
    if math.isnan(difference.half_width):
        return Verdict.OPEN
    least, most = -math.inf if at_least is None else at_least, math.inf if at_most is None else at_most
    low, high = difference.mean - difference.half_width, difference.mean + difference.half_width
    if least <= low and high <= most:
        return Verdict.AGREES
    return Verdict.DISAGREES if high < least or most < low else Verdict.OPEN


def worst(verdicts: Sequence[Verdict]) -> Verdict:
    """Worst of several that must all agree."""
    order = (Verdict.DISAGREES, Verdict.OPEN, Verdict.AGREES)
    return min(verdicts, key=order.index)


@dataclass(frozen=True)
class Take:
    """Everything that a score is of, but for the scene.

    Attributes:
        level_db: of light; NaN where it is a mean over levels, and of a number of the optics.
    """

    protocol: str
    case: str
    die: str
    level_db: float
    restorer: str


@dataclass(frozen=True)
class Finding:
    """A number that a claim is about.

    Attributes:
        of: the photographs, or the die alone for a number of the optics.
        over: those that they are compared with; None for a number that stands alone.
        difference: the mean difference, or mean, with its 95 % interval; of the optics, with its error, and no
            photographs.
    """

    of: Take
    over: Take | None
    wavelength_nm: float | None
    difference: MeanDifference
    verdict: Verdict


@dataclass(frozen=True)
class Claim:
    """A claim and its numbers."""

    stated: ClaimSection
    findings: tuple[Finding, ...]

    @property
    def verdicts(self) -> Mapping[str, Verdict]:
        """Verdicts by protocol; those of the optics under an empty name."""
        names = dict.fromkeys(finding.of.protocol for finding in self.findings)
        return {
            name: worst([finding.verdict for finding in self.findings if finding.of.protocol == name]) for name in names
        }


def _of_scores(claim: ClaimSection) -> bool:
    """Whether a claim is about photographs rather than about the optics."""
    return any(Need.PHOTOGRAPHS in finding.needs for finding in origins(claim.measure))


def pairs(claim: ClaimSection) -> Iterator[tuple[str, str | None]]:
    """Every die of a claim with the one that it is compared with."""
    over: Sequence[str | None] = claim.over or (None,)
    yield from zip(claim.die, over if len(over) == len(claim.die) else [over[0]] * len(claim.die), strict=True)


def of_photographs(claim: ClaimSection, scores: Mapping[Take, Sequence[Score]]) -> Claim:
    """A claim about scores, for everything that it does not name."""
    findings = []
    kinds = [
        dict.fromkeys(getattr(take, key) for take in scores) for key in ("protocol", "case", "level_db", "restorer")
    ]
    asked = (
        claim.protocols or kinds[0],
        kinds[1] if claim.case is None else (claim.case,),
        claim.levels or kinds[2],
        kinds[3] if claim.restorer is None else (claim.restorer,),
    )
    levels = [tuple(asked[2])] if claim.averaged else [(level,) for level in asked[2]]
    for (die, over), protocol, case, of_levels, restorer in product(pairs(claim), asked[0], asked[1], levels, asked[3]):
        takes = [Take(protocol, case, die, level, restorer) for level in of_levels]
        if any(take not in scores for take in takes):
            continue
        other = {"case": claim.over_case or case, "die": over or die, "restorer": claim.over_restorer or restorer}
        others = [replace(take, **other) for take in takes]
        mine = _of_levels(scores, takes, claim.measure)
        if others != takes:
            mine = mine - _of_levels(scores, others, claim.measure)
        difference = MeanDifference.of(mine.tolist())
        judged = verdict(difference, claim.at_least, claim.at_most)
        told = [each if len(takes) == 1 else replace(each, level_db=math.nan) for each in (takes[0], others[0])]
        findings.append(Finding(told[0], None if others == takes else told[1], None, difference, judged))
    return Claim(claim, tuple(findings))


def _of_levels(scores: Mapping[Take, Sequence[Score]], takes: Sequence[Take], measure: str) -> NDArray[np.float64]:
    return np.asarray(np.mean([[getattr(score, measure) for score in scores[take]] for take in takes], axis=0))


def of_optics(claim: ClaimSection, numbers: Mapping[tuple[str, float | None], tuple[float, float]]) -> Claim:
    """A claim about numbers of the optics, which needs no photographs, but for the difference of PSFs."""
    findings = []
    for die, over in pairs(claim):
        for (name, wavelength), (value, error) in numbers.items():
            if name != die:
                continue
            base, more = (0.0, 0.0) if over is None else numbers[over, wavelength]
            findings.append(
                finding_of_optics(claim, die, over, wavelength, MeanDifference(value - base, error + more, 0))
            )
    return Claim(claim, tuple(findings))


def finding_of_optics(
    claim: ClaimSection, die: str, over: str | None, wavelength_nm: float | None, value: MeanDifference
) -> Finding:
    """One number of the optics, judged."""
    mine, other = (None if name is None else Take("", "", name, math.nan, "") for name in (die, over))
    assert mine is not None
    return Finding(mine, other, wavelength_nm, value, verdict(value, claim.at_least, claim.at_most))


Learned: TypeAlias = Mapping[str, tuple[Restorer, ...]]

CROP = Crop(128, 160)
"""Part of the first scene that is shown of every die."""
OWN_SCENE = "the job's scene"
"""Name of the only case of a study without cases."""


@dataclass(frozen=True, eq=False)
class Optics:
    """The optics of one die, as designed.

    Attributes:
        psf: of pixels, at the middle wavelength.
        autocorrelation: float64 [n, n], the presampled modulation over the sensor's square of frequencies, at the
            longest wavelength, frequency 0 in the middle.
        mtfs: of every wavelength, the longest first.
        open_ratio: of a cell.
    """

    psf: Psf
    autocorrelation: NDArray[np.float64]
    mtfs: tuple[Mtf, ...]
    open_ratio: float


@dataclass(frozen=True, eq=False)
class Setting:
    """Conditions of some photographs of a study: one protocol in one case.

    Attributes:
        restorers: for every die.
        choose: whether one of them is chosen for each photograph too.
        colours: whether S-CIELAB is scored.
        reference: whose blur restorers are given; None for its own.
    """

    case: str
    job: Job
    conditions: Conditions
    restorers: tuple[Restorer, ...]
    choose: bool
    colours: bool
    reference: Setting | None = None
    learned: Learned = field(default_factory=dict)

    @property
    def protocol(self) -> Protocol:
        return self.conditions.protocol

    def design(self, name: str, panel: Panel) -> tuple[Design, tuple[str, ...]]:
        """As :meth:`maskfab.findings.photographs.Conditions.design`, restored by the reference's blur, if given."""
        design, notes = self.conditions.design(name, panel, Surroundings.of(self.job))
        if self.reference is None:
            return design, notes
        other, _ = self.reference.design(name, panel)
        return RestoredBy(design, other), (*notes, f"restored by the blur of the case {self.reference.case!r}")


@dataclass(frozen=True, eq=False)
class Plan:
    """A study that was checked and can be made.

    Attributes:
        photographs: of a folder; drawn scenes are beside them.
        skipped: files of the folder that are no photographs, or do not serve.
        idle_masks: names of given ones that no opening has.
    """

    job: Job
    panels: Mapping[str, Panel]
    settings: tuple[Setting, ...]
    photographs: tuple[Photograph, ...]
    skipped: tuple[str, ...]
    masks: Mapping[str, Path] = field(default_factory=dict)
    idle_masks: tuple[str, ...] = ()

    @property
    def masks_told(self) -> tuple[str, ...]:
        """Sentences on given masks; none where none are given."""
        stands = ", ".join(f"{name} is {path.name}" for name, path in self.masks.items())
        told = [f"In place of openings: {stands}."] if stands else []
        if self.idle_masks:
            told.append(f"Masks that no opening is named after: {', '.join(self.idle_masks)}.")
        return tuple(told)

    @property
    def unused(self) -> tuple[str, ...]:
        """Names of all that the job states and no part of the study depends on."""
        spec, uses = self.job.spec, [*USES["study"]]
        uses += USES["study of optics"] if self.study.optics else ()
        for setting in self.settings:
            uses += uses_of(setting.job, setting.protocol.name)
        return unused(spec, *uses)

    @property
    def study(self) -> StudySection:
        """As the job states it."""
        stated = self.job.spec.study
        assert stated is not None
        return stated


@dataclass(frozen=True, eq=False)
class Study:
    """A study, made.

    Attributes:
        scores: of every scene in order, by what they are of.
        left_out: sentences on what the photographs of each protocol, case and die leave out.
        truth: part of the first scene, code values; None without photographs.
        shown: the same part of restored photographs.
    """

    plan: Plan
    optics: Mapping[str, Optics]
    scenes: tuple[str, ...]
    scores: Mapping[Take, tuple[Score, ...]]
    left_out: Mapping[tuple[str, str, str], tuple[str, ...]]
    truth: Singles | None
    shown: Mapping[Take, Singles]

    @cached_property
    def claims(self) -> tuple[Claim, ...]:
        """Claims of the study with their numbers and verdicts."""
        return tuple(self._judged(claim) for claim in self.plan.study.claim)

    def _judged(self, claim: ClaimSection) -> Claim:
        if _of_scores(claim):
            return of_photographs(claim, self.scores)
        if claim.measure == "psf_difference":
            return Claim(claim, tuple(self._difference(claim, die, over) for die, over in pairs(claim) if over))
        return of_optics(claim, self._numbers(claim.measure))

    def _difference(self, claim: ClaimSection, die: str, over: str) -> Any:
        one, other = self.optics[die].psf, self.optics[over].psf
        difference = MeanDifference(relative_difference(one, other), 0.0, 0)
        return finding_of_optics(claim, die, over, one.wavelength_nm, difference)

    def _numbers(self, measure: str) -> dict[tuple[str, float | None], tuple[float, float]]:
        if measure == "open_ratio":
            return {(die, None): (optics.open_ratio, 0.0) for die, optics in self.optics.items()}
        areas = [(die, auc_radial_min(mtf, die)) for die, optics in self.optics.items() for mtf in optics.mtfs]
        return {
            (die, area.wavelength_nm): (float(area.value or 0.0), float(area.uncertainty or 0.0)) for die, area in areas
        }


def planned(
    job: Job,
    given: Folder | None = None,
    learned: Callable[[Setting], Learned] | None = None,
    masks: Mapping[str, Path] | None = None,
) -> Plan:
    """Check all of a study before any work: its dies, cases, protocols, claims and photographs.

    Args:
        given: photographs, beside the drawn scenes.
        masks: files in place of the job's openings, as :func:`maskfab.mask.job.masks_in` gives them.

    Raises:
        JobError: MF146 without [study], or for one that shows nothing or has no scenes; MF145 for a claim about what
            the study does not have; else as for a job, for :func:`maskfab.mask.job.with_masks` and for
            :meth:`maskfab.findings.photographs.Conditions.of`.
    """
    job, stand_in = with_masks(job, masks or {})
    study, where = job.spec.study, job.where
    if study is None:
        faults = JobFaults.of_spec(job.spec)
        faults.add(
            JobError("MF146", "the job has no [study]", where=where, cure="Add [study], or use maskfab simulate")
        )
        with faults:
            laid_out(job.spec, where=where)
        faults.refuse()
    assert study is not None
    if not (study.optics or study.protocols):
        what = "the study shows neither optics nor photographs"
        raise JobError("MF146", what, where=f"{where}: study", cure='Add optics = true, or protocols = ["camera"]')
    if study.optics:
        job.check_window()
    cases = study.case or (CaseSection(name=OWN_SCENE),)
    jobs = {case.name: _in_case(job, case, i) for i, case in enumerate(cases)}
    if len(jobs) < len(cases):
        raise JobError("MF109", "two cases have one name", where=f"{where}: study.case", cure="Rename one of them")
    colours = any(claim.measure == "delta_e" for claim in study.claim)
    settings = []
    for protocol in dict.fromkeys(study.protocols):
        own: dict[str, Setting] = {}
        for case, within in zip(cases, jobs.values(), strict=True):
            conditions = Conditions.of(within, protocol, study.levels, brackets=case.brackets)
            named = None if conditions.protocol.restorers else study.restore
            own[case.name] = Setting(case.name, within, conditions, *conditions.restorers(named), colours)
        for i, case in enumerate(cases):
            other = case.restored_by
            if other is not None and other not in own:
                problem = f"the case {case.name!r} is restored by {other!r}, which is no case"
                raise JobError("MF145", problem, where=f"{where}: study.case[{i}]", cure=f"Use one of {', '.join(own)}")
            mine = own[case.name]
            settings.append(mine if other in (None, case.name) else replace(mine, reference=own[other]))
    if study.case and any(setting.protocol.name != "camera" for setting in settings):
        what = "the study has cases of the scene, which protocols f1 and paper do not know"
        raise JobError("MF146", what, where=f"{where}: study.protocols", cure='Use protocols = ["camera"]')
    if learned is not None:
        settings = [replace(setting, learned=learned(setting)) for setting in settings]
    photographs, skipped = _serving(given if study.protocols else None, settings)
    if settings and not (photographs or study.scenes):
        what = "the study has no scenes: no photographs that serve it, and study.scenes = 0"
        raise JobError("MF146", what, where=f"{where}: study.scenes", cure="Add --images FOLDER, or draw some scenes")
    idle = tuple(path.name for path in (masks or {}).values() if path not in stand_in.values())
    plan = Plan(job, job.panels(), tuple(settings), photographs, skipped, stand_in, idle)
    for i, claim in enumerate(study.claim):
        _check_claim(claim, plan, f"{where}: study.claim[{i}]")
    return plan


def _serving(given: Folder | None, settings: Sequence[Setting]) -> tuple[tuple[Photograph, ...], tuple[str, ...]]:
    """Photographs of a folder that a study can take, and names of the others; brackets are for highlights."""
    if given is None:
        return (), ()
    serving, skipped = [], list(given.skipped)
    for photograph in given.photographs:
        try:
            for setting in settings:
                setting.protocol.check(photograph)
        except JobError:
            skipped.append(f"{photograph.name} without highlights")
        else:
            serving.append(photograph)
    return tuple(serving), tuple(skipped)


def _in_case(job: Job, case: CaseSection, i: int) -> Job:
    if not case.scene:
        return job
    section = job.spec.scene
    stated = {} if section is None else section.model_dump(mode="json", exclude_defaults=True)
    scene = parse_section(SceneSection, {**stated, **case.scene}, where=f"{job.where}: study.case[{i}].scene")
    changed = replace(job, spec=job.spec.model_copy(update={"scene": scene}))
    _ = changed.scene
    return changed


def _check_claim(claim: ClaimSection, plan: Plan, where: str) -> None:
    study = plan.study
    optical = not _of_scores(claim)
    if not (study.optics if optical else study.protocols):
        raise JobError(
            "MF145",
            f"the claim is about {claim.measure}, and the study has no {'optics' if optical else 'photographs'}",
            where=where,
            cure="Add optics = true to [study]" if optical else 'Add protocols = ["camera"] to [study]',
        )
    restorers = {restorer.name for setting in plan.settings for restorer in setting.restorers}
    restorers |= {
        restorer.name for setting in plan.settings for every in setting.learned.values() for restorer in every
    }
    restorers |= {AUTO} if any(setting.choose for setting in plan.settings) else set()
    levels = {level for setting in plan.settings for level in setting.conditions.levels}
    cases = {setting.case for setting in plan.settings}
    for what, named, names in (
        ("die", (*claim.die, *(claim.over or ())), plan.panels),
        ("level", claim.levels or (), levels),
        ("protocol", claim.protocols or (), study.protocols),
        ("case", [case for case in (claim.case, claim.over_case) if case], cases),
        ("restorer", [restorer for restorer in (claim.restorer, claim.over_restorer) if restorer], restorers),
    ):
        for place in named:
            if place not in names:
                listed = ", ".join(f"{one:g}" if isinstance(one, float) else str(one) for one in names) or "none"
                words = f"{place:g} dB" if isinstance(place, float) else repr(place)
                problem = f"the claim names the {what} {words}, which the study does not have"
                raise JobError("MF145", problem, where=where, cure=f"Use one of {listed}")
    if len(claim.over or ()) not in (0, 1, len(claim.die)):
        problem = f"the claim compares {len(claim.die)} dies with {len(claim.over or ())}"
        raise JobError("MF145", problem, where=where, cure="Name one die under over, or one for each")
    if claim.at_least is None and claim.at_most is None:
        problem = "the claim has no limit, so nothing could disagree with it"
        raise JobError("MF145", problem, where=where, cure="Add at_least or at_most")
    if claim.averaged and (optical or len(claim.levels or levels) < 2):
        problem = "the claim is about a mean over levels of light, and there are no two"
        raise JobError("MF145", problem, where=where, cure="Leave averaged out, or name several levels")
    if claim.measure == "psf_difference" and claim.over is None:
        raise JobError("MF145", "a difference of PSFs is one of two dies", where=where, cure="Add over")


@one_thread
def made(plan: Plan, progress: Progress = silent, workers: Workers = EVERY_CORE) -> Study:
    """Make a study."""
    optics = {}
    for done, (name, panel) in enumerate(plan.panels.items() if plan.study.optics else ()):
        progress("optics", done, len(plan.panels))
        optics[name] = optics_of(panel, plan.job.camera)
    if optics:
        progress("optics", len(optics), len(optics))
    if not plan.settings:
        return Study(plan, optics, (), {}, {}, None, {})
    lamps = any(setting.protocol.brackets for setting in plan.settings)
    scenes = (*plan.photographs, *drawn(plan.study.scenes, highlights=lamps))
    # What cannot be photographed is refused before the first photograph.
    designs = [(setting, name) for setting in plan.settings for name in plan.panels]
    left_out = {
        (setting.protocol.name, setting.case, name): _told(*setting.design(name, plan.panels[name]), plan.photographs)
        for setting, name in designs
    }
    release_memory()
    calls = [
        Call(_photographed, partial(tuple, (setting, name, plan.panels[name], scenes))) for setting, name in designs
    ]
    progress("photographs", 0, len(calls))
    with workers.executor(len(calls)) as executor:
        tasks = executor.run_all(calls, lambda done: progress("photographs", done, len(calls)))
    scores: dict[Take, tuple[Score, ...]] = {}
    shown: dict[Take, Singles] = {}
    for (setting, name), task in zip(designs, tasks, strict=True):
        dies_scores, pictures, more = task.result()
        scores |= dies_scores
        shown |= pictures
        left_out[setting.protocol.name, setting.case, name] += more
    truth = truth_of(scenes[0], CROP)
    return Study(plan, optics, tuple(scene.name for scene in scenes), scores, left_out, truth, shown)


def _told(design: Design, left_out: tuple[str, ...], photographs: Sequence[Photograph]) -> tuple[str, ...]:
    return (*left_out, *surroundings.messages(design, photographs))


def _photographed(
    setting: Setting, name: str, panel: Panel, scenes: Sequence[Photograph]
) -> tuple[dict[Take, tuple[Score, ...]], dict[Take, Singles], tuple[str, ...]]:
    """Scores of every scene through one die, part of the first, and sentences on how the blur errs over the field."""
    design, _ = setting.design(name, panel)
    shown: dict[Take, Singles] = {}
    taken: dict[Take, list[Score]] = {}

    def take(score: Score, picture: Singles) -> None:
        of = Take(setting.protocol.name, setting.case, name, score.level_db, score.restorer)
        taken.setdefault(of, []).append(score)
        if score.scene == scenes[0].name:
            shown[of] = CROP.of(picture)

    evaluate(
        [design],
        scenes,
        scenes,
        setting.conditions.levels,
        protocol=setting.protocol,
        restorers=(*setting.restorers, *setting.learned.get(name, ())),
        choose=setting.choose,
        colours=setting.colours,
        expected=True,
        show=take,
    )
    return {of: tuple(parts) for of, parts in taken.items()}, shown, design.told


def optics_of(panel: Panel, camera: Camera) -> Optics:
    """PSF, autocorrelation and MTFs of a panel as designed."""
    pupil = cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)
    table = lag_table(pupil, longest_lag_um(camera))
    lines = sorted(camera.wavelengths_nm, reverse=True)
    psf = pixel_psf(point_psf(pupil, camera, camera.middle_nm, pixel_margin(camera)), camera)
    upper = sensor_square(table, camera, line_spectrum([lines[0]])).modulation
    whole = np.concatenate([upper[::-1, ::-1], upper])
    mtfs = tuple(presampled_mtf(table, camera, line) for line in lines)
    return Optics(psf, whole, mtfs, panel.open_ratio)
