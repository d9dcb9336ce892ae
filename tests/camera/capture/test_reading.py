"""Frames read back as they were written, and all that is no linear frame refused."""

from __future__ import annotations

import struct
import sys
import zlib
from fractions import Fraction
from importlib.util import find_spec

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
import tifffile
from capture_frames import BLACK, GAIN, READ_NOISE, WHITE, frame, point_light

from maskfab.base.errors import MissingPackageError, SourceError
from maskfab.camera.frames.frame import Frame, frame_of_array, read_frame, read_frames
from maskfab.camera.frames.merge import merged
from maskfab.camera.frames.stack import check_stack

raw_only = pytest.mark.skipif(find_spec("rawpy") is None, reason="RAW files need rawpy, of the extra raw")

if find_spec("rawpy") is not None:
    from dng_files import write_dng

COUNTS = np.random.default_rng(3).integers(60, 4000, (34, 46)).astype(np.uint16)


def refusal(code, *paths, **options):
    with pytest.raises(SourceError) as caught:
        read_frames(paths, **options)
    assert caught.value.code == code, caught.value
    assert caught.value.cure
    return caught.value


def tiff(path, counts=COUNTS, **options):
    tifffile.imwrite(path, counts, photometric="rgb" if counts.ndim == 3 else "minisblack", metadata=None, **options)
    return path


def png(path, counts=COUNTS, chunk=None):
    """A grey PNG of 16 bits, one chunk of the given name and content before its pixels."""

    def of(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in counts)
    head = struct.pack(">IIBBBBB", counts.shape[1], counts.shape[0], 16, 0, 0, 0, 0)
    more = of(*chunk) if chunk else b""
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + of(b"IHDR", head) + more + of(b"IDAT", zlib.compress(rows)) + of(b"IEND", b"")
    )
    return path


def exr(path, values, compression="zip", kind="float"):
    output = oiio.ImageOutput.create(str(path))
    header = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
    header.attribute("compression", compression)
    header.attribute("ExposureTime", 0.125)
    assert output.open(str(path), header)
    assert output.write_image(values.astype(np.float32))
    output.close()
    return path


@raw_only
@pytest.mark.parametrize("time", [Fraction(1, 3), Fraction(1, 8000)])
def test_a_dng_gives_back_all_that_was_written(tmp_path, time):
    write_dng(tmp_path / "a.dng", COUNTS, time=time, black=(64, 65, 66, 67), white=4000, mosaic="grbg", iso=320)
    read = read_frame(tmp_path / "a.dng")
    # One black for all, the largest: counts are shifted to it.
    black = np.tile([[64, 65], [66, 67]], (17, 23))
    assert np.array_equal(read.counts - 67, COUNTS.astype(float) - black)
    assert read.exposure_s == float(time)
    assert read.black == (67,) * 4
    assert (read.white, read.pattern) == (4000, (("G", "R"), ("B", "G")))
    assert read.balance == (2, 1, 1.5)
    assert (read.camera, read.sensitivity) == ("Lab Cam", 320)
    assert len(read.sha256) == 64
    assert read.colour_matrix.shape == (3, 3)
    # White stays white: LibRaw's matrix is of balanced colours.
    assert read.colour_matrix.sum(axis=1) == pytest.approx([1, 1, 1], abs=1e-5)


@raw_only
def test_dng_files_merge_as_the_frames_that_were_drawn(tmp_path):
    draw = np.random.default_rng(1)
    drawn = [frame(point_light(48), time, draw) for time in (1e-3, 1.6e-2)]
    paths = [tmp_path / f"{place}.dng" for place in range(2)]
    for path, each in zip(paths, drawn, strict=True):
        write_dng(path, each.counts, time=Fraction(str(each.exposure_s)), black=int(BLACK), white=int(WHITE))
    sensor = {"electrons_per_count": GAIN, "read_noise_e": READ_NOISE}
    read, known = merged(read_frames(paths), **sensor), merged(drawn, **sensor)
    for one, other in zip(read.planes, known.planes, strict=True):
        assert np.array_equal(one.electrons_per_s, other.electrons_per_s)
        assert np.array_equal(one.sigma, other.sigma)
    assert [each.name for each in read.used] == ["0.dng", "1.dng"]


@raw_only
def test_frames_of_two_cameras_sensitivities_or_sizes_are_refused(tmp_path):
    write_dng(tmp_path / "a.dng", COUNTS)
    for name, counts, options, said in (
        ("camera", COUNTS, {"model": "Other"}, "Lab Other"),
        ("iso", COUNTS, {"iso": 400}, "ISO"),
        ("size", COUNTS[:-2], {}, "size"),
        ("mosaic", COUNTS, {"mosaic": "bggr"}, "mosaic"),
    ):
        write_dng(tmp_path / f"{name}.dng", counts, **options)
        assert said in refusal("MF331", tmp_path / "a.dng", tmp_path / f"{name}.dng").what


@raw_only
def test_raw_files_cut_short_or_of_nonsense_are_refused(tmp_path):
    write_dng(tmp_path / "a.dng", COUNTS)
    whole = (tmp_path / "a.dng").read_bytes()
    for name, content in (("cut", whole[: len(whole) // 2]), ("head", whole[:100]), ("text", b"no picture " * 50)):
        path = tmp_path / f"{name}.dng"
        path.write_bytes(content)
        with pytest.raises(SourceError, match=r"MF30[38]"):
            read_frame(path)


def test_raw_without_rawpy_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rawpy", None)
    (tmp_path / "a.nef").write_bytes(b"content")
    with pytest.raises(MissingPackageError, match=r"MF152 .*a\.nef.*pip install .*\[raw\]'"):
        read_frame(tmp_path / "a.nef")


def test_pictures_of_16_bits_and_floats_are_read_as_counts(tmp_path):
    three = np.stack([COUNTS, COUNTS + 1, COUNTS + 2], axis=-1)
    grey = read_frame(tiff(tmp_path / "grey.tif", compression="deflate"), black=20, white=4095, exposure_s=0.5)
    assert np.array_equal(grey.counts, COUNTS)
    assert (grey.black, grey.white, grey.exposure_s, grey.pattern) == ((20,), 4095, 0.5, None)
    colours = read_frame(tiff(tmp_path / "rgb.tif", three))
    assert np.array_equal(colours.counts, three.transpose(2, 0, 1))
    assert (colours.black, colours.white, colours.exposure_s) == ((0, 0, 0), 65535, None)
    assert np.array_equal(read_frame(png(tmp_path / "a.png")).counts, COUNTS)
    light = read_frame(exr(tmp_path / "a.exr", three / 7))
    assert np.array_equal(light.counts, (three / 7).astype(np.float32).transpose(2, 0, 1))
    assert (light.white, light.exposure_s) == (np.inf, 0.125)


def test_a_mosaic_in_grey_is_one_if_it_is_stated(tmp_path):
    path = tiff(tmp_path / "a.tif")
    read = read_frame(path, mosaic="gbrg", black=64)
    assert (read.pattern, read.black) == ((("G", "B"), ("R", "G")), (64,) * 4)
    blue = read.lattices[1]
    assert (blue.colour, blue.first, blue.step) == ("B", (0, 1), 2)
    assert np.array_equal(blue.of(read.counts), COUNTS[::2, 1::2])
    assert "rggb" in refusal("MF331", path, mosaic="rgbw").cure


def coded(folder):
    eight = (COUNTS >> 4).astype(np.uint8)
    yield tiff(folder / "bytes.tif", eight)
    yield tiff(folder / "stretched.tif", eight.astype(np.uint16) * 257)
    yield png(folder / "srgb.png", chunk=(b"sRGB", b"\0"))
    yield png(folder / "gamma.png", chunk=(b"gAMA", struct.pack(">I", 45455)))
    yield exr(folder / "lossy.exr", COUNTS[:, :, None] / 9, "dwaa")
    for name in ("photo.jpg", "photo.HEIC"):
        (folder / name).write_bytes(b"content")
        yield folder / name


def test_what_is_coded_or_compressed_with_loss_is_refused(tmp_path):
    paths = list(coded(tmp_path))
    assert len(paths) == 7
    for path in paths:
        assert path.name in refusal("MF330", path).what


def test_a_gamma_of_one_is_linear(tmp_path):
    assert np.array_equal(
        read_frame(png(tmp_path / "a.png", chunk=(b"gAMA", struct.pack(">I", 100_000)))).counts, COUNTS
    )


def test_files_that_are_no_frame_are_refused(tmp_path):
    refusal("MF301", tmp_path / "none.tif")
    (tmp_path / "empty.tif").write_bytes(b"")
    refusal("MF302", tmp_path / "empty.tif")
    whole = tiff(tmp_path / "a.tif").read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[:-300])
    refusal("MF303", tmp_path / "cut.tif")
    refusal("MF303", exr(tmp_path / "hole.exr", np.where(COUNTS > 100, COUNTS, np.nan)[:, :, None]))
    refusal("MF308", exr(tmp_path / "alpha.exr", np.ones((4, 4, 4))))


def test_levels_and_times_that_cannot_be_are_refused(tmp_path):
    path = tiff(tmp_path / "a.tif")
    refusal("MF333", path, black=4095, white=4095)
    refusal("MF332", path, times_s=[0.0])
    refusal("MF332", path, times_s=[1.0, 2.0])


@pytest.mark.parametrize(("bits", "white"), [(16, 65535.0), (14, 65532.0), (12, 65520.0)])
def test_levels_of_fewer_bits_that_were_shifted_end_where_the_converter_does(bits, white):
    counts = np.random.default_rng(bits).integers(0, 1 << bits, (32, 32)).astype(np.uint16) << (16 - bits)
    assert frame_of_array(counts, "shifted").white == white


def test_the_black_level_that_is_advised_is_that_of_the_counts():
    random = np.random.default_rng(1)
    light = np.zeros((64, 64))
    light[28:36, 28:36] = 900.0
    frames = []
    for time in (1, 32):
        counts = 16 * np.floor((random.normal(512, 20, light.shape) + time * light) / 16)
        frames.append(Frame(f"{time}.tif", counts.astype(np.float32), (0.0,), 65535.0, exposure_s=1e-3 * time))
    with pytest.raises(SourceError, match="MF333") as caught:
        check_stack(frames)
    advised = float(caught.value.cure.rpartition(" ")[2])
    assert abs(advised - (512 - 8)) < 3
