"""Rough edges: what their halo holds, and the mean field and halo of edges that are drawn by chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maskfab.base.model import Psf
from maskfab.findings.optics import stop_boundary
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import Roughness
from maskfab.optics.psf import EdgeLengths, halo_um3, image_scale_um2, rough_psf, scattered_um2

CAMERA = Camera(5000.0, Stop("square", 300.0), (530.0,), 2.0, 1200.0)
ROUGH = Roughness(0.6, 0.8)
PITCH = 56.0
BOXES = [(8.0, 8.0, 40.0, 24.0), (8.0, 32.0, 16.0, 48.0), (32.0, 32.0, 48.0, 48.0)]
"""Of a cell, micrometres."""
CELLS = 3


def test_the_halo_holds_what_the_mean_field_loses():
    """An edge's transmission is p in the mean, and p - p² over its profile is σ / √π."""
    across, along = np.linspace(-1.2, 1.2, 241), np.linspace(-8, 8, 321)
    found = halo_um3(across[:, None], along[None], ROUGH)
    # Beyond the grid 1 / (2π f)² is left across the edge, on both sides.
    held = np.trapezoid(np.trapezoid(found, along), across) + 2 / (4 * np.pi**2 * across[-1])
    edges = EdgeLengths.of(np.array([[0.0, 0.0, 0.0, 1.0]]), np.ones(1))
    assert held == pytest.approx(scattered_um2(edges, ROUGH), rel=2e-4)


def test_edges_are_summed_by_direction():
    box = np.array([[0, 0, 3, 0], [3, 0, 3, 4], [3, 4, 0, 4], [0, 4, 0, 0.0]])
    edges = EdgeLengths.of(np.concatenate([box, [[0, 0, -1, 1.0]]]), np.array([2.0, 2, 2, 2, 1]))
    found = {tuple(np.round(each, 6)): length for each, length in zip(edges.along, edges.length_um, strict=True)}
    assert found == pytest.approx({(1.0, 0.0): 12, (0.0, 1.0): 16, (-0.707107, 0.707107): np.sqrt(2)})
    assert edges.total_um == pytest.approx(28 + np.sqrt(2))


def rough_line(start: np.ndarray, end: np.ndarray, draw: np.random.Generator) -> np.ndarray:
    """Points of a rough edge from one corner to the next."""
    length = float(np.hypot(*(end - start)))
    count = int(length / (ROUGH.correlation_um / 5))
    at = np.linspace(0, length, count, endpoint=False)
    longer = 3 * count  # drawn on a ring, whose ends must not meet
    frequency = np.fft.fftfreq(longer, length / count)
    power = np.exp(-((np.pi * frequency * ROUGH.correlation_um) ** 2))
    noise = np.fft.ifft(np.fft.fft(draw.standard_normal(longer)) * np.sqrt(power / power.mean())).real[:count]
    along = (end - start) / length
    normal = np.array([along[1], -along[0]])
    return start + at[:, None] * along + ROUGH.sigma_um * noise[:, None] * normal


def openings(draw: np.random.Generator | None) -> tuple[np.ndarray, float]:
    """Edges [n, 4] of all boxes, rough ones if drawn, and the area in them."""
    edges, area = [], 0.0
    for x, y in np.ndindex(CELLS, CELLS):
        for x0, y0, x1, y1 in BOXES:
            middle = CELLS * PITCH / 2
            place = np.array([x * PITCH - middle, y * PITCH - middle])
            corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) + place
            following = np.roll(corners, -1, axis=0)
            if draw is not None:
                lines = [rough_line(*pair, draw) for pair in zip(corners, following, strict=True)]
                corners = np.concatenate(lines)
                following = np.roll(corners, -1, axis=0)
            edges.append(np.hstack([corners, following]))
            area += float((corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum()) / 2
    return np.concatenate(edges), area


def test_drawn_edges_have_this_mean_field_and_this_halo():
    """Debye-Waller factor and halo in the orders of a grating of boxes, against polygons with edges drawn by chance."""
    step, count, draws = 1 / PITCH, 25, 24
    smooth, area = openings(None)
    lengths = EdgeLengths.of(smooth, np.ones(len(smooth)))
    draw = np.random.default_rng(7)
    fields = [
        stop_boundary(*openings(draw), CAMERA).field(step, count)
        for _ in range(draws)
    ]  # fmt: skip
    drawn = np.array(fields)
    f = step * np.arange(-(count // 2), count // 2 + 1)
    factor = np.exp(-((2 * np.pi * ROUGH.sigma_um) ** 2) * (f[None] ** 2 + f[:, None] ** 2) / 2)
    mean = stop_boundary(smooth, area, CAMERA).field(step, count) * factor
    halo = sum(
        length * halo_um3(f[None] * ty - f[:, None] * tx, f[None] * tx + f[:, None] * ty, ROUGH)
        for (tx, ty), length in zip(lengths.along, lengths.length_um, strict=True)
    )
    assert factor.min() < 0.6
    apart = np.abs(drawn - mean) ** 2
    # Of 625 numbers, half of them twice, from 24 draws: about 1 % by chance, and the ends of edges.
    assert (apart / halo).mean() == pytest.approx(1, abs=0.06)
    # The mean of all draws is off by a 24th of the halo: without the factor it would be off by far more.
    assert (np.abs(drawn.mean(axis=0) - mean) ** 2 / (halo / draws)).mean() == pytest.approx(1, abs=0.2)
    assert (np.abs(drawn.mean(axis=0) - mean / factor) ** 2 / (halo / draws)).mean() > 2


def test_the_psf_has_both():
    smooth, area = openings(None)
    scale = image_scale_um2(CAMERA, 530.0)
    step, count = 4.0, 21
    field = stop_boundary(smooth, area, CAMERA).field(step / scale, count)
    psf = Psf(np.abs(field) ** 2 / (scale**2 * area), step, 530.0, "point")
    lengths = EdgeLengths.of(smooth, np.ones(len(smooth)))
    found = rough_psf(psf, lengths, area, scale, ROUGH)
    f = step / scale * np.arange(-10, 11)
    kept = psf.values * np.exp(-((2 * np.pi * ROUGH.sigma_um) ** 2) * (f[None] ** 2 + f[:, None] ** 2))
    added = (found.values - kept) * scale**2 * area
    # At such low frequencies an edge adds L σ² l √π, whatever its direction.
    flat = lengths.total_um * ROUGH.sigma_um**2 * ROUGH.correlation_um * np.sqrt(np.pi)
    assert added == pytest.approx(np.full_like(added, flat), rel=0.02)
    none = rough_psf(psf, lengths, area, scale, replace(ROUGH, sigma_um=0.0))
    assert np.array_equal(none.values, psf.values)
