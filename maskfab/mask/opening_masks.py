"""Openings, the clear shapes of one display pixel: read from whatever draws them, or drawn by rule.

Text and images show the top row first, a mask holds the lowest row first (model.py), so both are flipped on their way
in and out. Nothing is repaired: what could mean two things is refused with the cure.

A shape that is drawn by rule is a family that grows from its centres, so a count of clear dots selects one member of
it. Symmetry makes dots clear in groups; a count that would split a group is refused, never rounded. Shapes are pure
functions of their parameters and return bool masks [dots, dots], row 0 lowest."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maskfab.base.arrays import Floats, Labels, Mask
from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError, OpeningError, SourceError
from maskfab.base.model import COLOURS, refined
from maskfab.base.units import NM_PER_UM
from maskfab.mask.formats.tiff import said_by, shown_alike


def require_clear_dots(count: int, total: int, *, where: str = "design.clear_dots") -> None:
    """Refuse a number of clear dots that no opening of ``total`` dots has.

    Raises:
        OpeningError: MF203 for none, MF204 for fewer, or more than there are.
    """
    if count == 0:
        raise closed(count, total, where=where)
    if not 0 < count <= total:
        raise OpeningError("MF204", f"{count} of {total} dots cannot be clear", where=where, cure=f"Use 1 to {total}")


def closed(
    count: int, total: int, *, where: str = "design.clear_dots", cure: str = "Set clear_dots to 1 or more"
) -> OpeningError:
    """MF203 for an opening of ``total`` dots that lets no light through."""
    return OpeningError("MF203", f"{count} of {total} dots are clear; at least 1 must be", where=where, cure=cure)


Rows = list[tuple[int, str]]
"""Lines of a drawing with their line numbers in the source, the top line first."""

CLOSED, CLEAR = ".", "#"
_SAVE = "Save 1 where the opening is clear and 0 where it is opaque"
MOST_CHANNELS = 16
_BEYOND = 0.01
"""Rounding of floating-point pictures goes no farther beyond black and white."""
MAX_DOTS = 4096  # a mask of 16 MiB; anything larger is a photograph or a plate, not one display pixel


def text_rows(text: str, where: str) -> Rows:
    """The lines of a plain grid, without its comment lines (``;`` first), numbers 0 and 1 drawn as '.' and '#'.

    A drawing has no digits, so that a text with any in its first line is one of numbers: apart by semicolons, tabs,
    commas, blanks or nothing, comments behind ``# ``.

    Raises:
        OpeningError: MF202 for another number, or none.
    """
    lines = [(n, line) for n, line in enumerate(text.splitlines(), start=1) if not line.lstrip().startswith(";")]
    numbers = [(n, line.strip()) for n, line in lines if line.strip() and not line.startswith("# ")]
    if not any(character.isdigit() for _, line in numbers[:1] for character in line):
        return lines
    return [(n, _drawn_numbers(line, n, where)) for n, line in numbers]


def _drawn_numbers(line: str, number: int, where: str) -> str:
    """A line of 0 and 1 as it is drawn."""
    between = next((mark for mark in ";\t," if mark in line), None)
    fields: Iterable[str] = line.split(between)
    if between is None and not set(line) - set("01"):
        fields = line
    drawn = ""
    for place, field in enumerate(fields, start=1):
        try:
            # Where semicolons part numbers, a comma is a decimal one.
            value = float(field.strip().strip('"').replace(",", "."))
        except ValueError:
            value = np.nan
        if value not in (0, 1):
            what = f"line {number}, number {place}: {field.strip()!r} is neither 0 (opaque) nor 1 (clear)"
            cure = "Write rows of 0 and 1 alone, the top row first, without names of rows or columns"
            raise OpeningError("MF202", what, where=where, cure=cure)
        drawn += CLEAR if value else CLOSED
    return drawn


def mask_of_lines(lines: Rows, where: str) -> Mask:
    """Mask of a drawing in '.' (opaque) and '#' (clear); blank lines round it and blanks after a line do not count.

    Raises:
        OpeningError: MF201 not square, MF202 another character.
        JobError: MF115 too large.
    """
    rows = _trimmed([(number, line.rstrip()) for number, line in lines])
    if not rows:
        what = "the grid has 0 lines"
        raise OpeningError("MF201", what, where=where, cure=f"Draw it with {CLOSED!r} and {CLEAR!r}, one line a row")
    for number, row in rows:
        for column, character in enumerate(row, start=1):
            if character not in (CLOSED, CLEAR):
                what = (
                    f"line {number}, column {column}: {character!r} is neither {CLOSED!r} (opaque) nor {CLEAR!r} "
                    "(clear)"
                )
                raise OpeningError("MF202", what, where=where, cure="Replace it")
    width = Counter(len(row) for _, row in rows).most_common(1)[0][0]
    for number, row in rows:
        if len(row) != width:
            what = f"line {number} has {len(row)} dots where the others have {width}"
            raise OpeningError("MF201", what, where=where, cure=f"Give every line {width} characters")
    check_square(len(rows), width, where)
    check_dots(width, where)
    return np.array([[character == CLEAR for character in row] for _, row in reversed(rows)], dtype=np.bool_)


def drawn_lines(cells: Labels | Mask, characters: str = CLOSED + CLEAR) -> Iterable[str]:
    """The lines of a drawing, the top line first, a character for each number of the array."""
    drawn = np.frombuffer(characters.encode("ascii"), dtype=np.uint8)[cells[::-1].astype(np.intp)]
    return (row.tobytes().decode("ascii") for row in drawn)


def from_image(path: Path) -> Mask:
    """Mask of an image of one pixel per dot: clear where the mean of the colour channels is at least one half.

    Raises:
        SourceError: MF303 damaged, MF308 turned, of several pages or transparent, MF318 a TIFF that does not say what
            is white.
        OpeningError: MF201 not square, MF202 a brightness that is not finite, or no colour channel.
        JobError: MF115 too large.
    """
    image = _opened_image(path, path)
    if image.format_name() != "tiff":
        return _of_image(image, str(path))
    image.close()
    with shown_alike(path) as shown:
        mask = _of_image(_opened_image(path, shown.path), str(path))
        return ~mask if shown.turned else mask


def _opened_image(path: Path, shown: Path) -> Any:
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    image = oiio.ImageInput.open(str(shown))
    if image is None:
        raise _damaged(str(path), said_by(oiio))
    return image


def _of_image(image: Any, where: str) -> Mask:
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    try:
        spec = image.spec()
        check_square(spec.height, spec.width, where)
        check_dots(spec.width, where)
        if spec.nchannels > MOST_CHANNELS:
            what = f"the image has {spec.nchannels} channels; the limit is {MOST_CHANNELS}"
            raise OpeningError("MF202", what, where=where, cure="Save it as a grey image")
        if (spec.x, spec.y, spec.width, spec.height) != (spec.full_x, spec.full_y, spec.full_width, spec.full_height):
            what = (
                f"the image stores {spec.width} x {spec.height} pixels at ({spec.x}, {spec.y}) of a picture of "
                f"{spec.full_width} x {spec.full_height}"
            )
            cure = "Save the whole picture, with equal data and display windows"
            raise OpeningError("MF201", what, where=where, cure=cure)
        turned = spec.get_int_attribute("Orientation", 1) != 1
        if image.seek_subimage(1, 0) or turned:
            what = "is turned by its tags" if turned else "has several pages"
            raise SourceError("MF308", f"the image {what}", where=where, cure="Save one picture as it is seen")
        said_by(image)  # there being no second page is no error
        image.seek_subimage(0, 0)
        pixels = image.read_image(oiio.FLOAT)
        problem = said_by(image)
    finally:
        image.close()
    if pixels is None or problem:
        raise _damaged(where, problem)
    colours = [c for c in range(spec.nchannels) if c not in (spec.alpha_channel, spec.z_channel)]
    if not colours:
        raise OpeningError("MF202", "the image has no colour channel", where=where, cure="Save it as a grey image")
    channels = np.asarray(pixels).reshape(spec.height, spec.width, -1)
    if spec.alpha_channel >= 0 and not channels[:, :, spec.alpha_channel].min() >= 1:
        cure = "Save it without transparency, white where it is clear and black where it is opaque"
        raise SourceError("MF308", "the image is transparent in part, which is neither", where=where, cure=cure)
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is refused next
        brightness = channels[:, :, colours].astype(np.float64).mean(axis=2)
    _refuse(~np.isfinite(brightness), brightness, "is not finite", where)
    beyond = (brightness < -_BEYOND) | (brightness > 1 + _BEYOND)
    _refuse(beyond, brightness, "is not between 0 (opaque) and 1 (clear)", where)
    return np.asarray(brightness >= 0.5)[::-1]


def from_npy(path: Path) -> Mask:
    """Mask of an array [dots, dots] of bool or 0/1, row 0 lowest.

    Raises:
        SourceError: MF303 damaged.
        OpeningError: MF201 not square, MF202 another value.
        JobError: MF115 too large.
    """
    where = str(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that Python 2 wrote the header is no fault of the numbers
            values = np.load(path, mmap_mode="r", allow_pickle=False)  # looks at the shape before it takes memory
    except (ValueError, EOFError, OSError, SyntaxError, TypeError, OverflowError, MemoryError, TokenError) as problem:
        raise _damaged(where, str(problem).splitlines()[0] if str(problem) else type(problem).__name__) from None
    return from_array(values, where)


def from_array(given: ArrayLike, where: str, *, threshold: float | None = None, cure: str = _SAVE) -> Mask:
    """Mask of an array [dots, dots] of bool or 0/1, row 0 lowest; of a grey one what is the threshold or more.

    Raises:
        OpeningError: MF201 not square or empty, MF202 another value: not finite, complex, an object; grey without a
            threshold, which ``cure`` says how to state.
        JobError: MF115 too large.
    """
    if hasattr(given, "detach"):  # a tensor that has slopes is no array yet
        given = given.detach().cpu().numpy()
    try:
        values = np.asarray(given)
    except ValueError:
        what, square = "the rows of the array differ in length", "Give one square array, [dots, dots]"
        raise OpeningError("MF201", what, where=where, cure=square) from None
    if values.ndim != 2 or not values.size:
        what = f"the array has the shape {values.shape}; an opening has [dots, dots]"
        raise OpeningError("MF201", what, where=where, cure="Give one square array, [dots, dots]")
    rows, columns = values.shape
    check_square(rows, columns, where)
    check_dots(rows, where)
    if values.dtype.kind not in "buif":
        real = "the real part or the modulus, as " if values.dtype.kind == "c" else ""
        what = f"the array's values are of type {values.dtype}"
        raise OpeningError("MF202", what, where=where, cure=f"Give {real}bool values, or 0 and 1")
    _refuse(~np.isfinite(values), values, "is not finite", where)
    if threshold is not None:
        return np.asarray(values >= threshold)
    wrong = (values != 0) & (values != 1)
    if wrong.any() and cure != _SAVE:
        low, high = float(values.min()), float(values.max())
        what = f"the array is grey: {int(wrong.sum())} of its {values.size} values, {low:g} to {high:g}, are "
        what += "neither 0 nor 1"
        middle = 0.5 if low >= 0 and high <= 1 else (low + high) / 2
        raise OpeningError("MF202", what, where=where, cure=cure.format(middle=f"{middle:.3g}"))
    _refuse(wrong, values, "is neither 0 nor 1", where)
    return np.array(values, dtype=np.bool_)


def from_layout(
    path: Path, dots: int, dot_nm: int, layer: str | None, cell: str | None, unit_um: float | None = None
) -> Mask:
    """Mask of the polygons on one layer of one cell of a GDSII, OASIS or DXF file.

    The display pixel has its lower left corner at the origin; where geometry lies left of it or below it, the pixel
    is centred on the origin.

    Raises:
        SourceError: what :mod:`maskfab.mask.formats.table` and :func:`maskfab.mask.sandbox.bounded` raise,
            and MF309 where the layer is bare.
        OpeningError: MF205 a polygon is off the dot grid or outside the pixel.
    """
    from maskfab.mask.sandbox import bounded

    return bounded(path, lambda _tell: _of_polygons(path, dots, dot_nm, layer, cell, unit_um), kind=Mask)


def _of_polygons(
    path: Path, dots: int, dot_nm: int, layer: str | None, cell: str | None, unit_um: float | None
) -> Mask:
    from maskfab.mask.formats.content import find_cell, find_layer, rounding_nm
    from maskfab.mask.formats.drawing import drawing_notes
    from maskfab.mask.formats.table import read_layout
    from maskfab.mask.layout import region
    from maskfab.mask.raster import coverage

    where = str(path)
    layout = read_layout(path, unit_um)
    try:
        clear = region(layout, find_layer(layout, layer), cell=find_cell(layout, cell).name)
    except SourceError as problem:  # these two know the layout, but not its file
        raise SourceError(problem.code, problem.what, where=where, cure=problem.cure) from None
    if clear.is_empty():
        raise SourceError("MF309", "the layer has no polygons", where=where, cure="Name the layer that is clear")
    cure = f"Draw it on a grid of {dot_nm / NM_PER_UM:g} um, or state the dots and dot_nm that it was drawn with"
    notes = drawing_notes(layout)
    if notes is not None and not notes.unit_said_by:
        cure += f"; it states no unit, and one was taken for {notes.unit_um:g} um: state its unit"
    if rounding_nm(layout) > 0:
        what = f"a corner is {rounding_nm(layout):.3g} nm off the grid of 1 nm"
        raise OpeningError("MF205", what, where=where, cure=cure)
    box = clear.bbox()
    pitch_nm = CellSize(dots, dot_nm).pitch_nm
    corner = -(pitch_nm // 2) if min(box.left, box.bottom) < 0 else 0
    if min(box.left, box.bottom) < corner or max(box.right, box.top) > corner + pitch_nm:
        raise OpeningError(
            "MF205",
            f"the polygons span x {box.left} to {box.right} nm, y {box.bottom} to {box.top} nm; {dots} dots of "
            f"{dot_nm} nm span {corner} to {corner + pitch_nm} nm",
            where=where,
            cure=f"{cure}; put the pixel's lower left corner or centre at the origin",
        )
    points = np.array([(edge.x1, edge.y1) for polygon in clear.each() for edge in polygon.each_edge()])
    rest = (points - corner) % dot_nm
    off = np.minimum(rest, dot_nm - rest).max(axis=1)
    deviation, x, y = max(zip(off.tolist(), *points.T.tolist(), strict=True))
    if deviation:
        what = f"the corner at ({x}, {y}) nm is {deviation} nm off the grid of {dot_nm} nm"
        raise OpeningError("MF205", what, where=where, cure=cure)
    edges = corner + dot_nm * np.arange(dots + 1, dtype=np.float64)
    share = coverage(clear, edges, edges)
    worst = np.unravel_index(np.argmax(np.minimum(share, 1 - share)), share.shape)
    if 1e-9 < share[worst] < 1 - 1e-9:  # corners on the grid, but an oblique edge between them
        row, column = (int(i) for i in worst)
        what = (
            f"an oblique edge covers {share[worst]:.3f} of the dot in row {row} from below, column {column} from left"
        )
        raise OpeningError("MF205", what, where=where, cure=cure)
    return np.asarray(share > 0.5)


def check_square(rows: int, columns: int, where: str) -> None:
    """Refuse a mask that is not square (MF201)."""
    if rows != columns:
        what = f"the grid has {rows} rows of {columns} dots; a display pixel is square"
        raise OpeningError("MF201", what, where=where, cure=f"Give it {columns} rows, or {rows} dots in every row")


def check_dots(dots: int, where: str) -> None:
    """Refuse a mask larger than any display pixel needs (MF115)."""
    if dots > MAX_DOTS:
        what = f"{dots} dots along a side; one opening may have {MAX_DOTS}"
        raise JobError("MF115", what, where=where, cure="Use larger dots, or crop the file to one display pixel")


def _trimmed(rows: Rows) -> Rows:
    """Without the blank lines before and after the drawing; blank lines inside it are errors and stay."""
    filled = [i for i, (_, row) in enumerate(rows) if row]
    return rows[filled[0] : filled[-1] + 1] if filled else []


def _refuse(wrong: Mask, values: NDArray[Any], problem: str, where: str) -> None:
    if wrong.any():
        row, column = (int(i) for i in np.argwhere(wrong)[0])
        what = f"the value {values[row, column]} at [{row}, {column}] {problem} ({int(wrong.sum())} such values)"
        raise OpeningError("MF202", what, where=where, cure=_SAVE)


def _damaged(where: str, problem: str) -> SourceError:
    reason = " / ".join(problem.split("\n")).strip() or "its reader gives no reason"
    return SourceError("MF303", f"the file is damaged: {reason}", where=where, cure="Save or copy the file again")


LETTERS = CLOSED + "".join(colour[0].upper() for colour in COLOURS)


def labels_of_lines(lines: Rows, where: str) -> Labels:
    """Labels of a drawing in '.', R, G and B, the top line first; int8 [n, n], row 0 lowest.

    Raises:
        JobError: MF119 not square, or another character.
    """
    rows = [(number, line.strip()) for number, line in lines if line.strip()]
    for number, row in rows:
        wrong = next((character for character in row if character not in LETTERS), None)
        if wrong is not None:
            raise _refused(f"line {number}: {wrong!r} is none of {LETTERS}", where)
        if len(row) != len(rows):
            raise _refused(f"line {number} has {len(row)} cells, and there are {len(rows)} lines", where)
    if not rows:
        raise _refused("the drawing has 0 lines", where)
    return np.array([[LETTERS.index(character) for character in row] for _, row in reversed(rows)], dtype=np.int8)


def check_emitters(labels: Labels, mask: Mask, where: str) -> None:
    """Refuse emitters that are not on the dots, lie on an opening, or lack a colour. Raises JobError MF119."""
    times, rest = divmod(labels.shape[0], mask.shape[0])
    if rest or not times:
        raise _refused(
            f"{labels.shape[0]} cells a side are no whole number of times the {mask.shape[0]} dots of the grid", where
        )
    clear = refined(mask, times)
    for label, colour in enumerate(COLOURS, 1):
        emitter = labels == label
        if not emitter.any():
            raise _refused(f"there is no {colour} emitter", where)
        both = np.argwhere(emitter & clear)
        if both.size:
            row, column = both[0]
            drawn = "".join(
                "!" if both_here else LETTERS[cell]
                for both_here, cell in zip((emitter & clear)[row], labels[row], strict=True)
            )
            raise _refused(
                f"the {colour} emitter lies on the opening in {len(both)} cells, first in line "
                f"{labels.shape[0] - row}, column {column + 1}, at the ! of {drawn}",
                where,
            )


def _refused(what: str, where: str) -> JobError:
    return JobError("MF119", what, where=where, cure=f"Draw {LETTERS} on closed dots only, every line of one length")


def stripe(dots: int, width_dots: int, clear_dots: int | None = None) -> Mask:
    """A vertical slit, centred; where the parities differ, half a dot left of or below the centre.

    Args:
        clear_dots: its area; without it the slit runs through the whole cell.

    Raises:
        JobError: MF104 if the slit is wider than the cell or not at least one dot wide.
        OpeningError: MF203 closed, MF204 if the area is no multiple of the width, or more than the full slit.
    """
    check_range("dots", dots, 1, MAX_DOTS)
    check_range("width_dots", width_dots, 1, dots)
    full = dots * width_dots
    clear = full if clear_dots is None else clear_dots
    if clear % width_dots or not 0 < clear <= full:
        raise _unreachable("stripe", clear, dots, np.arange(width_dots, full + 1, width_dots))
    height = clear // width_dots
    left, bottom = (dots - width_dots) // 2, (dots - height) // 2
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[bottom : bottom + height, left : left + width_dots] = True
    return mask


def blobs(dots: int, clear_dots: int, *, size_ratio: float = 0.7, aspect: float = 1.25, exponent: float = 4.0) -> Mask:
    """Four blobs at half the pitch, as the gaps of a P-OLED display: two large ones and two small ones, crosswise.

    A blob is a superellipse |x/a|^exponent + |y/b|^exponent <= 1: exponent 2 is an ellipse, large ones near a
    rectangle. Large blobs lie (width = aspect x height), small ones stand, so that the cell has no fourfold symmetry.

    Args:
        size_ratio: side of a small blob over that of a large one, 0 to 1; 0 leaves out the small ones.
        aspect: the longer side of a blob over its shorter one, 1 to 4.
        exponent: 1 (rhombus) to 64 (rectangle).

    Raises:
        JobError: MF104 for a parameter out of its range.
        OpeningError: MF203 closed, MF204 if no member of the family has that count.
    """
    check_range("dots", dots, 1, MAX_DOTS)
    check_range("size_ratio", size_ratio, 0.0, 1.0)
    check_range("aspect", aspect, 1.0, 4.0)
    check_range("exponent", exponent, 1.0, 64.0)
    large = [(0.25, 0.25), (0.75, 0.75)]
    small = [(0.25, 0.75), (0.75, 0.25)] if size_ratio else []
    stretch = float(np.sqrt(aspect))
    levels = [
        _superellipse(away(dots, x), away(dots, y), size * wide, size / wide, exponent)
        for centres, size, wide in ((large, 1.0, stretch), (small, size_ratio, 1 / stretch))
        for x, y in centres
    ]
    return _grown("blobs", np.minimum.reduce(levels), clear_dots)


def diamond_discs(dots: int, clear_dots: int) -> Mask:
    """Two equal discs per cell, at its corner and its centre: a square lattice turned by 45 degrees.

    Raises:
        JobError: MF104 if the cell has no dots.
        OpeningError: MF203 closed, MF204 if no radius has that count.
    """
    check_range("dots", dots, 1, MAX_DOTS)
    levels = [_superellipse(away(dots, c), away(dots, c), 1.0, 1.0, 2.0) for c in (0.0, 0.5)]
    return _grown("diamond", np.minimum.reduce(levels), clear_dots)


def away(dots: int, centre: float) -> Floats:
    """Distance of each dot's middle from a centre (a fraction of the pitch), the short way round the cell."""
    direct: Floats = np.abs(np.arange(dots) + 0.5 - centre * dots)
    return np.asarray(np.minimum(direct, dots - direct))


def _superellipse(x: Floats, y: Floats, a: float, b: float, exponent: float) -> Floats:
    """Growth at which a blob of half axes proportional to a, b reaches each dot's middle, [y, x]."""
    total: Floats = (x[None, :] / a) ** exponent + (y[:, None] / b) ** exponent
    return np.asarray(total ** (1 / exponent), dtype=np.float64)


def _grown(shape: str, level: Floats, clear_dots: int) -> Mask:
    """The dots of the lowest levels, exactly ``clear_dots`` of them."""
    # Equal levels must tie, although they come from differently rounded sums.
    rank = np.unique(np.round(level, 9), return_inverse=True)[1].reshape(level.shape)
    reachable = np.cumsum(np.bincount(rank.ravel()))
    if clear_dots not in reachable:
        raise _unreachable(shape, clear_dots, level.shape[0], reachable)
    return np.asarray(rank <= np.searchsorted(reachable, clear_dots))


def _unreachable(shape: str, clear_dots: int, dots: int, reachable: NDArray[np.int_]) -> OpeningError:
    total = dots * dots
    if clear_dots <= 0:
        return closed(clear_dots, total, where="clear_dots", cure=f"The smallest is {reachable[0]} dots")
    nearest = reachable[np.argsort(np.abs(reachable - clear_dots), kind="stable")[:2]]
    named = " or ".join(f"{n} (open ratio {n / total:.4f})" for n in sorted(int(n) for n in nearest))
    return OpeningError(
        "MF204",
        f"{shape}: {clear_dots} of {total} dots (open ratio {clear_dots / total:.4f}) cannot be reached with these "
        "parameters",
        where="clear_dots",
        cure=f"The nearest are {named} clear dots",
    )


def check_range(name: str, value: float, low: float, high: float) -> None:
    """Refuse a parameter of a drawn opening that is out of its range (MF104)."""
    if not low <= value <= high:  # also refuses NaN
        what = f"{name} = {value} must lie between {low} and {high}"
        raise JobError("MF104", what, where=name, cure=f"Choose {name} in that range")
