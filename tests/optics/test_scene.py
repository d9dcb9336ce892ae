"""The scene of a job: what its section becomes, and the bands of its camera under its light."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import examples

from maskfab.base.errors import JobError, MaskfabError
from maskfab.job.camera import Camera, Stop
from maskfab.job.faults import parse_section
from maskfab.job.sections import SceneSection
from maskfab.job.values import COLDEST_K, HOTTEST_K
from maskfab.optics.response import black_body, generic_rgb
from maskfab.optics.scene.omissions import wavelength_range_nm
from maskfab.optics.scene.scene import Distortion, Scene

CAMERA = "wavelength_nm,left,right\n400,0,0\n500,1,0\n600,0,1\n700,0,0\n"
LAMP = "wavelength_nm,lamp\n380,1\n780,3\n"
CURVES = {"camera.csv": CAMERA, "lamp.csv": LAMP}
PLACES = np.linspace(395.0, 705.0, 311)


def section(**keys: object) -> SceneSection:
    return parse_section(SceneSection, keys, where="here")


def scene(curves: dict[str, str] | None = None, **keys: object) -> Scene:
    return Scene.of(section(**keys), CURVES if curves is None else curves, where="job.toml")


def test_the_default_scene_asks_for_nothing() -> None:
    assert Scene.of(None) == Scene.of(SceneSection()) == Scene()
    assert Scene().bands == ()


def test_a_scene_spans_its_bands_and_without_any_the_lines_of_its_camera() -> None:
    camera = Camera(10_000.0, Stop("circle", 400.0), (610.0, 470.0, 530.0), 2.0, 64.0)
    assert wavelength_range_nm(camera, Scene()) == (470.0, 610.0)
    shortest, longest = wavelength_range_nm(camera, scene(spectrum="camera.csv"))
    assert 400 <= shortest < 450
    assert 650 < longest <= 700


def test_lengths_and_flags_are_passed_on() -> None:
    found = scene(
        depth=["1 m", "3 m"],
        focus="2 m",
        field="1 mm",
        gap="0.2 mm",
        aberrations=[[11, 0.1]],
        saturation=True,
        distortion={"ratio": -0.02, "height": "2 mm"},
    )
    lens = Distortion(-0.02, 2e3)
    assert found == Scene(1e6, 3e6, 2e6, 1e3, 200.0, ((11, 0.1),), True, distortion=lens)
    camera = Camera(5e3, Stop("circle", 400.0), (530.0, 470.0), 2.0, 64.0)
    assert (found.wavefront(camera).terms, found.wavefront(camera).reference_nm) == (((11, 0.1),), 530.0)


def test_the_bundled_camera() -> None:
    bands = scene(spectrum="rgb").bands
    assert [band.name for band in bands] == ["red", "green", "blue"]
    for band, curve in zip(bands, generic_rgb().values(), strict=True):
        inside = PLACES[(band.range_nm[0] <= PLACES) & (band.range_nm[1] >= PLACES)]
        assert np.array_equal(band.density(inside), curve.at(inside))


def test_a_camera_of_ones_own() -> None:
    bands = scene(spectrum="camera.csv").bands
    assert [(band.name, band.range_nm) for band in bands] == [("left", (400, 600)), ("right", (500, 700))]
    assert bands[0].density(np.array([450.0, 500.0, 575.0])) == pytest.approx([0.5, 1.0, 0.25])


def test_light_of_ones_own_is_a_factor() -> None:
    plain, lit = scene(spectrum="camera.csv").bands, scene(spectrum="camera.csv", illuminant="lamp.csv").bands
    for one, other in zip(plain, lit, strict=True):
        assert other.range_nm == one.range_nm
        assert other.density(PLACES) == pytest.approx(one.density(PLACES) * (1 + (PLACES - 380) / 200))
    # A ramp over a flat response has its mean at two thirds.
    flat = "wavelength_nm,flat\n400,1\n600,1\n"
    ramp = "wavelength_nm,ramp\n400,0\n600,1\n"
    (band,) = scene({"flat.csv": flat, "ramp.csv": ramp}, spectrum="flat.csv", illuminant="ramp.csv").bands
    assert band.quadrature(1).centroid_nm == pytest.approx(400 + 200 * 2 / 3, abs=1e-9)


@given(st.floats(COLDEST_K, HOTTEST_K))
@examples(40)
def test_a_black_body_lights_the_whole_response_and_moves_its_mean(temperature_k: float) -> None:
    plain = scene(spectrum="camera.csv").bands
    lit = scene(spectrum="camera.csv", illuminant=f"{temperature_k:.15g} K").bands
    body = black_body(temperature_k, 400.0, 700.0)
    for one, other in zip(plain, lit, strict=True):
        assert other.range_nm == one.range_nm
        assert other.density(PLACES) == pytest.approx(one.density(PLACES) * body.at(PLACES), rel=1e-12)


@given(st.floats(COLDEST_K, HOTTEST_K), st.floats(COLDEST_K, HOTTEST_K))
@settings(max_examples=25, deadline=None)
def test_the_hotter_the_light_the_shorter_the_mean_wavelength(one: float, other: float) -> None:
    cold, hot = (scene(spectrum="rgb", illuminant=f"{kelvins:.15g} K").bands for kelvins in sorted((one, other)))
    for redder, bluer in zip(cold, hot, strict=True):
        assert bluer.quadrature(16).centroid_nm <= redder.quadrature(16).centroid_nm + 1e-9


def test_a_black_body_reaches_as_far_as_an_infrared_camera_sees() -> None:
    infrared = "wavelength_nm,near\n1200,1\n1500,1\n"
    (band,) = scene({"ir.csv": infrared}, spectrum="ir.csv", illuminant="2856 K").bands
    assert band.range_nm == (1200, 1500)
    assert (band.density(np.linspace(1200, 1500, 31)) > 0.5).all()


@pytest.mark.parametrize(
    ("curves", "keys", "code", "key"),
    [
        ({}, {"spectrum": "camera.csv"}, "MF105", "scene.spectrum"),
        (CURVES, {"spectrum": "camera.csv", "illuminant": "other.csv"}, "MF105", "scene.illuminant"),
        (CURVES, {"spectrum": "rgb", "illuminant": "camera.csv"}, "MF105", "scene.illuminant"),
        ({"c.csv": "nm,a\n1,1\n2,1\n"}, {"spectrum": "c.csv"}, "MF303", "scene.spectrum: c.csv: line 1"),
        ({"c.csv": ""}, {"spectrum": "c.csv"}, "MF302", "scene.spectrum: c.csv"),
        ({"c.csv": "wavelength_nm,a\n100,1\n500,1\n"}, {"spectrum": "c.csv"}, "MF112", "scene.spectrum: c.csv"),
        (
            {"l.csv": "wavelength_nm,a\n800,1\n900,1\n"},
            {"spectrum": "rgb", "illuminant": "l.csv"},
            "MF104",
            "scene.illuminant",
        ),
    ],
)
def test_wrong_tables_name_their_key(curves: dict[str, str], keys: dict[str, object], code: str, key: str) -> None:
    with pytest.raises(MaskfabError) as caught:
        scene(curves, **keys)
    assert (caught.value.code, caught.value.where) == (code, f"job.toml: {key}")
    assert caught.value.cure


def test_without_a_file_an_error_names_the_key_alone() -> None:
    with pytest.raises(JobError) as caught:
        Scene.of(section(spectrum="camera.csv"))
    assert caught.value.where == "scene.spectrum"


LENS = Camera(5e3, Stop("circle", 400.0), (530.0,), 2.0, 64.0)
FISHEYE = "angle_deg,height_um\n0,0\n10,871.56\n20,1736.5\n30,2588.2\n40,3420.2\n50,4226.2\n60,5000\n70,5735.8\n"


def off_axis(**keys: object) -> Scene:
    return Scene.of(section(**keys), {"lens.csv": FISHEYE}, camera=LENS, where="job.toml")


def test_an_angle_is_an_image_height_by_the_lens_and_its_focus() -> None:
    assert off_axis(field="40 deg").field_um == pytest.approx(5e3 * np.tan(np.radians(40)))
    assert off_axis(field="40 deg", projection="f theta").field_um == pytest.approx(5e3 * np.radians(40))
    assert off_axis(field="40 deg", projection="lens.csv").field_um == pytest.approx(3420.2, abs=1e-9)
    bent = off_axis(field="20°", distortion={"ratio": -0.1, "height": "2 mm"})
    plain = 5e3 * np.tan(np.radians(20))
    assert bent.field_um == pytest.approx(plain * (1 - 0.1 * (plain / 2e3) ** 2))
    assert bent.steepest_um == pytest.approx(plain)
    assert off_axis(field="40 deg", focus="105 mm").field_um == pytest.approx(1.05 * 5e3 * np.tan(np.radians(40)))
    for near in (
        off_axis(field="40 deg", focus="105 mm", projection=kind) for kind in ("f tan", "f theta", "lens.csv")
    ):
        assert near.slope(LENS) == pytest.approx(np.tan(np.radians(40)))
    assert off_axis(tilt="-3 deg").tilt_rad == pytest.approx(-np.radians(3))


def test_a_field_is_written_as_it_was_stated() -> None:
    for stated in ("20 deg", "1500 um"):
        assert section(field=stated).model_dump()["field"] == stated
    assert section(tilt="2.5 deg").model_dump()["tilt"] == "2.5 deg"


@pytest.mark.parametrize(
    ("keys", "code", "words"),
    [
        ({"field": "76 deg"}, "MF104", "outside 0 to 75 degrees"),
        ({"field": "-1 deg"}, "MF104", "outside 0 to 75 degrees"),
        ({"field": "3 kg"}, "MF103", "field"),
        ({"tilt": "3"}, "MF103", "tilt"),
        ({"tilt": "11 deg"}, "MF104", "outside -10 to 10 degrees"),
        ({"projection": "fisheye"}, "MF105", "projection"),
        ({"projection": "f theta", "distortion": {"ratio": 0.1, "height": "2 mm"}}, "MF105", "follows f tan"),
        ({"projection": "other.csv"}, "MF105", "not part of the job"),
        ({"field": "75 deg", "projection": "lens.csv"}, "MF104", "70 degrees"),
    ],
)
def test_a_field_or_a_lens_that_means_nothing_is_refused(keys: dict[str, object], code: str, words: str) -> None:
    with pytest.raises(MaskfabError, match=f"{code} .*{words}"):
        off_axis(**keys)


def test_a_table_of_another_lens_or_other_columns_is_refused() -> None:
    for text, code in ((FISHEYE.replace("height_um", "height_mm"), "MF303"), (FISHEYE.replace(",8", ",7"), "MF104")):
        with pytest.raises(MaskfabError, match=f"{code} .*scene.projection"):
            Scene.of(section(projection="lens.csv"), {"lens.csv": text}, camera=LENS, where="job.toml")


def test_an_angle_needs_a_lens() -> None:
    for keys in ({"field": "10 deg"}, {"projection": "f theta"}):
        with pytest.raises(JobError, match=r"MF105 .*of which nothing is known"):
            scene(**keys)
