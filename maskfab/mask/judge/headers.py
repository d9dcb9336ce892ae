"""Headers of files, which a mask house reads beside the polygons: units, extents, and remarks on tone and job.

Readers take polygons, and turn units into lengths or leave them out; a drawing whose header speaks of inches, or of the
other tone, has the right polygons all the same. Here the bytes are read, by no library.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from zipfile import ZipFile

from maskfab.base.model import Quantity

_LOOKED_AT = 1 << 16
_TONE = re.compile(r"digitized data (?:is|are|=) (\w+)", re.IGNORECASE)
_SHOWN = re.compile(r"(?:digitized data: |dark areas of this image are )(?:the )?(\w+)", re.IGNORECASE)
_JOB = re.compile(r"\bjob ([0-9a-f]{16})\b")
_HEADER_END = re.compile(r"^\s*0\r?\nENDSEC", re.MULTILINE)
_VARIABLE = re.compile(r"^\s*9\r?\n\$(\w+)\r?\n(.*?)(?=^\s*9\r?\n\$|\Z)", re.MULTILINE | re.DOTALL)
_PAIR = re.compile(r"^\s*(\d+)\r?\n(.*?)\r?$", re.MULTILINE)
_DXF_UNITS = {"um": ("13", 1e3), "mm": ("4", 1e6)}
"""$INSUNITS, and nanometres."""
_USER_UNIT, _DATABASE_UNIT = 1e-3, 1e-9
"""Of GDSII: micrometres, of a thousand units each, and a unit in metres."""


@dataclass(frozen=True)
class Stated:
    """Facts that headers have to state.

    Attributes:
        dark: whether data are the chrome.
        digest: of the job.
        extents: width and height in nanometres, any of which a drawing may state about its centre.
        unit: of a drawing.
    """

    dark: bool
    digest: str
    extents: tuple[tuple[int, int], ...]
    unit: str


def header_row(path: Path, stated: Stated) -> Quantity:
    """The row of a report on one file's header."""
    with path.open("rb") as file:
        head = file.read(_LOOKED_AT)
    of_kind = _OF_KIND.get(path.suffix.lower())
    wrong = [*_remarks(head, stated), *(of_kind(head, path, stated) if of_kind else ())]
    said = "".join(f"; {sentence}" for sentence in wrong)
    method = f"{path.name}: units, extents and remarks as its bytes have them{said}"
    return Quantity("judged_headers", len(wrong), method, limit=0, passed=not wrong)


def _remarks(head: bytes, stated: Stated) -> Iterator[str]:
    text, tone = head.decode("latin-1"), "dark" if stated.dark else "clear"
    for said in dict.fromkeys(found.lower() for found in _TONE.findall(text)):
        if said != tone:
            yield f"says that data are {said}, and they are {tone}"
    for said in dict.fromkeys(found.lower() for found in _SHOWN.findall(text)):
        if said != ("chrome" if stated.dark else "openings"):
            yield f"says that its shapes are {said}, and they are {'chrome' if stated.dark else 'openings'}"
    for said in dict.fromkeys(_JOB.findall(text)):
        if said != stated.digest[: len(said)]:
            yield f"is signed with the job {said}, not {stated.digest[: len(said)]}"


def _gdsii(head: bytes, _path: Path, _stated: Stated) -> Iterator[str]:
    """Records are their length, kind and data; UNITS is the fourth or so."""
    at = 0
    while at + 4 <= len(head):
        length, kind = struct.unpack(">HH", head[at : at + 4])
        if kind == 0x0305:
            user, database = (_real(head[at + 4 + start : at + 12 + start]) for start in (0, 8))
            for name, value, wanted in (("user", user, _USER_UNIT), ("database", database, _DATABASE_UNIT)):
                if abs(value / wanted - 1) > 1e-12:
                    yield f"has a {name} unit of {value:g}, not {wanted:g}"
            return
        at += max(length, 4)
    yield "has no units"


def _real(data: bytes) -> float:
    """GDSII's real number: sign, exponent of 16 from 64, and 56 bits of mantissa."""
    sign = -1 if data[0] & 128 else 1
    value: float = sign * int.from_bytes(data[1:], "big") / 2**56 * 16.0 ** ((data[0] & 127) - 64)
    return value


def _oasis(head: bytes, _path: Path, _stated: Stated) -> Iterator[str]:
    """Magic bytes, record 1, the version as a string, and the unit: a real of kind 0, grid steps a micrometre."""
    start = re.match(
        rb"%SEMI-OASIS\r\n\x01\x03" + re.escape(b"1.0") + rb"\x00([\x80-\xff]*[\x00-\x7f])", head, re.DOTALL
    )
    steps = sum((byte & 127) << 7 * place for place, byte in enumerate(start[1])) if start else 0
    if steps != 1000:
        yield f"has {steps} grid steps a micrometre, not 1000"


def _dxf(head: bytes, _path: Path, stated: Stated) -> Iterator[str]:
    text = head.decode("latin-1")
    end = _HEADER_END.search(text)
    facts = {name: _PAIR.findall(rest) for name, rest in _VARIABLE.findall(text[: end.start()] if end else "")}
    code, nm = _DXF_UNITS[stated.unit]
    said = {name: pairs[0][1].strip() for name, pairs in facts.items() if pairs}
    for name, wanted in (("INSUNITS", code), ("MEASUREMENT", "1")):
        # The oldest version knows neither.
        if said.get(name, wanted if said.get("ACADVER") == "AC1009" else "missing") != wanted:
            yield f"has ${name} {said.get(name, 'missing')}, not {wanted}"
    for name, sign in (("EXTMIN", -1), ("EXTMAX", 1)):
        corner = [float(value) * nm for _, value in facts.get(name, ())[:2]]
        if not any(
            len(corner) == 2 and all(abs(at - sign * side / 2) <= 1 for at, side in zip(corner, sides, strict=True))
            for sides in stated.extents
        ):
            yield f"has ${name} at {', '.join(f'{at / 1e6:g}' for at in corner)} mm"


def _stl(head: bytes, _path: Path, _stated: Stated) -> Iterator[str]:
    if not head.startswith(b"unit mm"):
        yield f"begins with {head[:12].decode('ascii', 'replace')!r}, not with 'unit mm'"


def _threemf(_head: bytes, path: Path, _stated: Stated) -> Iterator[str]:
    with ZipFile(path) as parts, parts.open("3D/3dmodel.model") as model:
        found = re.search(rb'\bunit="(\w+)"', model.read(_LOOKED_AT))
    unit = found[1].decode() if found else "missing"
    if unit != "micron":
        yield f"has the unit {unit}, not micron"


_OF_KIND: Mapping[str, Callable[[bytes, Path, Stated], Iterator[str]]] = MappingProxyType(
    {".gds": _gdsii, ".oas": _oasis, ".dxf": _dxf, ".stl": _stl, ".3mf": _threemf}
)
