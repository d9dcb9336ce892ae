"""Layouts of displays that ship, searched for anew and written where the program keeps them: ``make layouts``.

Run it after a change to a search, its version counted on, or to the openings, maps or rules of shipped jobs. What is
kept of dies that ship no more is left out.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import numpy as np

from maskfab.base.resources import path
from maskfab.display.feasibility import displays
from maskfab.display.kept_layouts import FILE, KeptLayouts, Layout
from maskfab.job.read import read
from maskfab.mask.job import load_job

USERS = ("emitter_pieces", "placement", "wiring")
"""Modules of maskfab.display that ask for layouts."""


@dataclass(frozen=True)
class Recorder(KeptLayouts):
    """Searches for everything, and keeps what is found."""

    layouts: dict[str, np.ndarray] = field(default_factory=dict)

    def layout(
        self, origin: str, proved: Callable[[Layout], bool], search: Callable[[], Layout | None]
    ) -> tuple[Layout | None, bool]:
        found = search()
        if found is not None:
            assert proved(found), "a search keeps the rules by which it is proved"
            self.layouts[origin] = found
        return found, False


def searched(jobs: Iterable[Path]) -> dict[str, np.ndarray]:
    """Everything that the displays of some jobs search for."""
    recorder = Recorder()
    with ExitStack() as patches:
        for user in USERS:
            patches.enter_context(mock.patch(f"maskfab.display.{user}.shipped", return_value=recorder))
        for job in jobs:
            displays(load_job(job))
    return recorder.layouts


def main() -> int:
    """Write the file."""
    jobs = [each for each in sorted(path("layouts").glob("*.toml")) if (spec := read(each)).emitters and spec.die]
    found = searched(jobs)
    np.savez_compressed(FILE, **dict(sorted(found.items())))
    print(f"{len(found)} layouts of {len(jobs)} jobs, {FILE.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
