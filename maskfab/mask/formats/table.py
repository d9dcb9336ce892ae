"""The files of a plate: every format with its name, its subject and its writer, in one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal, TypeAlias

from klayout import db

from maskfab.base.errors import OutputError
from maskfab.base.model import Die, Plate
from maskfab.job.values import FileFormat
from maskfab.mask.figures import Figures
from maskfab.mask.formats.cif import write_cif
from maskfab.mask.formats.dxf import DrawingStyle, Version, write_dxf
from maskfab.mask.formats.gdsii import write_gdsii, write_oasis
from maskfab.mask.formats.gerber import write_gerber
from maskfab.mask.formats.picture import write_bilevel, write_preview
from maskfab.mask.formats.plate_bitmap import write_plate_bmp, write_plate_tiff
from maskfab.mask.formats.solid import Stack, write_3mf, write_glb, write_stl
from maskfab.mask.formats.step import write_plate_step, write_step
from maskfab.mask.formats.svg import write_svg

Kind: TypeAlias = Literal["mask", "solid", "plate_solid", "bitmap", "plate_bitmap"]


@dataclass(frozen=True)
class FileSettings:
    """Settings of the writers beyond the figures of a plate.

    Attributes:
        stack: thicknesses of chrome and glass.
        stl_limit_bytes: larger STL files are refused.
        dots_per_um: pixels per micrometre of PNG and TIFF.
        dpi: dots per inch of a plotter; None where no format needs them.
        drawing: how DXF is drawn; its names of layers are those of OASIS too.
    """

    stack: Stack = field(default_factory=Stack)
    stl_limit_bytes: int = 100_000_000
    dots_per_um: float = 0.125
    dpi: int | None = None
    drawing: DrawingStyle = field(default_factory=DrawingStyle)


@dataclass(frozen=True, eq=False)
class Product:
    """One file of a result.

    Attributes:
        name: of the file.
        title: its format, for people.
        kind: how it is read back.
        write: writes it to a path.
        die: what it is about; None for the whole plate.
    """

    name: str
    title: str
    kind: Kind
    write: Callable[[Path], object]
    die: Die | None = None


@dataclass(frozen=True, eq=False)
class _Source:
    """Source of a file: a plate as it is drawn, or one die of it."""

    figures: Figures
    comments: Sequence[str]
    settings: FileSettings
    drawn: Die | None = None

    @property
    def plate(self) -> Plate:
        return self.figures.plate

    @property
    def die(self) -> Die:
        assert self.drawn is not None
        return self.drawn

    @property
    def dpi(self) -> int:
        assert self.settings.dpi is not None  # whoever asks for such a format has stated them
        return self.settings.dpi


_Writer: TypeAlias = Callable[[_Source, Path], object]


@dataclass(frozen=True)
class FormatFacts:
    """One format of files.

    Attributes:
        title: for people.
        tail: ending of the file's name, behind the plate's name or the die's.
        of_plate: how a file of the whole plate is read back, and its writer; None where there is none.
        of_die: as ``of_plate``, of a file for each die.
    """

    title: str
    tail: str
    of_plate: tuple[Kind, _Writer] | None = None
    of_die: tuple[Kind, _Writer] | None = None


def _mask(title: str, tail: str, write: _Writer) -> FormatFacts:
    return FormatFacts(title, tail, of_plate=("mask", write))


def _gdsii(of: _Source, to: Path) -> None:
    write_gdsii(of.figures.layout(), to, of.figures.options.max_vertices)


def _dxf(version: Version) -> _Writer:
    return lambda of, to: write_dxf(of.figures, to, version, of.comments, of.settings.drawing)


def _dots(write: Callable[..., object]) -> tuple[Kind, _Writer]:
    return "plate_bitmap", lambda of, to: write(
        of.plate, to, dpi=of.dpi, tone=of.figures.options.tone, comments=of.comments
    )


def _picture(write: Callable[..., object]) -> tuple[Kind, _Writer]:
    return "bitmap", lambda of, to: write(
        of.plate, to, dots_per_um=of.settings.dots_per_um, comments=of.comments, die=of.die.name
    )


def _solid(write: Callable[..., object], **more: Callable[[FileSettings], object]) -> tuple[Kind, _Writer]:
    return "solid", lambda of, to: write(
        of.die, to, of.comments, of.settings.stack, **{key: value(of.settings) for key, value in more.items()}
    )


FORMATS: Mapping[FileFormat, FormatFacts] = {
    "gdsii": _mask(
        "GDSII", ".gds", lambda of, to: write_gdsii(of.figures.layout(), to, of.figures.options.max_vertices)
    ),
    "oasis": _mask("OASIS", ".oas", lambda of, to: write_oasis(_renamed(of.figures.layout(), of.settings.drawing), to)),
    "dxf_r12": _mask("DXF R12", "_R12.dxf", _dxf("R12")),
    "dxf_r2010": _mask("DXF R2010", "_R2010.dxf", _dxf("R2010")),
    "gerber": _mask("Gerber X2", ".gbr", lambda of, to: write_gerber(of.figures, to, of.comments)),
    "cif": _mask("CIF", ".cif", lambda of, to: write_cif(of.figures, to, of.comments)),
    "svg": _mask("SVG", ".svg", lambda of, to: write_svg(of.figures, to, of.comments)),
    "step": FormatFacts(
        "STEP",
        ".step",
        ("plate_solid", lambda of, to: write_plate_step(of.plate, to, of.comments, of.settings.stack)),
        _solid(write_step),
    ),
    "glb": FormatFacts("GLB", ".glb", of_die=_solid(write_glb)),
    "3mf": FormatFacts("3MF", ".3mf", of_die=_solid(write_3mf)),
    "stl": FormatFacts("STL", ".stl", of_die=_solid(write_stl, limit_bytes=lambda each: each.stl_limit_bytes)),
    "png": FormatFacts("PNG", ".png", of_die=_picture(write_preview)),
    "tiff": FormatFacts("TIFF, 1 bit", ".tif", of_die=_picture(write_bilevel)),
    "exr": FormatFacts("OpenEXR, PSF", ".exr"),
    "plate_tiff": FormatFacts("TIFF of a plotter's dots", ".tif", of_plate=_dots(write_plate_tiff)),
    "plate_bmp": FormatFacts("BMP of a plotter's dots", ".bmp", of_plate=_dots(write_plate_bmp)),
}
"""Every format that maskfab writes. PSFs are of what is measured in the other files, so EXR has its writer in
:mod:`maskfab.mask.formats.exr`."""


def products(
    figures: Figures,
    formats: Sequence[FileFormat],
    comments: Sequence[str],
    settings: FileSettings | None = None,
    stem: str | None = None,
) -> tuple[Product, ...]:
    """The files of a plate, in the order of the formats; STEP has one for the plate and one for each die.

    Args:
        figures: the plate as it is drawn.
        formats: what is asked for.
        comments: provenance, for every format that can hold it.
        settings: of drawings, solids and pictures.
        stem: how names of files begin; the plate's name by default.
    """
    source, named = _Source(figures, comments, settings or FileSettings()), stem or figures.plate.name
    return tuple(product for each in formats for product in _of_format(source, FORMATS[each], named))


def _of_format(source: _Source, form: FormatFacts, stem: str) -> Iterator[Product]:
    if form.of_plate is not None:
        kind, write = form.of_plate
        yield Product(stem + form.tail, form.title, kind, partial(write, source))
    if form.of_die is not None:
        kind, write = form.of_die
        for die in source.plate.dies:
            name = f"{stem}_{die.name}{form.tail}"
            yield Product(name, form.title, kind, partial(write, replace(source, drawn=die)), die)


def format_of(path: Path, *, die: bool) -> FileFormat:
    """The format that the name of a file stands for, of one die or of the whole plate.

    Raises:
        OutputError: MF430 for a name that stands for none.
    """
    known = {each: facts for each, facts in FORMATS.items() if (facts.of_die if die else facts.of_plate)}
    for each, facts in known.items():
        if path.name.lower().endswith(facts.tail.lower()):
            return each
    suffix = path.suffix.lower()
    if suffix == ".dxf" and not die:
        return "dxf_r2010"
    what, cure = f"no {'die' if die else 'plate'} is written with the suffix {suffix!r}", "Use "
    if suffix == FORMATS["exr"].tail:
        what, cure = "an .exr is of a PSF, which a run measures in the files it wrote", "Run a job with exr, or use "
    elif not die and any(suffix == facts.tail for facts in FORMATS.values() if facts.of_die):
        what, cure = f"a {suffix} is of one die", "Name the die, as in write(path, die='OURS'), or use "
    listed = sorted({f".{facts.tail.rpartition('.')[2]}" for facts in known.values()})
    raise OutputError("MF430", what, where=str(path), cure=cure + " or ".join([", ".join(listed[:-1]), listed[-1]]))


def _renamed(layout: db.Layout, style: DrawingStyle) -> db.Layout:
    """The layout with the style's names of layers; numbers stay."""
    names = {} if style.layer_names is None else style.layer_names
    for info in layout.layer_infos():
        index = layout.find_layer(info)
        if index is not None and info.name in names:
            layout.set_info(index, db.LayerInfo(info.layer, info.datatype, names[info.name]))
    return layout
