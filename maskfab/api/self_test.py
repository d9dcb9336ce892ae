"""Trials of :func:`maskfab.doctor`: a PSF against its formula, a file of every format, a small use of every extra."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TypeAlias

import numpy as np

from maskfab.api.camera import Camera
from maskfab.api.opening import Opening
from maskfab.api.panel import Panel
from maskfab.api.plate import Plate
from maskfab.base import __version__
from maskfab.base.errors import MaskfabError
from maskfab.base.extras import EXTRAS
from maskfab.base.model import Quantity
from maskfab.base.work import silent
from maskfab.camera.frames.frame import read_frame
from maskfab.job.values import FileFormat
from maskfab.mask.comparison.files import read_back
from maskfab.mask.formats.exr import PsfFile, check_psf_file, psf_facts
from maskfab.mask.formats.table import FORMATS, require_packages
from maskfab.report.text import dataframe
from maskfab.runs.plate_files import draw_files

_WORKS = "works"
_LIMIT = 1e-9
_CAMERA = {"pixel": "2 um", "wavelengths": "530 nm", "window": "128 um"}
_DPI = "1270 dpi"
_SIDE, _GREY = 64, 1000
"""Pixels across a photograph, and the count of each."""

Trial: TypeAlias = Callable[[], Iterable[Quantity]]


def tried(what: str, trial: Trial) -> Iterator[Quantity]:
    """Checks of one part of the installation, and whether it works at all."""
    told = _WORKS
    try:
        yield from [check for check in trial() if check.passed is not None]
    except MaskfabError as error:
        told = str(error)
    except Exception as fault:  # whatever a library does where it was never tried
        told = f"{type(fault).__name__}: {fault}"
    yield Quantity("part_works", told, what, limit=_WORKS, passed=told == _WORKS)


def trials_of(folder: Path) -> Iterator[tuple[str, Trial]]:
    """Parts of this installation in words, and what tries each; files go to a folder."""
    for name, form in FORMATS.items():
        if name != "exr" and (form.extra is None or not EXTRAS[form.extra].missing):
            yield f"{form.title}, written and read back", partial(_format, name, folder)
    yield f"{FORMATS['exr'].title}, written and read back", partial(_psf, folder)
    uses: dict[str, Trial] = {"raw": partial(_photograph, folder), "design": _slope, "pandas": _table}
    for other, extra in EXTRAS.items():
        if other not in ("solid", "gerber") and not extra.missing:
            yield extra.use, uses.get(other, partial(_imported, extra.modules))


def clear_stop() -> Quantity:
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


def _format(name: FileFormat, folder: Path) -> Iterable[Quantity]:
    require_packages([name], where="", otherwise="do without")
    formats = list(dict.fromkeys(("gdsii", name)))  # the first is measured
    job = _plate().with_sections({"export": {"formats": formats, "dpi": _DPI}}).job()
    made = draw_files(job, job.plate())
    made = replace(made, products=tuple(file for file in made.products if file.form.name == name))
    for file in made.products:
        file.write(folder / file.name)
    return read_back(made, folder, silent).quantities


def _psf(folder: Path) -> Iterable[Quantity]:
    plate = _plate()
    assert plate.camera is not None
    psf, (die,) = plate.camera.psf(plate["BAR"], 530), plate.layout().dies
    file = PsfFile("psf.exr", die, psf, {**psf_facts(psf), "maskfab_version": __version__})
    file.write(folder / file.name)
    return check_psf_file(file, folder)


def _photograph(folder: Path) -> Iterable[Quantity]:
    path = folder / "frame.dng"
    path.write_bytes(_dng())
    counts = read_frame(path).counts
    if counts.shape != (_SIDE, _SIDE) or (counts != _GREY).any():
        raise ValueError(f"of {_SIDE} x {_SIDE} counts of {_GREY}, LibRaw reads {counts.shape}")
    return ()


def _slope() -> Iterable[Quantity]:
    import torch

    dots = torch.ones(2, requires_grad=True)
    (dots**2).sum().backward()  # type: ignore[no-untyped-call]
    if dots.grad is None or dots.grad.tolist() != [2.0, 2.0]:
        raise ValueError(f"the slope of a square at 1 is {dots.grad}")
    return ()


def _table() -> Iterable[Quantity]:
    if dataframe([{"a": 1}]).to_dict("records") != [{"a": 1}]:
        raise ValueError("a table does not come back")
    return ()


def _imported(modules: Sequence[str]) -> Iterable[Quantity]:
    for module in modules:
        import_module(module)
    return ()


def _dng() -> bytes:
    """A photograph of one grey as DNG 1.4 has it: the tags of a TIFF, the longer values behind them, the counts."""
    entries: list[tuple[int, str, tuple[int, ...]]] = [
        (254, "I", (0,)), (256, "I", (_SIDE,)), (257, "I", (_SIDE,)), (258, "H", (16,)), (259, "H", (1,)),
        (262, "H", (32803,)), (271, "B", (*b"maskfab", 0)), (272, "B", (*b"test", 0)), (273, "I", (0,)),
        (277, "H", (1,)), (278, "I", (_SIDE,)), (279, "I", (2 * _SIDE * _SIDE,)), (33421, "H", (2, 2)),
        (33422, "B", (0, 1, 1, 2)), (50706, "B", (1, 4, 0, 0)), (50714, "H", (64,)), (50717, "H", (4095,)),
        (50721, "i", tuple(n for k in range(9) for n in (int(k % 4 == 0), 1))), (50728, "I", (1, 1) * 3),
    ]  # fmt: skip
    kinds, rational = {"B": 1, "H": 3, "I": 4}, {50721: 10, 50728: 5}
    end = 8 + 2 + 12 * len(entries) + 4
    head, behind = struct.pack("<2sHIH", b"II", 42, 8, len(entries)), b""
    longer = sum(size for _, letter, held in entries if (size := struct.calcsize(f"<{len(held)}{letter}")) > 4)
    for tag, letter, held in entries:
        at = (end + longer,) if tag == 273 else held
        value = struct.pack(f"<{len(at)}{letter}", *at)
        kind = 2 if tag in (271, 272) else rational.get(tag) or kinds[letter]
        count = len(held) // 2 if tag in rational else len(held)
        if len(value) > 4:
            value, behind = struct.pack("<I", end + len(behind)), behind + value
        head += struct.pack("<HHI", tag, kind, count) + value.ljust(4, b"\0")
    return head + bytes(4) + behind + np.full((_SIDE, _SIDE), _GREY, "<u2").tobytes()
