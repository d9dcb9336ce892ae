"""Which layer of a file from elsewhere is taken for what is clear, and what its other layers hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from klayout import db

from maskfab.errors import SourceError
from maskfab.export.cell_polygons import CUT
from maskfab.geometry.plate_layout import layer_info, region
from maskfab.geometry.shape_limits import count_texts, left_out, note_left_out
from maskfab.model import CLEAR, LAYERS, Layer, Quantity
from maskfab.readers.layout_file import find_cell, find_layer, layer_label, layer_names

_TOLD = 8
_UNTOLD = (
    "mask houses do not unless they are told so: name one in [export] shop that takes holes on a layer of their own, "
    "or say --layer"
)


@dataclass(frozen=True)
class StatedLayers:
    """Layers as stated by the job.

    Attributes:
        names: what its mask house calls them in DXF, by their names on the plate; empty if as there.
        cut: whether the house takes holes on a layer of their own, as :data:`CUT` is.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    cut: bool = False

    def info(self, layer: Layer) -> db.LayerInfo:
        """The layer as a file may call it."""
        return db.LayerInfo(layer.number, layer.datatype, self.names.get(layer.name, layer.name))


@dataclass(frozen=True)
class LayersRead:
    """Layers that were read as clear.

    Attributes:
        clear: the layer, as it is called in the file; empty for files that have no layers.
        wanted: the one that the job orders.
        meant: whether it is that one, or was stated.
        taken_out: whether what :data:`CUT` holds was taken out of it.
        others: further layers with shapes that neither the job has for people nor the user passes over.
        passed_over: further layers with shapes of which nothing is looked at, and need not be.
    """

    clear: str = ""
    wanted: str = ""
    meant: bool = True
    taken_out: bool = False
    others: tuple[str, ...] = ()
    passed_over: tuple[str, ...] = ()

    def quantities(self, name: str, ordered: StatedLayers) -> Iterator[Quantity]:
        """Rows of a verdict on the file of that name."""
        if self.clear:
            method = f"what is clear is read from layer {self.clear} of {name}; the job orders {self.wanted}"
            cure = "; say --layer if the house is told so"
            told = method + ("" if self.meant else cure)
            yield Quantity("layer", self.clear, told, limit=self.wanted, passed=self.meant)
        if self.taken_out:
            cut = f"{CUT.number}/{CUT.datatype}"
            method = f"{name} has shapes on {cut}, which are taken out of what is clear for all that follows, as "
            method += "the job's mask house does" if ordered.cut else _UNTOLD
            limit = cut if ordered.cut else "none"
            yield Quantity("layer_taken_out", cut, method, limit=limit, passed=ordered.cut)
        if self.others:
            method = f"layers of {name} with shapes that the job has not: {_listed(self.others)}; the house may write "
            method += "them: take them out, or say --ignore if it is told not to"
            yield Quantity("other_layers", len(self.others), method, limit=0, passed=False)
        if self.passed_over:
            method = f"layers of {name} with shapes of which nothing is looked at, for they are not written: "
            yield Quantity("passed_over", len(self.passed_over), method + _listed(self.passed_over))


def clear_only(
    layout: db.Layout,
    path: Path,
    layer: str | None = None,
    cell: str | None = None,
    ignored: tuple[str, ...] = (),
    ordered: StatedLayers | None = None,
) -> LayersRead:
    """Leave one top cell with what is clear, on the layer CLEAR, and nothing else; notes about the file stay.

    Without a stated layer, what lies on the layer CUT is taken out of it, as a house does that is told to.

    Args:
        layout: what was read; it is changed.
        path: its file.
        layer, cell: what is clear and where; the usual if None.
        ignored: layers that are not written, by number or name.
        ordered: what the job says of layers.

    Raises:
        SourceError: MF305 to MF309 if cell or layer are not there, or could be several.
    """
    ordered = ordered or StatedLayers()
    try:
        root, info = find_cell(layout, cell), find_layer(layout, layer or _called(layout, ordered.info(CLEAR)))
    except SourceError as error:
        raise SourceError(error.code, error.what, where=str(path), cure=error.cure) from None
    for index in [each.cell_index() for each in layout.top_cells() if each.cell_index() != root.cell_index()]:
        _drop_above(layout, index, root.cell_index())
    cut = layout.find_layer(layer_info(CUT))
    taken_out = layer is None and cut is not None and not root.bbox(cut).empty()
    if taken_out:
        exposed = (region(layout, info) - region(layout, CUT)).merged(True, 1)
        layout.flatten(root.cell_index(), -1, True)
        root.shapes(layout.find_layer(info)).clear()
        root.shapes(layout.find_layer(info)).insert(exposed)
    kept = layout.find_layer(info)
    for_people = [ordered.info(each) for each in LAYERS if not each.written]
    others: list[str] = []
    passed_over: list[str] = []
    for each in layout.layer_infos():
        if each.is_equivalent(info) or (taken_out and each.is_equivalent(layer_info(CUT))):
            continue
        if draws(layout, layout.find_layer(each)):
            fine = any(each.is_equivalent(one) for one in for_people) or bool(layer_names(each) & {*ignored})
            (passed_over if fine else others).append(layer_label(each))
    note_left_out(layout, replace(left_out(layout), texts=count_texts(layout, kept)))
    for index in layout.layer_indexes():
        if index != kept:
            layout.delete_layer(index)
    wanted = ordered.info(CLEAR)
    meant = layer is not None or info.is_equivalent(wanted)
    layout.set_info(kept, layer_info(CLEAR))
    return LayersRead(
        layer_label(info), layer_label(wanted), meant, taken_out, tuple(sorted(others)), tuple(sorted(passed_over))
    )


def draws(layout: db.Layout, index: int) -> bool:
    """Whether anything but texts lies on a layer below the top cell."""
    polygons = layout.top_cell().begin_shapes_rec(index)
    polygons.shape_flags = db.Shapes.SRegions
    polygons.reset()
    return not polygons.at_end()


def _called(layout: db.Layout, info: db.LayerInfo) -> str | None:
    """The name of a layer where only names tell layers, and this one is there."""
    named = any(each.layer < 0 and each.name == info.name for each in layout.layer_infos())
    return str(info.name) if named else None


def _drop_above(layout: db.Layout, index: int, kept: int) -> None:
    """Delete a top cell and everything below it that is neither a cell nor part of it."""
    if kept not in layout.cell(index).called_cells():
        layout.prune_cell(index, -1)
        return
    below = list(layout.cell(index).each_child_cell())
    layout.delete_cell(index)
    for child in below:
        if child != kept and layout.is_valid_cell_index(child) and layout.cell(child).is_top():
            _drop_above(layout, child, kept)


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names[:_TOLD]) + (", ..." if len(names) > _TOLD else "")
