"""A run while it goes on: a line for each die as soon as something of it is known, and, if asked for, a page of them.

Who sees a wrong camera, opening or map stops the run in its first seconds. Photographs are taken from the design while
displays are still searched, optics are of the files; only the report has errors and verdicts.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from maskfab.base.errors import OutputError
from maskfab.base.folders import PAGE, check_file, write_text
from maskfab.base.model import Die, DieOptics
from maskfab.base.resources import template
from maskfab.base.work import Progress
from maskfab.display.feasibility import Feasibility
from maskfab.findings.photographs import Restored
from maskfab.optics.metrics import auc_radial_min

_EVERY_S = 0.5
"""Between two writings of the page within a stage."""
_MOST_TOLD = 60
"""Dies of which each has lines of its own; the page has those of more."""


class Live:
    """A progress that is also told of dies.

    Args:
        progress: told where the work stands, and a line for each die, of 0 steps out of 0.
        out: the run's directory, which appears when all of it is complete: the page lies elsewhere.
        page: written anew whenever something is known; None for none.
    """

    def __init__(self, progress: Progress, out: Path, page: Path | None = None, *, force: bool = False) -> None:
        """Raises OutputError MF401, MF402 for a page that cannot be written."""
        self._of_die: Any = None
        self._of_scene: Any = None
        if page is not None:
            if page.suffix.lower() not in (".html", ".htm"):
                what, cure = f"{page} is no page", "Give --live a path that ends in .html"
                raise OutputError("MF401", what, where="--live", cure=cure)
            if Path(os.path.realpath(out)) in Path(os.path.realpath(page)).parents:
                what = f"{page} lies in the run's directory, which appears when all of it is complete"
                raise OutputError("MF401", what, where="--live", cure="Give --live a path beside the directory")
            check_file(page, force=force, option="--live")
            from maskfab.report.figures import die, scene  # slow to load

            self._of_die, self._of_scene = die, scene
        self._progress, self._page, self._lock = progress, page, Lock()
        self._stage, self._end, self._written_s = "", "", -math.inf
        self._dies: dict[str, tuple[list[str], list[str]]] = {}

    def __enter__(self) -> Live:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._end = f"Stopped: {str(error) or 'from outside'}"
            self._write(now=True)

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Where the work stands."""
        self._progress(stage, done, total)
        changed, self._stage = stage != self._stage, stage
        if changed:
            self._write(now=True)

    def laid_out(self, dies: Sequence[Die]) -> None:
        """Dies, before anything is found of them."""
        side_nm = 3 * max((die.panel.pitch_nm for die in dies), default=1)
        for die in dies:
            self._dies[die.name] = [], [] if self._page is None else [self._of_die.panel_thumbnail(die.panel, side_nm)]
        for die in dies:
            self._tell(
                die.name, f"{die.panel.open_ratio:.1%} clear, {die.panel.opening.name}, {die.panel.tiling.value}"
            )

    def photographed(self, name: str, restored: Restored) -> None:
        """Photographs through a die, restored."""
        levels = sorted({score.level_db for score in restored.scores})
        found = ", ".join(f"{restored.psnr(level):.1f} dB at {level:g} dB" for level in levels)
        words = f"photographs restored to {found} of light" if levels else f"no photographs: {restored.refused}"
        shown = {}
        if self._page is not None and restored.shots:
            shown = self._of_scene.front(restored, restored.shots[-1].score.level_db)
        self._tell(name, words, *shown.values())

    def placed(self, displays: Mapping[str, Feasibility]) -> None:
        """Whether displays fit, by die."""
        for name, found in displays.items():
            self._tell(name, f"display: {found.footprint.verdict.value.lower()}")

    def measured(self, optics: DieOptics) -> None:
        """PSF and MTF of the die as its files draw it."""
        middle = sorted(optics.mtfs, key=lambda mtf: mtf.wavelength_nm)[len(optics.mtfs) // 2]
        area = auc_radial_min(middle, optics.die.name).value
        pictures = () if self._page is None else (self._of_die.psf_thumbnail(optics.psfs[len(optics.psfs) // 2]),)
        self._tell(optics.die.name, f"worst MTF {area:.3f} on average at {middle.wavelength_nm:g} nm", *pictures)

    def ended(self, folder: Path) -> None:
        """The run's directory is complete."""
        if self._page is not None:
            at = os.path.relpath(folder / PAGE, self._page.parent)
            self._end = Markup('Complete: <a href="{}">the report</a>').format(quote(at))
        self._write(now=True)

    def _tell(self, name: str, words: str, *pictures: str) -> None:
        with self._lock:
            said, seen = self._dies.setdefault(name, ([], []))
            said.append(words)
            seen.extend(pictures)
        if len(self._dies) <= _MOST_TOLD:
            self._progress(f"{name}: {words}", 0, 0)
        self._write()

    def _write(self, *, now: bool = False) -> None:
        # The page holds every die: to write it for each would take the square of their number.
        if self._page is None or not (now or time.monotonic() - self._written_s > _EVERY_S):
            return
        self._written_s = time.monotonic()
        from maskfab.report.pages.template import page_environment, style  # slow to load

        # Whoever moves the folder of the page does not end the run with it.
        with self._lock, suppress(OutputError, OSError):
            page = page_environment().from_string(template("live.html.j2"))
            dies = {name: (said, [Markup(picture) for picture in seen]) for name, (said, seen) in self._dies.items()}
            write_text(self._page, page.render(style=style(), stage=self._stage, end=self._end, dies=dies))
