"""Designs for the mean over a job's scene: the phase of a depth, the gap and the field, and what is told of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from once import leaves, small_scenes
from scipy.integrate import quad
from scipy.stats import spearmanr
from sweeps import sweep

from maskfab.base.errors import JobError
from maskfab.base.model import Tiling
from maskfab.base.work import Clock
from maskfab.camera.die_transfer import die_transfer
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.camera.scenes import Folder
from maskfab.camera.stop_cells import F1, CellGrid, OpenStop, lattice
from maskfab.designs.design import capture_settings, check_possible, conditions_of, design, notes_of
from maskfab.designs.model.appraisal import SceneConditions, appraise_over, cells_across, designed_panel, transfers
from maskfab.designs.model.expected_psnr import surrogate_of
from maskfab.designs.model.panel_error import PupilError, pupil_error
from maskfab.designs.model.panel_judgement import MeanPanelError
from maskfab.designs.model.statistics import CaptureSettings, scene_statistics
from maskfab.job.camera import Camera, Sensor
from maskfab.job.read import validate
from maskfab.job.reference import USES
from maskfab.mask.opening_file import opening_text
from maskfab.optics.phase import Wavefront, defocus_waves
from maskfab.optics.scene.scene import Scene
from maskfab.report.pages.design import designed_document
from maskfab.report.text import designed_lines

CAMERA = Camera(F1.focal_um, F1.stop, F1.wavelengths_nm, F1.pixel_um, 256.0)
TAKING = CaptureSettings(Protocol("camera", Sensor()), (32.0,))
DOT_NM = 48_000
ROOM = lattice(7, DOT_NM, camera=F1)
SECTIONS = {
    "camera": {
        "focal": "10 mm",
        "stop": {"shape": "circle", "diameter": "3.1 mm"},
        "wavelengths": ["610 nm", "530 nm", "470 nm"],
        "pixel": "2 um",
    },
    "design": {"name": "small", "dots": 7, "pitch": "336 um", "clear_dots": 12, "families": ["bars"]},
}
NEAR_UM = 5e6


def job(scene, **design):
    given = {} if scene is None else {"scene": scene}
    return validate(
        {**SECTIONS, "exposure": {"snr": [32]}, **given, "design": {**SECTIONS["design"], **design}}, where="job"
    )


def shaped(rows, columns, dots=7):
    unit = np.zeros((dots, dots), dtype=np.bool_)
    unit[:rows, :columns] = True
    return unit


def planned(scene: Scene, accuracy: float = 1e-2) -> SceneConditions:
    return SceneConditions.planned(CAMERA, scene, accuracy, shaped(4, 3), ROOM)


@pytest.fixture(scope="module")
def known():
    return scene_statistics([leaves(1)], settings=TAKING)


def error_at(known, seen: SceneConditions, object_um: float, room: CellGrid = ROOM) -> PupilError:
    return pupil_error(surrogate_of(known, seen.behind(room), seen.waves(object_um, F1.middle_nm)))


def defocus(object_um):
    return defocus_waves(CAMERA, F1.middle_nm, object_um, math.inf)


@pytest.mark.parametrize("lag", [20, 60, 110])
def test_the_open_stop_out_of_focus_has_the_transfer_of_a_defocused_lens(lag):
    """Over the overlap of two discs s apart, phases differ by 2 c s x waves (Hopkins, Proc. R. Soc. A 231, 1955)."""
    room = lattice(21, camera=F1)
    found = OpenStop.of(room, F1.middle_nm, amplitude=room.turned(defocus(NEAR_UM)))
    assert found.table.dtype == np.float64
    radius, apart = CAMERA.stop.diameter_um / 2, lag * room.dot_um
    curvature = float(defocus(NEAR_UM)(np.array(1.0), np.array(0.0)))

    def chord(x):
        return 2 * math.sqrt(max(0.0, radius**2 - (abs(x) + apart / 2) ** 2))

    reach = radius - apart / 2
    total, _ = quad(lambda x: chord(x) * math.cos(4 * math.pi * curvature * apart * x), -reach, reach, limit=200)
    assert found.at(np.array(0), np.array(lag)) == pytest.approx(total / (math.pi * radius**2), abs=1e-3)


def test_odd_aberrations_give_the_open_stop_a_complex_transfer():
    room = lattice(7, DOT_NM, camera=F1)
    coma = Wavefront(((8, 0.1),), F1.middle_nm).waves(CAMERA.stop, F1.middle_nm)
    table = OpenStop.of(room, F1.middle_nm, amplitude=room.turned(coma)).table
    assert table.dtype == np.complex128
    np.testing.assert_allclose(table, table[::-1, ::-1].conj(), atol=1e-12)


@pytest.mark.parametrize("scene", sweep([Scene(aberrations=((8, 0.15), (5, 0.1))), Scene(nearest_um=NEAR_UM)], 1))
def test_a_panels_error_is_that_by_the_transfer_of_its_die(known, scene):
    """Whole dots and their transforms against the dots cut by the stop, and their lags, of simulated photographs."""
    seen = planned(scene)
    panel = designed_panel(shaped(4, 3), DOT_NM, tiling=Tiling.RANDOM, seed=3, across=ROOM.cells)
    errors = tuple(error_at(known, seen, each) for each in seen.distances_um)
    found = appraise_over(panel, seen, errors)
    for error, psnr in zip(errors, found.psnr, strict=True):
        assert error.psnr(error.laid(shaped(4, 3), panel.orientations)) == pytest.approx(psnr, abs=0.03)
    assert found.mean == pytest.approx(np.mean(found.psnr, axis=0))


@pytest.mark.parametrize(
    "scene", sweep([Scene(nearest_um=NEAR_UM, farthest_um=2e7), Scene(aberrations=((8, 0.15),))], 1)
)
def test_the_slope_over_distances_is_that_of_differences(known, scene):
    seen = planned(scene)
    error = MeanPanelError(tuple(error_at(known, seen, each) for each in seen.distances_um))
    pupil = error.laid(shaped(4, 3))
    epsilons = error.epsilons(pupil)
    assert error.judge(pupil, epsilons).loss == pytest.approx(-np.mean(error.psnr(pupil)))
    step = 1e-3 * np.random.default_rng(0).standard_normal(pupil.shape) * error.inside
    after, before = (error.judge(pupil + sign * step, epsilons).loss for sign in (1, -1))
    slope = float((error.judge(pupil, epsilons).slope().field * step).sum())
    assert (after - before) / 2 == pytest.approx(slope, rel=0.02)


def test_a_blur_that_is_known_restores_as_its_own_and_another_worse(known):
    seen = planned(Scene(nearest_um=NEAR_UM))
    error = error_at(known, seen, math.inf)
    panel = designed_panel(shaped(4, 3), DOT_NM, tiling=Tiling.RANDOM, seed=3, across=ROOM.cells)
    dies = [die_transfer("D", panel, CAMERA, seen.scene, seen.plan, object_um=each) for each in (math.inf, NEAR_UM)]
    here, away = (transfers(die, error) for die in dies)
    own = error.squared_errors(here, 0.25)
    np.testing.assert_allclose(error.squared_errors(here, 0.25, known=here), own, rtol=1e-5)
    assert (error.squared_errors(here, 0.25, known=away) > own).all()


def test_conditions_are_a_mean_over_a_disc_at_the_ends_of_the_depth_and_the_focus():
    seen = planned(Scene(nearest_um=2e6, farthest_um=8e6, focus_um=4e6, gap_um=1000, field_um=1500), 1e-2)
    assert seen.distances_um == (2e6, 4e6, 8e6)
    conditions = list(seen)
    assert len(conditions) == 15
    assert sum(each.weight for each in conditions) == pytest.approx(1)
    x, y = np.array([each.image_um for each in conditions]).T / 1500
    shares = [each.weight for each in conditions]
    # Means of x², y², xy and x over the unit disc.
    moments = [np.dot(shares, each) for each in (x**2, y**2, x * y, x)]
    assert moments == pytest.approx([0.25, 0.25, 0, 0], abs=1e-12)


def test_the_mean_over_layouts_is_the_same_across_a_gap(known):
    """A free wave keeps its autocorrelation: single layouts change, means of them do not."""
    seen = planned(Scene(gap_um=1000))
    assert seen.modelled == ("diffraction over the gap",)
    assert not seen.turns_light
    error = pupil_error(surrogate_of(known, ROOM))
    across = cells_across(CAMERA, seen.scene, ROOM)
    change = []
    for seed in range(6):
        panel = designed_panel(shaped(4, 3), DOT_NM, tiling=Tiling.RANDOM, seed=seed, across=across)
        start = (across - ROOM.cells) // 2
        kinds = panel.orientations[start : start + ROOM.cells, start : start + ROOM.cells]
        change.append(appraise_over(panel, seen, [error]).mean[0] - error.psnr(error.laid(shaped(4, 3), kinds))[0])
    assert abs(np.mean(change)) < 0.05
    assert max(map(abs, change)) > 1e-4


@pytest.mark.slow
def test_openings_rank_over_a_depth_as_simulated_photographs_do():
    """Photographs of both distances by protocol camera, each restored by the blur of its own, of another scene."""
    dots, room = 7, lattice(7, 24_000, camera=F1)
    settings = CaptureSettings(Protocol("camera", Sensor()), (32.0,))
    seen = SceneConditions.planned(CAMERA, Scene(nearest_um=NEAR_UM), 1e-2, shaped(4, 3), room)
    rng = np.random.default_rng(1)
    units = [shaped(4, 3), shaped(6, 2), shaped(7, 2), shaped(1, 7) | shaped(6, 1)]
    unit = np.zeros(dots * dots, dtype=np.bool_)
    unit[rng.permutation(dots * dots)[:12]] = True
    units.append(unit.reshape(dots, dots))
    of_scene = scene_statistics([leaves(1)], settings=settings)
    judged = [surrogate_of(of_scene, room, seen.waves(each, F1.middle_nm)) for each in seen.distances_um]
    expected = [np.mean([each(unit) for each in judged]) for unit in units]
    scene, _ = small_scenes()
    measured = []
    for unit in units:
        panel = designed_panel(unit, 24_000, tiling=Tiling.RANDOM, seed=2, across=room.cells)
        dies = [
            die_transfer(f"{each:g}", panel, CAMERA, seen.scene, seen.plan, object_um=each)
            for each in seen.distances_um
        ]
        table = evaluate(dies, [scene], [scene], (32,), protocol=settings.protocol, details=False)
        measured.append(np.mean([score.psnr for score in table.scores]))
    assert spearmanr(expected, measured)[0] >= 0.95


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr("maskfab.designs.design.scene_sets.bundled", lambda *_: (leaves(1),))


ASKS_FOR_NOTHING = {"depth": ["inf", "inf"], "gap": "0 um", "field": "0 mm", "accuracy": "draft"}


@pytest.mark.usefixtures("few")
def test_a_scene_that_asks_for_nothing_changes_no_byte():
    plain, same = (design(job(scene), "again", where="job") for scene in (None, ASKS_FOR_NOTHING))
    assert opening_text(plain.opening) == opening_text(same.opening)
    assert (plain.psnr, plain.notes, plain.camera, same.scene) == (same.psnr, same.notes, same.camera, None)


@pytest.mark.usefixtures("few")
def test_a_design_over_a_depth_lists_its_conditions_and_their_mean(tmp_path):
    scene = {"depth": ["2 m", "inf"], "gap": "10 um", "field": "1 mm", "accuracy": 0.05, "spectrum": "rgb"}
    spec = job(scene, map="equal_light", shortlist=1)
    found = design(spec, "again", where="job")
    assert found.map_head_room is None
    document = designed_document(found, {"opening": tmp_path / "o.toml", "map": tmp_path / "m.toml"}, found.notes)
    told = document["scene"]
    assert told["modelled"] == ["defocus over the depth"]
    assert [each["object_um"] for each in told["conditions"]] == [2e6, None]
    near, sharp = (each["psnr_db"]["32"] for each in told["conditions"])
    assert near < sharp
    for level, mean in told["mean_psnr_db"].items():
        assert mean == pytest.approx(np.mean([each["psnr_db"][level] for each in told["conditions"]]))
        assert mean > told["random_mean_psnr_db"][level]
    assert any("shift through the gap is left out" in each for each in told["left_out"])
    assert "depth 2000000 um to inf, focus inf" in found.opening.provenance["scene"]
    notes = " ".join(found.notes)
    assert "spectrum of [scene]" in notes
    assert "[scene]," not in notes.replace("spectrum of [scene]", "")
    assert "Of the scene, shift through the gap is left out" in notes
    lines = designed_lines(found, found.notes)
    assert any(line.startswith("  at 2 m, on the axis (50.0%): ") for line in lines)


@pytest.mark.usefixtures("few")
def test_a_short_budget_says_that_conditions_are_not_told_apart():
    found = design(job({"depth": ["2 m", "inf"], "accuracy": 0.05}), "again", where="job", clock=Clock(1))
    assert found.scene is None
    assert any("conditions are told apart" in each for each in found.notes)


def test_a_scene_that_openings_are_not_compared_by_is_named():
    spec = job({"depth": ["5 m", "inf"]}, protocol="f1")
    assert conditions_of(spec, spec.design, DOT_NM, "job") is None
    (told,) = notes_of(spec, Folder((), ()), USES["design"], capture_settings(spec))
    assert "[scene]" in told


@pytest.mark.parametrize(
    ("scene", "camera", "code"),
    [
        ({"depth": ["10 cm", "inf"]}, {}, "MF115"),
        ({"gap": "2 mm", "accuracy": 1e-9}, {}, "MF115"),
        ({"depth": ["5 m", "inf"]}, {"wavelengths": ["530 nm"]}, "MF134"),
    ],
)
def test_scenes_that_cannot_be_modelled_are_refused_before_any_work(scene, camera, code):
    spec = validate({**SECTIONS, "camera": {**SECTIONS["camera"], **camera}, "scene": scene}, where="job")
    with pytest.raises(JobError, match=code) as refusal:
        check_possible(spec, where="job")
    assert refusal.value.where.startswith("job: ")
