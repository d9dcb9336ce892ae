"""The installation examined: versions, threads, memory, optional parts, and a self-test of optics and read-back."""

from __future__ import annotations

import os
import platform
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

from maskfab.api.camera import Camera
from maskfab.api.opening import Opening
from maskfab.api.panel import Panel
from maskfab.api.plate import Plate
from maskfab.api.verbs.plates import verify
from maskfab.base import provenance
from maskfab.base.checks import checked_arguments
from maskfab.base.model import Quantity
from maskfab.base.work import Progress, silent
from maskfab.report.rows.text import Quantities
from maskfab.runs.store import VARIABLE, Store

_OPTIONAL = {
    "pandas": ("tables for to_dataframe()", "pandas"),
    "rawpy": ("captures as RAW files", "raw"),
    "gerbonara": ("Gerber read back", "gerber"),
    "pycvvdp": ("ColorVideoVDP in maskfab render", "eye"),
    "distributed": ("sweeps on a cluster", "cluster"),
}
_FORMATS = ("gds", "oas", "dxf")
_LIMIT = 1e-9
_CAMERA = {"pixel": "2 um", "wavelengths": "530 nm", "window": "128 um"}
_CONTAINER_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


@dataclass(frozen=True, repr=False)
class Examination:
    """An installation.

    Attributes:
        facts: in words, by their names.
        checks: of the self-test, each judged.
        seconds: that the self-test took.
    """

    facts: dict[str, str]
    checks: Quantities = field(hash=False)
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether the self-test found every number right."""
        return self.checks.passed

    def to_dict(self) -> dict[str, Any]:
        """Facts and checks."""
        return {"facts": self.facts, "passed": self.passed, "seconds": self.seconds, "checks": self.checks.to_dict()}

    def __str__(self) -> str:
        width = max(map(len, self.facts))
        lines = [f"{name.ljust(width)}  {told}" for name, told in self.facts.items()]
        shown = self.checks if self.passed else self.checks.failed
        right = sum(each.passed is True for each in self.checks)
        told = f"self-test: {right} of {len(self.checks)} checks pass, {self.seconds:.1f} s"
        return "\n".join([*lines, told] if self.passed else [*lines, told, str(shown)])

    def __repr__(self) -> str:
        return str(self)


@checked_arguments
def doctor(*, progress: Progress = silent) -> Examination:
    """Examine this installation: versions, threads, memory, optional parts, and a self-test that takes seconds.

    The self-test holds the PSF of a clear square stop against its formula, and writes a small plate in three formats,
    reads each back and repeats its checks.

    Args:
        progress: told where the work stands.
    """
    begun = time.perf_counter()
    checks = [_clear_stop()]
    with tempfile.TemporaryDirectory(prefix="maskfab-") as scratch:
        for done, name in enumerate(_FORMATS):
            progress("self-test", done, len(_FORMATS))
            path = Path(scratch) / f"plate.{name}"
            plate = _plate()
            plate.write(path)
            checks += [each for each in verify(path, against=plate) if each.passed is not None]
    progress("self-test", len(_FORMATS), len(_FORMATS))
    return Examination(dict(_facts()), Quantities(checks), round(time.perf_counter() - begun, 2))


def _clear_stop() -> Quantity:
    """A clear square stop of side D: (D / λf)² sinc²(D x / λf) sinc²(D y / λf), Goodman, Fourier Optics, 4.4.1."""
    side_um, focal_um, line_um = 800.0, 10_000.0, 0.53
    camera = Camera(focal_um, stop={"shape": "square", "diameter": side_um}, **_CAMERA)
    opening = Opening.of(np.ones((4, 4), dtype=np.bool_), pitch="20 um", name="clear")
    psf = camera.psf(Panel.tile(opening, "periodic", size="1 mm"), 1000 * line_um)
    across = (side_um / (line_um * focal_um)) * np.sinc(side_um * psf.x_um / (line_um * focal_um)) ** 2
    exact = np.outer(across, across)
    error = float(abs(psf.samples - exact).max() / exact.max())
    method = "PSF of a clear square stop against its formula, largest difference over the peak"
    return Quantity("clear_stop_psf_error", error, method, limit=_LIMIT, passed=error <= _LIMIT)


def _plate() -> Plate:
    bar = Opening.bar(dots=21, size=(15, 7), pitch="168 um")
    panel = Panel.tile(bar, "random", seed=1, size="1.68 mm")
    return Plate.of(BAR=panel, blank="27 mm", writable="22 mm", camera=Camera("10 mm", stop="1 mm", **_CAMERA))


def _facts() -> Iterator[tuple[str, str]]:
    yield from provenance.versions().items()
    yield "system", f"{platform.system()} {platform.machine()}"
    yield "processors", str(os.cpu_count() or 1)
    pools = [f"{pool['internal_api']} {pool['num_threads']}" for pool in threadpool_info()]
    yield "threads", ", ".join(pools) or "no numerical library is loaded"
    yield "memory", _memory()
    store = Store.of_user()
    yield "cache", f"off; {VARIABLE} names a folder" if store is None else str(store.folder)
    for module, (use, extra) in _OPTIONAL.items():
        there = find_spec(module) is not None
        yield module, use if there else f"not installed: {use} needs pip install 'maskfab[{extra}]'"


def _memory() -> str:
    """Of the machine, and of the container where that allows less."""
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError, AttributeError):
        return "unknown"
    limits = [int(text) for path in _CONTAINER_LIMITS if (text := _text(path)).isdigit()]
    return f"{min([total, *limits]) / 1e9:.1f} GB"


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="ascii").strip()
    except OSError:
        return ""
