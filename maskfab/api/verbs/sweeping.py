"""Pareto fronts of restored photographs against room for emitters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab import provenance
from maskfab.camera import scenes as scene_sets
from maskfab.camera.photo_camera import PhotoCamera
from maskfab.camera.photographs import Folder, folder
from maskfab.camera.transfer import lattice
from maskfab.display.feasibility import DisplayRules
from maskfab.errors import JobError
from maskfab.files.staging import check_target
from maskfab.jobfile import SearchSection, read
from maskfab.opening.openings import load_opening, opening_text
from maskfab.optimiser.design import notes_of
from maskfab.optimiser.pareto import JudgedOpening, Pareto, openings, rules_of, sweep
from maskfab.progress import Progress, silent
from maskfab.report import pareto_files
from maskfab.report.pareto_files import Named
from maskfab.threads import one_thread
from maskfab.units import parse_time_s

if TYPE_CHECKING:
    from maskfab.report.plots.sheet import Drawing


@dataclass(frozen=True, eq=False, repr=False)
class ParetoFront:
    """A Pareto front of restored PSNR against emitter footprint.

    Attributes:
        found: curves, the best of all, and what they are compared with.
        named: the openings by name.
        digest: of the job.
        notes: what a user should know, as sentences.
    """

    found: Pareto
    named: Named
    digest: str
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Everything that was found."""
        return pareto_files.pareto_document(self.found, self.named, self.digest, self.notes)

    def save(self, out: str | Path, *, force: bool = False) -> list[Path]:
        """Write numbers, openings and figure into a directory.

        Raises:
            OutputError: MF401 or MF402 for a place that cannot be written.
        """
        return pareto_files.write_pareto(check_target(Path(out), force=force), self.found, self.to_dict(), self.named)

    def plot(self) -> Drawing:
        """The curves, and what they are compared with."""
        from maskfab.report.plots.pareto_figure import pareto_drawing

        return pareto_drawing(self.found)

    def __str__(self) -> str:
        return "\n".join([*_lines(self.found, self.named), *(f"note: {note}" for note in self.notes)])

    def _repr_svg_(self) -> str:
        return self.plot().svg()


@one_thread
def pareto(
    job: str | Path,
    *,
    images: str | Path | None = None,
    budget: str | None = None,
    command: str | None = None,
    progress: Progress = silent,
) -> ParetoFront:
    """Find the Pareto front of restored PSNR against emitter footprint.

    Args:
        job: a job file with [pareto], and a [design] that searches.
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
    rules = None if spec.emitters is None else DisplayRules.of(spec.emitters, None, None, where=str(path)).emitters
    lattice(section.dots, rules_of(section, compared, rules).dot_nm, camera=camera, where=f"{path}: design.dots")
    scenes = Folder(scene_sets.bundled(), ()) if images is None else folder(Path(images))
    found = sweep(
        spec.pareto,
        section,
        scenes.photographs,
        compared=compared,
        emitters=rules,
        camera=camera,
        budget_s=limit_s,
        progress=progress,
    )
    named = openings(found, section, command or f"maskfab.pareto({path.as_posix()!r})", camera)
    digest = provenance.job_hash(spec.model_copy(update={"openings": {**spec.openings, **texts}}).dump())
    idle = [*(["fit of [design]"] if section.fit else []), *(["[wires]"] if spec.wires is not None else [])]
    unwired = (f"A sweep asks for emitters alone; not used of the job: {', '.join(idle)}.",) if idle else ()
    return ParetoFront(found, named, digest, (*notes_of(spec, scenes), *unwired))


def _lines(found: Pareto, named: Named) -> list[str]:
    best = {id(each) for each in found.best}
    names = {id(judged): name for name, (judged, _) in named.items()}
    lines = []
    for curve in found.curves:
        if curve.refusal is not None:
            lines.append(f"{curve.clear_dots} clear dots: {curve.refusal}")
            continue
        cut = "" if curve.complete else "; the budget ended it"
        lines.append(
            f"{curve.clear_dots} clear dots ({curve.front[0].open_ratio:.1%} open): {curve.evaluated} openings "
            f"evaluated, {curve.measured} footprints measured{cut}"
        )
        lines += [
            f"  {'*' if id(each) in best else ' '} {_told(each)}  {names[id(each)]}: {each.shape}"
            for each in curve.front
        ]
    for each in found.compared:
        gain = found.gain_db(each)
        more = (
            "nothing found has that footprint at no more clear dots"
            if gain is None
            else f"the front is {gain:+.2f} dB better"
        )
        lines.append(f"    {_told(each)}  {each.shape}, {each.open_ratio:.1%} open; {more}")
    return lines


def _told(each: JudgedOpening) -> str:
    return f"{each.value:.2f} dB  {each.footprint:.2%}"
