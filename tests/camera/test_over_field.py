"""Photographs whose blur changes over the field, and what photographs leave out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from optics_cases import noise, panel

from maskfab.camera.die_transfer import die_transfer
from maskfab.camera.left_out import left_out
from maskfab.camera.over_field import MOST_NODES, FieldNodes, OverField, blurred_over_field, gathered
from maskfab.camera.photographs import Photograph
from maskfab.camera.protocol import Protocol, SensorScene
from maskfab.camera.restorers.wiener import Margin
from maskfab.camera.sensor import Sensor
from maskfab.model import Camera, Glass, MaskBlank, Stop, Track
from maskfab.optics.image.spectrum import Spectrum
from maskfab.optics.scene.distortion import Distortion
from maskfab.optics.scene.plan import plan
from maskfab.optics.scene.scene import Scene

CAMERA = Camera(2000.0, Stop("circle", 300.0), (610.0, 530.0, 470.0), 1.4, 128.0)
PANEL = panel(noise(7, 0.4, 4), cells=16, seed=3)
SHAPE, MARGIN = (64, 96), Margin((64, 96), 16)
# Light of the edge of the field meets openings two dots from those that the axis meets.
FAR = Scene(gap_um=400.0, field_um=80.0)


@pytest.fixture(scope="module")
def seen():
    found = die_transfer("D", PANEL, CAMERA)
    return replace(found, view=replace(found.view, scene=FAR, gap_um=FAR.gap_um))


def nodes_at(y_um: list[float], x_um: list[float]) -> FieldNodes:
    return FieldNodes(np.array(y_um), np.array(x_um), SHAPE, CAMERA.pixel_um)


def test_with_one_node_the_blur_is_that_of_the_axis(seen):
    scene = np.random.default_rng(1).random((3, *SHAPE), dtype=np.float32)
    expected = MARGIN.blurred(np.fft.rfft2(scene).astype(np.complex64), seen.on(SHAPE))
    assert blurred_over_field(scene, seen.at, nodes_at([0.0], [0.0]), MARGIN) == pytest.approx(expected, abs=1e-5)


def test_a_point_spreads_as_the_nodes_round_it_do(seen):
    nodes = nodes_at([0.0], [-30 * 1.4, 30 * 1.4])
    left, right = (seen.at((x, 0.0)).on(SHAPE) for x in nodes.x_um)
    # The picture's middle lies between columns 47 and 48; beyond a node it has all of the light.
    for column, share in ((10, 1.0), (17, 1.0), (32, 45.5 / 60), (77, 0.5 / 60), (90, 0.0)):
        scene = np.zeros((3, *SHAPE), dtype=np.float32)
        scene[:, 32, column] = 1
        spectrum = np.fft.rfft2(scene).astype(np.complex64)
        expected = MARGIN.blurred(spectrum, share * left + (1 - share) * right)
        assert blurred_over_field(scene, seen.at, nodes, MARGIN) == pytest.approx(expected, abs=1e-6)
    assert abs(left - right).max() > 0.01


def test_an_even_scene_stays_even_whatever_the_nodes(seen):
    scene = np.full((3, *SHAPE), 0.5, dtype=np.float32)
    nodes = nodes_at([-30.0, 0.0, 30.0], [-50.0, 50.0])
    assert sum(nodes.weights()[0]) == pytest.approx(1.0)
    assert blurred_over_field(scene, seen.at, nodes, MARGIN) == pytest.approx(0.5, abs=1e-2)


def test_places_are_those_of_the_plan_within_picture_and_field(seen):
    made = plan(PANEL, CAMERA, Scene(), 3e-2)
    for places, expected in ((1, 1), (3, 3), (33, MOST_NODES)):
        chosen = replace(made, choice=replace(made.choice, places=places))
        nodes = FieldNodes.of(seen, chosen, SHAPE)
        assert (nodes.y_um.size, nodes.x_um.size) == (expected, expected)
        assert math.hypot(nodes.y_um[-1], nodes.x_um[-1]) <= FAR.field_um * (1 + 1e-12)
        assert nodes.y_um[-1] <= 31.5 * CAMERA.pixel_um
    errors = [nodes_at(list(reach), list(reach)).error(seen) for reach in ([0.0], [-4.0, 4.0], [-30.0, 30.0])]
    assert errors[0] == 0.0
    assert 0 < errors[1] < errors[2]


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


def test_a_photograph_of_a_die_over_the_field_is_blurred_by_its_nodes_and_restored_by_the_axis(seen):
    values = np.random.default_rng(2).random((3, 512 + 64, 512 + 96), dtype=np.float32)
    known = SensorScene.of(Photograph("noise", 1, values))
    foretold = plan(PANEL, CAMERA, FAR, 1e-1)
    die = OverField(seen, replace(foretold, choice=replace(foretold.choice, places=3)))
    quiet = Protocol("quiet", Sensor(full_well=1e12, read_noise=0.0), linear=False)
    nodes = FieldNodes.of(seen, die.plan, known.margin.shape)
    assert (nodes.y_um.size, nodes.x_um.size) == (3, 3)
    expected = blurred_over_field(values, seen.at, nodes, known.margin)
    found = quiet.photograph(die, known, 110.0).values
    assert found == pytest.approx(expected, abs=1e-4)
    assert abs(found - quiet.photograph(seen, known, 110.0).values).max() > 1e-3
    np.testing.assert_array_equal(die.on(SHAPE), seen.on(SHAPE))


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
