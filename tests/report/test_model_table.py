"""Time and error of the models behind a die, from the numbers that its report has."""

from __future__ import annotations

import json

from jsonschema import Draft202012Validator
from report.test_report_html import read, row

from maskfab.report.documents.report import schema, to_document
from maskfab.report.pages import appendix as html
from maskfab.report.pages.tables import model_table


def test_every_model_has_its_time_and_its_largest_error():
    die = {
        "expected_seconds": {"optics": 0.75, "written": 1.5, "photographs": 4.5},
        "scene": {"plan": {"predicted_seconds": 2.0, "error": 4e-4}},
        "quantities": [
            row("readback_psf_difference", 2e-9, 610.0),
            row("readback_psf_difference", 3e-9, 530.0),
            row("strehl_invariant_error", 1e-9, 530.0),
            row("written_psf_difference_fused", 0.02, 530.0) | {"uncertainty": 1e-6},
            row("restored_psnr", 20.0) | {"level_db": 24, "uncertainty": 0.5},
            row("restored_psnr", 25.0) | {"level_db": 32, "uncertainty": 0.05},
            row("model_bar", 0.2),
        ],
    }
    table = model_table(die, [24, 32, 40])
    assert [(line.title, line.seconds, line.error, line.at_most, line.unit) for line in table] == [
        ("PSF and MTF on the axis", 0.75, 3e-9, False, "1"),
        ("PSF and MTF as written", 1.5, 1e-6, False, "1"),
        ("PSF in the scene", 2.0, 4e-4, True, "1"),
        ("Restored photographs", 4.5, 0.05, False, "dB"),
        ("Left out by all", None, 0.2, False, "1"),
    ]


def test_a_report_of_an_earlier_version_has_no_such_table():
    assert model_table({"quantities": [row("model_bar", 0.2)]}, []) == []


def test_the_page_shows_it_for_the_dies_that_have_times(run):
    told = {"TURNED": {"optics": 0.123, "photographs": 4.5}}
    document = to_document(run.report, run.plate, run.camera, expected_s=told)
    Draft202012Validator(schema()).validate(document)
    page = html.appendix_page(document, {})
    assert page.count('<table class="models">') == 1
    assert page.index('id="die-TURNED"') < page.index('<table class="models">')
    assert "0.12 s" in read(page).text


def test_a_run_tells_the_times_that_a_dry_run_forecasts(small_result):
    dies = json.loads((small_result / "report.json").read_text())["dies"]
    assert [set(die["expected_seconds"]) for die in dies] == [{"optics"}] * len(dies)
    assert all(die["expected_seconds"]["optics"] > 0 for die in dies)
