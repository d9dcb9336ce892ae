"""Studies: figures of a job's dies, and claims held against their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from maskfab.api.asked import AnyJob, dies_of, given_folder, job_of
from maskfab.api.results import Asked, FolderResult, Told, answers
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import Place, check_target
from maskfab.base.work import Progress, silent
from maskfab.base.workers import Workers
from maskfab.findings import study as studies
from maskfab.findings.photographs import learned_restorers, read_checkpoints
from maskfab.findings.study import Claim
from maskfab.job.reference import in_words
from maskfab.mask.job import masks_in, with_masks
from maskfab.report.pages.study import study_document, study_lines, write_study
from maskfab.runs.store import of_installation


@dataclass(frozen=True, eq=False, repr=False)
class Study(FolderResult):
    """A study that was made.

    Attributes:
        found: scores, optics, and what they are of.
    """

    found: studies.Study

    @property
    def claims(self) -> tuple[Claim, ...]:
        """Claims with their numbers and verdicts."""
        return self.found.claims

    def to_dict(self) -> dict[str, Any]:
        """Everything that was found."""
        return study_document(self.found)

    def rows(self) -> list[dict[str, Any]]:
        """Rows: one for each protocol, case, die, level of light, restorer and scene."""
        scores = self.found.scores.items()
        return [
            {"protocol": take.protocol, "case": take.case, **vars(score)} for take, all_ in scores for score in all_
        ]

    def _write(self, place: Annotated[Place, "FOLDER!"]) -> list[Path]:
        """Page, numbers and figures; of several jobs, one folder in it each."""
        return write_study(place, self.found)

    def __str__(self) -> str:
        return "\n".join([*study_lines(self.found), *in_words(self.found.plan.unused)])


def plan(
    job: AnyJob,
    *,
    images: str | Path | None = None,
    white: float | None = None,
    checkpoints: Sequence[str | Path] = (),
    masks: str | Path | None = None,
) -> studies.Plan:
    """Check all of a study before any work; arguments and errors as for :func:`study`."""
    loaded, trained = job_of(job), read_checkpoints(checkpoints)
    given = given_folder(images, white)
    files = {} if masks is None else masks_in(Path(masks))
    if not trained:
        return studies.planned(loaded, given, masks=files)
    panels = with_masks(loaded, files)[0].panels()
    behind = dies_of([network.trade.die for _, network in trained], panels)

    def learned(setting: studies.Setting) -> studies.Learned:
        designs = [setting.design(name, panels[name])[0] for name in behind]
        return learned_restorers(trained, setting.job, setting.conditions, designs)

    return studies.planned(loaded, given, learned, files)


def _require_masks(plans: Sequence[studies.Plan]) -> None:
    idle = {name for each in plans for name in each.idle_masks}
    if idle and not any(each.masks for each in plans):
        names = sorted({name for each in plans for name in each.job.spec.openings})
        what = f"none of {', '.join(sorted(idle))} is named after an opening of the study"
        raise JobError("MF147", what, where="masks", cure=f"Name them after {', '.join(names)}")


@checked_arguments
def study(
    job: Annotated[AnyJob, "JOB..."],
    *,
    images: str | Path | None = None,
    white: float | None = None,
    checkpoints: Sequence[str | Path] = (),
    masks: str | Path | None = None,
    scheduler: Annotated[str | None, "ADDRESS"] = None,
    workers: Annotated[int | None, "1..1024"] = None,
    progress: Progress = silent,
) -> Study:
    """Make figures of a job's dies, with tables and intervals, and tell which claims agree with the numbers.

    Examples:
        $ maskfab study layouts/studies/fig7.toml -o build/fig7
        $ maskfab study layouts/studies/*.toml --images photographs -o build/studies
        $ maskfab study layouts/studies/fig9.toml --masks published -o build/fig9

    Args:
        job: job file (.toml) with [study]; of several, each is made.
        images: folder of photographs, beside the study's drawn scenes.
        white: light that is white in photographs that hold light, EXR and HDR; it must be stated if they hold more
            than 1.
        checkpoints: file of maskfab learn, for one of the dies: one more restorer, learned.
        masks: folder of masks, each in place of the openings that it is named after; those of other names are told.
        scheduler: address of a Dask scheduler whose workers share the work, such as tcp://127.0.0.1:8786.
        workers: processes; by default as many as processors and memory bear. The numbers are the same.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a white without photographs, MF145 for a claim about what the study does not have, MF146
            for a job without a study, or for one that shows nothing; MF147 for a mask of another size than its
            opening, or none named after one; else as for ``simulate``.
    """
    crew = Workers(workers, scheduler, of_installation)
    planned = plan(job, images=images, white=white, checkpoints=checkpoints, masks=masks)
    _require_masks([planned])
    return Study(studies.made(planned, progress, crew))


@answers(study)
def _study(asked: Asked) -> Told:
    """One folder for each job; all of them are looked at before any is made."""
    jobs, out = asked.stated["job"], asked.out
    assert out is not None
    stated = {key: asked.stated[key] for key in ("images", "white", "checkpoints", "masks") if key in asked.stated}
    crew = Workers(asked.stated.get("workers"), asked.stated.get("scheduler"), of_installation)
    plans = {}
    for job in jobs:
        place = out / job.stem if len(jobs) > 1 else out
        if place in plans:
            problem = f"two of the jobs are called {job.stem}, and would be written to {place}"
            raise JobError("MF105", problem, where="JOB", cure="Make them one after the other, or rename one")
        plans[place] = plan(job, **stated)
        check_target(place, force=asked.force)
    _require_masks(list(plans.values()))
    documents, lines = [], []
    for place, planned in plans.items():
        result = Study(studies.made(planned, asked.progress, crew))
        paths = result.save(place, force=asked.force)
        documents.append({**result.to_dict(), "path": str(place)})
        lines += [*str(result).split("\n"), "", *map(str, paths)]
    return Told({"studies": documents}, lines)
