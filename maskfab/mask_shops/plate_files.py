"""The files of a plate, as a job or a mask shop asks for them, and the layout that each of them must show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from klayout import db

from maskfab.base import __version__
from maskfab.errors import JobError
from maskfab.export.cell_polygons import Figures, draw
from maskfab.export.outputs import FileSettings, Product, products
from maskfab.export.solid.tiles import Stack
from maskfab.geometry.plate_layout import plate_layout
from maskfab.jobfile import PLATE_BITMAPS, ExportSection, FileFormat, JobSpec
from maskfab.jobfile.shop_profile import Format, Shop
from maskfab.judge.verdict import Asked, asked
from maskfab.mask_shops.adapt import as_ordered, blank_of, drawing_style, suited, written_formats, written_options
from maskfab.mask_shops.dot_edges import DotEdges, dot_edges, plotted_dpi
from maskfab.mask_shops.judge import PlateFacts
from maskfab.mask_shops.package_rules import package_options
from maskfab.model import Plate, Quantity
from maskfab.units import NM_PER_UM

_MB = 1_000_000


@dataclass(frozen=True, eq=False)
class PlateFiles:
    """A plate, the layout that its files must show, and the files as writers draw them.

    Attributes:
        plate: the plate, its marks as the shop takes them.
        design: the plate as :func:`maskfab.geometry.plate_layout.plate_layout` builds it. It is made from the plate and
            not from the figures, so that a fault of what draws them shows when files are read back.
        figures: cells and polygons.
        products: the files.
        settings: of drawings, solids and pictures.
        formats: of the files.
        edges: what a plotter's dots make of edges; None where no file is of dots.
        asked: what the job asks for, derived without the plate; None of a plate that no job has laid out.
    """

    plate: Plate
    design: db.Layout
    figures: Figures
    products: tuple[Product, ...]
    settings: FileSettings
    formats: tuple[FileFormat, ...]
    edges: DotEdges | None = None
    asked: Asked | None = None

    def account(self) -> tuple[Quantity, ...]:
        """Changes made to draw what formats and readers accept, as rows of the report."""
        said = self.figures.account
        counts = {
            "drawn_holes": (said.holed, f"outlines with holes, drawn by {self.figures.options.holes}"),
            "drawn_parted": (said.parted, "outlines parted where they touched themselves"),
            "drawn_split": (said.split, f"outlines cut for more than {self.figures.options.max_vertices} vertices"),
        }
        if said.snapped is not None:
            counts["drawn_snapped"] = said.snapped.vertices, str(said.snapped)
        rows = tuple(Quantity(name, count, method) for name, (count, method) in counts.items())
        return rows if self.edges is None else (*rows, *self.edges.quantities())


def files_of_job(plate: Plate, spec: JobSpec, comments: Sequence[str], shop: Shop | None = None) -> PlateFiles:
    """Draw a plate as the job's [export] asks, or as cells in GDSII, OASIS and DXF if it asks for nothing.

    What it leaves to the ``shop`` that it names is chosen by :mod:`maskfab.mask_shops.adapt`, and marks are drawn as
    the shop takes them.

    Raises:
        OutputError: MF413, MF416 for drawings that cannot be made.
        JobError: MF105 for a bitmap of the plate without its dots per inch.
    """
    section = spec.export or ExportSection()
    formats = written_formats(section, shop)
    glass_nm = blank_of(spec).glass_nm
    dpi = plotted_dpi(section, shop)
    check_stated(dpi, formats)
    settings = FileSettings(
        Stack(
            section.chrome * NM_PER_UM,
            Stack().glass_nm if glass_nm is None else glass_nm,
            section.exaggeration,
            "neck" if spec.order is not None and spec.order.corner_touches == "join" else "gap",
            None if spec.order is None or spec.order.corner_width is None else spec.order.corner_width * NM_PER_UM,
        ),
        round(section.stl_limit_mb * _MB),
        section.dots_per_um,
        dpi,
        drawing_style(plate, shop),
    )
    options = as_ordered(written_options(plate, section, shop, spec.tone), spec)
    taken = plate if shop is None else suited(plate, shop, options.holes)
    figures = draw(taken, options)
    made = products(figures, formats, comments, settings)
    edges = dot_edges(taken, spec, shop, formats, dpi)
    return PlateFiles(taken, plate_layout(taken), figures, made, settings, formats, edges)


def check_stated(dpi: int | None, formats: Sequence[FileFormat]) -> None:
    """Refuse bitmaps of a plate without dots per inch.

    Raises:
        JobError: MF105.
    """
    asked = [each for each in formats if each in PLATE_BITMAPS]
    if asked and dpi is None:
        raise JobError(
            "MF105",
            f"{asked[0]} is made of a plotter's dots, and nobody says how many there are to the inch",
            where="export.dpi",
            cure='Set dpi = "25400 dpi" or what your house plots at in [export], or leave the format out',
        )


def check_polygons(spec: JobSpec, formats: Sequence[FileFormat], where: str) -> None:
    """Refuse biased data as pictures, whose dots are far coarser than a bias.

    Raises:
        JobError: MF128.
    """
    dots = [each for each in formats if each in (*PLATE_BITMAPS, "png", "tiff")]
    if spec.data_bias_nm and dots:
        raise JobError(
            "MF128",
            f"{dots[0]} is made of dots, which are far coarser than the bias that the data should be short of",
            where=f"{where}: export.formats",
            cure=f'Leave {" and ".join(dots)} out of formats, or let the house make it good: order.bias = "house"',
        )


def files_for_shop(
    plate: Plate,
    shop: Shop,
    formats: Sequence[Format],
    comments: Sequence[str],
    stem: str,
    spec: JobSpec,
    facts: PlateFacts | None = None,
    *,
    version: str = __version__,
) -> PlateFiles:
    """Draw a plate that is :func:`maskfab.mask_shops.adapt.fitted` as its shop takes it.

    Args:
        plate: what is sent.
        shop: whom it is sent to.
        formats: of the mask files.
        comments: provenance.
        stem: of their names.
        spec: of its job.
        facts: of the plate, shared by houses that it is drawn for.
        version: of maskfab that signs the plate.

    Raises:
        OutputError, JobError: as :func:`files_of_job`.
    """
    dpi = plotted_dpi(spec.export, shop)
    check_stated(dpi, formats)
    settings = FileSettings(dpi=dpi, drawing=drawing_style(plate, shop))
    options = package_options(spec, plate, shop)
    figures = draw(plate, options) if facts is None else facts.drawn(plate, options)
    made = products(figures, formats, comments, settings, stem)
    edges = dot_edges(plate, spec, shop, formats, dpi)
    design = plate_layout(plate) if facts is None else facts.design(plate)
    wanted = asked(spec, shop, sent=True, version=version)
    return PlateFiles(plate, design, figures, made, settings, tuple(formats), edges, wanted)
