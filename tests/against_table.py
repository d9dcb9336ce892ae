"""What users wait for, side by side with an earlier revision: ``make bench-against REV=61bf7920``.

The earlier one is checked out with an environment of its own into ``build/against``, and both do the same jobs in turn,
in processes of their own: one BLAS thread each, nothing kept from before unless a row says so. A row has the smallest
wall and processor time of some rounds, children counted, and the largest memory of a process. Masks have to be equal,
but for the words and codes on the plate, in which the version stands. Table and bars go into ``build/bench``.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from klayout import db

HOME = Path(__file__).resolve().parents[1]
PLATE = "layouts/upc12.toml"
OUT = "{out}"
"""Where a command of a row names the folder that it makes."""
ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

PSF = """
import time, numpy as np, maskfab as mf
bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
camera = mf.Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths="530 nm", window="256 um")
first, warm = [], []
for seed in range(7):
    panel = mf.Panel.tile(bar, "random", seed=seed, size="4.4 mm")
    for times in (first, *[warm] * 5):
        start = time.process_time()
        camera.psf(panel, "530 nm")
        times.append(time.process_time() - start)
print("seconds", min(first[1:]), np.median(warm))
"""


@dataclass(frozen=True)
class Build:
    """A checkout, and the environment that runs it."""

    name: str
    home: Path
    bin: Path


@dataclass(frozen=True)
class Spent:
    """What a process took, its children counted: seconds, seconds of a processor, bytes of the largest of them."""

    wall_s: float
    cpu_s: float
    bytes: float

    def least(self, other: Spent) -> Spent:
        return Spent(min(self.wall_s, other.wall_s), min(self.cpu_s, other.cpu_s), max(self.bytes, other.bytes))


@dataclass(frozen=True)
class Row:
    """What a user does.

    Attributes:
        command: arguments of maskfab, with :data:`OUT` where it names a folder.
        target: time of now over that of then.
        before: arguments of what is done before, uncounted, with the same cache.
        ours: a command that the earlier revision does not do; it is timed alone.
    """

    what: str
    command: Sequence[str]
    target: str
    before: Sequence[str] = ()
    ours: bool = False
    check: Callable[[Path, Path], str] = field(default=lambda one, other: "")


def checked_out(revision: str) -> Build:
    """An earlier revision beside this one, installed as its README says."""
    place = HOME / "build" / "against" / revision
    if not (place / ".git").exists():
        subprocess.run(["git", "clone", "--quiet", "--shared", str(HOME), str(place)], check=True)
    subprocess.run(["git", "-C", str(place), "checkout", "--quiet", revision], check=True)
    subprocess.run(["make", "--silent", "-C", str(place), ".venv/run.stamp"], check=True)
    return Build(revision, place, place / ".venv" / "bin")


def spent(command: Sequence[str], cache: Path, at: Path) -> Spent:
    """Run a command and say what it took; its words are kept for whoever asks why it failed."""
    environment = {**os.environ, **ALONE, "XDG_CACHE_HOME": str(cache), "PYTHONDONTWRITEBYTECODE": ""}
    with tempfile.TemporaryFile() as words:
        start = time.perf_counter()
        process = subprocess.Popen(command, cwd=at, env=environment, stdout=words, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        # A display that does not fit is an answer.
        if process.returncode not in (0, 1):
            words.seek(0)
            raise SystemExit(f"{' '.join(command)}: {words.read().decode()[-2000:]}")
    return Spent(wall, usage.ru_utime + usage.ru_stime, 1024.0 * usage.ru_maxrss)


def took(build: Build, row: Row, aside: Path) -> Spent:
    """One round of a row, with a cache of its own; the folder that it makes stays."""
    out = aside / f"out-{build.name}"
    with tempfile.TemporaryDirectory(dir=aside) as cache:
        for arguments in filter(None, (row.before, row.command)):
            shutil.rmtree(out, ignore_errors=True)
            given = [argument.replace(OUT, str(out)) for argument in arguments]
            found = spent([str(build.bin / "maskfab"), *given], Path(cache), HOME)
    return found


def psf_times(build: Build) -> tuple[float, float]:
    """Milliseconds of processor time of the first PSF of a panel, and of the next."""
    said = subprocess.run(
        [str(build.bin / "python"), "-P", "-c", PSF],
        cwd=build.home, env={**os.environ, **ALONE}, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    first, warm = map(float, re.findall(r"\d\.[\de-]+", said.splitlines()[-1]))
    return 1e3 * first, 1e3 * warm


def same_masks(one: Path, other: Path) -> str:
    """Words on the polygons of two plates: those of dies have to be equal; area that differs elsewhere is told."""
    drawn = []
    for folder in (one, other):
        layout = db.Layout()
        layout.read(str(next(folder.glob("*.gds"))))
        drawn.append(db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(1, 0))).merged())
    report = json.loads((one / "report.json").read_text())
    half = max(die["cells"][0] * die["pitch_um"] for die in report["dies"]) * 500
    dies = db.Region(
        [
            db.Box(*(round(1e3 * c + sign * half) for sign in (-1, 1) for c in die["centre_um"]))
            for die in report["dies"]
        ]
    )
    differing = drawn[0] ^ drawn[1]
    within = (differing & dies).area()
    assert not within, f"{within} nm2 of dies differ"
    return f"dies equal; {differing.area() / 1e12:.2g} mm2 of words and codes differ"


def one_die(aside: Path) -> Path:
    """The plate's job with one of its dies."""
    head, *dies = re.split(r"(?m)^(?=\[\[die\]\])", (HOME / PLATE).read_text())
    last, *sections = re.split(r"(?m)^(?=\[[a-z])", dies[-1], maxsplit=1)
    (die,) = (die for die in (*dies[:-1], last) if 'name = "FITS_M150"' in die)
    head = re.sub(r"(?m)^reference = .*$", "", head)
    return _job(aside / "one.toml", head + die + "".join(sections))


def many_dies(count: int, aside: Path) -> Path:
    """A plate of small dies behind a camera of a millimetre, each tiled by a seed of its own."""
    head = """
[job]
name = "MANY"
title = "MANY DIES"
[camera]
focal = "2.5 mm"
stop = { shape = "circle", diameter = "1 mm" }
wavelengths = ["530 nm"]
pixel = "2 um"
window = "64 um"
[plate]
template = "5in"
die_size = "2.1 mm"
die_pitch = "2.8 mm"
columns = 32
"""
    dies = (
        f'[[die]]\nname = "D{number:04}"\nlabel = "D{number:04}"\ntiling = "random"\nseed = {number}\ndot = "8 um"\n'
        f'pitch = "168 um"\nopening = "openings/{("toled", "fits", "bar")[number % 3]}.toml"\n'
        for number in range(count)
    )
    return _job(aside / f"many{count}.toml", head + "".join(dies))


def _job(path: Path, text: str) -> Path:
    """A job whose openings and maps are the project's."""
    path.write_text(re.sub(r'"((?:openings|maps)/[^"]*)"', rf'"{HOME}/layouts/\1"', text))
    return path


def rows(aside: Path, many: int) -> list[Row]:
    """Everything that is timed by a command."""
    plate = ("run", PLATE, "--out", OUT)
    one, crowd = str(one_die(aside)), str(many_dies(many, aside))
    design, sweep = "layouts/design_bar.toml", "layouts/sweeps/bias.toml"
    return [
        Row("run upc12, nothing kept", plate, "0.45x", check=same_masks),
        Row("run upc12 again, unchanged", (*plate, "--force"), "0.38x", before=plate),
        Row("run of one die with photographs", ("run", one, "--out", OUT), "0.43x"),
        Row("analyse an opening", ("analyse", "layouts/openings/fits.toml"), "0.58x"),
        Row(f"run of {many} small dies", ("run", crowd, "--out", OUT), "0.44x"),
        Row("check upc12 --look", ("check", PLATE, "--look"), "0.5x"),
        Row("order compare upc12", ("order", "compare", PLATE), "0.5x"),
        *(
            Row(f"{name}, {count} process{'es' * (count > 1)}", (*words, "--workers", str(count)), "", ours=True)
            for name, words in (
                ("run upc12", plate),
                ("design", ("design", design, "-o", OUT)),
                ("sweep", ("sweep", sweep, "-o", OUT)),
            )
            for count in (1, 2)
        ),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("revision")
    parser.add_argument("--rounds", type=int, default=2, help="of which the least counts (2)")
    parser.add_argument("--only", default="", help="rows whose words have this in them")
    parser.add_argument("--dies", type=int, default=200, help="on the plate of many (200)")
    given = parser.parse_args()
    now, then = Build("now", HOME, Path(sys.executable).parent), checked_out(given.revision)
    table = []
    with tempfile.TemporaryDirectory(prefix="maskfab-against-") as name:
        aside = Path(name)
        for row in rows(aside, given.dies):
            if given.only not in row.what:
                continue
            builds = (now,) if row.ours else (then, now)
            # In turn, for the machine may change its pace.
            found = {build.name: took(build, row, aside) for build in builds}
            for _ in range(given.rounds - 1):
                found = {build.name: found[build.name].least(took(build, row, aside)) for build in builds}
            said = "" if row.ours else row.check(aside / f"out-{then.name}", aside / "out-now")
            table.append((row.what, found.get(then.name), found["now"], row.target, said))
            print(_line(*table[-1]), flush=True)
    if given.only in "camera.psf":
        (first, warm), (first_now, warm_now) = psf_times(then), psf_times(now)
        for what, one, other in (("first", first, first_now), ("warm", warm, warm_now)):
            print(f"camera.psf, {what:29} {one:8.2f} ms  {other:8.2f} ms  {other / one:5.2f}x")
    folder = HOME / "build" / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    _draw([(what, old, new) for what, old, new, *_ in table if old], given.revision, folder / "against.png")


def _line(what: str, old: Spent | None, new: Spent, target: str, said: str) -> str:
    def words(one: Spent | None) -> str:
        return f"{'':26}" if one is None else f"{one.wall_s:7.1f} s {one.cpu_s:7.1f} s {one.bytes / 1e9:5.2f} GB"

    ratio = "" if old is None else f"{new.wall_s / old.wall_s:5.2f}x wall {new.cpu_s / old.cpu_s:5.2f}x processor"
    return f"{what:41} {words(old)}  {words(new)}  {ratio} {target and 'target ' + target}  {said}".rstrip()


def _draw(table: Sequence[tuple[str, Spent, Spent]], revision: str, path: Path) -> None:
    """Bars of processor time over that of the earlier revision."""
    from matplotlib.figure import Figure

    if not table:
        return
    figure = Figure(figsize=(7, 0.8 + 0.42 * len(table)), layout="constrained")
    axes = figure.add_subplot()
    names = [what for what, *_ in table][::-1]
    for shift, colour, label, ratio in (
        (0.2, "#0072B2", "wall", lambda old, new: new.wall_s / old.wall_s),
        (-0.2, "#E69F00", "processor", lambda old, new: new.cpu_s / old.cpu_s),
    ):
        shares = [ratio(old, new) for _, old, new in table][::-1]
        bars = axes.barh([k + shift for k in range(len(names))], shares, height=0.38, color=colour, label=label)
        axes.bar_label(bars, [f"{share:.2f}" for share in shares], padding=3, fontsize=8)
    axes.axvline(1, color="#7a828c", linewidth=0.8)
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel(f"time over that of {revision}")
    axes.margins(x=0.12)
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=8)
    figure.savefig(path, metadata={"Software": None}, dpi=130)


if __name__ == "__main__":
    main()
