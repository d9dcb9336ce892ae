"""Camera responses and illuminants: files of curves over wavelength, the bundled generic camera, and black bodies."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError, SourceError
from maskfab.base.files import no_file
from maskfab.job.values import COLDEST_K, HOTTEST_K
from maskfab.optics.spectrum import LONGEST_NM, SHORTEST_NM, Band, Curve, check_wavelengths, check_weights

GENERIC_RGB = Path(__file__).with_name("data") / "generic_rgb.csv"

# hc/k in nm K, of the 2019 SI.
_SECOND_RADIATION_CONSTANT = 1.438776877e7


def read_curves(path: Path) -> Mapping[str, Curve]:
    """Curves over wavelength from a file; see :func:`parse_curves`.

    Raises:
        SourceError: as :func:`curves_text` and :func:`parse_curves` do.
        JobError: as :func:`parse_curves` does.
    """
    return parse_curves(curves_text(path, str(path)), str(path))


_COLUMNS = "wavelength_nm, then one column per curve"


def curves_text(path: Path, where: str, columns: str = _COLUMNS) -> str:
    """The unjudged text of a file of curves, lines ended by ``\\n``; MF308 if no ``.csv``, MF301, MF302, MF304."""
    if path.suffix.lower() != ".csv":
        what = f"{path} has the suffix {path.suffix!r}"
        raise SourceError("MF308", what, where=where, cure="Curves are read from .csv")
    if not os.path.isfile(path):
        cure = "Give the path of an existing .csv, relative to the job file"
        raise SourceError("MF301", no_file(path, path), where=where, cure=cure)
    data = path.read_bytes()
    if not data.strip():
        what = f"{path} holds no text"
        raise SourceError("MF302", what, where=where, cure=f"Write a header and rows: {columns}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError("MF304", f"{path} is not text", where=where, cure="Save it as UTF-8") from error
    return "".join(f"{line}\n" for line in text.splitlines())


def parse_curves(text: str, where: str) -> Mapping[str, Curve]:
    """Curves over wavelength from a table of comma-separated values, by the names of its columns.

    Lines that begin with ``#`` and empty lines are skipped. The first other line names the columns, ``wavelength_nm``
    first; wavelengths ascend, and values are relative signal per unit of radiant energy (or relative radiant energy,
    for an illuminant), never negative. A curve is straight between rows and zero outside them.

    Raises:
        SourceError: MF302 if there is no table, MF303 for a header, row or number that is damaged, or wavelengths out
            of order.
        JobError: MF112 for a wavelength outside 200 to 2000 nm; MF104 for a value that is negative or not finite, or a
            column of zeros.
    """
    header, numbers = numeric_table(text, where, ("wavelength_nm",))
    wavelengths = numbers[:, 0]
    check_wavelengths(wavelengths, where)
    if (np.diff(wavelengths) <= 0).any():
        at = wavelengths[1:][np.diff(wavelengths) <= 0][0]
        what = f"wavelengths do not ascend at {at:g} nm"
        raise SourceError("MF303", what, where=where, cure="Sort the rows by wavelength, each wavelength once")
    for name, column in zip(header[1:], numbers[:, 1:].T, strict=True):
        check_weights(column, f"{where}: {name}")
    columns = zip(header[1:], numbers[:, 1:].T, strict=True)
    return MappingProxyType({name: Curve(wavelengths, column, name) for name, column in columns})


def camera_bands(response: Mapping[str, Curve], illuminant: Curve | None = None, where: str = "") -> Mapping[str, Band]:
    """One band for each colour: response times illuminant, or the response alone (equal energy at all wavelengths).

    A band ends where its response or its illuminant does: rows of zeros at either end of a table do not count.

    Raises:
        JobError: MF104 if a response and the illuminant do not overlap.
    """
    extra = () if illuminant is None else (_support(illuminant),)
    try:
        return MappingProxyType({name: Band((_support(curve), *extra), name) for name, curve in response.items()})
    except JobError as error:
        raise JobError(error.code, error.what, where=where, cure=error.cure) from error


def generic_rgb() -> Mapping[str, Curve]:
    """The bundled response ``red``, ``green``, ``blue`` from 400 to 700 nm; its file's header gives the formula."""
    return read_curves(GENERIC_RGB)


def black_body(temperature_k: float, low_nm: float = 300.0, high_nm: float = 1100.0) -> Curve:
    """Planck's radiant energy per nanometre, λ^-5 / (exp(c2 / λT) - 1), 1 at its largest; a sample every nanometre.

    Between samples the curve is straight, which is 1e-5 of its peak off at most for 2000 K and more.

    Args:
        temperature_k: 1000 to 100 000 K; 2856 is a tungsten lamp, 6500 close to daylight.

    Raises:
        JobError: MF104 for a temperature or a range out of bounds, MF112 for a wavelength.
    """
    if not COLDEST_K <= temperature_k <= HOTTEST_K:
        what = f"temperature {temperature_k:g} K is outside {COLDEST_K:g} K to {HOTTEST_K:g} K"
        raise JobError("MF104", what, cure="Daylight is about 6500 K")
    check_wavelengths(np.array([low_nm, high_nm]), "black body")
    if not low_nm < high_nm:
        cure = f"Give two ascending wavelengths between {SHORTEST_NM:g} nm and {LONGEST_NM:g} nm"
        raise JobError("MF104", f"the range {low_nm:g} nm to {high_nm:g} nm is empty", cure=cure)
    wavelengths = np.linspace(low_nm, high_nm, int(np.ceil(high_nm - low_nm)) + 1)
    # As exp(-x) / (1 - exp(-x)) nothing overflows for cold bodies and short waves.
    exponent = _SECOND_RADIATION_CONSTANT / (wavelengths * temperature_k)
    energy = wavelengths**-5 * np.exp(-exponent) / -np.expm1(-exponent)
    return Curve(wavelengths, energy / energy.max(), f"black body {temperature_k:g} K")


def numeric_table(text: str, where: str, first: Sequence[str]) -> tuple[list[str], Floats]:
    """Names of the columns of comma-separated values, and the numbers below them, [rows >= 2, columns >= 2].

    Args:
        text: the table; lines that begin with ``#`` and empty lines are skipped.
        where: the file or key it came from, for errors.
        first: names that the first column may have.

    Raises:
        SourceError: MF302 if there is no table, MF303 for a header, row or number that is damaged.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"]
    if not lines:
        raise SourceError("MF302", "there is no table", where=where, cure="Add a header and rows")
    header = _cells(lines[0][1])
    if len(header) < 2 or header[0] not in first or len(set(header)) < len(header) or "" in header:
        what = f"the header {lines[0][1]!r} is not {' or '.join(first)} and different names"
        raise _damaged(where, lines[0][0], what)
    if len(lines) < 3:
        raise _damaged(where, lines[-1][0], "there are fewer than two rows of numbers")
    return header, np.array([_numbers(where, number, line, header) for number, line in lines[1:]])


def _support(curve: Curve) -> Curve:
    """The curve without rows that are zero up to either end: they would widen the range of its band."""
    seen = np.flatnonzero(curve.values)
    part = slice(max(int(seen[0]) - 1, 0), int(seen[-1]) + 2)
    return Curve(curve.wavelengths_nm[part], curve.values[part], curve.name)


def _numbers(where: str, number: int, line: str, header: Iterable[str]) -> list[float]:
    cells, names = _cells(line), list(header)
    if len(cells) != len(names):
        raise _damaged(where, number, f"{len(cells)} values where the header names {len(names)}")
    try:
        return [float(cell) for cell in cells]
    except ValueError as error:
        raise _damaged(where, number, f"{line!r} is not a row of numbers") from error


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line]))]


def _damaged(where: str, number: int, what: str) -> SourceError:
    return SourceError("MF303", what, where=f"{where}: line {number}", cure="Write or copy it again")
