from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from jsonschema import Draft202012Validator, ValidationError

from maskfab.base import __version__
from maskfab.base.errors import InternalError
from maskfab.base.model import Quantity
from maskfab.job.camera import Stop
from maskfab.report.documents.report import report_text, schema, to_document

QUANTITY_KEYS = ["name", "symbol", "value", "unit", "uncertainty", "method", "limit", "passed"]


@pytest.fixture(scope="module")
def document(run):
    return to_document(run.report, run.plate, run.camera)


def test_document_has_the_keys_of_the_contract_in_their_order(document):
    assert list(document) == [
        "schema_version",
        "maskfab_version",
        "title",
        "job_hash",
        "provenance",
        "verdict",
        "verdicts",
        "seeds",
        "camera",
        "dies",
        "plate",
        "checks",
        "files",
    ]
    assert document["maskfab_version"] == __version__
    assert document["verdict"] == "fail"
    assert document["seeds"] == {"TURNED": 7}
    assert document["files"][0] == {"path": "P.gds", "format": "GDSII", "bytes": 1234, "sha256": "c" * 64}


def test_die_states_how_it_was_laid_out(document):
    plain, turned = document["dies"]
    assert (plain["name"], plain["dot_um"], plain["pitch_um"], plain["gutter_um"]) == ("PLAIN", 8.0, 42.0, 2.0)
    assert plain["dpi"] == 25400 / 42
    assert plain["cells"] == [8, 8]
    assert plain["centre_um"] == [-10_000.0, 0.0]
    assert (plain["tiling"], plain["seed"]) == ("periodic", None)
    assert (turned["tiling"], turned["seed"]) == ("random", 7)


def test_quantity_names_wavelength_and_die_only_where_they_apply(document):
    by_name = {row["name"]: row for row in document["dies"][0]["quantities"]}
    assert list(by_name["open_ratio"]) == [*QUANTITY_KEYS, "die"]
    assert list(by_name["auc_radial_min"]) == [*QUANTITY_KEYS, "wavelength_nm", "die"]
    assert list(document["plate"][0]) == QUANTITY_KEYS


def test_document_is_what_its_schema_says(document):
    rules = schema()
    Draft202012Validator(rules).validate(document)
    Draft202012Validator(rules).validate(json.loads(report_text(document)))


@pytest.mark.parametrize(
    ("stop", "facts"),
    [
        (Stop("circle", 400.0), {}),
        (Stop.ellipse(400.0, 300.0), {"stop_width_um": 400.0, "stop_height_um": 300.0}),
        (Stop.annulus(400.0, 100.0), {"stop_inner_um": 100.0}),
        (Stop.polygon([(1, 0), (0, 1), (-1, -1.5)]), {"stop_corners_um": "1 0; 0 1; -1 -1.5"}),
    ],
    ids=lambda each: getattr(each, "shape", ""),
)
def test_a_stop_of_any_shape_is_told_whole(run, stop, facts):
    document = json.loads(report_text(to_document(run.report, run.plate, replace(run.camera, stop=stop))))
    Draft202012Validator(schema()).validate(document)
    assert document["camera"]["stop"] == {"shape": stop.shape, "diameter_um": stop.diameter_um, **facts}


def test_a_scene_is_what_the_schema_says(run, seen):
    document = json.loads(report_text(to_document(run.report, run.plate, run.camera, seen)))
    rules = schema()
    Draft202012Validator(rules).validate(document)
    plain, turned = document["dies"]
    assert "scene" not in plain
    scene, (optics,) = turned["scene"], seen
    assert scene["asked"]["gap_um"] == 30.0
    assert scene["asked"]["farthest_um"] is None
    assert [band["name"] for band in scene["asked"]["bands"]] == ["blue", "<red>"]
    assert scene["field"][0][0]["residual"] == optics.field[0][0].residual
    assert len(scene["plan"]["ingredients"]) == len(optics.plan.ingredients)


def test_schema_refuses_what_the_contract_does_not_know(document):
    rules = schema()
    with pytest.raises(ValidationError, match="surplus"):
        Draft202012Validator(rules).validate({**document, "surplus": 1})


def test_equal_documents_give_equal_text_that_reads_back_exactly(run, document):
    again = to_document(run.report, run.plate, run.camera)
    assert report_text(again) == report_text(document)
    assert json.loads(report_text(document)) == document


def test_texts_of_the_title_are_told(run):
    plate = replace(run.plate, texts={"serial": "A-017"})
    told = to_document(run.report, plate, run.camera)
    assert told["texts"] == {"serial": "A-017"}
    Draft202012Validator(schema()).validate(told)


def test_runs_that_took_different_times_have_equal_reports(run, document):
    assert to_document(replace(run.report, seconds={"export": 99.0}), run.plate, run.camera) == document


def test_numpy_scalars_become_plain_numbers(run):
    odd = Quantity("polygons", np.int64(3), "count", np.float32(0.5), 4, np.bool_(True))
    row = to_document(replace(run.report, plate=(odd,)), run.plate, run.camera)["plate"][0]
    assert (row["value"], row["uncertainty"], row["passed"]) == (3, 0.5, True)
    assert [type(row[key]) for key in ("value", "uncertainty", "passed")] == [int, float, bool]


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), np.float64("-inf")])
def test_numbers_that_json_cannot_say_are_refused_with_their_place(run, bad):
    broken = replace(run.report, plate=(Quantity("polygons", bad, "none"),))
    with pytest.raises(InternalError, match=r"report\.plate\[0\]\.value") as caught:
        to_document(broken, run.plate, run.camera)
    assert caught.value.code == "MF901"
    with pytest.raises(InternalError, match="MF901"):
        report_text({"value": bad})


def test_report_and_plate_must_have_the_same_dies(run):
    with pytest.raises(InternalError, match="PLAIN"):
        to_document(replace(run.report, dies={}), run.plate, run.camera)
