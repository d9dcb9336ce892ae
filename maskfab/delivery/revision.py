"""Packages of one plate, revision by revision: each has a name of its own, and none takes the place of another."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maskfab.delivery.archive import is_package, safe_stem, unpack
from maskfab.errors import InputError, OutputError
from maskfab.files.finished import RESULT_MARK


def package_stem(plate: str, shop: str, revision: str | None) -> str:
    """Name of a package's folder, and of the package itself where only a folder is given for it."""
    suffix = "" if revision is None else f"_rev{safe_stem(revision)}"
    return f"{safe_stem(plate)}_{safe_stem(shop)}{suffix}"


def placed(target: Path, stem: str) -> Path:
    """The file to write: ``target`` itself, or in the folder that it is."""
    return target / f"{stem}.zip" if os.path.isdir(target) else target


def check_earlier(target: Path, revision: str | None) -> None:
    """Refuse to replace the package of another revision.

    Raises:
        OutputError: MF406.
    """
    earlier = _manifest(target)
    if earlier is not None and earlier.get("revision") != revision:
        raise OutputError(
            "MF406",
            f"{target} holds {_told(earlier.get('revision'))}, and this is {_told(revision)}",
            cure="Give --out another name, or a folder, in which each revision has a name of its own",
        )


def check_same(target: Path, manifest: Mapping[str, Any]) -> None:
    """Refuse to replace a package of the same revision that holds something else.

    Raises:
        OutputError: MF406.
    """
    earlier, revision = _manifest(target), manifest.get("revision")
    if earlier is None or revision is None or earlier == json.loads(json.dumps(manifest)):
        return
    hashes = [{row["path"]: row["sha256"] for row in each.get("files", ())} for each in (earlier, manifest)]
    other = sorted(name for name in {**hashes[0], **hashes[1]} if hashes[0].get(name) != hashes[1].get(name))
    raise OutputError(
        "MF406",
        f"{target} holds {_told(revision)} already, and other contents: {', '.join(other) or RESULT_MARK}",
        cure="Raise order.revision in the job; or move the package elsewhere if nobody has received it",
    )


def _told(revision: object) -> str:
    return "a package without a revision" if revision is None else f"revision {revision}"


def _manifest(target: Path) -> dict[str, Any] | None:
    """The manifest of a package that is there; None where there is none, or another file."""
    if not os.path.isfile(target) or not is_package(target):
        return None
    try:
        with tempfile.TemporaryDirectory(prefix="maskfab-package-") as folder:
            unpack(target, Path(folder))
            held = json.loads((Path(folder) / RESULT_MARK).read_text(encoding="utf-8"))
    except (InputError, ValueError):
        return None
    return held if isinstance(held, dict) else None
