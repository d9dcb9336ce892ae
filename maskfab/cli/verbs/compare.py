"""``maskfab compare``: finished reports side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from maskfab.cli.common.options import Json
from maskfab.cli.common.printing import print_found


def compare(
    reports: Annotated[
        list[Path], typer.Argument(metavar="REPORT...", help="Finished runs, or report.json files; of one, its dies.")
    ],
    die: Annotated[
        list[str] | None, typer.Option(help="Compare this die: DIE, or RUN:DIE; may be given several times.")
    ] = None,
    reference: Annotated[
        str | None, typer.Option(help="Die that gains are over; default: that of the first report.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Directory for a page with the figure.")] = None,
    as_json: Json = False,
) -> None:
    """Put dies of finished runs side by side: who is best and how sure, what cannot be compared, how jobs differ."""
    from maskfab.api.verbs.comparing import compare as side_by_side
    from maskfab.base.folders import check_target

    if out is not None:
        check_target(out, force=False)
    found = side_by_side(*reports, dies=die or (), reference=reference)
    print_found(found, as_json)
    if out is not None:
        typer.echo(found.save(out), err=as_json)
