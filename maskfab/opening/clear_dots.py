"""The number of clear dots of an opening, refused where no opening has it."""

from __future__ import annotations

from maskfab.errors import OpeningError


def require_clear_dots(count: int, total: int, *, where: str = "design.clear_dots") -> None:
    """Refuse a number of clear dots that no opening of ``total`` dots has.

    Raises:
        OpeningError: MF203 for none, MF204 for fewer, or more than there are.
    """
    if count == 0:
        raise closed(count, total, where=where)
    if not 0 < count <= total:
        raise OpeningError("MF204", f"{count} of {total} dots cannot be clear", where=where, cure=f"Use 1 to {total}")


def closed(
    count: int, total: int, *, where: str = "design.clear_dots", cure: str = "Set clear_dots to 1 or more"
) -> OpeningError:
    """MF203 for an opening of ``total`` dots that lets no light through."""
    return OpeningError("MF203", f"{count} of {total} dots are clear; at least 1 must be", where=where, cure=cure)
