"""GDSII and OASIS files, byte-identical between runs."""

from __future__ import annotations

from pathlib import Path

from klayout import db

from maskfab.errors import OutputError
from maskfab.export.figures import MAX_VERTICES
from maskfab.export.partial import partial


def write_gdsii(layout: db.Layout, path: Path, max_vertices: int = MAX_VERTICES) -> None:
    """Write a layout as GDSII, without time stamps.

    Args:
        layout: from :func:`maskfab.geometry.region.plate_layout` or :meth:`maskfab.export.figures.Figures.layout`.
        path: the file to write.
        max_vertices: longer polygons, which only a layout from elsewhere has, are split by klayout.

    Raises:
        OutputError: MF401 if the file cannot be written; nothing is left under its name.
    """
    options = db.SaveLayoutOptions()
    options.format = "GDS2"
    options.gds2_write_timestamps = False
    options.gds2_max_vertex_count = max_vertices
    options.gds2_multi_xy_records = False
    _write(layout, path, options)


def write_oasis(layout: db.Layout, path: Path) -> None:
    """Write a layout as OASIS, with compressed blocks and the tightest repetitions; raises as :func:`write_gdsii`."""
    options = db.SaveLayoutOptions()
    options.format = "OASIS"
    options.oasis_compression_level = 10
    options.oasis_write_cblocks = True
    _write(layout, path, options)


def _write(layout: db.Layout, path: Path, options: db.SaveLayoutOptions) -> None:
    with partial(path) as aside:
        try:
            layout.write(str(aside), options)
        except RuntimeError as error:
            raise OutputError("MF401", f"{path} cannot be written: {error}", cure="Choose another --out") from error
