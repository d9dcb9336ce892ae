"""``maskfab doctor``: the installation examined."""

from __future__ import annotations

from maskfab.cli.common.options import Json, Quiet
from maskfab.cli.common.printing import leave, print_found
from maskfab.cli.common.watch import watched


def doctor(as_json: Json = False, quiet: Quiet = False) -> None:
    """Examine this installation: versions, threads, memory, optional parts, and a self-test that takes seconds."""
    from maskfab.api.verbs.examining import doctor as examine

    with watched(quiet) as progress:
        found = examine(progress=progress)
    print_found(found, as_json)
    leave(found.passed)
