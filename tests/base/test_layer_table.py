from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from klayout import lay

from maskfab.base.model import LAYERS, OUTLINE

TABLE = Path(__file__).parents[2] / "export_templates" / "layers.lyp"


def test_the_layer_table_agrees_with_the_model():
    rows = ElementTree.parse(TABLE).getroot().findall("properties")
    found = {row.findtext("source"): row.findtext("name") for row in rows}
    assert found == {f"{each.number}/{each.datatype}@1": f"{each.name}: {each.purpose}" for each in LAYERS}


def test_colours_differ_and_the_outline_is_hollow():
    rows = ElementTree.parse(TABLE).getroot().findall("properties")
    assert len({row.findtext("frame-color") for row in rows}) == len(LAYERS)
    patterns = {row.findtext("source"): row.findtext("dither-pattern") for row in rows}
    assert patterns[f"{OUTLINE.number}/{OUTLINE.datatype}@1"] == "I1"


def test_klayout_opens_it():
    view = lay.LayoutView()
    view.load_layer_props(str(TABLE))
    assert sum(1 for _ in view.each_layer()) == len(LAYERS)
