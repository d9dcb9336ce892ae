"""Bundled data: layouts/ and export_templates/, in a checkout and in an installed wheel alike."""

from __future__ import annotations

from pathlib import Path

from maskfab.errors import InternalError


def template(name: str) -> str:
    """Text of a file in export_templates/."""
    return path(f"export_templates/{name}").read_text(encoding="utf-8")


def path(name: str) -> Path:
    """Path of a bundled file, such as ``layouts/upc12.toml``.

    Raises:
        InternalError: MF901 if this installation lacks the file.
    """
    package = Path(__file__).resolve().parent
    for root in (package / "_bundled", package.parent):
        if (root / name).exists():
            return root / name
    raise InternalError(
        "MF901", f"the bundled file {name} is missing from this installation", cure="Install maskfab again"
    )
