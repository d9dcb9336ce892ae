"""A film that light leaks through: in step with the openings, against them, and in between."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from optics_cases import clear_region, noise, panel
from sweeps import in_turns, sweep

from maskfab.base.model import Die
from maskfab.cli.program import run_command_line
from maskfab.findings.optics import lit_pupils, measure
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.optics.film_lags import lit_lags
from maskfab.optics.lags import lag_table
from maskfab.optics.psf import Leak, ReadyPupil, point_psf
from maskfab.optics.pupil import Aperture, Lattice, cut, panel_aperture
from maskfab.optics.scene.model_bar import model_bar

TOLED = Path(__file__).parents[2] / "layouts" / "openings" / "toled.toml"
CAMERA = Camera(10_000.0, Stop("circle", 270.0), (530.0,), 4.0, 120.0)
STOPS = (
    CAMERA.stop,
    Stop.rectangle(250.0, 190.0),
    Stop.annulus(270.0, 90.0),
    Stop.polygon([(130.0, 0.0), (-90.0, 120.0), (-70.0, -130.0)]),
)
each_stop = pytest.mark.parametrize("stop", STOPS, ids=lambda stop: stop.shape)
# Thin films, so that a mistake in any term shows.
IN_STEP, AGAINST, BETWEEN = MaskBlank(1.0, 0.0), MaskBlank(1.2, 0.5), MaskBlank(1.1, 0.3)


def openings(seed=4, gutter_nm=0):
    return panel_aperture(panel(noise(6, 0.4, seed), gutter_nm=gutter_nm, cells=6, seed=seed))


def leaking(aperture, amplitude):
    """What really passes, as an aperture; only for real amplitudes."""
    return Aperture(
        aperture.x, aperture.y, aperture.transmission + amplitude * (1 - aperture.transmission), aperture.variance
    )


def direct(aperture, camera, amplitude, u):
    """Intensity along v = 0.7 u from a sum over dots, and the energy; dots at the rim as points of their share."""
    clear, film = (
        cut(replace(aperture, transmission=values), camera.stop).mean_transmission
        for values in (aperture.transmission, 1 - aperture.transmission)
    )
    x, y = ((e[1:] + e[:-1]) / 2 for e in (aperture.x.edges_um(), aperture.y.edges_um()))
    dot = aperture.x.dot_um
    waves = np.exp(-2j * np.pi * u[:, None] * x), np.exp(-2j * np.pi * 0.7 * u[:, None] * y)
    field = np.einsum("kj,ji,ki->k", waves[1], clear + amplitude * film, waves[0])
    return abs(field * dot**2 * np.sinc(u * dot) * np.sinc(0.7 * u * dot)) ** 2


@each_stop
@pytest.mark.parametrize("blank", [IN_STEP, AGAINST])
def test_a_real_leak_is_that_of_an_aperture_that_passes_it(stop, blank):
    camera = replace(CAMERA, stop=stop)
    leak = Leak.of(blank, stop)
    plain = openings()
    (found,) = ReadyPupil.of(cut(plain, stop), camera).psfs(leak)
    expected = point_psf(cut(leaking(plain, leak.amplitude.real), stop), camera, 530.0)
    np.testing.assert_allclose(found.values, expected.values, atol=1e-10 * expected.values.max())
    table = lit_pupils(cut(plain, stop), leak, camera).table
    alone = lag_table(cut(leaking(plain, leak.amplitude.real), stop), table.reach_um)
    lags = np.linspace(0, 60, 31)
    off = abs(table.otf(lags, 0.3 * lags) - alone.otf(lags, 0.3 * lags))
    assert off.max() <= table.uncertainty
    # As many squares as a stop has know the film's light far better than a bound without signs.
    # Squares know the film's light far better than a bound without signs; a polygon's rim they do not.
    assert stop.outline_um or off.max() < 3e-4


def test_a_leak_of_any_phase_is_the_sum_over_dots():
    leak = Leak.of(BETWEEN, CAMERA.stop)
    (found,) = ReadyPupil.of(cut(openings(), CAMERA.stop), CAMERA).psfs(leak)
    clear = point_psf(cut(openings(), CAMERA.stop), CAMERA, 530.0)
    middle = found.values.shape[0] // 2
    scale = 5.3e-1 * CAMERA.focal_um
    k = np.arange(0, middle + 1, 10)
    u = k * found.step_um / scale
    # Only on lines that the grid has: v = 0.7 u falls on every tenth sample.
    rows, columns = middle + (0.7 * k).round().astype(int), middle + k
    passed = leak.energy_um2(cut(openings(), CAMERA.stop).energy_um2)
    expected = direct(openings(), CAMERA, leak.amplitude, u) / (scale**2 * passed)
    # Grey points for what the stop leaves of dots: exact on the axis.
    assert found.values[middle, middle] == pytest.approx(expected[0], rel=1e-12)
    assert abs(found.values[rows, columns] - expected).max() < 0.02 * expected.max()
    # A real aperture's PSF is its own mirror image; one of a lagging film is not.
    assert abs(clear.values - clear.values[::-1, ::-1]).max() < 1e-12 * clear.values.max()
    assert abs(found.values - found.values[::-1, ::-1]).max() > 0.02 * found.values.max()


def test_opposite_phases_mirror_the_picture():
    one, other = (
        ReadyPupil.of(cut(openings(), CAMERA.stop), CAMERA).psfs(Leak.of(MaskBlank(1.0, phase), CAMERA.stop))[0].values
        for phase in (0.3, -0.3)
    )
    np.testing.assert_allclose(one, other[::-1, ::-1], atol=1e-12 * one.max())


@pytest.mark.parametrize(
    ("stop", "blank", "gutter_nm"),
    sweep(
        [
            (stop, *laid)
            for stop, laid in in_turns(STOPS, product((IN_STEP, AGAINST, BETWEEN, MaskBlank(3.0, 0.4)), (0, 4000)))
        ],
        8,
    ),
)
def test_both_paths_and_the_invariants_hold_with_a_leak(stop, blank, gutter_nm):
    there = panel(noise(6, 0.4, 4), gutter_nm=gutter_nm, cells=6, seed=4)
    die = Die("D", "D", there, (0, 0), there.pitch_nm * 6)
    found = {
        each.name: each for each in measure(die, replace(CAMERA, stop=stop), clear_region(there), blank).quantities
    }
    assert found["readback_psf_difference"].value < 1e-6
    assert found["strehl_invariant_error"].value < 1e-6
    volume = found["mtf_volume_invariant_error"]
    # The rim of so small a stop is grey to the lags, and film at the rim is most of it.
    assert volume.value < max(volume.limit, 0.1 * volume.uncertainty)
    assert volume.passed or blank.optical_density < 3
    plain = {each.name: each for each in measure(die, replace(CAMERA, stop=stop), clear_region(there)).quantities}
    eta = plain["stop_open_ratio"].value
    amplitude = Leak.of(blank, stop).amplitude
    assert found["stop_open_ratio"].value == eta
    assert plain["peak_strehl"].value == pytest.approx(eta**2, rel=1e-6)
    assert found["peak_strehl"].value == pytest.approx(abs(eta + amplitude * (1 - eta)) ** 2, rel=1e-6)


def test_the_volume_under_the_mtf_is_mean_amplitude_squared_over_mean_intensity():
    """A square stop cuts along dots, so the tables are exact."""
    stop = Stop("square", 240.0)
    aperture = openings()
    pupil = cut(aperture, stop)
    eta = pupil.energy_um2 / stop.area_um2
    for blank in (IN_STEP, AGAINST, BETWEEN):
        leak = Leak.of(blank, stop)
        t = leak.amplitude
        expected = abs(eta + t * (1 - eta)) ** 2 / (eta + abs(t) ** 2 * (1 - eta)) * stop.area_um2
        table = lit_lags(pupil, leak, np.inf)[0]
        assert table.volume_um2 == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("gutter_nm", [0, 8000])
def test_the_bar_of_the_mtf_holds_what_it_leaves_out(gutter_nm):
    """Against the autocorrelation of the complex amplitude on a grid that has the strips between cells, too."""
    aperture, stop = openings(gutter_nm=gutter_nm), Stop("square", 240.0)
    edges = aperture.x.edges_um()
    assert np.allclose(np.diff(edges), 8.0)
    leak = Leak.of(MaskBlank(2.0, 0.3), stop)
    pupil = cut(aperture, stop)
    table = lit_lags(pupil, leak, np.inf)[0]
    # The stop cuts dots in half, so that halves of dots are whole.
    half = Lattice(float(edges[0]), 2 * (edges.size - 1), 1, 4.0, 4.0)
    fine = aperture.transmission.repeat(2, 0).repeat(2, 1)
    clear, film = (cut(Aperture(half, half, part, 0 * part), stop).mean_transmission for part in (fine, 1 - fine))
    amplitude = clear + leak.amplitude * film
    size = 2 * len(amplitude)
    spectrum = np.fft.fft2(amplitude, (size, size))
    exact = np.fft.ifft2(abs(spectrum) ** 2)
    worst = 0.0
    for k in range(0, 14):
        for j in range(0, 14):
            true = abs(exact[2 * k, 2 * j]) / exact[0, 0].real
            worst = max(worst, abs(float(abs(table.otf(np.array(8.0 * j), np.array(8.0 * k)))) - true))
    assert 0 < worst <= table.uncertainty
    assert table.uncertainty < 0.02


def test_a_stated_leak_is_no_longer_in_the_bar_and_one_without_phase_is():
    pupil = cut(openings(), CAMERA.stop)
    names = [{each.name for each in model_bar(pupil, CAMERA, blank)} for blank in (MaskBlank(3.0), MaskBlank(3.0, 0.1))]
    assert "chrome leak" in names[0]
    assert "chrome leak" not in names[1]
    assert Leak.of(UNSTATED, CAMERA.stop) is None
    assert Leak.of(MaskBlank(3.0), CAMERA.stop) is None


def test_analyse_counts_a_stated_leak_in_every_number(capsys):
    command = [
        "analyse",
        str(TOLED),
        "--camera",
        '{ stop = { diameter = "300 um" }, window = "32 um", wavelengths = ["530 nm"] }',
        "--quiet",
        "--json",
    ]
    found = []
    for plate in ("{ optical_density = 2 }", "{ optical_density = 2, film_phase = 0.4 }"):
        assert run_command_line([*command, "--plate", plate]) == 0
        found.append({each["name"]: each["value"] for each in json.loads(capsys.readouterr().out)["quantities"]})
    assert "model_chrome_leak" in found[0]
    assert "model_chrome_leak" not in found[1]
    eta = found[0]["stop_open_ratio"]
    tau = 0.1 * np.exp(0.8j * np.pi)
    assert found[0]["peak_strehl"] == pytest.approx(eta**2, rel=1e-6)
    assert found[1]["peak_strehl"] == pytest.approx(abs(eta + tau * (1 - eta)) ** 2, rel=1e-6)
    assert found[1]["auc_radial_min"] != pytest.approx(found[0]["auc_radial_min"], rel=1e-3)
