"""Bands on the page: beside each number, dies ranked by what a bias does to them, and a word where there are none."""

from __future__ import annotations

import pytest
from report.test_front import A, B, document_of, front_of, taken
from report.test_report_html import read

from maskfab.base.model import Quantity
from maskfab.findings.bands import ProcessSpread
from maskfab.job.process import Process
from maskfab.report.documents.report import to_document
from maskfab.report.pages.appendix import appendix_page
from maskfab.report.pages.page import html_page
from maskfab.report.pages.tables import die_table, edges, ranked, spread_words
from maskfab.report.text import quantity_document


def band(name: str, low: float, high: float, **places: object) -> dict:
    return quantity_document(Quantity(name, (high - low) / 2, "made up", between=(low, high), **places))


def sensitivity(name: str, value: float, **places: object) -> dict:
    return quantity_document(Quantity(f"sensitivity_{name}", value, "made up", **places))


@pytest.fixture
def document(run):
    made = document_of(run, taken(PLAIN=A, TURNED=B)) | {
        "process": {"corner_radius_um": 1.0, "cd_bias_um": 0.0, "roughness": None},
        "spread": {"bias_um": 0.1, "radius_um": 0.0},
    }
    plain, turned = made["dies"]
    plain["quantities"] += [
        band("band_restored_psnr", 24.9, 25.1, die="PLAIN", level_db=32.0),
        sensitivity("psf_shape", 2.5e-3, die="PLAIN"),
        sensitivity("restored_psnr", 0.009, die="PLAIN", level_db=32.0),
    ]
    turned["quantities"] += [
        band("band_restored_psnr", 30.15, 30.25, die="TURNED", level_db=32.0),
        band("band_restored_gain", 5.12, 5.28, die="TURNED", level_db=32.0),
        band("band_stop_open_ratio", 0.2262, 0.2282, die="TURNED"),
        sensitivity("psf_shape", 2.9e-4, die="TURNED"),
        sensitivity("restored_psnr", -0.02, die="TURNED", level_db=32.0),
    ]
    return made


def test_the_front_has_the_bands_of_the_best_die(document):
    words = front_of(document)
    assert "95 % of displays made gain +5.12–5.28 dB." in words
    assert "30.20 dB, made 30.15–30.25 dB" in words
    assert "made 0.226–0.228" in words


def test_dies_side_by_side_have_theirs(document):
    best, reference = die_table(document).lines
    assert (best.psnr.made, best.gain.made) == ("30.15–30.25", "+5.12–5.28")
    assert (reference.psnr.made, reference.gain.made) == ("24.90–25.10", "")
    assert best.cells[0].made == "0.226–0.228"
    assert "30.15–30.25" in html_page(document, {})


def test_dies_are_ranked_and_the_most_and_the_least_sensitive_are_named(document):
    found = ranked(document)
    assert [each.name for each in found.lines] == ["PLAIN", "TURNED"]
    words = " ".join(" ".join(read(appendix_page(document, {})).text).split())
    assert "most behind PLAIN (0.00250), least behind TURNED (2.9 × 10⁻⁴)" in words
    assert "restored photographs most behind TURNED (−0.020 dB), least behind PLAIN (+0.009 dB)" in words


def test_without_a_process_one_line_says_so(run):
    document = document_of(run, taken(PLAIN=A, TURNED=B))
    assert ranked(document) is None
    assert "displays made" not in front_of(document)
    assert 'id="sensitivity"' not in appendix_page(document, {})


def test_the_spread_is_part_of_the_document(run):
    document = to_document(run.report, run.plate, run.camera, spread=ProcessSpread(0.1, 0.2), process=Process(1.0))
    assert document["spread"] == {"bias_um": 0.1, "radius_um": 0.2}
    assert spread_words(document).endswith("CD bias ± 0.1 µm, corner radius ± 0.2 µm")


@pytest.mark.parametrize(
    ("between", "text"),
    [((0.2262, 0.2282), "0.226–0.228"), ((0.13634, 0.13749), "0.136–0.137"), ((0.17450, 0.17459), "0.17450–0.17459"),
     ((-0.004, 0.003), "−0.004 to 0.003"), ((1e-18, 3e-17), "0.000–0.000"), ((0.5, 0.5), "0.500–0.500")],
)  # fmt: skip
def test_edges_have_as_many_decimals_as_show_the_band(between, text):
    assert edges({"between": between}) == text
