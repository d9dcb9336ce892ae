"""Gerber X2: every opening a region (G36, G37), so that no aperture and no macro is needed.

The Gerber layer format specification, revision 2024.05: coordinates of six decimals of a millimetre are whole
nanometres, a coordinate that does not change is left out (4.2.2), attributes are those of chapter 5 only. They stand
in comments of the form that the specification gives them (5.1.1), for older viewers warn of what they do not know.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from maskfab.base import __version__
from maskfab.export.cell_polygons import CUT, Figures, as_figures
from maskfab.export.polygon_text import Placeholder, polygon_lines
from maskfab.export.size import check_file_size
from maskfab.files.atomic import partial
from maskfab.model import Plate, Polygon

LARGEST_BYTES = 1_000_000_000

_HEAD_BYTES = 2_000
_OUTLINE_BYTES = 46
_VERTEX_BYTES = 16


def write_gerber(
    source: Plate | Figures, path: Path, comments: Sequence[str] = (), *, limit_bytes: int = LARGEST_BYTES
) -> None:
    """Write what a mask exposes as Gerber X2, in millimetres, byte-identical between runs.

    Dark is what the writer exposes: digitized data is clear. Holes that have a layer of their own are drawn with
    clear polarity after all else. The format has no cells that all readers know, so the file is flat.

    Args:
        source: what to draw, or how it was drawn.
        path: the file to write.
        comments: G04 lines, before what the figures' account has to say.
        limit_bytes: size beyond which nothing is written.

    Raises:
        OutputError: MF401 if the file cannot be written, MF415 if it would be too large.
    """
    figures = as_figures(source)
    check_file_size(gerber_bytes(figures), limit_bytes, path, 'Choose GDSII or OASIS, or hierarchy = "merged"')
    # The specification leaves line ends out of the hash.
    digest = hashlib.md5(usedforsecurity=False)
    with partial(path) as aside, aside.open("w", encoding="ascii", newline="\n") as file:
        for text in chain(_head(figures, comments), _body(figures)):
            digest.update(text.replace("\n", "").encode("ascii"))
            file.write(text)
        file.write(_attribute("MD5", digest.hexdigest()) + "M02*\n")


def gerber_bytes(figures: Figures) -> int:
    """About how large the file becomes, from above."""
    account = figures.account
    return _HEAD_BYTES + account.polygons * _OUTLINE_BYTES + account.vertices * _VERTEX_BYTES


def _head(figures: Figures, comments: Sequence[str]) -> Iterator[str]:
    lines = (
        *comments,
        *figures.account.lines(),
        f"Digitized data is {figures.options.tone}: dark areas of this image are "
        f"{'openings in the chrome' if figures.options.tone == 'clear' else 'chrome'}",
        "Unit mm, six decimals: one step is one nanometre; origin is the centre of the blank",
    )
    yield from (f"G04 {_text(line)}*\n" for line in lines)
    yield _attribute("GenerationSoftware", "maskfab", "maskfab", _field(__version__))
    yield _attribute("Part", "Other", f"Photomask {_field(figures.plate.name)}")
    yield _attribute("FileFunction", "Other", "Photomask")
    # Regions need no aperture, and some readers warn of a file that defines none.
    yield "%FSLAX46Y46*%\n%MOMM*%\n%ADD10C,0.001*%\nG01*\n"


def _attribute(name: str, *fields: str) -> str:
    """An attribute of the file."""
    return f"G04 #@! TF.{','.join((name, *fields))}*\n"


def _body(figures: Figures) -> Iterator[str]:
    for layer, polarity in ((figures.options.layer, "D"), (CUT, "C")):
        texts = polygon_lines(figures, layer, _Pen())
        first = next(texts, None)
        if first is not None:
            yield f"%LP{polarity}*%\n"
            yield first
            yield from texts


def _text(line: str) -> str:
    """The line as comments take it: ASCII, none of the characters that end a block, and no attribute."""
    return re.sub(r"[^ -~]|[*%\\]|^#(?=@!)", "_", " ".join(line.split()))


def _field(value: str) -> str:
    """The value as attributes take it: no comma either, which parts their fields."""
    return _text(value).replace(",", "_")


@dataclass(frozen=True)
class _Pen:
    """Writes regions; of each vertex only the coordinate that changes."""

    def outline(self, polygon: Polygon) -> tuple[str, list[Placeholder]]:
        (x, y), texts = polygon[0], ["G36*\nX%sY%sD02*\n"]
        gaps = [Placeholder("x", x), Placeholder("y", y)]
        for next_x, next_y in (*polygon[1:], polygon[0]):
            if next_x != x or next_y == y:
                gaps.append(Placeholder("x", next_x))
            if next_y != y:
                gaps.append(Placeholder("y", next_y))
            texts.append("X%sD01*\n" if next_y == y else "Y%sD01*\n" if next_x == x else "X%sY%sD01*\n")
            x, y = next_x, next_y
        return "".join([*texts, "G37*\n"]), gaps

    def number(self, nm: int) -> str:
        return str(nm)

    def serial(self) -> str:
        raise NotImplementedError("regions have no numbers")
