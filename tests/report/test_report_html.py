from __future__ import annotations

import json
import re
from dataclasses import replace
from hashlib import sha256
from html.parser import HTMLParser

import pytest

from maskfab.job.camera import Stop
from maskfab.job.process import UNSTATED
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.optics.scene.model_bar import bar_of_pupil
from maskfab.report.documents.report import report_text, to_document
from maskfab.report.figures import report as report_figures
from maskfab.report.pages import page as html
from maskfab.report.pages.appendix import appendix_page
from maskfab.report.pages.front import shown_count, shown_dies, stamps
from maskfab.report.pages.template import limit_text
from maskfab.report.text import rounded

MARKUP = "<script>alert('x')</script>"


@pytest.fixture(scope="module")
def document(run):
    return to_document(run.report, run.plate, run.camera)


@pytest.fixture(scope="module")
def pictures(run, document):
    return report_figures.pictures(run.plate, run.optics, document)


@pytest.fixture(scope="module")
def page(document, pictures):
    return html.html_page(document, pictures)


@pytest.fixture(scope="module")
def appendix(document, pictures):
    return appendix_page(document, pictures)


LINKS = ("#", "data:image/", "report.html", "appendix.html", "numbers.csv")
"""Where a page may lead: into itself, to what it holds, and to the files beside it."""


class Reader(HTMLParser):
    """Tags that are open, and every attribute that could fetch something."""

    VOID = frozenset({"meta", "img", "br", "input"})

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.links, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in {"src", "href", "action", "srcset", "data"}]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    assert reader.open == []
    return reader


@pytest.mark.parametrize("made", ["page", "appendix"])
def test_pages_are_well_formed_and_fetch_nothing(request, made):
    page = request.getfixturevalue(made)
    reader = read(page)
    assert {"script", "link", "iframe", "object"}.isdisjoint(reader.tags)
    assert all(link.startswith(LINKS) for link in reader.links)
    assert "http://" not in page
    assert "https://" not in page
    assert "@import" not in page
    assert "url(" not in re.sub("src='[^']*'", "", page)


def test_links_between_the_pages_lead_somewhere(page, appendix):
    for one, other, name in ((page, appendix, "appendix.html"), (appendix, page, "report.html")):
        assert {link[1:] for link in read(one).links if link[:1] == "#"} <= set(re.findall(r'id="([^"]+)"', one))
        targets = {link.partition("#")[2] for link in read(one).links if link.startswith(name)} - {""}
        assert targets <= set(re.findall(r'id="([^"]+)"', other))
    assert {"die-PLAIN", "die-TURNED", "files"} <= {link.partition("#")[2] for link in read(page).links}


def test_the_appendix_has_every_die_check_and_file_and_the_report_their_short_hashes(page, appendix, document):
    words = " ".join(" ".join(read(appendix).text).split())
    for die in document["dies"]:
        assert f'id="die-{die["name"]}"' in page
        assert f'id="die-{die["name"]}"' in appendix
        assert die["label"] in words
    checks = appendix[appendix.index('<section id="checks"') : appendix.index('<section id="files"')]
    failed, _, passed = checks.split("<details")
    judged = [check["passed"] for check in document["checks"]]
    assert (failed.count("<tr>"), passed.count("<tr>")) == (judged.count(False) + 1, judged.count(True) + 1)
    for file in document["files"]:
        assert file["path"] in words
        assert file["sha256"] in words
        assert file["sha256"][: html.SHORT_HASH] in page
        assert file["sha256"] not in page
    assert document["job_hash"] in page
    assert sha256(report_text(document).encode()).hexdigest()[: html.SHORT_HASH] in page


def test_front_says_fail_and_how_to_mend_it(page):
    front = page[: page.index("</header>")]
    words = " ".join(" ".join(read(front + "</header></body></html>").text).split())
    assert "FILES ✓ AS DESIGNED 1 checks pass; no mask house chosen" in words
    assert "OPTICS ✗ NOT PROVED 2 of 4 checks failed" in words
    for verdict in ("FITS", "LOOKS", "LIVES"):
        assert f"{verdict} ? NOT JUDGED the job has no [emitters]" in words
    assert "1 kind of check failed" in words
    assert "PASS" not in front
    whole = " ".join(" ".join(read(page).text).split())
    assert "What failed The written file differs from the design." in whole
    assert "limit ≤ 10⁻⁶" in whole


def test_passing_report_says_pass_and_lists_no_failures(run, document):
    good = [check for check in document["checks"] if check["passed"]]
    tally = {"checks": len(good), "failed": 0, "passed": True}
    verdicts = {**document["verdicts"], "files": tally, "optics": tally}
    page = html.html_page({**document, "verdict": "pass", "verdicts": verdicts, "checks": good}, {})
    front = page[: page.index("</header>")]
    assert "✓ AS DESIGNED" in front
    assert "✓ PROVED" in front
    assert "What failed" not in page


def test_a_plate_can_be_ordered_only_where_a_house_was_asked(document):
    passed = {"checks": 1, "failed": 0, "passed": True}
    asked = {**document, "verdicts": {**document["verdicts"], "files": passed}}
    house = {**document["checks"][0], "name": "shop_blank", "passed": True}
    words = stamps({**asked, "checks": [house]})[0].word, stamps({**asked, "checks": []})[0].word
    assert words == ("CAN BE ORDERED", "AS DESIGNED")


def test_markup_in_a_label_is_inert(page, appendix):
    for made in (page, appendix):
        assert MARKUP not in made
        assert "&lt;script&gt;" in made


def test_tables_carry_full_values_and_units(page, appendix):
    for made in (page, appendix):
        assert 'title="0.123456789 ± 1e-07">0.1235' in made
    assert "furlong" in appendix
    assert "Shop rule: flashes" in appendix


def test_page_does_not_tell_the_time(run, document, page):
    slower = to_document(replace(run.report, seconds={"export": 99.0}), run.plate, run.camera)
    assert html.html_page(slower, report_figures.pictures(run.plate, run.optics, slower)) == page


def test_page_without_pictures_dies_or_checks_still_reads(document):
    empty = {**document, "dies": [], "plate": [], "checks": [], "files": [], "seeds": {}}
    assert "No check was requested" in appendix_page(empty, {})
    assert "No photographs" in html.html_page(empty, {})


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        ("R12", "R12"),
        (0.0, "0"),
        (0, "0"),
        (0.2, "0.2000"),
        (0.123456, "0.1235"),
        (41.98765, "41.99"),
        (-36.5, "−36.50"),
        (1234567, "1\u202f234\u202f567"),
        (2.5e-13, "2.50 × 10⁻¹³"),
        (1.5e7 + 0.5, "1.50 × 10⁷"),
    ],
)
def test_numbers_have_few_digits(value, text):
    assert rounded(value) == text


@pytest.mark.parametrize(
    ("value", "bound", "passed", "text"),
    [
        (1e-9, 1e-6, True, "≤ 10⁻⁶"),
        (1e-3, 1e-6, False, "≤ 10⁻⁶"),
        (3.0, 2.5, True, "≥ 2.5"),
        (2.0, 2.5, False, "≥ 2.5"),
        (-0.08, 0.05, False, "≤ 0.05"),
        (0, 0, True, "0"),
        (1.0, None, None, "–"),
        ("a", "a", True, "a"),
    ],
)
def test_limits_say_on_which_side_to_be(value, bound, passed, text):
    assert limit_text({"value": value, "limit": bound, "passed": passed}) == text


def row(name: str, value: float, line: float | None = None, passed: bool | None = None) -> dict:
    """A row of report.json."""
    limit = None if passed is None else 1.0
    found = {"name": name, "symbol": "s", "value": value, "unit": "1", "uncertainty": 0.5, "method": f"way {line}"}
    return found | {"limit": limit, "passed": passed} | ({} if line is None else {"wavelength_nm": line})


def test_wavelengths_stand_side_by_side_and_rare_rows_are_folded_unless_they_fail(document):
    rows = [
        *(row("halo_energy", line / 1e4, line) for line in (610.0, 530.0)),
        row("peak_to_side_lobe", 7.5, 530.0),
        *(row("mtf50_per_pixel", line / 1e5, line) for line in (610.0, 530.0)),
        row("first_side_lobe", 2.5, 610.0, passed=True),
        row("first_side_lobe", 3.5, 530.0, passed=False),
        row("order_zero_incident", 0.25),
        row("orders_lowest_five_transmitted", 0.75),
    ]
    die = {**document["dies"][0], "quantities": rows}
    page = appendix_page({**document, "dies": [die], "checks": []}, {})
    section = page[page.index('<section class="die"') : page.index('<section id="plate"')]
    read(page)
    often, rarely = section.split("<details>")
    assert "Rarely read (2)" in rarely
    assert re.findall(r'<td title="(\w+)">', often) == [
        "halo_energy", "peak_to_side_lobe", "first_side_lobe", "orders_lowest_five_transmitted",
    ]  # fmt: skip
    assert re.findall(r'<td title="(\w+)">', rarely) == ["mtf50_per_pixel", "order_zero_incident"]
    assert ">610 nm</th>" in often
    assert 'title="0.061 ± 0.5">0.1<small>± 0.5</small></td>' in often
    assert '<td class="n quiet">–</td>' in often  # no side lobe was looked for at 610 nm
    assert "✗ 3.5" in often
    assert "✗ FAIL</td>" in often


def test_rows_of_files_are_folded_unless_they_failed(document):
    """A die has many for every file of its own; the plate's are told apart likewise."""
    rows = [
        row("open_ratio", 0.25),
        row("solid_wrong_cells", 0, passed=True),
        row("bitmap_xor_area", 0.5, passed=True),
        row("solid_volume_error", 0.5, passed=False),
        row("bitmap_xor_area", 7.5, passed=False),
    ]
    plate = [
        row("drawn_holes", 3),
        row("polygons", 40),
        row("solid_dies", 2, passed=True),
        row("solid_strangers", 1, passed=False),
    ]
    die = {**document["dies"][0], "quantities": rows}
    page = appendix_page({**document, "dies": [die], "plate": plate, "checks": []}, {})
    read(page)
    named = r'<td title="(\w+)">'
    of_plate = page[page.index('<section id="plate"') : page.index('<section id="checks"')]
    shown, rare = of_plate.split("<details>")
    assert re.findall(named, shown) == ["polygons", "solid_strangers"]
    assert "Rarely read (1)" in rare
    assert re.findall(named, rare.split("</details>")[0]) == ["drawn_holes"]
    section = page[page.index('<section class="die"') : page.index('<section id="plate"')]
    often, rarely = section.split("<details>")
    assert re.findall(named, often) == ["open_ratio", "solid_volume_error", "bitmap_xor_area"]
    assert re.findall(named, rarely) == ["solid_wrong_cells", "bitmap_xor_area"]


def test_what_is_not_modelled_stands_apart_the_largest_first(run):
    name = run.plate.dies[0].name
    camera = replace(run.camera, stop=Stop("circle", 300.0))
    pupil = cut(panel_aperture(run.plate.dies[0].panel, 150.0), camera.stop)
    bar = bar_of_pupil(pupil, camera, UNSTATED, name)
    with_bar = replace(run.report, dies={**run.report.dies, name: (*run.report.dies[name], *bar)})
    document = to_document(with_bar, run.plate, run.camera)
    assert [row["name"] for row in document["dies"][0]["quantities"][-len(bar) :]] == [each.name for each in bar]
    page = appendix_page(document, {})
    (section,) = re.findall(r"<summary>Not modelled, by size .*?</table>", page, re.DOTALL)
    assert re.findall(r'<td title="(model_\w+)">', section) == [each.name for each in bar]
    assert page.count('title="model_chrome_leak"') == 1
    assert "Not modelled" not in appendix_page(to_document(run.report, run.plate, run.camera), {})


@pytest.fixture(scope="module")
def crowd(small_result):
    """The report of a run as if its plate had 160 of its first die; two of them fail."""
    document = json.loads((small_result / "report.json").read_text(encoding="utf-8"))
    first = document["dies"][0]
    own = [check for check in document["checks"] if check.get("die") == first["name"]]
    names = [f"D{number}" for number in range(160)]
    rows = {name: [{**row, "die": name} for row in first["quantities"]] for name in names}
    checks = [{**check, "die": name, "passed": name not in {"D90", "D159"}} for name in names for check in own]
    dies = [{**first, "name": name, "label": f"label {name}", "quantities": rows[name]} for name in names]
    return {**document, "dies": dies, "checks": checks}


def test_many_dies_are_a_table_that_unfolds(crowd):
    unfolded = shown_dies(crowd)
    shown = shown_count(160)
    assert len(unfolded) == shown < 160
    assert {"D90", "D159"} < set(unfolded)
    figure = f"<img src='data:image/png;base64,{'A' * 40_000}' alt=''>"
    page = appendix_page(crowd, {name: {"psf": figure} for name in unfolded})
    read(page)
    for die in crowd["dies"]:
        assert page.count(f'id="die-{die["name"]}"') == 1
        assert f"“{die['label']}”" in page
    assert page.count(figure) == page.count('<section class="die"') == shown
    folded = page[page.index('<section id="folded"') : page.index('<section id="plate"')]
    assert folded.count("<details>") == folded.count('<table class="marked" id="numbers-') == 160 - shown
    words = " ".join(folded.split())
    assert f"of {shown} of the 160 dies" in words
    assert "Left out are their figures, methods, rarely read numbers" in words
    line = next(row for row in crowd["dies"][0]["quantities"] if row["name"] == "stop_open_ratio")
    assert folded.count(f">{rounded(line['value'])}</td>") >= 160 - shown
    signed = html.html_page(crowd, {})
    read(signed)
    assert signed.count('<section class="die page"') == shown
    assert f"Pages follow for {shown} of the 160 dies" in signed
    left = [die["name"] for die in crowd["dies"] if die["name"] not in unfolded]
    assert all(f'href="appendix.html#die-{name}"' in signed for name in left)
    # A thousand dies, and figures of the size that they have: within 10 MB.
    fewer = appendix_page({**crowd, "dies": crowd["dies"][:100]}, {})
    of_each = (len(page) - shown * len(figure) - len(fewer)) / 60
    assert len(page) + 840 * of_each < 10e6


def test_a_few_dies_are_all_shown(crowd):
    few = {**crowd, "dies": crowd["dies"][:20]}
    page = appendix_page(few, {})
    assert shown_dies(few) == tuple(die["name"] for die in few["dies"])
    assert 'id="folded"' not in page
    assert page.count('<section class="die"') == 20
    assert "Checks that passed (" in page
