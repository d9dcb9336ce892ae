"""A scene's views and numbers: what asking for nothing gives, what similarity forces, and what is refused."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from klayout import db
from small_job import MASK

from maskfab.base.errors import JobError
from maskfab.base.model import Die, Opening, Panel, Plate, Tiling
from maskfab.findings.optics import reach_box, read_openings
from maskfab.findings.scene import SceneOptics, distance, measure_scene, peak_bytes, scene_plan, scene_reach_um
from maskfab.job.camera import Camera, Stop
from maskfab.mask.layout import clear_shapes, plate_layout
from maskfab.optics.metrics import relative_difference
from maskfab.optics.pupil import panel_aperture
from maskfab.optics.response import camera_bands, generic_rgb
from maskfab.optics.scene.point_images import spectrum_psf
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import Band, Curve

CAMERA = Camera(5000.0, Stop("circle", 400.0), (610.0, 530.0, 470.0), 2.0, 64.0)
RANDOM = np.random.default_rng(5).integers(0, 8, (12, 12)).astype(np.int8)


def die(mask: np.ndarray = MASK, turns: np.ndarray = RANDOM, centre_nm: tuple[int, int] = (300_000, -7)) -> Die:
    panel = Panel(Opening("ring", mask, 8000), 8000, 0, turns, Tiling.RANDOM, 5)
    return Die("D", "d", panel, centre_nm, 700_000)


def measured(
    scene: Scene, accuracy: float, subject: Die | None = None, camera: Camera = CAMERA, *, oblique: bool = True
) -> SceneOptics:
    subject = subject or die()
    plan = scene_plan(subject, camera, scene, accuracy, "job.toml")
    if not oblique:
        plan = replace(plan, choice=replace(plan.choice, oblique=False))
    return measure_scene(subject, camera, scene, panel_aperture(subject.panel), plan)


def told(found: SceneOptics) -> dict[str, float]:
    return {quantity.name: quantity.value for quantity in found.quantities}


def test_a_scene_that_asks_for_nothing_changes_nothing():
    found = measured(Scene(), 1e-6)
    assert (found.field, found.depth, found.colours) == ((), (), ())
    numbers = told(found)
    assert numbers["scene_psf_change"] <= numbers["plan_error"]
    assert numbers["plan_error_measured"] <= numbers["plan_error"] <= 1e-6
    assert set(numbers) == {"scene_psf_change", "plan_error", "plan_error_measured", "nearest_object"}


def test_what_few_lines_of_a_band_leave_out_is_measured():
    """At one line a plan of a band may be off by nothing, where its colour is off by much."""
    scene = Scene(bands=(Band((Curve(np.array([430.0, 480.0, 640.0]), np.array([0.2, 1.0, 0.5]), "drawn"),), "drawn"),))
    found = measured(scene, 2e-2)
    told_by = next(quantity for quantity in found.quantities if quantity.name == "plan_error_measured")
    openings, fine = panel_aperture(found.die.panel), replace(found.plan, choice=replace(found.plan.choice, lines=256))
    few, many = (spectrum_psf(openings, CAMERA, scene, plan, scene.bands[0]) for plan in (found.plan, fine))
    off = relative_difference(few, many)
    assert off > 1e-6
    assert off <= told_by.value + told_by.uncertainty
    assert told_by.value <= told(found)["plan_error"]


def test_a_field_that_is_too_small_to_tell_has_no_views():
    found = measured(Scene(field_um=20.0), 1e-2)
    assert found.field == ()
    assert told(found)["scene_psf_change"] < 1e-2


def test_views_tell_their_angle_their_light_and_their_mtf():
    found = measured(Scene(field_um=CAMERA.focal_um * math.tan(math.radians(30.0))), 1e-3)
    corner, edge, centre = found.field[0][0], found.field[2][4], found.field[2][2]
    assert (corner.angle_deg, centre.angle_deg, centre.illumination) == (pytest.approx(30.0), 0.0, pytest.approx(1.0))
    assert corner.illumination == pytest.approx(math.cos(math.radians(30.0)) ** 4)
    assert edge.angle_deg == pytest.approx(math.degrees(math.atan(math.tan(math.radians(30.0)) / math.sqrt(2))))
    assert corner.residual > 0.01
    # Along the radius the stop is cos³ as wide to the sensor, across it cos.
    worst = max((found.field[y][x] for y in (0, 4) for x in (0, 4)), key=lambda view: view.residual)
    assert told(found)["field_mtf_tangential"] == worst.mtf_tangential < centre.mtf_tangential
    assert centre.restored_loss_db == 0
    assert told(found)["field_restored_loss"] == worst.restored_loss_db > 0
    (row,) = (each for each in found.quantities if each.name == "field_residual")
    assert re.search("30 degrees off the axis, where an even scene is 0.56[23] as bright", row.method)


@pytest.fixture(scope="module")
def behind_gap() -> SceneOptics:
    return measured(Scene(gap_um=60.0, field_um=3000.0, nearest_um=1e5), 0.4)


def test_views_are_held_against_the_axis_in_focus(behind_gap):
    rows = behind_gap.field
    assert [len(row) for row in rows] == [5] * 5
    centre = rows[2][2]
    assert (centre.image_um, centre.residual, centre.change) == ((0.0, 0.0), 0.0, 0.0)
    assert all(view.residual > 0 for row in rows for view in row if view is not centre)
    corners = [rows[y][x] for y in (0, 4) for x in (0, 4)]
    assert all(math.hypot(*view.image_um) == pytest.approx(3000.0) for view in corners)
    assert told(behind_gap)["field_residual"] == max(view.residual for view in corners)
    near, far = behind_gap.depth
    assert (near.object_um, far.object_um, far.residual) == (1e5, math.inf, 0.0)
    assert told(behind_gap)["depth_residual"] == near.residual > 0
    np.testing.assert_array_equal(far.psf.values, centre.psf.values)


def test_what_the_plan_leaves_out_is_measured_within_its_estimate(behind_gap):
    assert 0 < told(behind_gap)["plan_error_measured"] < told(behind_gap)["plan_error"] <= 0.4
    judged = {quantity.name for quantity in behind_gap.quantities if quantity.passed is not None}
    assert judged == {"plan_error", "plan_error_measured"}
    assert all(quantity.die == "D" for quantity in behind_gap.quantities)


@pytest.fixture(scope="module")
def straight() -> SceneOptics:
    """Without the light's angle."""
    return measured(Scene(gap_um=60.0, field_um=3000.0), 0.4, oblique=False)


def test_twice_the_gap_at_half_the_height_moves_the_shadow_as_far(straight):
    """Where diffraction and the light's angle are left out, gap times height is all that counts."""
    shorter, longer = straight, measured(Scene(gap_um=120.0, field_um=1500.0), 0.4, oblique=False)
    assert not shorter.plan.choice.diffraction
    assert not longer.plan.choice.diffraction
    assert shorter.field
    for one, other in zip(shorter.field, longer.field, strict=True):
        for a, b in zip(one, other, strict=True):
            assert a.residual == pytest.approx(b.residual, rel=1e-6, abs=1e-12)


def test_a_longer_shift_leaves_more_blur(straight):
    short = measured(Scene(gap_um=40.0, field_um=3000.0), 0.4, oblique=False)
    assert told(short)["field_residual"] < told(straight)["field_residual"]


def test_where_the_focus_is_near_the_far_end_is_the_worse():
    found = measured(Scene(nearest_um=1e5, farthest_um=2e5, focus_um=1e5), 0.3)
    sharp, blurred = found.depth
    assert sharp.residual == 0.0
    assert told(found)["depth_residual"] == blurred.residual > 0
    change = next(quantity for quantity in found.quantities if quantity.name == "scene_psf_change")
    assert "0.2 m" in change.method


def test_bands_have_their_colours_told():
    bands = tuple(camera_bands(generic_rgb()).values())
    found = measured(Scene(bands=bands), 0.5, camera=replace(CAMERA, window_um=40.0))
    assert [psf.kind for psf in found.colours] == ["pixel"] * 3
    red, green, blue = (psf.wavelength_nm for psf in found.colours)
    assert 400 < blue < green < red < 700
    assert {"colour_distance", "edge_colour_difference"} <= set(told(found))


def test_bands_beyond_the_cameras_lines_are_looked_at_by_their_own_light():
    infrared = Band((Curve(np.array([800.0, 900.0]), np.ones(2), "infrared"),), "infrared")
    found = measured(Scene(nearest_um=1e5, bands=(infrared,)), 0.5, camera=replace(CAMERA, window_um=40.0))
    assert {view.psf.wavelength_nm for view in found.depth} == {850.0}
    assert len(found.colours) == 1


# --- what was read back -----------------------------------------------------------------------------------------------


def laid_out(subject: Die) -> db.Layout:
    return plate_layout(Plate("P", "", 5_000_000, 5_000_000, (subject,), (), (), ()))


@pytest.mark.parametrize("reach", [200.0, 250.0, 1e4])
def test_openings_read_back_are_those_of_the_design(reach):
    subject = die()
    read = read_openings(subject, clear_shapes(laid_out(subject), reach_box(subject, reach)), reach)
    wanted = panel_aperture(subject.panel, reach)
    inside = [abs(edges[1:] + edges[:-1]) / 2 < reach - 8 for edges in (wanted.y.edges_um(), wanted.x.edges_um())]
    here = np.ix_(*inside)
    np.testing.assert_array_equal(read.transmission[here], wanted.transmission[here])
    assert wanted.transmission[here].any()


def test_a_dot_that_the_file_lacks_is_seen():
    whole, holed = die(), die(turns=np.zeros((12, 12), dtype=np.int8))
    reach = scene_reach_um(CAMERA, Scene(gap_um=100.0, field_um=500.0))
    read = read_openings(whole, clear_shapes(laid_out(holed), reach_box(holed, reach)), reach)
    assert (read.transmission != panel_aperture(whole.panel, reach).transmission).any()


def test_a_box_ends_with_the_panel():
    subject = die()
    assert reach_box(subject, 1e6) == subject.box_nm
    x0, y0, x1, y1 = reach_box(subject, 100.0)
    assert (x1 - x0, y1 - y0) == (200_000, 200_000)


def test_reach_holds_stop_shift_and_spread():
    assert scene_reach_um(CAMERA, Scene()) == 200.0
    assert scene_reach_um(CAMERA, Scene(gap_um=100.0, field_um=500.0)) > 200.0 + 10.0 + 100.0


def test_memory_of_diffraction_is_foreseen():
    subject, scene = die(), Scene(gap_um=50.0, field_um=500.0)
    plan = scene_plan(subject, CAMERA, scene, 0.3, "job.toml")
    assert peak_bytes(subject, CAMERA, scene, plan) > plan.price.memory
    plain = scene_plan(subject, CAMERA, Scene(), 0.3, "job.toml")
    assert peak_bytes(subject, CAMERA, Scene(), plain) == plain.price.memory


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "accuracy", "code"),
    [
        (Scene(gap_um=2000.0, field_um=2000.0), 0.3, "MF114"),
        (Scene(gap_um=500.0), 1e-6, "MF115"),
        (Scene(nearest_um=4000.0), 0.3, "MF104"),
    ],
)
def test_a_scene_that_cannot_be_modelled_names_its_die(scene, accuracy, code):
    with pytest.raises(JobError) as caught:
        scene_plan(die(), CAMERA, scene, accuracy, "job.toml")
    assert caught.value.code == code
    assert caught.value.where.startswith("job.toml: die D, ")
    assert caught.value.cure


@pytest.mark.parametrize(("um", "words"), [(math.inf, "infinity"), (5e5, "0.5 m"), (5e4, "50 mm")])
def test_distances_are_told_in_a_readers_unit(um, words):
    assert distance(um) == words
