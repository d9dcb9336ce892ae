"""Finished output directories, kept whole: an unchanged job is made once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from maskfab.files.finished import TIMES
from maskfab.kept.store import Finding, Origin, Store
from maskfab.provenance import sha256_of_file


def keep_result(store: Store, origin: Origin, folder: Path, summary: object, kind: Any) -> None:
    """Keep every file of a finished directory but that of its times, and make room for it.

    Args:
        store: that keeps it.
        origin: everything that the files depend on.
        folder: which nobody changes meanwhile.
        summary: kept with it.
        kind: of the summary, as a type hint states it.
    """
    hashes = {path.name: sha256_of_file(path) for path in sorted(folder.iterdir()) if path.name != TIMES}
    for name, sha256 in hashes.items():
        store.keep_file(sha256, folder / name)
    store.put(origin, (hashes, summary), tuple[dict[str, str], kind])
    store.prune()


def give_result(store: Store, origin: Origin, folder: Path, kind: Any) -> Finding | None:
    """Put the files of a kept directory into an empty one.

    Returns:
        The summary that was kept with it. None if nothing is kept of that origin, or its entry is refused, or a file of
        it is lost or damaged; the folder is then empty again.

    Raises:
        OSError: if a file cannot be written.
    """
    kept = store.get(origin, tuple[dict[str, str], kind])
    if not isinstance(kept, Finding):
        return None
    hashes, summary = kept.value
    if any(Path(name).name != name for name in hashes):
        return None
    if all(store.give_file(sha256, folder / name) for name, sha256 in hashes.items()):
        return replace(kept, value=summary)
    _remove(folder / name for name in hashes)
    return None


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)
