"""The front of the report, and the table of dies: what they say of made-up photographs."""

from __future__ import annotations

import pytest
from jsonschema import Draft202012Validator
from report.test_report_html import read

from maskfab.camera.scores import MeanDifference
from maskfab.findings.bands import ProcessSpread
from maskfab.findings.photographs import Photographs, Restored
from maskfab.job.process import Process, Roughness
from maskfab.report.documents.report import schema, to_document
from maskfab.report.pages import page as html
from maskfab.report.pages.appendix import appendix_page
from maskfab.report.pages.front import Best, assumptions, best, crops
from maskfab.report.pages.tables import die_table


def taken(*, reference: str | None = "PLAIN", stated: str | None = None, refused: str = "", **psnr) -> dict:
    """As report.json tells of photographs, at one level of light; a die without numbers was ``refused``."""
    scenes = [f"s{k}" for k in range(max(map(len, psnr.values())))]
    return {
        "protocol": "camera", "camera": "focal 10000 um", "light": "32 dB", "brackets": [], "linear": True,
        "sensor": {"full_well": 15506.0, "read_noise": 4.87, "bits": None, "black_level": 0, "mosaic": "none"},
        "levels_db": [24, 32, 40], "scene": {}, "unused": [], "told": ["sensor: full well 15506 electrons"],
        "reference": reference, "reference_stated": stated, "scenes": scenes,
        "dies": [
            {
                "name": name, "refused": None if values else refused, "left_out": [],
                "levels": [
                    {"level_db": level, "epsilon": 0.1, "psnr": list(values), "psnr_inner": list(values)}
                    for level in ((24, 32, 40) if values else ())
                ],
            }
            for name, values in psnr.items()
        ],
    }  # fmt: skip


def document_of(run, photographs):
    document = to_document(run.report, run.plate, run.camera, photographs=photographs)
    Draft202012Validator(schema()).validate(document)
    return document


def front_of(document) -> str:
    page = html.html_page(document, {})
    return " ".join(" ".join(read(page[: page.index("</header>")] + "</header></body></html>").text).split())


A, B = (20.0, 25.0, 30.0), (25.5, 29.8, 35.3)


def test_the_front_names_the_best_die_its_gain_and_how_sure_it_is(run):
    document = document_of(run, taken(PLAIN=A, TURNED=B))
    found = best(document)
    assert isinstance(found, Best)
    expected = MeanDifference.of([one - two for one, two in zip(B, A, strict=True)])
    assert (found.name, found.gain, found.ties) == ("TURNED", expected, ())
    words = front_of(document)
    assert f"+5.2 ± {expected.half_width:.1f} dB restored PSNR over PLAIN, the first die of the job" in words
    assert "95 % interval by Student's t of the paired differences over 3 scenes (s0, s1, s2), at 32 dB" in words
    assert "Every other die is worse" in words
    told = dict(assumptions(document))
    assert told["Sensor"] == "full well 15506 electrons"
    assert told["Photographs"] == "drawn scenes s0, s1, s2, restored by a Wiener filter"


def test_dies_that_cannot_be_told_apart_are_tied(run):
    document = document_of(run, taken(PLAIN=A, TURNED=(20.5, 24.8, 30.3)))
    words = front_of(document)
    assert "Tied with it: PLAIN. It may be as good, for the 95 % interval of the paired difference includes 0." in words
    assert "a tie, for the interval holds 0" in words
    assert not any(line.psnr.best for line in die_table(document).lines)


def test_one_photograph_gives_no_interval(run):
    words = front_of(document_of(run, taken(PLAIN=A[:1], TURNED=B[:1])))
    assert "+5.5 dB restored PSNR" in words
    assert "one photograph, which gives no interval" in words


def test_a_reference_that_the_job_names_is_said_to_be_its_own(run):
    words = front_of(document_of(run, taken(PLAIN=A, TURNED=B, stated="PLAIN")))
    assert "over PLAIN, the job's reference" in words
    assert "To compare with another die" not in words


@pytest.mark.parametrize(
    ("photographs", "told"),
    [
        (None, "No photographs: the plate has no die"),
        (taken(PLAIN=(), TURNED=(), reference=None, refused="MF134 one line"), "No photographs: one line. "),
        (taken(PLAIN=A, TURNED=(), refused="MF114 too small"), "No gain, for no other die was photographed: add a die"),
        (taken(PLAIN=B, TURNED=A), "It is the reference itself"),
        (
            taken(PLAIN=(), TURNED=B, reference=None, stated="PLAIN", refused="MF114 too small"),
            "No gain: the reference PLAIN was not photographed. too small. ",
        ),
    ],
    ids=["no photographs", "all refused", "one die", "the reference is best", "the reference is refused"],
)
def test_what_is_missing_is_said_with_what_to_add(run, photographs, told):
    assert told in front_of(document_of(run, photographs))


def test_the_table_puts_photographs_first_and_marks_the_group_of_the_best(run):
    document = document_of(run, taken(PLAIN=A, TURNED=B))
    table = die_table(document)
    assert [(line.name, line.psnr.text, line.psnr.best) for line in table.lines] == [
        ("TURNED", "30.20", True), ("PLAIN", "25.00", False),
    ]  # fmt: skip
    assert table.lines[0].gain.text.startswith("+5.2 ± ")
    assert table.lines[1].gain.text == "reference"
    for page in (html.html_page(document, {}), appendix_page(document, {})):
        text = page[page.index('<table class="dies">') :]
        assert text.index("Restored<br>PSNR") < text.index("Open ratio<br>in the stop")
        assert text[: text.index("</table>")].count(' best"') == 1


def test_reference_and_best_are_shown_with_the_number_of_that_photograph(run):
    document = document_of(run, taken(PLAIN=A, TURNED=B))
    assert list(crops(document, best(document))) == [
        ("PLAIN", "PLAIN (reference), scene s0 alone: 20.0 dB"), ("TURNED", "TURNED (best), scene s0 alone: 25.5 dB"),
    ]  # fmt: skip
    assert list(crops(document, "nothing")) == []


def test_a_stated_reference_is_kept_even_if_it_is_refused():
    seen = {"A": Restored(refused="MF134 one line"), "B": Restored((object(),))}
    assert Photographs(None, seen).reference == "B"
    assert Photographs(None, seen, "B").reference == "B"
    assert Photographs(None, seen, "A").reference is None


def test_a_scene_and_its_spectrum_are_assumed(run):
    photographs = {**taken(PLAIN=A, TURNED=B), "scene": {"spectrum": "rgb", "depth": ["1 m", "inf"]}}
    told = dict(assumptions({**document_of(run, None), "photographs": photographs}))
    assert (told["Spectrum"], told["Scene"]) == ("as [scene] says (rgb)", "[scene]: depth")


def test_the_front_says_what_process_its_bands_are_about(run):
    process = Process(1.0, 0.1, Roughness(0.03, 0.5))
    given = {"photographs": taken(PLAIN=A, TURNED=B), "process": process}
    drawn = to_document(run.report, run.plate, run.camera, photographs=given["photographs"])
    stated = to_document(run.report, run.plate, run.camera, **given)
    spread = to_document(run.report, run.plate, run.camera, **given, spread=ProcessSpread(0.1))
    for document in (drawn, stated, spread):
        Draft202012Validator(schema()).validate(document)
    words = "corners of 1 µm, CD bias 0.1 µm, edges rough by 0.03 µm over 0.5 µm"
    said = [dict(assumptions(document))["Dies"] for document in (drawn, stated, spread)]
    assert "no [process] of the writer" in said[0]
    assert f"{words}, without a spread" in said[1]
    assert f"95 % of displays about {words}, standard deviations CD bias ± 0.1 µm" in said[2]
