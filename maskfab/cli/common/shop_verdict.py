"""The verdict of a shop on a plate, as text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from typing import TYPE_CHECKING, Any

import typer

from maskfab.cli.common.printing import one_line

if TYPE_CHECKING:
    from maskfab.jobfile.shop_profile import Shop
    from maskfab.mask_shops.judge import Finding


def print_findings(findings: Sequence[Finding], shop: str, *, passed: bool) -> None:
    """A line for each rule, and the verdict on stderr."""
    for finding in findings:
        typer.echo(one_line(finding))
    refused = [each for each in findings if each.passed is False]
    for source in dict.fromkeys(each.source for each in refused if each.source):
        typer.echo(one_line(f"source of the rules: {source}"), err=True)
    verdict = "PASS" if passed else "REFUSED"
    typer.echo(one_line(f"{verdict}: {len(refused)} of {len(findings)} rules of {shop} broken"), err=True)


def tell_age(shop: Shop) -> None:
    """On stderr, that rules were read long ago; no paper says so, for papers must not change with the day."""
    if shop.outdated(date.today()):
        told = f"note: the rules of {shop.name} were read on {shop.read_on}, over two years ago: ask whether they hold"
        typer.echo(one_line(told), err=True)


def findings_document(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """The rules as JSON."""
    return [dict(vars(each)) for each in findings]
