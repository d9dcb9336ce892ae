"""``maskfab check``: feasibility of the displays of a job, or the verdict of a mask shop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.cli.common.dies import check_dies
from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import leave, print_json
from maskfab.cli.common.watch import watched
from maskfab.errors import JobError

if TYPE_CHECKING:
    from maskfab.display.feasibility import Feasibility

_RULES = """State the rules of the display maker, such as

[emitters]
gap_to_opening = "4 um"
colour_gap = "8 um"
min_width = "8 um"
"""


def check(
    job: JobFile,
    die: Annotated[list[str] | None, typer.Option(help="Die of the job (repeatable); default: all.")] = None,
    largest: Annotated[
        bool, typer.Option("--largest", help="Search for the largest emitters, even if smaller ones suffice.")
    ] = False,
    shop: Annotated[str | None, typer.Option(help="Check against this mask shop's rules instead.")] = None,
    format_: Annotated[
        list[str] | None,
        typer.Option("--format", help="With --shop: output format (repeatable); default: the shop's first."),
    ] = None,
    widest: Annotated[
        bool, typer.Option("--largest-gap", help="Also find the widest possible gap between colours.")
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check whether emitters, circuits and wires fit in the opaque area around the openings; prove it where not."""
    from maskfab.cli.common import display_json, display_text
    from maskfab.display.place import widest_gaps
    from maskfab.job import load

    if shop is not None:
        _check_shop(job, shop, format_ or (), as_json=as_json, quiet=quiet)
        return
    loaded = load(job)
    rules = loaded.display_rules
    if rules is None:
        raise JobError("MF105", "the job asks for no emitters", where=f"{job}: emitters", cure=_RULES)
    plate = loaded.plate()
    check_dies(die or (), [each.name for each in plate.dies])
    plate = replace(plate, dies=tuple(each for each in plate.dies if not die or each.name in die))
    with watched(quiet) as progress:
        built = loaded.displays_of(plate, progress, largest=largest)
        gaps = widest_gaps(plate, rules, progress) if widest else {}
    passed = all(_passes(found) for found in built.found.values())
    if as_json:
        print_json(display_json.document(built, gaps, loaded.digest, passed=passed))
    else:
        for each in built.plate.dies:
            for line in display_text.lines(each.name, built.found.get(each.name), gaps.get(each.name)):
                typer.echo(line)
    leave(passed)


def _check_shop(job: Path, shop: str, formats: Sequence[str], *, as_json: bool, quiet: bool) -> None:
    """Check the plate against the rules of a mask shop, with a cure for each violation; writes nothing."""
    from maskfab.cli.common.shop_verdict import chosen_formats, findings_document, print_findings
    from maskfab.job import load
    from maskfab.shops.adapt import blank_of
    from maskfab.shops.judge import accepted, check_shop
    from maskfab.shops.profiles import load_shop

    profile, sent = load_shop(shop), chosen_formats(formats)
    loaded = load(job)
    with watched(quiet) as progress:
        progress("rules", 0, 1)
        findings = check_shop(loaded.plate(), profile, sent, blank=blank_of(loaded.spec))
        progress("rules", 1, 1)
    passed = accepted(findings)
    if as_json:
        verdict = "pass" if passed else "fail"
        rules = findings_document(findings)
        print_json({"verdict": verdict, "shop": profile.name, "job_hash": loaded.digest, "rules": rules})
    else:
        print_findings(findings, profile.name, passed=passed)
    leave(passed)


def _passes(found: Feasibility) -> bool:
    """Not knowing is enough as long as nothing is required and no rule is broken."""
    from maskfab.display.emitters.placement import Verdict

    return found.verdict is Verdict.FITS or (
        found.verdict is Verdict.UNKNOWN and not found.required and not found.broken
    )
