"""The verdict of a shop on a plate, as text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from typing import TYPE_CHECKING, Any

import typer

from maskfab.cli.common.printing import one_line

if TYPE_CHECKING:
    from maskfab.job.shop import Shop
    from maskfab.mask.houses.findings import Finding


def print_findings(findings: Sequence[Finding], shop: str, mail: str, failed: Sequence[str] = ()) -> None:
    """A line for each rule, and the verdict on stderr.

    Args:
        findings: the house's rules.
        shop: its name.
        mail: questions to it, as one text.
        failed: checks of the files that fail.
    """
    for finding in findings:
        typer.echo(one_line(finding))
    refused = [each for each in findings if each.passed is False]
    for source in dict.fromkeys(each.source for each in refused if each.source):
        typer.echo(one_line(f"source of the rules: {source}"), err=True)
    if refused:
        told = ", ".join(dict.fromkeys(each.rule for each in refused))
        verdict = f"REFUSED: {len(refused)} of {len(findings)} rules of {shop} broken: {told}"
    elif failed:
        verdict = f"REFUSED: the files as written fail {', '.join(failed)}; {shop} is not the reason, no rule of it is"
    else:
        verdict = f"PASS: none of {len(findings)} rules of {shop} is broken"
    typer.echo(one_line(verdict), err=True)
    if mail:
        typer.echo(f"ASK FIRST: {shop} does not publish all that has to be known. To paste into a mail:\n", err=True)
        typer.echo("\n".join(map(one_line, mail.split("\n"))), err=True)


def tell_age(shop: Shop) -> None:
    """On stderr, that rules were read long ago; no paper says so, for papers must not change with the day."""
    if shop.outdated(date.today()):
        told = f"note: the rules of {shop.name} were read on {shop.read_on}, over two years ago: ask whether they hold"
        typer.echo(one_line(told), err=True)


def findings_document(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """The rules as JSON."""
    return [dict(vars(each)) for each in findings]
