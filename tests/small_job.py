"""A job that runs in a second, two dies of one small opening behind a stop of 0.4 mm; and the command line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from klayout import db
from once import figures_in_words

from maskfab.cli.program import run_command_line

DRAWING = """\
.......
.##.#..
.##.##.
.#...#.
.####..
...##..
.......
"""
OPENING = f'name = "ring"\npitch = "56 um"\ndots = 7\ngrid = """\n{DRAWING}"""\n'
MASK = np.array([[character == "#" for character in row] for row in reversed(DRAWING.split())])

JOB = """\
[job]
name = "SMALL"
title = "SMALL PLATE"

[camera]
focal = "5 mm"
stop = { shape = "circle", diameter = "400 um" }
wavelengths = ["530 nm"]
pixel = "2 um"
window = "64 um"

[plate]
blank = "27 mm"
writable = "22 mm"
die_size = "560 um"
die_pitch = "2 mm"
columns = 2

[[die]]
name = "PLAIN"
label = "periodic"
opening = "ring.toml"
dot = "8 um"
pitch = "56 um"
tiling = "periodic"

[[die]]
name = "TURNED"
label = "random"
opening = "ring.toml"
dot = "8 um"
pitch = "56 um"
tiling = "random"
seed = 3
"""


def look(**keys: object) -> tuple[str, ...]:
    """Options of `maskfab analyse` with the camera of the job, some of its keys otherwise."""
    return ("--camera", table({**CAMERA, **keys}), "--quiet")


def table(value: object) -> str:
    """A value of a job as TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {table(held)}' for key, held in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(table, value))}]"
    return str(value) if isinstance(value, float) else json.dumps(value)


CAMERA = {"stop": {"diameter": "400 um"}, "focal": "5 mm", "wavelengths": ["530 nm"], "window": "64 um"}
LOOK = look()
"""The camera of the job, for `maskfab analyse`."""


def write_job(folder: Path, *edits: tuple[str, str], opening: str = OPENING) -> Path:
    """The job and its opening in a folder; each edit replaces the first place where its text stands."""
    text = JOB
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "ring.toml").write_text(opening, encoding="utf-8")
    job = folder / "job.toml"
    job.write_text(text, encoding="utf-8")
    return job


def with_the_die(name: str, job: Path) -> Path:
    """The job with no other die."""
    head, *dies = job.read_text(encoding="utf-8").split("[[die]]")
    job.write_text("[[die]]".join([head, *(die for die in dies if f'name = "{name}"' in die)]), encoding="utf-8")
    return job


def finished(folder: Path, *edits: tuple[str, str], code: int = 0) -> Path:
    """The output directory of the job, run by the command line with that exit code; figures are in words."""
    out = folder / "out"
    with figures_in_words():
        assert run_command_line(["run", str(write_job(folder, *edits)), "--out", str(out), "--quiet"]) == code
    return out


def edited(source: Path, target: Path, edit: Callable[[db.Layout], object]) -> Path:
    """A mask file with something changed in its layout."""
    layout = db.Layout()
    layout.read(str(source))
    edit(layout)
    layout.write(str(target))
    return target


@dataclass(frozen=True)
class Answer:
    """What one command did."""

    code: int
    stdout: str
    stderr: str

    @property
    def document(self) -> dict:
        """The one JSON document on stdout."""
        return json.loads(self.stdout)


def command(capsys: pytest.CaptureFixture[str], *arguments: object) -> Answer:
    """Run one command in this process."""
    capsys.readouterr()
    code = run_command_line([str(argument) for argument in arguments])
    return Answer(code, *capsys.readouterr())


def listing(folder: Path) -> dict[str, bytes | None]:
    """Everything below a folder, hidden files included; the content of files, None for folders."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }
