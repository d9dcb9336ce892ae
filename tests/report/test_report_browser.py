"""The report in a browser, on a desk, on a telephone and on paper: nothing is out of sight, runs or is fetched.

Paper is looked at twice: as a PDF, and as a window of the width of A4 between its margins, with the style of print.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from browser import DESK, TELEPHONE
from report.conftest import MARKUP
from report.test_front import A, B, taken

from maskfab.report.documents.report import to_document
from maskfab.report.figures import die
from maskfab.report.figures import scene as design_figures
from maskfab.report.pages.appendix import appendix_page
from maskfab.report.pages.page import html_page

PAPER = (688, 1016)
"""A4 without margins of 14 mm, at 96 pixels an inch."""
A4_PT = (595, 842)
EVERYWHERE = pytest.mark.parametrize("size", [DESK, TELEPHONE, PAPER], ids=["desk", "telephone", "paper"])
FRONT = """
    front: page.querySelector("header").getBoundingClientRect().bottom,
    outside: [...page.querySelectorAll("header *")].filter(each => each.getBoundingClientRect().right > wide + 1)
      .length,
    clipped: [...page.querySelectorAll("header *")].filter(each => each.scrollWidth > each.clientWidth + 1
      && frame.contentWindow.getComputedStyle(each).overflowX === "hidden").length,
    heights: [...page.querySelectorAll("section.page")].map(each => each.getBoundingClientRect().height),
    cut: [...page.querySelectorAll("tr, figure, .verdict")].filter(each =>
      frame.contentWindow.getComputedStyle(each).breakInside !== "avoid").length,
    heads: [...page.querySelectorAll("thead")].filter(each =>
      frame.contentWindow.getComputedStyle(each).display !== "table-header-group").length,
    keys: [...page.querySelectorAll("a[href], summary, input")].filter(each => each.tabIndex < 0).length,
    psnr: [...page.querySelectorAll("table.dies tbody tr:first-child > *")].slice(0, 2)
      .map(each => each.getBoundingClientRect().right),
    text: page.querySelector("header").innerText,
    beyond: [...page.querySelectorAll("body *")].filter(each => each.getBoundingClientRect().right > wide + 1)
      .map(each => each.outerHTML.slice(0, 80)),
    unfolded: [...page.querySelectorAll("details")].filter(each => each.querySelector("table").checkVisibility(
      { contentVisibilityAuto: true })).map(each => each.querySelector("summary").textContent),
    psfs: ["on-one-scale", "by-own-peak"].map(scale => [...page.querySelectorAll(`.psfs .${scale}`)]
      .filter(each => each.checkVisibility()).length),
    asked: (() => {
      page.querySelector("#own-peak")?.click();
      return ["on-one-scale", "by-own-peak"].map(scale => [...page.querySelectorAll(`.psfs .${scale}`)]
        .filter(each => each.checkVisibility()).length);
    })(),
"""


@pytest.fixture(scope="module")
def pages(run):
    """A report and its appendix, with photographs and a hostile title."""
    report = replace(run.report, title=f"{MARKUP} LONG TITLE OF A PLATE WITH EIGHTY CHARACTERS, FOR A")
    document = to_document(report, run.plate, run.camera, photographs=taken(PLAIN=A, TURNED=B))
    pictures = report.pictures(run.plate, run.optics, document)
    scene = np.random.default_rng(1).random((3, 144, 192), dtype=np.float32)
    pictures[die.PLATE]["front_truth"] = design_figures.tile(scene, "truth")
    for name in ("PLAIN", "TURNED"):
        pictures[name]["front"] = design_figures.tile(scene, f"through {name}")
    return html_page(document, pictures), appendix_page(document, pictures)


def everywhere(browser, page):
    """What a browser sees of one page, by the width of its window."""
    return {size[0]: browser.seen(page, size, FRONT, paper=size is PAPER) for size in (DESK, TELEPHONE, PAPER)}


@pytest.fixture(scope="module")
def looked(browser, pages):
    return everywhere(browser, pages[0])


@pytest.fixture(scope="module")
def appended(browser, pages):
    return everywhere(browser, pages[1])


@EVERYWHERE
def test_nothing_of_the_front_is_out_of_sight(looked, size):
    told = looked[size[0]]
    assert told["wide"] <= size[0]
    assert (told["outside"], told["clipped"]) == (0, 0)
    assert len(told["psnr"]) == 2
    assert max(told["psnr"]) <= size[0]
    assert told["broken"] == 0


def test_the_front_is_one_screen_of_a_desk(looked):
    assert looked[DESK[0]]["front"] <= DESK[1]


@EVERYWHERE
def test_a_hostile_title_runs_nothing_and_nothing_is_fetched(looked, appended, size):
    for told in (looked[size[0]], appended[size[0]]):
        assert (told["scripts"], told["fetched"], told["broken"], told["keys"]) == (0, 0, 0, 0)


@EVERYWHERE
def test_the_appendix_scrolls_its_tables_and_never_the_page(appended, size):
    assert appended[size[0]]["wide"] <= size[0]


@EVERYWHERE
def test_the_front_answers_what_its_reader_asks(looked, size):
    words = " ".join(looked[size[0]]["text"].split())
    asked = (
        "FILES", "OPTICS", "FITS ? NOT JUDGED", "LOOKS ? NOT JUDGED", "LIVES ? NOT JUDGED", "TURNED", "+5.2 ± 0.9 dB",
        "over PLAIN, the first die of the job", "95 % interval", "3 scenes (s0, s1, s2), at 32 dB of light",
        "Every other die is worse", "Open ratio in the stop 0.", "30.20 dB, mean of 3 scenes",
        "1 dB more is 21 % less squared error", "PLAIN (reference), scene s0 alone: 20.0 dB",
        "TURNED (best), scene s0 alone: 25.5 dB", "Truth, scene s0", MARKUP,
    )  # fmt: skip
    assert [each for each in asked if each not in words] == []


def test_psfs_are_on_one_scale_and_against_their_own_peaks_when_asked(appended):
    for wide, _ in (DESK, TELEPHONE):
        assert (appended[wide]["psfs"], appended[wide]["asked"]) == ([2, 0], [0, 2])
    assert appended[PAPER[0]]["psfs"] == [2, 2]


def test_nothing_is_clipped_on_paper_and_tables_are_unfolded(looked, appended):
    for told in (looked[PAPER[0]], appended[PAPER[0]]):
        assert told["beyond"] == []
        assert (told["cut"], told["heads"]) == (0, 0)
    assert {each.split(" (")[0] for each in appended[PAPER[0]]["unfolded"]} == {"All numbers", "Checks by quantity"}
    assert appended[DESK[0]]["unfolded"] == looked[DESK[0]]["unfolded"] == []


def test_a_die_is_a_page_of_a4(looked):
    heights = looked[PAPER[0]]["heights"]
    assert len(heights) == 3
    assert max(heights) <= PAPER[1]


def test_the_browser_prints_pages_of_a4_and_has_nothing_to_complain_of(chromium, pages, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(pages[0], encoding="utf-8")
    paper = chromium.printed(file)
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", paper)
    assert {(round(float(wide)), round(float(high))) for wide, high in boxes} == {A4_PT}
    # The decision, the evidence, and the two dies.
    assert len(re.findall(rb"/Type /Page\b", paper)) == 4
    assert chromium.complaints() == []
