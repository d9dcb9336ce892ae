"""How an opening was designed: foreign text as text, numbers as far as they are numbers, and photographs."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from matplotlib.image import imread
from report.test_report_html import read
from sweeps import examples

from maskfab.camera.scores import Score, Shot
from maskfab.findings.photographs import Restored
from maskfab.mask.job import load_job
from maskfab.report.documents.die import Stated, stated, stated_design
from maskfab.report.documents.report import report_text, schema, to_document
from maskfab.report.figures import scene as design_figures
from maskfab.report.pages import appendix as html

MARKUP = "<script>alert('x')</script>\"&"
FULL = {
    "author": "maskfab",
    "command": "maskfab design layouts/design_bar.toml",
    "version": "0.1.0",
    "seed": 5,
    "shape": "bar 6x17 at (0, 0)",
    "evaluated": 1146,
    **{f"expected_psnr_{level}": 20.5 + level / 10 for level in (24, 32, 40)},
    **{f"head_room_{level}": level / 100 for level in (24, 32, 40)},
    "rules_cost_db": 0.125,
    "price_min_feature_db": 0.05,
    "price_wires_db": 0,
}
CELLS = {"mode": "equal_light", "gain_db_24": 0.25, "gain_db_32": 0.5, "gain_db_40": 1.5, "seed": 5}
LEVELS = (24, 40)
LAYOUTS = Path(__file__).parents[2] / "layouts"


def restored(scene="leaves1"):
    ramp = np.linspace(0, 1, 3 * 8 * 12, dtype=np.float32).reshape(3, 8, 12)
    taken = [
        Shot(Score("TURNED", level, scene, 0.02, level - 4.0, 0.5, level - 3.0, 0.5), ramp**power)
        for level, power in ((24, 2), (40, 3))
    ]
    return Restored(tuple(shot.score for shot in taken), (), None, scene, ramp, tuple(taken))


def page_of(run, said, seen=None):
    document = to_document(run.report, run.plate, run.camera, designs={"TURNED": stated_design(said, LEVELS, seen)})
    Draft202012Validator(schema()).validate(json.loads(report_text(document)))
    pictures = {"TURNED": {} if seen is None else design_figures.photograph_pictures(seen)}
    return html.appendix_page(document, pictures)


def words_of(page):
    return " ".join(" ".join(read(page).text).split())


def test_headroom_above_a_decibel_is_not_told(run):
    far = {**FULL, "head_room_24": 1.25}
    words = words_of(page_of(run, Stated(far, 8.0)))
    assert "Proven headroom of the opening: at most 0.400 dB (frame interior) at 40 dB SNR." in words
    assert "at most 1.25" not in words


def test_everything_that_is_stated_is_told(run):
    words = words_of(page_of(run, Stated(FULL, 8.0, CELLS, "bar_map"), restored()))
    for said in (
        "bar 6x17 at (0, 0) , the best of 1 146 evaluated",
        "maskfab design layouts/design_bar.toml",
        "version 0.1.0 , seed 5",
        "bar_map , equal light , seed 5",
        "Proven headroom of the opening: at most 0.240 dB (frame interior) at 24 dB SNR, 0.400 dB at 40 dB SNR.",
        "All rules together cost 0.125 dB.",
        "Dropping one rule alone gains: min feature 0.0500 dB , wires 0 dB .",
        "Scene leaves1 through this die at 24 dB of light, restored: 20.00 dB, inner frame 21.00 dB",
        "The scene leaves1, which page 1 of the report shows as it is",
    ):
        assert said.replace(" ,", ",").replace(" .", ".") in words.replace(" ,", ",").replace(" .", "."), said


def test_other_dies_and_reports_say_nothing_of_a_design(run):
    document = to_document(run.report, run.plate, run.camera)
    assert all("design" not in die for die in document["dies"])
    assert "<h3>Design</h3>" not in html.appendix_page(document, {})
    assert page_of(run, Stated(FULL, 8.0)).count("<h3>Design</h3>") == 1


def test_markup_in_provenance_stays_text(run):
    facts = dict.fromkeys(FULL, MARKUP) | {f"price_{MARKUP}_db": 0.1}
    page = page_of(run, Stated(facts, 8.0, dict.fromkeys(CELLS, MARKUP), MARKUP), restored(MARKUP))
    assert "<script" not in page
    assert {"script", "iframe"}.isdisjoint(read(page).tags)
    assert MARKUP in words_of(page)


def test_a_design_for_other_dots_is_said_to_be_one(run):
    assert "Designed for" in words_of(page_of(run, Stated(FULL, 4.0)))
    assert "Designed for" not in words_of(page_of(run, Stated(FULL, 8.0)))


def test_numbers_that_are_none_are_missing():
    for bad in (True, "0.3", math.nan, math.inf, None, [1], {"a": 1}):
        facts = dict.fromkeys(FULL, bad) | {"price_x_db": bad}
        document = stated_design(Stated(facts, 8.0, dict.fromkeys(CELLS, bad), "m"), LEVELS)
        assert document["rules_cost"] is None
        assert document["evaluated"] is None
        assert document["prices"] == []
        assert all(row["head_room"] is row["stated_psnr"] is row["map_gain"] is None for row in document["levels"])


def test_long_and_unprintable_text_becomes_one_short_line():
    said = stated_design(
        Stated({"shape": "a\nb\x00c\u202e" + "x" * 10_000, "command": "\n\t", "seed": False}, 8.0), LEVELS
    )
    assert said["shape"].startswith("a b c xxx")
    assert len(said["shape"]) == 300
    assert said["command"] is None
    assert said["seed"] is None


rubbish = st.dictionaries(
    st.sampled_from([*FULL, *CELLS, "price__db", "price_db", "light"]) | st.text(max_size=12),
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=20)
    | st.lists(st.integers(), max_size=2),
)


@examples(60)
@given(rubbish, rubbish)
def test_any_provenance_is_told_as_the_schema_says(opening, cells):
    document = json.loads(json.dumps(stated_design(Stated(opening, 8.0, cells, "m"), LEVELS), allow_nan=False))
    rules = schema()["properties"]["dies"]["items"]["properties"]["design"]
    Draft202012Validator(rules).validate(document)


def test_dies_of_a_job_with_a_designed_opening_or_map_have_one():
    found = stated(load_job(LAYOUTS / "toled_against_ours.toml"))
    assert list(found) == ["OURS"]
    assert found["OURS"].dot_um == 8.0
    assert found["OURS"].cells is not None
    displays = load_job(LAYOUTS / "displays.toml")
    designed = [die.name for die in displays.spec.die if die.opening.startswith("paper")]
    assert 0 < len(designed) < len(displays.spec.die)
    assert list(stated(displays)) == designed


def test_photographs_are_png_of_the_codes_themselves():
    drawn = design_figures.photograph_pictures(restored())
    assert list(drawn) == ["design_24", "design_40"]
    assert drawn == design_figures.photograph_pictures(restored())
    assert list(design_figures.truth(restored())) == ["front_truth"]
    assert design_figures.front(restored(), 40) == {"front": drawn["design_40"]}
    assert design_figures.photograph_pictures(Restored(())) == {}


def test_the_sheet_is_one_png_with_equal_bytes_and_a_column_for_each_die():
    seen = restored()
    one = design_figures.sheet(seen.truth, "leaves1", {"A": seen.shots}, "protocol f1")
    two = design_figures.sheet(seen.truth, "leaves1", {"A": seen.shots, "$B": seen.shots}, "protocol f1")
    assert two == design_figures.sheet(seen.truth, "leaves1", {"A": seen.shots, "$B": seen.shots}, "protocol f1")
    widths = [imread(io.BytesIO(picture), format="png").shape[1] for picture in (one, two)]
    assert widths[1] - widths[0] == pytest.approx(415, abs=2)
