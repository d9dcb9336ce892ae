"""The model bar: every estimate against the effect itself, computed another way on a die of its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from klayout import db
from optics_cases import clear_region, noise, panel

from maskfab.base.model import Panel, Tiling
from maskfab.cli.program import run_command_line
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import UNSTATED, Glass, MaskBlank
from maskfab.mask.opening_file import load_opening
from maskfab.optics.field.matrix import parity_field
from maskfab.optics.field.polygons import boundary
from maskfab.optics.gap import gap_psf
from maskfab.optics.metrics import relative_difference
from maskfab.optics.psf import image_scale_um2, odd_samples, point_psf, point_step_um
from maskfab.optics.pupil import Aperture, cut, panel_aperture
from maskfab.optics.scene.model_bar import ASSUMED_BIAS_UM, bar_of_pupil, model_bar, scene_bar
from maskfab.optics.scene.scene import Scene
from maskfab.optics.stop import clear_field
from maskfab.optics.stop_edges import edges_in_stop
from maskfab.optics.tiling import orientations

TOLED = Path(__file__).parents[2] / "layouts" / "openings" / "toled.toml"
# As fast a lens as the one of the published numbers, with a tenth of its dots.
FAST = Camera(1000.0, Stop("circle", 400.0), (530.0,), 1.0, 24.0)
SLOW = Camera(10_000.0, Stop("circle", 400.0), (530.0,), 2.0, 200.0)


def laid(seed=3):
    return panel(noise(6, 0.4, seed), cells=12, seed=seed)


def bar(openings, camera, blank=UNSTATED):
    return {each.name: each.size for each in model_bar(cut(openings, camera.stop), camera, blank)}


def difference(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


def sums(aperture, camera, weights, u, v):
    """Fields of weighted dots at pairs of frequencies, dot by dot as points in the middle, [weight, ...]."""
    pupil = cut(aperture, camera.stop)
    x, y = ((e[1:] + e[:-1]) / 2 for e in (pupil.x.edges_um(), pupil.y.edges_um()))
    row, column = np.nonzero(pupil.mean_transmission)
    amplitude = pupil.mean_transmission[row, column]
    wave = np.exp(-2j * np.pi * (x[column] * u.ravel()[:, None] + y[row] * v.ravel()[:, None]))
    return [
        (wave @ (amplitude * np.broadcast_to(weight(x[column], y[row]), amplitude.shape))).reshape(u.shape)
        for weight in weights
    ]


def grid(camera):
    step = point_step_um(camera)
    half = odd_samples(camera.window_um, step) // 2
    return np.meshgrid(*2 * [2 * step * np.arange(-half // 2, half // 2 + 1)])


def intensity(aperture, camera, weights, u, v):
    return sum(abs(each) ** 2 for each in sums(aperture, camera, weights, u, v))


def test_the_published_sizes_come_out_of_the_published_display():
    """T-OLED behind 4 mm at f/2.5: leak, vector field, apodisation, glass, bias."""
    opening = load_opening(TOLED)
    die = Panel(opening, opening.dot_nm, 0, orientations(Tiling.RANDOM, 26, 26, 1, where=""), Tiling.RANDOM, 1)
    camera = Camera(10_000.0, Stop("circle", 4000.0), (530.0,), 2.0, 256.0)
    openings = panel_aperture(die, 2150.0)
    leaks = [bar(openings, camera, MaskBlank(density))["chrome leak"] for density in (3, 4)]
    assert leaks == pytest.approx([0.23, 0.07], rel=0.1)
    found = bar(openings, camera)
    assert found["vector field"] == pytest.approx(1e-2, rel=0.1)
    assert 1.4e-3 < found["lens apodisation"] < 4.4e-3
    assert found["glass"] == pytest.approx(1.7e-3, rel=0.2)
    assert found["cd bias"] == pytest.approx(7.2e-3, rel=0.3)
    assert 0.004 < found["ghosts"] / np.sqrt(2) < 0.024


def stated_leak(openings, phase):
    """What a scene says of a leak that it lacks."""
    (found,) = scene_bar(cut(openings, SLOW.stop), SLOW, 0.0, MaskBlank(3.0, phase))
    return found.size


@pytest.mark.parametrize("seed", [3, 8])
def test_the_leak_is_that_of_apertures_that_pass_it(seed):
    """A film in step or in counter-step makes real apertures, which need no formula of a leak."""
    openings = panel_aperture(laid(seed))
    expected = []
    for phase, amplitude in ((0.0, 10**-1.5), (0.5, -(10**-1.5))):
        leaking = Aperture(
            openings.x, openings.y, openings.transmission + amplitude * (1 - openings.transmission), openings.variance
        )
        psfs = [point_psf(cut(each, SLOW.stop), SLOW, 530.0).values for each in (leaking, openings)]
        expected.append(difference(*psfs))
        assert stated_leak(openings, phase) == pytest.approx(expected[-1], rel=0.1)
    worst = bar(openings, SLOW, MaskBlank(3.0))["chrome leak"]
    stated = [stated_leak(openings, phase) for phase in np.linspace(-1, 1, 17)]
    assert worst >= max(stated) > 0.99 * worst
    # Thin leaks weigh by their amplitude.
    assert bar(openings, SLOW, MaskBlank(8.0))["chrome leak"] == pytest.approx(
        10**-0.5 * bar(openings, SLOW, MaskBlank(7.0))["chrome leak"], rel=1e-3
    )


def test_the_vector_field_is_that_of_richards_and_wolf():
    openings = panel_aperture(laid())
    x, y = grid(FAST)
    u, v = x / image_scale_um2(FAST, 530.0), y / image_scale_um2(FAST, 530.0)

    def polarised(across):
        """Ex, Ey, Ez of light polarised along one axis, bent by the lens towards the focus."""

        def parts(px, py):
            q = np.hypot(px, py) / FAST.focal_um
            c, turn = np.sqrt(1 - q**2), np.arctan2(py, px) - across
            return c * np.cos(turn) ** 2 + np.sin(turn) ** 2, (c - 1) * np.sin(turn) * np.cos(turn), -q * np.cos(turn)

        return [lambda px, py, k=k: parts(px, py)[k] for k in range(3)]

    vector = sum(intensity(openings, FAST, polarised(across), u, v) for across in (0.0, np.pi / 2)) / 2
    scalar = intensity(openings, FAST, [lambda px, py: 1.0], u, v)
    assert bar(openings, FAST)["vector field"] == pytest.approx(difference(vector, scalar), rel=0.15)


@pytest.mark.parametrize("power", [0.5, -0.5])
def test_apodisation_is_that_of_a_weighted_aperture(power):
    openings = panel_aperture(laid())
    x, y = grid(FAST)
    u, v = x / image_scale_um2(FAST, 530.0), y / image_scale_um2(FAST, 530.0)

    def weight(px, py):
        return (1 - (px**2 + py**2) / FAST.focal_um**2) ** (power / 2)

    scalar = intensity(openings, FAST, [lambda px, py: 1.0], u, v)
    apodised = intensity(openings, FAST, [weight], u, v)
    zero = np.zeros((1, 1))
    # Energies: of binary dots the sum of squared weights is the field on the axis of their squares.
    light = [
        sums(openings, FAST, [each], zero, zero)[0].real.item()
        for each in (lambda px, py: weight(px, py) ** 2, lambda px, py: 1.0)
    ]
    expected = difference(apodised / light[0], scalar / light[1])
    assert bar(openings, FAST)["lens apodisation"] == pytest.approx(expected, rel=0.15)


def test_a_tangent_lens_is_sampled_where_it_images():
    openings, camera = panel_aperture(laid()), Camera(1000.0, Stop("circle", 400.0), (530.0,), 2.0, 64.0)
    x, y = grid(camera)
    squared = (x**2 + y**2) / camera.focal_um**2
    scale = image_scale_um2(camera, 530.0)

    def at(u, v):
        return intensity(openings, camera, [lambda px, py: 1.0], u, v) * (np.sinc(8 * u) * np.sinc(8 * v)) ** 2

    shrink = 1 / np.sqrt(1 + squared)
    straight, bent = at(x / scale, y / scale), at(x * shrink / scale, y * shrink / scale) * shrink**4
    assert bar(openings, camera)["tangent for sine"] == pytest.approx(difference(bent, straight), rel=0.2)


def test_walls_of_the_film_take_from_every_width_at_the_edge_of_the_field():
    pupil = cut(panel_aperture(laid()), SLOW.stop)
    bias = bar(panel_aperture(laid()), SLOW)["cd bias"]
    for slope in (0.2, 1.5):
        (walls,) = scene_bar(pupil, SLOW, slope, UNSTATED)
        assert (walls.name, walls.size) == ("film walls", pytest.approx(bias * 0.1 * slope / ASSUMED_BIAS_UM, rel=1e-6))
    assert scene_bar(pupil, SLOW, 0.0, UNSTATED) == ()


def test_glass_is_a_gap_and_nothing_on_the_side_of_the_lens():
    openings = panel_aperture(laid())
    glass = Glass(1500.0, 1.5, "away")
    expected = relative_difference(*(point(openings, gap) for gap in (1000.0, 0.0)))
    # The estimate knows nothing of what lies beyond the stop.
    assert 0.5 < bar(openings, SLOW, MaskBlank(glass=glass))["glass"] / expected < 2.2
    assert "glass" not in bar(openings, SLOW, MaskBlank(glass=Glass(1500.0, 1.5, "lens")))


def point(openings, gap):
    return gap_psf(openings, SLOW, 530.0, gap, samples_per_dot=3)


def test_fine_dots_are_gathered_for_the_glass_and_tell_the_same():
    """Dots of 400 nm and of 800 nm, of one panel: the window tells no dots of 2.4 um apart, which both are made of."""
    mask = noise(6, 0.4, 3)
    finer, fine = (panel(np.kron(mask, np.ones((k, k), bool)), dot_nm=8000 // k, cells=6, seed=3) for k in (20, 10))
    camera = Camera(10_000.0, Stop("circle", 250.0), (530.0,), 2.0, 200.0)
    sizes = [bar(panel_aperture(each), camera)["glass"] for each in (finer, fine)]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-2)


def test_a_bias_is_that_of_polygons_that_grew():
    there, camera = laid(), SLOW
    fields = []
    for grown in (0, round(ASSUMED_BIAS_UM * 500)):
        shapes = clear_region(there).sized(grown, grown, 2).merged()
        edges, area = edges_in_stop(shapes, camera.stop, (0.0, 0.0))
        step = point_step_um(camera) / image_scale_um2(camera, 530.0)
        fields.append(abs(boundary(edges, area, 0.03).field(step, 101)) ** 2 / area)
    expected = difference(fields[1], fields[0])
    near = Camera(camera.focal_um, camera.stop, (530.0,), 2.0, 101 * point_step_um(camera))
    assert bar(panel_aperture(there), near)["cd bias"] == pytest.approx(expected, rel=0.2)
    assert isinstance(shapes, db.Region)


def test_without_chrome_nothing_leaks_and_without_contrast_nothing_biases():
    clear = panel(np.ones((6, 6), bool), cells=12)
    found = bar(panel_aperture(clear), SLOW)
    assert found["chrome leak"] < 1e-9
    assert found.get("cd bias", 0.0) < 1e-12


@pytest.mark.parametrize(
    "stop",
    [Stop("circle", 210.0), Stop.ellipse(210.0, 150.0), Stop.annulus(210.0, 90.0), Stop.rectangle(200.0, 120.0),
     Stop.polygon([(90.0, -70.0), (60.0, 95.0), (-80.0, 40.0), (-30.0, -10.0)])],
    ids=lambda stop: stop.shape,
)  # fmt: skip
def test_the_clear_field_in_closed_form_is_the_transform_of_clear_dots(stop):
    u = 4.1e-4 * np.arange(30)
    clear = parity_field(cut(panel_aperture(panel(np.ones((6, 6), bool), cells=6)), stop), u, u).amplitude()
    whole = np.concatenate([-u[:0:-1], u])
    np.testing.assert_allclose(clear_field(stop, whole, whole[:, None]), clear, atol=1e-11 * stop.area_um2)


def test_next_to_the_axis_a_polygons_field_has_no_step():
    stop = Stop.polygon([(90.0, -70.0), (60.0, 95.0), (-80.0, 40.0)])
    u = np.geomspace(1e-9, 1e-4, 200)
    found = clear_field(stop, u, 0.3 * u)
    assert abs(np.diff(abs(found))).max() < 1e-4 * stop.area_um2
    assert abs(found[0]) == pytest.approx(stop.area_um2, rel=1e-12)


def test_a_scene_holds_the_glass_as_a_gap_and_says_that_it_lacks_the_leak():
    away, near = (MaskBlank(3.0, 0.2, Glass(1460.0, 1.46, side)) for side in ("away", "lens"))
    scene = Scene(gap_um=200.0)
    assert scene.through(away).gap_um == pytest.approx(1200.0)
    assert scene.through(near) == scene.through(UNSTATED) == scene
    pupil = cut(panel_aperture(laid()), SLOW.stop)
    (left_out,) = scene_bar(pupil, SLOW, 0.0, away)
    assert left_out.name == "chrome leak"
    assert left_out.size <= bar(panel_aperture(laid()), SLOW, MaskBlank(3.0))["chrome leak"]


def test_rows_say_what_was_assumed_and_come_by_size():
    pupil = cut(panel_aperture(laid()), SLOW.stop)
    rows = bar_of_pupil(pupil, SLOW, UNSTATED, "D")
    assert rows[0].name == "model_bar"
    assert rows[0].value == pytest.approx(sum(row.value for row in rows[1:]))
    sizes = [row.value for row in rows[1:]]
    assert sizes == sorted(sizes, reverse=True)
    assert {row.die for row in rows} == {"D"}
    told = {row.name: row.method for row in rows}
    assert "assumed" in told["model_chrome_leak"]
    stated = bar_of_pupil(pupil, SLOW, MaskBlank(4.0, None, Glass(1000.0, 1.5, "away")), None)
    told = {row.name: row.method for row in stated}
    assert "assumed" not in told["model_chrome_leak"] + told["model_glass"]
    assert "optical density 4" in told["model_chrome_leak"]


def test_analyse_prints_the_bar_as_text_and_json(capsys):
    camera = '{ stop = { diameter = "400 um" }, window = "32 um", wavelengths = ["530 nm"] }'
    command = ["analyse", str(TOLED), "--camera", camera, "--quiet"]
    plate = '{ optical_density = 5, glass = { thickness = "1 mm", index = 1.5, chrome = "lens" } }'
    assert run_command_line([*command, "--plate", plate, "--json"]) == 0
    found = {each["name"]: each for each in json.loads(capsys.readouterr().out)["quantities"]}
    assert "optical density 5 (stated)" in found["model_chrome_leak"]["method"]
    assert "model_glass" not in found
    assert run_command_line([*command]) == 0
    text = capsys.readouterr().out.split("not modelled, by size:")[1]
    assert "optical density 3 (assumed" in text
    assert "model_glass" in text


@pytest.mark.parametrize(
    ("plate", "code"),
    [
        ("{ film_phase = 0.2 }", "MF105"),
        ("{ optical_density = 0.0 }", "MF104"),
        ("{ optical_density = 4, film_phase = 1.5 }", "MF104"),
        ('{ glass = { thickness = "1 mm", index = 0.9, chrome = "lens" } }', "MF104"),
        ('{ glass = { thickness = "1 mm", index = 1.5, chrome = "under" } }', "MF105"),
        ("{ density = 4 }", "MF102"),
    ],
)
def test_a_plate_that_cannot_be_is_refused(plate, code, capsys):
    assert run_command_line(["analyse", str(TOLED), "--plate", plate, "--quiet"]) == 2
    assert code in capsys.readouterr().err
