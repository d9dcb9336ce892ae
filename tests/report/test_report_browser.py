"""The report in a browser, on a desk and on a telephone: its front is in sight, and nothing runs or is fetched."""

from __future__ import annotations

import html as markup
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import dumped, installed
from report.conftest import MARKUP
from report.test_front import A, B, taken

from maskfab.report.documents.report_data import to_document
from maskfab.report.page import html
from maskfab.report.plots import design_figures, die_figures

DESK, TELEPHONE = (1280, 900), (390, 844)
LOOK = """
const told = {};
const frames = [...document.querySelectorAll("iframe")];
await Promise.all(frames.map(frame => frame.contentDocument.readyState === "complete" && frame.contentDocument.body
  ? null : new Promise(done => frame.addEventListener("load", done))));
for (const frame of frames) {
  const page = frame.contentDocument, wide = frame.clientWidth;
  const front = [...page.querySelectorAll("header *")];
  const cells = [...page.querySelectorAll("table.dies tbody tr:first-child > *")].slice(0, 2);
  told[wide] = {
    wide: page.documentElement.scrollWidth,
    front: page.querySelector("header").getBoundingClientRect().bottom,
    outside: front.filter(each => each.getBoundingClientRect().right > wide + 1).length,
    clipped: front.filter(each => each.scrollWidth > each.clientWidth + 1
      && frame.contentWindow.getComputedStyle(each).overflowX === "hidden").length,
    psnr: cells.map(each => each.getBoundingClientRect().right),
    pictures: [...page.images].filter(each => !each.complete || !each.naturalWidth).length,
    scripts: page.scripts.length,
    fetched: frame.contentWindow.performance.getEntriesByType("resource").filter(each => !each.name.startsWith("data:"))
      .length,
  };
}
const pre = document.createElement("pre");
pre.id = "told";
pre.textContent = JSON.stringify(told);
document.body.append(pre);
"""


@pytest.fixture(scope="module")
def looked(run, tmp_path_factory):
    """What a browser sees of one report, by the width of its window."""
    browser, place = installed(), tmp_path_factory.mktemp("report")
    report = replace(run.report, title=f"{MARKUP} LONG TITLE OF A PLATE WITH EIGHTY CHARACTERS, FOR A")
    document = to_document(report, run.plate, run.camera, photographs=taken(PLAIN=A, TURNED=B))
    pictures = die_figures.pictures(run.plate, run.optics, document)
    scene = np.random.default_rng(1).random((3, 144, 192), dtype=np.float32)
    pictures[die_figures.PLATE]["front_truth"] = design_figures.tile(scene, "truth")
    for name in ("PLAIN", "TURNED"):
        pictures[name]["front"] = design_figures.tile(scene, f"through {name}")
    shown = markup.escape(html.html_page(document, pictures))
    frames = "".join(
        f'<iframe style="border: 0; width: {wide}px; height: {high}px" srcdoc="{shown}"></iframe>'
        for wide, high in (DESK, TELEPHONE)
    )
    page = place / "page.html"
    page.write_text(f'<!DOCTYPE html><body>{frames}<script type="module">{LOOK}</script></body>', encoding="utf-8")
    found = re.search(r'<pre id="told">(.*?)</pre>', dumped(browser, page, place / "home"), re.DOTALL)
    assert found, "the page came to no end"
    return {int(wide): told for wide, told in json.loads(markup.unescape(found[1])).items()}


@pytest.mark.parametrize("size", [DESK, TELEPHONE], ids=["desk", "telephone"])
def test_nothing_of_the_front_is_out_of_sight(looked, size):
    seen = looked[size[0]]
    assert seen["wide"] <= size[0]
    assert (seen["outside"], seen["clipped"]) == (0, 0)
    assert len(seen["psnr"]) == 2
    assert max(seen["psnr"]) <= size[0]
    assert seen["pictures"] == 0


def test_the_front_is_one_screen_of_a_desk(looked):
    assert looked[DESK[0]]["front"] <= DESK[1]


@pytest.mark.parametrize("size", [DESK, TELEPHONE], ids=["desk", "telephone"])
def test_a_hostile_title_runs_nothing_and_nothing_is_fetched(looked, size):
    assert (looked[size[0]]["scripts"], looked[size[0]]["fetched"]) == (0, 0)
