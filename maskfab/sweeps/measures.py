"""The numbers that a sweep can ask of a case, each with the least work that gives it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import MappingProxyType

from maskfab.camera import scenes as scene_sets
from maskfab.camera.photo_camera import PhotoCamera
from maskfab.camera.transfer import lattice
from maskfab.display.emitters.placement import Verdict
from maskfab.display.feasibility import feasibility
from maskfab.errors import JobError
from maskfab.job import Job
from maskfab.measurement.as_written import measure_written, written_psf_quantities
from maskfab.measurement.conditions import Conditions, Surroundings
from maskfab.measurement.display_rows import display_quantities
from maskfab.measurement.features import judged, smallest_features, written_features
from maskfab.measurement.restored import Photographs, photograph_die
from maskfab.measurement.scene_rows import measure_scene, scene_plan, scene_reach_um
from maskfab.model import ORIENTATIONS, Camera, Die, Opening, Panel, Process, Quantity, Tiling
from maskfab.optics.image.lag_table import LagTable, lag_table
from maskfab.optics.image.mtf import longest_lag_um, presampled_mtf
from maskfab.optics.numbers import metrics
from maskfab.optics.pupil.aperture import panel_aperture
from maskfab.optics.pupil.pupil import cut
from maskfab.optimiser.model.expected_psnr import Surrogate, surrogate_of
from maskfab.optimiser.model.scene_statistics import scene_statistics
from maskfab.optimiser.model.taking import Taking
from maskfab.optimiser.rules.footprints import Footprints
from maskfab.sweeps.wanted import WORKS, by_psf

_SURROGATES = 8


@dataclass(frozen=True, eq=False)
class Subject:
    """One die of one case.

    Attributes:
        job: of the case.
        name: of the die.
        panel: of the die, without wires.
        works: all that is wanted of it; one may find what another is about on its way.
    """

    job: Job
    name: str
    panel: Panel
    works: frozenset[str]

    @cached_property
    def die(self) -> Die:
        """The die by itself."""
        return Die(self.name, self.name, self.panel, (0, 0), max(self.panel.size_nm))

    @property
    def camera(self) -> Camera:
        return self.job.camera

    @property
    def process(self) -> Process:
        """Of the writer; one that changes nothing where the job states none."""
        return self.job.spec.written or Process(0.0, 0.0)

    @cached_property
    def as_written(self) -> tuple[Quantity, ...]:
        """Numbers of the die as the process makes it."""
        given = self.die, self.camera, self.process, f"{self.job.where}: process"
        return measure_written(*given).quantities if "mtf as written" in self.works else written_psf_quantities(*given)

    @cached_property
    def table(self) -> LagTable:
        """Lags of the panel as designed."""
        stop = self.camera.stop
        return lag_table(cut(panel_aperture(self.panel, stop.diameter_um / 2), stop), longest_lag_um(self.camera))


Measure = Callable[[Subject], Iterable[Quantity]]


def measured(job: Job, wanted: Sequence[str]) -> list[Quantity]:
    """The quantities wanted of every die of a job, judged by its [limits].

    Raises:
        JobError: for what cannot be measured.
    """
    if by_psf(wanted):
        job.check_window()
    works = frozenset(WORKS[name] for name in wanted)
    functions = list(dict.fromkeys(MEASURES[name] for name in wanted))
    return [
        judged(quantity, job.spec.limits)
        for name, panel in job.panels().items()
        for subject in (Subject(job, name, panel, works),)
        for function in functions
        for quantity in function(subject)
        if quantity.name in wanted
    ]


def _open_ratio(subject: Subject) -> Iterable[Quantity]:
    how = "clear share of one cell of the design, exact"
    return [Quantity("open_ratio", subject.panel.open_ratio, how, die=subject.name)]


def _mtfs(subject: Subject) -> Iterable[Quantity]:
    for line in subject.camera.wavelengths_nm:
        mtf = presampled_mtf(subject.table, subject.camera, line)
        yield from metrics.mtf_quantities(mtf, subject.camera.pixel_um, subject.name)


def _restoration(subject: Subject) -> Iterable[Quantity]:
    for line in subject.camera.wavelengths_nm:
        yield from metrics.restoration_quantities(subject.table, subject.camera, line, subject.name)


def _features(subject: Subject) -> Iterable[Quantity]:
    return written_features(smallest_features(subject.die), subject.process)


def _written_psf(subject: Subject) -> Iterable[Quantity]:
    return [each for each in subject.as_written if WORKS[each.name] == "psf as written"]


def _written_mtf(subject: Subject) -> Iterable[Quantity]:
    return [each for each in subject.as_written if WORKS[each.name] == "mtf as written"]


def _scatter(subject: Subject) -> Iterable[Quantity]:
    if subject.process.roughness is None:
        where, cure = subject.job.where, "Add it, or vary process.roughness.sigma and process.roughness.correlation"
        raise JobError("MF105", "rough edges scatter, and the job has no [process.roughness]", where=where, cure=cure)
    return [each for each in subject.as_written if WORKS[each.name] == "scatter"]


def _photographs(subject: Subject) -> Iterable[Quantity]:
    conditions, around = Conditions.of(subject.job, "camera"), Surroundings.of(subject.job)
    found = photograph_die(conditions, around, subject.name, subject.panel, False)
    if found.refused is not None:
        code, _, what = found.refused.partition(" ")
        raise JobError(code, what, where=f"die {subject.name}", cure="See maskfab explain")
    return Photographs(conditions, {subject.name: found}).quantities(subject.name)


def _expected(subject: Subject) -> Iterable[Quantity]:
    from maskfab.optimiser.design import taking_of  # which loads torch

    opening = _only_opening(subject)
    taking = taking_of(subject.job.spec)
    known = _surrogate(subject.camera, opening.dots, subject.panel.dot_nm, taking)
    found = known(opening.mask, periodic=subject.panel.tiling is Tiling.PERIODIC, levels=taking.levels)
    how = "surrogate: photographs of the bundled scenes through any random tiling of the opening, no gutters"
    for level, psnr in zip(taking.levels, found, strict=True):
        yield Quantity("expected_psnr", psnr, how, die=subject.name, level_db=level)


def _footprint(subject: Subject) -> Iterable[Quantity]:
    rules, opening = subject.job.display_rules, _only_opening(subject)
    if rules is None:
        where = subject.job.where
        raise JobError("MF105", "a footprint is of emitters, and the job has no [emitters]", where=where, cure="Add it")
    turned = (0,) if subject.panel.tiling is Tiling.PERIODIC else tuple(range(ORIENTATIONS))
    places = Footprints(rules.emitters, opening.dots, subject.panel.dot_nm, turned)
    found, bound = places(opening.mask), float(places.bounds(opening.mask[None])[0])
    name = subject.name
    yield Quantity(
        "led_footprint_largest", found, "of rectangles and straight cuts; crooked emitters may exceed it", die=name
    )
    how = "free squares of the least width, swept by the gap; the gap across borders is free in it"
    yield Quantity("led_footprint_bound", max(bound, found), how, die=name, at_most=True)


def _display(subject: Subject) -> Iterable[Quantity]:
    job, name = subject.job, subject.name
    if job.display_rules is None:
        cure = "Add it"
        raise JobError("MF105", "a display has emitters, and the job has no [emitters]", where=job.where, cure=cure)
    found = feasibility(subject.panel, job.display_rules)
    if found is None:
        cure = "Leave the die out of sweep.dies"
        raise JobError("MF161", f"die {name} is a sheet without pixels", where=job.where, cure=cure)
    how = "emitters, circuits and wires by the job's rules: 1 they were placed, 0 a proof that they do not fit"
    value = {Verdict.FITS: 1, Verdict.DOES_NOT_FIT: 0, Verdict.UNKNOWN: None}[found.verdict]
    yield Quantity("display_fits", value, how, passed=found.passed, die=name)
    rows = display_quantities(subject.die, found)
    yield from (each for each in rows if each.name in ("led_footprint", "circuit_room"))


def _scene(subject: Subject) -> Iterable[Quantity]:
    job, section, scene = subject.job, subject.job.spec.scene, subject.job.scene
    if section is None or scene is None:
        raise JobError("MF105", "the job has no [scene]", where=job.where, cure="Add one, or vary a key of it")
    plan = scene_plan(subject.die, job.camera, scene, section.accuracy, job.where)
    openings = panel_aperture(subject.panel, scene_reach_um(job.camera, scene))
    return measure_scene(subject.die, job.camera, scene, openings, plan, job.blank).quantities


def _only_opening(subject: Subject) -> Opening:
    """The opening of all cells.

    Raises:
        JobError: MF161 for cells of several.
    """
    if subject.panel.others:
        what = f"die {subject.name} has several openings, of which no surrogate knows"
        raise JobError("MF161", what, where=subject.job.where, cure="Ask for restored_psnr instead of expected_psnr")
    return subject.panel.opening


@lru_cache(maxsize=_SURROGATES)
def _surrogate(camera: Camera, dots: int, dot_nm: int, taking: Taking) -> Surrogate:
    """Of cells of such dots, for all cases of a process."""
    room = lattice(dots, dot_nm, camera=PhotoCamera.of(camera), where="die.dot")
    return surrogate_of(scene_statistics(scene_sets.bundled(), taking=taking), room)


_BY_WORK: Mapping[str, Measure] = MappingProxyType(
    {
        "open ratio": _open_ratio,
        "mtf": _mtfs,
        "restoration": _restoration,
        "features": _features,
        "psf as written": _written_psf,
        "mtf as written": _written_mtf,
        "scatter": _scatter,
        "surrogate": _expected,
        "footprint": _footprint,
        "display": _display,
        "scene": _scene,
        "photographs": _photographs,
    }
)
MEASURES: Mapping[str, Measure] = MappingProxyType({name: _BY_WORK[work] for name, work in WORKS.items()})
"""Function that finds a quantity, by the quantity's name, the cheapest first."""
