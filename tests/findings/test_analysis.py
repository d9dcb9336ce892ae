"""One opening in any form, and the mask that was made of it, give the same numbers; foreign masks give honest ones."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 - its customary name
import pytest
from klayout import db
from scipy.special import j1
from small_job import DRAWING, LOOK, MASK, OPENING, command, look, write_job

import maskfab
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import Tiling
from maskfab.base.provenance import sha256_of_file
from maskfab.findings.analysis import Request, analyse
from maskfab.job.camera import Camera, Stop

pytestmark = pytest.mark.usefixtures("read_here")

CAMERA = Camera(5000.0, Stop("circle", 400.0), (530.0,), 2.0, 64.0)
SMALL_STOP = Camera(5000.0, Stop("circle", 100.0), (530.0,), 2.0, 64.0)
"""For edges that lie on no grid, whose MTF takes most of the time."""
OF_BOTH = ("stop_open_ratio", "auc_radial_min", "mtf50", "mtf30", "mtf10", "psf_energy_in_window", "peak_strehl")


@pytest.fixture(scope="module")
def out(small_result) -> Path:
    return small_result


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> dict[str, float]:
    """The numbers of the opening as text, laid out periodically."""
    job = write_job(tmp_path_factory.mktemp("reference"))
    return numbers(job.parent / "ring.toml")


def numbers(path: Path, *, camera: Camera = CAMERA, **request) -> dict[str, float]:
    """The value of each quantity by its name."""
    found = analyse(path, Request(camera=camera, **request))
    return {q.name: q.value for q in found.quantities}


def same(one: dict, other: dict, tolerance: float = 1e-9) -> None:
    for name in OF_BOTH:
        assert one[name] == pytest.approx(other[name], rel=tolerance), name


def drawn(path: Path, polygons: list[list[tuple[int, int]]], layer: tuple[int, int] = (1, 0)) -> Path:
    """A layout of polygons in nanometres."""
    layout = db.Layout()
    layout.dbu = 0.001
    shapes = layout.create_cell("FOREIGN").shapes(layout.layer(*layer))
    for polygon in polygons:
        shapes.insert(db.Polygon([db.Point(x, y) for x, y in polygon]))
    layout.write(str(path))
    return path


def box(x0: int, y0: int, x1: int, y1: int) -> list[tuple[int, int]]:
    return [(x0, y0), (x0, y1), (x1, y1), (x1, y0)]


def panel(mask: np.ndarray, cells: int, dot_nm: int = 8000, shift: tuple[int, int] = (0, 0)) -> list:
    """The dots of a periodic panel, as boxes."""
    pitch = dot_nm * len(mask)
    return [
        box(
            *(
                shift[k % 2] + start + extra
                for k, (start, extra) in enumerate(((x, 0), (y, 0), (x, dot_nm), (y, dot_nm)))
            )
        )
        for x, y in (
            (column * pitch + i * dot_nm, row * pitch + j * dot_nm)
            for row in range(cells)
            for column in range(cells)
            for j, i in np.argwhere(mask).tolist()
        )
    ]


# --- one opening, in every form --------------------------------------------------------------------------------------


def write_npy(path: Path) -> None:
    np.save(path, MASK)


def write_txt(path: Path) -> None:
    path.write_text("; a remark\n" + DRAWING)


def write_image(path: Path) -> None:
    image = oiio.ImageOutput.create(str(path))
    assert image.open(str(path), oiio.ImageSpec(7, 7, 1, "half" if path.suffix == ".exr" else "uint8"))
    assert image.write_image(np.ascontiguousarray(MASK[::-1, :, None], dtype=np.float32))
    image.close()


def write_unit(path: Path) -> None:
    drawn(path, panel(MASK, 1))


FORMS: dict[str, Callable[[Path], None]] = {
    "npy": write_npy, "txt": write_txt, "png": write_image, "tif": write_image, "exr": write_image,
}  # fmt: skip


@pytest.mark.parametrize("suffix", FORMS)
def test_an_opening_in_any_form_gives_the_same_numbers(tmp_path, reference, suffix):
    path = tmp_path / f"1-my main {suffix}.{suffix}"
    FORMS[suffix](path)
    request = {"pitch_um": 56.0} if suffix == "txt" else {"dot_um": 8.0}
    assert numbers(path, **request) == reference


def test_a_unit_cell_of_a_layout_gives_the_same_numbers(tmp_path, reference):
    write_unit(tmp_path / "unit.gds")
    found = numbers(tmp_path / "unit.gds", dot_um=8.0, pitch_um=56.0, tiling=Tiling.PERIODIC)
    assert found == reference


@pytest.mark.parametrize("name", ["SMALL.gds", "SMALL.oas", "SMALL_R12.dxf", "SMALL_R2010.dxf"])
def test_the_die_of_a_plate_file_gives_the_same_numbers(out, reference, name):
    found = numbers(out / name, cell="PLAIN")
    same(found, reference)
    assert found["readback_psf_difference"] < 1e-6


def test_the_die_of_a_plate_file_gives_the_numbers_of_its_report(out):
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    for die in report["dies"]:
        same(numbers(out / "SMALL.gds", cell=die["name"]), {q["name"]: q["value"] for q in die["quantities"]})


def test_the_numbers_do_not_depend_on_what_is_said_of_the_grid(out, reference):
    for request in ({"dot_um": 8.0}, {"dot_um": 8.0, "pitch_um": 56.0}, {"dot_um": 4.0}):
        found = numbers(out / "SMALL.gds", cell="PLAIN", **request)
        assert found["stop_open_ratio"] == pytest.approx(reference["stop_open_ratio"], rel=1e-12)
        assert found["peak_strehl"] == pytest.approx(reference["peak_strehl"], rel=1e-7)
        assert found["readback_psf_difference"] < 1e-6


@pytest.mark.parametrize("request_", [{}, {"dot_um": 8.0}, {"dot_um": 8.0, "pitch_um": 56.0}], ids=str)
def test_a_panel_whose_geometry_is_off_its_middle_is_still_exact(tmp_path, request_):
    """Six of seven columns clear: the middle of what is drawn lies half a dot beside that of the panel."""
    mask = np.zeros((7, 7), dtype=bool)
    mask[1:6, 0:6] = True
    path = drawn(tmp_path / "off.gds", panel(mask, 10))
    found = numbers(path, **request_)
    assert found["readback_psf_difference"] < 1e-6
    assert found["mtf_volume_invariant_error"] < 1e-3


def test_a_mask_is_looked_at_in_its_middle_wherever_it_lies(tmp_path, reference):
    path = drawn(tmp_path / "far.gds", panel(MASK, 10, shift=(123_456_789, -98_765_431)))
    same(numbers(path), reference)


def test_a_gutter_is_opaque(tmp_path):
    job = write_job(tmp_path)
    found = numbers(job.parent / "ring.toml", gutter_um=8.0)
    assert found["open_ratio"] == pytest.approx(15 * 64 / 64**2)
    assert found["readback_psf_difference"] < 1e-6


# --- tilings ---------------------------------------------------------------------------------------------------------


def test_a_tiling_is_drawn_from_its_seed(tmp_path, reference):
    path = write_job(tmp_path).parent / "ring.toml"
    first = numbers(path, tiling=Tiling.RANDOM, seed=1)
    assert first == numbers(path, tiling=Tiling.RANDOM, seed=1)
    assert first["mtf50"] != numbers(path, tiling=Tiling.RANDOM, seed=2)["mtf50"]
    assert first["open_ratio"] == reference["open_ratio"]
    assert first["auc_radial_min"] != pytest.approx(reference["auc_radial_min"], rel=1e-3)
    assert numbers(path, tiling=Tiling.PERIODIC) == reference


def test_a_random_tiling_of_the_command_line(capsys, tmp_path):
    path = write_job(tmp_path).parent / "ring.toml"
    answer = command(capsys, "analyse", path, *LOOK, "--tiling", "paper4", "--seed", "5", "--json")
    found = {q["name"]: q["value"] for q in answer.document["quantities"]}
    assert found == numbers(path, tiling=Tiling.PAPER4, seed=5)


def test_an_opening_of_one_orientation_does_not_care_how_it_is_turned(tmp_path):
    """A square in the middle of its cell is the same under all of D4."""
    mask = np.zeros((7, 7), dtype=bool)
    mask[2:5, 2:5] = True
    np.save(tmp_path / "square.npy", mask)
    turned = numbers(tmp_path / "square.npy", dot_um=8.0, tiling=Tiling.RANDOM, seed=1)
    plain = numbers(tmp_path / "square.npy", dot_um=8.0)
    same(turned, plain)


# --- masks of others -------------------------------------------------------------------------------------------------


def test_a_mask_of_odd_coordinates_is_seen_through_a_fine_grid_and_says_so(tmp_path, monkeypatch):
    """Edges at odd nanometres share no grid that could be held, so the raster is grey and its error is told."""
    monkeypatch.setattr("maskfab.findings.analysis._FINEST_GRID", 800)  # quicker
    generator = np.random.default_rng(1)
    corners = 20_000 * np.arange(20)[:, None] + np.sort(generator.integers(1, 19_999, (20, 2)), axis=1)
    rows = corners.tolist()
    odd = drawn(tmp_path / "odd.gds", [box(x0, y0, x1, y1) for x0, x1 in rows for y0, y1 in rows])
    even = drawn(tmp_path / "even.gds", [box(*(8000 * round(v / 8000) for v in (x0, y0, x1 + 8000, y1 + 8000)))
                                         for x0, x1 in rows for y0, y1 in rows])  # fmt: skip
    found, clean = (analyse(path, Request(camera=CAMERA)) for path in (odd, even))

    def told(analysis, name):
        (quantity,) = (q for q in analysis.quantities if q.name == name)
        return quantity

    difference = told(found, "readback_psf_difference")
    assert "raster of 1 um" in difference.method
    assert 1e-8 < difference.value < 1e-2
    assert told(clean, "readback_psf_difference").value < 1e-7
    # What is told of the PSF is the polygons' own, which no raster has touched; so is the area.
    monkeypatch.setattr("maskfab.findings.analysis._FINEST_GRID", 400)
    coarser = analyse(odd, Request(camera=CAMERA))
    assert told(coarser, "readback_psf_difference").value > difference.value
    for name in ("psf_energy_in_window", "ensquared_energy", "halo_energy", "streak_index"):
        assert told(coarser, name).value == pytest.approx(told(found, name).value, rel=1e-9), name
    inside = sum(
        clipped_area(x0, y0, x1, y1, centre_of(rows), 200_000) for x0, x1 in rows for y0, y1 in rows
    )  # fmt: skip
    assert told(found, "stop_open_ratio").value == pytest.approx(inside / (math.pi * 200_000**2), abs=2e-4)


def centre_of(rows: list[list[int]]) -> float:
    return (rows[0][0] + rows[-1][1]) / 2


def clipped_area(x0: int, y0: int, x1: int, y1: int, centre: float, radius: float) -> float:
    """Area of a box inside a circle, by the midpoint rule."""
    x = x0 + (np.arange(60) + 0.5) * (x1 - x0) / 60 - centre
    y = y0 + (np.arange(60) + 0.5) * (y1 - y0) / 60 - centre
    share = np.mean(x[:, None] ** 2 + y**2 < radius**2)
    return float(share * (x1 - x0) * (y1 - y0))


def strehl_of_a_clear_square(folder: Path, diameter_um: float) -> tuple[float, float]:
    """Peak Strehl, and its distance from the square of the open ratio, of a file whose middle is clear all over."""
    path = drawn(folder / "clear.gds", [box(-3_000_000, -3_000_000, 3_000_000, 3_000_000)])
    found = numbers(path, camera=Camera(10_000.0, Stop("circle", diameter_um), (530.0,), 4.0, 32.0))
    return found["peak_strehl"], found["strehl_invariant_error"]


@pytest.mark.parametrize("diameter_um", [900.0, 777.7])
def test_nothing_in_the_way_is_a_peak_strehl_of_one_whatever_the_dots_at_the_rim(tmp_path, diameter_um):
    assert strehl_of_a_clear_square(tmp_path, diameter_um) == pytest.approx((1, 0), abs=1e-8)


@pytest.mark.slow
def test_nothing_in_the_way_is_a_peak_strehl_of_one_behind_forty_stops(tmp_path):
    for diameter_um in np.random.default_rng(5).uniform(400, 2999, 40):
        assert strehl_of_a_clear_square(tmp_path, float(diameter_um)) == pytest.approx((1, 0), abs=1e-8), diameter_um


def test_what_lies_beyond_the_stop_changes_nothing(tmp_path):
    """Shapes off the grid that begin a hair outside of the rim, in dots that the rim cuts."""
    dots = panel(MASK, 10)
    beyond = [box(-202_003, -30_001, -200_100, 29_999), box(200_100, -1, 202_003, 17)]
    moved = [[(x + 280_000, y + 280_000) for x, y in polygon] for polygon in beyond]
    frame = [box(-100_000, -100_000, -99_000, -99_000), box(659_000, 659_000, 660_000, 660_000)]
    bare, more = (
        numbers(drawn(tmp_path / name, shapes), camera=CAMERA)
        for name, shapes in (("bare.gds", dots + frame), ("more.gds", dots + frame + moved))
    )
    for name, value in bare.items():
        assert more[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name


def test_the_energy_of_an_ellipse_in_a_square_is_that_of_its_field_in_closed_form(tmp_path, monkeypatch):
    """Its polygon's field, edge by edge in closed form, integrated over the square by Gauss-Legendre."""
    monkeypatch.setattr("maskfab.findings.analysis._FINEST_GRID", 600)  # quicker
    angles = 2 * np.pi * np.arange(96) / 96
    corners = np.rint(1e3 * np.stack([151 * np.cos(angles), 87 * np.sin(angles)], axis=1)).astype(int)
    (found,) = (
        q
        for q in analyse(drawn(tmp_path / "ellipse.gds", [corners.tolist()]), Request(camera=CAMERA)).quantities
        if q.name == "ensquared_energy"
    )
    side_um, scale = 10.0, 0.530 * 5000.0
    nodes, weights = np.polynomial.legendre.leggauss(40)
    u, v = np.meshgrid(side_um / 2 * nodes / scale, side_um / 2 * nodes / scale)
    start = corners / 1e3 - (corners.max(axis=0) + corners.min(axis=0)) / 2e3
    along = np.roll(start, -1, axis=0) - start
    field = np.zeros(u.shape, dtype=complex)
    for (x, y), (dx, dy) in zip(start + along / 2, along, strict=True):
        field += (u * dy - v * dx) * np.sinc(u * dx + v * dy) * np.exp(-2j * np.pi * (u * x + v * y))
    field *= 1j / (2 * np.pi * (u**2 + v**2))
    area = abs(np.sum(start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0])) / 2
    exact = (side_um / 2) ** 2 * (weights @ abs(field) ** 2 @ weights) / (scale**2 * area)
    assert found.method.startswith("energy within a square of 10 um")
    assert abs(found.value - exact) <= found.uncertainty < 3e-8


def test_masks_that_would_take_minutes_are_refused_by_a_forecast(tmp_path, monkeypatch):
    """Polygons that meet many others side by side when merged, and edges that run along very many dots."""
    monkeypatch.setattr("maskfab.findings.analysis._FINEST_GRID", 600)  # quicker
    slats = [[(x, 0), (x + 3_001, 90_000), (x + 8_000, 90_000), (x + 5_000, 0)] for x in range(0, 90_000, 4_003)]
    path = drawn(tmp_path / "slats.gds", slats)
    assert numbers(path)["stop_open_ratio"] > 0
    for limit, what in (("_LONGEST_MERGE_S", "s to merge; the limit is 0 s"), ("_MOST_CROSSED", "run along .+ dots")):
        with monkeypatch.context() as held:
            held.setattr(f"maskfab.findings.analysis.{limit}", 0)
            with pytest.raises(SourceError, match=f"MF313.*{what}") as refused:
                numbers(path)
        assert refused.value.cure


def test_overlapping_polygons_are_merged_along_either_axis(tmp_path, monkeypatch):
    """Teeth that stand, which a sweep meets at once, and teeth that lie."""
    monkeypatch.setattr("maskfab.findings.analysis._FINEST_GRID", 600)  # quicker
    teeth = [box(4_003 * k, 1_777 * (k % 5), 4_003 * k + 5_000, 90_001) for k in range(22)]
    standing = drawn(tmp_path / "standing.gds", teeth)
    lying = drawn(tmp_path / "lying.gds", [[(y, x) for x, y in corners] for corners in teeth])
    stands, lies = (numbers(path, camera=SMALL_STOP) for path in (standing, lying))
    for name in ("stop_open_ratio", "auc_radial_min", "mtf50"):
        assert stands[name] == pytest.approx(lies[name], rel=1e-9), name


def test_a_coarser_grid_makes_the_error_grow(tmp_path):
    rows = [(20_003 * k + 17, 20_003 * k + 11_118) for k in range(5)]
    path = drawn(tmp_path / "odd.gds", [box(x0, y0, x1, y1) for x0, x1 in rows for y0, y1 in rows])
    errors = [numbers(path, camera=SMALL_STOP, dot_um=dot)["readback_psf_difference"] for dot in (4.0, 2.0, 1.0)]
    assert errors[0] > 1.5 * errors[1] > 2 * errors[2] > 0
    assert errors[0] > 1e-3


def test_a_round_hole_makes_an_airy_pattern(tmp_path, monkeypatch):
    """A polygon of 512 corners for a pinhole of 100 um, the stop far outside."""
    monkeypatch.setattr("maskfab.findings.analysis._FINEST_GRID", 600)  # quicker
    angles = 2 * np.pi * np.arange(512) / 512
    circle = [(round(50_000 * math.cos(a)), round(50_000 * math.sin(a))) for a in angles]
    camera = Camera(5000.0, Stop("square", 120.0), (530.0,), 2.0, 64.0)
    found = analyse(drawn(tmp_path / "hole.gds", [circle]), Request(camera=camera))
    (ratio,) = (q.value for q in found.quantities if q.name == "stop_open_ratio")
    assert ratio == pytest.approx(math.pi * 50**2 / 120**2, rel=1e-4)
    point = found.psfs[0]
    n = len(point.values)
    radius = point.step_um * np.hypot(*np.meshgrid(*2 * [np.arange(n) - n // 2]))
    v = np.pi * 100 * radius / (0.530 * 5000)
    v[n // 2, n // 2] = 1
    airy = np.pi * 50**2 / (0.530 * 5000) ** 2 * (2 * j1(v) / v) ** 2
    airy[n // 2, n // 2] = np.pi * 50**2 / (0.530 * 5000) ** 2
    assert np.abs(point.values - airy).max() < 1e-4 * airy.max()


def test_a_dot_too_fine_for_its_stop_is_refused_before_the_file_is_read(tmp_path):
    """The file is damaged, which a reader would say first."""
    (tmp_path / "x.gds").write_bytes(b"no mask")
    with pytest.raises(JobError, match="MF115"):
        numbers(tmp_path / "x.gds", dot_um=CAMERA.stop.diameter_um / 6001)
    with pytest.raises(SourceError, match="MF304"):
        numbers(tmp_path / "x.gds", dot_um=CAMERA.stop.diameter_um / 5999)


@pytest.mark.parametrize("layer", ["7/3", "CLEAR"])
def test_the_layer_that_is_named_is_looked_at(tmp_path, layer, reference):
    number = (7, 3) if layer == "7/3" else (1, 0)
    path = drawn(tmp_path / "one.gds", panel(MASK, 10), number)
    same(numbers(path, layer=layer), reference)
    if layer == "7/3":
        same(numbers(path), reference)  # the only layer there is


def test_a_cell_of_several_is_looked_at(tmp_path, reference):
    layout = db.Layout()
    layout.dbu = 0.001
    for name, mask in (("RING", MASK), ("FULL", np.ones((7, 7), dtype=bool))):
        shapes = layout.create_cell(name).shapes(layout.layer(1, 0))
        for polygon in panel(mask, 10):
            shapes.insert(db.Polygon([db.Point(x, y) for x, y in polygon]))
    layout.write(str(tmp_path / "two.oas"))
    same(numbers(tmp_path / "two.oas", cell="RING"), reference)
    assert numbers(tmp_path / "two.oas", cell="FULL")["peak_strehl"] == pytest.approx(1, abs=1e-6)


def test_nothing_in_the_stop_is_told(out, tmp_path):
    frame = [box(0, 0, 900_000, 1000), box(0, 899_000, 900_000, 900_000)]
    with pytest.raises(SourceError, match=r"MF309 .*a stop of 400 um"):
        numbers(drawn(tmp_path / "frame.gds", frame))
    with pytest.raises(SourceError, match=r"MF309 .*layer OUTLINE"):
        numbers(out / "SMALL.gds", layer="10/0")
    with pytest.raises(SourceError, match=r"MF309 .*larger --stop"):
        numbers(out / "SMALL.gds")


# --- what is written -------------------------------------------------------------------------------------------------


def read_exr(path: Path) -> tuple[oiio.ImageSpec, np.ndarray]:
    image = oiio.ImageInput.open(str(path))
    spec, values = image.spec(), image.read_image(oiio.FLOAT)
    image.close()
    return spec, np.asarray(values)[:, :, 0]


def test_psfs_are_written_with_their_step_and_wavelength(capsys, tmp_path):
    path = tmp_path / "lopsided.toml"
    path.write_text(OPENING)
    answer = command(capsys, "analyse", path, *look(wavelengths=["530 nm", "610 nm"]), "--out", tmp_path / "out")
    assert answer.code == 0
    camera = Camera(5000.0, Stop("circle", 400.0), (530.0, 610.0), 2.0, 64.0)
    psfs = analyse(path, Request(camera=camera)).psfs
    assert {(psf.kind, psf.wavelength_nm) for psf in psfs} == {(k, w) for k in ("point", "pixel") for w in (530, 610)}
    names = {f"psf_{psf.kind}_{psf.wavelength_nm:g}nm.exr" for psf in psfs}
    assert {file.name for file in (tmp_path / "out").iterdir()} == names | {"optics.png"}
    for psf in psfs:
        header, values = read_exr(tmp_path / "out" / f"psf_{psf.kind}_{psf.wavelength_nm:g}nm.exr")
        assert header.format.basetype == oiio.FLOAT
        assert header.get_float_attribute("maskfab:step_um") == pytest.approx(psf.step_um, rel=1e-7)
        assert header.get_float_attribute("maskfab:wavelength_nm") == psf.wavelength_nm
        assert header.get_string_attribute("maskfab:kind") == psf.kind
        assert header.get_string_attribute("maskfab:unit") == "1/um^2"
        assert header.get_float_attribute("maskfab:stop_um") == 400
        assert header.get_float_attribute("maskfab:focal_um") == 5000
        assert header.get_string_attribute("maskfab:gutter") == "0 um"
        assert header.get_string_attribute("maskfab:source") == "lopsided.toml"
        assert header.get_string_attribute("maskfab:source_sha256") == sha256_of_file(path)
        assert header.get_string_attribute("Software").startswith(f"maskfab {maskfab.__version__}")
        assert np.array_equal(values[::-1], psf.values.astype(np.float32))
        assert not np.array_equal(values, values[::-1])  # so that upside down would be seen


def test_nothing_is_written_if_the_analysis_fails(capsys, tmp_path):
    path = drawn(tmp_path / "frame.gds", [box(0, 0, 900_000, 1000), box(0, 899_000, 900_000, 900_000)])
    answer = command(capsys, "analyse", path, *LOOK, "--out", tmp_path / "out")
    assert answer.code == 2
    assert {file.name for file in tmp_path.iterdir()} == {"frame.gds"}


def test_a_check_that_fails_is_exit_1_and_its_files_are_there(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("maskfab.findings.optics.READBACK_LIMIT", 0.0)
    path = write_job(tmp_path).parent / "ring.toml"
    answer = command(capsys, "analyse", path, *LOOK, "--out", tmp_path / "out")
    assert answer.code == 1
    assert "FAIL (0" in answer.stdout
    assert (tmp_path / "out" / "optics.png").is_file()


SCENE = ("--scene", '{ gap = "60 um", field = "3 mm", depth = ["100 mm", "inf"], accuracy = 0.4 }')


def test_a_scene_is_analysed_and_drawn(capsys, tmp_path):
    opening = write_job(tmp_path).parent / "ring.toml"
    plain = command(capsys, "analyse", opening, *LOOK, "--json").document["quantities"]
    answer = command(capsys, "analyse", opening, *LOOK, *SCENE, "--out", tmp_path / "out", "--json")
    assert answer.code == 0
    rows = answer.document["quantities"]
    names = [row["name"] for row in rows]
    assert names[: len(plain)] == [row["name"] for row in plain]
    assert {"plan_error_measured", "field_residual", "depth_residual", "nearest_object"} <= set(names[len(plain) :])
    for old, new in zip(plain, rows, strict=False):
        # The panel is larger than without a scene; what the stop shows of it is not.
        assert new["value"] == pytest.approx(old["value"], rel=1e-6, abs=1e-8), old["name"]
    assert {"scene_field.png", "scene_depth.png"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_aberrations_are_taken_one_by_one(capsys, tmp_path):
    opening = write_job(tmp_path).parent / "ring.toml"
    asked = ("--scene", '{ aberrations = [[4, 0.05], [11, -0.02]], accuracy = "draft" }')
    rows = command(capsys, "analyse", opening, *LOOK, *asked, "--json").document["quantities"]
    assert next(row["value"] for row in rows if row["name"] == "scene_psf_change") > 0.01


@pytest.mark.parametrize(
    ("scene", "code"),
    [
        ('aberrations = [[4, "x"]]', "MF105"),
        ("accuracy = 2", "MF104"),
        ('depth = ["1 mm", "inf"]', "MF104"),
        ('spectrum = "none.csv"', "MF301"),
        ('spectrum = "uv"', "MF105"),
        ('illuminant = "6500"', "MF103"),
    ],
)
def test_bad_scenes_are_refused(capsys, tmp_path, scene, code):
    opening = write_job(tmp_path).parent / "ring.toml"
    answer = command(capsys, "analyse", opening, *LOOK, "--scene", f"{{ {scene} }}", "--json")
    assert answer.code == 2
    assert answer.document["error"]["code"] == code
    assert answer.document["error"]["cure"]


def test_a_mask_of_unknown_tiling_is_refused_a_scene(capsys, out):
    answer = command(capsys, "analyse", out / "SMALL.gds", *LOOK, "--scene", '{ gap = "60 um" }', "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF105")
    assert "--tiling" in answer.document["error"]["cure"]
