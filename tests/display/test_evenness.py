"""Evenness in closed form, against pictures of random fields, periodic ones and invariants."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.model import Emitters, Tiling, orient
from maskfab.display import emitted_light, eye, pictures
from maskfab.display.emitted_light import Viewing, series
from maskfab.display.emitter_rules import EmitterGrid
from maskfab.display.evenness import _frequencies, _matrices, _mean_length, evenness, evenness_of, sight
from maskfab.optics.colour import LUMINANCE, lab_of_linear_srgb


def pictured(panel, viewing, count=100) -> tuple[float, float]:
    spectrum = series(emitted_light.show(panel, pictures.flat(count), 14), viewing, eye.HIGHEST_CPD)
    seen = eye.of_series(spectrum, viewing)
    even = lab_of_linear_srgb(np.full(3, 0.5))
    return float(np.linalg.norm(seen - even, axis=-1).mean()), eye.measured_rms(spectrum, 0, eye.SLOW_CPD)


@pytest.mark.parametrize("order", [(1, 3, 2), (2, 1, 3)])
@pytest.mark.parametrize("ppd", [31, 62])
def test_the_closed_form_is_that_of_a_picture(slit_panel, order, ppd):
    panel = slit_panel(order)
    viewing = Viewing(panel.cell_size.pitch_um, np.degrees(panel.cell_size.pitch_um * ppd))
    delta_e, grain = pictured(panel, viewing)
    quick = evenness(panel, viewing)
    assert quick.delta_e == pytest.approx(delta_e, rel=0.04)
    assert quick.grain == pytest.approx(grain, rel=0.06)


def test_a_periodic_panel_has_its_lattice_alone(slit_panel):
    panel = slit_panel(tiling=Tiling.PERIODIC, count=20)
    near = Viewing(panel.cell_size.pitch_um, 150e3)
    quick = evenness(panel, near)
    assert quick.grain == 0
    assert quick.delta_e == pytest.approx(pictured(panel, near, 20)[0], rel=0.2)  # a wave is not normal
    assert evenness(panel, Viewing(panel.cell_size.pitch_um, 600e3)).delta_e < 1e-6


def test_turning_or_mirroring_all_orientations_changes_nothing(slit_panel, telephone):
    emitters = slit_panel().emitters
    shares = np.full(8, 1 / 8)
    answers = []
    for own in range(8):
        pixels = [Emitters(orient(orient(emitters.labels, own), k), emitters.cell_nm) for k in range(8)]
        seen = evenness_of(pixels, shares, 84_672, telephone)
        answers.append((seen.delta_e, seen.grain))
    np.testing.assert_allclose(answers, [answers[0]] * 8, rtol=1e-9)


def test_emitters_with_all_symmetries_of_the_square_are_even(make_panel, telephone):
    labels = np.zeros((8, 8), dtype=np.int8)
    labels[:2, :2] = labels[:2, -2:] = labels[-2:, :2] = labels[-2:, -2:] = 1
    labels[3:5, 3:5] = 2
    labels[3:5, :1] = labels[3:5, -1:] = labels[:1, 3:5] = labels[-1:, 3:5] = 3
    panel = make_panel(np.zeros((8, 8), dtype=np.bool_), labels, 10_584)
    seen = evenness(panel, telephone)
    assert seen.delta_e < 1e-6
    assert seen.grain < 1e-12


def test_what_a_search_minimises_is_the_rms(slit_panel, telephone):
    emitters = slit_panel().emitters
    grid = EmitterGrid(42, 2016, 2, 0, 1, 2, 2)
    lights = sight(grid, telephone)
    total = sum(
        lights[colour][emitters.labels == colour + 1].sum(axis=0) / (emitters.labels == colour + 1).sum()
        for colour in range(3)
    )
    seen = evenness(slit_panel(), telephone)
    # The mean of a length is below its rms, by a fifth if there is one direction alone.
    assert 0.75 < seen.delta_e / float(np.linalg.norm(total)) < 1.02


@pytest.mark.parametrize("cells", [7, 11])
def test_lights_have_the_products_of_all_waves(cells, telephone):
    grid = EmitterGrid(cells, 84_672 // cells, 1, 0, 1, 1, 1)
    ppd, worth = telephone.pixels_per_degree, 150.0
    lights = sight(grid, telephone, worth).reshape(3 * cells**2, -1)
    f = _frequencies(math.ceil(30 / 3), ppd)
    along = (np.arange(cells) + 0.5 - cells / 2) / cells
    waves = np.exp(-2j * np.pi * np.outer(f, along)) * np.sinc(f / cells)[:, None]
    labs, seen = _matrices(f, ppd), []
    for y, x in np.argwhere(np.hypot(f[:, None], f) * ppd <= 30):
        wave = np.outer(waves[y], waves[x])
        wave = wave - np.mean([np.rot90(half, k) for half in (wave, wave[:, ::-1]) for k in range(4)], axis=0)
        slow = np.hypot(f[y], f[x]) * ppd <= 10
        seen.append(np.kron(np.vstack([labs[y, x], worth * slow * LUMINANCE]), wave.ravel()))
    rows = np.concatenate(seen) * (f[1] - f[0])
    total = rows.real.T @ rows.real + rows.imag.T @ rows.imag
    assert lights @ lights.T == pytest.approx(total, abs=1e-6 * np.abs(total).max())


def test_the_mean_length_of_a_normal_vector():
    assert _mean_length(np.array([0.0, 0.0, 4.0])) == pytest.approx(2 * np.sqrt(2 / np.pi), rel=1e-6)
    assert _mean_length(np.array([1.0, 1.0, 1.0])) == pytest.approx(2 * np.sqrt(2 / np.pi), rel=1e-6)
    assert _mean_length(np.array([0.0, 1.0, 1.0])) == pytest.approx(np.sqrt(np.pi / 2), rel=1e-4)
    assert _mean_length(np.zeros(3)) == 0


def test_a_regular_frame_round_a_map_changes_nothing(slit_panel, telephone):
    panel = slit_panel(count=60)
    framed = replace(panel, orientations=np.pad(panel.orientations, 30, constant_values=3))
    alone = evenness(panel, telephone)
    assert evenness(framed, telephone).delta_e == pytest.approx(alone.delta_e, rel=1e-9)


def test_from_farther_away_less_is_seen(slit_panel):
    panel = replace(slit_panel(), emitters=slit_panel((3, 1, 2)).emitters)
    seen = [evenness(panel, Viewing(84.672, distance)).delta_e for distance in (200e3, 300e3, 600e3, 1200e3)]
    assert seen == sorted(seen, reverse=True)
