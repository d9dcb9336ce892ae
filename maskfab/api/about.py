"""About the program itself: errors and keys in words, the installation, what runs have kept, entries to cite."""

from __future__ import annotations

import json
import math
import platform
import re
import tempfile
import textwrap
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, Literal

from maskfab.api.results import Result
from maskfab.base import __version__, provenance
from maskfab.base import resources as error_codes
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import InternalError, JobError, catalogue
from maskfab.base.extras import EXTRAS, install_command
from maskfab.base.machine import cores, memory_bytes
from maskfab.base.work import Progress, silent

if TYPE_CHECKING:
    from maskfab.api.asked import AnyJob, AnyPath  # heavy, and refused where it is used
    from maskfab.report.text import Quantities
    from maskfab.runs.store import Entry
    from maskfab.trials.hard_cases import CaseResult
    from maskfab.trials.race import Timing


# Each answer imports what it needs: an error is explained in less time than any of it takes to load.

_WIDTH = 100
_CODE = re.compile(r"(?i)\s*(mf.?\d|\d)")
_INDENT = " " * len("Usual cause: ")
_SCHEMAS = {
    "job": "job.reference:job_schema",
    "report": "report.documents.report:schema",
    "check": "report.documents.display:check_schema",
    "advice": "report.pages.advice:schema",
}


@dataclass(frozen=True, repr=False)
class Answer(Result):
    """An explanation, as text for people and as plain data."""

    text: str
    document: Mapping[str, Any]

    def __str__(self) -> str:
        return self.text

    def to_dict(self) -> dict[str, Any]:
        """The parts by their names."""
        return dict(self.document)


@checked_arguments
def explain(
    code: Annotated[str | None, "CODE|KEY"] = None,
    *,
    schema: Literal["job", "report", "check", "advice"] | None = None,
    source: bool = False,
) -> Answer:
    """Explain an error code (example, usual cause, cure), a key of a job (form, default) or a number (what finds it).

    Examples:
        $ maskfab explain MF106
        $ maskfab explain camera.stop
        $ maskfab explain mtf50 --source
        $ maskfab explain --schema job > job.schema.json
        >>> import maskfab as mf
        >>> print(mf.explain("MF111").text.splitlines()[0])
        MF111  A random tiling needs a seed.

    Args:
        code: code such as ``"MF106"``, or a key or table of a job such as ``"camera.stop"``, or its last word, or a
            quantity such as ``"mtf50"``; left out, all codes are listed.
        schema: print the JSON Schema (draft 2020-12) of a job file, of report.json, of maskfab check --json or of
            advice.json.
        source: tell of a quantity or a code which functions make it, by which formula, and which tests guard them.

    Raises:
        JobError: MF105 for what is neither, or both, and for the source of a key or of nothing.
    """

    if source and (code is None or schema is not None):
        what, cure = "no number and no code is named", "Name one alone, such as mtf50 or MF106"
        raise JobError("MF105", what, where="source", cure=cure)
    if schema is not None:
        if code is not None:
            raise JobError("MF105", f"{code} is not of a schema", where="code", cure="Ask for one after the other")
        document = _schema(schema)
        return Answer(json.dumps(document, indent=1, ensure_ascii=False), document)
    if code is None:
        listed = {head: {e: catalogue()[e]["meaning"] for e in codes} for head, codes in error_codes.grouped().items()}
        lists = ("\n".join([head, *(f"  {e}  {told}" for e, told in codes.items())]) for head, codes in listed.items())
        return Answer("\n\n".join(lists), listed)
    if source:
        return _source_of(code.strip())
    if not _CODE.match(code):
        return _of_keys(code)
    entry = error_codes.explained(code)
    parts = _parts(("Example", entry.example), ("Usual cause", entry.cause), ("Cure", entry.cure))
    return Answer(f"{entry.code}  {entry.meaning}\n\n{parts}", asdict(entry))


def _schema(of: str) -> dict[str, Any]:
    if of not in _SCHEMAS:
        cure = "Name job, report, check or advice"
        raise JobError("MF105", f"there is no schema of {of!r}", where="schema", cure=cure)
    document: dict[str, Any] = resolve_name(f"maskfab.{_SCHEMAS[of]}")()
    return document


def _of_quantity(name: str) -> Answer | None:
    """A number of report.json, and what finds it; None for what is no quantity, or stands for any name."""
    from maskfab.base.findings import LIMITS, origins
    from maskfab.base.quantities import FAMILIES, registered

    try:
        entry = registered(name)
    except InternalError:
        return None
    sources = [f"{work.name}, from {', '.join(need.value for need in work.needs)}" for work in origins(name)]
    if not sources or any(f"{{{word}}}" in entry.name for word, form in FAMILIES.items() if form == ".*"):
        return None
    unit = "" if entry.takes_detail or entry.unit == "1" else entry.unit
    limit = f"limits.{LIMITS[name]}" if name in LIMITS else ""
    stated = {"Meaning": entry.meaning, "Unit": unit, "Limit": limit, "Verdict": entry.subject, "Cure": entry.cure}
    parts = [(title, text) for title, text in stated.items() if text]
    body = _parts(*parts, ("Found by", "\n".join(sources)))
    document = {"quantity": name, **asdict(entry), "limit": limit or None, "found_by": sources}
    return Answer(f"{name}  {entry.title}\n\n{body}", document)


def _source_of(name: str) -> Answer:
    """Functions that give a quantity or raise a code, each with its formula and the tests that guard it."""
    from maskfab.base.makers import guards, makers
    from maskfab.base.quantities import registered

    if name.upper() in catalogue():
        name = name.upper()
        title, family = catalogue()[name]["meaning"], name
    else:
        try:
            entry = registered(name)
        except InternalError:
            cure = "Name a quantity of numbers.csv, such as mtf50, or a code such as MF106"
            raise JobError("MF105", f"{name} is no quantity and no code", where="source", cure=cure) from None
        title, family = entry.title, entry.name
    found = [(maker, guards(name, maker)) for maker in makers(name, family)]
    none = ("none is installed here",)
    told = [
        "\n".join([f"{maker.function}  {maker.place}", textwrap.indent(maker.formula, "    "), *(tests or none)])
        for maker, tests in found
    ]
    document = {"name": name, "title": title, "makers": [{**asdict(maker), "tests": tests} for maker, tests in found]}
    return Answer("\n\n".join([f"{name}  {title}", *told]), document)


def _of_keys(path: str) -> Answer:
    from maskfab.job.reference import keys_of

    try:
        keys = keys_of(path, or_word=True)
    except JobError:
        answer = _of_quantity(path.strip())
        if answer is None:
            raise
        return answer
    document = {"keys": [asdict(key) for key in keys]}
    if len({key.section for key in keys}) > 1 and all(key.name == path.strip().lower() for key in keys):
        # A word that ends several keys: which is meant, their first sentences tell.
        width = max(len(key.path) for key in keys)
        lines = [f"{key.path:<{width}}  {key.meaning.partition('. ')[0].rstrip('.')}." for key in keys]
        return Answer("\n".join([*lines, f"maskfab explain {keys[0].path} tells more"]), document)
    refused = _refused_if() if any(key.section == "design.rules" for key in keys) else {}
    entries = []
    for key in keys:
        default = "required" if key.default is None else key.default or "none"
        parts = _parts(("Meaning", key.meaning), ("Form", key.form), ("Default", default), *refused.get(key.path, ()))
        entries.append(key.path + key.section.partition(" ")[1] + key.section.partition(" ")[2] + "\n" + parts)
    return Answer("\n\n".join(entries), document)


def _refused_if() -> dict[str, tuple[tuple[str, str]]]:
    """Refusals by the keys of design rules, before a design is searched for."""
    from maskfab.designs.rules.constraints import RULES

    return {rule.where: (("Refused if", rule.refused_if),) for rule in RULES if rule.refused_if}


def _parts(*parts: tuple[str, str]) -> str:
    paragraphs = []
    for title, text in parts:
        lines = (
            line
            for paragraph in text.splitlines()
            for line in textwrap.wrap(paragraph, _WIDTH - len(_INDENT), break_on_hyphens=False)
        )
        paragraphs.append(f"{title + ':':<{len(_INDENT)}}" + f"\n{_INDENT}".join(lines))
    return "\n".join(paragraphs)


@dataclass(frozen=True, repr=False)
class Examination(Result):
    """An installation."""

    facts: dict[str, str]
    checks: Quantities = field(hash=False)
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether the self-test found every number right."""
        return self.checks.passed

    def to_dict(self) -> dict[str, Any]:
        """Facts and checks."""
        return {"facts": self.facts, "passed": self.passed, "seconds": self.seconds, "checks": self.checks.to_dict()}

    def __str__(self) -> str:
        width = max(map(len, self.facts))
        lines = [f"{name.ljust(width)}  {words}" for name, words in self.facts.items()]
        shown = self.checks if self.passed else self.checks.failed
        right = sum(check.passed is True for check in self.checks)
        summary = f"self-test: {right} of {len(self.checks)} checks pass, {self.seconds:.1f} s"
        return "\n".join([*lines, summary] if self.passed else [*lines, summary, str(shown)])


@checked_arguments
def doctor(*, progress: Progress = silent) -> Examination:
    """Examine this installation: versions, threads, memory, optional parts, and a self-test that takes seconds.

    The self-test holds the PSF of a clear square stop against its formula, writes a small plate in every format that
    this installation can write, reads each file back and repeats its checks, and uses what else is installed once.

    Examples:
        $ maskfab self doctor

    Args:
        progress: told where the work stands.
    """
    from maskfab.api.self_test import clear_stop, trials_of, tried
    from maskfab.report.text import Quantities

    begun = time.perf_counter()
    checks = [clear_stop()]
    with tempfile.TemporaryDirectory(prefix="maskfab-") as scratch:
        trials = dict(trials_of(Path(scratch)))
        for done, (what, trial) in enumerate(trials.items()):
            progress("self-test", done, len(trials))
            checks += tried(what, trial)
    progress("self-test", len(trials), len(trials))
    return Examination(dict(_facts()), Quantities(checks), round(time.perf_counter() - begun, 2))


def _facts() -> Iterator[tuple[str, str]]:
    from threadpoolctl import threadpool_info

    from maskfab.runs.store import VARIABLE, Store

    yield from provenance.versions().items()
    yield "system", f"{platform.system()} {platform.machine()}"
    yield "processors", str(cores())
    pools = [f"{pool['internal_api']} {pool['num_threads']}" for pool in threadpool_info()]
    yield "threads", ", ".join(pools) or "no numerical library is loaded"
    yield "memory", f"{memory:.1f} GB" if math.isfinite(memory := memory_bytes() / 1e9) else "unknown"
    store = Store.of_user()
    yield "cache", f"off; {VARIABLE} names a folder" if store is None else str(store.folder)
    for name, extra in EXTRAS.items():
        missing = f"not installed: {', '.join(extra.missing)}"
        yield f"maskfab[{name}]", f"{extra.use}: {missing if extra.missing else 'installed'}"
    yield "more", f"to install an extra, {install_command('EXTRA')}"


_UNITS = {"kB": 1e3, "MB": 1e6, "GB": 1e9}
_DAY_S = 86400


@dataclass(frozen=True, repr=False)
class Kept(Result):
    """Findings of earlier runs, which later ones take from there.

    Attributes:
        folder: that holds it; None where the cache is off, or has no place that only its owner may write.
        entries: everything that is kept.
        removed: just now; None if nothing was to be.
    """

    folder: Path | None
    entries: tuple[Entry, ...]
    removed: tuple[Entry, ...] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Numbers and bytes, by kind."""
        kinds = {what: _sums(entries) for what, entries in sorted(_by_kind(self.entries).items())}
        folder = None if self.folder is None else str(self.folder)
        return {"folder": folder, "kept": kinds, "removed": None if self.removed is None else _sums(self.removed)}

    def __str__(self) -> str:
        if self.folder is None:
            from maskfab.runs.store import VARIABLE

            return f"The cache is off, or has no place that only you may write; {VARIABLE} names another folder."
        now = time.time()
        lines = [str(self.folder)]
        for what, entries in sorted(_by_kind(self.entries).items(), key=lambda item: -_sums(item[1])["bytes"]):
            days = (now - max(entry.used for entry in entries)) / _DAY_S
            lines.append(_line(entries, f"{what}, used {days:.1f} days ago"))
        lines.append(_line(self.entries, "in all"))
        return "\n".join(lines if self.removed is None else [*lines, _line(self.removed, "removed")])


@checked_arguments
def cache(limit: Annotated[str | None, "--limit SIZE"] = None) -> Kept:
    """Tell what earlier runs have found, which later ones take from there, and remove what was used longest ago.

    Examples:
        $ maskfab self cache
        $ maskfab self cache --limit '1 GB'
        >>> import maskfab as mf
        >>> print(mf.cache(limit="1 GB"))                                              # doctest: +SKIP

    Args:
        limit: remove what was used longest ago until the rest takes no more, such as ``"1 GB"``, 0.

    Raises:
        JobError: MF105 for what is no size.
    """
    from maskfab.runs.store import Store

    most, store = None if limit is None else _bytes(limit), Store.of_user()
    if store is None:
        return Kept(None, ())
    removed = None if most is None else store.prune(most)
    return Kept(store.folder, tuple(store.entries()), removed)


def _by_kind(entries: Iterable[Entry]) -> dict[str, list[Entry]]:
    kinds: dict[str, list[Entry]] = {}
    for entry in entries:
        kinds.setdefault(entry.what, []).append(entry)
    return kinds


def _sums(entries: Iterable[Entry]) -> dict[str, int]:
    sizes = [entry.bytes for entry in entries]
    return {"entries": len(sizes), "bytes": sum(sizes)}


def _line(entries: Iterable[Entry], words: str) -> str:
    sums = _sums(entries)
    return f"{sums['bytes'] / 1e6:9.1f} MB  {sums['entries']:6}  {words}"


def _bytes(text: str) -> int:
    number, _, unit = text.strip().partition(" ")
    try:
        value = float(number)
        value *= 1.0 if value == 0 and not unit else _UNITS[unit.strip()]
    except (ValueError, KeyError):
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise JobError("MF105", f"{text!r} is no size", where="limit", cure="Give a number and kB, MB or GB: '1 GB'")
    return int(value)


@dataclass(frozen=True, eq=False, repr=False)
class Benchmark(Result):
    """Time and error of every method.

    Attributes:
        timings: by contestant.
        bound_ms: processor time of the matrix products alone, by precision.
        absent: libraries that are not installed, and why.
        unused: keys and tables that the job states and the race does not depend on.
    """

    timings: Sequence[Timing]
    bound_ms: Mapping[str, float]
    absent: Mapping[str, str]
    unused: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Everything that was measured."""
        from maskfab.trials import race as accuracy_page

        return {**accuracy_page.race_document(self.timings, self.bound_ms, self.absent), "unused": list(self.unused)}

    def picture(self) -> bytes:
        """A PNG of error against time."""
        from maskfab.trials import race as accuracy_page

        race = accuracy_page.Race(self.timings, self.bound_ms)
        return accuracy_page.race_figure({"speed against error": race})

    def save(self, out: Annotated[str | Path, "FOLDER"]) -> list[Path]:
        """Write figure and results into a new directory.

        Args:
            out: new folder for the figure and the results.
        """
        from maskfab.trials import race as accuracy_page

        return accuracy_page.write_accuracy(Path(out), self.to_dict(), self.picture())

    def __str__(self) -> str:
        from maskfab.job.reference import in_words
        from maskfab.trials import race as accuracy_page

        return "\n".join([*accuracy_page.race_table(self.timings, self.bound_ms, self.absent), *in_words(self.unused)])

    def _repr_png_(self) -> bytes:
        return self.picture()


@dataclass(frozen=True, eq=False, repr=False)
class HardCases(Result):
    """Outcomes of the hard cases."""

    outcomes: Sequence[CaseResult]

    @property
    def passed(self) -> bool:
        """Whether every case keeps its bound."""
        return all(outcome.passed for outcome in self.outcomes)

    def to_dict(self) -> dict[str, Any]:
        """Every case."""
        from maskfab.trials import race as accuracy_page

        return accuracy_page.case_document(self.outcomes)

    def __str__(self) -> str:
        from maskfab.trials import race as accuracy_page

        return "\n".join(accuracy_page.case_table(self.outcomes))


@checked_arguments
def bench(
    job: AnyJob | None = None,
    *,
    die: str | None = None,
    rounds: Annotated[int, "2..1000"] = 9,
    hard: bool = False,
    progress: Progress = silent,
) -> Benchmark | HardCases:
    """Time every PSF method and compare each with the exact one, or run the hard cases.

    Examples:
        $ maskfab self bench --out bench
        $ maskfab self bench layouts/upc12.toml --die TOLED_R150
        $ maskfab self bench --hard

    Args:
        job: job file (.toml); by default a standard panel.
        die: die of the job; by default the first.
        rounds: number of timed rounds.
        hard: run the hard cases instead.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a die that the job does not have.
    """
    from maskfab.api.asked import dies_of, job_of
    from maskfab.job.reference import USES, unused
    from maskfab.trials import race as accuracy

    if hard:
        from maskfab.trials.hard_cases import CASES, run_cases

        return HardCases(tuple(run_cases(CASES)))
    left: tuple[str, ...] = ()
    if job is None:
        workload = accuracy.standard_workload()
    else:
        loaded = job_of(job)
        loaded.check_window()
        left = unused(loaded.spec, *USES["self bench"])
        panels = {one.name: one.panel for one in loaded.plate().dies}
        workload = accuracy.workload_of(panels[dies_of(die, panels)[0]], loaded.camera)
    timings = accuracy.race(workload, rounds, progress)
    return Benchmark(timings, accuracy.gemm_bound_ms(workload), accuracy.absent(), left)


_PROGRAM = """\
@software{{maskfab,
  title   = {{maskfab: photomask plates for under-panel cameras}},
  version = {{{version}}},{note}
}}"""
_PAPER = """\
@article{yang2021display,
  author  = {Yang, Anqi and Sankaranarayanan, Aswin C.},
  title   = {Designing Display Pixel Layouts for Under-Panel Cameras},
  journal = {IEEE Transactions on Pattern Analysis and Machine Intelligence},
  year    = {2021}
}"""


@dataclass(frozen=True, repr=False)
class Citation(Result):
    """Entries for a bibliography.

    Attributes:
        program: of maskfab in the version that is cited.
        paper: of the work whose experiment it is for.
    """

    program: str
    paper: str

    def __str__(self) -> str:
        return f"{self.program}\n\n{self.paper}"

    def to_dict(self) -> dict[str, str]:
        """The entries."""
        return {"program": self.program, "paper": self.paper}


@checked_arguments
def cite(directory: AnyPath | None = None) -> Citation:
    """Print BibTeX entries of maskfab, and of the paper whose experiment it is for.

    Examples:
        $ maskfab self cite
        $ maskfab self cite build/upc12

    Args:
        directory: a finished run, whose version and job are cited, or its result; by default this installation.

    Raises:
        OutputError: MF403 if it is none.
    """
    if directory is None:
        return Citation(_PROGRAM.format(version=__version__, note=""), _PAPER)
    from maskfab.api.asked import folder_of
    from maskfab.base.folders import read_manifest

    manifest = read_manifest(folder_of(directory, "cite", "directory"))
    note = f"\n  note    = {{job {str(manifest.get('job_hash'))[:16]}}},"
    return Citation(_PROGRAM.format(version=manifest["maskfab_version"], note=note), _PAPER)
