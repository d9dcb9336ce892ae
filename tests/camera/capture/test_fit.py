"""A die found again from pictures that another path made: what it is, how it stands, how it was written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camera.capture.captured_dies import GAIN, READ_NOISE, exposed, exposed_each, phased_picture, polygon_picture
from optics_cases import camera, noise, panel, pupil

from maskfab.camera.frames.merge import merged
from maskfab.camera.inspection.die_image import (
    MARGIN,
    OVERSAMPLING,
    DieField,
    DieImage,
    Pixels,
    Setting,
    pixel_means,
    turned,
)
from maskfab.camera.inspection.die_verdict import Answer
from maskfab.camera.inspection.fit import brightest, fitted, taken_of, with_frames, with_terms
from maskfab.camera.inspection.identity import WAYS_ROUND, Hypothesis, identified
from maskfab.camera.inspection.measurement import measured
from maskfab.optics.phase import Wavefront, phased, window_frequency
from maskfab.optics.psf import point_psf
from maskfab.optics.spectrum import line_spectrum

CAMERA = camera(diameter_um=800.0, window_um=128.0)
DIE = panel(noise(8, 0.45, 3), cells=14, seed=5)
OTHER = panel(noise(8, 0.45, 4), cells=14, seed=5)
LIGHT = {"-": line_spectrum([530.0])}
STACK = (1.0, 4.0, 16.0, 64.0)


def seen(picture, times=STACK, seed=0):
    merging = merged(exposed(picture, times, 1e4, seed), electrons_per_count=GAIN, read_noise_e=READ_NOISE)
    return merging, taken_of(merging, CAMERA.pixel_um, brightest(merging.planes))


def image_of(laid_out, taken, way=0):
    return DieImage.of(laid_out, way, CAMERA, LIGHT, [each.pixels for each in taken])


def grid(side=41):
    axis = CAMERA.pixel_um * (np.arange(side) - side // 2)
    return [Pixels("-", axis, -axis)]


def stood(picture, way):
    """A picture of a die as drawn, as one that stands otherwise makes it."""
    about = np.rot90(picture, way % 4)
    return np.rot90(picture[:, ::-1], way % 4) if way >= 4 else about


def test_means_over_pixels_and_turns_of_a_band_limited_picture():
    """A cosine that is as fine as the grid allows, under a wide Gaussian, where both are known in closed form."""
    samples, width, wave = 161, 3.7, 0.5 / OVERSAMPLING
    places = np.arange(samples) - samples // 2
    centres = np.linspace(-20, 20, 11) + 0.3
    fine = centres[:, None] + width * (np.arange(2000) + 0.5) / 2000 - width / 2
    expected = np.cos(2 * np.pi * wave * fine).mean(axis=1)
    got = pixel_means(samples, centres, width) @ np.cos(2 * np.pi * wave * places)
    assert got == pytest.approx(expected, abs=1e-5)

    x, y = places, places[:, None]

    def blob(x, y):
        return np.exp(-(((x - 9) / 9) ** 2) - ((y + 5) / 6) ** 2) * np.cos(0.8 * x + 0.3 * y)

    angle = 0.02
    back_x, back_y = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    inner = slice(MARGIN, -MARGIN)
    assert turned(blob(x, y), angle)[inner, inner] == pytest.approx(blob(back_x, back_y)[inner, inner], abs=1e-9)


@pytest.mark.parametrize("terms", [((4, 0.1),), ((7, 0.05), (4, -0.08))])
def test_the_field_is_that_of_a_phase_on_exact_dots(terms):
    held, frequencies = pupil(DIE, CAMERA.stop), 5e-4 * np.arange(20)
    found = abs(DieField.of(held, CAMERA.stop, frequencies).behind(terms).field(0.0)) ** 2
    path = Wavefront(terms, 530.0).waves(CAMERA.stop, 530.0)
    source = phased(held, path, window_frequency(CAMERA, 530.0))
    expected = abs(source.field(frequencies, frequencies)) ** 2
    # The slope of the phase within a dot, which is left out, is 25 times as steep here as behind a stop of 4 mm.
    assert np.linalg.norm(found - expected) < 5e-4 * np.linalg.norm(expected)


def test_the_intensity_in_focus_is_that_of_the_point_psf():
    held = pupil(DIE, CAMERA.stop)
    psf = point_psf(held, CAMERA, 530.0)
    scale = 0.53 * CAMERA.focal_um
    frequencies = psf.step_um * np.arange(psf.values.shape[0] // 2 + 1) / scale
    found = abs(DieField.of(held, CAMERA.stop, frequencies).behind(()).field(0.0)) ** 2
    # Of cut dots the moments beyond the second are left out.
    assert np.linalg.norm(found / (scale**2 * held.energy_um2) - psf.values) < 1e-5 * np.linalg.norm(psf.values)


def test_slopes_are_differences_of_pictures():
    image = DieImage.of(DIE, 0, CAMERA, LIGHT, grid())
    at = Setting(0.4, -0.3, 0.004, 2e-4, 0.1, ((4, 0.06), (7, -0.03)))
    steps = np.array([0.02, 0.02, 1e-3, 1e-4, 1e-2, 1e-3, 1e-3])
    for k, slope in enumerate(image.slopes(at)):
        change = np.zeros(steps.size)
        change[k] = steps[k]
        (ahead,), (behind,) = image.pictures(at.at(at.values + change)), image.pictures(at.at(at.values - change))
        expected = (ahead - behind) / (2 * steps[k])
        # What the lens's errors do to the edges' own part is left out.
        most = 3e-2 if at.names[k].startswith("z") else 2e-3
        assert np.linalg.norm(slope[0] - expected) < most * np.linalg.norm(expected), at.names[k]


def test_bias_and_turn_of_polygons_are_found_within_their_errors():
    truth = {"bias_um": 0.15, "turn_rad": 0.004, "z4": 0.0, "scale": 0.0}
    picture = polygon_picture(DIE, CAMERA, {530.0: 1.0}, bias_um=truth["bias_um"], turn_rad=truth["turn_rad"])
    _, taken = seen(picture)
    found = fitted(image_of(DIE, taken), taken, Setting(terms=((4, 0.0),)))
    values = dict(zip(found.setting.names, found.setting.values, strict=True))
    for name, value in truth.items():
        assert abs(values[name] - value) < 3.5 * found.errors[name], name
    assert found.errors["bias_um"] < 0.05
    assert found.errors["turn_rad"] < 0.002
    assert found.chi2 / found.freedom == pytest.approx(1, abs=0.1)


def test_more_of_the_lens_is_told_where_defocus_leaves_residuals():
    _, taken = seen(phased_picture(DIE, CAMERA, ((4, 0.05), (7, 0.04), (11, -0.03))))
    image = image_of(DIE, taken)
    short = fitted(image, taken, Setting(terms=((4, 0.0),)))
    full = with_terms(image, taken, short)
    assert short.chi2 / short.freedom > 1.5
    assert full.chi2 / full.freedom < 1.1
    values = dict(zip(full.setting.names, full.setting.values, strict=True))
    assert len(values) <= 5 + 4, "terms that the lens does not have"
    for name, value in {"z4": 0.05, "z7": 0.04, "z11": -0.03, "bias_um": 0.0}.items():
        assert abs(values[name] - value) < 4 * full.errors[name], name


@pytest.mark.parametrize("way", WAYS_ROUND)
def test_four_ways_round_are_told(way):
    picture = polygon_picture(DIE, CAMERA, {530.0: 1.0}, bias_um=0.0, turn_rad=0.0)
    _, taken = seen(stood(picture, way))
    found = identified({"ONE": DIE, "OTHER": OTHER}, CAMERA, LIGHT, taken)
    assert found.best == Hypothesis("ONE", way)
    assert found.certain


def test_a_turn_by_180_degrees_changes_a_picture_as_the_sign_of_defocus_does():
    right, turned_over = (DieImage.of(DIE, way, CAMERA, LIGHT, grid()) for way in (0, 2))
    for waves in (0.0, 0.07):
        (here,), (there,) = (
            image.pictures(Setting(terms=((4, sign * waves),))) for image, sign in ((right, 1), (turned_over, -1))
        )
        assert there == pytest.approx(here, abs=1e-9 * here.max())
    (same_side,) = turned_over.pictures(Setting(terms=((4, 0.07),)))
    assert np.linalg.norm(same_side - here) > 1e-3 * np.linalg.norm(here)


def test_of_light_that_is_no_die_of_the_job_nothing_is_told():
    """A wide light may explain a spot, through whatever die."""
    across = np.arange(33) - 16
    spot = np.exp(-(across**2 + across[:, None] ** 2) / 30.0)
    merging, _ = seen(spot / spot.sum(), (1.0,))
    found = measured(merging, {"ONE": DIE}, camera(diameter_um=400.0), LIGHT, priced=False)
    assert found.verdict.answer is Answer.CANNOT_TELL
    assert not any(each.name == "captured_cd_bias" for each in (*found.quantities, *found.if_numbers))


def test_a_second_lamp_enlarges_the_errors():
    picture = polygon_picture(DIE, CAMERA, {530.0: 1.0}, bias_um=0.0, turn_rad=0.0)
    _, taken = seen(picture + 0.05 * np.roll(picture, (9, 14), (0, 1)))
    start = replace(Setting(), terms=((4, 0.0),))
    found = with_terms(image_of(DIE, taken), taken, fitted(image_of(DIE, taken), taken, start))
    assert found.inflation > 2


def of_frames(picture_of, draws, times=STACK):
    """Values over errors, of noise and with the scatter between frames: [draws, values] each."""
    pairs = []
    for draw in range(draws):
        pictures = [picture_of(np.random.default_rng((draw, place))) for place in range(len(times))]
        merging = merged(exposed_each(pictures, times, 1e4, draw), electrons_per_count=GAIN, read_noise_e=READ_NOISE)
        taken = taken_of(merging, CAMERA.pixel_um, tuple((side - 1) / 2 for side in merging.shape))
        image = image_of(DIE, taken)
        found = fitted(image, taken, Setting(terms=((4, 0.0),)))
        both = found, with_frames(image, taken, found)
        pairs.append([found.setting.values / list(fit.errors.values()) for fit in both])
    return np.swapaxes(pairs, 0, 1)


def test_a_light_that_moves_between_exposures_enlarges_the_errors_to_hold_it():
    """Frames off by .05 pixels each: errors of the place grow to what the frames scatter, no others do by much."""
    per_wave = 2 / (CAMERA.stop.diameter_um / 2) * 0.53 * CAMERA.focal_um
    tilt = 0.05 * CAMERA.pixel_um / per_wave

    def moved(random):
        return phased_picture(DIE, CAMERA, ((2, random.normal(0, tilt)), (3, random.normal(0, tilt))))

    noise, whole = of_frames(moved, 4)
    place = [0, 1]
    assert np.median(abs(noise[:, place])) > 10
    assert (abs(whole[:, place]) < 3).all()
    assert (abs(whole[:, 2:]) < 3.5).all()


def test_exposures_of_one_light_leave_the_errors_of_the_noise():
    picture = phased_picture(DIE, CAMERA, ())
    noise, whole = of_frames(lambda _: picture, 8)
    grown = noise / whole
    assert (grown >= 1 - 1e-12).all()
    assert np.median(grown) == pytest.approx(1, abs=0.01)
    assert np.mean(grown > 1.1) < 0.25


def test_two_exposures_tell_no_scatter():
    noise, whole = of_frames(lambda _: phased_picture(DIE, CAMERA, ()), 1, (1.0, 4.0))
    assert (noise == whole).all()
