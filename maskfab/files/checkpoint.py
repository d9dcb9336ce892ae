"""A run's state on disk, so that it can be cut off anywhere and go on to the same result.

The state is written aside and renamed, so a file of that name is always whole. It holds plain arrays, no code.
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import SourceError
from maskfab.files.atomic import partial

State = Mapping[str, NDArray[np.generic]]
RUN = "run"
"""Name of what tells a run from every other."""


def save_state(path: Path, run: str, state: State) -> None:
    """Keep the state of a run.

    Args:
        path: of the file; its directory exists.
        run: what tells this run from every other.
        state: arrays by name.

    Raises:
        OutputError: MF401 if the file cannot be written.
    """
    with partial(path) as aside, aside.open("wb") as file:
        np.savez(file, allow_pickle=False, **{RUN: np.array(run)}, **state)
        file.flush()
        os.fsync(file.fileno())


def read_state(path: Path) -> dict[str, NDArray[np.generic]]:
    """All arrays of a file that :func:`save_state` wrote, by name.

    Raises:
        SourceError: MF303 if the file is damaged, or cannot be read.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except (OSError, ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise SourceError(
            "MF303", "the checkpoint is damaged", where=str(path), cure="Delete it and start again"
        ) from error


def load_state(path: Path, run: str) -> dict[str, NDArray[np.generic]] | None:
    """The state that :func:`save_state` kept; None if there is no file.

    Raises:
        SourceError: MF303 if the file is damaged, MF304 if it is another run's.
    """
    if not os.path.exists(path):
        return None
    found = read_state(path)
    if RUN not in found or str(found.pop(RUN)) != run:
        raise SourceError(
            "MF304",
            "the checkpoint belongs to another run",
            where=str(path),
            cure="Give the settings it was made with, or delete it",
        )
    return found


@dataclass(frozen=True, eq=False)
class Kept:
    """A checkpoint that grows from stage to stage of a run.

    Attributes:
        path: of the file; its directory exists.
        key: what tells the run from every other.
        state: what is known of it so far, read from the file.

    Raises:
        SourceError: MF303, MF304 as :func:`load`.
    """

    path: Path
    key: str
    state: dict[str, NDArray[np.generic]] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.state.update(load_state(self.path, self.key) or {})

    def put(self, arrays: State) -> None:
        """Add these, or replace those of the same names, and save all; MF401 as :func:`save`."""
        self.state.update(arrays)
        save_state(self.path, self.key, self.state)
