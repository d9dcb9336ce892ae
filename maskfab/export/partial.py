"""Files that are written piece by piece and still appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maskfab.errors import OutputError


@contextmanager
def partial(path: Path) -> Iterator[Path]:
    """A name beside ``path`` to write to; renamed to ``path`` on success, removed on failure.

    Raises:
        OutputError: MF401 if the place cannot be written, or has no room left.
    """
    aside = path.with_name(f".{path.name}.partial{path.suffix}")
    try:
        yield aside
        os.replace(aside, path)
    except OSError as error:
        raise OutputError(
            "MF401", f"{path} cannot be written: {error.strerror or error}", cure="Choose another --out"
        ) from error
    finally:
        aside.unlink(missing_ok=True)


def check_size(expected: int, limit: int, path: Path, cure: str) -> None:
    """Refuse (MF415) a file that would have more bytes than allowed, before a byte of it is written."""
    if expected > limit:
        raise OutputError(
            "MF415", f"{path.name} would have about {expected / 1e6:,.0f} MB; at most {limit / 1e6:,.0f} MB", cure=cure
        )
