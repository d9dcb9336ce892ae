"""Finished output directories, kept whole: an unchanged job is made once."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from maskfab.files.finished import TIMES
from maskfab.kept.store import Store
from maskfab.provenance import sha256_of_file


def keep_result(store: Store, key: str, folder: Path, summary: object) -> None:
    """Keep every file of a finished directory but that of its times.

    Args:
        store: that keeps it.
        key: fingerprint of everything that the files depend on.
        folder: which nobody changes meanwhile.
        summary: kept with it.
    """
    hashes = {path.name: sha256_of_file(path) for path in sorted(folder.iterdir()) if path.name != TIMES}
    for name, sha256 in hashes.items():
        store.keep_file(sha256, folder / name)
    store.put(key, "run", (hashes, summary))


def give_result(store: Store, key: str, folder: Path) -> Any:
    """Put the files of a kept directory into an empty one.

    Returns:
        The summary that was kept with it, in a tuple of one. None if nothing is kept under that key, or a file of it is
        lost or damaged; the folder is then empty again.

    Raises:
        OSError: if a file cannot be written.
    """
    kept = store.get(key)
    if kept is None:
        return None
    hashes, summary = kept[0]
    if all(store.give_file(sha256, folder / name) for name, sha256 in hashes.items()):
        return (summary,)
    _remove(folder / name for name in hashes)
    return None


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)
