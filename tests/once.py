"""What is dear and follows from its arguments alone, done once of equal ones, for tests that are about something else.

Drawing figures takes more than half of a small run and of a package, and the bounds of an opening most of a short
design. Where one argument differs in anything, the work is done; of figures, all but setting them as ink.
"""

from __future__ import annotations

import copyreg
import hashlib
import io
import pickle
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from html import escape
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from klayout import db
from matplotlib.figure import Figure
from PIL import Image

from maskfab.base.processes import read_only
from maskfab.base.provenance import sha256_of_file
from maskfab.camera.scenes import Photograph, dead_leaves, indoors, lit
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings, SceneStatistics
from maskfab.mask.comparison import files
from maskfab.report.figures import die, report, sheet

FIGURES = (
    "maskfab.report.figures.report.pictures",
    "maskfab.report.figures.report.of_die",
    "maskfab.report.figures.die.overview",
    "maskfab.mask.package.papers.drawing_sheet",
)
OPTICS = ("maskfab.findings.optics.measure_with_pupil",)
BOUNDS = ("maskfab.designs.search.result.bounds",)
DESIGN = (
    "maskfab.mask.comparison.faults._of_plate",
    "maskfab.findings.foreign.measure",
)
"""What the design itself breaks and shows, which every file that is held against it asks for."""

leaves = cache(dead_leaves)
"""The scene of a seed and a size, drawn once by each process. Nobody writes into it."""

dimmed = cache(indoors)
"""The same scene indoors."""


@cache
def small_scenes(highlights: bool = False) -> tuple[Photograph, ...]:
    """Scenes for the photographs of a run, a sixth as large as its own; the sensor has 192 x 256 pixels."""
    scenes = leaves(1, 704, 768), dimmed(leaves(2, 704, 768))
    return tuple(map(lit, scenes)) if highlights else scenes


_statistics = SceneStatistics.of
_scenes: dict[tuple[object, ...], tuple[Sequence[Photograph], SceneStatistics]] = {}


def statistics(
    photographs: Sequence[Photograph], *, leak_scenes: int = 2, settings: CaptureSettings = F1_SETTINGS
) -> SceneStatistics:
    """What a surrogate knows of the same photographs, found once by each process."""
    key = (settings, leak_scenes, *map(id, photographs))
    if key not in _scenes:
        _scenes[key] = photographs, _statistics(photographs, leak_scenes=leak_scenes, settings=settings)
    return _scenes[key][1]


@contextmanager
def figures_in_words() -> Iterator[None]:
    """Within this, figures are drawn once of equal arguments, and their files hold words in place of a picture.

    A PNG has the letters as grey pixels. Two files differ if a text, a curve, an image or the number of outlines does:
    what a figure looks like is for the tests of the report.
    """
    with once(*FIGURES), pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", _write_words)
        patch.setattr(sheet, "vector", _vector_in_words)
        patch.setattr(report, "mtf_image", lambda mtfs: die.mtf(mtfs).img())
        patch.setattr(report, "psf_image", lambda psfs: die.psf(psfs).img())
        yield


def _vector_in_words(figure: Figure) -> str:
    written = io.StringIO()
    _write_words(figure, written, format="svg")
    return " ".join(written.getvalue().split())


def _write_words(figure: Figure, target: Any, *, format: str, **_: object) -> None:
    words = [text.get_text() for text in figure.texts]
    for axes in figure.axes:
        shown = [*axes.texts, axes.title, axes.xaxis.label, axes.yaxis.label]
        words += [text.get_text() for text in shown if text.get_text()]
        words += [f"{zlib.crc32(line.get_xydata().tobytes()):08x}" for line in axes.lines]
        words += [type(drawn).__name__ for drawn in (*axes.patches, *axes.collections)]
        words += [f"{zlib.crc32(image.get_array().tobytes()):08x}" for image in axes.images]
    text = "\n".join(words)
    if format == "svg":
        drawing = f'<svg xmlns="http://www.w3.org/2000/svg"><text>{escape(text)}</text></svg>'
        target.write(drawing if isinstance(target, io.StringIO) else drawing.encode())
    elif format == "pdf":
        target.write(f"%PDF-1.7\n{text}\n%%EOF\n".encode())
    else:
        pixels = text.encode() or bytes(1)
        Image.frombytes("L", (len(pixels), 1), pixels).save(target, format=format)


_KNOWN: dict[tuple[str, bytes], Any] = {}


@contextmanager
def once(*places: str) -> Iterator[None]:
    """Within this, functions, each as ``module.name``, answer to equal arguments what they answered before."""
    with pytest.MonkeyPatch.context() as patch:
        for place in places:
            module, _, name = place.rpartition(".")
            patch.setattr(place, partial(_remembered, place, getattr(import_module(module), name)))
        yield


@contextmanager
def compared_once() -> Iterator[None]:
    """Within this, a layout of the same bytes is read and compared with the same plate once."""
    compare = files._within_limits

    @contextmanager
    def remembered(made: Any, product: Any, folder: Path, costs: Any, **how: bool) -> Iterator[Callable[[], Any]]:
        path = folder / product.name
        if not path.is_file():
            with compare(made, product, folder, costs, **how) as answer:
                yield answer
            return
        key = "compared", _digest((made.plate, made.settings, product.name, sha256_of_file(path), how))

        def found() -> Any:
            if key not in _KNOWN:
                with compare(made, product, folder, costs, **how) as answer:
                    _KNOWN[key] = answer()
            return replace(_KNOWN[key], path=path)

        yield found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "_within_limits", remembered)
        yield


def _remembered(place: str, work: Callable[..., Any], *given: object, **named: object) -> Any:
    key = place, _digest((given, named, Figure.savefig is _write_words))
    if key not in _KNOWN:
        _KNOWN[key] = work(*given, **named)
    return _KNOWN[key]


def _digest(content: object) -> bytes:
    """The same for equal contents, whichever of them are one object."""
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer)
    pickler.fast = True
    pickler.dispatch_table = copyreg.dispatch_table | {
        MappingProxyType: lambda view: (read_only, (dict(view),)),
        db.Region: lambda region: (list, ([each.to_s() for each in region.each()],)),
    }
    pickler.dump(content)
    return hashlib.sha256(buffer.getbuffer()).digest()
