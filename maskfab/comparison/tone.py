"""Dark data as clear ones: what a plate's writable area has besides the chrome that a file draws."""

from __future__ import annotations

from klayout import db

from maskfab.export.cell_polygons import CUT
from maskfab.geometry.plate_layout import layer_info
from maskfab.model import CHROME, CLEAR, Layer, Plate


def cleared(read: db.Layout, plate: Plate) -> db.Layout:
    """A layout whose layer CLEAR is what the chrome of another leaves of the writable area; other layers are as there.

    Nothing is left in hierarchy on that layer, for a file from elsewhere may draw chrome in any cell.
    """
    found = read.dup()
    top, half = found.top_cell(), plate.writable_nm // 2
    clear = db.Region(db.Box(-half, -half, half, half)) - _drawn(found, CHROME)
    cut = found.find_layer(layer_info(CUT))
    if cut is not None:
        clear += _drawn(found, CUT)
    for layer in (CLEAR, CHROME, CUT):
        index = found.find_layer(layer_info(layer))
        if index is not None:
            found.delete_layer(index)
    top.shapes(found.layer(layer_info(CLEAR))).insert(clear.merged(True, 1))
    return found


def named_chrome(read: db.Layout) -> None:
    """Call what a file without layers draws chrome: its reader takes it for what is clear."""
    index = read.find_layer(layer_info(CLEAR))
    if index is not None:
        read.set_info(index, layer_info(CHROME))


def _drawn(layout: db.Layout, layer: Layer) -> db.Region:
    index = layout.find_layer(layer_info(layer))
    return db.Region() if index is None else db.Region(layout.top_cell().begin_shapes_rec(index))
