"""Time and memory of meshes: what is held while they are written and read, and what a film's making must not change."""

from __future__ import annotations

import math
import tracemalloc
import zipfile
from importlib.util import find_spec

import numpy as np
import pytest
from small_job import write_job

from maskfab.mask.formats import mesh, solid
from maskfab.mask.formats.format import Stack
from maskfab.mask.job import load_job


@pytest.fixture(scope="module")
def die(tmp_path_factory):
    """A die of 1600 cells, whose STL is some megabytes."""
    edits = ("560 um", f"{56 * 40} um"), ('die_pitch = "2 mm"', 'die_pitch = "6 mm"')
    return load_job(write_job(tmp_path_factory.mktemp("weight"), *edits)).plate().dies[1]


def _peak(work) -> int:
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("suffix", "written", "read"), [(".stl", 3, 7), (".glb", 6, 20), (".3mf", 12, 40)])
def test_a_mesh_is_written_and_read_in_a_few_times_its_file(die, tmp_path, suffix, written, read):
    made = solid.film(die, Stack())
    path = tmp_path / f"die{suffix}"
    write = {".stl": mesh.write_stl, ".glb": mesh.write_glb, ".3mf": mesh.write_3mf}[suffix]
    peak = _peak(lambda: write(die, path, films=lambda *_: made))
    assert peak < written * path.stat().st_size + 20e6
    peak = _peak(lambda: mesh.check_mesh(die, path))
    assert peak < read * path.stat().st_size + 20e6


def test_a_film_is_made_once_for_the_formats_that_share_it(die, monkeypatch):
    made = []
    monkeypatch.setattr(solid, "film", lambda *given: made.append(given) or (solid.box_mesh(*np.eye(3)[:2]), 0))
    films = solid.SharedFilm(3)
    assert len({id(films(die, Stack())[0]) for _ in range(3)}) == 1
    films(die, Stack())
    assert len(made) == 2  # the fourth is of another round
    films(die, Stack(corners="neck"))
    assert len(made) == 3


def test_a_3mf_that_is_not_plain_is_read_by_trimesh(small_plate, tmp_path):
    """The same meshes, whose elements do not stand a line each."""
    die = small_plate.dies[1]
    plain, other = tmp_path / "plain.3mf", tmp_path / "other.3mf"
    mesh.write_3mf(die, plain)
    with zipfile.ZipFile(plain) as source, zipfile.ZipFile(other, "w") as target:
        for name in source.namelist():
            target.writestr(name, source.read(name).replace(b'"/>\n', b'" />'))
    assert mesh._plain_3mf(plain) is not None
    assert mesh._plain_3mf(other) is None
    values = [[(row.name, row.value, row.passed) for row in mesh.check_mesh(die, path)] for path in (plain, other)]
    assert values[0] == values[1]


def _turned(points, triangles):
    """Triangles with their diagonals turned one after the other, in whole numbers, by sets and tuples alone."""
    owner = {side: n for n, (a, b, c) in enumerate(triangles) for side in ((a, b), (b, c), (c, a))}
    waiting = list(owner)
    while waiting:
        a, c = waiting.pop()
        n, across = owner.get((a, c)), owner.get((c, a))
        if n is None or across is None:
            continue
        (b,), (d,) = {*triangles[n]} - {a, c}, {*triangles[across]} - {a, c}
        (ax, ay), (cx, cy), (bx, by) = ((points[k][0] - points[d][0], points[k][1] - points[d][1]) for k in (a, c, b))
        areas = cx * by - cy * bx, bx * ay - by * ax, ax * cy - ay * cx
        turns = sum(area * (x * x + y * y) for area, (x, y) in zip(areas, ((ax, ay), (cx, cy), (bx, by)), strict=True))
        if turns > 0 if any(areas) else math.dist(points[b], points[d]) < math.dist(points[a], points[c]):
            triangles[n], triangles[across] = (b, a, d), (d, c, b)
            del owner[a, c], owner[c, a]
            owner |= {(b, a): n, (a, d): n, (d, b): n, (d, c): across, (c, b): across, (b, d): across}
            waiting += [(b, a), (a, d), (d, c), (c, b)]
    return np.array(triangles)


@pytest.mark.parametrize("step_nm", [1, 8000, 600_001])
def test_diagonals_turn_as_they_do_in_whole_numbers_compiled_or_not(step_nm):
    """Strips of a grid whose corners lie on common lines and circles, in triangles as bad as ears make them."""
    random = np.random.default_rng(step_nm)
    for _ in range(8):
        across = np.sort(random.choice(40, 14, replace=False))
        points = [(int(x) * step_nm, 0) for x in across] + [(int(x) * step_nm, 3 * step_nm) for x in across[::-1]]
        from manifold3d import triangulate

        ears = np.array(triangulate([np.array(points, dtype=np.float64)]), dtype=np.int64)
        expected = _turned(points, [tuple(row) for row in ears.tolist()])
        turners = [solid._turn, *([solid._compiled()] if find_spec("numba") else [])]
        for turn in turners:
            assert np.array_equal(solid._delaunay(np.array(points), ears, turn), expected)
    assert solid._turner(10**6, 1 << 26) is solid._turn  # too wide for whole numbers of 64 bits
