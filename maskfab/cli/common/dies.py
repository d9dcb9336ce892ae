"""Dies that a command line names."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from maskfab.errors import JobError


def check_dies(asked: Iterable[str], names: Collection[str]) -> None:
    """Refuse what is no die of the job.

    Raises:
        JobError: MF105 for the first of them.
    """
    for name in asked:
        if name not in names:
            listed = ", ".join(names)
            raise JobError("MF105", f"the job has no die {name!r}", where="--die", cure=f"Use one of {listed}")
