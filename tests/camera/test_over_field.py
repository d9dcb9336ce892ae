"""Photographs whose blur changes over the field, and what photographs leave out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from optics_cases import noise, panel

from maskfab.base.model import Track
from maskfab.camera.die_transfer import Samples, die_transfer, left_out
from maskfab.camera.field_transfer import REACH, FieldChange, FieldNodes, OverField, gathered
from maskfab.camera.imaging import Margin
from maskfab.camera.protocol import Protocol
from maskfab.camera.scenes import Photograph
from maskfab.job.camera import Camera, Sensor, Stop
from maskfab.job.process import Glass, MaskBlank
from maskfab.optics.gap import AXIS
from maskfab.optics.scene.plan import plan
from maskfab.optics.scene.scene import Distortion, Scene
from maskfab.optics.spectrum import Spectrum

CAMERA = Camera(2000.0, Stop("circle", 300.0), (610.0, 530.0, 470.0), 1.4, 128.0)
PANEL = panel(noise(7, 0.4, 4), cells=16, seed=3)
SHAPE, MARGIN = (320, 352), Margin((320, 352), 130)
# Light of the edge of the field meets openings two dots from those that the axis meets.
FAR = Scene(gap_um=400.0, field_um=80.0)


@pytest.fixture(scope="module")
def seen():
    found = die_transfer("D", PANEL, CAMERA)
    return replace(found, view=replace(found.view, scene=FAR, gap_um=FAR.gap_um))


@pytest.fixture(scope="module")
def dies(seen):
    """A die over the field, by the accuracy that is asked for."""
    made = plan(PANEL, CAMERA, Scene(), 3e-2)
    return {accuracy: OverField(seen, replace(made, accuracy=accuracy)) for accuracy in (1e-1, 2e-2, 6e-3)}


def point_um(row, column):
    """Place of a pixel within the field, which ends before the picture does."""
    reach = 80 / math.sqrt(2)
    x, y = ((place - (count - 1) / 2) * 1.4 for place, count in ((column, SHAPE[1]), (row, SHAPE[0])))
    return float(np.clip(x, -reach, reach)), float(np.clip(y, -reach, reach))


@pytest.fixture(scope="module")
def points(seen):
    """A few bright points, and the light on the sensor of each by the transfer of its own place."""
    draw = np.random.default_rng(3)
    scene = np.zeros((3, *SHAPE), dtype=np.float32)
    expected = np.zeros((3, *SHAPE), dtype=np.float32)
    for row, column in draw.integers((110, 110), (210, 240), (12, 2)):
        colour = draw.random(3, dtype=np.float32)
        scene[:, row, column] += colour
        spread = np.fft.irfft2(seen.at(point_um(row, column)).on(SHAPE), s=SHAPE)
        expected += np.roll(spread, (row, column), axis=(1, 2)) * colour[:, None, None]
    return scene, MARGIN.sensor(expected)


def changed(change, place):
    """Change of the point spread at a place, as a picture's blur has it."""
    shares = change.shares.reshape(len(change.shares), len(change.nodes.places)) @ change.nodes.shares(place)
    return np.tensordot(shares, change.spreads, 1)


def relative(found, expected):
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


@pytest.mark.parametrize("accuracy", [2e-2, 6e-3])
def test_every_point_spreads_by_the_openings_of_its_own_place(seen, dies, points, accuracy):
    light, expected = points
    die = dies[accuracy]
    assert relative(die.blurred(light, MARGIN), expected) < accuracy < relative(seen.blurred(light, MARGIN), expected)
    np.testing.assert_array_equal(die.on(SHAPE), seen.on(SHAPE))


def test_the_error_told_is_that_of_places_nobody_measured(dies, seen):
    changes = [each.change(SHAPE) for each in dies.values()]
    axis = np.fft.irfft2(seen.on(SHAPE), s=SHAPE)
    across, mean = np.arange(-REACH, REACH + 1), []
    places = np.random.default_rng(5).uniform(-50, 50, (12, 2))
    for change in changes:
        errors = []
        for x, y in places:
            found = axis.copy()
            found[:, across[:, None], across] += changed(change, (x, y))[:, across[:, None], across]
            errors.append(relative(found, np.fft.irfft2(seen.at((x, y)).on(SHAPE), s=SHAPE)))
        assert 0.3 * change.error < max(errors) < 1.5 * change.error
        mean.append(np.mean(errors))
    assert mean[0] > 2 * mean[1] > 4 * mean[2]


def test_an_accuracy_that_the_axis_meets_takes_no_other_place(seen, dies, points):
    die = dies[1e-1]
    change = die.change(SHAPE)
    assert (change.nodes.places, len(change.spreads)) == ([AXIS], 0)
    assert 0.01 < change.error < 0.1
    (told,) = die.told
    assert "that of the axis" in told
    assert f"{change.error:.1g}" in told
    np.testing.assert_array_equal(die.blurred(points[0], MARGIN), seen.blurred(points[0], MARGIN))


def test_scenes_of_several_sizes_are_told_apart_and_what_is_the_same_is_told_once(dies):
    def change(error):
        return FieldChange(
            FieldNodes(np.zeros(1), np.zeros(1), SHAPE, 2.0), *2 * (np.zeros((0, 1, 1), np.float32),), error
        )

    die = replace(dies[1e-1])
    die._kept.update({SHAPE: change(0.01), (64, 128): change(0.012)})
    (told,) = die.told
    assert "pixels" not in told
    die._kept[1024, 1536] = change(0.05)
    few, large = die.told
    assert few == f"in scenes of {SHAPE[1]} x {SHAPE[0]}, 128 x 64 pixels {told}"
    assert large.startswith("in scenes of 1536 x 1024 pixels over the field")
    assert "0.05" in large


def test_an_even_scene_stays_even(dies):
    scene = np.full((3, *SHAPE), 0.5, dtype=np.float32)
    change = dies[2e-2].change(SHAPE)
    assert change.nodes.y_um.size > 1
    assert sum(change.nodes.weights()[0]) == pytest.approx(1.0)
    assert dies[2e-2].blurred(scene, MARGIN) == pytest.approx(0.5, abs=2e-3)


def test_parts_of_a_sensor_join_without_a_seam(dies, monkeypatch):
    scene = np.random.default_rng(1).random((3, *SHAPE), dtype=np.float32)
    change = dies[2e-2].change(SHAPE)
    whole, parts = np.zeros((2, *MARGIN.sensor(scene).shape), dtype=np.float32)
    change.add(scene, MARGIN, whole)
    monkeypatch.setattr("maskfab.camera.field_transfer.MOST_ACROSS", 25)
    change.add(scene, MARGIN, parts)
    assert parts == pytest.approx(whole, abs=1e-6)
    assert abs(whole).max() > 1e-3


def test_places_lie_within_picture_and_field_and_are_more_where_more_is_asked_for(seen, dies):
    asked = [die.change(SHAPE).nodes for die in dies.values()]
    assert [nodes.y_um.size for nodes in asked] == [1, 3, 5]
    assert all(math.hypot(nodes.y_um[-1], nodes.x_um[-1]) <= FAR.field_um * (1 + 1e-12) for nodes in asked)
    small = FieldNodes.of(seen.view, (64, 96), 3)
    assert small.y_um[-1] == 31.5 * CAMERA.pixel_um
    assert small.x_um[-1] < 47.5 * CAMERA.pixel_um


def test_diffraction_over_the_gap_is_the_axiss_only_where_that_is_accurate_enough():
    far, camera = Scene(gap_um=60.0, field_um=30.0), replace(CAMERA, focal_um=800.0, stop=Stop("circle", 100.0))
    die = die_transfer("D", PANEL, camera, far)
    die = replace(die, samples=Samples(1, 4))
    made = plan(PANEL, CAMERA, Scene(), 3e-2)
    place = (20.0, -20.0)
    axis, own = (np.fft.irfft2(each.on((255, 255)), s=(255, 255)) for each in (die, die.at(place)))
    errors = []
    for accuracy in (1e-1, 2e-2):
        change = FieldChange.of(die, replace(made, accuracy=accuracy), SHAPE)
        errors.append(relative(axis + changed(change, place), own))
        assert errors[-1] < change.error
    assert errors[1] < 0.5 * errors[0]


def test_everything_that_no_photograph_holds_is_named():
    nothing = left_out(PANEL, Scene(), MaskBlank())
    assert nothing == ()
    glass = Glass(2300.0, 1.46, "away")
    wired = replace(PANEL, tracks=(Track("scan", "x", (((0, 0), (9, 0), (9, 9)),), turns=False),))
    scene = Scene(nearest_um=1e5, farthest_um=math.inf, field_um=80.0, gap_um=10.0, distortion=Distortion(0.02, 80.0))
    told = left_out(wired, scene, MaskBlank(3.0, None, glass))
    for part in ("off the axis", "distortion of 0.02", "between 100 mm and infinity", "0.001", "glass", "wires"):
        assert sum(part in each for each in told) == 1, part
    assert len(told) == 6


def test_what_the_plan_leaves_out_is_told_with_its_error_and_the_rest_is_not():
    scene = Scene(gap_um=20.0, aberrations=((11, 0.2),))
    made = plan(PANEL, CAMERA, scene, 5e-2)
    rows = {row.name: row for row in made.ingredients}
    told = left_out(PANEL, scene, MaskBlank(), made)
    assert rows["lens aberrations"].modelled
    left = [row for row in made.ingredients if not row.modelled and row.error and row.name.startswith("diffraction")]
    assert [each.split(" is left out")[0] for each in told] == [row.name for row in left]
    found = die_transfer("D", PANEL, CAMERA, scene, made)
    assert found.view.choice.diffraction == (not left)


def test_a_photograph_of_a_die_over_the_field_is_blurred_by_its_nodes(seen, dies):
    values = np.random.default_rng(2).random((3, 512 + 16, 512 + 32), dtype=np.float32)
    known = Photograph("noise", 1, values)
    die = dies[2e-2]
    quiet = Protocol("quiet", Sensor(full_well=1e12, read_noise=0.0), linear=False)
    found = quiet.photograph(die, known, 110.0).values
    assert found == pytest.approx(die.blurred(values, known.margin), abs=1e-4)
    assert abs(found - quiet.photograph(seen, known, 110.0).values).max() > 1e-3


def test_lines_are_gathered_with_their_light_and_its_mean():
    draw = np.random.default_rng(4)
    weights = draw.random(50)
    fine = Spectrum(np.sort(draw.uniform(400, 700, 50)), weights / weights.sum(), "band")
    coarse = gathered(fine, 16)
    assert coarse.wavelengths_nm.size == 16
    assert (np.diff(coarse.wavelengths_nm) > 0).all()
    assert coarse.weights.sum() == pytest.approx(1)
    assert coarse.centroid_nm == pytest.approx(fine.centroid_nm)
    assert gathered(fine, 50) is fine
