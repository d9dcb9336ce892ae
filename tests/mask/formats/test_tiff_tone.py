"""A TIFF is read only if it says which of its values is white; what readers show differently is refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import tifffile
from PIL import Image

from maskfab.base.errors import OpeningError, SourceError
from maskfab.camera.frames.frame import read_frame
from maskfab.display.pictures import read_picture
from maskfab.mask.formats.picture import read_levels
from maskfab.mask.opening_masks import from_image

PIXELS = bytes([255, 0, 0, 255, 255, 0, 0, 0, 255])
SHORT = 3


def tiff(path, *stated, order="<", big=False, pixels=PIXELS):
    """A picture of 3 x 3 grey pixels with further tags (tag, values); what has no room in its row stands apart."""
    tags = {256: [3], 257: [3], 258: [8], 259: [1], 273: [0], 277: [1], 278: [3], 279: [len(pixels)]}
    tags |= {tag: values for tag, values in stated if tag in tags}
    rows = sorted([*tags.items(), *(row for row in stated if row[0] not in tags)])
    entry, room, word = (20, 8, "Q") if big else (12, 4, "I")
    start = 16 if big else 8
    apart = start + (8 if big else 2) + entry * len(rows) + room
    body = b""
    for tag, values in rows:
        if 2 * len(values) > room and tag != 273:
            body += struct.pack(f"{order}{len(values)}H", *values)
    table, placed = b"", apart
    for tag, values in rows:
        held = struct.pack(f"{order}{len(values)}H", *(values if tag != 273 else [apart + len(body)]))
        if len(held) > room:
            held, placed = struct.pack(order + word, placed), placed + len(held)
        table += struct.pack(order + "HH" + word, tag, SHORT, len(values)) + held.ljust(room, b"\0")
    head = {"<": b"II", ">": b"MM"}[order]
    head += struct.pack(order + "HHHQ", 43, 8, 0, 16) if big else struct.pack(order + "HI", 42, 8)
    count = struct.pack(order + ("Q" if big else "H"), len(rows))
    path.write_bytes(head + count + table + bytes(room) + body + pixels)
    return path


def refusal(read, path) -> str:
    with pytest.raises(SourceError) as caught:
        read(path)
    assert path.name in str(caught.value)
    return caught.value.code


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(("photometric", "white"), [(0, 0), (1, 255)])
def test_a_tiff_that_says_what_is_white_is_read_as_it_says(tmp_path, order, big, photometric, white):
    levels, _ = read_levels(tiff(tmp_path / "x.tif", (262, [photometric]), order=order, big=big))
    assert np.array_equal(levels.ravel() == 255, np.frombuffer(PIXELS, np.uint8) == white)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32, np.float32, np.float64])
@pytest.mark.parametrize("photometric", [0, 1])
def test_what_is_white_is_so_at_every_depth(tmp_path, photometric, kind, order):
    """OpenImageIO turns a picture in which 0 is white up to 8 bits alone."""
    drawn = np.array([[1, 0, 0], [1, 1, 0], [0, 0, 1]], bool)
    white = 1 if np.dtype(kind).kind == "f" else np.iinfo(kind).max
    tifffile.imwrite(
        tmp_path / "x.tif", (drawn * white).astype(kind), photometric=photometric, byteorder=order, metadata=None
    )
    seen = drawn if photometric else ~drawn
    assert np.array_equal(from_image(tmp_path / "x.tif"), seen[::-1])
    assert np.array_equal(read_levels(tmp_path / "x.tif")[0], seen * 255)
    assert np.array_equal(read_picture(tmp_path / "x.tif").values[..., 0], seen)


def test_a_frame_in_which_0_is_white_is_turned_or_refused_where_nothing_is_black(tmp_path):
    counts = np.arange(12, dtype=np.uint16).reshape(3, 4) * 5000
    tifffile.imwrite(tmp_path / "x.tif", counts, photometric=0)
    assert np.array_equal(read_frame(tmp_path / "x.tif").counts, 65535.0 - counts)
    tifffile.imwrite(tmp_path / "y.tif", counts.astype(np.float32), photometric=0)
    assert refusal(read_frame, tmp_path / "y.tif") == "MF318"


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_opacity_beside_samples_in_which_0_is_white_is_refused(tmp_path, kind):
    """OpenImageIO turns it, too."""
    pixels = np.full((3, 3, 2), np.iinfo(kind).max, kind)
    tifffile.imwrite(tmp_path / "x.tif", pixels, photometric=0, planarconfig="contig", extrasamples=["unassalpha"])
    assert refusal(from_image, tmp_path / "x.tif") == "MF318"


def test_an_opening_of_floats_that_reach_beyond_white_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "x.tif", np.float32([[0, 100], [255, 0]]))
    with pytest.raises(OpeningError, match="between 0"):
        from_image(tmp_path / "x.tif")


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("order", "<>")
def test_a_tiff_of_unsaid_tone_is_refused_as_mask_and_as_opening(tmp_path, order, big):
    path = tiff(tmp_path / "x.tif", order=order, big=big)
    assert refusal(read_levels, path) == refusal(from_image, path) == "MF318"


def test_two_readers_show_a_tiff_of_unsaid_tone_differently(tmp_path):
    """Why it is refused."""
    unsaid, black = tiff(tmp_path / "x.tif"), tiff(tmp_path / "y.tif", (262, [1]))
    first, second = (np.asarray(Image.open(path)) for path in (unsaid, black))
    assert np.array_equal(first, ~second)


@pytest.mark.parametrize(
    "stated",
    [
        [(262, [1]), (262, [0])],
        [(262, [1, 0])],
        [(262, [])],
        [(262, [2])],
        [(262, [4])],
        [(262, [5])],
        [(262, [6])],
        [(262, [1]), (339, [2])],
        [(262, [2]), (277, [3]), (339, [1, 1, 2])],
    ],
    ids=["twice", "two values", "no value", "RGB of one", "a mask", "CMYK", "YCbCr", "signed", "signed blue"],
)
def test_what_readers_show_differently_is_refused(tmp_path, stated):
    assert refusal(read_levels, tiff(tmp_path / "x.tif", *stated)) == "MF318"


def test_a_directory_cut_short_is_damage(tmp_path):
    path = tiff(tmp_path / "x.tif", (262, [1]))
    path.write_bytes(path.read_bytes()[:40])
    assert refusal(read_levels, path) == "MF303"


@pytest.mark.parametrize("mode", ["1", "L", "RGB"])
def test_what_programs_write_is_read(tmp_path, mode):
    pixels = Image.fromarray(np.frombuffer(PIXELS, np.uint8).reshape(3, 3)).convert(mode)
    pixels.save(tmp_path / "x.tiff")
    levels, _ = read_levels(tmp_path / "x.tiff")
    assert np.array_equal(levels.ravel(), np.frombuffer(PIXELS, np.uint8))


def palette_tiff(path, bits, entry_of, order="<", big=False):
    """All indices in turn, three in a row, of a grey palette; the whole picture if it is of 8 bits."""
    entries = [entry_of(255 * k // (2**bits - 1)) for k in range(2**bits)]
    packed = np.packbits(np.unpackbits(np.array([[0, 1, 2**bits - 1]] * 3, np.uint8)[..., None], axis=2)
                         [..., 8 - bits :].reshape(3, -1), axis=1)  # fmt: skip
    stated = [(262, [3]), (258, [bits]), (279, [packed.size]), (320, entries * 3)]
    return tiff(path, *stated, order=order, big=big, pixels=packed.tobytes())


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("bits", [1, 4, 8])
@pytest.mark.parametrize("white", [65535, 65280])
def test_the_white_of_a_palette_is_white_whichever_way_it_is_written(tmp_path, bits, white, order, big):
    path = palette_tiff(tmp_path / "x.tif", bits, lambda byte: byte * white // 255, order, big)
    before = path.read_bytes()
    levels, _ = read_levels(path)
    assert levels.tolist() == [[0, 255 // (2**bits - 1), 255]] * 3
    assert path.read_bytes() == before


def test_every_level_of_a_palette_is_read_as_the_program_that_wrote_it_reads_it(tmp_path):
    """Pillow writes bytes times 256. The level next to black is one, too, and a half is clear as an opening's dot."""
    picture = Image.fromarray(np.arange(256, dtype=np.uint8).reshape(16, 16), "P")
    picture.putpalette([byte for byte in range(256) for _ in "RGB"])
    picture.save(tmp_path / "x.tif")
    with Image.open(tmp_path / "x.tif") as written:
        assert max(written.tag_v2[320]) == 65280
        shown = np.asarray(written.convert("L"))
    levels, _ = read_levels(tmp_path / "x.tif")
    assert np.array_equal(levels, shown)
    assert np.array_equal(from_image(tmp_path / "x.tif"), (levels >= 128)[::-1])


def test_a_picture_with_a_palette_that_is_cut_short_is_damage(tmp_path):
    once = palette_tiff(tmp_path / "x.tif", 8, lambda byte: 256 * byte).read_bytes()
    for cut in range(8, len(once), 97):
        (tmp_path / "y.tif").write_bytes(once[:cut])
        assert refusal(read_levels, tmp_path / "y.tif") == "MF303"
