"""A DNG's light by its own tags, whatever they say of black, white, active pixels and tone, or a refusal."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from maskfab.base.errors import SourceError
from maskfab.camera.frames.dng import as_told, told
from maskfab.camera.frames.frame import Frame, read_frame

pytest.importorskip("rawpy")

from dng_files import RATIONAL, SIGNED_RATIONAL, write_dng

ROWS, COLUMNS, WHITE = 48, 64, 4095
LIGHT = np.random.default_rng(7).uniform(0.1, 0.4, (ROWS, COLUMNS))
LIGHT[::2, ::2] *= 0.5  # red
LIGHT[1::2, 1::2] *= 0.8  # blue
EACH = [LIGHT[y::2, x::2].mean() for y in (0, 1) for x in (0, 1)]

FLOAT_WHITE = (50717, "I", 1, 1, True)
NO_BLACK = (50714, "H", 1, 0, True)


def signed(tag, values):
    return tag, SIGNED_RATIONAL, len(values), tuple(n for value in values for n in (int(value), 1)), True


def patterned(levels, most):
    tiled = np.tile(levels, (ROWS // levels.shape[0], COLUMNS // levels.shape[1]))
    return np.rint(tiled + LIGHT * (WHITE - most))


def active(top, left):
    return 50829, "I", 4, (top, left, top + ROWS, left + COLUMNS), True


HOT = LIGHT.copy()
HOT[3, 3] = 4
FOUR = 64 + 16 * np.arange(16).reshape(4, 4)
PLAIN = np.rint(64 + LIGHT * (WHITE - 64))
TABLE = tuple(np.rint((np.arange(1024) / 1023) ** 2 * WHITE).astype(int).tolist())
CASES = {
    "floats": (LIGHT, {"kind": np.float32, "extra": [NO_BLACK, FLOAT_WHITE]}),
    "halves": (LIGHT, {"kind": np.float16, "extra": [NO_BLACK, FLOAT_WHITE]}),
    "floats with a hot pixel": (HOT, {"kind": np.float32, "extra": [NO_BLACK, FLOAT_WHITE]}),
    "floats on black": (
        0.1 + 0.9 * LIGHT, {"kind": np.float32, "extra": [(50714, RATIONAL, 1, (1, 10), True), FLOAT_WHITE]},
    ),
    "a black a place": (patterned(np.array([[64, 256], [300, 512]]), 512), {"black": (64, 256, 300, 512)}),
    "an odd row": (np.pad(PLAIN, ((1, 0), (0, 0))), {"extra": [active(1, 0)]}),
    "an odd corner": (
        np.pad(patterned(np.array([[64, 256], [300, 512]]), 512), 3),
        {"black": (64, 256, 300, 512), "extra": [active(3, 3)]},
    ),
    "a black of 4 x 4": (
        patterned(FOUR, 304),
        {"extra": [(50713, "H", 2, (4, 4), True), (50714, "H", 16, tuple(FOUR.ravel().tolist()), True)]},
    ),
    "a black a row": (
        patterned(np.array([[64], [128]]), 128), {"extra": [signed(50716, np.arange(ROWS) % 2 * 64)]},
    ),
    "a black a column": (
        patterned(np.array([[64, 128]]), 128), {"extra": [signed(50715, np.arange(COLUMNS) % 2 * 64)]},
    ),
    "half a count of black": (
        np.rint(64.5 + LIGHT * (WHITE - 64.5)), {"extra": [(50714, RATIONAL, 1, (129, 2), True)]},
    ),
    "a table": (
        np.rint(np.sqrt(LIGHT) * 1023), {"extra": [NO_BLACK, (50712, "H", 1024, TABLE, True)]},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_every_colour_has_the_share_of_white_that_the_tags_tell(tmp_path, case):
    counts, options = CASES[case]
    write_dng(tmp_path / "a.dng", counts, white=WHITE, **options)
    read = read_frame(tmp_path / "a.dng")
    assert [lattice.colour for lattice in read.lattices] == ["R", "G", "G", "B"]
    assert read.shape == (ROWS, COLUMNS)
    for place, (lattice, share) in enumerate(zip(read.lattices, EACH, strict=True)):
        above, hot = read.signal(place) / (read.white - read.black[place]), lattice.of(HOT) == 4
        assert np.where(hot, lattice.of(LIGHT), above).mean() == pytest.approx(share, abs=3e-4)


def operation(number, optional=0):
    return 51008, "B", 20, struct.pack(">5I", 1, number, 0x01030000, optional, 0), True


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        ((259,), "loss"),
        (operation(7), "MapTable"),
        (operation(12), "ScalePerRow"),
    ],
)
def test_a_tone_that_is_not_read_is_refused(tmp_path, extra, said):
    write_dng(tmp_path / "a.dng", PLAIN, extra=[extra] if extra[1:] else [])
    if extra[0] == 259:
        content = bytearray((tmp_path / "a.dng").read_bytes())
        at = content.index(struct.pack("<HHIH", 259, 3, 1, 1))
        content[at + 8 : at + 10] = struct.pack("<H", 34892)
        (tmp_path / "a.dng").write_bytes(content)
    with pytest.raises(SourceError, match=said) as caught:
        read_frame(tmp_path / "a.dng")
    assert caught.value.code == "MF330"


def test_what_mends_pixels_or_shading_may_be_left_out(tmp_path):
    write_dng(tmp_path / "a.dng", PLAIN, extra=[operation(9)])
    assert np.array_equal(read_frame(tmp_path / "a.dng").counts, PLAIN)


def test_readers_that_disagree_are_both_told(tmp_path):
    path = tmp_path / "a.dng"
    write_dng(path, PLAIN)
    frame = Frame("a.dng", PLAIN.astype(np.float32), (64.0,) * 4, WHITE, pattern=(("R", "G"), ("G", "B")))
    others = PLAIN.astype(np.uint16)
    others[5, 7] += 3
    with pytest.raises(SourceError, match=f"row 5, column 7: {PLAIN[5, 7]:.0f} .* {others[5, 7]} by LibRaw") as caught:
        as_told(frame, others, (0, 0), told(path), path)
    assert caught.value.code == "MF308"
    with pytest.raises(SourceError, match="mosaic from row 1"):
        as_told(frame, PLAIN, (1, 0), told(path), path)
