"""Damaged files for every reader, each read in a process that may die or hang without harm.

    python tests/fuzz_readers.py 2000-3000 exr           the third thousand of one
    python tests/fuzz_readers.py 1000                    a thousand inputs for every reader
    python tests/fuzz_readers.py 1000 gdsii dxf          of these readers only
    python tests/fuzz_readers.py --case gdsii:17 FILE    write one input again, and say what becomes of it

An input is refused with an error of maskfab's, or reads as the original does, or reads as something else that a
comparison tells. Everything else is a finding: another exception, a process that ends, ten seconds of the processor,
two gigabytes, and geometry that is not the original's where the comparison with the original says that it is. What is
foreign is worked with as the command line does, within the limits of :mod:`maskfab.mask.sandbox`.
"""

from __future__ import annotations

import faulthandler
import io
import math
import os
import pickle
import random
import select
import subprocess
import sys
import tempfile
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import fuzz_damage
import numpy as np
from fuzz_originals import SUFFIXES, WRITTEN, clear_alone, design, file_name, job, made, mask, originals, plate
from klayout import db
from small_job import OPENING

from maskfab.base.errors import InputError, SourceError
from maskfab.base.processes import quiet
from maskfab.base.work import silent
from maskfab.display import pictures
from maskfab.display.pictures import on_pixels
from maskfab.findings.foreign import check_foreign
from maskfab.mask import opening_file, panels
from maskfab.mask.comparison.files import read_back
from maskfab.mask.comparison.roundtrip import compare_layout
from maskfab.mask.formats import gdsii, gdstk_process, gerber, gerber_process, step, step_process
from maskfab.mask.formats.content import find_cell
from maskfab.mask.formats.picture import read_picture
from maskfab.mask.formats.table import read_layout
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.marks import load_template
from maskfab.mask.package import papers
from maskfab.mask.package.pack import verify_package
from maskfab.mask.package.papers import drawing_sheet
from maskfab.mask.sandbox import bounded

try:
    import resource
except ImportError:  # not on Windows; inputs that fill memory are not bounded there
    resource = None  # type: ignore[assignment]

SECONDS = 10.0
"""Of the processor, that an input may take, whatever is done with it."""

MOST_BYTES = 2e9
"""Of memory, the same."""

_PATIENCE = 6
MAY_END = ("step",)
"""Read by libraries that end on damage the process that maskfab gives them; of layouts, :func:`bounded` tells."""

LAYOUTS = ("gdsii", "oasis", "dxf", "gerber", "cif")
PICTURES = ("png", "tiff")
TEXTS: dict[str, Callable[[Path], str]] = {
    "map": lambda path: panels.map_text(panels.read_map(path)),
    "template": lambda path: repr(load_template(path)),
    "shop": lambda path: repr(load_shop(str(path)).model_copy(update={"name": "any"})),
}
"""What these read, said in a text that is the same for the same contents."""


def damaged(reader: str, number: int) -> bytes:
    """One damaged file, the same for the same number."""
    chance = random.Random(f"{reader} {number}")
    return fuzz_damage.damaged(chance.choice(originals(reader)), SUFFIXES[reader], chance)


# --- one input -------------------------------------------------------------------------------------------------------


def outcome(reader: str, path: Path) -> str:
    """``refused CODE``, ``same``, ``seen`` or ``FINDING: ...`` for a file that stands at a path."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            if reader in LAYOUTS:
                return bounded(path, lambda _tell: _layout_outcome(reader, path), kind=str)
            if reader in PICTURES:
                return _picture_outcome(path)
            if reader == "exr":
                return _exr_outcome(path)
            if reader == "job":
                return "same" if load_job(path).spec.dump() == job().spec.dump() else "seen"
            if reader in TEXTS:
                return "same" if TEXTS[reader](path) in _texts(reader) else "seen"
            if reader in WRITTEN:
                found = read_back(made(reader), path.parent, silent)
                return "same" if all(check.passed is not False for check in found.quantities) else "seen"
            if reader == "package":
                return _package_outcome(path)
            return _opening_outcome(reader, path)
    except InputError as error:
        return f"refused {error.code}"
    except Exception as error:  # whatever it is, it is not told to the user as it should be
        return f"FINDING: {type(error).__name__}: {str(error)[:200]!r}"


def _layout_outcome(reader: str, path: Path) -> str:
    layout = read_layout(path)
    find_cell(layout)
    original = _design(reader)
    found, expected = _flat(layout), _expected(reader)
    empty = db.Region()
    differs = any(
        not (found.get(key, empty) ^ expected.get(key, empty)).is_empty() for key in found.keys() | expected.keys()
    )
    told = compare_layout(plate(), original, layout, path, dots=False)
    if differs != (told.xor_area_um2 > 0):
        return "FINDING: geometry differs, and the comparison does not tell, or the other way round"
    if zlib.crc32(path.read_bytes()) % 12:
        return "seen" if differs else "same"
    # Of one in twelve, all that a user does with such a file, from its reading to its optics.
    foreign = check_foreign(plate(), job().camera, job().spec.limits, path)
    passed = all(quantity.passed is not False for quantity in foreign.quantities)
    clear = [regions.get("1/0", empty) for regions in (found, expected)]
    if passed and not (clear[0] ^ clear[1]).is_empty():
        return "FINDING: every check of a damaged file passes"
    return "seen" if differs else "same"


def _design(reader: str) -> db.Layout:
    return clear_alone() if reader == "gerber" else design()


@cache
def _expected(reader: str) -> dict[str, db.Region]:
    return _flat(_design(reader))


def _flat(layout: db.Layout) -> dict[str, db.Region]:
    """Everything on every layer that holds polygons, flattened and merged without the help of a hierarchy."""
    regions = {}
    for info in layout.layer_infos():
        region = db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(info))).merged()
        if not region.is_empty():
            regions[f"{info.layer}/{info.datatype}" if info.layer >= 0 else info.name] = region
    return regions


def _picture_outcome(path: Path) -> str:
    found = read_picture(path)
    expected = db.Region()
    for y, x in np.argwhere(mask()).tolist():
        expected.insert(db.Box(x * 8000, y * 8000, x * 8000 + 8000, y * 8000 + 8000).moved(-28000, -28000))
    found_region = db.Region(found.top_cell().begin_shapes_rec(found.find_layer(1, 0)))
    return "same" if (found_region ^ expected).is_empty() else "seen"


def _exr_outcome(path: Path) -> str:
    """As a photograph and as an opening."""
    light = on_pixels(pictures.read_picture(path), 7, 7)
    same = light.shape == (7, 7, 3) and bool(((light > 0.5).all(axis=2) == mask()).all())
    return "same" if same and bool((opening_file.load_opening(path, dot_nm=8000).mask == mask()).all()) else "seen"


@cache
def _texts(reader: str) -> frozenset[str]:
    """What the originals say."""
    said = []
    with tempfile.TemporaryDirectory() as folder:
        for original in originals(reader):
            path = Path(folder) / f"whole{SUFFIXES[reader]}"
            path.write_bytes(original)
            said.append(TEXTS[reader](path))
    return frozenset(said)


def _package_outcome(path: Path) -> str:
    checks = verify_package(path)
    if not all(check.passed for check in checks):
        return "seen"
    with zipfile.ZipFile(path) as now, zipfile.ZipFile(io.BytesIO(originals("package")[0])) as then:
        masks = [name for name in then.namelist() if not name.endswith("manifest.json")]
        held = [name for name in masks if name in now.namelist()]
        if any(now.read(name) != then.read(name) for name in held):
            return "FINDING: a member changed, and every hash holds"
    return "same"


def _opening_outcome(reader: str, path: Path) -> str:
    opening = opening_file.load_opening(path) if reader == "toml" else opening_file.load_opening(path, dot_nm=8000)
    same = opening.mask.shape == mask().shape and bool((opening.mask == mask()).all())
    return "same" if same and opening.dot_nm == 8000 else "seen"


# --- many inputs, in processes of their own --------------------------------------------------------------------------


@dataclass
class Findings:
    """What became of the inputs of one reader: how many of each outcome, and the findings by their case."""

    reader: str
    outcomes: Counter[str] = field(default_factory=Counter)
    findings: dict[str, str] = field(default_factory=dict)
    slowest: float = 0.0
    largest: float = 0.0

    def note(self, number: int, said: str, seconds: float, size: float) -> None:
        """Seconds of the processor and bytes of memory, those of all its processes."""
        self.slowest, self.largest = max(self.slowest, seconds), max(self.largest, size)
        if seconds > SECONDS or size > MOST_BYTES:
            said = f"FINDING: {seconds:.1f} s of the processor, {size / 1e6:.0f} MB: {said}"
        if said.startswith("FINDING"):
            self.findings[f"{self.reader}:{number}"] = said
            said = "FINDING"
        self.outcomes[said] += 1

    def take(self, number: int, answer: str) -> None:
        """An outcome and what it took, as :func:`apart` tells it; nothing of the latter where the process ended."""
        said, _, cost = answer.partition("\t")
        seconds, size = (float(each) for each in cost.split()) if cost else (0.0, 0.0)
        self.note(number, said, seconds, size)


class Worker:
    """A process that reads damaged files, one after the other, and may be ended."""

    def __init__(self, reader: str) -> None:
        self.reader = reader
        self.process: subprocess.Popen[str] | None = None
        self.spent = 0.0

    def outcome(self, number: int) -> str:
        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, __file__, "--worker", self.reader],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, bufsize=1,
            )  # fmt: skip
            self.spent = 0.0
            self._answer(60.0)
        assert self.process.stdin is not None
        self.process.stdin.write(f"{number}\n")
        self.process.stdin.flush()
        self._processor_seconds()
        said = self._answer(3 * SECONDS)
        if said is None:
            self.process.kill()
            self.process.wait()
            self.process = None
            return f"FINDING: no answer within {3 * SECONDS:g} s"
        if not said:
            code = self.process.wait()
            self.process = None
            return f"FINDING: the process ended with {code}"
        return said

    def _answer(self, seconds: float) -> str | None:
        assert self.process is not None
        assert self.process.stdout is not None
        for _ in range(_PATIENCE):
            ready, _, _ = select.select([self.process.stdout], [], [], seconds)
            if ready:
                return self.process.stdout.readline().strip()
            if self._processor_seconds() > seconds / 2:
                break  # on a machine that is busy with other things it may just wait for its turn
        return None

    def _processor_seconds(self) -> float:
        """Time that the process has had of a processor since it was last asked; much where that cannot be told."""
        assert self.process is not None
        try:
            said = Path(f"/proc/{self.process.pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
        except OSError:
            return math.inf
        now = sum(int(ticks) for ticks in said[11:15]) / os.sysconf("SC_CLK_TCK")
        spent, self.spent = now - self.spent, now
        return spent

    def close(self) -> None:
        if self.process is not None:
            self.process.communicate()


def fuzz(reader: str, numbers: range) -> Findings:
    """Read the inputs of those numbers."""
    found = Findings(reader)
    worker = Worker(reader)
    for number in numbers:
        found.take(number, worker.outcome(number))
    worker.close()
    return found


def work(reader: str) -> None:
    """A worker's life: numbers on stdin, outcomes on stdout."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / file_name(reader)
        if reader == "job":
            (Path(folder) / "ring.toml").write_text(OPENING, encoding="utf-8")
        # What is imported and drawn on the way is so once, not in every copy.
        path.write_bytes(originals(reader)[0])
        in_one_process()
        draw_once()
        outcome(reader, path)
        print("ready", flush=True)
        for line in sys.stdin:
            path.write_bytes(damaged(reader, int(line)))
            print(apart(reader, path), flush=True)


def in_one_process() -> None:
    """maskfab reads these in a process of its own for each, which may end; here the copy of the worker is that."""
    gdsii._read_cells = _gdstk
    gerber.read_apart = _gerber  # type: ignore[assignment]
    step.read_apart = _step  # type: ignore[assignment]


class _Sayer(pickle.Pickler):
    """Takes mappings that cannot be changed for dictionaries."""

    def reducer_override(self, thing: object) -> Any:
        return (dict, (dict(thing),)) if isinstance(thing, MappingProxyType) else NotImplemented


def _said(asked: tuple[object, ...]) -> bytes:
    said = io.BytesIO()
    _Sayer(said).dump(asked)
    return said.getvalue()


def draw_once() -> None:
    """The same plate with the same notes is drawn once: of a package that is most of the time."""
    drawn: dict[bytes, bytes] = {}

    def remembered(*asked: object) -> bytes:
        key = _said(asked)
        if key not in drawn:
            drawn[key] = drawing_sheet(*asked)  # type: ignore[arg-type]
        return drawn[key]

    papers.drawing_sheet = remembered  # type: ignore[assignment]


def apart(reader: str, path: Path) -> str:
    """The outcome, from a copy of this process that may end, and what it took: seconds and bytes after a tab."""
    back, to = os.pipe()
    copy = os.fork()
    if not copy:
        faulthandler.disable()
        os.close(back)
        resource.setrlimit(resource.RLIMIT_CPU, (2 * int(SECONDS), 2 * int(SECONDS)))
        if reader in MAY_END:
            step_process.limit(path)
        os.write(to, outcome(reader, path).encode()[:4000])
        os._exit(0)
    os.close(to)
    with os.fdopen(back, "rb") as said:
        answer = said.read().decode(errors="replace").replace("\t", " ").replace("\n", " ")
    _, ended, used = os.wait4(copy, 0)
    took = used.ru_utime + used.ru_stime
    if not answer:
        # Libraries that end on damage the process that they are given, or that the system ends at its limit.
        own = reader in MAY_END and took <= SECONDS
        answer = "refused with its process" if own else f"FINDING: the process ended with {ended}"
    return f"{answer}\t{took:.3f} {used.ru_maxrss * 1024}"


def _gdstk(path: Path, function: str, _seconds: float) -> list[dict[str, Any]]:
    """The cells that a process of its own reads of GDSII and OASIS, or what it raises, in this process.

    Whatever exception ends the process of its own is a refusal there.
    """
    try:
        return gdstk_process.content(function, str(path))
    except Exception as error:
        raise SourceError("MF303", str(error)) from error


def _gerber(path: Path, *_script: object, **_limits: object) -> object:
    """The same for Gerber; but here an exception that is not ours is a finding."""
    return gerber_process.content(path)


def _step(path: Path, *_script: object, **_limits: object) -> object:
    """The same for STEP."""
    try:
        with quiet():
            return step_process.content(path)
    except Exception as error:
        raise SourceError("MF303", str(error)) from error


def main(arguments: list[str]) -> int:
    if arguments[0] == "--worker":
        work(arguments[1])
        return 0
    if arguments[0] == "--case":
        reader, number = arguments[1].split(":")
        path = Path(arguments[2])
        path.write_bytes(damaged(reader, int(number)))
        print(outcome(reader, path))
        return 0
    failed = False
    for reader in arguments[1:] or SUFFIXES:
        first, _, last = arguments[0].rpartition("-")
        found = fuzz(reader, range(int(first or 0), int(last)))
        told = ", ".join(f"{count} {said}" for said, count in found.outcomes.most_common())
        print(
            f"{reader}: {told}; slowest {found.slowest:.2f} s of the processor, largest {found.largest / 1e6:.0f} MB",
            flush=True,
        )
        for case, said in found.findings.items():
            print(f"  {case} {said}", flush=True)
        failed = failed or bool(found.findings)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
