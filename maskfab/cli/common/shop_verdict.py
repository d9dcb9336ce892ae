"""The verdict of a shop on a plate, as text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer

from maskfab.cli.common.printing import plain
from maskfab.errors import JobError

if TYPE_CHECKING:
    from maskfab.jobfile.shop_profile import Format
    from maskfab.shops.judge import Finding


def chosen_formats(wanted: Sequence[str]) -> tuple[Format, ...]:
    """The formats of the command line.

    Raises:
        JobError: MF105 for one that there is not.
    """
    from maskfab.jobfile.shop_profile import FORMATS

    for each in wanted:
        if each not in FORMATS:
            cure = f"Choose among {', '.join(FORMATS)}"
            raise JobError("MF105", f"there is no format {each!r}", where="--format", cure=cure)
    return tuple(each for each in FORMATS if each in wanted)


def print_findings(findings: Sequence[Finding], shop: str, *, passed: bool) -> None:
    """A line for each rule, and the verdict on stderr."""
    for finding in findings:
        typer.echo(plain(finding))
    refused = [each for each in findings if each.passed is False]
    for source in dict.fromkeys(each.source for each in refused if each.source):
        typer.echo(plain(f"source of the rules: {source}"), err=True)
    verdict = "PASS" if passed else "REFUSED"
    typer.echo(plain(f"{verdict}: {len(refused)} of {len(findings)} rules of {shop} broken"), err=True)


def findings_document(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """The rules as JSON."""
    return [dict(vars(each)) for each in findings]
