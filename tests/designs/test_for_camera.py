"""Openings for the job's own camera: its lens, its sensor, its levels and its light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from estimates import surrogate
from hypothesis import given, settings
from hypothesis import strategies as st
from once import leaves

from maskfab.base.errors import JobError
from maskfab.camera.protocol import F1 as PROTOCOL_F1
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.camera.scenes import Folder, Photograph
from maskfab.camera.sensor import LEVELS, Exposure, record_light
from maskfab.camera.stop_cells import F1, PhotoCamera, lattice, lay
from maskfab.designs.design import capture_settings, check_possible, design, notes_of
from maskfab.designs.model.expected_psnr import interior
from maskfab.designs.model.panel_error import pupil_error
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings, PixelNoise, SceneStatistics
from maskfab.designs.search.result import camera_facts
from maskfab.job.camera import Sensor, Stop
from maskfab.job.read import validate
from maskfab.job.reference import USES

OWN = CaptureSettings(Protocol("camera", Sensor()))
PHONE = PhotoCamera(5560.0, Stop("circle", 3475.0), 1.12, (610.0, 530.0, 470.0))
CAMERA = {
    "focal": "10 mm",
    "stop": {"shape": "circle", "diameter": "4 mm"},
    "wavelengths": ["610 nm", "530 nm", "470 nm"],
    "pixel": "2 um",
}
DESIGN = {"name": "small", "dots": 7, "pitch": "168 um", "clear_dots": 12, "families": ["bars"]}


def job(**sections):
    own = {**DESIGN, **sections.pop("design", {})}
    return validate({"camera": CAMERA, "design": own, **sections}, where="job")


def bar(rows=4, columns=3, dots=7):
    unit = np.zeros((dots, dots), dtype=np.bool_)
    unit[:rows, :columns] = True
    return unit


def speckled(dots=7, clear=12):
    unit = np.zeros(dots * dots, dtype=np.bool_)
    unit[np.random.default_rng(3).permutation(dots * dots)[:clear]] = True
    return unit.reshape(dots, dots)


@pytest.fixture(scope="module")
def own():
    return surrogate([leaves(1)], 7, settings=OWN)


def test_f1s_sensor_and_light_stated_as_a_protocol_of_another_name_are_f1s_numbers(estimate):
    """With the same ε to choose from, only electrons that are not whole differ: by 1/500 at most, .01 dB."""
    stated = replace(PROTOCOL_F1, name="camera", whole=False)
    other = surrogate([leaves(1)], 7, settings=CaptureSettings(stated))
    same = {"strengths": estimate.strengths, "leak_every": estimate.leak_every}
    other = replace(other, noise=replace(other.noise, coded_db={}), **same)
    for unit in (bar(), speckled()):
        np.testing.assert_allclose(other(unit), estimate(unit), atol=0.01)


def test_f1_is_what_it_was_to_the_last_bit(estimate):
    """The sum that the surrogate was before photographs could be others."""
    errors, share = estimate.errors(bar())
    square = 10**2.4
    white = round((square + (square**2 + 4 * square * 4.87**2) ** 0.5) / 2) * share / 0.2072
    light = float(leaves(1).values.mean())
    variance = light / white + (4.87 / white) ** 2
    assert estimate(bar())[0] == float(-10 * np.log10((variance * errors.noise + errors.bias + errors.leak).min()))


def test_linear_light_of_a_picture_of_two_greys_has_their_mean_and_both_scenes_count_by_contrast():
    rows, columns = 1024, 1536

    def halves(low, high, name):
        light = np.full((3, rows, columns), low, dtype=np.float32)
        light[:, :, columns // 2 :] = high
        code = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        return Photograph(name, 1, code.astype(np.float32))

    bright, dim = halves(0.2, 0.6, "bright"), halves(0.02, 0.06, "dim")
    known = SceneStatistics.of([bright, dim], settings=OWN).noise
    # Contrasts of .2 and .02 are brought to their geometric mean: by 10^-1/2 and 10^1/2.
    assert known.shot == pytest.approx((0.4 * 0.1 + 0.04 * 10) / 2, rel=1e-4)
    assert known.flat == pytest.approx((0.1 + 10) / 2, rel=1e-4)
    assert SceneStatistics.of([bright], settings=OWN).noise.flat == pytest.approx(1)


def test_read_noise_costs_most_in_least_light(own):
    noisy = surrogate([leaves(1)], 7, settings=CaptureSettings(Protocol("camera", Sensor(read_noise=40.0)), (24, 40)))
    white = [float(each) for each in noisy.noise.settings.electrons.values()]
    # As bright a scene: the levels of so noisy a sensor have more light, so electrons are put in the place of levels.
    still = replace(noisy, noise=replace(noisy.noise, settings=replace(noisy.noise.settings, protocol=OWN.protocol)))
    levels = tuple(float(20 * np.log10(each / np.sqrt(each + 4.87**2))) for each in white)
    calm = CaptureSettings(OWN.protocol, levels)
    still = replace(still, noise=replace(noisy.noise, settings=calm, coded_db={}))
    loss = np.subtract(still(bar()), replace(noisy, noise=replace(noisy.noise, coded_db={}))(bar()))
    assert loss[0] > loss[1] > 0


@settings(max_examples=30, deadline=None)
@given(white=st.floats(20, 15_000), read=st.floats(0, 30), shot=st.floats(0.01, 1))
def test_a_pixels_variance_is_that_of_counts(white, read, shot):
    own = CaptureSettings(Protocol("camera", Sensor(full_well=1e6, read_noise=read)), (30.0,))
    known = PixelNoise(own, shot)
    # Mean of Poisson counts of shot * white and of the read noise, over the square of white.
    assert known.of_white(white) == pytest.approx((shot * white + read**2) / white**2)


def test_a_converter_rounds_into_the_read_noise():
    sensor = Sensor(full_well=1023.0, read_noise=3.0, bits=10, gain=1.0)
    assert CaptureSettings(Protocol("camera", sensor), (20.0,)).read_noise(100.0) == pytest.approx((9 + 1 / 12) ** 0.5)


@settings(max_examples=30, deadline=None)
@given(white=st.floats(20, 15_000), late=st.floats(0, 60), bits=st.sampled_from([None, 8, 10]))
def test_openings_are_compared_at_the_gain_that_their_photographs_pick(white, late, bits):
    """One number for design and photographs, of numbers, arrays and tensors alike."""
    sensor = Sensor(bits=bits, converter_noise=late)
    own = CaptureSettings(Protocol("camera", sensor), (20.0,))
    taken = record_light(sensor, np.full((3, 2, 2), 0.5, np.float32), white, 1).noise
    expected = taken.floor**0.5 * taken.electrons
    assert own.read_noise(white) == pytest.approx(expected, rel=1e-6)
    for many in (np.array([white]), torch.tensor([white], dtype=torch.float64)):
        found = own.read_noise(many)
        assert float(found if isinstance(found, float) else found[0]) == pytest.approx(expected, rel=1e-6)


def test_a_longer_focal_length_restores_less_behind_the_same_stop():
    """A cycle per pixel is a longer lag: the stop passes less of it. Light at a level is the same."""
    longer = replace(F1, focal_um=14_000.0)
    near, far = (surrogate([leaves(1)], 7, camera=camera, settings=OWN)(bar()) for camera in (F1, longer))
    assert all(a > b for a, b in zip(near, far, strict=True))


def test_expected_means_in_code_values_lie_by_the_protocols_own_and_their_order_is_its_own(own):
    """Protocol camera photographs the scene itself, behind one random panel of each opening."""
    scene, units = leaves(1), {"bar": bar(), "speckled": speckled(), "slit": bar(2, 6)}
    room = lattice(7, camera=F1)
    laid = [lay(name, unit, room=room) for name, unit in units.items()]
    table = evaluate(laid, [scene], [scene], (32,), protocol=OWN.protocol, details=False)
    measured = {score.design: score.psnr for score in table.scores}
    expected = {name: own(unit, levels=(32,))[0] for name, unit in units.items()}
    assert sorted(measured, key=measured.get) == sorted(expected, key=expected.get)
    assert abs(np.mean(list(expected.values())) - np.mean(list(measured.values()))) < 3


def test_levels_are_the_jobs_own_throughout():
    own = CaptureSettings(OWN.protocol, (18.0, 35.5))
    estimate = surrogate([leaves(1)], 7, settings=own)
    room = interior(estimate)
    panel = pupil_error(estimate)
    assert len(estimate(bar())) == len(room.of_unit(bar())) == len(panel.psnr(panel.laid(bar()))) == 2
    assert panel.levels == (18.0, 35.5)
    with pytest.raises(JobError, match="MF104"):
        estimate(bar(), levels=(24,))


def test_of_a_realised_panel_the_same_is_expected_as_of_random_ones(own):
    panel = pupil_error(own)
    laid = np.array([panel.psnr(panel.laid(bar(), seed=seed)) for seed in range(2)])
    # One layout of 24 x 24 cells, cut cells and all, lies some tenths from the mean of all.
    np.testing.assert_allclose(laid.mean(axis=0), own(bar()), atol=0.4)


def test_a_job_is_compared_by_its_own_sensor_or_light_unless_it_names_f1():
    assert capture_settings(job()) is F1_SETTINGS
    assert capture_settings(job(sensor={"read_noise": 2.0}, design={"protocol": "f1"})) is F1_SETTINGS
    assert capture_settings(job(sensor={"read_noise": 2.0})).protocol == Protocol("camera", Sensor(read_noise=2.0))
    assert capture_settings(job(exposure={"snr": [20, 30]})).levels == (20, 30)
    assert capture_settings(job(design={"protocol": "camera"})) == CaptureSettings(Protocol("camera", Sensor()), LEVELS)
    lit = capture_settings(job(exposure={"white": 2000}))
    assert lit.levels == (Exposure.of_white(2000, Sensor()).level_db,)
    assert lit.electrons[lit.levels[0]] == pytest.approx(2000)


@pytest.mark.parametrize(
    ("sections", "named", "silent"),
    [
        ({"sensor": {"mosaic": "rggb", "read_noise": 2.0}}, ["mosaic of [sensor]"], ["read_noise", "exposure"]),
        ({"sensor": {"full_well": 12000.0}}, ["full_well of [sensor]"], ["mosaic"]),
        ({"exposure": {"snr": [30], "brackets": [1, 4]}}, ["brackets of [exposure]"], ["[sensor]"]),
        ({"sensor": {"read_noise": 2.0}, "design": {"protocol": "f1"}}, ["[sensor]", "protocol F1"], ["[exposure]"]),
    ],
)
def test_what_a_search_leaves_out_of_a_job_is_named(sections, named, silent):
    spec = job(**sections)
    (told,) = notes_of(spec, Folder((), ()), USES["design"], capture_settings(spec))
    assert all(each in told for each in named)
    assert not any(each in told for each in silent)


def test_a_sweep_which_is_by_f1_says_that_it_does_not_use_the_protocol():
    (told,) = notes_of(job(design={"protocol": "camera"}), Folder((), ()), USES["design"])
    assert "protocol of [design]" in told


def test_a_job_that_states_all_that_is_used_has_no_note():
    spec = job(sensor={"read_noise": 2.0}, exposure={"snr": [30]})
    assert notes_of(spec, Folder((), ()), USES["design"], capture_settings(spec)) == ()


def test_weights_for_other_levels_than_the_jobs_are_refused_before_any_work():
    check_possible(job(exposure={"snr": [20, 30]}, design={"weights": [1, 2]}), where="job")
    with pytest.raises(JobError, match=r"MF105.*3 weights for 2 levels of light, 20, 30 dB"):
        check_possible(job(exposure={"snr": [20, 30]}, design={"weights": [1, 2, 3]}), where="job")


def test_a_light_that_overflows_the_sensor_is_refused_before_any_work():
    with pytest.raises(JobError, match="MF141"):
        check_possible(job(sensor={"full_well": 500.0}, exposure={"snr": [40]}), where="job")


def test_a_file_says_what_it_was_designed_for_and_of_f1_nothing():
    assert camera_facts(F1) == {}
    facts = camera_facts(F1, CaptureSettings(Protocol("camera", Sensor(read_noise=2.0)), (30.0,)))
    assert facts["camera"] == "focal 10000 um, stop circle 4000 um, pixel 2 um, 610/530/470 nm"
    assert "read noise 2 electrons" in facts["protocol"]
    assert "30 dB; linear light" in facts["protocol"]
    assert camera_facts(PHONE)["protocol"] == "another camera at the levels of F1"


def test_a_design_for_the_jobs_camera_names_it_and_its_levels(monkeypatch):
    monkeypatch.setattr("maskfab.designs.design.scene_sets.bundled", lambda *_: (leaves(1),))
    found = design(job(exposure={"snr": [30]}, sensor={"read_noise": 2.0}), "again", where="job")
    assert "read noise 2 electrons; 30 dB; linear light, scored as sRGB" in found.camera
    assert found.levels == (30,)
    assert len(found.psnr) == len(found.head_room) == 1
    assert found.head_room[0] >= 0
    assert "expected_psnr_30" in found.opening.provenance
    assert found.opening.provenance["protocol"] in found.camera
