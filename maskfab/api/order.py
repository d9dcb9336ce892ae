"""Orders: mask houses with published rules, which of them takes a plate, the blanks of the order, and the package."""

from __future__ import annotations

import os
import shlex
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, overload

from maskfab.api.asked import AnyJob, laid_out
from maskfab.api.results import Asked, Result, Told, answers, verdict_lines
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.quantities import columns
from maskfab.base.work import Progress, one_thread, silent
from maskfab.job.reference import USES, in_words, unused
from maskfab.job.shop import Shop
from maskfab.job.values import SHOP_FORMATS
from maskfab.mask.houses.files import check_package
from maskfab.mask.houses.findings import Finding, Taken, accepted, answer_of, mail_of
from maskfab.mask.houses.order import OrderForm, write_answers
from maskfab.mask.houses.profiles import load_shop, shop_names, shop_of
from maskfab.mask.job import Job
from maskfab.mask.package.pack import Bid, Package, compare_shops
from maskfab.mask.package.pack import pack as pack_plate

_LINE, _LEAST = 100, 30
"""Columns of a table, and the fewest of its last column."""
_SECTIONS = ("accepts", "limits", "plate", "names", "blocks", "text", "polygons", "tolerance", "offers", "order")


class Shops(tuple[Shop, ...]):
    """Mask houses; ``print(shops)`` is a table, of one house all its rules with their sources."""

    def __new__(cls, shops: Iterable[Shop], *, one: bool = False) -> Shops:
        made = super().__new__(cls, tuple(shops))
        made.one = one
        return made

    one: bool

    def to_dict(self) -> dict[str, Any]:
        """Everything that the profiles say; null is what a house does not publish."""
        documents = [_document(shop) for shop in self]
        return documents[0] if self.one else {"shops": documents}

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        if self.one:
            return "\n".join(_rules(self[0]))
        rows = [("shop", "formats", "min feature", "house")]
        for shop in self:
            least = shop.limits.min_feature_um
            formats = "not published" if shop.accepts.formats is None else " ".join(shop.accepts.formats)
            rows.append((shop.name, formats, "-" if least is None else f"{least:g} um", shop.title))
        return "\n".join(columns(rows))


def _document(shop: Shop) -> dict[str, Any]:
    document: dict[str, Any] = shop.model_dump(mode="json")
    # JSON has no infinity: a tolerance without an upper width holds for all others.
    document["tolerance"]["cd_um"] = [
        [None if width == float("inf") else width, deviation] for width, deviation in shop.tolerance.cd_um
    ]
    return document


def _rules(shop: Shop) -> Iterator[str]:
    yield f"{shop.name}: {shop.title}"
    said = shop.model_dump(mode="python", exclude_none=True)
    for section in _SECTIONS:
        for key, value in said[section].items():
            if value not in ((), {}):
                yield f"  {section}.{key} = {_told(value)}"
    yield from (f"  source {source}" for source in shop.sources)
    if shop.read_on is not None:
        yield f"  read on {shop.read_on}"
    yield from (f"  not from a page of the house: {key}" for key in shop.third_party)


def _told(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(_told(item) for item in value)
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_told(item)}" for key, item in value.items())
    return (
        "yes" if value is True else "no" if value is False else f"{value:g}" if isinstance(value, float) else str(value)
    )


def _age(shops: Iterable[Shop]) -> Sequence[str]:
    """Sentences on rules that were read long ago; no paper says so, for papers must not change with the day."""
    return [
        f"note: the rules of {shop.name} were read on {shop.read_on}, over two years ago: ask whether they hold"
        for shop in shops
        if shop.outdated(date.today())
    ]


@checked_arguments
def list(name: Annotated[str | None, "SHOP"] = None) -> Shops:
    """List the mask shops with published rules, or show the rules of one with their sources.

    Examples:
        $ maskfab order list
        $ maskfab order list generic-chrome --json
        >>> import maskfab as mf
        >>> mf.order.list("photoplotstore")[0].accepts.formats[0]
        'gdsii'

    Args:
        name: name of a shop, or the path of a profile (.toml); by default all shops.

    Raises:
        OutputError: MF420 or MF421 for the profile.
    """
    return Shops(map(load_shop, shop_names() if name is None else [name]), one=name is not None)


@answers(list)
def _list(asked: Asked) -> Told:
    shops = asked.found()
    return replace(Told.of(shops), remarks=_age(shops))


class Bids(tuple[Bid, ...]):
    """Houses against one plate, those that take it first, then those to ask; ``print(bids)`` is a table.

    Attributes:
        unused: keys and tables that the job states and no house's answer depends on.
    """

    unused: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether any house takes the plate, or may once it is asked."""
        return any(bid.answer != "does not" for bid in self)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "shops": [
                {
                    "shop": bid.shop,
                    "title": bid.title,
                    "answer": bid.answer,
                    "taken": bid.taken,
                    "format": bid.format,
                    "changes": [*bid.changes],
                    "refusals": [vars(finding) for finding in bid.refusals],
                    "to_agree": [vars(finding) for finding in bid.agreed],
                    "to_ask": [vars(finding) for finding in bid.asked],
                    "mail": bid.mail,
                    "blanks": [*bid.blanks],
                }
                for bid in self
            ],
            "unused": [*self.unused],
        }

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        rows = [("shop", "takes it", "format", "blanks", "changes, what to ask, or why not")]
        for bid in self:
            reason = ", ".join(bid.changes) or "-"
            if bid.answer == "does not":
                reason = "; ".join(finding.value_text for finding in bid.refusals)
            elif bid.asked:
                reason = "; ".join(
                    filter(None, (f"ask: {', '.join(finding.rule for finding in bid.asked)}", *bid.changes))
                )
            answer = {"takes it": "yes", "ask first": "ask first", "does not": "no"}[bid.answer]
            rows.append((bid.shop, answer, bid.format, str(len(bid.blanks)), reason))
        widths = [max(len(row[k]) for row in rows) for k in range(4)]
        room = max(_LINE - sum(widths) - 2 * len(widths), _LEAST)
        lines = []
        for *cells, reason in rows:
            first, *more = textwrap.wrap(reason, room) or [""]
            start = "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
            lines += [f"{start}  {first}".rstrip(), *(" " * (len(start) + 2) + line for line in more)]
        for keys in dict.fromkeys(bid.blanks for bid in self if bid.blanks):
            at = [bid.shop for bid in self if bid.blanks == keys]
            reason = f"blank at {'all' if len(at) == len(self) else ', '.join(at)}: {', '.join(keys)}"
            lines += ["", *textwrap.wrap(reason, _LINE)]
        for mail in dict.fromkeys(bid.mail for bid in self if bid.answer == "ask first"):
            to = ", ".join(bid.shop for bid in self if bid.answer == "ask first" and bid.mail == mail)
            lines += ["", *textwrap.wrap(f"to ask, ready for a mail: {to}", _LINE)]
            lines += [
                line
                for text in mail.split("\n")
                for line in textwrap.wrap(text, _LINE, initial_indent="  ", subsequent_indent="  ")
            ]
        if any(bid.answer == "does not" for bid in self):
            lines += ["", "where, and what to do: maskfab order pack JOB --shop NAME --dry-run"]
        return "\n".join([*lines, *in_words(self.unused)])


@checked_arguments
@one_thread
def compare(job: AnyJob, shop: Annotated[str | None, "<SHOP>"] = None, *, progress: Progress = silent) -> Bids:
    """Show which mask shops take the plate of a job, and why others do not.

    Examples:
        $ maskfab order compare layouts/upc12.toml

    Args:
        job: job file (.toml), held against the rules of all shops, also of one that it names by a profile of its own.
        shop: name of the only shop to look at, or the path of a profile (.toml).
        progress: told where the work stands.

    Raises:
        OutputError: MF420 or MF421 for the profile.
        JobError: as for the job.
    """
    houses = {name: load_shop(name) for name in (shop_names() if shop is None else [shop])}
    loaded, plate = laid_out(job, Job.plate, *(() if shop is not None else [_own_house]))
    own = _own_house(loaded) if shop is None else None
    houses |= {} if own is None else {own.name: own}
    bids = compare_shops(loaded.spec, plate, tuple(houses.values()), progress)
    ranked = Bids(sorted(bids, key=lambda bid: get_args(Taken).index(bid.answer)))
    ranked.unused = unused(loaded.spec, *USES["order compare"])
    return ranked


def _own_house(job: Job) -> Shop | None:
    return shop_of(job.spec, job.where)


class Filled(Result):
    """Findings of ``order fill``, and the lines that it wrote; ``print(filled)`` says it.

    Attributes:
        form: the order with all that is answered; its ``questions`` are what is left.
        written: keys of the job file that were written.
        next: the command that makes the package.
        unused: keys and tables that the job states and the order does not depend on.
    """

    def __init__(
        self, form: OrderForm, written: tuple[str, ...], next_command: str, unused: tuple[str, ...] = ()
    ) -> None:
        self.form, self.written, self.next, self.unused = form, written, next_command, unused

    @property
    def passed(self) -> bool:
        """Whether nothing is blank, and the house offers all that is asked for."""
        return not self.form.questions and not self.form.refused

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        order = self.form.order
        return {
            "shop": self.form.shop.name,
            "complete": self.passed,
            "missing": [vars(question) for question in self.form.questions],
            "refused": [vars(refusal) for refusal in self.form.refused],
            "written": [*self.written],
            "order": [vars(answer) for answer in order.answers],
            "next": self.next,
            "unused": [*self.unused],
        }

    def __str__(self) -> str:
        lines = [f"written: {', '.join(self.written)}"] if self.written else []
        lines += [str(refusal) for refusal in self.form.refused]
        lines += [f"blank: order.{question.key}: {question}" for question in self.form.questions]
        lines += [*in_words(self.unused), f"next: {self.next}"]
        return "\n".join(lines)


@checked_arguments
def fill(job: AnyJob, shop: str, answers: Annotated[Mapping[str, str] | None, "--set KEY=VALUE"] = None) -> Filled:
    """Ask for all that an order to a mask shop still lacks, and write the answers into the job.

    On a terminal one question after the other: Enter leaves a line blank, and Ctrl-C the job as it is. Elsewhere, and
    with --json, the missing keys are named. Exit code 1 while a line is blank, or asks for what the shop does not
    offer.

    Examples:
        $ maskfab order fill job.toml --shop compugraphics
        $ maskfab order fill job.toml --shop compugraphics --set quantity=1 --set contact.name='A. Reader'
        $ maskfab order fill job.toml --shop compugraphics --json

    Args:
        job: job file (.toml).
        shop: mask shop to order from: a name from maskfab order list, or a profile (.toml).
        answers: answer to a key of [order], such as ``contact.name``; asks nothing. Each is held against what the house
            offers; all of them are written, or none. A job that names no house in [export] gets this
            one, and one without a date of its order the day of today. All else in the file stays as it is.

    Raises:
        OutputError: MF420 or MF421 for the shop, MF401 if the job cannot be written.
        JobError: MF102 to MF110 and MF128 for an answer, MF105 for one that the job has, or for a job that is no file;
            else as for the job.
        SourceError: MF308 for answers to a job that is no TOML file.
    """
    profile = load_shop(shop)
    loaded, plate = laid_out(job, Job.plate)
    form = OrderForm.of(loaded.spec, plate, profile)
    for key, text in (answers or {}).items():
        form = form.answered(key, text)
    written: tuple[str, ...] = ()
    if answers:
        if not isinstance(job, str | Path):
            cure = "Give the path of a job file, or state [order] in the plate's sections"
            raise JobError("MF105", "answers are written into a file, and this job is none", where="job", cure=cure)
        named = shop if shop in shop_names() else os.path.relpath(shop, Path(job).parent)
        written = write_answers(Path(job), answers, form, named, date.today())
    name = job if isinstance(job, str | Path) else "JOB.toml"
    command = f"maskfab order pack {shlex.quote(str(name))} --shop {shlex.quote(shop)}"
    return Filled(form, written, command, unused(loaded.spec, *USES["order fill"]))


@answers(fill)
def _fill(asked: Asked) -> Told:
    stated = asked.stated.get("answers") or {}
    answered = {key.removeprefix("order."): value for key, value in stated.items()}
    filled = asked.found(answers=answered)
    for line in _age([filled.form.shop]):
        asked.tell(line)
    if asked.attended and not answered and not asked.as_json and filled.form.questions:
        answered = _typed(filled.form, asked)
        filled = asked.found(answers=answered) if answered else filled
    return Told.of(filled)


def _typed(form: OrderForm, asked: Asked) -> dict[str, str]:
    """Answers to all questions of a form, each held against the job and the house as it is typed."""
    answered: dict[str, str] = {}
    blank = f"{form.plate.name} at {form.shop.title}: {len(form.questions)} lines of the order are blank."
    asked.tell(f"{blank} Enter leaves one blank, Ctrl-C the job as it is.")
    try:
        for question in form.questions:
            if (typed := asked.answered(str(question), partial(form.answered, question.key))) is not None:
                answered[question.key], form = typed
    except KeyboardInterrupt:
        asked.tell("")
        asked.tell("The job is as it was.")
        raise
    return answered


@dataclass(frozen=True, eq=False, repr=False)
class ShopCheck(Result):
    """A plate held against the rules of a mask shop; ``mail`` asks the shop for what it does not publish."""

    shop: Shop
    findings: tuple[Finding, ...]
    digest: str
    unused: tuple[str, ...] = ()
    mail: str = ""

    @property
    def passed(self) -> bool:
        """Whether no rule is broken."""
        return accepted(self.findings)

    def to_dict(self) -> dict[str, Any]:
        """The verdict and every rule."""
        return {
            "verdict": "pass" if self.passed else "fail",
            "shop": self.shop.name,
            "job_hash": self.digest,
            "answer": answer_of(self.findings),
            "rules": [dict(vars(finding)) for finding in self.findings],
            "unused": [*self.unused],
            "mail": self.mail,
        }

    def __str__(self) -> str:
        return "\n".join([*(str(finding) for finding in self.findings), *in_words(self.unused)])


@overload
def pack(
    job: AnyJob, shop: str, out: str | Path = ..., *, dry_run: Literal[True], formats: Sequence[str] = ...,
    progress: Progress = ...
) -> ShopCheck: ...  # fmt: skip
@overload
def pack(
    job: AnyJob, shop: str, out: str | Path = ..., *, formats: Sequence[str] = ..., force: bool = ...,
    progress: Progress = ...
) -> Package: ...  # fmt: skip
@checked_arguments
@one_thread
def pack(
    job: AnyJob,
    shop: str,
    out: Annotated[str | Path, "FILE.zip|FOLDER"] = ".",
    *,
    formats: Sequence[str] = (),
    dry_run: bool = False,
    force: bool = False,
    progress: Progress = silent,
) -> Package | ShopCheck:
    """Pack a plate for a mask shop: mask files, order sheet, drawing, job, certificate; only if it keeps the rules.

    Examples:
        $ maskfab order pack layouts/upc12.toml --shop generic-chrome
        $ maskfab order pack layouts/upc12.toml --shop generic-chrome --format oasis --out upc12.zip
        $ maskfab order pack job.toml --shop generic-chrome --dry-run

    Args:
        job: job file (.toml).
        shop: mask shop to pack for: a name from maskfab order list, or a profile (.toml).
        out: the package (.zip), or a folder, in which it is named by plate, shop and revision; it appears when it is
            complete.
        formats: output format of the mask files; by default the shop's first.
        dry_run: only check the plate against the shop's rules; nothing is written.
        force: replace an earlier file, but no package of another revision, nor one of this that holds anything else.
        progress: told where the work stands.

    Raises:
        OutputError: MF401 or MF402 for the place, MF406 for a revision that would be lost, MF420 or MF421 for the shop.
        JobError: MF105 for a format that there is not; else as for the job.
    """
    profile = load_shop(shop)
    for kind in formats:
        if kind not in SHOP_FORMATS:
            cure = f"Choose among {', '.join(SHOP_FORMATS)}"
            raise JobError("MF105", f"there is no format {kind!r}", where="format", cure=cure)
    sent = tuple(kind for kind in SHOP_FORMATS if kind in formats)
    loaded, plate = laid_out(job, Job.plate)
    if dry_run:
        progress("rules", 0, 1)
        findings = check_package(loaded.spec, plate, profile, sent)
        progress("rules", 1, 1)
        left = unused(loaded.spec, *USES["order pack --dry-run"])
        return ShopCheck(profile, findings, loaded.digest, left, mail_of(plate.name, findings))
    made = pack_plate(loaded, profile, out, sent, force=force, progress=progress)
    return replace(made, unused=unused(loaded.spec, *USES["order pack"]))


@answers(pack)
def _pack(asked: Asked) -> Told:
    shop = load_shop(asked.stated["shop"])
    package = asked.found()
    if isinstance(package, ShopCheck):
        heard = _verdict(package.findings, shop.name, package.mail)
        return Told(package.to_dict(), str(package).split("\n"), package.passed, remarks=heard)
    lines = [str(finding) for finding in package.findings]
    heard = _verdict(package.findings, shop.name, package.mail, package.refused_by)
    if package.checks:
        from maskfab.report.verdicts import Verdicts

        heard += tuple(
            verdict_lines(package.checks, Verdicts.of(package.checks, {}, 0, house=package.path is not None))
        )
    if package.missing:
        keys = ", ".join(answer.key for answer in package.missing)
        lines.append(f"blank on the order sheet, for [order] does not state them: {keys}")
    lines += [*in_words(package.unused), *([] if package.path is None else [str(package.path)])]
    return Told(_packed(package, shop), lines, package.path is not None, asides=_age([shop]), remarks=heard)


def _packed(package: Package, shop: Shop) -> dict[str, Any]:
    from maskfab.report.text import quantity_document

    return {
        "verdict": "pass" if package.path is not None else "fail",
        "shop": shop.name,
        "package": None if package.path is None else str(package.path),
        "files": [vars(file) for file in package.files],
        "refused_by": [*package.refused_by],
        "rules": [dict(vars(finding)) for finding in package.findings],
        "answer": package.answer,
        "mail": package.mail,
        "checks": [quantity_document(check) for check in package.checks],
        "blanks": [answer.key for answer in package.missing],
        "unused": [*package.unused],
    }


def _verdict(findings: Sequence[Finding], shop: str, mail: str, failed: Sequence[str] = ()) -> tuple[str, ...]:
    """Sources of the rules that are broken, the verdict, and questions to the house ready for a mail."""
    refused = [finding for finding in findings if finding.passed is False]
    lines = [
        f"source of the rules: {source}" for source in dict.fromkeys(finding.source for finding in refused) if source
    ]
    if refused:
        why = ", ".join(dict.fromkeys(finding.rule for finding in refused))
        lines.append(f"REFUSED: {len(refused)} of {len(findings)} rules of {shop} broken: {why}")
    elif failed:
        why = f"the files as written fail {', '.join(failed)}"
        lines.append(f"REFUSED: {why}; {shop} is not the reason, no rule of it is")
    else:
        lines.append(f"PASS: none of {len(findings)} rules of {shop} is broken")
    if mail:
        lines += [f"ASK FIRST: {shop} does not publish all that has to be known. To paste into a mail:", ""]
        lines += mail.split("\n")
    return tuple(lines)
