"""The files of a plate, by the formats of the job: name, subject and writer of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal, TypeAlias

from klayout import db

from maskfab.export.cell_polygons import Figures
from maskfab.export.cif import write_cif
from maskfab.export.dxf import DrawingStyle, write_dxf
from maskfab.export.gds import write_gdsii, write_oasis
from maskfab.export.gerber import write_gerber
from maskfab.export.images.bitmap import write_bilevel, write_preview
from maskfab.export.images.plate_bitmap import write_plate_bmp, write_plate_tiff
from maskfab.export.solid.mesh import write_3mf, write_glb, write_stl
from maskfab.export.solid.step import write_plate_step, write_step
from maskfab.export.solid.tiles import Stack
from maskfab.export.svg import write_svg
from maskfab.jobfile import FileFormat, PlateBitmap
from maskfab.model import Die

Kind: TypeAlias = Literal["mask", "solid", "plate_solid", "bitmap", "plate_bitmap"]

TITLES: Mapping[str, str] = {
    "gdsii": "GDSII",
    "oasis": "OASIS",
    "dxf_r12": "DXF R12",
    "dxf_r2010": "DXF R2010",
    "gerber": "Gerber X2",
    "cif": "CIF",
    "plate_tiff": "TIFF of a plotter's dots",
    "plate_bmp": "BMP of a plotter's dots",
    "svg": "SVG",
    "step": "STEP",
    "glb": "GLB",
    "3mf": "3MF",
    "stl": "STL",
    "png": "PNG",
    "tiff": "TIFF, 1 bit",
    "exr": "OpenEXR, PSF",
}
MASK_TAILS: Mapping[str, str] = {
    "gdsii": ".gds",
    "oasis": ".oas",
    "dxf_r12": "_R12.dxf",
    "dxf_r2010": "_R2010.dxf",
    "gerber": ".gbr",
    "cif": ".cif",
    "svg": ".svg",
}
"""Ending of the file name of a whole plate, after the plate's name, by format."""
PLATE_BITMAP_TAILS: Mapping[PlateBitmap, str] = {"plate_tiff": ".tif", "plate_bmp": ".bmp"}
"""As :data:`MASK_TAILS`, of pictures that a plotter takes in place of polygons."""
_DIE_SUFFIX: Mapping[str, str] = {
    "step": ".step",
    "glb": ".glb",
    "3mf": ".3mf",
    "stl": ".stl",
    "png": ".png",
    "tiff": ".tif",
}


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


def products(
    figures: Figures,
    formats: Sequence[FileFormat],
    comments: Sequence[str],
    settings: FileSettings | None = None,
    stem: str | None = None,
) -> tuple[Product, ...]:
    """The files of a plate, in the order of the formats; STEP has a file for each die and one for the plate.

    PSFs are made of what is measured in these files, so that EXR has none here: see
    :mod:`maskfab.export.images.psf_exr`.

    Args:
        figures: the plate as it is drawn.
        formats: what is asked for.
        comments: provenance, for every format that can hold it.
        settings: of drawings, solids and pictures.
        stem: how names of files begin; the plate's name by default.
    """
    chosen, named = settings or FileSettings(), stem or figures.plate.name
    return tuple(product for each in formats for product in _of_format(figures, each, comments, chosen, named))


def _of_format(
    figures: Figures, kind: FileFormat, comments: Sequence[str], settings: FileSettings, stem: str
) -> Iterator[Product]:
    plate, title = figures.plate, TITLES[kind]
    if kind == "exr":
        return
    if kind in MASK_TAILS:
        write_mask = mask_writer(figures, kind, comments, settings.drawing)
        yield Product(stem + MASK_TAILS[kind], title, "mask", write_mask)
        return
    if kind in ("plate_tiff", "plate_bmp"):
        assert settings.dpi is not None  # whoever asks for such a format has stated them
        dots = write_plate_tiff if kind == "plate_tiff" else write_plate_bmp
        tone = figures.options.tone
        write_dots = partial(dots, plate, dpi=settings.dpi, tone=tone, comments=comments)
        yield Product(stem + PLATE_BITMAP_TAILS[kind], title, "plate_bitmap", write_dots)
        return
    if kind == "step":
        assembly = partial(write_plate_step, plate, comments=comments, stack=settings.stack)
        yield Product(f"{stem}.step", title, "plate_solid", assembly)
    for die in plate.dies:
        name = f"{stem}_{die.name}{_DIE_SUFFIX[kind]}"
        if kind in ("png", "tiff"):
            picture = write_preview if kind == "png" else write_bilevel
            write = partial(picture, plate, dots_per_um=settings.dots_per_um, comments=comments, die=die.name)
            yield Product(name, title, "bitmap", write, die)
        else:
            yield Product(name, title, "solid", _solid_writer(die, kind, comments, settings), die)


def mask_writer(
    figures: Figures, kind: FileFormat, comments: Sequence[str], style: DrawingStyle | None = None
) -> Callable[[Path], object]:
    """Writer of the polygons of a whole plate to a path; a format of :data:`MASK_TAILS`."""
    writers: Mapping[str, Callable[[Path], object]] = {
        "gdsii": lambda path: write_gdsii(figures.layout(), path, figures.options.max_vertices),
        "oasis": lambda path: write_oasis(_renamed(figures.layout(), style), path),
        "dxf_r12": lambda path: write_dxf(figures, path, "R12", comments, style),
        "dxf_r2010": lambda path: write_dxf(figures, path, "R2010", comments, style),
        "gerber": lambda path: write_gerber(figures, path, comments),
        "cif": lambda path: write_cif(figures, path, comments),
        "svg": lambda path: write_svg(figures, path, comments),
    }
    return writers[kind]


def _renamed(layout: db.Layout, style: DrawingStyle | None) -> db.Layout:
    """The layout with the style's names of layers; numbers stay."""
    names = {} if style is None or style.layer_names is None else style.layer_names
    for info in layout.layer_infos():
        index = layout.find_layer(info)
        if index is not None and info.name in names:
            layout.set_info(index, db.LayerInfo(info.layer, info.datatype, names[info.name]))
    return layout


def _solid_writer(
    die: Die, kind: FileFormat, comments: Sequence[str], settings: FileSettings
) -> Callable[[Path], object]:
    writers: Mapping[str, Callable[[Path], object]] = {
        "step": lambda path: write_step(die, path, comments, settings.stack),
        "glb": lambda path: write_glb(die, path, comments, settings.stack),
        "3mf": lambda path: write_3mf(die, path, comments, settings.stack),
        "stl": lambda path: write_stl(die, path, comments, settings.stack, limit_bytes=settings.stl_limit_bytes),
    }
    return writers[kind]
