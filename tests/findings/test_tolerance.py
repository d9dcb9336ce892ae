"""Bands over the spread of a process: against exact areas, against full draws, and what they say of themselves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri
from small_job import write_job

from maskfab.base.errors import JobError
from maskfab.base.model import Die, Opening, Panel, Tiling
from maskfab.findings.as_written import fused_optics, measure_written
from maskfab.findings.bands import Band, ProcessSpread, _inner, band_quantities, bands
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import Process
from maskfab.mask.job import load_job
from maskfab.mask.writer import Reading
from maskfab.optics.mtf import area_under_radial_min
from maskfab.optics.psf import ReadyPupil
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.runs.pipeline import run

LAYOUTS = Path(__file__).parents[2] / "layouts"

CAMERA = Camera(5000.0, Stop("circle", 400.0), (530.0,), 2.0, 64.0)
MASK = np.zeros((7, 7), dtype=bool)
MASK[1:6, 2:4] = True
STRIPES = np.zeros((7, 7), dtype=bool)
STRIPES[:, 2:5] = True


def die(mask: np.ndarray = MASK) -> Die:
    cells = np.zeros((8, 8), dtype=np.int8)
    panel = Panel(Opening("W", mask, 8000), 8000, 0, cells, Tiling.PERIODIC, None)
    return Die("W", "W", panel, (0, 0), 8 * panel.pitch_nm)


def of(found: tuple[Band, ...], name: str) -> Band:
    (band,) = (each for each in found if each.name == name)
    return band


def test_stripes_open_in_proportion_to_their_width():
    """In a square stop of whole periods a stripe of w in a pitch of T is open by (w + bias) / T."""
    camera = replace(CAMERA, stop=Stop("square", 336.0))
    written = measure_written(die(STRIPES), camera, Process(0.0))
    band = of(bands(written, camera, ProcessSpread(bias_um=0.1)), "band_stop_open_ratio")
    assert band.nominal == pytest.approx(3 / 7, abs=1e-9)
    assert band.by_bias == pytest.approx(0.1 / 56, rel=1e-6)
    # The quantiles of 201 equally likely points are those of the normal distribution to a few per cent.
    assert (band.high - band.low) / 2 == pytest.approx(1.96 * 0.1 / 56, rel=0.03)
    assert band.error < 1e-3 * (band.high - band.low)


def test_a_radius_that_cannot_be_less_takes_light_with_its_square():
    """Each of a bar's four corners loses (1 - pi / 4) r²."""
    camera = replace(CAMERA, stop=Stop("square", 336.0))
    written = measure_written(die(), camera, Process(0.0))
    band = of(bands(written, camera, ProcessSpread(radius_um=0.5)), "band_stop_open_ratio")
    lost = 4 * (1 - np.pi / 4) * 0.5**2 / 56**2
    assert band.by_radius == pytest.approx(0, abs=1e-3 * lost)
    assert band.high == pytest.approx(band.nominal, abs=1e-12)
    assert band.nominal - band.low == pytest.approx(ndtri(0.975) ** 2 * lost, rel=0.05)


def test_the_psf_of_a_bar_changes_as_the_integral_over_its_edges_says():
    """U of whole openings w by h is a sum over cells times W H, W = 2 sin(kw / 2) / k; an edge's own transform is
    cos(kw / 2) H, so that both edges of a bias b add b cos(kw / 2) H / 2 each."""
    camera = replace(CAMERA, stop=Stop("square", 336.0))
    written = measure_written(die(), camera, Process(0.0))
    psf = written.readings[Reading.FUSED].psf
    place = psf.step_um * (np.arange(psf.values.shape[0]) - psf.values.shape[0] // 2)
    k = 2 * np.pi * place / (psf.wavelength_nm * 1e-3 * camera.focal_um)

    def along(width: float, middle: float) -> tuple[np.ndarray, np.ndarray]:
        centres = 56.0 * np.arange(-3, 3) + middle
        cells = np.exp(1j * np.outer(k, centres)).sum(axis=1)
        return cells * width * np.sinc(k * width / (2 * np.pi)), cells * np.cos(k * width / 2)

    (across, across_edge), (up, up_edge) = along(16.0, 24.0), along(40.0, 28.0)
    field, change = np.outer(up, across), np.outer(up_edge, across) + np.outer(up, across_edge)
    middle = (k.size // 2, k.size // 2)
    shape = abs(field) ** 2 / abs(field[middle]) ** 2
    assert psf.values / psf.values[middle] == pytest.approx(shape, abs=1e-9)
    by_um = 2 * (field.conj() * change).real / abs(field[middle]) ** 2
    by_um -= shape * by_um[middle]
    rows = {row.name: row.value for row in band_quantities(written, camera, ProcessSpread(bias_um=0.05))}
    expected = 0.1 * np.linalg.norm(by_um) / np.linalg.norm(shape)
    assert rows["sensitivity_psf_shape"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plate", "name", "change"),
    [("toled_against_ours", "OURS", 2.9e-4), ("upc12", "PINV_R150", 1.5e-3), ("toled_against_ours", "TOLED", 2.5e-3)],
)
def test_a_tenth_of_a_micrometre_changes_the_psf_by_what_the_manual_says(plate, name, change):
    job = load_job(LAYOUTS / f"{plate}.toml")
    (seen,) = (each for each in job.plate().dies if each.name == name)
    like = ReadyPupil.of(
        cut(panel_aperture(seen.panel), job.camera.stop), replace(job.camera, wavelengths_nm=(530.0,))
    ).psfs()[0]
    psfs = [fused_optics(seen, job.camera, Process(0.0, bias), like).psf.values for bias in (0.0, 0.1)]
    drawn, written = (each / each.max() for each in psfs)
    assert np.linalg.norm(written - drawn) / np.linalg.norm(drawn) == pytest.approx(change, rel=0.04)


@pytest.mark.slow
def test_edges_are_those_of_full_draws():
    spread, process, count = ProcessSpread(0.2, 0.3), Process(0.5, 0.1), 200
    written = measure_written(die(), CAMERA, process)
    found, like = bands(written, CAMERA, spread), written.readings[Reading.FUSED].psf
    draw = np.random.default_rng(2)
    # Draws spread evenly: so few drawn each by itself have edges that lie a quarter off by chance.
    x, y = ndtri([(draw.permutation(count) + 0.5) / count for _ in range(2)])
    drawn = [
        fused_optics(die(), CAMERA, Process(max(0.0, 0.5 + 0.3 * v), 0.1 + 0.2 * u), like)
        for u, v in zip(x, y, strict=True)
    ]
    peak = [each.psf.values / each.psf.values.max() for each in (written.readings[Reading.FUSED], *drawn)]
    changes = [np.linalg.norm(each - peak[0]) / np.linalg.norm(peak[0]) for each in peak[1:]]
    assert of(found, "band_psf_shape").high == pytest.approx(np.quantile(changes, 0.95), rel=0.1)
    for name, values in (
        ("band_stop_open_ratio", [each.open_ratio for each in drawn]),
        ("band_auc_radial_min", [area_under_radial_min(each.mtfs[0]) for each in drawn]),
    ):
        band, (low, high) = of(found, name), np.quantile(values, [0.025, 0.975])
        assert band.nominal - band.low == pytest.approx(band.nominal - low, rel=0.1)
        assert band.high - band.nominal == pytest.approx(high - band.nominal, rel=0.1)


def test_rows_say_their_error_and_there_are_none_without_a_spread():
    written = measure_written(die(), CAMERA, Process(0.5))
    rows = band_quantities(written, CAMERA, ProcessSpread(0.1))
    names = ["stop_open_ratio", "auc_radial_min", "mtf50", "psf_shape"]
    assert [row.name for row in rows] == [*(f"band_{name}" for name in names), "sensitivity_psf_shape"]
    assert all(row.uncertainty is not None and row.uncertainty < 0.1 * row.value for row in rows)
    assert band_quantities(written, CAMERA, ProcessSpread()) == ()


def test_a_window_too_small_for_means_over_pixels_has_no_band_of_its_halo():
    assert _inner(replace(CAMERA, wavelengths_nm=(610.0, 530.0, 470.0))) is None
    inner = _inner(replace(CAMERA, window_um=256.0))
    assert inner is not None
    assert 50 <= inner.window_um < 256


def test_a_spread_that_closes_dots_is_refused_before_any_work(tmp_path):
    spread = ("[[die]]", '[process]\ncorner_radius = "3.5 um"\nspread = { bias = "2 um" }\n\n[[die]]')
    with pytest.raises(JobError, match=r"MF127.*process\.spread"):
        run(write_job(tmp_path, spread), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("drawn_in_words", "read_here")
def test_a_report_has_the_bands_of_every_die(tmp_path):
    export = '[export]\nformats = ["gdsii"]\n\n'
    spread = ("[[die]]", f'[process]\nspread = {{ bias = "0.1 um", radius = "0.2 um" }}\n\n{export}[[die]]')
    found = run(write_job(tmp_path, spread), tmp_path / "out")
    for name in ("PLAIN", "TURNED"):
        assert 0 < found[name]["band_psf_shape", 530].value < 0.01
        assert found[name]["band_stop_open_ratio"].value > 0
    assert "Band of the AUC" in (tmp_path / "out/appendix.html").read_text(encoding="utf-8")
