"""The front of the report, and the table of dies: what they say of made-up photographs."""

from __future__ import annotations

import pytest
from jsonschema import Draft202012Validator
from report.test_report_html import read

from maskfab.camera.scores import MeanDifference
from maskfab.display.drive import BY_AREA
from maskfab.job.process import Process, Roughness
from maskfab.report.documents.report import schema, to_document
from maskfab.report.pages import page as html
from maskfab.report.pages.front import Best, assumed, best, crops, stamps
from maskfab.report.pages.tables import die_table
from maskfab.report.rows.bands import ProcessSpread
from maskfab.report.rows.photographs import Photographs, Restored


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
    assert "95 % interval by Student's t of the paired differences over 3 photographs, at 32 dB" in words
    assert "Every other die is worse" in words
    assert "sensor: full well 15506 electrons" in words
    assert "restorer: Wiener filter" in words


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


def test_displays_that_do_not_fit_are_no_pass(run):
    document = document_of(run, None)
    counts = {
        "dies": 12, "fits": 1, "does_not_fit": 6, "unknown": 5, "verdict": "DOES NOT FIT", "circuits": BY_AREA
    }  # fmt: skip
    display = stamps({**document, "verdicts": {**document["verdicts"], "display": counts}})[2]
    assert (display.mood, display.sign, display.word) == ("bad", "✗", "1 OF 12 FIT")
    assert display.basis == f"6 do not fit, 5 are unknown; {BY_AREA}"
    open_ = {**counts, "does_not_fit": 0, "verdict": "UNKNOWN"}
    assert stamps({**document, "verdicts": {**document["verdicts"], "display": open_}})[2].mood == "open"
    fits = {**counts, "does_not_fit": 0, "unknown": 0, "fits": 12, "verdict": "FITS"}
    display = stamps({**document, "verdicts": {**document["verdicts"], "display": fits}})[2]
    assert (display.mood, display.basis) == ("good", f"on 12 of 12 dies; {BY_AREA}")


def test_the_table_puts_photographs_first_and_marks_the_group_of_the_best(run):
    document = document_of(run, taken(PLAIN=A, TURNED=B))
    table = die_table(document)
    assert [(line.name, line.psnr.text, line.psnr.best) for line in table.lines] == [
        ("TURNED", "30.20", True), ("PLAIN", "25.00", False),
    ]  # fmt: skip
    assert table.lines[0].gain.text.startswith("+5.20 ± ")
    assert table.lines[1].gain.text == "reference"
    page = html.html_page(document, {})
    table_text = page[page.index('<table class="dies">') :]
    assert table_text.index("Restored<br>PSNR") < table_text.index("Open<br>ratio") < table_text.index("AUC<br>")
    assert table_text[: table_text.index("</table>")].count(" best") == 1


def test_reference_and_best_are_shown_with_the_number_of_that_photograph(run):
    document = document_of(run, taken(PLAIN=A, TURNED=B))
    assert list(crops(document, best(document))) == [
        ("PLAIN", "PLAIN (reference): 20.0 dB"), ("TURNED", "TURNED (best): 25.5 dB"),
    ]  # fmt: skip
    assert list(crops(document, "nothing")) == []


def test_a_stated_reference_is_kept_even_if_it_is_refused():
    seen = {"A": Restored(refused="MF134 one line"), "B": Restored((object(),))}
    assert Photographs(None, seen).reference == "B"
    assert Photographs(None, seen, "B").reference == "B"
    assert Photographs(None, seen, "A").reference is None


def test_a_scene_and_its_spectrum_are_assumed(run):
    photographs = {**taken(PLAIN=A, TURNED=B), "scene": {"spectrum": "rgb", "depth": ["1 m", "inf"]}}
    told = assumed({**document_of(run, None), "photographs": photographs})
    assert "spectrum: as [scene] says (rgb)" in told
    assert "[scene]: depth;" in told


def test_the_front_says_what_process_its_bands_are_about(run):
    process = Process(1.0, 0.1, Roughness(0.03, 0.5))
    given = {"photographs": taken(PLAIN=A, TURNED=B), "process": process}
    drawn = to_document(run.report, run.plate, run.camera, photographs=given["photographs"])
    stated = to_document(run.report, run.plate, run.camera, **given)
    spread = to_document(run.report, run.plate, run.camera, **given, spread=ProcessSpread(0.1))
    for document in (drawn, stated, spread):
        Draft202012Validator(schema()).validate(document)
    words = "corners of 1 µm, CD bias 0.1 µm, edges rough by 0.03 µm over 0.5 µm"
    assert "no [process] of the writer" in assumed(drawn)
    assert f"{words}, without a spread" in assumed(stated)
    assert f"95 % of displays about {words}, standard deviations CD bias ± 0.1 µm." in assumed(spread)
