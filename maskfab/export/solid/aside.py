"""Files that appear whole or not at all, for writers that need a path or write piece by piece."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maskfab.errors import OutputError


@contextmanager
def aside(target: Path) -> Iterator[Path]:
    """A path beside ``target`` to write to; renamed to ``target`` on success, removed on failure.

    Raises:
        OutputError: MF401 if nothing can be written there.
    """
    place = target.with_name(f".{target.name}.{os.getpid()}.partial")
    try:
        yield place
        os.replace(place, target)
    except OSError as error:
        what = f"{target} cannot be written: {error.strerror or error}"
        raise OutputError("MF401", what, cure="Choose another --out") from error
    finally:
        place.unlink(missing_ok=True)
