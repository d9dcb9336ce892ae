"""Every format that maskfab writes or reads: the files of a plate, and mask files of any maker as layouts.

Modules of this folder list their formats as ``FORMATS``, which are found here under the names that
:data:`maskfab.job.values.FileFormat` gives them; so none of them imports this one. A file is read by a library that did
not write it: GDSII and OASIS are written by klayout and read by gdstk, DXF is written by ezdxf and read by klayout,
Gerber is read by gerbonara, CIF by its grammar and by klayout, which must agree. Pictures of masks are read by
:mod:`maskfab.mask.formats.picture`, for they need to be told how large a pixel is.
"""

from __future__ import annotations

import gzip
import os
import re
import tempfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module, metadata
from itertools import chain
from pathlib import Path
from pkgutil import iter_modules
from typing import get_args

from klayout import db

from maskfab.base.errors import JobError, MaskfabError, OutputError, SourceError
from maskfab.base.extras import EXTRAS, lacking_libraries, require
from maskfab.base.files import PACKED, suffix_of
from maskfab.job.values import MEASURED_FORMATS, FileFormat
from maskfab.mask import formats as folder
from maskfab.mask.figures import Figures
from maskfab.mask.formats.format import FileSettings, Format, Product, Source
from maskfab.mask.formats.mesh import FORMATS as MESHES
from maskfab.mask.formats.picture import IMAGE_SUFFIXES
from maskfab.mask.formats.solid import SharedFilm
from maskfab.mask.process_limits import BYTES_PER_SECOND, allow
from maskfab.mask.sandbox import MEMORY_PER_BYTE, damaged, missing

_LATER = ("_process", "_writer")
"""Ends of names of modules that a format runs or loads when it needs them, for their libraries are heavy."""


def _listed() -> Iterator[Format]:
    for module in iter_modules(folder.__path__, f"{folder.__name__}."):
        if module.name != __name__ and not module.name.endswith(_LATER):
            yield from getattr(import_module(module.name), "FORMATS", ())


_FORMATS = {form.name: form for form in _listed()}
FORMATS: Mapping[FileFormat, Format] = {name: _FORMATS[name] for name in get_args(FileFormat)}
"""Formats by name, in the order of their names in a job."""

_READ = {suffix: form for form in FORMATS.values() for suffix in form.suffixes}

LAYOUT_SUFFIXES = frozenset(_READ)
"""Suffixes of the files that :func:`read_layout` reads."""

LARGEST_UNPACKED = 1_000_000_000
"""Bytes of a layout that comes packed: the largest that is read takes some hours of the processor."""

_AT_ONCE = 1 << 20

MEASURED_SUFFIXES = frozenset(suffix for name in MEASURED_FORMATS for suffix in FORMATS[name].suffixes)
"""Suffixes of layouts whose optics can be measured."""


def products(
    figures: Figures,
    formats: Sequence[FileFormat],
    comments: Sequence[str],
    settings: FileSettings | None = None,
    stem: str | None = None,
) -> tuple[Product, ...]:
    """The files of a plate in the order of the formats, STEP also one for each die; ``stem`` for the plate's name."""
    films = SharedFilm(len({form.name for form in MESHES}.intersection(formats)))
    source, name = Source(figures, comments, settings or FileSettings(), films), stem or figures.plate.name
    files: list[Product] = []
    for form in (FORMATS[chosen] for chosen in formats):
        if form.write_plate is not None:
            files.append(Product(name + form.tail, form, partial(form.write_plate, source)))
        if form.write_die is not None:
            files += [
                Product(f"{name}_{die.name}{form.tail}", form, partial(form.write_die, source, die), die)
                for die in source.plate.dies
            ]
    return tuple(files)


def require_packages(
    formats: Sequence[FileFormat], *, where: str = "export.formats", otherwise: str = "leave these out"
) -> None:
    """Refuse formats that this installation could not write, or not read back. Raises MissingPackageError MF152."""
    forms = {name: form for name in formats if (form := FORMATS[name]).extra is not None}
    extras = dict.fromkeys(form.extra for form in forms.values() if form.extra is not None)
    loads = tuple(chain(*(form.loads for form in forms.values())))
    missing = [
        name
        for name, form in forms.items()
        if (form.extra is not None and EXTRAS[form.extra].missing) or lacking_libraries(*form.loads)
    ]
    require(*extras, what=f"writing {', '.join(missing)}", where=where, otherwise=otherwise, loads=loads)


def format_of(path: Path, *, die: bool) -> FileFormat:
    """The format that the name of a file stands for, of one die or of the whole plate.

    Raises:
        OutputError: MF430 for a name that stands for none.
    """
    written = [form for form in FORMATS.values() if (form.write_die if die else form.write_plate)]
    suffix = path.suffix.lower()
    for form in written:
        if path.name.lower().endswith(form.tail.lower()):
            return form.name
    if suffix == ".dxf" and not die:
        return "dxf_r2010"
    what, cure = f"no {'die' if die else 'plate'} is written with the suffix {suffix!r}", "Use "
    if suffix == FORMATS["exr"].tail:
        what, cure = "an .exr is of a PSF, which a run measures in the files it wrote", "Run a job with exr, or use "
    elif not die and any(suffix == form.tail for form in FORMATS.values() if form.write_die):
        what, cure = f"a {suffix} is of one die", "Name the die, as in write(path, die='OURS'), or use "
    tails = sorted({f".{form.tail.rpartition('.')[2]}" for form in written})
    raise OutputError("MF430", what, where=str(path), cure=cure + " or ".join([", ".join(tails[:-1]), tails[-1]]))


def read_layout(path: Path, unit_um: float | None = None) -> db.Layout:
    """A mask file as a hierarchical layout; database unit 1 nm, layers of the plate under their numbers and names.

    Coordinates off the nanometre grid are rounded, and the largest rounding is kept for ``content.rounding_nm``, the
    unit of a DXF for ``content.drawn_unit_um``.

    Args:
        unit_um: one unit of a DXF; what $INSUNITS says if None, and one micrometre if that says nothing.

    Raises:
        JobError: MF105 a unit is stated for a file that states its own.
        SourceError: MF301 missing, MF302 empty, MF303 truncated or damaged, MF304 not what its suffix says,
            MF308 of a kind that is not read, MF310 and MF311 drawn with open lines or curves, MF312 a polygon that
            crosses itself, MF313 too large, MF315 a command of Gerber or CIF that is not read, MF316 too slow to read,
            MF317 a DXF that draws out of sight.
    """
    form = _READ.get(suffix_of(path))
    if unit_um is not None and not (form is not None and form.takes_unit):
        what = f"{path.name} is not a DXF; only the unit of a DXF can be stated"
        raise JobError("MF105", what, where="--unit", cure="Leave out --unit: other formats state their own")
    if form is None or form.read is None:
        what = f"{path.name} has the suffix {path.suffix!r}; maskfab reads {' '.join((*_READ, *IMAGE_SUFFIXES))}"
        cure = "Convert it to GDSII, OASIS, DXF, Gerber, CIF or a picture"
        raise SourceError("MF308", what, where=str(path), cure=cure)
    if not os.path.isfile(path):
        raise missing(path)
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{path.name} holds 0 bytes", where=str(path), cure="Export or copy the file again")
    units = () if unit_um is None else (unit_um,)
    if path.suffix.lower() != PACKED:
        return form.read(path, *units)
    with tempfile.TemporaryDirectory(prefix="maskfab-") as aside:
        try:
            return form.read(_unpacked(path, Path(aside) / path.stem), *units)
        except MaskfabError as error:
            inner = re.compile(rf"(?:{re.escape(aside)}{re.escape(os.sep)})?{re.escape(path.stem)}(?!{PACKED})")
            error.reword(lambda text: inner.sub(lambda found: str(path) if aside in found[0] else path.name, text))
            raise


def _unpacked(path: Path, to: Path) -> Path:
    """The content of a file packed by gzip, within the size that a layout may have. Raises SourceError MF303, MF313."""
    size = 0
    try:
        with gzip.open(path) as packed, to.open("wb") as file:
            while some := packed.read(_AT_ONCE):
                size += len(some)
                if size > LARGEST_UNPACKED:
                    what = f"{path.name} unpacks to more than {LARGEST_UNPACKED:.3g} bytes"
                    raise SourceError("MF313", what, where=str(path), cure="Export the cells of the mask alone")
                file.write(some)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise damaged(path, f"it cannot be unpacked ({error})") from error
    allow(size / BYTES_PER_SECOND, MEMORY_PER_BYTE * size)
    return to


def layout_format(path: Path) -> Format | None:
    """The format of a layout by the end of its name, ours or anybody's; None if no layout is called so."""
    layouts = [form for form in FORMATS.values() if form.read is not None]
    ours = (form for form in layouts if path.name.endswith(form.tail))
    return next(ours, next((form for form in layouts if suffix_of(path) in form.suffixes), None))


def readers_of(path: Path, *, versions: bool = False) -> str:
    """Packages that read a layout of this name, as in ``"alike by klayout and gdstk"``; empty if it is none."""
    form = layout_format(path)
    # Of those that are not held against each other only the first says what a file of ours holds.
    names = [] if form is None else [package for package, _ in form.readers[: None if form.agreed else 1]]
    said = [f"{name} {metadata.version(name)}" if versions else name for name in names]
    return f"alike by {', '.join(said[:-1])} and {said[-1]}" if len(said) > 1 else f"by {said[0]}" if said else ""
