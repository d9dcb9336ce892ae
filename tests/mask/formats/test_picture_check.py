"""Pictures of a die against the die, with answers that can be had on paper: a pixel is what its share makes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import Die, Opening, Panel, Plate, Tiling
from maskfab.mask.dots import die_edges_nm, die_raster, pixel_overlaps
from maskfab.mask.formats.picture import check_bitmap, check_pixels, write_picture
from maskfab.mask.layout import plate_layout

both = pytest.mark.parametrize("kind", ["png", "tif"])


def one_dot(dots=5, centre_nm=(1_000_001, -7), gutter_nm=0) -> Plate:
    """One cell of 40 um with one clear dot of 8 um in its middle, off the plate's own grid of pixels."""
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[dots // 2, dots // 2] = True
    cells = np.zeros((1, 1), dtype=np.int8)
    panel = Panel(Opening("dot", mask, 8000), 8000, gutter_nm, cells, Tiling.PERIODIC, None)
    die = Die("ONE", "", panel, centre_nm, 100_000)
    return Plate("P", "", 5_000_000, 4_000_000, (die,), (), (), ())


def checked(plate: Plate, path, dots_per_um: float, die: Die | None = None):
    """Wrong pixels, XOR area."""
    wrong, area = check_bitmap(die or plate.dies[0], plate_layout(plate), path, dots_per_um)
    assert (wrong.name, wrong.limit, wrong.passed) == ("bitmap_wrong_pixels", 0, wrong.value == 0)
    assert (area.name, area.unit) == ("bitmap_xor_area", "um^2")
    assert (area.limit, area.passed) in {(None, None), (0, area.value == 0)}
    assert wrong.die == area.die == (die or plate.dies[0]).name
    return wrong, area


def written(plate: Plate, folder, kind: str, dots_per_um: float, die: str = "ONE"):
    path = folder / f"{die}.{kind}"
    write_picture(plate, path, dots_per_um, die=die)
    return path


@both
@pytest.mark.parametrize(
    ("dots_per_um", "area", "limit"),
    [
        (0.125, 0, 0),  # a dot is a pixel
        (0.5, 0, 0),  # a dot is 4 x 4 pixels
        (1.0, 0, 0),
        (0.1, 64, None),  # four pixels of 100 um2 have 16 um2 each: all dark, and the dot is lost
        (0.2, 4 * 25 - 64, None),  # four pixels of 25 um2 have 16 um2 each: all white, and 36 um2 too much
    ],
)
def test_one_dot(tmp_path, kind, dots_per_um, area, limit):
    plate = one_dot()
    wrong, found = checked(plate, written(plate, tmp_path, kind, dots_per_um), dots_per_um)
    assert (found.value, found.limit) == (pytest.approx(area), limit)
    assert wrong.passed


@both
@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("dots_per_um", [0.125, 0.2, 0.25, 0.3])
def test_every_pixel_is_off_by_its_smaller_share(small_plate, tmp_path, kind, number, dots_per_um):
    die = small_plate.dies[number]
    path = written(small_plate, tmp_path, kind, dots_per_um, die.name)
    wrong, found = checked(small_plate, path, dots_per_um, die)
    assert wrong.passed
    if dots_per_um == 0.3:
        return  # whose borders lie between nanometres
    share = shares(die, dots_per_um)
    assert found.value == pytest.approx(np.minimum(share, 1 - share).sum() / dots_per_um**2, rel=1e-9, abs=1e-6)
    if die.panel.dot_nm == 8000 and dots_per_um == 0.25:
        assert (found.value, found.passed) == (0, True)
    else:
        assert found.passed is None
        assert found.value > 0


def shares(die: Die, dots_per_um: float):
    """The clear share of every pixel, without the layout."""
    pixel, (x0, y0, x1, y1) = 1000 / dots_per_um, die.box_nm
    x, y = die_edges_nm(die)
    across, up = (np.ceil(side / pixel - 1e-6) for side in (x1 - x0, y1 - y0))
    return (
        pixel_overlaps(y, y0 + pixel * np.arange(up + 1))
        @ die_raster(die)
        @ pixel_overlaps(x, x0 + pixel * np.arange(across + 1)).T
    )


def changed(path, target, place, value):
    with Image.open(path) as image:
        copy = image.copy()
        copy.putpixel(place, value)
        copy.save(target, dpi=image.info["dpi"])


@both
@pytest.mark.parametrize("dots_per_um", [0.5, 0.2, 0.3])
def test_one_wrong_pixel_is_found_whatever_the_pixels(tmp_path, kind, dots_per_um):
    plate = one_dot()
    path = written(plate, tmp_path, kind, dots_per_um)
    with Image.open(path) as image:
        width, height = image.size
        values = {
            place: image.getpixel(place) for place in ((0, 0), (width - 1, height - 1), (width // 2, height // 2))
        }
    for place, value in values.items():
        changed(path, tmp_path / f"wrong.{kind}", place, 0 if value > 127 else 255)
        wrong, area = checked(plate, tmp_path / f"wrong.{kind}", dots_per_um)
        assert wrong.value == 1
        if dots_per_um == 0.5:
            assert (area.value, area.passed) == (pytest.approx(4), False)


def test_a_grey_that_is_off_by_one_level_is_found(tmp_path):
    plate = one_dot()
    path = written(plate, tmp_path, "png", 0.2)
    with Image.open(path) as image:
        place = next((x, y) for x in range(8) for y in range(8) if 0 < image.getpixel((x, y)) < 255)
        value = image.getpixel(place)
    assert value == round(255 * 16 / 25)
    for other, expected in ((value, 0), (value + 1, 1), (value - 1, 1)):
        changed(path, tmp_path / "grey.png", place, other)
        assert checked(plate, tmp_path / "grey.png", 0.2)[0].value == expected


@both
def test_a_pixel_that_is_half_clear_is_white(tmp_path, kind):
    """A gutter of 8 um shifts the dots by half a pixel of 8 um, so that a bar is two rows of halves."""
    plate = one_dot(gutter_nm=8000)
    (die,) = plate.dies
    bar = np.zeros((5, 5), dtype=np.bool_)
    bar[2] = True
    panel = replace(die.panel, opening=Opening("bar", bar, 8000))
    plate = replace(plate, dies=(replace(die, panel=panel),))
    path = written(plate, tmp_path, kind, 0.125)
    with Image.open(path) as image:
        levels = np.asarray(image.convert("L"))
    assert sorted(set(levels.ravel().tolist())) == ([0, 64, 128] if kind == "png" else [0, 255])
    assert np.count_nonzero(levels >= 128) == 2 * 4
    assert checked(plate, path, 0.125)[0].passed


def test_a_picture_whose_pixels_are_larger_than_a_feature_is_refused():
    check_pixels((), 1e-6, "job")
    dies = one_dot().dies
    for enough in (0.125, 0.2, 100.0):
        check_pixels(dies, enough, "job")
    with pytest.raises(JobError) as caught:
        check_pixels(dies, 0.0625, "job")
    for said in ("MF104", "0.0625", "16 um", "8 um", "die ONE", "job: export.dots_per_um", "at least 0.125"):
        assert said in str(caught.value)


@pytest.mark.parametrize(
    ("gutter_nm", "cure"),
    [
        (2, "Leave png and tiff out of export.formats: it would take 500,"),
        (20, "Set it to at least 50"),
        (14, "71.4286"),
    ],
)
def test_the_cure_of_pixels_is_one_that_a_job_may_state(gutter_nm, cure):
    """Gutters this narrow ask for more pixels than any picture may have, to show them or to follow every dot."""
    (die,) = one_dot(gutter_nm=gutter_nm).dies
    facing = replace(die.panel, opening=Opening("all", np.ones((5, 5), np.bool_), 8000))
    narrow = replace(die, panel=replace(facing, orientations=np.zeros((2, 2), dtype=np.int8)))
    with pytest.raises(JobError) as caught:
        check_pixels((narrow,), 0.125, "job")
    assert cure in caught.value.cure
    assert ("follow" in caught.value.cure) == (gutter_nm == 20)


def test_the_coarsest_picture_that_is_told_is_taken():
    """Dots of 7 um: 1/7 is rounded up, or it would be refused again. Gutters count where dots face each other."""
    (die,) = one_dot().dies
    dots = replace(die, panel=replace(die.panel, dot_nm=7000))
    with pytest.raises(JobError, match=r"at least 0\.142858") as caught:
        check_pixels((die, dots), 0.1, "job")
    check_pixels((die, dots), 0.142858, "job")
    assert "from 1 on pixels can follow every dot" in str(caught.value)
    full = replace(die.panel, opening=Opening("all", np.ones((5, 5), np.bool_), 8000), gutter_nm=4000)
    faced = replace(die, panel=replace(full, orientations=np.zeros((2, 2), dtype=np.int8)))
    with pytest.raises(JobError, match=r"4 um.*at least 0\.25; from 0\.5 on"):
        check_pixels((faced,), 0.2, "job")
    alone = replace(die, panel=full)  # no gutter lies between two dots
    check_pixels((alone,), 0.2, "job")


@both
@pytest.mark.parametrize("turn", [Image.Transpose.FLIP_LEFT_RIGHT, Image.Transpose.FLIP_TOP_BOTTOM], ids=str)
def test_a_mirrored_picture_is_found(small_plate, tmp_path, kind, turn):
    path = written(small_plate, tmp_path, kind, 0.25, "RANDOM")
    with Image.open(path) as image:
        image.transpose(turn).save(tmp_path / f"turned.{kind}", dpi=image.info["dpi"])
    assert not checked(small_plate, tmp_path / f"turned.{kind}", 0.25, small_plate.dies[2])[0].passed


@both
@pytest.mark.parametrize("dots_per_um", [0.5, 0.2])
@pytest.mark.parametrize("factor", [0.5, 1.02])
def test_a_picture_of_another_resolution_is_found_by_its_tags(tmp_path, kind, dots_per_um, factor):
    plate = one_dot()
    path = written(plate, tmp_path, kind, dots_per_um)
    with Image.open(path) as image:
        image.save(tmp_path / f"coarse.{kind}", dpi=tuple(value * factor for value in image.info["dpi"]))
        pixels = image.width * image.height
    wrong, _ = checked(plate, tmp_path / f"coarse.{kind}", dots_per_um)
    assert wrong.value == pixels
    assert f"the design has {image.width} x {image.height}, {dots_per_um} to the um" in wrong.method


@both
def test_where_the_die_lies_does_not_matter(tmp_path, kind):
    areas = set()
    for centre in ((0, 0), (1_000_001, -7), (-1_234_567, 890_123)):
        plate = one_dot(centre_nm=centre)
        areas.add(round(checked(plate, written(plate, tmp_path, kind, 0.2), 0.2)[1].value, 9))
    assert areas == {36}


def test_a_picture_of_another_die_is_found(small_plate, tmp_path):
    path = written(small_plate, tmp_path, "tif", 0.25, "PERIODIC")
    assert not checked(small_plate, path, 0.25, small_plate.dies[2])[0].passed


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
    wrong, area = checked(replace(plate, dies=(other,)), path, 0.5)
    assert area.value == pytest.approx(2 * 64)
    assert wrong.value == 2 * 16
