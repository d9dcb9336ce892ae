"""``maskfab package``: one zip for a mask shop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import JobFile, Json, Quiet
from maskfab.cli.common.printing import leave, print_json, summarise
from maskfab.cli.common.shop_verdict import findings_document, print_findings, tell_age
from maskfab.cli.common.watch import watched


def package(
    job: JobFile,
    shop: Annotated[str, typer.Option(help="Mask shop to pack for: a name from maskfab shops, or a profile (.toml).")],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE.zip|FOLDER", help="The package, or a folder, where it is named by plate, shop and revision."
        ),
    ] = Path(),
    format_: Annotated[
        list[str] | None, typer.Option("--format", help="Output format (repeatable); default: the shop's first.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an earlier file, but no other revision.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Pack a plate for a mask shop (mask files, order sheet, drawing, job, certificate) if it keeps the rules."""
    from maskfab.api.verbs.shops import package as pack_job
    from maskfab.job.reference import in_words
    from maskfab.mask.houses.profiles import load_shop

    profile = load_shop(shop)
    tell_age(profile)
    with watched(quiet) as progress:
        made = pack_job(job, shop, out, formats=format_ or (), force=force, progress=progress)
    if as_json:
        from maskfab.report.rows.text import quantity_document

        print_json(
            {
                "verdict": "pass" if made.path is not None else "fail",
                "shop": profile.name,
                "package": None if made.path is None else str(made.path),
                "files": [vars(file) for file in made.files],
                "refused_by": list(made.refused_by),
                "rules": findings_document(made.findings),
                "answer": made.answer,
                "mail": made.mail,
                "checks": [quantity_document(check) for check in made.checks],
                "blanks": [each.key for each in made.missing],
                "unused": list(made.unused),
            }
        )
    else:
        print_findings(made.findings, profile.name, made.mail, made.refused_by)
        if made.checks:
            from maskfab.report.rows.verdicts import Verdicts

            summarise(made.checks, Verdicts.of(made.checks, {}, 0))
        if made.missing:
            keys = ", ".join(each.key for each in made.missing)
            typer.echo(f"blank on the order sheet, for [order] does not state them: {keys}")
        for line in in_words(made.unused):
            typer.echo(line)
        if made.path is not None:
            typer.echo(made.path)
    leave(made.path is not None)
