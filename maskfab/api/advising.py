"""One answer to what should be built for a display and its camera."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, overload

from maskfab.api.asked import spec_of
from maskfab.api.foreseen import Foreseen, sought
from maskfab.api.results import Asked, FolderResult, Told, saved
from maskfab.api.results import answers as answered_by
from maskfab.base.checks import checked_arguments
from maskfab.base.effort import measured
from maskfab.base.errors import JobError
from maskfab.base.folders import Place, check_target
from maskfab.base.units import parse_time_s
from maskfab.base.work import Progress, budget_clock, ended_by_interrupt, one_thread, silent
from maskfab.designs.design import scenes_of
from maskfab.job.brief import Brief, job_text, merged, modules, questions, snapped
from maskfab.job.read import validate
from maskfab.job.toml import loads
from maskfab.report.pages.advice import (
    DOCUMENT,
    PAGE,
    Advised,
    advice_document,
    advice_lines,
    advice_page,
    pictures,
    write_advice,
)
from maskfab.runs.advice import advise as advise_spec
from maskfab.runs.advice import job_files, off_axis, searched

if TYPE_CHECKING:
    from maskfab.api.asked import DesignJob  # at run time refused here, with its reason

BUDGET = "40 s"


@dataclass(frozen=True, eq=False, repr=False)
class Advice(FolderResult):
    """An answer to what should be built.

    Attributes:
        found: the design, photographs through it, its display, mask houses, and what else there is.
    """

    found: Advised
    command: str
    time: Mapping[str, float] = field(default_factory=dict)

    @property
    def build(self) -> bool:
        """Whether the design should be built."""
        return bool(self.to_dict()["build"])

    @property
    def verdict(self) -> str:
        """The answer in one sentence."""
        return str(self.to_dict()["verdict"])

    @property
    def why_not(self) -> list[str]:
        """Reasons not to build it, the strongest first."""
        return list(self.to_dict()["why_not"])

    def to_dict(self) -> dict[str, Any]:
        """Everything that the page tells."""
        return advice_document(self.found, self.command, sorted(job_files(self.found.job)), self.time or None)

    def _write(self, place: Place) -> list[Path]:
        """The page, its numbers, and a job of the design with its files, which ``run`` takes."""
        return write_advice(place, self.to_dict(), job_files(self.found.job), pictures(self.found))

    def __str__(self) -> str:
        return "\n".join(advice_lines(self.to_dict()))

    def _repr_html_(self) -> str:
        return advice_page(self.to_dict(), pictures(self.found))


@overload
def advise(
    job: DesignJob | None = ..., *, answers: Mapping[str, str] | Brief | None = ..., budget: str | None = ...,
    images: str | Path | None = ..., progress: Progress = ...,
) -> Advice: ...  # fmt: skip
@overload
def advise(
    job: DesignJob | None = ..., *, answers: Mapping[str, str] | Brief | None = ..., budget: str | None = ...,
    dry_run: Literal[True], images: str | Path | None = ..., progress: Progress = ...,
) -> Foreseen: ...  # fmt: skip
@checked_arguments
@one_thread
def advise(
    job: Annotated[DesignJob | None, "JOB"] = None,
    *,
    answers: Annotated[Mapping[str, str] | Brief | None, "--set KEY=VALUE"] = None,
    budget: Annotated[str | None, "TIME"] = None,
    dry_run: bool = False,
    images: str | Path | None = None,
    progress: Progress = silent,
) -> Advice | Foreseen:
    """Say what to build for a display and its camera, what photographs gain, what it costs, who writes it, or why not.

    Without a job, questions are asked on a terminal: pitch, layout, emitters, lines, camera, light and limits.

    Examples:
        $ maskfab advise layouts/display_that_fits.toml -o answer
        $ maskfab advise job.toml -o answer --budget '5 min'
        $ maskfab advise -o answer --set pitch='400 dpi' --set camera=phone_main --set lux='200 lux'
        $ maskfab advise -o answer --set device=galaxy_z_fold_3 --set camera='2.4 mm'

    Args:
        job: job file (.toml) with [design], [emitters] and [plate]; in Python also a loaded job.
        answers: answer about the display and its camera, in place of a job, such as ``lines``; the rest has defaults.
            ``device`` answers what was published of one, as :func:`maskfab.new` lists them.
        budget: time from the call on, such as ``"5 min"``; more finds better openings, proves bounds and tries more; by
            default 40 s, or as long as the first openings and their photographs take where the machine is slow.
        dry_run: tell what would be designed, by which job, and for how long; write nothing.
        images: folder of photographs to design for; by default synthetic scenes.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a job without [design], [emitters] or [plate]; MF150 for a stated budget that the first
            openings exceed; else as for the job.
    """
    clock = budget_clock(parse_time_s(budget or BUDGET, where="budget"), refuses=budget is not None)
    began = time.monotonic()
    made, notes, text = None, tuple[str, ...](), ""
    if job is not None:
        if answers is not None:
            what = "answers cannot be stated beside a job, which says what is designed"
            raise JobError("MF105", what, where="answers", cure="State them in the job, or leave the job out")
        spec, path = spec_of(job, "advise")
        command = f"maskfab advise {path.as_posix()}"
    else:
        made = snapped(answers if isinstance(answers, Brief) else Brief.of(answers or {}))
        notes = (*(f"Moved to a common grid: {move}." for move in made.moves), *filter(None, [made.finer]))
        text, path, command = job_text(made), Path("answers"), "maskfab advise job.toml"
        spec = validate(loads(text), where="answers")
    command += "" if budget in (None, BUDGET) else f" --budget '{budget}'"
    command += "" if images is None else f" --images {Path(images).as_posix()}"
    given = None if images is None else Path(images)
    if dry_run:
        _, section, _ = searched(spec, str(path))
        scenes_of(given, section)
        work = f"{sought(spec)}; photographs, display, mask houses and larger openings"
        return Foreseen(work, command, clock.budget_s, job=text, notes=notes)
    with measured(time.process_time) as effort, ended_by_interrupt(clock):
        found = advise_spec(spec, command, path=path, images=given, progress=progress, clock=clock, notes=notes)
        if made is not None:
            progress("off the axis", 0, 1)
            lens = off_axis(found.job, found.name, made.brief.gap, made.brief.field, clock)
            found = replace(found, notes=(*found.notes, lens))
            progress("off the axis", 1, 1)
    taken = {"wall_s": time.monotonic() - began, "processor_s": effort.seconds}
    return Advice(found, command, {key: round(seconds, 1) for key, seconds in taken.items()})


@answered_by(advise)
def _advise(asked: Asked) -> Told:
    """Places are looked at before any question or work."""
    planned = asked.stated.get("dry_run")
    if asked.out is None and not asked.as_json and not planned:
        cure = "Add -o with a folder for the page, its numbers, and the job"
        raise JobError("MF105", "the answer has no output folder", where="--out", cure=cure)
    if asked.out is not None:
        check_target(asked.out, force=asked.force)
    if "job" not in asked.stated:
        asked.stated["answers"] = ask_brief(asked, asked.stated.get("answers") or {})
    if not planned:
        return saved(asked)
    makes = [] if asked.out is None else [str(asked.out / name) for name in (PAGE, DOCUMENT, "job.toml")]
    return Told.of(replace(asked.found(), makes=tuple(makes)))


def ask_brief(asked: Asked, given: Mapping[str, object]) -> Brief:
    """The brief of given answers and, on a terminal, of those that a person types to the other questions.

    Enter takes the default that a question shows; an answer that cannot be, or that contradicts an earlier one, is
    asked again. Elsewhere, and with ``--json``, nothing is asked.

    Args:
        given: answers by their keys, as :meth:`maskfab.job.brief.Brief.of` takes them.

    Raises:
        JobError: MF105 for answers without a default that are missing where nobody can be asked; else as that does.
    """
    stated = merged(given)
    if asked.attended and not asked.as_json:
        asked.tell("Enter takes the answer in brackets; Ctrl-C ends, and nothing is written.")
        for question in questions():
            if question.key in stated:
                continue
            if question.key == "camera":
                for name, camera in modules().items():
                    asked.tell(f"  {name}: {camera.title}")
            default = question.default_of(stated)
            shown = f"{question.text} [{f'{default}: ' if default else ''}{question.why}]"
            typed = asked.answered(shown, partial(_with, stated, question.key))
            if answer := default if typed is None else typed[0]:
                stated[question.key] = answer
    return Brief.of(stated)


def _with(stated: Mapping[str, object], key: str, answer: str) -> Brief:
    """The brief with one more answer, as if all questions that are not asked yet had their defaults."""
    needed = {question.key: question.default_of(stated) for question in questions() if question.needed}
    return Brief.of({**needed, **stated, key: answer})
