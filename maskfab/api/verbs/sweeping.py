"""Pareto fronts of designs for a display."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.base import provenance
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target
from maskfab.base.units import parse_time_s
from maskfab.base.work import Progress, one_thread, silent
from maskfab.camera.lens import PhotoCamera, lattice
from maskfab.designs.design import capture_settings, notes_of, require_weights, scenes_line, scenes_of, stated_display
from maskfab.designs.front import (
    FrontDesign,
    FrontPoint,
    JudgedOpening,
    Pareto,
    designs,
    lines_of,
    require_uneven,
    rules_of,
    sweep,
)
from maskfab.job.read import read
from maskfab.job.reference import USES
from maskfab.job.sections import SearchSection
from maskfab.mask.opening_file import load_opening, opening_text
from maskfab.report.pages import pareto as pareto_files

if TYPE_CHECKING:
    from maskfab.report.figures.sheet import Drawing


@dataclass(frozen=True, eq=False, repr=False)
class ParetoFront:
    """A Pareto front of designs for a display.

    Attributes:
        found: curves, the best of all, and what they are compared with.
        designs: those of the curves with their names, openings, maps and jobs.
        digest: of the job.
        scenes: that openings were judged by, in words.
        notes: what a user should know, as sentences.
    """

    found: Pareto
    designs: tuple[FrontDesign, ...]
    digest: str
    scenes: str
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Everything that was found."""
        return pareto_files.pareto_document(self.found, self.designs, self.digest, self.notes, self.scenes)

    def save(self, out: str | Path, *, force: bool = False) -> list[Path]:
        """Write numbers, openings and figure into a directory.

        Raises:
            OutputError: MF401 or MF402 for a place that cannot be written.
        """
        return pareto_files.write_pareto(check_target(Path(out), force=force), self.found, self.to_dict(), self.designs)

    def plot(self) -> Drawing:
        """The curves, and what they are compared with."""
        from maskfab.report.pages.pareto import pareto_drawing

        return pareto_drawing(self.found)

    def __str__(self) -> str:
        return "\n".join([*_lines(self.found, self.designs), *(f"note: {note}" for note in self.notes)])

    def _repr_svg_(self) -> str:
        return self.plot().svg()


@checked_arguments
@one_thread
def pareto(
    job: str | Path,
    *,
    images: str | Path | None = None,
    budget: str | None = None,
    command: str | None = None,
    progress: Progress = silent,
) -> ParetoFront:
    """Find the designs for a display that none betters in photographs, emitters, wires and grain.

    Args:
        job: a job file with [pareto], [emitters], and a [design] that searches.
        images: folder of photographs to score with; synthetic scenes if None.
        budget: ``"60 s"``: take the best that was found by then.
        command: what reproduces it, for the openings' provenance; by default this call.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a job without the sections; MF109 for two openings of one name; else as for a design.
    """
    path = Path(job)
    spec = read(path)
    if spec.pareto is None:
        raise JobError(
            "MF105",
            "the job has no [pareto] section",
            where=str(path),
            cure="Add a [pareto] section with clear_dots = [88, 100]",
        )
    section = spec.design
    if not isinstance(section, SearchSection):
        raise JobError(
            "MF105",
            "a sweep is among compact shapes, and the job has no [design] that searches them",
            where=f"{path}: design",
            cure='Add [design] with method = "search"',
        )
    camera = PhotoCamera.of(spec.camera.camera(), where=str(path))
    settings = capture_settings(spec)
    require_weights(section, settings, str(path))
    limit_s = None if budget is None else parse_time_s(budget, where="budget")
    compared = [load_opening(path.parent / each) for each in spec.pareto.compare]
    texts = {opening.name: opening_text(opening) for opening in compared}
    if len(texts) < len(compared):
        raise JobError(
            "MF109",
            "two openings have one name",
            where=f"{path}: pareto.compare",
            cure="Give one of the openings another name in its file",
        )
    display = stated_display(spec, section, str(path), key="pareto")
    lines_of(spec.pareto, display, where=f"{path}: pareto.lines")
    require_uneven(spec.pareto, section, display, where=f"{path}: pareto")
    rules = rules_of(section, display, compared)
    lattice(section.dots, rules.dot_nm, camera=camera, where=f"{path}: design.dots")
    scenes = scenes_of(None if images is None else Path(images), section)
    found = sweep(
        spec.pareto,
        section,
        scenes.photographs,
        display,
        compared=compared,
        camera=camera,
        settings=settings,
        budget_s=limit_s,
        progress=progress,
    )
    made = designs(found, spec, command or f"maskfab.pareto({path.as_posix()!r})", camera, settings)
    digest = provenance.job_hash(spec.model_copy(update={"openings": {**spec.openings, **texts}}).dump())
    told = scenes_line(scenes, None if images is None else Path(images))
    return ParetoFront(found, made, digest, told, notes_of(spec, scenes, USES["pareto"], settings))


def _lines(found: Pareto, designs: Sequence[FrontDesign]) -> list[str]:
    best = set(map(id, found.best))
    names = {id(each.point): each.name for each in designs}
    lines = []
    for curve in found.curves:
        if curve.refusal is not None:
            lines.append(f"{curve.clear_dots} clear dots: {curve.refusal}")
            continue
        cut = "; the budget ended it" if not curve.complete else ""
        between = f", {curve.left_out} designs between these left out" if curve.left_out else ""
        lines.append(
            f"{curve.clear_dots} clear dots ({curve.front[0].judged.open_ratio:.1%} open): {curve.evaluated} openings "
            f"evaluated, emitters and wires of {curve.measured} measured{between}{cut}"
        )
        lines += [
            f"  {'*' if id(each) in best else ' '} {_told(each.value, each)}, grain {each.grain:.5f}  "
            f"{names[id(each)]}: {each.shape}"
            for each in curve.points
        ]
        lines += [f"    does not fit on a die: {each}" for each in curve.misfits]
    for given in found.compared:
        gain = found.gain_db(given)
        more = (
            "nothing found has so much of both at no more clear dots"
            if gain is None
            else f"the best design found, neither mapped, is {gain:+.2f} dB better"
        )
        lines.append(f"    {_told(given.value, given)}  {given.shape}, {given.open_ratio:.1%} open; {more}")
    return lines


def _told(value: float, each: JudgedOpening | FrontPoint) -> str:
    return f"{value:.2f} dB  emitters {each.footprint:.2%}  {each.lines} lines"
