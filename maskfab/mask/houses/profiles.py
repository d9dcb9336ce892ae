"""Profiles of mask houses: the bundled ones, and those of users."""

from __future__ import annotations

import os
from pathlib import Path

from maskfab.base import resources
from maskfab.base.errors import OutputError
from maskfab.job.sections import JobSpec
from maskfab.job.shop import Shop, parse_shop, read_shop

_FOLDER = "export_templates/shops"


def shop_names() -> tuple[str, ...]:
    """Names of the bundled profiles, sorted."""
    return tuple(sorted(path.stem for path in resources.path(_FOLDER).glob("*.toml")))


def load_shop(name: str) -> Shop:
    """A profile by its name, or one of your own by the path of its file, which ends in .toml.

    Raises:
        OutputError: MF420 if there is no such profile, with the names of those that there are; MF421 if it is
            malformed.
    """
    names = shop_names()
    path = Path(name) if name.endswith(".toml") else None
    if path is None and name in names:
        path = resources.path(f"{_FOLDER}/{name}.toml")
    if path is None or not os.path.isfile(path):
        what = f"there is no shop {name!r}"
        raise OutputError("MF420", what, cure=f"Name one of {', '.join(names)}, or a profile of your own.toml")
    return read_shop(path)


def shop_of(spec: JobSpec, where: str) -> Shop | None:
    """The mask house that the [export] of a loaded job names, its own profile as the job keeps it; None without one."""
    name = None if spec.export is None else spec.export.shop
    if name is None:
        return None
    text = spec.shops.get(name)
    return load_shop(name) if text is None else parse_shop(text, Path(name).stem, where=f"{where}: shops.{name}")
