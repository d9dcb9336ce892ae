"""Openings read from every kind of file, written back, and refused with a code and a cure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 - its customary name
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from klayout import db
from sweeps import in_turns, sweep

from maskfab.base.errors import InputError, OpeningError
from maskfab.base.model import Opening
from maskfab.job.values import check_name
from maskfab.mask.opening_file import dot_of_pitch, load_opening, opening_text, parse_opening
from maskfab.mask.opening_masks import from_image, stripe

ASYMMETRIC = np.array([[1, 1, 0], [0, 0, 0], [0, 0, 1]], dtype=bool)  # row 0 lowest
DRAWING = "..#\n...\n##.\n"
GOOD = f'name = "corner"\npitch = "24 um"\ndots = 3\nopen_ratio = 0.3333\ngrid = """\n{DRAWING}"""\n'

masks = st.integers(1, 30).flatmap(lambda n: hnp.arrays(np.bool_, (n, n))).filter(np.any)
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


def refused(code: str, function: object, *args: object, **kwargs: object) -> InputError:
    """Every refusal has its code, says where it stands, and names a cure."""
    with pytest.raises(InputError) as caught:
        function(*args, **kwargs)  # type: ignore[operator]
    error = caught.value
    assert error.code == code, str(error)
    assert error.where
    assert error.cure
    return error


def image(path: Path, pixels: np.ndarray, kind: str = "uint8") -> Path:
    """Write [y, x] or [y, x, channel] with the top row first."""
    values = np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[:, :, None], dtype=np.float32)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind))
    assert out.write_image(values)
    out.close()
    return path


def layout(path: Path, *polygons: list[tuple[int, int]]) -> Path:
    """Write polygons in nanometres on layer 1/0 (CLEAR in DXF) of a cell UNIT."""
    drawn = db.Layout()
    drawn.dbu = 0.001
    shapes = drawn.create_cell("UNIT").shapes(drawn.layer(db.LayerInfo(1, 0, "CLEAR")))
    for polygon in polygons:
        shapes.insert(db.Polygon([db.Point(x, y) for x, y in polygon]))
    drawn.write(str(path))
    return path


def square(column: int, row: int, dot: int = 8000, shift: int = 0) -> list[tuple[int, int]]:
    x0, y0 = column * dot + shift, row * dot + shift
    return [(x0, y0), (x0, y0 + dot), (x0 + dot, y0 + dot), (x0 + dot, y0)]


# --- what is read ---------------------------------------------------------------------------------------------------


def test_toml_has_the_top_row_first() -> None:
    opening = parse_opening(GOOD)
    assert (opening.name, opening.dots, opening.dot_nm, opening.clear_dots) == ("corner", 3, 8000, 3)
    np.testing.assert_array_equal(opening.mask, ASYMMETRIC)


@given(masks, st.integers(1, 10**6), st.dictionaries(texts, texts | st.integers(-(2**53), 2**53) | st.floats()))
def test_text_round_trip(mask: np.ndarray, dot_nm: int, provenance: dict[str, str | int | float]) -> None:
    opening = Opening("any_Name1", mask, dot_nm, provenance)
    again = parse_opening(opening_text(opening))
    np.testing.assert_array_equal(again.mask, mask)
    assert (again.name, again.dot_nm) == (opening.name, dot_nm)
    assert repr(dict(again.provenance)) == repr(provenance)  # repr, because NaN differs from itself
    assert opening_text(again) == opening_text(opening)


def test_toml_file_with_windows_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "corner.toml"
    path.write_bytes(GOOD.replace("\n", "\r\n").encode())
    np.testing.assert_array_equal(load_opening(path).mask, ASYMMETRIC)
    assert load_opening(path, name="other").name == "other"


def test_plain_text_with_comments(tmp_path: Path) -> None:
    path = tmp_path / "corner.txt"
    path.write_text("; a comment\n\n" + DRAWING + "\n; the end", encoding="utf-8")
    opening = load_opening(path, dot_nm=8000, dots=3)
    np.testing.assert_array_equal(opening.mask, ASYMMETRIC)
    assert (opening.name, opening.dot_nm) == ("corner", 8000)


@pytest.mark.parametrize(
    ("suffix", "kind"), [(".png", "uint8"), (".tif", "uint16"), (".tiff", "float"), (".exr", "half")]
)
def test_images(tmp_path: Path, suffix: str, kind: str) -> None:
    mask = np.random.default_rng(0).random((21, 21)) < 0.3
    path = image(tmp_path / f"a{suffix}", mask[::-1], kind)
    np.testing.assert_array_equal(load_opening(path, dot_nm=8000).mask, mask)


def test_image_threshold_and_alpha(tmp_path: Path) -> None:
    colours = np.zeros((2, 2, 4))
    colours[:, :, 3] = 1  # opaque in the image's sense says nothing about the mask
    colours[0, 0, :3] = 0.6
    colours[0, 1, :3] = 0.4
    path = image(tmp_path / "a.png", colours)
    np.testing.assert_array_equal(load_opening(path, dot_nm=8000).mask, [[False, False], [True, False]])


def test_a_dot_of_an_image_that_is_half_bright_is_clear(tmp_path: Path) -> None:
    path = image(tmp_path / "a.tiff", np.array([[0.5] * 2, [0.4999] * 2]), "float")
    np.testing.assert_array_equal(from_image(path), [[False] * 2, [True] * 2])


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.float64])
def test_npy_has_the_lowest_row_first(tmp_path: Path, dtype: type) -> None:
    path = tmp_path / "a.npy"
    np.save(path, ASYMMETRIC.astype(dtype))
    opening = load_opening(path, dot_nm=8000)
    path.unlink()
    np.testing.assert_array_equal(opening.mask, ASYMMETRIC)


def test_npy_with_the_header_of_an_old_python(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, ASYMMETRIC)
    path.write_bytes(path.read_bytes().replace(b"(3, 3), }  ", b"(3L, 3L), }"))
    assert b"3L" in path.read_bytes()
    np.testing.assert_array_equal(load_opening(path, dot_nm=8000).mask, ASYMMETRIC)


@pytest.mark.parametrize(("shift", "suffix"), sweep(in_turns((0, -12000), (".gds", ".oas")), 2))
def test_polygons_from_the_corner_or_the_centre(tmp_path: Path, suffix: str, shift: int) -> None:
    path = layout(tmp_path / f"a{suffix}", *(square(x, y, shift=shift) for x, y in [(0, 0), (1, 0), (2, 2)]))
    for choice in ({}, {"layer": "1/0", "cell": "UNIT"}):
        np.testing.assert_array_equal(load_opening(path, dots=3, dot_nm=8000, **choice).mask, ASYMMETRIC)


def test_an_all_clear_cell_is_a_reference() -> None:
    text = GOOD.replace(DRAWING, "###\n###\n###\n").replace("0.3333", "1")
    assert parse_opening(text).open_ratio == 1.0


def test_pitch_in_dots_per_inch() -> None:
    assert dot_of_pitch(50.0, 5) == 10_000


def test_open_ratio_agrees_to_its_printed_digits() -> None:
    for printed in ("0.3", "0.33", "0.333333333333"):
        assert parse_opening(GOOD.replace("0.3333", printed)).clear_dots == 3


# --- what is refused ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "before", "after", "named"),
    [
        ("MF101", '"""\n..#', '"""\n..#"""', ""),
        ("MF102", "dots", 'colour = "red"\ndots', "'colour'"),
        ("MF103", '"24 um"', "24", "24"),
        ("MF103", '"24 um"', '"24 kg"', "kg"),
        ("MF104", '"24 um"', '"-24 um"', "-24"),
        ("MF104", '"24 um"', '"nan um"', "nan"),
        ("MF104", "0.3333", "nan", "NaN"),
        ("MF104", "0.3333", "-inf", "Infinity"),
        ("MF104", "0.3333", "1.5", "1.5"),
        ("MF105", 'pitch = "24 um"\n', "", "'pitch'"),
        ("MF105", "dots = 3\n", "", "'dots'"),
        ("MF105", "dots = 3", "dots = 3.0", "dots"),
        ("MF105", "dots = 3", "dots = true", "dots"),
        ("MF105", 'name = "corner"', "name = 3", "name"),
        ("MF105", 'name = "corner"', 'name = "corner"\nprovenance = 1', "provenance"),
        ("MF105", "0.3333", '"0.3333"', "open_ratio"),
        ("MF106", '"24 um"', '"25 um"', "8333.3333 nm"),
        ("MF106", '"24 um"', '"2 nm"', "2"),
        ("MF107", '"24 um"', '"24.0005 um"', "24.000500 um"),
        ("MF107", '"24 um"', '"150 dpi"', "169.333333 um"),
        ("MF110", '"corner"', '""', "0 characters"),
        ("MF110", '"corner"', '"9corner"', "9corner"),
        ("MF110", '"corner"', '"re-main"', "main"),
        ("MF110", '"corner"', '"DoMAINs"', "main"),
        ("MF110", '"corner"', '"aaaaaaaaaaaaaaaaaaaaaaaaa"', "25 characters"),
        ("MF110", '"corner"', '"corner\\n"', "letter"),
        ("MF110", '"corner"', '"größe"', "letter"),
        ("MF201", "..#", "..##", "line 1 has 4 dots where the others have 3"),
        ("MF201", "...", "..", "line 2 has 2"),
        ("MF201", "...\n", "...\n\n", "line 3 has 0"),
        ("MF201", "...\n", "", "2 rows of 3"),
        ("MF201", DRAWING, "", "0 lines"),
        ("MF202", "..#", ".x#", "line 1, column 2: 'x'"),
        ("MF202", "...\n##.", "...\n1#.", "line 3, column 1: '1'"),
        ("MF202", "..#", "\t..#", "line 1, column 1: '\\t'"),
        ("MF203", DRAWING, "...\n...\n...\n", "0 of 9"),
        ("MF206", "dots = 3", "dots = 4", "dots = 4"),
        ("MF206", "dots = 3", "dots = 0", "dots = 0"),
        ("MF206", "0.3333", "0.3334", "0.3334"),
        ("MF206", "0.3333", "1", "3 of 9"),
        ("MF206", "0.3333", "0", "3 of 9"),
    ],
)
def test_bad_toml(code: str, before: str, after: str, named: str) -> None:
    assert before in GOOD
    text = GOOD.replace(before, after, 1)
    if before == DRAWING and code == "MF203":
        text = text.replace("open_ratio = 0.3333\n", "")
    assert named in refused(code, parse_opening, text, "x.toml").what


def test_bad_provenance() -> None:
    for value in ("true", "[1]", "1979-05-27", "{ a = 1 }"):
        assert (
            "provenance.when"
            in refused("MF105", parse_opening, GOOD + f"[provenance]\nwhen = {value}\n", "x.toml").where
        )


def test_missing_empty_unknown(tmp_path: Path) -> None:
    refused("MF301", load_opening, tmp_path / "none.toml")
    refused("MF301", load_opening, tmp_path / "none.gds", dots=3, dot_nm=8000)
    (tmp_path / "folder.toml").mkdir()
    assert "directory" in refused("MF301", load_opening, tmp_path / "folder.toml").what
    for suffix in (".toml", ".txt", ".png", ".tif", ".exr", ".npy", ".gds", ".oas", ".dxf"):
        path = tmp_path / f"empty{suffix}"
        path.write_bytes(b"")
        refused("MF302", load_opening, path, dots=3, dot_nm=8000)
    path = tmp_path / "a.xyz"
    path.write_bytes(b"text")
    assert ".xyz" in refused("MF308", load_opening, path).what


def test_damaged(tmp_path: Path) -> None:
    whole = {
        ".png": image(tmp_path / "whole.png", ASYMMETRIC),
        ".tif": image(tmp_path / "whole.tif", ASYMMETRIC),
        ".exr": image(tmp_path / "whole.exr", ASYMMETRIC, "half"),
        ".npy": tmp_path / "whole.npy",
        ".gds": layout(tmp_path / "whole.gds", square(0, 0)),
        ".oas": layout(tmp_path / "whole.oas", square(0, 0)),
    }
    np.save(whole[".npy"], ASYMMETRIC)
    for suffix, source in whole.items():
        content = source.read_bytes()
        for length in (20, len(content) // 2, len(content) - 20):
            path = tmp_path / f"part{suffix}"
            path.write_bytes(content[:length])
            refused("MF303", load_opening, path, dots=3, dot_nm=8000)


def test_not_what_the_suffix_says(tmp_path: Path) -> None:
    picture = image(tmp_path / "a.png", ASYMMETRIC).read_bytes()
    for suffix in (".toml", ".txt", ".tif", ".exr", ".npy", ".gds", ".oas", ".dxf"):
        path = tmp_path / f"b{suffix}"
        path.write_bytes(picture)
        refused("MF304", load_opening, path, dots=3, dot_nm=8000)
    for suffix in (".png", ".tif", ".exr", ".npy", ".gds", ".oas"):
        path = tmp_path / f"c{suffix}"
        path.write_text(DRAWING, encoding="utf-8")
        refused("MF304", load_opening, path, dots=3, dot_nm=8000)
    path = tmp_path / "latin.txt"
    path.write_bytes(b"; gr\xf6sse\n" + DRAWING.encode())
    refused("MF304", load_opening, path, dot_nm=8000)


def test_arguments(tmp_path: Path) -> None:
    path = tmp_path / "corner.txt"
    path.write_text(DRAWING, encoding="utf-8")
    refused("MF105", load_opening, path)
    refused("MF104", load_opening, path, dot_nm=0)
    refused("MF115", load_opening, path, dot_nm=1, dots=5000)
    refused("MF206", load_opening, path, dot_nm=8000, dots=4)
    refused("MF110", load_opening, path, dot_nm=8000, name="domain")
    refused("MF105", load_opening, layout(tmp_path / "a.gds", square(0, 0)), dot_nm=8000)
    good = tmp_path / "corner.toml"
    good.write_text(GOOD, encoding="utf-8")
    refused("MF206", load_opening, good, dot_nm=4000)
    path.rename(tmp_path / "9-corner.txt")
    refused("MF110", load_opening, tmp_path / "9-corner.txt", dot_nm=8000)


def test_text_grid_names_the_line_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("; one\n; two\n#..\n.?.\n...\n", encoding="utf-8")
    assert "line 4, column 2: '?'" in refused("MF202", load_opening, path, dot_nm=8000).what


def test_bad_images(tmp_path: Path) -> None:
    holed = ASYMMETRIC.astype(float)
    holed[1, 2] = np.nan
    assert "[1, 2]" in refused("MF202", load_opening, image(tmp_path / "a.exr", holed, "half"), dot_nm=8000).what
    refused("MF203", load_opening, image(tmp_path / "b.png", np.zeros((3, 3))), dot_nm=8000)
    assert "2 rows of 3" in refused("MF201", load_opening, image(tmp_path / "c.png", np.ones((2, 3))), dot_nm=8000).what
    refused("MF115", load_opening, image(tmp_path / "d.png", np.zeros((5000, 5000))), dot_nm=8000)


@pytest.mark.parametrize(
    ("code", "array"),
    [
        ("MF201", np.ones((2, 3))),
        ("MF201", np.ones(9)),
        ("MF201", np.ones((3, 3, 1))),
        ("MF202", np.full((3, 3), np.nan)),
        ("MF202", np.full((3, 3), np.inf)),
        ("MF202", np.full((3, 3), 0.3)),
        ("MF202", np.full((3, 3), 255)),
        ("MF202", np.full((3, 3), "#")),
        ("MF202", np.ones((3, 3), dtype=complex)),
        ("MF203", np.zeros((3, 3))),
        ("MF303", np.array([[None]])),
    ],
)
def test_bad_npy(tmp_path: Path, code: str, array: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", array)
    refused(code, load_opening, tmp_path / "a.npy", dot_nm=8000)


def test_polygons_off_the_grid(tmp_path: Path) -> None:
    shifted = layout(tmp_path / "a.gds", square(0, 0), [(8000, 8000), (8000, 16001), (16000, 16001), (16000, 8000)])
    assert "16001) nm is 1 nm off" in refused("MF205", load_opening, shifted, dots=3, dot_nm=8000).what
    oblique = layout(tmp_path / "b.gds", [(0, 0), (0, 8000), (8000, 0)])
    assert "0.500 of the dot in row 0" in refused("MF205", load_opening, oblique, dots=3, dot_nm=8000).what
    outside = layout(tmp_path / "c.gds", square(3, 0))
    assert "32000" in refused("MF205", load_opening, outside, dots=3, dot_nm=8000).what
    refused("MF306", load_opening, outside, dots=4, dot_nm=8000, layer="7/0")
    refused("MF307", load_opening, outside, dots=4, dot_nm=8000, cell="OTHER")


def test_names_that_pass() -> None:
    for name in ("a", "toled", "Inv_random_300", "a" * 24):
        check_name(name)


@pytest.mark.parametrize(
    ("name", "dots", "clear_dots"),
    [
        ("toled", 21, 92),
        ("stripe", 21, 90),
        ("poled", 42, 418),
        ("diamond", 42, 416),
        ("paper_inv_random", 21, 100),
        ("paper_inv_periodic", 21, 100),
        ("paper_l2_random", 21, 100),
        ("paper_l2_periodic", 21, 100),
        ("bar", 21, 100),
        ("fits", 21, 100),
        ("fits_packed", 21, 100),
        ("fits_88", 21, 88),
        ("fits_gutter", 42, 400),
        ("periodic", 21, 100),
    ],
)
def test_shipped_openings(name: str, dots: int, clear_dots: int) -> None:
    path = Path(__file__).parents[2] / "layouts" / "openings" / f"{name}.toml"
    opening = load_opening(path)
    assert (opening.name, opening.dots, opening.clear_dots) == (name, dots, clear_dots)
    assert opening.dots * opening.dot_nm == 168_000
    assert opening.provenance["author"] == "maskfab"
    assert opening_text(opening) == path.read_text(encoding="utf-8")


@pytest.mark.parametrize(("dots", "width", "clear"), [(21, 5, 90), (21, 4, 40), (20, 5, 45), (20, 6, None), (1, 1, 1)])
def test_a_slit_is_centred_to_half_a_dot(dots: int, width: int, clear: int | None) -> None:
    row, column = np.nonzero(stripe(dots, width, clear))
    height = dots if clear is None else clear // width
    assert (len(set(row)), len(set(column))) == (height, width)
    assert dots - 1 - row.max() - row.min() == (dots - height) % 2
    assert dots - 1 - column.max() - column.min() == (dots - width) % 2


NUMBERS = {
    "commas": ("0,1,1\n0,0,1\n0,0,0\n", ".csv"),
    "commas and blanks": ("0, 1, 1\r\n0, 0, 1\r\n0, 0, 0\r\n", ".csv"),
    "semicolons": ("0;1;1\n0;0;1\n0;0;0", ".csv"),
    "semicolons, decimal commas": ("0,0;1,0;1,0\n0,0;0,0;1,0\n0,0;0,0;0,0", ".csv"),
    "tabs": ("0\t1\t1\n0\t0\t1\n0\t0\t0\n", ".tsv"),
    "blanks": ("0 1 1\n 0  0 1\n0 0 0\n", ".txt"),
    "nothing": ("011\n001\n000\n", ".txt"),
    "as numpy saves": ("# of mine\n0.0000e+00 1.0000e+00 1.0e+00\n0.0 0.0 1.0\n0.0 0.0 0.0\n", ".txt"),
    "drawn": (".##\n..#\n...\n", ".csv"),
    "marked": ("\ufeff0,1,1\n0,0,1\n0,0,0\n\n", ".csv"),
}


@pytest.mark.parametrize("case", NUMBERS)
def test_a_table_of_0_and_1_is_an_opening_its_top_row_first(tmp_path, case):
    text, suffix = NUMBERS[case]
    path = tmp_path / f"corner{suffix}"
    path.write_text(text, encoding="utf-8")
    assert load_opening(path, dot_nm=8000).mask.tolist() == [[0, 0, 0], [0, 0, 1], [0, 1, 1]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,1,1\n0,2,1\n0,0,0", "line 2, number 2: '2'"),
        ("0,1,1\n0,0.5,1\n0,0,0", "line 2, number 2: '0.5'"),
        (",0,1\n0,0,1\n0,0,0", "line 1, number 1: ''"),
        ("0,1,1\n0,nan,1\n0,0,0", "line 2, number 2: 'nan'"),
        ("0,1,-1\n0,0,1\n0,0,0", "line 1, number 3: '-1'"),
    ],
)
def test_other_numbers_are_refused_with_their_place(tmp_path, text, said):
    path = tmp_path / "corner.csv"
    path.write_text(text)
    with pytest.raises(OpeningError, match=said) as caught:
        load_opening(path, dot_nm=8000)
    assert caught.value.code == "MF202"


@pytest.mark.parametrize("fault", ["turned", "pages", "transparent"])
def test_an_image_that_may_be_seen_otherwise_is_refused(tmp_path, fault):
    path, pixels = tmp_path / "corner.tif", np.full((3, 3), 255, np.uint8)
    if fault == "transparent":
        tifffile.imwrite(path, np.stack([pixels, pixels // 2], axis=-1), photometric=1, extrasamples=["unassalpha"])
    else:
        turned = [(274, "H", 1, 6, True)] if fault == "turned" else ()
        pages = np.stack([pixels, pixels]) if fault == "pages" else pixels
        tifffile.imwrite(path, pages, photometric=1, extratags=turned, metadata=None)
    refused("MF308", load_opening, path, dot_nm=8000)
