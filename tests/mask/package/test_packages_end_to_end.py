"""Packages from the command line and back: every house, every format, holes however drawn, and tampered ones.

What a package exposes is counted here once more from the file as the house gets it, by readers of this test alone.
"""

from __future__ import annotations

import hashlib
import json
import re
import stat
import struct
import zipfile
from pathlib import Path

import pytest
from house_plates import taken_as
from klayout import db
from once import figures_in_words
from repacking import members, of_manifest, repacked
from small_job import command, listing, with_the_die, write_job
from sweeps import sweep

from maskfab.mask.houses.profiles import load_shop, shop_names
from maskfab.mask.job import load_job
from maskfab.mask.package.pack import pack, verify_package

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

FRAME = """\
.......
.#####.
.#...#.
.#...#.
.#...#.
.#####.
.......
"""
"""One hole and no corners that only touch."""
OPENING = f'name = "frame"\npitch = "56 um"\ndots = 7\ngrid = """\n{FRAME}"""\n'
DOT_NM, CELLS = 8000, 10
DIE_AREA_NM2 = FRAME.count("#") * CELLS**2 * DOT_NM**2
SUFFIXES = {"gdsii": ".gds", "oasis": ".oas", "dxf_r12": ".dxf", "dxf_r2010": ".dxf", "gerber": ".gbr", "cif": ".cif"}
ALL = ("gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif")
PROFILE = """\
title = "A house of nobody"
sources = []
[accepts]
formats = ["gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif"]
[polygons]
holes = "{holes}"
hierarchy = "{hierarchy}"
[order]
fields = ["mask_name", "tone", "design_layers"]
"""


def sent_to(name: str) -> tuple[str, ...]:
    """Formats of polygons in which the small plate goes to a house."""
    shop = load_shop(name)
    known = shop.accepts.formats or shop.accepts.ruled or ALL[:2]
    return tuple(each for each in known if each in ALL)


def as_options(formats) -> list[str]:
    return [word for each in formats for word in ("--format", each)]


def packed(capsys, folder: Path, shop: object, formats, edits=()) -> tuple[Path, Path]:
    """A job of one die, and the package that the command makes of it."""
    job, out = with_the_die("TURNED", write_job(folder, *edits, opening=OPENING)), folder / "p.zip"
    answer = command(
        capsys, "order", "pack", job, "--shop", shop, "--out", out, *as_options(formats), "--json", "--quiet", "--force"
    )
    assert answer.code == 0, answer.stdout
    assert {file["format"] for file in answer.document["files"]} - {"paper"} == set(formats)
    return job, out


def masks(package: Path, folder: Path) -> dict[str, Path]:
    """The mask files of a package, unpacked by format."""
    with zipfile.ZipFile(package) as archive:
        (manifest,) = (name for name in archive.namelist() if name.endswith("/manifest.json"))
        root = manifest.partition("/")[0]
        rows = [row for row in json.loads(archive.read(manifest))["files"] if row["format"] in SUFFIXES]
        for row in rows:
            (folder / row["path"]).write_bytes(archive.read(f"{root}/{row['path']}"))
    return {row["format"]: folder / row["path"] for row in rows}


def exposed(path: Path) -> db.Region:
    """What a file exposes, in nanometres: CLEAR without CUT, or dark regions of a Gerber without the clear ones."""
    if path.suffix == ".gbr":
        return gerber_regions(path.read_text(encoding="ascii"))
    options = db.LoadLayoutOptions()
    in_mm = path.suffix == ".dxf" and b"1 drawing unit = 1 millimetre" in path.read_bytes()
    options.dxf_dbu, options.dxf_unit = 0.001, 1000.0 if in_mm else 1.0
    layout = db.Layout()
    layout.read(str(path), options)
    found = {}
    for number, name in ((1, "CLEAR"), (2, "CUT")):
        wanted = [
            info for info in layout.layer_infos() if info.name == name or (info.layer, info.datatype) == (number, 0)
        ]
        found[name] = db.Region()
        for info in wanted:
            found[name] += db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(info)))
    return (found["CLEAR"] - found["CUT"]).merged()


def gerber_regions(text: str) -> db.Region:
    """Regions alone, coordinates modal, as of the specification; six decimals of a millimetre are nanometres."""
    assert "%FSLAX46Y46*%" in text
    assert "%MOMM*%" in text
    image, dark, x, y = db.Region(), True, 0, 0
    batch, corners = db.Region(), []
    for line in text.splitlines():
        polarity = re.fullmatch(r"%LP([DC])\*%", line)
        step = re.fullmatch(r"(?:X(-?\d+))?(?:Y(-?\d+))?D0([12])\*", line)
        if polarity:
            image, batch = image + batch if dark else image - batch, db.Region()
            dark = polarity[1] == "D"
        elif step:
            x, y = int(step[1] or x), int(step[2] or y)
            corners.append(db.Point(x, y))
        elif line == "G37*":
            batch.insert(db.Polygon(corners))
            corners = []
    return (image + batch if dark else image - batch).merged()


def test_what_reads_packages_here_reads_what_is_known():
    square = "G36*\nX{0}Y{0}D02*\nX{1}D01*\nY{1}D01*\nX{0}D01*\nY{0}D01*\nG37*\n"
    head = "%FSLAX46Y46*%\n%MOMM*%\n"
    text = head + "%LPD*%\n" + square.format(0, 30) + "%LPC*%\n" + square.format(10, 20)
    assert gerber_regions(text).area() == 900 - 100
    assert gerber_regions(head + "%LPD*%\n" + square.format(-30, 0)).bbox() == db.Box(-30, -30, 0, 0)


@pytest.mark.parametrize("name", sweep(shop_names(), 1))
def test_what_a_house_gets_is_the_plate_in_every_format(capsys, tmp_path, name):
    formats = sent_to(name)
    edits = taken_as(load_shop(name))
    job, package = packed(capsys, tmp_path, name, formats, edits)
    answer = command(capsys, "verify", package, "--against", job, "--shop", name, "--json", "--quiet")
    assert (answer.code, answer.document["verdict"]) == (0, "pass")
    rows = [(check["name"], check.get("die")) for check in answer.document["checks"]]
    for check in (("readback_xor_area", None), ("readback_xor_area", "TURNED"), ("readback_wrong_dots", "TURNED")):
        assert rows.count(check) == len(formats), check
    plate = load_job(job).plate()
    files = masks(package, tmp_path)
    assert set(files) == set(formats)
    for path in files.values():
        clear = exposed(path)
        for die in plate.dies:
            openings = FRAME.count("#") * die.panel.orientations.size * die.panel.dot_nm**2
            drawn = 0 if load_job(job).spec.tone == "dark" else openings  # of dark data, none is an opening
            assert (clear & db.Region(db.Box(*die.box_nm))).area() == drawn, path.name


@pytest.mark.parametrize(
    ("holes", "hierarchy", "formats"),
    sweep(
        [
            ("layer", "cells", ("dxf_r12", "gerber")),
            ("trapezoids", "merged", ("oasis", "dxf_r12")),
            ("layer", "cells", ALL),
            *((*drawn, ("oasis", "dxf_r12", "gerber")) for drawn in (("layer", "flat"), ("layer", "merged"))),
            ("keyhole", "cells", ALL),
            ("trapezoids", "merged", ("gerber", "gdsii")),
        ],
        2,
    ),
)
def test_holes_are_holes_however_they_are_drawn(capsys, tmp_path, holes, hierarchy, formats):
    shop = tmp_path / "nobody.toml"
    shop.write_text(PROFILE.format(holes=holes, hierarchy=hierarchy), encoding="utf-8")
    job, package = packed(capsys, tmp_path, shop, formats)
    answer = command(capsys, "verify", package, "--against", job, "--shop", shop, "--json", "--quiet")
    assert (answer.code, answer.document["verdict"]) == (0, "pass")
    files = masks(package, tmp_path)
    first, *others = (exposed(path) for path in files.values())
    box = db.Region(db.Box(*load_job(job).plate().dies[0].box_nm))
    assert (first & box).area() == DIE_AREA_NM2
    for other in others:
        assert (first ^ other).is_empty()
    with zipfile.ZipFile(package) as archive:
        order = archive.read("SMALL_nobody/order.txt").decode()
    assert ("CLEAR minus CUT" in order) == (holes == "layer")


@pytest.mark.parametrize(
    ("named", "formats"), sweep([(True, ("gdsii",)), (False, ("gdsii",)), (True, ALL), (False, ALL)], 2)
)
def test_mask_files_of_a_package_stand_up_alone(capsys, tmp_path, named, formats):
    """Nothing is wrong if the job names the house; if it does not, that holes have a layer of their own is told."""
    shop = tmp_path / "nobody.toml"
    shop.write_text(PROFILE.format(holes="layer", hierarchy="cells"), encoding="utf-8")
    edits = (("[[die]]", f'[export]\nshop = "{shop}"\n\n[[die]]'),) if named else ()
    job, package = packed(capsys, tmp_path, shop, formats, edits)
    for path in masks(package, tmp_path).values():
        answer = command(capsys, "verify", path, "--against", job, "--json", "--quiet")
        failed = {row["name"] for row in answer.document["quantities"] if row["passed"] is False}
        # A Gerber file says itself what is taken out of what.
        assert failed == (set() if named or path.suffix == ".gbr" else {"layer_taken_out"}), path.name
        assert answer.document["verdict"] == ("fail" if failed else "pass")


@pytest.mark.parametrize("kind", sweep(["gdsii", "dxf_r12", "gerber"], 1))
def test_a_hole_that_the_file_lacks_is_told_by_the_package_and_by_the_file(capsys, tmp_path, kind):
    """Hashes made right again: only geometry can tell."""
    shop = tmp_path / "nobody.toml"
    shop.write_text(PROFILE.format(holes="layer", hierarchy="flat"), encoding="utf-8")
    job, package = packed(capsys, tmp_path, shop, (kind,))

    def without_holes(name: str, content: bytes) -> bytes:
        if not name.endswith(SUFFIXES[kind]):
            return content
        if kind == "gerber":
            return content.partition(b"%LPC*%")[0] + b"M02*\n"
        if kind == "dxf_r12":
            return content.replace(b"\n8\nCUT\n", b"\n8\nCLEAR\n")
        layout = db.Layout()
        (tmp_path / "x.gds").write_bytes(content)
        layout.read(str(tmp_path / "x.gds"))
        layout.clear_layer(layout.find_layer(2, 0))
        layout.write(str(tmp_path / "x.gds"))
        return (tmp_path / "x.gds").read_bytes()

    forged = repacked(package, tmp_path / "forged.zip", without_holes, honest=True)
    for options in ((), ("--against", job, "--shop", shop)):
        answer = command(capsys, "verify", forged, *options, "--json", "--quiet")
        failed = {(check["name"], check.get("die")) for check in answer.document["checks"] if not check["passed"]}
        assert answer.code == 1
        assert failed >= {("readback_xor_area", None), ("readback_wrong_dots", "TURNED")}
    (path,) = masks(forged, tmp_path).values()
    assert command(capsys, "verify", path, "--against", job, "--quiet").code == 1


# --- damage ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[Path, Path]:
    """A job and its package in GDSII."""
    return _whole(tmp_path_factory.mktemp("whole"), "gdsii")


@pytest.fixture(scope="module")
def whole_gerber(tmp_path_factory) -> tuple[Path, Path]:
    """The same in Gerber, which takes longer to read."""
    return _whole(tmp_path_factory.mktemp("whole_gerber"), "gerber")


def _whole(folder: Path, kind: str) -> tuple[Path, Path]:
    job, path = with_the_die("TURNED", write_job(folder)), folder / "p.zip"
    with figures_in_words():
        assert pack(load_job(job), load_shop("ualberta_mla150"), path, (kind,)).path == path
    return job, path


def told(capsys, package: Path, *options: object) -> tuple[int, str]:
    """Exit code, and the error's code or what the failed checks say."""
    answer = command(capsys, "verify", package, *options, "--json", "--quiet")
    if "error" in answer.document:
        return answer.code, answer.document["error"]["code"]
    return answer.code, "; ".join(check["method"] for check in answer.document["checks"] if not check["passed"])


def test_a_byte_changed_anywhere_in_the_archive_is_told(capsys, whole, tmp_path):
    """Every member at its first packed byte, and in the middle: of its last byte some bits mean nothing."""
    _, package = whole
    content = package.read_bytes()
    with zipfile.ZipFile(package) as archive:
        infos = archive.infolist()
    for info in infos:
        name_length, extra_length = struct.unpack("<HH", content[info.header_offset + 26 : info.header_offset + 30])
        start = info.header_offset + 30 + name_length + extra_length
        for at in (start, start + info.compress_size // 2):
            damaged = bytearray(content)
            damaged[at] ^= 0x10
            (tmp_path / "q.zip").write_bytes(damaged)
            assert told(capsys, tmp_path / "q.zip") == (2, "MF303"), (info.filename, at)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.999])
def test_a_package_that_is_cut_off_is_refused(capsys, whole, tmp_path, share):
    content = whole[1].read_bytes()
    (tmp_path / "q.zip").write_bytes(content[: int(share * len(content))])
    code, said = told(capsys, tmp_path / "q.zip")
    assert (code, said in {"MF303", "MF422"}) == (2, True)


@pytest.mark.slow
def test_every_member_that_is_changed_missing_or_added_is_named(capsys, whole, tmp_path):
    _, package = whole
    for member in (name for name in members(package) if not name.endswith("manifest.json")):
        file = member.partition("/")[2]
        changed = repacked(package, tmp_path / "a.zip", lambda n, c, m=member: c[:-1] + b"?" if n == m else c)
        code, said = told(capsys, changed)
        assert (code, said.split("; ")[0]) == (1, f"SHA-256 of {file}")
        lacking = repacked(package, tmp_path / "b.zip", lambda n, c, m=member: None if n == m else c)
        code, said = told(capsys, lacking)
        assert (code, said.split("; ")[0]) == (1, f"SHA-256 of {file}")
        # Without its job or its profile the polygons cannot be held against anything, and there is but one mask.
        assert ("; " in said) == (file in {"job.json", "shop.toml", "SMALL.gds"})
    with zipfile.ZipFile(repacked(package, tmp_path / "c.zip", lambda _, c: c), "a") as archive:
        archive.writestr("SMALL_ualberta_mla150/more.gds", b"more")
    assert told(capsys, tmp_path / "c.zip") == (1, "the manifest does not know more.gds")


def test_a_package_without_its_manifest_is_none(capsys, whole, tmp_path):
    without = lambda name, content: None if name.endswith("manifest.json") else content  # noqa: E731
    assert told(capsys, repacked(whole[1], tmp_path / "q.zip", without)) == (2, "MF422")


HOSTILE_NAMES = [
    "../x", "SMALL_ualberta_mla150/../x", "SMALL_ualberta_mla150/../../x", "/etc/x", "//host/x", "C:/x", "C:x",
    "SMALL_ualberta_mla150\\x", "..\\x", "x", "SMALL_ualberta_mla150/deep/x", "SMALL_ualberta_mla150/", "other/x",
    "SMALL_ualberta_mla150/order.txt", "SMALL_ualberta_mla150/ORDER.TXT", "./SMALL_ualberta_mla150/x/..", "..", ".", "",
]  # fmt: skip


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_a_member_that_would_leave_its_folder_is_refused_before_anything_is_written(capsys, whole, tmp_path, name):
    folder = tmp_path / "here"
    folder.mkdir()
    path = repacked(whole[1], folder / "q.zip", lambda _, c: c)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(zipfile.ZipInfo(name), b"evil")
    before = listing(tmp_path)
    code, said = told(capsys, path)
    assert (code, said in {"MF422", "MF423"}) == (2, True)
    assert listing(tmp_path) == before


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFDIR])
def test_a_member_that_is_no_plain_file_is_refused(capsys, whole, tmp_path, kind):
    path = repacked(whole[1], tmp_path / "q.zip", lambda _, c: c)
    link = zipfile.ZipInfo("SMALL_ualberta_mla150/link")
    link.create_system, link.external_attr = 3, (kind | 0o777) << 16
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(link, "/etc/passwd")
    assert told(capsys, path) == (2, "MF423")


def test_a_bomb_is_refused_before_it_goes_off(capsys, whole, tmp_path):
    path = repacked(whole[1], tmp_path / "q.zip", lambda _, c: c)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("SMALL_ualberta_mla150/bomb.gds", bytes(100_000_000))
    assert path.stat().st_size < 1_000_000
    assert told(capsys, path) == (2, "MF423")


def test_a_member_that_says_less_than_it_holds_is_refused(capsys, whole, tmp_path):
    path = repacked(whole[1], tmp_path / "q.zip", lambda _, c: c)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("SMALL_ualberta_mla150/bomb.gds", bytes(1_000_000))
    content = path.read_bytes()
    assert content.count(struct.pack("<L", 1_000_000)) == 2  # in its own header, and in the directory
    path.write_bytes(content.replace(struct.pack("<L", 1_000_000), struct.pack("<L", 10)))
    assert told(capsys, path) == (2, "MF303")


@pytest.mark.parametrize(
    "path", sweep(["../p.zip", "/etc/hostname", "SMALL_ualberta_mla150/order.txt", ".", "", "x\x00y"], 2)
)
def test_a_manifest_that_lists_other_places_reaches_none(capsys, whole, tmp_path, path):
    job, package = whole
    row = {"path": path, "format": "gdsii", "sha256": "0" * 64, "bytes": 1}
    forged = repacked(package, tmp_path / "q.zip", of_manifest(lambda document: document["files"].append(row)))
    options = ("--against", job, "--shop", "ualberta_mla150") if path == "../p.zip" else ()
    assert told(capsys, forged, *options) == (1, f"SHA-256 of {path}")


@pytest.mark.parametrize(
    "manifest", [b"", b"[]", b"{}", b'{"files": 1}', b'{"files": [1]}', b'{"files": [{}]}', b"\xff\xfe", b"[" * 100_000]
)
def test_a_manifest_that_is_none_is_refused(capsys, whole, tmp_path, manifest):
    edit = lambda name, content: manifest if name.endswith("manifest.json") else content  # noqa: E731
    assert told(capsys, repacked(whole[1], tmp_path / "q.zip", edit)) == (2, "MF422")


@pytest.mark.slow
def test_masks_that_the_manifest_calls_something_else_are_compared_all_the_same(whole_gerber, tmp_path):
    """Somebody else's polygons under true hashes, listed as paper."""
    job, package = whole_gerber

    def forged(name: str, content: bytes) -> bytes:
        if name.endswith("manifest.json"):
            document = json.loads(content)
            for row in document["files"]:
                row["format"] = "paper"
            return json.dumps(document).encode()
        return content.replace(b"%LPD*%\n", b"%LPD*%\nG36*\nX0Y0D02*\nX900Y0D01*\nX900Y900D01*\nX0Y0D01*\nG37*\n")

    path = repacked(package, tmp_path / "q.zip", forged, honest=True)
    for asked in ((), (load_job(job), load_shop("ualberta_mla150"))):
        failed = {check.name for check in verify_package(path, *asked) if not check.passed}
        assert "readback_xor_area" in failed
        assert "sha256" not in failed


def exchanged(file: str, old: bytes, new: bytes):
    """An edit of one file of a package, which must change it."""

    def edit(name: str, content: bytes) -> bytes:
        if name.rpartition("/")[2] != file:
            return content
        assert old in content
        return content.replace(old, new, 1)

    return edit


def stated(**said: object):
    """An edit of what the manifest says; None takes a fact away."""
    return of_manifest(lambda held: {key: value for key, value in {**held, **said}.items() if value is not None})


FORGED_PAPERS = {
    "order.txt": (b"digitized data = clear", b"digitized data = dark"),
    "order.html": (b"chrome up", b"chrome down"),
    "plate.svg": (b"blank 27 mm", b"blank 28 mm"),
    "plate.pdf": (b"blank 27 mm", b"blank 28 mm"),
    "certificate.json": (b"true", b"false"),
    "job.json": (b"{", b"{ "),
    "shop.toml": (b"title =", b"title  ="),
}


@pytest.mark.parametrize(("file", "against"), [*((file, False) for file in FORGED_PAPERS), ("certificate.json", True)])
def test_a_forged_paper_is_told_though_its_hash_is_true(capsys, whole, tmp_path, file, against):
    job, package = whole
    forged = repacked(package, tmp_path / "q.zip", exchanged(file, *FORGED_PAPERS[file]), honest=True)
    options = ("--against", job, "--shop", "ualberta_mla150") if against else ()
    assert told(capsys, forged, *options) == (1, f"SHA-256 of {file} as its job and profile make it")


def test_a_package_lacks_no_paper_and_has_no_other(capsys, whole, tmp_path):
    """Taken out, or put in, with a manifest that agrees."""
    _, package = whole

    without = lambda name, content: None if name.endswith("order.txt") else content  # noqa: E731
    lacking = repacked(package, tmp_path / "b.zip", without, honest=True)
    assert told(capsys, lacking) == (1, "SHA-256 of order.txt as its job and profile make it")
    row = {"path": "more.txt", "format": "paper", "bytes": 4, "sha256": hashlib.sha256(b"more").hexdigest()}
    more = repacked(package, tmp_path / "c.zip", of_manifest(lambda document: document["files"].append(row)))
    with zipfile.ZipFile(more, "a") as archive:
        archive.writestr("SMALL_ualberta_mla150/more.txt", b"more")
    assert told(capsys, more) == (1, "more.txt: no package of this job holds it")


@pytest.mark.parametrize(
    ("said", "names"),
    sweep(
        [
            ({"tone": "digitized data = dark"}, {"manifest_tone"}),
            ({"parity": None}, {"manifest_parity"}),
            ({"plate": "OTHER"}, {"manifest_plate"}),
            ({"job_hash": "0" * 64}, {"manifest_job_hash"}),
            ({"shop": "pog"}, {"package_folder", "paper", "profile"}),
            ({"drawn": ["nothing"]}, {"manifest_drawn"}),
            ({"drawing": float("nan")}, {"manifest_drawing"}),
            ({"schema_version": 1}, {"manifest_schema_version"}),
            ({"more": {"a": [1]}}, {"manifest_more"}),
        ],
        quick=2,
    ),
)
def test_what_a_manifest_says_is_what_its_job_and_profile_make(whole, tmp_path, said, names):
    job, package = whole
    forged = repacked(package, tmp_path / "q.zip", stated(**said))
    assert {check.name for check in verify_package(forged) if check.passed is False} == names
    against = verify_package(forged, load_job(job), load_shop("ualberta_mla150"))
    assert {check.name for check in against if check.passed is False} == (
        {"manifest_shop"} if "shop" in said else names
    )


def test_a_manifest_tells_format_and_length_of_every_file(whole, tmp_path):
    def edit(name: str, content: bytes) -> bytes:
        return content.replace(b'"bytes": ', b'"bytes": 1') if name.endswith("manifest.json") else content

    _, package = whole
    failed = [check for check in verify_package(repacked(package, tmp_path / "q.zip", edit)) if not check.passed]
    assert {check.name for check in failed} == {"files"}
    assert len(failed) == len(members(package)) - 1


@pytest.mark.slow
def test_papers_of_another_version_are_notes_where_they_differ(whole, tmp_path):
    """That the version is another is told by the plate itself, whose lettering names it."""
    _, package = whole
    same = verify_package(repacked(package, tmp_path / "a.zip", stated(matplotlib_version="3.1")))
    assert {check.name for check in same if check.passed is not True} == {"manifest_matplotlib_version"}
    edit = exchanged("plate.pdf", *FORGED_PAPERS["plate.pdf"])
    drawn = repacked(tmp_path / "a.zip", tmp_path / "b.zip", edit, honest=True)
    notes = [check for check in verify_package(drawn) if check.passed is not True]
    assert [(check.name, check.passed) for check in notes] == [("manifest_matplotlib_version", None), ("paper", None)]
    assert "plate.pdf" in notes[1].method
    later = repacked(package, tmp_path / "c.zip", stated(maskfab_version="9", drawn=["x"], tone="dark"))
    rows = verify_package(later)
    assert {check.name for check in rows if check.passed is None} >= {
        "manifest_maskfab_version",
        "manifest_drawn",
        "paper",
    }
    assert {check.name for check in rows if check.passed is False} >= {"readback_xor_area", "manifest_tone"}


def test_a_package_that_its_house_would_refuse_is_told(whole, tmp_path):
    job, package = whole
    named = {
        check.name for check in verify_package(package, load_job(job), load_shop("gesim")) if check.passed is False
    }
    assert named >= {"shop_blank", "manifest_shop", "paper"}


def test_a_package_without_a_mask_is_no_proof(whole, tmp_path):
    job, package = whole

    def papers(name: str, content: bytes) -> bytes | None:
        if name.endswith("manifest.json"):
            document = json.loads(content)
            document["files"] = [row for row in document["files"] if row["format"] == "paper"]
            return json.dumps(document).encode()
        return None if name.endswith((".gds", ".gbr")) else content

    path = repacked(package, tmp_path / "q.zip", papers)
    failed = [check for check in verify_package(path, load_job(job), load_shop("ualberta_mla150")) if not check.passed]
    assert [check.name for check in failed] == ["mask_files"]


def test_equal_plates_are_equal_packages_whatever_their_time(whole, tmp_path, monkeypatch):
    import time

    job, package = whole
    monkeypatch.setattr(time, "time", lambda: 2e9)
    monkeypatch.setenv("TZ", "Asia/Kathmandu")
    pack(load_job(job), load_shop("ualberta_mla150"), tmp_path / "q.zip", ("gdsii",))
    assert (tmp_path / "q.zip").read_bytes() == package.read_bytes()
