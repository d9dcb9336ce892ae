"""Fields at all frequencies of a window from those at few."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optics_cases import camera, noise, panel, pupil
from sweeps import examples

from maskfab.job.camera import Stop
from maskfab.optics.field.matrix import SampledField, direct_field, parity_field, prepare
from maskfab.optics.field.methods import DIRECT, PARITY, FieldPath
from maskfab.optics.field.waves import Precision, frequency_nodes
from maskfab.optics.psf import ReadyPupil, point_psf
from maskfab.optics.pupil import Pupil


@examples(60)
@given(st.floats(1.0, 1e4), st.floats(0.05, 300.0), st.integers(0, 10_000), st.sampled_from(["double", "single"]))
def test_waves_of_any_source_follow_from_the_nodes(reach_um: float, cycles: float, seed: int, precision: str) -> None:
    highest = cycles / reach_um
    nodes = frequency_nodes(reach_um, highest, precision)  # type: ignore[arg-type]
    rng = np.random.default_rng(seed)
    x = reach_um * np.append(rng.random(20), [0.0, 1.0])[:, None]
    u = highest * np.append(np.sort(rng.random(30)), [0.0, 1.0, nodes.frequency[0] / highest])
    error = {"double": 2e-13 * max(1.0, cycles / 20), "single": 2e-6}[precision]
    for parity, wave in enumerate((np.cos, np.sin)):
        found = wave(2 * np.pi * x * nodes.frequency) @ nodes.interpolation(u)[parity].astype(np.float64)
        assert abs(found - wave(2 * np.pi * x * u)).max() < error


@pytest.mark.parametrize("cycles", [5.0, 20.0, 50.0, 200.0])
def test_nodes_are_hardly_more_than_the_independent_waves(cycles: float) -> None:
    """2UX and a few (Slepian); polynomials would need pi / 2 times as many."""
    count = frequency_nodes(1.0, cycles, "double").count
    assert 2 * cycles < count < 2.35 * cycles + 22


@pytest.mark.parametrize("gutter_nm", [0, 5000])
@pytest.mark.parametrize(
    "frequency", [np.linspace(0.0, 0.011, 181), np.sort(np.random.default_rng(8).random(150)) / 70]
)
def test_the_field_by_few_frequencies_is_that_of_a_direct_sum(gutter_nm: int, frequency: np.ndarray) -> None:
    """Rectangles summed one by one on a lattice that no path special-cases, the stop's rim among them whole."""
    laid_out = panel(noise(13, 0.6, 3), dot_nm=9000, gutter_nm=gutter_nm, cells=18, seed=4)
    source = pupil(laid_out, Stop("circle", 2000.0))
    whole = Pupil.of_whole_dots(source.x, source.y, source.whole, source.stop)
    prepared = prepare(whole, float(frequency[-1]), float(frequency[-1]))
    reach = prepared.terms[0].x.reach_um
    assert frequency_nodes(reach, float(frequency[-1]), "double").count < 0.6 * frequency.size
    rows, columns = np.nonzero(source.whole)
    x, y = source.x.edges_um(), source.y.edges_um()
    found = prepared.field(frequency, frequency).amplitude()[-frequency.size :, -frequency.size :]
    chosen = np.random.default_rng(0).integers(0, frequency.size, (12, 2))
    for j, i in chosen:
        v, u = frequency[j], frequency[i]
        sides = [
            (edges[at + 1] - edges[at]) * np.sinc((edges[at + 1] - edges[at]) * f)
            for edges, at, f in ((x, columns, u), (y, rows, v))
        ]
        phase = u * (x[columns] + x[columns + 1]) / 2 + v * (y[rows] + y[rows + 1]) / 2
        expected = (sides[0] * sides[1] * np.exp(-2j * np.pi * phase)).sum()
        assert abs(found[j, i] - expected) < 1e-12 * abs(found).max()


def test_a_window_met_for_the_first_time_costs_no_more_than_one_met_again() -> None:
    """No factorisation to pay for: every new wavelength, window or lattice is as fast as the last."""
    source = pupil(panel(noise(21, 0.2, 1), cells=24, seed=2), Stop("circle", 4000.0))
    bare = Pupil.of_whole_dots(source.x, source.y, source.whole, source.stop)

    def spent(highest: float) -> float:
        frequency = np.linspace(0.0, highest, 257)
        start = time.process_time()
        parity_field(bare, frequency, frequency)
        return time.process_time() - start

    spent(0.02)
    firsts = [spent(0.02 + 0.0004 * k) for k in range(1, 8)]
    again = [spent(0.02) for _ in range(7)]
    assert np.median(firsts) < 1.6 * np.median(again)


@pytest.mark.parametrize("path", [PARITY, DIRECT], ids=lambda path: path.name)
@pytest.mark.parametrize(("precision", "most"), [("double", 1e-12), ("single", 5e-6)])
def test_one_sampled_field_serves_every_wavelength(path: FieldPath, precision: Precision, most: float) -> None:
    """On grids with the axis and without it, the field and its intensity, whatever made the samples."""
    source = pupil(panel(noise(13, 0.6, 3), cells=6, seed=4), Stop("circle", 500.0))
    highest = 0.02
    reach = float(source.x.edges_um()[-1])
    sampled = SampledField.of(
        path.prepare(source, highest, highest, precision).field, (reach, reach), (highest, highest), precision
    )
    for scale in (1.0, 0.77, 0.3):
        for places in (np.linspace(0, highest, 70), highest / 70 * (np.arange(70) + 0.5)):
            found, known = sampled.field(scale * places, places), parity_field(source, scale * places, places)
            exact = known.amplitude()
            assert np.linalg.norm(found.amplitude() - exact) < most * np.linalg.norm(exact)
            same, opposite = found.quadrants()
            whole = np.linalg.norm(known.intensity())
            if places[0]:
                assert np.hypot(np.linalg.norm(same), np.linalg.norm(opposite)) == pytest.approx(
                    whole / math.sqrt(2), rel=2 * most
                )


@pytest.mark.parametrize(("window_um", "nodes"), [(120.0, True), (8.0, False)])
def test_one_line_is_kept_at_nodes_where_these_are_fewer_than_samples(window_um: float, nodes: bool) -> None:
    setting = camera(300.0, wavelengths=(530.0,), window_um=window_um)
    source = pupil(panel(noise(7, 0.5, 2), cells=6, seed=1), setting.stop)
    ready = ReadyPupil.of(source, setting)
    assert isinstance(ready.prepared, SampledField) == nodes
    (found,) = ready.psfs()
    expected = point_psf(source, setting, 530.0)
    np.testing.assert_allclose(found.values, expected.values, rtol=0, atol=1e-13 * expected.values.max())


@pytest.mark.parametrize("off", [0.0, 0.004])
def test_a_sampled_field_is_told_at_places_of_either_sign(off: float) -> None:
    """The axes alike, whose nodes serve both in one go, and not."""
    source = pupil(panel(noise(7, 0.5, 2), cells=6, seed=1), Stop("circle", 300.0))
    highest = (0.02, 0.02 - off)
    sampled = SampledField.of(prepare(source, *highest).field, source.reach_um, highest)
    u, v = np.linspace(-0.012, 0.011, 5), np.linspace(-0.004, 0.015, 4)
    np.testing.assert_allclose(sampled.at(u, v), direct_field(source, u, v), rtol=0, atol=1e-12 * source.energy_um2)
