"""Mask shops, and what is sent to them."""

from __future__ import annotations

import os
import shlex
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any, get_args, overload

from maskfab.api.jobs import AnyJob, job_of
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.work import Progress, one_thread, silent
from maskfab.job.reference import USES, in_words, unused
from maskfab.job.shop import Shop
from maskfab.job.values import SHOP_FORMATS, ShopFormat
from maskfab.mask.houses.findings import Taken
from maskfab.mask.houses.order import OrderForm, write_answers
from maskfab.mask.houses.profiles import load_shop, shop_names, shop_of
from maskfab.mask.package.pack import Bid, Package, compare_shops, pack

_LINE, _LEAST = 100, 30
"""Columns of a table, and the fewest of its last column."""


class Comparison(tuple[Bid, ...]):
    """Houses against one plate, those that take it first, then those to ask; ``print(comparison)`` is a table.

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
                    "changes": list(bid.changes),
                    "refusals": [vars(each) for each in bid.refusals],
                    "to_agree": [vars(each) for each in bid.agreed],
                    "to_ask": [vars(each) for each in bid.asked],
                    "mail": bid.mail,
                    "blanks": list(bid.blanks),
                }
                for bid in self
            ],
            "unused": list(self.unused),
        }

    def __str__(self) -> str:
        rows = [("shop", "takes it", "format", "blanks", "changes, what to ask, or why not")]
        for bid in self:
            told = ", ".join(bid.changes) or "-"
            if bid.answer == "does not":
                told = "; ".join(each.told for each in bid.refusals)
            elif bid.asked:
                told = "; ".join(filter(None, (f"ask: {', '.join(each.rule for each in bid.asked)}", *bid.changes)))
            answer = {"takes it": "yes", "ask first": "ask first", "does not": "no"}[bid.answer]
            rows.append((bid.shop, answer, bid.format, str(len(bid.blanks)), told))
        widths = [max(len(row[k]) for row in rows) for k in range(4)]
        room = max(_LINE - sum(widths) - 2 * len(widths), _LEAST)
        lines = []
        for *cells, told in rows:
            first, *more = textwrap.wrap(told, room) or [""]
            start = "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
            lines += [f"{start}  {first}".rstrip(), *(" " * (len(start) + 2) + each for each in more)]
        for keys in dict.fromkeys(bid.blanks for bid in self if bid.blanks):
            at = [bid.shop for bid in self if bid.blanks == keys]
            told = f"blank at {'all' if len(at) == len(self) else ', '.join(at)}: {', '.join(keys)}"
            lines += ["", *textwrap.wrap(told, _LINE)]
        for mail in dict.fromkeys(bid.mail for bid in self if bid.answer == "ask first"):
            to = ", ".join(bid.shop for bid in self if bid.answer == "ask first" and bid.mail == mail)
            lines += ["", *textwrap.wrap(f"to ask, ready for a mail: {to}", _LINE)]
            lines += [
                line
                for text in mail.split("\n")
                for line in textwrap.wrap(text, _LINE, initial_indent="  ", subsequent_indent="  ")
            ]
        if any(bid.answer == "does not" for bid in self):
            lines += ["", "where, and what to do: maskfab check JOB --shop NAME"]
        return "\n".join([*lines, *in_words(self.unused)])


@overload
def shops(name: None = None, *, compare: None = None, progress: Progress = ...) -> tuple[Shop, ...]: ...
@overload
def shops(name: str, *, compare: None = None, progress: Progress = ...) -> Shop: ...
@overload
def shops(name: str | None = None, *, compare: AnyJob, progress: Progress = ...) -> Comparison: ...
@checked_arguments
@one_thread
def shops(
    name: str | None = None, *, compare: AnyJob | None = None, progress: Progress = silent
) -> Shop | tuple[Shop, ...] | Comparison:
    """All mask shops with published rules, or the rules of one; with ``compare``, which of them take a plate.

    Examples:
        >>> import maskfab as mf
        >>> mf.shops("photoplotstore").accepts.formats[0]
        'gdsii'

    Args:
        name: of a shop, or the path of a profile (.toml).
        compare: a plate, a loaded job, or the path of a job file: held against the rules of all shops, also of one that
            the job names by a profile of its own, or of the shop that is named.
        progress: of a comparison.

    Raises:
        OutputError: MF420 or MF421 for the profile.
        JobError: as for the job.
    """
    if compare is None:
        return tuple(map(load_shop, shop_names())) if name is None else load_shop(name)
    job = job_of(compare)
    if name is not None:
        known = {name: load_shop(name)}
    else:
        known = {each: load_shop(each) for each in shop_names()}
        own = shop_of(job.spec, job.where)
        known |= {} if own is None else {own.name: own}
    bids = compare_shops(job.spec, job.plate(), tuple(known.values()), progress)
    found = Comparison(sorted(bids, key=lambda bid: get_args(Taken).index(bid.answer)))
    found.unused = unused(job.spec, *USES["shops"])
    return found


class Ordered:
    """Findings of :func:`order`, and the lines that it wrote; ``print(ordered)`` says it.

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
            "missing": [vars(each) for each in self.form.questions],
            "refused": [vars(each) for each in self.form.refused],
            "written": list(self.written),
            "order": [vars(each) for each in order.answers],
            "next": self.next,
            "unused": list(self.unused),
        }

    def __str__(self) -> str:
        lines = [f"written: {', '.join(self.written)}"] if self.written else []
        lines += [str(each) for each in self.form.refused]
        lines += [f"blank: order.{each.key}: {each}" for each in self.form.questions]
        lines += [*in_words(self.unused), f"next: {self.next}"]
        return "\n".join(lines)


@checked_arguments
def order(job: AnyJob, shop: str, answers: Mapping[str, str] | None = None) -> Ordered:
    """List the blanks of an order of a job to a house; with ``answers``, which are written into the job file.

    Args:
        job: a plate, a loaded job, or the path of a job file; to be written to, a path of TOML.
        shop: the house's name, or the path of a profile.
        answers: texts to keys of [order]: ``{"quantity": "1", "contact.name": "A. Reader"}``. Each is held against
            what the house offers; all of them are written, or none. A job that names no house in [export] gets this
            one, and one without a date of its order the day of today. All else in the file stays as it is.

    Raises:
        OutputError: MF420 or MF421 for the shop, MF401 if the job cannot be written.
        JobError: MF102 to MF110 and MF128 for an answer, MF105 for one that the job has, or for a job that is no file;
            else as for the job.
        SourceError: MF308 for answers to a job that is no TOML file.
    """
    loaded, profile = job_of(job), load_shop(shop)
    form = OrderForm.of(loaded.spec, loaded.plate(), profile)
    for key, text in (answers or {}).items():
        form = form.answered(key, text)
    written: tuple[str, ...] = ()
    if answers:
        if not isinstance(job, str | Path):
            cure = "Give the path of a job file, or state [order] in the plate's sections"
            raise JobError("MF105", "answers are written into a file, and this job is none", where="job", cure=cure)
        named = shop if shop in shop_names() else os.path.relpath(shop, Path(job).parent)
        written = write_answers(Path(job), answers, form, named, date.today())
    told = job if isinstance(job, str | Path) else "JOB.toml"
    command = f"maskfab package {shlex.quote(str(told))} --shop {shlex.quote(shop)}"
    return Ordered(form, written, command, unused(loaded.spec, *USES["order"]))


@checked_arguments
@one_thread
def package(
    job: AnyJob,
    shop: str,
    out: str | Path = ".",
    *,
    formats: Sequence[str] = (),
    force: bool = False,
    progress: Progress = silent,
) -> Package:
    """Pack a plate for a mask shop: mask files, order sheet, drawing, job, certificate; only if it keeps the rules.

    Args:
        job: a plate, a loaded job, or the path of a job file.
        shop: its name, or the path of a profile.
        out: the package (.zip), or a folder, in which it is named by plate, shop and revision; it appears when it is
            complete.
        formats: of the mask files; by default the shop's first.
        force: replace an earlier file, but no package of another revision, nor one of this that holds anything else.
        progress: told where the work stands.

    Raises:
        OutputError: MF401 or MF402 for the place, MF406 for a revision that would be lost, MF420 or MF421 for the shop.
        JobError: MF105 for a format that there is not; else as for the job.
    """
    profile, sent = load_shop(shop), formats_of(formats)
    loaded = job_of(job)
    made = pack(loaded, profile, out, sent, force=force, progress=progress)
    return replace(made, unused=unused(loaded.spec, *USES["package"]))


def formats_of(asked: Sequence[str]) -> tuple[ShopFormat, ...]:
    """Formats by their names, in the order of all.

    Raises:
        JobError: MF105 for one that there is not.
    """
    for each in asked:
        if each not in SHOP_FORMATS:
            cure = f"Choose among {', '.join(SHOP_FORMATS)}"
            raise JobError("MF105", f"there is no format {each!r}", where="format", cure=cure)
    return tuple(each for each in SHOP_FORMATS if each in asked)
