"""The pages of a run, opened from their files in both browsers: whole, legible, and leading to one another."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from browser import DESK, TELEPHONE, faults
from small_job import finished

from maskfab.base.model import Quantity
from maskfab.base.provenance import sha256_of_file
from maskfab.report.pages.template import in_view, linked_places
from maskfab.report.text import quantity_document
from maskfab.runs.verification import verify

LIMITS = ("[plate]", '[limits]\nmin_feature = "9 um"\n\n[plate]')
BAD = """<!DOCTYPE html><meta charset="utf-8"><body style="margin: 0">
<p id="pale" style="color: #888">pale words</p><p style="opacity: .5">faded</p><p>words</p><p>still</p>
<a href="#nothing">a place</a> <a href="none.html">a file</a> <a href="#pale">there</a>
<div style="overflow-x: auto"><div style="width: 900px">in its own box</div></div>
<div style="width: 700px">wide</div>
<details><summary>folded</summary><p style="background: #777; color: #888">hidden</p></details>
<img src="none.png" alt="gone"><img src="https://example.org/far.png" alt="far">
<script>nothing.at.all</script>
"""


def test_what_is_wrong_with_a_page_is_found(browser, tmp_path):
    page = tmp_path / "bad.html"
    page.write_text(BAD, encoding="utf-8")
    told = "\n".join(faults(browser, page))
    for part in (
        'contrast 3.54 of <p #pale> "pale words" (1280, 1280 dark, 390, 390 dark)', '"hidden"', '"faded"',
        "leads nowhere: #nothing", "leads nowhere: none.html", "wider than the window: <div> (390, 390 dark)",
        "no picture: gone", "https://example.org/far.png", "nothing is not defined",
    ):  # fmt: skip
        assert part in told
    assert "in its own box" not in told
    assert "#pale " not in told.replace("<p #pale>", "")


@pytest.fixture(scope="module")
def broken(tmp_path_factory) -> Path:
    """A run whose two dies are narrower in places than the job allows."""
    return finished(tmp_path_factory.mktemp("broken"), LIMITS, code=1)


@pytest.mark.parametrize("name", ["report.html", "appendix.html", "view.html"])
def test_a_page_opens_anywhere(browser, broken, name):
    assert faults(browser, broken / name) == []


@pytest.mark.parametrize("size", [DESK, TELEPHONE], ids=["desk", "telephone"])
def test_a_broken_rule_leads_to_its_place_and_its_die_to_its_numbers(browser, broken, size):
    browser.open(broken / "report.html", size)
    browser.run("document.querySelector('.failures a[href*=TURNED]').click()")
    browser.until("return location.pathname.endsWith('/view.html') && document.querySelector('#told')?.textContent")
    assert browser.run("return location.hash") == "#rule=width&die=TURNED&place=1"
    assert browser.run("return document.querySelector('#told').textContent").startswith("width, place ")
    assert browser.run("return document.querySelector('#dies [aria-pressed=true]').textContent") == "TURNED"
    view, die, pointed = browser.inside("[view, told.dies[chosen], pointed]")
    (x0, y0, x1, y1), box = (pointed[side] for side in "0123"), die["box"]
    assert die["name"] == "TURNED"
    assert box[0] <= x0 <= x1 <= box[2]
    assert box[1] <= y0 <= y1 <= box[3]
    assert (view["x"], view["y"]) == ((x0 + x1) / 2, (y0 + y1) / 2)
    # What is narrow there can be told by eye, and its surroundings are seen.
    assert view["scale"] * 8000 >= 20
    assert view["scale"] * (x1 - x0) < size[0] / 2
    browser.run("document.querySelector('#chosen-links a').click()")
    browser.until("return location.pathname.endsWith('/appendix.html') && document.readyState === 'complete'")
    assert browser.run("const own = document.querySelector(':target'); return [own.id, own.checkVisibility()]") == [
        "numbers-TURNED",
        True,
    ]


def test_a_die_of_the_drawing_leads_to_its_numbers(browser, broken):
    browser.open(broken / "appendix.html")
    browser.run("document.documentElement.style.scrollBehavior = 'auto'")
    browser.run("document.querySelector('.places').scrollIntoView()")
    seen = browser.run("""
        const { left, top, width, height } = document.querySelector(".places img").getBoundingClientRect();
        return [...document.querySelectorAll(".places a")].map((each) => {
          const box = each.getBoundingClientRect(), x = (box.left + box.right) / 2, y = (box.top + box.bottom) / 2;
          return [document.elementFromPoint(x, y) === each, each.hash, (x - left) / width, (y - top) / height];
        });
    """)
    assert [(hit, name) for hit, name, *_ in seen] == [(True, "#numbers-PLAIN"), (True, "#numbers-TURNED")]
    # Of the drawing, 2.37 halves of the blank wide and high, 1.17 lie above and 1.11 left of the plate's middle.
    for sign, (*_, x, y) in zip((-1, 1), seen, strict=True):
        assert x == pytest.approx((1.11 + sign / 13.5) / 2.37, abs=1e-3)
        assert y == pytest.approx(1.17 / 2.37, abs=1e-3)


def test_a_place_is_told_by_rule_by_point_or_by_die():
    def row(name: str, method: str, **more: object) -> dict[str, object]:
        detail = "um" if name.startswith("shop_") else None
        return quantity_document(Quantity(name, 1.0, method, passed=False, detail=detail, **more))

    rows = (
        row("corner_touches", "count", die="A"), row("min_space", "least", die="B"), row("corner_touches", "count"),
        row("shop_min_feature", "at (-1.500, 2.000) um in die A, 3 in all. Use a coarser dot"),
        row("shop_grid", "at (4.000, 5.000) um in the marks, 1 in all"), row("mtf50", "seen", die="A"),
        row("polygons", "count"),
    )  # fmt: skip
    assert [in_view(each) for each in rows] == [
        "view.html#rule=corner_touch&die=A", "view.html#rule=space&die=B", "view.html#rule=corner_touch",
        "view.html#rule=shop_min_feature&die=A&x=-1.500&y=2.000", "view.html#rule=shop_grid&x=4.000&y=5.000",
        "view.html#die=A", "view.html",
    ]  # fmt: skip
    many = linked_places([row("mtf50", "seen", die=f"D{n}") for n in range(14)] * 2)
    assert (many.count("<a "), many.endswith("2 more")) == (12, True)


def test_a_point_is_gone_to_whatever_rule_names_it(browser, broken):
    browser.open(f"{(broken / 'view.html').as_uri()}#rule=shop_grid&x=-1000.5&y=20")
    assert browser.inside("[view.x, view.y, pointed, told.dies[chosen].name]") == [
        -1_000_500, 20_000, [-1_000_500, 20_000, -1_000_500, 20_000], "PLAIN",
    ]  # fmt: skip
    assert browser.run("return document.querySelector('#told').textContent") == "shop_grid, x −1000.5 µm, y 20 µm"


@pytest.mark.usefixtures("read_here", "verified_once", "drawn_in_words")
def test_a_view_that_was_changed_with_its_hash_is_told(broken, tmp_path):
    def judged(folder: Path) -> list[bool | None]:
        checks = verify(folder).checks
        return [row.passed for row in checks if row.name == "made_again" and "view.html" in row.method]

    run = Path(shutil.copytree(broken, tmp_path / "run"))
    assert judged(run) == [True]
    page, mark = run / "view.html", run / "manifest.json"
    before = sha256_of_file(page)
    page.write_text(page.read_text(encoding="utf-8").replace("PLAIN", "OTHER"), encoding="utf-8")
    mark.write_text(mark.read_text().replace(before, sha256_of_file(page)))
    assert judged(run) == [False]
