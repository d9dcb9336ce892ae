"""The cases of the golden set, and what of their answers no two runs share.

A case is named GROUP/WHAT by what it shows, not by its verb; its command stands here and nowhere else.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

DROPPED = {"timing.json": "how long each stage took, and on which machine"}
"""Files of which only the presence is recorded, and why."""

MEASURED = re.compile(
    r".*\.(versions|seconds|[a-z_]+_seconds|[a-z_]+_s|started|finished|hostname|platform|threads|processors)"
)
"""Places in documents that hold durations, times of day, or what is installed: ``versions`` of a manifest name Python and
libraries, which ``golden/environment.json`` states once."""


@dataclass(frozen=True)
class Case:
    """One command.

    Attributes:
        name: group and what it shows.
        command: words after ``maskfab``, or a script after ``python``; ``--json`` is added.
        inputs: laid into its folder, see ``golden_inputs.py``.
        after: case whose folder this one goes on in.
        edits: (file, old, new) in the inputs.
        exits: exit codes that need no attention while it is recorded.
        quick: belongs to the subset for every commit.
        slow: is left out unless asked for.
        text: without ``--json``.
        shape: only the shape of the answer is recorded, for its numbers are measured.
        store: kept findings of ``after`` are at hand.
        longest_text: characters of a text that is recorded whole.
    """

    name: str
    command: str
    inputs: tuple[str, ...] = ()
    after: str = ""
    edits: tuple[tuple[str, str, str], ...] = ()
    exits: tuple[int, ...] = (0, 1, 2)
    quick: bool = False
    slow: bool = False
    text: bool = False
    shape: bool = False
    store: bool = False
    longest_text: int = 2500


SMALL = ("small.toml", "ring.toml")
LOOK = "--stop '400 um' --focal '5 mm' --wavelengths '530 nm' --window '64 um'"

CASES = (
    Case("run/small", "run small.toml --out out", SMALL, quick=True),
    Case("run/no_job", "run none.toml --out out", quick=True),
    Case("analyse/ring", f"analyse ring.toml {LOOK} --out seen", SMALL, quick=True),
    Case("verify/small", "verify out", after="run/small"),
)
