"""Openings are data: read from text, images, arrays and layout files; written as TOML.

A TOML opening is a drawing with its facts beside it, and the facts are checked against the drawing::

    name = "toled"
    pitch = "168 um"
    dots = 21
    open_ratio = 0.2086
    grid = '''
    .........######......
    '''                        # '.' opaque, '#' clear, one line per row, the top row first
    emitters = '''
    RRR.............GG
    '''                        # optional: R, G, B and '.', as fine as the dots or a whole number of times finer
    [provenance]
    author = "..."             # any keys; text and numbers

Other kinds of file become a mask in :mod:`maskfab.mask.opening_masks`.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from types import MappingProxyType
from typing import Any

from maskfab.base.arrays import Mask
from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError, OpeningError, SourceError
from maskfab.base.files import suffix_of
from maskfab.base.model import Opening
from maskfab.base.units import NM_PER_UM, parse_pitch_um, to_nm
from maskfab.job.toml import loads
from maskfab.job.values import check_name
from maskfab.mask import opening_masks as decode
from maskfab.mask.opening_masks import closed

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_KEYS = ("name", "pitch", "dots", "open_ratio", "grid", "emitters", "provenance")

_IMAGES = (".png", ".tif", ".tiff", ".exr")
_TEXTS = (".txt", ".csv", ".tsv")
_LAYOUTS = (".gds", ".gds2", ".gdsii", ".oas", ".oasis", ".cif", ".dxf")
GRIDS = (".toml", *_TEXTS, *_IMAGES, ".npy")
"""Suffixes of files that say themselves how many dots there are."""
_SUFFIXES = (*GRIDS, *_LAYOUTS)
_MAGIC: Mapping[str, tuple[bytes, ...]] = MappingProxyType(
    {
        "PNG": (b"\x89PNG\r\n\x1a\n",),
        "TIFF": (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),
        "OpenEXR": (b"v/1\x01",),
        "NumPy": (b"\x93NUMPY",),
    }
)
_FORMAT: Mapping[str, str] = MappingProxyType(
    {".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF", ".exr": "OpenEXR", ".npy": "NumPy"}
)


def load_opening(
    path: str | Path,
    *,
    dots: int | None = None,
    dot_nm: int | None = None,
    layer: str | None = None,
    cell: str | None = None,
    unit_um: float | None = None,
    name: str | None = None,
) -> Opening:
    """The opening held by a file, whose suffix says how to read it.

    * ``.toml``: the form of this module; it states its own pitch.
    * ``.txt .csv .tsv``: the grid alone, drawn or in numbers 0 and 1; ``;`` starts a comment line.
    * ``.png .tif .tiff .exr``: one pixel per dot, clear where the mean of the colour channels is at least one half.
    * ``.npy``: bool or 0/1 [dots, dots], row 0 lowest, as in :class:`~maskfab.base.model.Opening`.
    * ``.gds .oas .dxf``: polygons of one cell and layer, on the dot grid. The display pixel's lower left corner is
      the origin; where geometry lies left of it or below it, the pixel is centred on the origin.

    Args:
        dots: dots along a side; needed for polygons, checked against the grid elsewhere.
        dot_nm: side of one dot; needed for all but TOML, which states its pitch (checked if given).
        layer: layer of a layout file; may be omitted where there is only one.
        cell: cell of a layout file; may be omitted where there is only one top cell.
        unit_um: one unit of a DXF, if not what it says itself.
        name: the opening's name if not the one stated in the TOML, or the file's stem.

    Raises:
        SourceError: MF301 missing, MF302 empty, MF303 damaged, MF304 another kind than its suffix, MF308 unknown kind.
        OpeningError: MF201 not square, MF202 a value that is neither clear nor opaque, MF203 closed, MF205 off the dot
            grid, MF206 stated facts contradict the grid.
        JobError: MF101 to MF110 for the keys of a TOML opening and for missing or refused arguments, MF115 too large.
    """
    path = Path(path)
    where = str(path)
    suffix = path.suffix.lower() if suffix_of(path) not in _LAYOUTS else suffix_of(path)
    _check_number("dots", dots, where)
    _check_number("dot_nm", dot_nm, where)
    content = b"" if suffix in _LAYOUTS else _read_bytes(path)  # geometry.reading checks its own files
    if suffix == ".toml":
        opening = parse_opening(_decode(content, where), where)
        _check_stated(opening, dots, dot_nm, where)
        return opening if name is None else checked(name, opening.mask, opening.dot_nm, opening.provenance, where)

    if dot_nm is None:
        raise _missing("dot_nm", "the side of one dot in nanometres", where)
    if suffix in _TEXTS:
        mask = decode.mask_of_lines(decode.text_rows(_decode(content, where), where), where)
    elif suffix in _IMAGES:
        mask = decode.from_image(path)
    elif suffix == ".npy":
        mask = decode.from_npy(path)
    else:
        if dots is None:
            raise _missing("dots", "the number of dots along a side", where)
        mask = decode.from_layout(path, dots, dot_nm, layer, cell, unit_um)
    opening = checked(path.stem if name is None else name, mask, dot_nm, {"source": path.name}, where)
    _check_stated(opening, dots, dot_nm, where)
    return opening


def parse_opening(text: str, where: str = "") -> Opening:
    """The opening that a TOML text describes; ``where`` names the text in errors."""
    # Decimal keeps how many digits the open ratio has.
    facts = facts_of(text, "An opening", _KEYS, where, parse_float=Decimal)
    name = _required(facts, "name", str, where)
    check_name(name, where=at_key(where, "name"))
    grid = _required(facts, "grid", str, where)
    mask = decode.mask_of_lines(list(enumerate(grid.splitlines(), start=1)), at_key(where, "grid"))
    dots = _required(facts, "dots", int, where)
    if dots != mask.shape[0]:
        what = f"dots = {dots} but the grid has {mask.shape[0]} x {mask.shape[0]} dots"
        cure = f"Set dots = {mask.shape[0]} or draw {dots} lines of {dots} characters"
        raise OpeningError("MF206", what, where=at_key(where, "dots"), cure=cure)
    if "pitch" not in facts:
        raise _absent("pitch", where)
    place = at_key(where, "pitch")
    dot_nm = dot_of_pitch(parse_pitch_um(facts["pitch"], where=place), dots, where=place)
    if "open_ratio" in facts:
        _check_open_ratio(facts["open_ratio"], mask, at_key(where, "open_ratio"))
    opening = checked(name, mask, dot_nm, provenance_of(facts, where), where)
    if "emitters" not in facts:
        return opening
    drawn = _required(facts, "emitters", str, where)
    place = at_key(where, "emitters")
    labels = decode.labels_of_lines(list(enumerate(drawn.splitlines(), start=1)), place)
    decode.check_emitters(labels, mask, place)
    return replace(opening, emitters=labels)


def opening_text(opening: Opening) -> str:
    """The opening as TOML text; ``parse(dumps(o))`` is equal in all parts."""
    pitch_um = Decimal(opening.cell_size.pitch_nm) / NM_PER_UM
    lines = [
        f"name = {quoted(opening.name)}",
        f'pitch = "{pitch_um:f} um"',
        f"dots = {opening.dots}",
        f"open_ratio = {opening.open_ratio:.4f}  # {opening.clear_dots} of {opening.mask.size} dots",
        'grid = """',
        *decode.drawn_lines(opening.mask),
        '"""',
    ]
    if opening.emitters is not None:
        lines += ['emitters = """', *decode.drawn_lines(opening.emitters, decode.LETTERS), '"""']
    return "\n".join([*lines, *provenance_lines(opening.provenance)]) + "\n"


def dot_of_pitch(pitch_um: float, dots: int, *, where: str = "") -> int:
    """Nanometres of one dot of a pitch of so many dots and no gutter.

    Raises:
        JobError: MF104 for no dots; MF107 if the pitch is off the 1 nm grid, MF106 if a dot is.
    """
    _check_number("dots", dots, where)
    pitch_nm = to_nm(pitch_um, where=where, name="pitch")
    dot_nm, rest = divmod(pitch_nm, dots)
    if rest:
        below, above = (f"{CellSize(dots, d).pitch_um:g} um" for d in (dot_nm, dot_nm + 1))
        what = (
            f"pitch {pitch_nm / NM_PER_UM:.15g} um is not a multiple of {dots} dots of whole nanometres: one dot would "
            f"be {pitch_nm / dots:.4f} nm"
        )
        raise JobError("MF106", what, where=where, cure=f"Use a pitch of {above}" + (f" or {below}" if dot_nm else ""))
    return dot_nm


# --- the facts of an opening, checked -------------------------------------------------------------------------------


def checked(name: str, mask: Mask, dot_nm: int, provenance: Mapping[str, str | int | float], where: str) -> Opening:
    """The opening of a mask, if its name is one that layouts take and something of it is clear (MF110, MF203)."""
    check_name(name, where=at_key(where, "name"))
    if not mask.any():
        raise closed(
            0, mask.size, where=where, cure=f"Draw clear dots with {decode.CLEAR!r}; in images bright is clear"
        )
    return Opening(name, mask, dot_nm, MappingProxyType(dict(provenance)))


def _check_number(key: str, value: int | None, where: str) -> None:
    if value is not None and value < 1:
        what = f"{key} = {value} must be at least 1"
        raise JobError("MF104", what, where=at_key(where, key), cure="Give a whole number of 1 or more")
    if key == "dots" and value is not None:
        decode.check_dots(value, where)


def _check_stated(opening: Opening, dots: int | None, dot_nm: int | None, where: str) -> None:
    for key, stated, actual in (("dots", dots, opening.dots), ("dot_nm", dot_nm, opening.dot_nm)):
        if stated is not None and stated != actual:
            what = f"{key} = {stated} was asked for, but the file has {actual}"
            raise OpeningError("MF206", what, where=where, cure=f"Leave {key} out or set it to {actual}")


def _check_open_ratio(stated: object, mask: Mask, where: str) -> None:
    if isinstance(stated, bool) or not isinstance(stated, int | Decimal):
        raise JobError("MF105", f"open_ratio = {stated!r} is not a number", where=where, cure="Write open_ratio = 0.2")
    ratio = Decimal(stated)
    if not ratio.is_finite() or not 0 <= ratio <= 1:
        what = f"open_ratio = {ratio} must lie between 0 and 1"
        raise JobError("MF104", what, where=where, cure="Write open_ratio = 0.2")
    clear = int(mask.sum())
    share = Decimal(clear) / mask.size
    digits = 0 if isinstance(stated, int) else -int(ratio.as_tuple().exponent)
    # A whole number has no printed decimals to round to, so it must be met exactly.
    half_unit = Decimal(0) if digits <= 0 else Decimal(10) ** -digits / 2
    if abs(share - ratio) > half_unit:
        what = f"open_ratio = {ratio} but {clear} of {mask.size} dots are clear, which is {share:.{max(digits, 4)}f}"
        raise OpeningError("MF206", what, where=where, cure=f"Set open_ratio = {share:.4f} or mend the grid")


def _required(facts: Mapping[str, Any], key: str, kind: type, where: str) -> Any:
    if key not in facts:
        raise _absent(key, where)
    value = facts[key]
    if not isinstance(value, kind) or isinstance(value, bool):
        what = f"{key} = {value!r} is of type {type(value).__name__}, not {kind.__name__}"
        cure = f"Write {key} as {'text in quotes' if kind is str else 'a whole number'}"
        raise JobError("MF105", what, where=at_key(where, key), cure=cure)
    return value


def _absent(key: str, where: str) -> JobError:
    return JobError("MF105", f"the key {key!r} is missing", where=where, cure=f"An opening has: {', '.join(_KEYS)}")


def _missing(key: str, meaning: str, where: str) -> JobError:
    return JobError(
        "MF105",
        f"{key} is not given, and a {Path(where).suffix} file does not hold it",
        where=at_key(where, key),
        cure=f"State {meaning}",
    )


# --- files ----------------------------------------------------------------------------------------------------------


def _read_bytes(path: Path) -> bytes:
    """The file's content after every check that needs no parser: there, known, not empty, of the kind it says."""
    where, suffix = str(path), path.suffix.lower()
    if not os.path.isfile(path):
        problem = "is a directory" if os.path.isdir(path) else "does not exist"
        cure = "Give the path of an existing opening; paths in a job are relative to the job file"
        raise SourceError("MF301", f"the opening's file {problem}", where=where, cure=cure)
    if suffix not in _SUFFIXES:
        what = f"no opening is read from a file with the suffix {path.suffix!r}"
        raise SourceError("MF308", what, where=where, cure=f"Use one of {' '.join(_SUFFIXES)}")
    try:
        content = path.read_bytes()
    except OSError as problem:
        cure = "Check that you may read the file, or copy it again"
        raise SourceError("MF303", f"cannot be read: {problem.strerror}", where=where, cure=cure) from None
    if not content.strip():
        cure = "Write the opening again; layouts/openings/toled.toml shows how one looks"
        raise SourceError("MF302", f"{len(content)} bytes and no content", where=where, cure=cure)
    kind_found = next((kind for kind, starts in _MAGIC.items() if content.startswith(starts)), None)
    expected = _FORMAT.get(suffix)
    # A file shorter than its signature that begins like one is truncated, not of another kind.
    truncated = kind_found is None and expected and any(start.startswith(content) for start in _MAGIC[expected])
    if kind_found != expected and not truncated:
        what = f"the suffix {path.suffix} means {expected or 'text'}, but the file begins with {content[:8]!r}" + (
            f" as {kind_found} does" if kind_found else ""
        )
        raise SourceError("MF304", what, where=where, cure="Give the file the suffix of its content, or write it again")
    return content


def _decode(content: bytes, where: str) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        text, fault = "", f"byte {problem.start} is not UTF-8"
    else:
        fault = "it holds a NUL character" if "\0" in text else ""
    if fault:
        what = f"the file is not text: {fault}"
        raise SourceError("MF304", what, where=where, cure="Save it as UTF-8 text, or rename it")
    return text


# --- TOML text of openings and maps ---------------------------------------------------------------------------------


def facts_of(text: str, owner: str, keys: Sequence[str], where: str, **options: Any) -> dict[str, Any]:
    """Keys and values of a TOML text.

    Args:
        owner: what it describes, such as ``A map``, for errors.
        keys: that it may have.

    Raises:
        JobError: MF101 no TOML, MF102 another key.
    """
    try:
        facts = loads(text, **options)
    except (ValueError, RecursionError) as problem:
        what = f"the {owner.split()[1]} is not valid TOML: {problem}"
        cure = "Correct the TOML on that line: close its quotes and brackets"
        raise JobError("MF101", what, where=where, cure=cure) from None
    for key in facts:
        if key not in keys:
            cure = f"{owner} has: {', '.join(keys)}"
            raise JobError("MF102", f"unknown key {key!r}", where=at_key(where, key), cure=cure)
    return facts


def provenance_of(facts: Mapping[str, Any], where: str) -> Mapping[str, str | int | float]:
    """The table [provenance], read-only; its values are text and numbers (MF105)."""
    stated = facts.get("provenance", {})
    if not isinstance(stated, dict):
        cure = "Write provenance as a table under [provenance]"
        raise JobError("MF105", "provenance is not a table", where=at_key(where, "provenance"), cure=cure)
    for key, value in stated.items():
        if isinstance(value, bool) or not isinstance(value, str | int | float | Decimal):
            what, place = f"{key} is a {type(value).__name__}, not text or a number", f"provenance.{key}"
            raise JobError("MF105", what, where=at_key(where, place), cure='Write it as text: "..."')
    plain = {key: float(value) if isinstance(value, Decimal) else value for key, value in stated.items()}
    return MappingProxyType(plain)


def provenance_lines(provenance: Mapping[str, str | int | float]) -> list[str]:
    """The lines of the table [provenance], none where it is empty."""
    lines = []
    for key, value in provenance.items():
        name = key if _BARE_KEY.fullmatch(key) else quoted(key)
        lines.append(f"{name} = {quoted(value) if isinstance(value, str) else repr(value)}")
    return ["", "[provenance]", *lines] if lines else []


def at_key(where: str, key: str) -> str:
    """The place of a key in a text that ``where`` names."""
    return f"{where}: {key}" if where else key


def quoted(text: str) -> str:
    """A TOML string: JSON's escapes are TOML's, but TOML also wants DEL escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
