"""``maskfab edge`` and ``--mtf``: what they answer, write and refuse."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile
from browser import faults
from slanted_edges import blurred_edge, gaussian, noisy, rendered, true_mtf
from small_job import command, write_job

import maskfab
from maskfab.camera.inspection.edge_mtf import designed_mtf
from maskfab.mask.job import load_job

BLURS = {"R": 1.0, "G": 0.6, "B": 0.4}
BLACK, WHITE = 500.0, 60000.0


@pytest.fixture(scope="module")
def mosaic(tmp_path_factory):
    """A picture whose every colour has a blur of its own; what one pixel says of another colour would be wrong."""
    colours = {
        colour: noisy(rendered(260, 120, 5.0, blurred_edge(sigma)), seed)
        for seed, (colour, sigma) in enumerate(BLURS.items())
    }
    light = np.empty((260, 120))
    for (row, column), colour in {(0, 0): "R", (0, 1): "G", (1, 0): "G", (1, 1): "B"}.items():
        light[row::2, column::2] = colours[colour][row::2, column::2]
    path = tmp_path_factory.mktemp("edge") / "edge.tif"
    counts = np.rint(BLACK + 40000 * light).astype(np.uint16)
    tifffile.imwrite(path, counts, photometric="minisblack", metadata=None)
    return path


LEVELS = ("--black", BLACK, "--white", WHITE, "--mosaic", "rggb")


def test_each_colour_of_a_mosaic_is_measured_by_its_own_pixels(capsys, chromium, firefox, mosaic, tmp_path):
    out = tmp_path / "out"
    answer = command(capsys, "edge", mosaic, *LEVELS, "--pixel", "2 um", "-o", out, "--json")
    assert answer.code == 0, answer
    edges = answer.document["edges"]
    assert [each["colour"] for each in edges] == ["R", "G", "B"]
    for each in edges:
        truth = true_mtf(np.array([0.1, 0.25, 0.5]), 5.0, gaussian(BLURS[each["colour"]]))
        told = [row for row in each["quantities"] if row["name"] == "edge_mtf"]
        assert [row["value"] for row in told] == pytest.approx(truth, abs=0.03)
        assert all(0 < row["uncertainty"] < 0.05 for row in told)
        per_mm, per_pixel = (row for row in each["quantities"] if row["name"].startswith("edge_mtf50"))
        assert per_mm["value"] == pytest.approx(500 * per_pixel["value"])
    page = (out / "measure.html").read_text()
    assert "Green pixels, horizontal, edge −5.0" in page
    assert [fault for browser in (chromium, firefox) for fault in faults(browser, out / "measure.html")] == []
    assert json.loads((out / "measure.json").read_text())["edges"] == edges
    assert {each.name for each in out.iterdir()} == {"measure.html", "measure.json", "manifest.json"}
    again = command(capsys, "edge", mosaic, *LEVELS, "-o", out, "--force")
    assert again.code == 0, again
    assert "cy/pixel." in again.stdout
    assert "cy/mm" not in again.stdout
    assert "The pixel is not known" in again.stdout


def test_a_picture_is_held_against_the_die_that_is_named(mosaic, tmp_path):
    job = write_job(tmp_path)
    levels = {"black": BLACK, "white": WHITE, "mosaic": "rggb"}
    found = maskfab.edge(mosaic, job, die="PLAIN", line="530 nm", region=(20, 0, 240, 120), **levels)
    edge = found.found.edges[1]
    known = load_job(job)
    own = designed_mtf(
        known.panels()["PLAIN"], known.camera, 530.0, edge.edge.frequency_cy_per_px, edge.edge.normal_deg
    )
    np.testing.assert_allclose(edge.designed[0].mtf, own.mtf)
    # The picture was blurred by a Gaussian, and not by a die of small openings.
    assert found.edges[1]["edge_mtf_parting"].value > 0
    assert "It parts from the design of PLAIN in 530 nm at" in found.verdict[3]
    region = edge.edge.region
    assert 20 <= region.top < region.bottom <= 240
    assert found.plot().svg().count("designed, 530 nm") == 1


def test_a_curve_from_elsewhere_is_that_of_its_die_along_its_own_direction(capsys, tmp_path):
    job = write_job(tmp_path)
    known = load_job(job)
    frequency = np.linspace(0, 0.5, 26)
    true = designed_mtf(known.panels()["TURNED"], known.camera, 530.0, frequency, 90.0).mtf
    curve = tmp_path / "curve.csv"
    rows = [
        f"{each:.4f},{value:.6f},{max(value - 0.005, 0):.6f},{value + 0.005:.6f}"
        for each, value in zip(frequency, true, strict=True)
    ]
    curve.write_text("\n".join(["cycles/pixel,mtf,low,high", *rows]), encoding="utf-8")

    def compared(*stated):
        answer = command(capsys, "edge", curve, "--job", job, *stated, "--json")
        assert answer.code == 0, answer
        (edge,) = answer.document["edges"]
        return {row["name"]: row["value"] for row in edge["quantities"]}

    right = compared("--die", "TURNED", "--angle", 90)
    assert right["edge_mtf_difference"] < 1e-5
    assert right["edge_mtf_parting"] is None
    # A die that stands turned shows at 0 degrees what it shows at 90 as drawn; mirrored left to right, nothing changes
    # along its axes.
    assert compared("--die", "TURNED", "--stands", "turned")["edge_mtf_difference"] < 1e-5
    assert compared("--die", "TURNED", "--angle", 90, "--stands", "mirrored")["edge_mtf_difference"] < 1e-5
    for wrong in (("--die", "TURNED"), ("--die", "PLAIN", "--angle", 90)):
        assert compared(*wrong)["edge_mtf_parting"] > 0
    answer = command(capsys, "edge", curve, "--job", job, "--die", "TURNED", "--angle", 90, "-o", tmp_path / "o")
    assert "It agrees with the design of TURNED in 530 nm up to half a cycle per pixel" in answer.stdout
    assert "Waves at 90° of curve.csv" in (tmp_path / "o" / "measure.html").read_text()


REFUSED = {
    "nothing": (("edge",), "MF105", "PICTURE"),
    "no captures": (("measure",), "MF105", "FILE"),
    "point light without a job": (("measure", "a.tif"), "MF105", "--job"),
    "pair beside an edge": (("edge", "b.tif", "--pair", "a.tif"), "MF105", "--pair"),
    "gain beside a curve": (("edge", "c.csv", "--gain", "1"), "MF105", "--gain"),
    "region beside captures": (("measure", "a.tif", "--region", "0,0,9,9"), "MF105", "--region"),
    "mosaic beside a curve": (("edge", "c.csv", "--mosaic", "rggb"), "MF105", "mosaic goes with a picture of edges"),
    "angle beside an edge": (("edge", "b.tif", "--angle", "0"), "MF105", "angle goes with a table (.csv) of an MTF"),
    "die without a job": (("edge", "b.tif", "--die", "PLAIN"), "MF105", "--die"),
    "line without a job": (("edge", "b.tif", "--line", "530 nm"), "MF105", "--line"),
    "line without a die": (("edge", "b.tif", "--job", "{job}", "--line", "530 nm"), "MF105", "--line"),
    "stand without a die": (("edge", "b.tif", "--job", "{job}", "--stands", "mirrored"), "MF105", "--stands"),
    "no such stand": (
        ("edge", "b.tif", "--job", "{job}", "--die", "PLAIN", "--stands", "up"),
        "MF105",
        "'up' is no stand",
    ),
    "pixel beside a job": (("edge", "b.tif", "--job", "{job}", "--pixel", "2 um"), "MF105", "--pixel"),
    "two dies": (("edge", "b.tif", "--job", "{job}", "--die", "PLAIN", "--die", "TURNED"), "MF105", "2 dies"),
    "no such die": (("edge", "b.tif", "--job", "{job}", "--die", "OTHER"), "MF105", "'OTHER'"),
    "curve without a job": (("edge", "c.csv"), "MF105", "job is missing"),
    "curve without a die": (("edge", "c.csv", "--job", "{job}"), "MF105", "die is missing"),
    "three numbers": (("edge", "b.tif", "--region", "1,2,3"), "MF105", "--region"),
    "words": (("edge", "b.tif", "--region", "a,b,c,d"), "MF105", "--region"),
    "no pixels": (("edge", "b.tif", "--region", "9,0,9,5"), "MF104", "--region"),
    "narrow": (("edge", "b.tif", "--window", "5"), "MF104", "--window"),
    "no unit": (("edge", "b.tif", "--pixel", "2"), "MF103", "--pixel"),
    "steep": (("edge", "c.csv", "--job", "{job}", "--die", "PLAIN", "--angle", "nan"), "MF104", "--angle"),
    "no file": (("edge", "b.tif"), "MF301", "b.tif"),
    "no curve": (("edge", "c.csv", "--job", "{job}", "--die", "PLAIN"), "MF301", "c.csv"),
}


@pytest.mark.parametrize(("stated", "code", "said"), REFUSED.values(), ids=REFUSED)
def test_bad_input_is_refused_by_its_option(capsys, tmp_path, stated, code, said):
    job = write_job(tmp_path)
    out = tmp_path / "out"
    answer = command(capsys, *(each.format(job=job) for each in stated), "-o", out, "--json")
    assert answer.code == 2, answer
    error = answer.document["error"]
    assert error["code"] == code, error
    assert said in " ".join(map(str, error.values())), error
    assert error["cure"]
    assert not out.exists()


def test_pictures_without_an_edge_or_beyond_white_or_of_other_colours_are_refused(capsys, mosaic, tmp_path):
    job = write_job(tmp_path)
    for stated, code in (
        ((*LEVELS, "--region", "0,0,40,40"), "MF340"),
        (("--black", BLACK, "--white", 30000, "--mosaic", "rggb"), "MF343"),
        ((*LEVELS, "--region", "9000,0,9100,90"), "MF342"),
        ((*LEVELS, "--job", job, "--die", "PLAIN"), "MF105"),
    ):
        answer = command(capsys, "edge", mosaic, *stated, "--json")
        assert answer.code == 2
        assert answer.document["error"]["code"] == code, answer.document
