"""Packages with something else in them than was packed, under hashes that tell of it or that are true again."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable
from pathlib import Path


def members(package: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(package) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def repacked(package: Path, target: Path, edit: Callable[[str, bytes], bytes | None], *, honest: bool = False) -> Path:
    """The package with every member's content changed by ``edit``, and left out for None.

    Where it is to be ``honest``, its manifest tells hash and length of what it holds now, and of nothing else.
    """
    held = {name: edit(name, content) for name, content in members(package).items()}
    held = {name: content for name, content in held.items() if content is not None}
    if honest:
        (manifest,) = (name for name in held if name.endswith("/manifest.json"))
        root, document = manifest.partition("/")[0], json.loads(held[manifest])
        document["files"] = [row for row in document["files"] if f"{root}/{row['path']}" in held]
        for row in document["files"]:
            content = held[f"{root}/{row['path']}"]
            row["sha256"], row["bytes"] = hashlib.sha256(content).hexdigest(), len(content)
        held[manifest] = json.dumps(document).encode()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in held.items():
            archive.writestr(name, content)
    return target


def of_manifest(change: Callable[[dict], dict | None]) -> Callable[[str, bytes], bytes]:
    """An edit of what the manifest says, in place or as another document."""

    def edit(name: str, content: bytes) -> bytes:
        if not name.endswith("manifest.json"):
            return content
        document = json.loads(content)
        return json.dumps(change(document) or document).encode()

    return edit
