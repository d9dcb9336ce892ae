"""The planner against what leaving things out really costs, and against every other choice it had."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optics.scene_cases import CASES, RGB, Case, case, planned, priced
from optics_cases import aberrated_psf, defocused_psf, focused_psf, noise, pupil, shifted_psf
from sweeps import examples, sweep

from maskfab.base import resources
from maskfab.base.errors import JobError
from maskfab.base.model import Panel, Psf, Tiling
from maskfab.job.camera import Camera, Stop
from maskfab.mask.opening_file import load_opening
from maskfab.optics.field.methods import PATHS
from maskfab.optics.gap import gap_psf
from maskfab.optics.metrics import relative_difference
from maskfab.optics.phase import defocus_waves
from maskfab.optics.psf import image_scale_um2, odd_samples, point_psf, point_step_um
from maskfab.optics.pupil import Pupil, panel_aperture
from maskfab.optics.scene import omissions
from maskfab.optics.scene.omissions import PLACES, grey
from maskfab.optics.scene.plan import PHASED, SPECTRUM, Choice, CostModel, Plan, cost_model, plan
from maskfab.optics.scene.point_images import spectrum_psf
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import band_lines
from maskfab.optics.tiling import orientations

LEFT_IN_PART = ("width of the bands", "field between places")


def single(source: Pupil, setting: Camera, line: float, path_name: str) -> Psf:
    """The point PSF by one path in single precision."""
    step, scale = point_step_um(setting), image_scale_um2(setting, line)
    frequency = step * np.arange(odd_samples(setting.window_um, step) // 2 + 1, dtype=np.float64) / scale
    (path,) = (path for path in PATHS if path.name == path_name)
    values = path.intensity(source, frequency, frequency, "single") / (scale**2 * source.energy_um2)
    return Psf(np.asarray(values, dtype=np.float64), step, line, "point")


def colour(source: Pupil, setting: Camera, spectrum) -> np.ndarray:
    """PSF of a band, line by line."""
    return sum(
        weight * point_psf(source, setting, float(line)).values
        for line, weight in zip(spectrum.wavelengths_nm, spectrum.weights, strict=True)
    )


def real_errors(each: Case, found: Plan) -> dict[str, tuple[float, float]]:
    """Estimate and real error, by ingredient, of all that a plan leaves out."""
    scene, choice = each.scene, found.choice
    source = pupil(each.panel, each.camera.stop)
    ends = priced(each).estimates.range_nm
    setting = replace(each.camera, wavelengths_nm=tuple(dict.fromkeys(ends)))
    rows = {row.name: row for row in found.ingredients}
    measured: dict[str, list[float]] = {}

    def compare(name: str, with_it: Psf, without: Psf) -> None:
        measured.setdefault(name, []).append(relative_difference(without, with_it))

    for line in setting.wavelengths_nm:
        plain = point_psf(source, setting, line)
        # Modelling the scale is free and so never left out; its estimate is held to the truth all the same.
        if not math.isinf(scene.focus_um):
            compare("scale of a near focus", focused_psf(source, setting, line, scene.focus_um), plain)
        if rows["defocus over the depth"].error and not choice.defocus:
            sharp = focused_psf(source, setting, line, scene.focus_um)
            for distance in (scene.nearest_um, scene.farthest_um):
                blurred = defocused_psf(source, setting, line, distance, scene.focus_um)
                compare("defocus over the depth", blurred, sharp)
        if scene.aberrations and not choice.aberrations:
            compare("lens aberrations", aberrated_psf(source, scene.wavefront(each.camera), setting, line), plain)
        if scene.gap_um and not choice.diffraction:
            still, spread = (
                gap_psf(panel_aperture(each.panel), setting, line, gap, samples_per_dot=8)
                for gap in (0.0, scene.gap_um)
            )
            compare("diffraction over the gap", spread, still)
        if scene.gap_um and scene.field_um:
            reach = scene.field_um if choice.places == 1 else scene.field_um * math.sqrt(2) / (choice.places - 1)
            name = "shift through the gap" if choice.places == 1 else "field between places"
            if choice.places < PLACES[-1]:
                for angle in (0.0, 0.25, 0.5, 0.7):
                    place = (reach * math.cos(angle * math.pi), reach * math.sin(angle * math.pi))
                    compare(name, shifted_psf(panel_aperture(each.panel), setting, line, scene.gap_um, place), plain)
        if choice.grey_rim:
            compare("curve of the rim", plain, point_psf(grey(source), setting, line))
        if choice.precision == "single":
            measured.setdefault("single precision", []).append(
                relative_difference(single(source, setting, line, choice.path), plain)
            )
    for band in scene.bands:
        fine, coarse = (colour(source, setting, band_lines(band, n)) for n in (32, choice.lines))
        error = float(np.linalg.norm(fine - coarse) / np.linalg.norm(fine))
        measured.setdefault("width of the bands", []).append(error)
    estimates = {name: row.remaining if row.name in LEFT_IN_PART else row.error for name, row in rows.items()} | {
        "single precision": 1e-6
    }
    return {name: (estimates[name], max(errors)) for name, errors in measured.items()}


@pytest.mark.parametrize("each", CASES, ids=lambda each: each.name)
def test_what_is_left_out_errs_no_more_than_the_plan_says(each: Case) -> None:
    found = planned(each)
    errors = real_errors(each, found)
    for name, (estimated, real) in errors.items():
        ratio = estimated / real if real else math.inf
        print(f"{each.name:28} {name:26} estimate {estimated:9.2e}  real {real:9.2e}  ratio {ratio:8.2f}")
    assert {name for name, (estimated, real) in errors.items() if real > estimated} == set()
    left_out = math.fsum(row.remaining for row in found.ingredients)
    assert left_out <= found.price.error <= each.accuracy


def test_the_cases_cover_every_omission() -> None:
    """Each ingredient is left out in some case and modelled in another, where there is any."""
    asked = [(row.name, row.modelled) for each in CASES for row in planned(each).ingredients if row.error]
    names = {name for name, _ in asked} - {"the layout itself", "field between places"}
    assert {name for name, modelled in asked if not modelled} >= names - {"scale of a near focus"}
    assert {name for name, modelled in asked if modelled} >= names
    precisions = {planned(each).choice.precision for each in CASES}
    assert precisions == {"single", "double"}


@pytest.mark.parametrize("each", CASES, ids=lambda each: each.name)
def test_no_cheaper_choice_was_passed_over(each: Case) -> None:
    """All paths x precisions x omissions, counted here anew, the error summed from the estimates themselves."""
    found, known = planned(each), priced(each)
    e = known.estimates
    tried = 0
    for values in itertools.product(
        (*(path.name for path in PATHS), PHASED, SPECTRUM),
        ("double", "single"),
        *[(False, True)] * 5,
        e.places,
        e.bands,
        (0, 4, 8, 16, 32),
        (False, True),
    ):
        choice = Choice(*values)
        if not known.possible(choice):
            continue
        tried += 1
        error = known.own_error(choice) + e.places[choice.places] + e.bands[choice.lines]
        parts = ((choice.grey_rim, e.rim), (not choice.scale, e.scale), (not choice.defocus, e.defocus))
        parts += ((not choice.aberrations, e.aberrations), (not choice.diffraction, e.diffraction))
        parts += ((not choice.oblique, e.oblique),)
        error += sum(part.error for out, part in parts if out) + (e.shift.error if choice.places == 1 else 0.0)
        if error <= each.accuracy * (1 - 1e-12):
            assert known.price(choice).seconds >= found.price.seconds
    assert tried >= 4


@pytest.mark.parametrize("name", ["plain random", "plain periodic", "colours"])
def test_a_scene_that_asks_nothing_of_the_layout_takes_no_mean_over_layouts(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (each,) = (each for each in CASES if each.name == name)
    expected = planned(each)
    for mean in ("mean_psf", "layout_psf"):
        monkeypatch.delattr(omissions, mean)
    found = plan(each.panel, each.camera, each.scene, each.accuracy)
    assert (found.choice, found.price) == (expected.choice, expected.price)


def test_one_psf_is_priced_once_for_all_places_and_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every choice all the same gets the price that it has alone."""
    (each,) = (each for each in CASES if each.name == "gap and field, tight")
    known = priced(each)
    alone = {choice: known.price(choice) for choice in known.choices()}
    counted = []
    one = CostModel._one
    monkeypatch.setattr(CostModel, "_one", lambda self, choice: counted.append(choice) or one(self, choice))
    assert dict(known.priced()) == alone
    assert len(known.estimates.places) > 3
    assert 2 * len(counted) < len(alone)


def _ordinary() -> list[tuple[str, Tiling, tuple[float, float, float], float]]:
    """Openings of the paper behind telephones' and laboratory cameras, the least work first."""
    cameras = [(5000.0, 600.0, 128.0), (4160.0, 800.0, 96.0), (5000.0, 1000.0, 128.0), (10_000.0, 2000.0, 128.0)]
    return [
        (opening, tiling, camera, accuracy)
        for camera in cameras
        for opening in ("paper_inv_random", "toled")
        for tiling in (Tiling.PERIODIC, Tiling.RANDOM)
        for accuracy in (1e-2, 1e-3)
    ]


@pytest.mark.parametrize(("opening", "tiling", "lens", "accuracy"), sweep(_ordinary(), 4))
def test_an_ordinary_colour_scene_has_a_plan_that_errs_no_more_than_it_says(
    opening: str, tiling: Tiling, lens: tuple[float, float, float], accuracy: float
) -> None:
    """Against the rim exact, double precision, and four times the lines or more."""
    focal_um, diameter_um, window_um = lens
    setting = Camera(focal_um, Stop("circle", diameter_um), (610.0, 530.0, 470.0), 2.0, window_um)
    unit = load_opening(resources.path("layouts") / "openings" / f"{opening}.toml")
    cells = math.ceil(1.1 * diameter_um / 168) + 2
    chosen = orientations(tiling, cells, cells, 1)
    laid_out = Panel(unit, 8000, 0, chosen, tiling, 1 if tiling.seeded else None)
    scene, openings = Scene(bands=RGB), panel_aperture(laid_out)
    found = plan(laid_out, setting, scene, accuracy)
    assert found.price.error <= accuracy
    finest = replace(found.choice, path="parity", precision="double", grey_rim=False, lines=4 * found.choice.lines)
    best = replace(found, choice=finest)
    for band in scene.bands:
        seen, true = (spectrum_psf(openings, setting, scene, each, band) for each in (found, best))
        assert relative_difference(seen, true) <= found.price.error


_WAVES = st.tuples(st.sampled_from((4, 5, 6, 8, 11)), st.floats(0.001, 0.1)).map(lambda term: (term,))
EFFECTS = {
    "nearest_um": st.floats(5.3, 8).map(lambda power: 10.0**power),
    "aberrations": _WAVES,
    "gap_um": st.floats(0, 2.2).map(lambda power: 10.0**power),
}


@st.composite
def drawn(draw: st.DrawFn, effects: int) -> Case:
    """A small stop and scene with so many effects, any openings, tiling and dots."""
    asked = draw(st.permutations(sorted(EFFECTS)))[:effects]
    scene = Scene(**{name: draw(EFFECTS[name]) for name in asked})  # type: ignore[arg-type]
    mask = noise(7, draw(st.sampled_from((0.2, 0.4, 0.6))), draw(st.integers(0, 50)))
    return case(
        "drawn", mask, scene, 0.5, diameter_um=draw(st.sampled_from((160.0, 200.0, 300.0))),
        shape=draw(st.sampled_from(("circle", "square"))), seed=draw(st.sampled_from((None, 1))),
        gutter_nm=draw(st.sampled_from((0, 4000))),
    )  # fmt: skip


@given(st.integers(0, 3).flatmap(drawn), st.booleans(), st.sampled_from((0.0, 1000.0)))
@examples(40)
def test_a_looser_accuracy_is_not_refused_where_a_tighter_one_is_met_and_costs_no_more(
    each: Case, colours: bool, field_um: float
) -> None:
    scene, spent = replace(each.scene, bands=RGB if colours else (), field_um=field_um), math.inf
    for accuracy in (1e-6, 1e-3, 1e-2, 0.2):
        try:
            seconds = plan(each.panel, each.camera, scene, accuracy).price.seconds
        except JobError:
            # Nothing that maskfab can compute is so exact.
            assert spent == math.inf
        else:
            # A phase of fewer degrees leaves a small stop's rim more, and is priced up to a thousandth higher.
            assert seconds <= 1.01 * spent
            spent = seconds


@given(drawn(2))
@examples(100)
def test_two_effects_left_out_err_by_no_more_than_their_sum_nor_does_either_alone(each: Case) -> None:
    """As far as an accuracy may go: an error above 1 is one that no plan leaves out."""
    found = cost_model(each.panel, each.camera, each.scene, each.accuracy).estimates
    bar = found.defocus.error + found.aberrations.error + found.diffraction.error
    line, none = each.camera.wavelengths_nm[0], Scene()

    def seen(scene: Scene) -> Psf:
        lens = scene.wavefront(each.camera).waves(each.camera.stop, line)
        blur = defocus_waves(each.camera, line, scene.nearest_um, math.inf)
        return gap_psf(
            panel_aperture(each.panel), each.camera, line, scene.gap_um, samples_per_dot=4,
            waves=lambda x, y: lens(x, y) + blur(x, y),
        )  # fmt: skip

    plain = seen(none)
    alone = [
        replace(none, **{name: getattr(each.scene, name)})
        for name in EFFECTS if getattr(each.scene, name) != getattr(none, name)
    ]  # fmt: skip
    assert len(alone) == 2
    assert bar >= min(1.0, max(relative_difference(plain, seen(scene)) for scene in (*alone, each.scene)))


def test_lines_of_a_band_share_the_work_that_single_precision_does_not_speed_up() -> None:
    """The price of a pupil is paid for each band, that of a field for each line."""
    (each,) = (each for each in CASES if each.name == "colours")
    known = priced(each)
    few, more, most = (
        known.price(Choice("parity", "single", *[False] * 5, places=1, lines=lines, samples_per_dot=0)).seconds
        for lines in sorted(known.estimates.bands)[:3]
    )
    lines = sorted(known.estimates.bands)[:3]
    line = (more - few) / (lines[1] - lines[0])
    assert most - more == pytest.approx(line * (lines[2] - lines[1]))
    assert few > 2 * line * lines[0]


def test_a_plan_states_what_the_probe_found() -> None:
    """Far below the share of the accuracy that its tolerance is, and the constant of the path."""
    for each in (each for each in CASES if each.name in ("near objects", "strong mixture", "field without gap")):
        found = planned(each)
        own = found.price.error - math.fsum(row.remaining for row in found.ingredients)
        assert (found.choice.path == PHASED) != (found.choice.precision == "single")
        assert 0 < own < priced(each).own_error(found.choice) / 10
