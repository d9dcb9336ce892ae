"""A scene's figures and its part of the page: what was measured stands there, and what was not is explained."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from urllib.parse import unquote
from xml.etree import ElementTree

import pytest

from maskfab.optics.scene.scene import Distortion
from maskfab.report.documents.report import to_document
from maskfab.report.figures import scene
from maskfab.report.pages import appendix as html
from maskfab.report.text import rounded


@pytest.fixture(scope="module")
def drawn(seen):
    return scene.pictures(seen[0])


def words(image: str) -> list[str]:
    svg = unquote(unescape(re.search("src='data:image/svg[+]xml,([^']*)'", image)[1]))
    return [
        "".join(node.itertext()).strip() for node in ElementTree.fromstring(svg).iter() if node.tag.endswith("text")
    ]


def page(run, scenes, pictures) -> str:
    return html.appendix_page(to_document(run.report, run.plate, run.camera, scenes), {"TURNED": pictures})


def test_every_place_shows_its_residual_and_its_change(seen, drawn):
    said = words(drawn["scene_field"])
    views = [view for row in seen[0].field for view in row]
    assert len(views) == 25
    for view in views:
        for value in (view.residual, view.change):
            assert (rounded(value, 2) if value else "0") in said
    assert {"−5.66", "0", "5.66"} <= set(said)  # millimetres: 8 mm along the diagonal


def test_the_depth_names_its_distances_and_the_colours_their_bands(seen, drawn):
    assert {"30 mm", "infinity", rounded(seen[0].depth[0].residual, 2)} <= set(words(drawn["scene_depth"]))
    assert {"blue, mean 450 nm", "<red>, mean 550 nm"} <= set(words(drawn["scene_colours"]))


def test_equal_scenes_give_equal_bytes(seen, drawn):
    assert scene.pictures(seen[0]) == drawn
    first, second = (scene.bitmaps(seen[0]) for _ in range(2))
    assert first == second
    assert all(image.startswith(b"\x89PNG") for image in first.values())


def test_what_was_not_measured_has_no_figure(seen):
    assert scene.pictures(replace(seen[0], field=(), depth=(), colours=())) == {}


def test_the_page_tells_what_was_asked_for_planned_and_measured(run, seen, drawn):
    text = page(run, seen, drawn)
    section = text[text.index("<h3>Scene</h3>") : text.index('<section id="checks">')]
    for said in ("30 mm", "up to 8 mm", "0.03 mm between", "Z4 0.01", "highlights clip", "&lt;red&gt; 500 to 600 nm"):
        assert said in section
    for row in seen[0].plan.ingredients:
        assert row.name in section
    for name in ("Measured error of the plan", "Residual blur in the corner", "Nearest object"):
        assert name in section
    assert section.count("<img") == 3
    assert "No PSFs over" not in section


def test_a_figure_that_is_missing_is_explained(run, seen):
    plain = replace(seen[0], field=(), depth=(), colours=())
    assert "the plan leaves the shift through the gap out" in page(run, (plain,), {})
    assert "the plan leaves defocus out" in page(run, (plain,), {})
    asked = replace(plain.scene, gap_um=0.0, nearest_um=plain.scene.farthest_um)
    text = page(run, (replace(plain, scene=asked),), {})
    assert "the oblique light out, for an error of" in text
    bent = replace(plain, scene=replace(asked, distortion=Distortion(-0.02, 2000.0)))
    assert "-0.02 of the image height at 2 mm" in page(run, (bent,), {})
    assert "objects in focus only" in text
    assert "asks for the axis only" in page(run, (replace(plain, scene=replace(asked, field_um=0.0)),), {})


def test_a_page_without_a_scene_says_nothing_of_one(run):
    assert "<h3>Scene</h3>" not in page(run, (), {})
