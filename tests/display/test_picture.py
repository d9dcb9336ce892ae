"""Photographs of every kind become the same light; what is none is refused."""

from __future__ import annotations

import struct

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from PIL import Image, ImageOps

from maskfab.base.errors import JobError, OpeningError, SourceError
from maskfab.display.pictures import LARGEST, Picture, on_pixels, read_picture
from maskfab.mask.opening_masks import from_image


def save(path, pixels, kind, **attributes):
    height, width, channels = pixels.shape
    header = oiio.ImageSpec(width, height, channels, kind)
    for name, value in attributes.items():
        header.attribute(name.replace("_", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), header)
    assert output.write_image(np.ascontiguousarray(pixels))
    assert output.close()
    return path


def codes(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


LIGHT = np.random.default_rng(0).random((6, 9, 3))


@pytest.mark.parametrize(
    ("suffix", "kind", "tolerance"),
    [("png", "uint8", 5e-3), ("png", "uint16", 2e-5), ("tif", "uint16", 2e-5), ("tif", "float", 1e-6),
     ("exr", "half", 1e-3), ("exr", "float", 1e-6)],
)  # fmt: skip
def test_all_depths_are_the_same_light(tmp_path, suffix, kind, tolerance):
    stored = LIGHT if kind in ("half", "float") else codes(LIGHT)
    if kind in ("uint8", "uint16"):
        dtype = np.dtype(kind)
        stored = (stored * np.iinfo(dtype).max).round().astype(dtype)
    else:
        stored = stored.astype(np.float32)
    found = on_pixels(read_picture(save(tmp_path / f"a.{suffix}", stored, kind)), 6, 9)
    np.testing.assert_allclose(found, LIGHT[::-1], atol=tolerance)  # row 0 is the lowest


def test_grey_is_grey_and_transparent_is_black(tmp_path):
    grey = (np.full((4, 4, 1), 188)).astype(np.uint8)
    np.testing.assert_allclose(
        on_pixels(read_picture(save(tmp_path / "g.png", grey, "uint8")), 2, 2), 0.502886, atol=1e-5
    )
    veiled = np.concatenate([grey, np.full_like(grey, 102)], axis=2)
    found = on_pixels(read_picture(save(tmp_path / "ga.png", veiled, "uint8", oiio_UnassociatedAlpha=1)), 2, 2)
    np.testing.assert_allclose(found, 0.502886 * 0.4, atol=1e-5)
    colour = np.concatenate([np.repeat(grey, 3, axis=2), np.full_like(grey, 102)], axis=2)
    found = on_pixels(read_picture(save(tmp_path / "rgba.png", colour, "uint8", oiio_UnassociatedAlpha=1)), 2, 2)
    np.testing.assert_allclose(found, 0.502886 * 0.4, atol=1e-5)
    linear = np.broadcast_to(np.float32([0.2, 0.1, 0.4, 0.5]), (3, 3, 4))
    found = on_pixels(read_picture(save(tmp_path / "a.exr", linear, "float")), 3, 3)
    np.testing.assert_allclose(found, np.broadcast_to([0.2, 0.1, 0.4], (3, 3, 3)), atol=1e-6)


def test_palettes_are_looked_up(tmp_path):
    """A PNG of two palette entries, written by hand."""
    import struct
    import zlib

    def chunk(tag, data):
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))

    header = struct.pack(">IIBBBBB", 2, 1, 8, 3, 0, 0, 0)
    body = (b"IHDR", header), (b"PLTE", bytes([255, 0, 0, 0, 0, 255])), (b"IDAT", zlib.compress(b"\0\0\1"))
    path = tmp_path / "p.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in (*body, (b"IEND", b""))))
    np.testing.assert_allclose(on_pixels(read_picture(path), 1, 2)[0], [[1, 0, 0], [0, 0, 1]], atol=1e-12)


def picture(values):
    return Picture(np.asarray(values, dtype=np.float32), coded=False, associated=True, where="here")


def test_pixels_are_exact_means_of_fractions_in_linear_light():
    """Seven elements on three pixels: each is two and a third of them."""
    row = np.arange(7) / 8
    found = on_pixels(picture(np.broadcast_to(row[None, :, None], (7, 7, 1))), 3, 3)[0, :, 0]
    expected = np.array([0 + 1 + 2 / 3, 2 * 2 / 3 + 3 + 4 * 2 / 3, 4 / 3 + 5 + 6]) / 8 / (7 / 3)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_the_mean_of_the_light_is_kept_and_wide_pictures_are_cut_in_the_middle():
    values = np.random.default_rng(3).random((11, 11, 3))
    np.testing.assert_allclose(
        on_pixels(picture(values), 4, 4).mean(axis=(0, 1)), np.float32(values).mean(axis=(0, 1)), rtol=1e-6
    )
    wide = np.zeros((2, 6, 1))
    wide[:, 2:4] = 1.0
    np.testing.assert_allclose(on_pixels(picture(wide), 4, 4), 1.0)


def test_a_picture_smaller_than_the_display_is_magnified_exactly():
    values = np.array([[0.0, 1.0], [0.5, 0.25]])[:, :, None]
    found = on_pixels(picture(values), 3, 3)[::-1, :, 0]
    np.testing.assert_allclose(found[0], [0, 0.5, 1])
    np.testing.assert_allclose(found[1, 1], 0.4375)


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.5, 3.0])
def test_light_that_no_display_gives_is_refused(value):
    values = np.full((3, 3, 3), 0.5)
    values[1, 1, 1] = value
    with pytest.raises(JobError, match="MF121"):
        on_pixels(picture(values), 2, 2)


def test_files_that_are_no_pictures_are_refused(tmp_path):
    with pytest.raises(SourceError, match="MF301"):
        read_picture(tmp_path / "none.png")
    empty = tmp_path / "empty.png"
    empty.touch()
    with pytest.raises(SourceError, match="MF302"):
        read_picture(empty)
    text = tmp_path / "text.png"
    text.write_text("no picture at all")
    with pytest.raises(SourceError, match=r"MF30[38]"):
        read_picture(text)
    good = save(tmp_path / "a.png", np.random.default_rng(1).integers(0, 255, (64, 64, 3), dtype=np.uint8), "uint8")
    good.write_bytes(good.read_bytes()[:3000])
    with pytest.raises(SourceError, match="MF303"):
        read_picture(good)


@pytest.mark.parametrize("reading", [read_picture, from_image])
def test_a_header_that_is_no_text_is_refused(tmp_path, reading):
    good = save(tmp_path / "a.exr", np.ones((6, 6, 1)), "half")
    good.write_bytes(good.read_bytes().replace(b"chlist\0", b"chli\xfft\0", 1))
    with pytest.raises(SourceError, match=r"MF30[38].*no text"):
        reading(good)


@pytest.mark.parametrize("reading", [read_picture, from_image])
def test_a_picture_of_many_channels_is_refused_before_it_is_read(tmp_path, reading):
    good = save(tmp_path / "a.exr", np.ones((6, 6, 40)), "half")
    with pytest.raises((JobError, OpeningError), match="40 channels"):
        reading(good)


def test_a_huge_picture_is_refused_before_it_is_read(tmp_path):
    import struct
    import zlib

    header = struct.pack(">IIBBBBB", LARGEST, 2, 8, 0, 0, 0, 0)
    path = tmp_path / "huge.png"
    part = b"IHDR" + header
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + part + struct.pack(">I", zlib.crc32(part)))
    with pytest.raises((JobError, SourceError), match=r"MF121|MF308"):
        read_picture(path)


def test_a_palette_of_bytes_times_256_shows_the_colours_that_its_writer_meant(tmp_path):
    """As Pillow writes them, where white would come out as 65280 of 65535."""
    colours = np.random.default_rng(2).integers(256, size=(256, 3), dtype=np.uint8)
    colours[0], colours[-1] = 0, 255
    picture = Image.fromarray(np.arange(256, dtype=np.uint8).reshape(16, 16), "P")
    picture.putpalette(colours.ravel().tolist())
    picture.save(tmp_path / "p.tif")
    picture.convert("RGB").save(tmp_path / "p.png")
    expected, found = (on_pixels(read_picture(tmp_path / name), 16, 16) for name in ("p.png", "p.tif"))
    assert found.max() == 1
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_a_tiff_that_does_not_say_what_is_white_is_refused(tmp_path):
    Image.fromarray(np.full((3, 3), 200, dtype=np.uint8)).save(tmp_path / "g.tif")
    written, tag = (tmp_path / "g.tif").read_bytes(), struct.pack("<HHI", 262, 3, 1)
    assert written.count(tag) == 1
    (tmp_path / "u.tif").write_bytes(written.replace(tag, struct.pack("<HHI", 263, 3, 1)))
    assert read_picture(tmp_path / "g.tif").values.shape == (3, 3, 1)
    with pytest.raises(SourceError) as caught:
        read_picture(tmp_path / "u.tif")
    assert caught.value.code == "MF318"


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_picture_is_seen_as_its_tag_turns_it_and_as_pillow_shows_it(tmp_path, suffix, orientation):
    drawn = np.random.default_rng(0).integers(0, 255, (4, 6, 3)).astype(np.uint8)
    path = tmp_path / f"x.{suffix}"
    header = oiio.ImageSpec(6, 4, 3, "uint8")
    header.attribute("Orientation", orientation)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), header)
    assert output.write_image(drawn)
    output.close()
    shown = np.asarray(ImageOps.exif_transpose(Image.open(path)))
    assert np.allclose(read_picture(path).values, shown / 255, atol=1e-6)
    assert np.allclose(read_picture(path, upright=False).values, drawn / 255, atol=1e-6)
