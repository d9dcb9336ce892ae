"""Plans carried out: every choice against its parts called by hand, and every plan against the fullest model."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optics.scene_cases import CASES, DENSE, RGB, RING, SLIT, SPARSE, Case, case, planned, priced

from maskfab.base.errors import InternalError, JobError
from maskfab.base.model import Psf
from maskfab.optics.field.matrix import direct_field
from maskfab.optics.gap import AXIS, Place, gap_psf, magnified, moved_aperture
from maskfab.optics.metrics import relative_difference
from maskfab.optics.phase import defocus_waves, image_distance_um, phased, phased_psf
from maskfab.optics.psf import odd_samples, point_psf, within
from maskfab.optics.pupil import Aperture, cut, panel_aperture
from maskfab.optics.scene.lens import RESAMPLED
from maskfab.optics.scene.omissions import PLACES, grey
from maskfab.optics.scene.plan import PHASED, SPECTRUM, Choice, Plan, sampling_camera
from maskfab.optics.scene.point_images import full_plan, nearest_place, scene_psf, spectrum_psf
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import band_lines

DEEP = Scene(nearest_um=5e6, farthest_um=1e8, focus_um=2e7)
LENS = ((7, 0.03), (11, 0.02))
RICH = replace(DEEP, aberrations=LENS, gap_um=30.0, field_um=600.0)
SMALL = {"diameter_um": 160.0, "shape": "circle"}
EVERYTHING = case("everything", DENSE, RICH, 0.9, **SMALL)
IMAGE, OBJECT = (200.0, 350.0), 6e6
# By hand: of -600, 0 and 600 the nearest to 200 is 0, to 350 it is 600.
BORROWED = {1: AXIS, 3: (0.0, 600.0), PLACES[-1]: IMAGE}

COMBINED = (
    case("deep and aberrated", DENSE, replace(DEEP, aberrations=((11, 0.003),)), 0.1),
    # Of two even phases the one that is left out counts to first order.
    case("defocus on a lens's defocus", DENSE, replace(DEEP, aberrations=((4, 0.05), (7, 0.06))), 3e-3, seed=None),
    case("defocus on a lens's, square", DENSE, Scene(1e6, 1e7, aberrations=((4, 0.045),)), 0.2, shape="square"),
    case("a lens's defocus on defocus", SLIT, Scene(4e5, 4e5, aberrations=((4, 0.002),)), 0.1, seed=None),
    case("deep, focus near", SLIT, Scene(nearest_um=3e5, farthest_um=1e7, focus_um=5e5), 0.3, seed=None),
    case("deep, square", RING, replace(DEEP, aberrations=((5, 0.001),)), 0.5, shape="square", diameter_um=240.0),
    case("aberrated behind a gap", SPARSE, Scene(gap_um=20.0, aberrations=LENS), 5e-2),
    case("weakly aberrated behind a gap", DENSE, Scene(gap_um=20.0, aberrations=((8, 0.002),)), 0.3),
    case("aberrated behind a gap, square", DENSE, Scene(gap_um=20.0, aberrations=LENS), 5e-2, shape="square"),
    case("deep behind a gap", RING, replace(DEEP, gap_um=50.0), 2e-2, gutter_nm=4000),
    case("all, loosely", DENSE, replace(RICH, aberrations=((4, 0.002),)), 0.6, diameter_um=160.0),
    case("all, gap by shift", SPARSE, RICH, 0.12, seed=None, gutter_nm=4000, diameter_um=160.0),
    case("all, two lines", SLIT, RICH, 0.2, lines=(610.0, 470.0), diameter_um=160.0),
    case("all, few places", SPARSE, replace(RICH, gap_um=100.0), 5e-2, diameter_um=120.0),
    case("colours, deep", SPARSE, replace(DEEP, bands=RGB), 2e-2, diameter_um=200.0),
    case("colours behind a gap", DENSE, Scene(gap_um=5.0, bands=RGB[1:2]), 0.2, diameter_um=120.0),
)


def openings(each: Case) -> Aperture:
    return panel_aperture(each.panel)


def phases(each: Case, choice: Choice, line: float, object_um: float | None):
    """The sum of a choice's phases; zero if it has none."""
    lens = each.scene.wavefront(each.camera).waves(each.camera.stop, line)
    distance = each.scene.focus_um if object_um is None else object_um
    blur = defocus_waves(each.camera, line, distance, each.scene.focus_um)
    return lambda x, y: choice.aberrations * lens(x, y) + choice.defocus * blur(x, y)


def by_hand(each: Case, choice: Choice, line: float, place: Place, object_um: float | None) -> Psf:
    """A choice at an image point's own place, put together from sums over dots."""
    scene, setting = each.scene, sampling_camera(each.camera, each.scene)
    distance = image_distance_um(setting.focal_um, scene.focus_um if choice.scale else math.inf)
    waves = phases(each, choice, line, object_um)
    away = object_um if choice.defocus else scene.focus_um if choice.scale else math.inf
    clear, gap_um = magnified(openings(each), scene.gap_um, away)
    if choice.diffraction:
        samples = choice.samples_per_dot
        return gap_psf(
            clear, setting, line, gap_um, place, samples, waves=waves, distance_um=distance
        )  # fmt: skip
    moved = (gap_um * place[0] / distance, gap_um * place[1] / distance)
    source = cut(moved_aperture(clear, moved, setting.stop.diameter_um / 2), setting.stop)
    if choice.grey_rim:
        source = grey(source)
    scale, step = line * 1e-3 * distance, planned(each).step_um
    reach = odd_samples(setting.window_um, step) // 2
    if choice.defocus or choice.aberrations:
        return phased_psf(phased(source, waves, 64 / scale, 1e-9), setting, line, distance_um=distance)
    frequency = step * np.arange(-reach, reach + 1) / scale
    intensity = abs(direct_field(source, frequency, frequency)) ** 2
    return Psf(intensity / (scale**2 * source.energy_um2), step, line, "point")


def carried_out(each: Case, choice: Choice) -> Plan:
    return replace(planned(each), choice=choice, phase_tolerance=1e-9)


def possible(each: Case) -> list[Choice]:
    """Every choice of a case, at the coarsest samples, with places whose nearest one is known."""
    found = (choice for choice in priced(each).choices() if choice.samples_per_dot in (0, 4))
    return [choice for choice in found if choice.places in BORROWED]


def test_every_choice_is_what_its_parts_make_by_hand() -> None:
    chosen = [c for c in possible(EVERYTHING) if (c.scale or not c.diffraction) and not c.oblique]
    asked = {(c.path, c.grey_rim, c.scale, c.defocus, c.aberrations, c.diffraction) for c in chosen}
    assert {path for path, *_ in asked} >= {"parity", "direct", "structure", PHASED, SPECTRUM}
    assert (SPECTRUM, False, True, True, True, True) in asked
    assert (PHASED, False, True, True, True, False) in asked
    known: dict[object, Psf] = {}
    for choice in chosen:
        place = BORROWED[choice.places]
        # Field paths and precisions differ by their rounding alone, so one sum by hand serves all of them.
        same = replace(
            choice, precision="double", path="direct" if choice.path in ("parity", "structure") else choice.path
        )
        if same not in known:
            known[same] = by_hand(EVERYTHING, same, 530.0, place, OBJECT)
        found = scene_psf(
            openings(EVERYTHING), EVERYTHING.camera, RICH, carried_out(EVERYTHING, choice), 530.0,
            image_um=IMAGE, object_um=OBJECT,
        )  # fmt: skip
        assert found.step_um == planned(EVERYTHING).step_um
        assert found.values.shape == 2 * (planned(EVERYTHING).samples,)
        assert relative_difference(found, known[same]) < (1e-6 if choice.precision == "single" else 1e-7), choice


def looks(scene: Scene) -> Iterator[tuple[Place, float | None]]:
    """Image points and distances at which a scene is looked at: each of both at least once."""
    reach = scene.field_um if scene.gap_um else 0.0
    places = ((reach, 0.0), (0.7 * reach, 0.7 * reach), (0.3 * reach, -0.6 * reach)) if reach else (AXIS,)
    distances = (None, *sorted({scene.nearest_um, scene.farthest_um} - {scene.focus_um}))
    for k in range(max(len(places), len(distances))):
        yield places[k % len(places)], distances[k % len(distances)]


def joint_error(each: Case) -> float:
    """Largest difference between a plan carried out and the fullest model."""
    plan, clear = planned(each), openings(each)
    full, errors = full_plan(plan), []
    if full.choice.diffraction:
        # Twice the plan's samples, or 8, tell as much as the finest ones and take a fraction of their time.
        full = replace(full, choice=replace(full.choice, samples_per_dot=max(8, 2 * plan.choice.samples_per_dot)))
    for place, distance in looks(each.scene):
        for light in each.scene.bands or each.camera.wavelengths_nm:
            rough, exact = (
                spectrum_psf(clear, each.camera, each.scene, which, light, image_um=place, object_um=distance)
                for which in (plan, full)
            )
            errors.append(relative_difference(rough, exact))
    return max(errors)


@pytest.mark.slow
def test_plans_err_no_more_than_they_say_when_all_that_they_leave_out_comes_together() -> None:
    ratios = {}
    for each in (*CASES, *COMBINED):
        real, stated = joint_error(each), planned(each).price.error
        ratios[each.name] = stated / real if real else math.inf
        print(f"{each.name:32} stated {stated:8.1e}  real {real:8.1e}  ratio {ratios[each.name]:7.2f}")
        assert stated <= each.accuracy
    assert {name for name, ratio in ratios.items() if ratio < 1} == set()
    assert float(np.median(list(ratios.values()))) < 10


def test_the_fullest_plan_models_all_that_the_scene_has() -> None:
    choice = full_plan(planned(EVERYTHING)).choice
    assert choice.path == SPECTRUM
    assert (choice.scale, choice.defocus, choice.aberrations, choice.diffraction) == 4 * (True,)
    assert (choice.places, choice.grey_rim) == (PLACES[-1], False)
    plain = full_plan(planned(CASES[0])).choice
    assert (plain.precision, plain.grey_rim, plain.places) == ("double", False, 1)


def test_the_fullest_plan_has_samples_that_tell_the_error_of_the_plans_own() -> None:
    for each in (*CASES[::2], *COMBINED):
        plan = planned(each)
        # Lines of a band come on top of what its paths err.
        assert 0 < plan.fullest_error <= each.accuracy / 2
        assert priced(each).own_error(plan.fullest) + RESAMPLED <= each.accuracy / 2
        if plan.choice.diffraction:
            assert plan.fullest.samples_per_dot >= 2 * plan.choice.samples_per_dot


def test_a_band_is_the_sum_of_its_lines_on_one_grid() -> None:
    each = next(each for each in COMBINED if each.name == "colours, deep")
    plan, clear, red = planned(each), openings(each), RGB[0]
    found = spectrum_psf(clear, each.camera, each.scene, plan, red, object_um=5e6, margin=3)
    spectrum = band_lines(red, plan.choice.lines)
    expected = sum(
        weight * scene_psf(clear, each.camera, each.scene, plan, float(line), object_um=5e6, margin=3).values
        for line, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True)
    )
    np.testing.assert_allclose(found.values, expected, rtol=1e-12)
    assert spectrum.wavelengths_nm.size == plan.choice.lines > 1
    assert found.wavelength_nm == pytest.approx(red.quadrature(256).centroid_nm, rel=1e-4)
    assert within(found, sampling_camera(each.camera, each.scene)).values.shape == 2 * (plan.samples,)


@pytest.mark.parametrize("path", ["parity", PHASED, SPECTRUM])
def test_turning_openings_and_image_point_turns_the_psf(path: str) -> None:
    even = replace(EVERYTHING, name="even", scene=replace(RICH, aberrations=((11, 0.05),)))
    choice = next(
        c for c in possible(even)
        if c.path == path and c.places == PLACES[-1] and c.precision == "double" and not c.grey_rim
        and c.aberrations == c.defocus == (path != "parity") and c.scale
    )  # fmt: skip
    straight = openings(even)
    # Rows go upwards, so this is a quarter turn counter-clockwise.
    turned = Aperture(
        straight.y, straight.x, np.rot90(straight.transmission, -1).copy(), np.rot90(straight.variance, -1).copy()
    )
    here, there = (
        scene_psf(
            each, even.camera, even.scene, carried_out(even, choice), 530.0, image_um=place, object_um=OBJECT
        ).values
        for each, place in ((straight, (200.0, 350.0)), (turned, (-350.0, 200.0)))
    )  # fmt: skip
    np.testing.assert_allclose(there, np.rot90(here, -1), atol=1e-8 * here.max())
    assert np.linalg.norm(here - there) > 0.03 * np.linalg.norm(here)


def test_a_scene_that_asks_for_nothing_gives_the_plain_psf() -> None:
    each = next(each for each in CASES if each.name == "tighter than single")
    plain = point_psf(cut(openings(each), each.camera.stop), each.camera, 530.0)
    found = scene_psf(openings(each), each.camera, each.scene, planned(each), 530.0)
    assert relative_difference(found, plain) < 1e-12


def test_openings_that_the_path_refuses_take_another_one() -> None:
    """Light between the cells, which the design does not have, belongs to none of them."""
    each = case("gutter clear", DENSE, Scene(), 0.5, gutter_nm=4000, **SMALL)
    clear = openings(each)
    lit = Aperture(clear.x, clear.y, np.where(clear.transmission > 0, 1.0, 0.25), clear.variance)
    structured, direct = (
        scene_psf(
            lit, each.camera, each.scene,
            carried_out(each, replace(planned(each).choice, path=path, precision="double", grey_rim=False)), 530.0,
        )
        for path in ("structure", "direct")
    )  # fmt: skip
    assert relative_difference(structured, direct) < 1e-11


@given(st.sampled_from(PLACES), st.floats(-1, 1), st.floats(-1, 1))
def test_the_place_that_lends_its_psf_is_the_nearest(places: int, x: float, y: float) -> None:
    scene = Scene(gap_um=1.0, field_um=500.0)
    choice = replace(planned(EVERYTHING).choice, places=places)
    image = (500 * x, 500 * y)
    found = nearest_place(choice, scene, image)
    if places == PLACES[-1]:
        assert found == image
        return
    nodes = np.linspace(-500, 500, places) if places > 1 else np.zeros(1)
    for at, wanted in zip(found, image, strict=True):
        assert abs(nodes - at).min() < 1e-9
        assert abs(at - wanted) <= abs(nodes - wanted).min() + 1e-9


def test_what_the_plan_was_not_made_for_is_refused() -> None:
    clear, setting, plan = openings(EVERYTHING), EVERYTHING.camera, planned(EVERYTHING)
    for key, value in (("image_um", (500.0, 400.0)), ("image_um", (math.nan, 0.0)), ("object_um", 1e6)):
        with pytest.raises(JobError, match="MF104"):
            scene_psf(clear, setting, RICH, plan, 530.0, **{key: value})
    with pytest.raises(JobError, match="MF104"):
        scene_psf(clear, setting, RICH, plan, 400.0)
    with pytest.raises(JobError, match="MF104"):
        spectrum_psf(clear, setting, RICH, plan, RGB[0])
    with pytest.raises(InternalError, match="MF901"):
        scene_psf(clear, replace(setting, pixel_um=1.5), RICH, plan, 530.0)
    small = panel_aperture(EVERYTHING.panel, 20.0)
    with pytest.raises(JobError, match="MF114"):
        scene_psf(small, setting, RICH, full_plan(plan), 530.0, image_um=(600.0, 0.0))
