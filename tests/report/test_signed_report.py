"""The report that is signed: which die may be called best, what stands beside it, and how long it may be."""

from __future__ import annotations

import csv
import io
import json
import re

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from report.test_front import A, B, document_of, front_of, taken
from report.test_report_html import read
from small_job import finished

from maskfab.base.model import Quantity
from maskfab.base.resources import path as resource
from maskfab.base.units import decimals_of
from maskfab.camera.scores import MeanDifference
from maskfab.report.documents.numbers import COLUMNS, methods, numbers_text, rows_of
from maskfab.report.pages.appendix import appendix_page
from maskfab.report.pages.breaches import breach_words, breaches, broken, limit_lines
from maskfab.report.pages.front import Best, best, decision, stamps
from maskfab.report.pages.page import html_page, judged_dies, key_rows
from maskfab.report.text import EXACT, short, table_lines, value_and_error
from maskfab.runs.pipeline import run as run_job

LAYOUTS = resource("layouts")
DELTA_E, GRAIN, LIFE = 2.3, 0.015, 1 / 3


def display(*, fits: str = "FITS", delta_e: float = 1.0, grain: float = 0.01, life: float = 0.5) -> dict:
    """The display of a die as report.json tells it."""

    def number(name: str, value: float, limit: float | None, *, passed: bool | None) -> dict:
        return {
            "name": name, "value": value, "reference": 0.001, "unit": "1", "limit": limit, "stated": name == "grain",
            "passed": passed, "source": "somebody, 1994",
        }  # fmt: skip

    looks = [
        number("delta_e", delta_e, DELTA_E, passed=delta_e <= DELTA_E),
        number("grain", grain, GRAIN, passed=grain <= GRAIN),
        number("fringe", 31.0, None, passed=None),
    ]
    lives = [number("life", life, LIFE, passed=life >= LIFE)]
    return {
        "verdict": fits, "required": 0.1, "share": 0.125, "bound_share": 0.3, "found_share": 0.2, "method": "cuts",
        "rectangles_share": 0.1, "emitters": None, "wires": None, "borders": None, "circuits": {"room_um2": 1.0,
        "need_um2": 2.0}, "proofs": [], "bound_proof": None,
        "looks": {"verdict": "KEPT" if delta_e <= DELTA_E and grain <= GRAIN else "BROKEN", "numbers": looks},
        "lives": {"verdict": "KEPT" if life >= LIFE else "BROKEN", "numbers": lives},
        "reference": {"layout": "stripe", "emitter_share": 0.26},
    }  # fmt: skip


def judged(run, photographs, **displays):
    """A report of dies with these displays."""
    document = document_of(run, photographs)
    dies = [{**die, "display": displays[die["name"]]} for die in document["dies"]]
    return {**document, "dies": dies}


C = (24.0, 28.0, 33.5)


def test_a_die_that_breaks_a_limit_is_never_best_and_the_cost_of_limits_is_told(run):
    document = judged(run, taken(PLAIN=C, TURNED=B), PLAIN=display(), TURNED=display(grain=0.0252))
    found = best(document)
    assert isinstance(found, Best)
    assert (found.name, found.broken, found.others) == ("PLAIN", (), 0)
    cost = MeanDifference.of([one - two for one, two in zip(B, C, strict=True)])
    assert f"The limits of the display cost {cost.mean:.1f} ± {cost.half_width:.1f} dB: TURNED restores" in found.limits
    assert "breaks LOOKS (slow grain 0.0252, limit ≤ 0.015)." in found.limits
    words = front_of(document)
    assert found.limits in words
    assert "Best die PLAIN" in words
    assert [row.role for row in judged_dies(document, found)] == ["best, reference", ""]


@pytest.mark.parametrize(
    ("broke", "name"),
    [({"fits": "DOES NOT FIT"}, "FITS"), ({"fits": "UNKNOWN"}, "FITS"), ({"delta_e": 3.6}, "LOOKS"),
     ({"life": 0.3}, "LIVES")],
    ids=["does not fit", "unknown", "looks", "lives"],
)  # fmt: skip
def test_every_verdict_keeps_a_die_from_being_best(run, broke, name):
    document = judged(run, taken(PLAIN=A, TURNED=B), PLAIN=display(), TURNED=display(**broke))
    found = best(document)
    assert (found.name, broken(document["dies"][1])) == ("PLAIN", (name,))
    assert name in found.limits


def test_where_no_die_keeps_all_the_limit_that_binds_is_named_and_nothing_is_called_best(run):
    worse = display(fits="DOES NOT FIT", delta_e=4.0, life=0.1)
    document = judged(run, taken(PLAIN=B, TURNED=A), PLAIN=worse, TURNED=display(delta_e=3.6))
    found = best(document)
    assert (found.name, found.broken) == ("TURNED", ("LOOKS",))
    assert found.heading == "No die keeps all limits; the best without LOOKS"
    assert "What binds is LOOKS (ΔE of even white 3.60, limit ≤ 2.3)" in found.limits
    assert "TURNED keeps FITS and LIVES." in found.limits
    assert decision(document, found).startswith("Build none of these: no die keeps FITS, LOOKS and LIVES. TURNED")
    words = front_of(document)
    assert "Best die" not in words
    assert "(best)" not in words
    assert "best" not in {row.role for row in judged_dies(document, found)}


def test_the_decision_names_the_die_its_gain_its_display_and_the_order(run):
    document = judged(run, taken(PLAIN=A, TURNED=B), PLAIN=display(), TURNED=display())
    found = best(document)
    gain = found.gain.told(digits=1).lstrip("+")
    assert decision(document, found) == (
        f"Build TURNED: photographs through it restore {gain} better than PLAIN's; its display fits, looks right and "
        "lives long enough; before an order choose a mask house."
    )
    files = {**document["verdicts"]["files"], "passed": False, "failed": 3}
    failed = {**document, "verdicts": {**document["verdicts"], "files": files}}
    assert decision(failed, found).endswith("; do not order, for 3 checks of the files failed.")
    tied = judged(run, taken(PLAIN=A, TURNED=(A[0] + 1.0, A[1] - 0.9, A[2])), PLAIN=display(), TURNED=display())
    assert decision(tied, best(tied)).startswith("Nothing here is surely better than PLAIN: TURNED is ahead")


def test_limits_that_cost_nothing_say_so_and_a_plate_without_displays_says_nothing(run):
    free = judged(run, taken(PLAIN=A, TURNED=B), PLAIN=display(delta_e=3.0), TURNED=display())
    assert best(free).limits.startswith("The limits of the display cost nothing")
    bare = document_of(run, taken(PLAIN=A, TURNED=B))
    assert (best(bare).limits, limit_lines(bare["dies"][0]), broken(bare["dies"][0])) == ("", (), ())


def test_defaults_say_that_they_are(run):
    lines = breaches({"display": display(delta_e=3.0, grain=0.02, life=0.2)})
    assert breach_words(lines).endswith("; some limits are defaults")
    assert breach_words(breaches({"display": display(delta_e=3.0)})).endswith("; these limits are defaults")
    assert "defaults" not in breach_words(breaches({"display": display(grain=0.02)}))
    page = html_page(judged(run, taken(PLAIN=A, TURNED=B), PLAIN=display(), TURNED=display()), {})
    table = page[page.index('<table class="limits">') : page.index("</table>", page.index('<table class="limits">'))]
    assert "≤ 2.3*" in table
    assert "≤ 0.015*" not in table


def test_a_reference_that_is_meant_to_fail_is_not_red(run):
    document = judged(run, taken(PLAIN=A, TURNED=B), PLAIN=display(fits="DOES NOT FIT", life=0.1), TURNED=display())
    shown = {stamp.name: stamp for stamp in stamps(document)}
    for name in ("FITS", "LOOKS", "LIVES"):
        assert (shown[name].mood, shown[name].word) == ("good", "1 OF 1 DIE"), name
    assert "not the reference PLAIN" in shown["FITS"].basis
    page = html_page(document, {})
    for start, end in (('<table class="dies">', "</table>"), ('id="die-PLAIN"', "</section>")):
        part = page[page.index(start) : page.index(end, page.index(start))]
        assert 'class="bad"' not in part
        assert "✗" in part
    worse = judged(run, taken(PLAIN=A, TURNED=B), PLAIN=display(), TURNED=display(fits="DOES NOT FIT"))
    assert {stamp.name: stamp.mood for stamp in stamps(worse)}["FITS"] == "bad"


def test_dies_that_keep_every_limit_stand_first(run):
    document = judged(run, taken(PLAIN=A, TURNED=B), PLAIN=display(), TURNED=display(life=0.2))
    rows = judged_dies(document, best(document))
    assert [row.line.name for row in rows] == ["PLAIN", "TURNED"]
    assert [row.verdicts for row in rows] == [(True, True, True), (True, True, False)]
    assert [cell.name for cell in rows[0].cells] == ["delta_e", "grain", "emitters", "life"]


def test_no_two_psnrs_of_a_die_stand_without_their_scenes(run):
    words = front_of(document_of(run, taken(PLAIN=A, TURNED=B)))
    for number in re.finditer(r"(?<![±+] )\b\d\d\.\d+ dB", words):
        around = words[max(0, number.start() - 60) : number.end() + 40]
        assert "scene" in around, around


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A run of two dies with displays."""
    rules = (
        '[emitters]\ngap_to_opening = "0 um"\ncolour_gap = "8 um"\nmin_width = "8 um"\ncircuit = "1 um^2"\n\n[[die]]'
    )
    return finished(tmp_path_factory.mktemp("shown"), ("[[die]]", rules))


@pytest.fixture(scope="module")
def document(shown):
    return json.loads((shown / "report.json").read_text(encoding="utf-8"))


def words_of(page: str) -> int:
    text = re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)
    return len(re.sub(r"<[^>]*>", " ", text).split())


def test_twelve_dies_are_few_words_and_bytes(shown):
    """What both pages before the dies have, with a line of a table for each, and twelve times the longest die."""
    page = (shown / "report.html").read_text(encoding="utf-8")
    front, *dies = page.split('<section class="die page"')
    assert len(dies) == 2
    lines = re.findall(r"<tr.*?</tr>", front[front.index('<table class="dies">') :], re.DOTALL)
    words = words_of(front) + 10 * max(map(words_of, lines[1:3])) + 12 * max(words_of(f"<i {die}") for die in dies)
    assert words <= 9000
    size = len(front.encode()) + 12 * max(len(die.encode()) for die in dies)
    assert size <= 3e6


@pytest.mark.slow
def test_the_report_of_the_twelve_dies_that_are_shipped_keeps_its_budget(chromium, tmp_path):
    run_job(LAYOUTS / "upc12.toml", tmp_path / "out")
    file = tmp_path / "out" / "report.html"
    page = file.read_text(encoding="utf-8")
    assert words_of(page) <= 9000
    assert file.stat().st_size <= 3e6
    paper = chromium.printed(file)
    # The decision, the evidence, and the dies.
    assert len(re.findall(rb"/Type /Page\b", paper)) == 14


def test_a_run_of_two_dies_is_four_pages(chromium, shown):
    paper = chromium.printed(shown / "report.html")
    assert len(re.findall(rb"/Type /Page\b", paper)) == 4


def test_the_table_of_numbers_is_the_report_row_by_row(document, shown):
    table = list(csv.DictReader(io.StringIO((shown / "numbers.csv").read_text(encoding="utf-8"), newline="")))
    rows, listed = list(rows_of(document)), methods(document)
    assert len(rows) == len(table) == sum(len(die["quantities"]) for die in document["dies"]) + len(document["plate"])

    def spelt(value: object) -> str:
        return "" if value is None else json.dumps(value) if isinstance(value, bool) else str(value)

    for (die, row), line in zip(rows, table, strict=True):
        assert tuple(line) == COLUMNS
        assert line["die"] == die
        assert (line["method"], line["remark"]) == listed.of(row)
        assert line["error"] == spelt(row["uncertainty"])
        for column in ("name", "symbol", "value", "unit", "limit", "passed", "at_most", "wavelength_nm", "level_db"):
            assert line[column] == spelt(row.get(column)), column
        if isinstance(row["value"], float):
            assert float(line["value"]) == row["value"]


def test_texts_of_others_are_one_cell_of_the_table(document):
    wild = 'said "so", by\nsomebody, =1+1'
    first, *others = document["dies"][0]["quantities"]
    dies = [{**document["dies"][0], "quantities": [{**first, "value": wild}, *others]}]
    (line, *_) = csv.DictReader(io.StringIO(numbers_text({**document, "dies": dies}), newline=""))
    assert line["value"] == wild


def test_the_appendix_tells_each_method_once_and_the_report_none(document, shown):
    appendix, page = ((shown / name).read_text(encoding="utf-8") for name in ("appendix.html", "report.html"))
    told_there = read(appendix).text
    listed = methods(document)
    assert len(listed.keys) > 20
    assert len(set(listed.keys.values())) == len(listed.keys)
    for sentence, key in listed.keys.items():
        assert told_there.count(sentence) == 1
        assert f'<dt id="{key}">{key}</dt>' in appendix
        assert sentence not in read(page).text
    used = set(re.findall(r'href="appendix\.html#(M\d+)"', page))
    assert used <= set(listed.keys.values())
    assert len(used) > 10
    for _, row in rows_of(document):
        key, remark = listed.of(row)
        sentence = next(sentence for sentence, own in listed.keys.items() if own == key)
        assert row["method"] in {f"{sentence}{mark} {remark}" for mark in ";:"} | ({sentence} if not remark else set())


def test_clauses_that_differ_from_row_to_row_are_remarks():
    def row(name: str, method: str) -> dict:
        return {"name": name, "method": method}

    halo = [row("halo_energy", f"energy beyond 25 um; of that, {share} lies outside") for share in (0.1, 0.2)]
    own = [row("mtf50", "from the curve: first crossing"), row("polygons", "count"), row("shop_blank", "")]
    listed = methods({"dies": [{"name": "A", "quantities": halo}], "plate": own, "checks": halo})
    assert list(listed.keys) == ["energy beyond 25 um", "from the curve: first crossing", "count"]
    assert [listed.of(each) for each in (*halo, *own)] == [
        ("M1", "of that, 0.1 lies outside"), ("M1", "of that, 0.2 lies outside"), ("M2", ""), ("M3", ""), ("", ""),
    ]  # fmt: skip


def test_a_die_has_its_key_numbers_at_one_wavelength_and_all_that_failed(document):
    (die, _) = document["dies"]
    own = die["quantities"]
    psnrs = [{**own[0], "name": "restored_psnr", "level_db": level} for level in (24.0, 32.0)]
    failed = {**own[0], "name": "solid_volume_error", "passed": False}
    passed = {**own[0], "name": "bitmap_xor_area", "passed": True}
    rows = key_rows({**die, "quantities": [*own, *psnrs, failed, passed]}, 530.0, 32.0)
    assert rows[0] == psnrs[1]
    assert rows[-1] == failed
    names = [row["name"] for row in rows]
    assert len(set(names)) == len(names)
    assert len(names) > 8
    assert key_rows(die, 470.0, None) == [row for row in rows if row in own and "wavelength_nm" not in row]


def test_an_appendix_made_again_is_the_same_to_the_last_byte(document, shown):
    assert "Appendix to" in appendix_page(document, {})
    assert appendix_page(document, {}) == appendix_page(document, {})
    assert numbers_text(document) == (shown / "numbers.csv").read_text(encoding="utf-8")


NUMBERS = st.floats(1e-9, 1e9) | st.floats(-1e9, -1e-9)


def number_of(text: str) -> float:
    """A number as a page tells it."""
    plain = text.replace("\u202f", "").replace("−", "-")
    mantissa, _, exponent = plain.partition(" × 10")
    if bare := re.fullmatch(r"10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", plain):
        mantissa, exponent = "1", bare[1]
    power = exponent.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    return float(mantissa) * 10.0 ** int(power or 0)


@given(NUMBERS, st.floats(1e-9, 1e6))
def test_a_number_has_no_digit_that_its_error_does_not_allow(value, error):
    text, of_error = value_and_error(value, error)
    assume(of_error != EXACT)
    assert number_of(of_error) == pytest.approx(error, rel=0.15)
    step = 10.0 ** -decimals_of(error)
    if " × 10" not in text and "." in text:
        assert 10.0 ** -len(text.partition(".")[2]) >= 0.999 * step
    # To half a step of its last digit, or of its fourth.
    assert abs(number_of(text) - value) <= 0.5001 * max(step, 10.0 ** (len(f"{abs(value):.0f}") - 4), 1e-3 * abs(value))
    assert len(re.sub(r"\D", "", text.partition(" × ")[0]).lstrip("0")) <= max(4, len(f"{abs(value):.0f}"))


@given(NUMBERS)
def test_errors_of_rounding_are_told_as_exact(value):
    assert value_and_error(value, abs(value) * 1e-12)[1] == EXACT
    assert value_and_error(value, 0.0)[1] == EXACT
    assert value_and_error(value)[1] == ""
    assert value_and_error(value, abs(value) * 1e-6 + 1e-11)[1] != EXACT


@pytest.mark.parametrize(
    ("value", "error", "unit", "expected"),
    [
        (24.6162, 0.05, "dB", ("24.62", "0.05")),
        (24.6162, None, "dB", ("24.62", "")),
        (-0.0002, 0.03, "1", ("0.000", "0.030")),
        (6.2612, 1.5123, "dB", ("6.3", "1.5")),
        (0.8437, 2.5e-13, "1", ("0.8437", "exact")),
        (123456.7, 300.0, "um", ("123\u202f500", "300")),
        (3, None, "", ("3", "")),
        ("R12", None, "", ("R12", "")),
        (None, None, "dB", ("–", "")),
    ],
)
def test_numbers_are_told_as_their_errors_allow(value, error, unit, expected):
    assert value_and_error(value, error, unit) == expected


def test_limits_of_thirds_are_told_to_three_digits():
    assert short(LIFE, 3) == "0.333"
    assert next(line.limit for line in limit_lines({"display": display()}) if line.name == "life") == "≥ 0.333"


def test_a_table_of_quantities_has_the_digits_that_errors_allow():
    rows = (
        Quantity("restored_psnr", 24.6162, "drawn", 0.05, level_db=32.0),
        Quantity("auc_radial_min", 0.123456789, "mean", 1e-7, wavelength_nm=530.0),
        Quantity("readback_psf_difference", 2.49e-9, "L2", 1e-8, wavelength_nm=530.0),
        Quantity("stop_open_ratio", 0.5, "area", 1e-13),
        Quantity("polygons", 12345, "count"),
    )
    _, *lines = (re.split(r"\s{2,}", line) for line in table_lines(rows))
    assert [line[1:4] for line in lines] == [
        ["32 dB", "24.62", "± 0.05"],
        ["530 nm", "0.123457", "± 1.0e-07"],
        ["530 nm", "2e-09", "± 1.0e-08"],
        ["0.5", "exact", "1"],
        ["12345"],
    ]
