"""The size of a file, judged before it is written."""

from __future__ import annotations

from pathlib import Path

from maskfab.errors import OutputError


def check_file_size(expected: int, limit: int, path: Path, cure: str) -> None:
    """Refuse (MF415) a file that would have more bytes than allowed, before a byte of it is written."""
    if expected > limit:
        raise OutputError(
            "MF415", f"{path.name} would have about {expected / 1e6:,.0f} MB; at most {limit / 1e6:,.0f} MB", cure=cure
        )
