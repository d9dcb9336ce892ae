"""GDSII and OASIS files, byte-identical between runs."""

from __future__ import annotations

from pathlib import Path

from klayout import db

# A GDSII record holds 32767 bytes: 4094 vertices of 8 bytes each and the closing one fit.
_MAX_VERTICES = 4094


def write_gdsii(layout: db.Layout, path: Path) -> None:
    """Write a layout (see :func:`maskfab.geometry.region.plate_layout`) as GDSII, without time stamps."""
    options = db.SaveLayoutOptions()
    options.format = "GDS2"
    options.gds2_write_timestamps = False
    options.gds2_max_vertex_count = _MAX_VERTICES
    options.gds2_multi_xy_records = False
    layout.write(str(path), options)


def write_oasis(layout: db.Layout, path: Path) -> None:
    """Write a layout as OASIS, with compressed blocks and the tightest repetitions."""
    options = db.SaveLayoutOptions()
    options.format = "OASIS"
    options.oasis_compression_level = 10
    options.oasis_write_cblocks = True
    layout.write(str(path), options)
