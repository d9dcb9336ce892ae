"""A run's result: everything found out about a plate, its report and pictures, and the object that a user is handed."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.base.errors import UnknownNameError
from maskfab.base.findings import expected
from maskfab.base.folders import OVERVIEW, REPORT, TIMES, Account
from maskfab.base.model import Die, DieOptics, Plate, Quantity, Report, WrittenFile
from maskfab.display.feasibility import PlateWithDisplays, display_rules
from maskfab.findings.as_written import Written, measure_written
from maskfab.findings.bands import Expansion, restored_bands
from maskfab.findings.display import display_quantities, footprint_band
from maskfab.findings.optics import measure_with_bar, view_rows
from maskfab.findings.photographs import Photographs, Surroundings, photograph_die
from maskfab.findings.scene import SceneOptics
from maskfab.job.reference import USES, unused
from maskfab.mask.job import Job
from maskfab.mask.plate_rules import judged, smallest_features
from maskfab.optics.mtf import worst_directions
from maskfab.report.documents import die as die_data
from maskfab.report.documents import report as report_data
from maskfab.report.documents.die import Beside
from maskfab.report.documents.shape import Document
from maskfab.report.text import Quantities, note_lines
from maskfab.report.verdicts import Verdicts
from maskfab.runs.plate_files import named_shop, process_spread

if TYPE_CHECKING:
    from pandas import DataFrame

UNUSED = "unused_keys"
_NOTES = (UNUSED, "display_seed", "photographs_refused", "assumed_tiling")
TAKEN = "taken from the cache"
"""Stage of a run that an earlier one had made."""


@dataclass(frozen=True, repr=False)
class Result:
    """Where a finished run is, and what came of it.

    ``result["DIE"]`` are the numbers of a die, ``result["DIE"]["mtf50", 530]`` one of them.

    Attributes:
        verdicts: whether the plate can be ordered, its optics are proved, and displays fit, look and live.
        taken: how many findings earlier runs had kept, and how many there are; None for a run without a cache.
        accounts: where every finding comes from; none for a run without a cache.
    """

    directory: Path
    report: Report
    verdicts: Verdicts
    taken: tuple[int, int] | None = None
    accounts: tuple[Account, ...] = ()

    def __fspath__(self) -> str:
        return str(self.directory)

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return self.report.passed

    @property
    def origin(self) -> str:
        """Which of its numbers were found in this run, and which earlier ones had kept, in words."""
        since = min((account.since for account in self.accounts if account.kept), default="")
        refused = sum(account.refused is not None for account in self.accounts)
        whole = TAKEN in self.report.seconds
        share = "the whole run" if whole else "{} of {} findings".format(*self.taken or (0, 0))
        more = f", found since {since}" if since else ""
        more += ", its files read back in this run" if whole else ""
        more += f"; {refused} kept findings refused, and found again" if refused else ""
        return f"{share} taken from the cache{more}: see {TIMES}"

    @property
    def checks(self) -> Quantities:
        """Every number that was judged, of dies and plate."""
        return Quantities(self.report.checks)

    @property
    def plate(self) -> Quantities:
        """Numbers of the whole plate."""
        return Quantities(self.report.plate)

    @property
    def notes(self) -> tuple[Quantity, ...]:
        """Notes to see beside the checks: keys of the job unused, dies of another seed or without photographs."""
        rows = (*self.report.plate, *(row for die in self.report.dies.values() for row in die))
        return tuple(row for row in rows if row.name in _NOTES)

    def __getitem__(self, die: str) -> Quantities:
        if die not in self.report.dies:
            cure = f"Use one of {', '.join(self.report.dies)}"
            raise UnknownNameError("MF432", f"there is no die {die!r}", cure=cure)
        return Quantities(self.report.dies[die])

    def __iter__(self) -> Iterator[str]:
        return iter(self.report.dies)

    def to_dict(self) -> dict[str, Any]:
        """The content of report.json."""
        document: dict[str, Any] = json.loads((self.directory / REPORT).read_text(encoding="utf-8"))
        return document

    def to_dataframe(self) -> DataFrame:
        """One row for each number of each die and of the plate."""
        return self._every.to_dataframe()

    @property
    def _every(self) -> Quantities:
        return Quantities((*(row for die in self.report.dies.values() for row in die), *self.report.plate))

    def __str__(self) -> str:
        return "\n".join([str(self.directory), str(self._every), *note_lines(self.notes)])

    def __repr__(self) -> str:
        return f"<Result in {self.directory}: {', '.join(self.report.dies)}; {'; '.join(self.verdicts.lines)}>"

    def _repr_html_(self) -> str:
        picture = self.directory / OVERVIEW
        from maskfab.report.figures.sheet import data_uri, img

        shown = img(data_uri(picture.read_bytes()), "the plate", "overview") if picture.is_file() else ""
        return shown + self._every._repr_html_()


@dataclass(frozen=True, eq=False)
class PlateFindings:
    """Everything that was found out about a plate.

    Attributes:
        read: rows of what reading files back has shown, and the shop's rules.
        restored: photographs through all dies.
        written: dies as their writer makes them, by name.
        changes: of restored photographs over the spread of the process, by die; none without a spread.
        measured: the measurement beside the job; None if there is none.
    """

    job: Job
    built: PlateWithDisplays
    read: Sequence[Quantity]
    optics: Sequence[DieOptics]
    scenes: Sequence[SceneOptics]
    restored: Photographs
    written: Mapping[str, Written]
    changes: Mapping[str, Expansion | str]
    measured: Beside | None = None

    @property
    def plate(self) -> Plate:
        """With its displays."""
        return self.built.plate

    @property
    def reference(self) -> str | None:
        """Die that the others are compared with: that of photographs, or the one that stands for it without any."""
        return self.restored.reference or self.job.compared_with

    def report(self, files: tuple[WrittenFile, ...], seconds: dict[str, float]) -> Report:
        """Everything gathered; every judged quantity is also a check."""
        job, built = self.job, self.built
        of_dies = {item.die.name: die_quantities(item, self.read, job) for item in self.optics}
        of_plate = tuple(quantity for quantity in self.read if quantity.die is None)
        for die in built.plate.dies:
            if die.name in built.displays and die.name in of_dies:
                exempt = die.name == self.reference and len(built.displays) > 1
                of_dies[die.name] += display_quantities(die, built.displays[die.name], job.camera, exempt=exempt)
                of_dies[die.name] += self._of_footprint(die)
        for name in self.restored.dies:
            of_dies[name] += self.restored.quantities(name)
        for name, process in self.written.items():
            of_dies[name] += process.quantities
        if job.spec.written is not None:
            for name in self.changes:
                of_process = job.spec.written, process_spread(job)
                of_dies[name] += tuple(restored_bands(self.restored, name, self.changes, *of_process))
        for notes in (die_data.camera_notes(job), job.notes):
            for name, note in notes.items():
                if name in of_dies:
                    of_dies[name] += (note,)
        of_plate += (*view_rows(job),)
        asked = {"run for a house": named_shop(job) is not None, "run for a display": job.spec.emitters is not None}
        names = unused(job.spec, *USES["run"], *(key for use, holds in asked.items() if holds for key in USES[use]))
        if names:
            how = "of the job: no file and no number here depends on it"
            of_plate += (Quantity(UNUSED, ", ".join(names), how),)
        if self.measured is not None:
            of_plate += self.measured.note(job.digest)
        everything = [*of_plate]
        of_scenes = {scene.die.name: scene.quantities for scene in self.scenes}
        for name, quantities in of_dies.items():
            everything += [*quantities, *of_scenes.get(name, ())]
        checks = tuple(quantity for quantity in everything if quantity.passed is not None)
        return Report(built.plate.title, job.digest, job.seeds, of_dies, of_plate, checks, files, seconds)

    def _of_footprint(self, die: Die) -> tuple[Quantity, ...]:
        rules, process = display_rules(self.job), self.job.spec.written
        if rules is None or process is None:
            return ()
        return footprint_band(die, self.built.displays[die.name], rules.emitters, process, process_spread(self.job))

    def verdicts(self, report: Report) -> Verdicts:
        """Verdicts on the plate."""
        return Verdicts.of(report.checks, self.built.displays, len(self.plate.dies), self.reference)

    def document(self, report: Report) -> Document:
        """The content of report.json."""
        designs = {
            name: die_data.stated_design(said, self.restored.conditions.levels, self.restored.dies.get(name))
            for name, said in die_data.stated(self.job).items()
        }
        photographs = die_data.photographs_document(self.restored)
        return report_data.to_document(
            report, self.plate, self.job.camera, self.scenes, self.built.displays, designs, photographs,
            self._of_dies(), self._expected_s(), process_spread(self.job), self.job.spec.written,
            self.reference,
        )  # fmt: skip

    def _expected_s(self) -> dict[str, dict[str, float]]:
        """Seconds that the models of every die are expected to take, by constants: equal runs tell equal numbers."""
        around = Surroundings.of(self.job)
        seconds_of: dict[str, dict[str, float]] = {}
        for optics in self.optics:
            die = optics.die
            models = {
                "optics": expected(measure_with_bar, (die, self.job.camera)),
                "written": expected(measure_written, ()) if die.name in self.written else None,
                "photographs": expected(photograph_die, (self.restored.conditions, around)),
            }
            seconds_of[die.name] = {name: seconds for name, seconds in models.items() if seconds}
        return seconds_of

    def _of_dies(self) -> dict[str, Document]:
        names = () if self.measured is None else [die.name for die in self.plate.dies]
        documents = {name: self.measured.of_die(name, self.job.digest) for name in names if self.measured is not None}
        return {name: document for name, document in documents.items() if document is not None}


def die_quantities(item: DieOptics, read: Sequence[Quantity], job: Job) -> tuple[Quantity, ...]:
    """Numbers of one die: optics, what reading back has shown, and features, judged by the job's own limits."""
    name = item.die.name
    shown = (quantity for quantity in read if quantity.die == name)
    frequencies = job.spec.frequencies_cy_per_mm
    worst = (direction for mtf in item.mtfs for direction in worst_directions(mtf, frequencies, name))
    every = (*item.quantities, *worst, *shown, *smallest_features(item.die))
    return tuple(judged(quantity, job.spec.limits) for quantity in every)
