"""Polygons of very many or very long edges: what a raster of them takes, and that they need no merging where apart."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from klayout import db

from maskfab.findings import analysis
from maskfab.job.camera import Camera, Stop
from maskfab.mask.raster import outline_coverage


def test_long_edges_are_rastered_in_the_memory_of_the_grid():
    """300 slanted needles cross 2 000 lines each: a million pieces, of 300 bytes with all that is made of them."""
    lines = 1.0 * np.arange(2001)
    left = 6.0 * np.arange(300) - 0.5
    low = np.stack([left, np.full(300, -1.0), left + 0.7, np.full(300, 2001.0)], axis=1)
    edges = np.concatenate([low[:, [2, 3, 0, 1]], low + np.array([0.25, 0, 0.25, 0])])
    tracemalloc.start()
    found = outline_coverage(edges, lines, lines)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2.5 * found.nbytes
    whole = 0.25 * 2000 * 299
    assert whole <= found.sum() <= whole + 0.25 * 2000


def star(x: int, y: int, radius: int = 40_000, points: int = 60) -> db.Polygon:
    angle = 2 * np.pi * np.arange(2 * points) / (2 * points)
    reach = np.where(np.arange(2 * points) % 2, radius // 2, radius)
    corners = np.stack([x + reach * np.cos(angle), y + reach * np.sin(angle)], axis=1).round().astype(int)
    return db.Polygon([db.Point(*corner) for corner in corners.tolist()])


@pytest.mark.parametrize("pitch", [100_000, 60_000])
def test_polygons_that_lie_apart_are_seen_as_if_they_were_merged(tmp_path, monkeypatch, pitch):
    layout = db.Layout()
    cell, layer = layout.create_cell("STARS"), layout.layer(1, 0)
    for k in range(9):
        cell.shapes(layer).insert(star((k % 3 - 1) * pitch, (k // 3 - 1) * pitch))
    layout.write(str(tmp_path / "stars.oas"))
    request = analysis.Request(Camera(10_000.0, Stop("circle", 250.0), (530.0,), 2.0, 32.0))
    merged = analysis._draw(tmp_path / "stars.oas", request, outlined=False)
    monkeypatch.setattr(analysis, "_MANY_VERTICES", 500, raising=False)
    held = analysis._polygons(tmp_path / "stars.oas", request)[2]
    assert held.merged_semantics == (pitch < 80_000)  # of overlapping ones none is counted twice
    plain = analysis._draw(tmp_path / "stars.oas", request, outlined=False)
    assert plain[2] == pytest.approx(merged[2], rel=1e-12)
    assert plain[3] == merged[3]
    np.testing.assert_allclose(plain[4].transmission, merged[4].transmission, atol=1e-12)
