"""Pictures of a die against the die, with answers that can be had on paper: a pixel goes to its nearer side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from maskfab.errors import SourceError
from maskfab.export.bitmap import write_bilevel, write_preview
from maskfab.geometry.die_grid import die_edges_nm, die_raster, overlaps
from maskfab.geometry.region import plate_layout
from maskfab.model import Die, Opening, Panel, Plate, Tiling
from maskfab.validate.bitmaps import check_bitmap

WRITERS = {"png": write_preview, "tif": write_bilevel}
both = pytest.mark.parametrize("kind", WRITERS)


def one_dot(dots=5, centre_nm=(1_000_001, -7)) -> Plate:
    """One cell of 40 um with one clear dot of 8 um in its middle, off the plate's own grid of pixels."""
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[dots // 2, dots // 2] = True
    panel = Panel(Opening("dot", mask, 8000), 8000, 0, np.zeros((1, 1), dtype=np.int8), Tiling.PERIODIC, None)
    die = Die("ONE", "", panel, centre_nm, 100_000)
    return Plate("P", "", 5_000_000, 4_000_000, (die,), (), (), ())


def checked(plate: Plate, path, dots_per_um: float, die: Die | None = None):
    (row,) = check_bitmap(die or plate.dies[0], plate_layout(plate), path, dots_per_um)
    assert (row.name, row.unit) == ("bitmap_xor_area", "um^2")
    assert row.passed is (row.value <= row.limit * (1 + 1e-9))
    return row


def written(plate: Plate, folder, kind: str, dots_per_um: float, die: str = "ONE"):
    path = folder / f"{die}.{kind}"
    WRITERS[kind](plate, path, dots_per_um, die=die)
    return path


@both
@pytest.mark.parametrize(
    ("dots_per_um", "area", "limit"),
    [
        (0.125, 0, 0),  # a dot is a pixel
        (0.5, 0, 0),  # a dot is 4 x 4 pixels
        (1.0, 0, 0),
        (0.1, 64, 4 * 100 / 2),  # four pixels of 100 um2 have 16 um2 each: all dark, and the dot is lost
        (0.2, 4 * 25 - 64, 4 * 25 / 2),  # four pixels of 25 um2 have 16 um2 each: all white, and 36 um2 too much
    ],
)
def test_one_dot(tmp_path, kind, dots_per_um, area, limit):
    plate = one_dot()
    row = checked(plate, written(plate, tmp_path, kind, dots_per_um), dots_per_um)
    assert (row.value, row.limit) == (pytest.approx(area), pytest.approx(limit))
    assert row.passed


@both
@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("dots_per_um", [0.125, 0.2, 0.25])
def test_every_pixel_is_off_by_its_smaller_share(small_plate, tmp_path, kind, number, dots_per_um):
    die = small_plate.dies[number]
    row = checked(small_plate, written(small_plate, tmp_path, kind, dots_per_um, die.name), dots_per_um, die)
    pixel, (x0, y0, x1, y1) = 1000 / dots_per_um, die.box_nm
    x, y = die_edges_nm(die)
    across, up = (np.ceil(side / pixel - 1e-6) for side in (x1 - x0, y1 - y0))
    share = (
        overlaps(y, y0 + pixel * np.arange(up + 1))
        @ die_raster(die)
        @ overlaps(x, x0 + pixel * np.arange(across + 1)).T
    )
    assert row.value == pytest.approx(np.minimum(share, 1 - share).sum() / dots_per_um**2, rel=1e-9, abs=1e-6)
    assert row.passed
    assert row.die == die.name
    if die.panel.dot_nm == 8000 and dots_per_um == 0.25:
        assert (row.value, row.limit) == (0, 0)
    else:
        assert 0 < row.value < row.limit


@both
def test_one_wrong_pixel_is_found_where_pixels_follow_the_dots(tmp_path, kind):
    plate = one_dot()
    path = written(plate, tmp_path, kind, 0.5)
    for place in ((0, 0), (19, 19), (9, 11)):
        with Image.open(path) as image:
            changed = image.copy()
            changed.putpixel(place, 0 if image.getpixel(place) else 255)
            changed.save(tmp_path / f"wrong.{kind}", dpi=image.info["dpi"])
        row = checked(plate, tmp_path / f"wrong.{kind}", 0.5)
        assert (row.value, row.limit, row.passed) == (pytest.approx(4), 0, False)


@both
@pytest.mark.parametrize("turn", [Image.Transpose.FLIP_LEFT_RIGHT, Image.Transpose.FLIP_TOP_BOTTOM], ids=str)
def test_a_mirrored_picture_is_found(small_plate, tmp_path, kind, turn):
    path = written(small_plate, tmp_path, kind, 0.25, "RANDOM")
    with Image.open(path) as image:
        image.transpose(turn).save(tmp_path / f"turned.{kind}", dpi=image.info["dpi"])
    assert checked(small_plate, tmp_path / f"turned.{kind}", 0.25, small_plate.dies[2]).passed is False


@both
def test_a_picture_of_another_resolution_is_found_by_its_tags(tmp_path, kind):
    plate = one_dot()
    path = written(plate, tmp_path, kind, 0.5)
    with Image.open(path) as image:
        image.save(tmp_path / f"coarse.{kind}", dpi=tuple(value / 2 for value in image.info["dpi"]))
    assert checked(plate, tmp_path / f"coarse.{kind}", 0.5).passed is False


@both
def test_where_the_die_lies_does_not_matter(tmp_path, kind):
    areas = set()
    for centre in ((0, 0), (1_000_001, -7), (-1_234_567, 890_123)):
        plate = one_dot(centre_nm=centre)
        areas.add(round(checked(plate, written(plate, tmp_path, kind, 0.2), 0.2).value, 9))
    assert areas == {36}


def test_a_picture_of_another_die_is_found(small_plate, tmp_path):
    path = written(small_plate, tmp_path, "tif", 0.25, "PERIODIC")
    assert checked(small_plate, path, 0.25, small_plate.dies[2]).passed is False


@pytest.mark.parametrize(("content", "code"), [(None, "MF301"), (b"", "MF302"), (b"no picture", "MF304")])
def test_what_is_no_picture_is_refused(tmp_path, content, code):
    plate, path = one_dot(), tmp_path / "x.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SourceError) as caught:
        checked(plate, path, 0.5)
    assert caught.value.code == code


def test_a_picture_without_tags_is_refused(tmp_path):
    plate = one_dot()
    with Image.open(written(plate, tmp_path, "png", 0.5)) as image:
        Image.fromarray(np.asarray(image)).save(tmp_path / "bare.png")
    with pytest.raises(SourceError, match="MF314"):
        checked(plate, tmp_path / "bare.png", 0.5)


def test_a_closed_die_is_dark(tmp_path):
    plate = one_dot()
    (die,) = plate.dies
    path = written(plate, tmp_path, "png", 0.5)
    dark = np.zeros_like(die.panel.opening.mask)
    dark[0, 0] = True  # no opening is closed everywhere
    other = replace(die, panel=replace(die.panel, opening=replace(die.panel.opening, mask=dark)))
    row = checked(replace(plate, dies=(other,)), path, 0.5)
    assert row.value == pytest.approx(2 * 64)
