"""A design, or advice, told beforehand: what it would make, by which job, and for how long."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from maskfab.api.results import Result
from maskfab.job.sections import JobSpec, SearchSection


@dataclass(frozen=True, repr=False)
class Foreseen(Result):
    """Work that was checked, as the verb itself does, and not done.

    Attributes:
        work: what would be done, in words.
        command: that would be told as the one that repeats it.
        budget_s: seconds that it may take, within a fifth; None for no limit.
        makes: files that would be written, as far as the call says where.
        job: text of the job that answers ask for; empty for a job's file.
        notes: numbers of it that differ from the answers, and what else a user should know, as sentences.
    """

    work: str
    command: str
    budget_s: float | None
    makes: tuple[str, ...] = ()
    job: str = ""
    notes: tuple[str, ...] = ()

    @property
    def takes(self) -> str:
        """Time in words."""
        if self.budget_s is None:
            return "until its search ends, which is not estimated; --budget TIME takes the best by then"
        return f"{self.budget_s:g} s, within a fifth"

    def to_dict(self) -> dict[str, Any]:
        """Its attributes, and time in words."""
        return {**asdict(self), "takes": self.takes}

    def __str__(self) -> str:
        lines = [f"would do: {self.work}", f"by: {self.command}", f"takes: {self.takes}"]
        lines += [f"would write: {path}" for path in self.makes]
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join([*lines, *(["", self.job] if self.job else [])])


def sought(spec: JobSpec, many: str = "") -> str:
    """Openings that a job's [design] asks for, in words.

    Args:
        many: numbers of clear dots of a front, which has its own.
    """
    section = spec.design
    assert section is not None
    many = many or str(section.clear_dots or "a chosen number of")
    dots = f"{many} clear dots of {section.dots} x {section.dots} in {section.pitch:g} um"
    if not isinstance(section, SearchSection):
        return f"descend to an opening, {dots}"
    held = ", round which the display must fit" if section.fit else ""
    cells = "no map" if section.map is None else f"the map {section.map}"
    return f"search {', '.join(section.families)} for an opening, {dots}{held}; {cells}"
