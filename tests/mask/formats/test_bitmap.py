from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from maskfab.base.errors import OutputError
from maskfab.base.model import CLEAR
from maskfab.mask.dots import die_edges_nm, die_raster, pixel_overlaps
from maskfab.mask.formats.picture import bitmap_size, write_picture
from maskfab.mask.layout import plate_layout, region
from maskfab.mask.raster import coverage


def pixels(path):
    """Row 0 lowest, through a library that did not write it."""
    with Image.open(path) as image:
        return np.asarray(image)[::-1], image.mode, image.info


def test_dots_as_pixels_are_the_die(small_plate, tmp_path):
    die = small_plate.dies[2]
    written = write_picture(small_plate, tmp_path / "x.tif", 0.25, die=die.name)
    found, mode, info = pixels(tmp_path / "x.tif")
    x, y = die_edges_nm(die)
    wide, high = (np.rint(np.diff(edges) / 4000).astype(int) for edges in (x, y))
    assert np.array_equal(found, die_raster(die).repeat(high, axis=0).repeat(wide, axis=1))
    assert mode == "1"
    assert info["dpi"] == pytest.approx((0.25 * 25_400,) * 2)
    assert written.partly == 0
    assert (written.width, written.height) == found.shape[::-1]


@pytest.mark.parametrize("dots_per_um", [0.013, 0.1])
def test_a_preview_is_the_share_of_every_pixel(small_plate, tmp_path, dots_per_um):
    written = write_picture(small_plate, tmp_path / "x.png", dots_per_um)
    found, mode, info = pixels(tmp_path / "x.png")
    half = small_plate.blank_nm // 2
    edges = -half + np.arange(written.width + 1) * 1000 / dots_per_um
    expected = coverage(region(plate_layout(small_plate), CLEAR), edges, edges)
    assert np.abs(found - expected * 255).max() <= 0.5 + 1e-6
    assert mode == "L"
    assert info["dpi"][0] == pytest.approx(dots_per_um * 25_400, rel=1e-3)
    assert written.partly == np.count_nonzero((expected > 1e-9) & (expected < 1 - 1e-9))


def test_bands_meet_without_a_seam(small_plate, tmp_path, monkeypatch):
    write_picture(small_plate, tmp_path / "x.png", 0.05)
    monkeypatch.setattr("maskfab.mask.formats.picture._BAND_PIXELS", 500 * 7)
    write_picture(small_plate, tmp_path / "bands.png", 0.05)
    assert np.array_equal(pixels(tmp_path / "x.png")[0], pixels(tmp_path / "bands.png")[0])


def test_a_pixel_is_white_from_one_half_on(small_plate, tmp_path):
    grey = write_picture(small_plate, tmp_path / "x.png", 0.1, die="DENSE")
    write_picture(small_plate, tmp_path / "x.tif", 0.1, die="DENSE")
    shares, bits = pixels(tmp_path / "x.png")[0], pixels(tmp_path / "x.tif")[0]
    clear = shares != 127  # the one level that rounding leaves undecided
    assert np.array_equal(bits[clear], (shares > 127)[clear])
    assert grey.partly > 0


@pytest.mark.parametrize("name", ["x.png", "x.tif"])
def test_they_say_what_they_are(small_plate, tmp_path, name):
    write_picture(small_plate, tmp_path / name, 0.02, ["job 0123"])
    data = (tmp_path / name).read_bytes()
    assert b"job 0123; 0.02 dots per um; white is clear in the chrome" in data
    assert b"maskfab" in data


def test_the_date_of_a_tiff_is_one_as_the_format_asks(small_plate, tmp_path):
    """TIFF 6.0: 19 characters, YYYY:MM:DD HH:MM:SS."""
    write_picture(small_plate, tmp_path / "x.tif", 0.02)
    with Image.open(tmp_path / "x.tif") as read:
        assert re.fullmatch(r"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d", read.tag_v2[306])


@pytest.mark.parametrize("dots_per_um", [0.0, -1.0, float("nan"), float("inf")])
def test_no_dots(small_plate, tmp_path, dots_per_um):
    with pytest.raises(OutputError, match="MF413"):
        write_picture(small_plate, tmp_path / "x.png", dots_per_um)


def test_bad_requests(small_plate, tmp_path):
    with pytest.raises(OutputError, match="MF415"):
        write_picture(small_plate, tmp_path / "x.tif", 100.0)
    with pytest.raises(KeyError, match="NOBODY"):
        write_picture(small_plate, tmp_path / "x.png", 0.01, die="NOBODY")
    assert not list(tmp_path.iterdir())


def test_sizes(small_plate):
    assert bitmap_size(small_plate, 0.1) == (1000, 1000)
    assert bitmap_size(small_plate, 0.1000001) == (1001, 1001)
    assert bitmap_size(replace(small_plate, blank_nm=1), 0.1) == (1, 1)


def test_overlaps_share_every_interval_out():
    edges, grid = np.array([0.0, 3.0, 7.0, 10.0]), np.array([-2.0, 1.0, 4.0, 6.0, 20.0])
    shares = pixel_overlaps(edges, grid).toarray() * np.diff(grid)[:, None]
    assert np.allclose(shares.sum(axis=0), np.diff(edges), atol=1e-9)
    assert np.allclose(pixel_overlaps(edges, edges).toarray(), np.eye(3))
    assert pixel_overlaps(edges, grid + 100).nnz == 0
