"""What is damaged: small whole files of every kind that something of maskfab reads."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from klayout import db
from small_job import DRAWING, OPENING, write_job

from maskfab.base import resources
from maskfab.base.model import Plate
from maskfab.job.sections import ExportSection
from maskfab.mask.formats.cif import write_cif
from maskfab.mask.formats.dxf_writer import write_dxf
from maskfab.mask.formats.gdsii import write_gdsii, write_oasis
from maskfab.mask.houses.files import PlateFiles, files_of_job
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import Job, load_job
from maskfab.mask.layout import plate_layout
from maskfab.mask.package.pack import pack

SUFFIXES = {
    "gdsii": ".gds", "oasis": ".oas", "dxf": ".dxf", "gerber": ".gbr", "cif": ".cif", "png": ".png", "tiff": ".tif",
    "exr": ".exr", "toml": ".toml", "text": ".txt", "npy": ".npy", "job": ".toml", "map": ".toml", "template": ".toml",
    "shop": ".toml", "package": ".zip", "svg": ".svg", "step": ".step", "glb": ".glb", "3mf": ".3mf", "stl": ".stl",
}  # fmt: skip
"""Every reader, and what its files end in."""

WRITTEN = ("svg", "step", "glb", "3mf", "stl")
"""Formats that are only read back after they were written, never from anybody else."""

_DATE = "2024:01:02 03:04:05"
"""For pictures that would hold the time of writing, and be others a second later."""

FEW = (
    ('"SMALL PLATE"', '"S"'),
    ('"periodic"', '"P"'),
    ('"random"', '"R"'),
    ('"560 um"', '"280 um"'),
    ('"400 um"', '"200 um"'),
)
MAP = "name = 'turns'\nmap = '''\n0415\n7726\n'''\nopenings = '''\n0010\n0000\n'''\nshifts = [[0, 0], [2, 0]]\n"


@cache
def originals(reader: str) -> tuple[bytes, ...]:
    """The files of a reader."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"o{SUFFIXES[reader]}"
        return tuple(content if isinstance(content, bytes) else path.read_bytes() for content in FILES[reader](path))


@cache
def job() -> Job:
    """Few cells and few letters: what is damaged should matter."""
    with tempfile.TemporaryDirectory() as folder:
        return load_job(write_job(Path(folder), *FEW))


@cache
def plate() -> Plate:
    return job().plate()


@cache
def design() -> db.Layout:
    return plate_layout(plate())


@cache
def clear_alone() -> db.Layout:
    """The layout of a Gerber file, which holds one layer."""
    layout = design().dup()
    for info in layout.layer_infos():
        if not info.is_equivalent(db.LayerInfo(1, 0)):
            layout.clear_layer(layout.find_layer(info))
    return layout


@cache
def made(reader: str) -> PlateFiles:
    """The plate drawn for one file of a format."""
    export = ExportSection.model_validate({"formats": ["gdsii", reader]})
    whole = files_of_job(plate(), job().spec.model_copy(update={"export": export}), ["fuzz"])
    # SVG has no die of its own, and of STEP the first file is the light assembly of the plate.
    chosen = next(each for each in whole.products[1:] if each.die or reader == "svg")
    return replace(whole, products=(chosen,))


def mask() -> np.ndarray:
    return np.array([[character == "#" for character in row] for row in reversed(DRAWING.split())])


def file_name(reader: str) -> str:
    """What a file to be read has to be called."""
    return made(reader).products[0].name if reader in WRITTEN else f"damaged{SUFFIXES[reader]}"


# --- the files: each function writes to the path, or yields bytes, once for every original ---


def _gdsii(path: Path) -> Iterator[bytes | None]:
    yield write_gdsii(design(), path)


def _oasis(path: Path) -> Iterator[bytes | None]:
    yield write_oasis(design(), path)
    plain = db.SaveLayoutOptions()
    plain.format, plain.oasis_write_cblocks, plain.oasis_compression_level = "OASIS", False, 0
    yield design().write(str(path), plain)


def _dxf(path: Path) -> Iterator[bytes | None]:
    for version in ("R12", "R2010"):
        write_dxf(plate(), path, version)
        yield None


def _gerber(_path: Path) -> Iterator[bytes]:
    """Every polygon on CLEAR as a region, in millimetres with six decimals."""
    lines = ["%FSLAX46Y46*%", "%MOMM*%", "G01*", "%LPD*%"]
    shapes = db.Region(design().top_cell().begin_shapes_rec(design().find_layer(1, 0)))
    shapes.merged_semantics = False
    for polygon in shapes.each():
        points = [f"X{point.x}Y{point.y}" for point in polygon.each_point_hull()]
        lines += ["G36*", f"{points[0]}D02*", *(f"{point}D01*" for point in (*points[1:], points[0])), "G37*"]
    yield "\n".join([*lines, "M02*", ""]).encode()


def _cif(path: Path) -> Iterator[bytes | None]:
    yield write_cif(plate(), path)
    plain = db.SaveLayoutOptions()
    plain.format = "CIF"
    yield design().write(str(path), plain)


def _picture(path: Path) -> Iterator[None]:
    import OpenImageIO as oiio  # noqa: N813

    pixels = np.kron(mask()[::-1].astype(np.uint8) * 255, np.ones((4, 4), dtype=np.uint8))[:, :, None]
    spec = oiio.ImageSpec(28, 28, 1, oiio.UINT8)
    spec.attribute("XResolution", 5000.0)
    spec.attribute("YResolution", 5000.0)
    spec.attribute("ResolutionUnit", "cm")
    if path.suffix == ".tif":
        spec.attribute("DateTime", _DATE)
    image = oiio.ImageOutput.create(str(path))
    assert image.open(str(path), spec)
    assert image.write_image(pixels)
    image.close()
    yield None


def _exr(path: Path) -> Iterator[None]:
    import OpenImageIO as oiio  # noqa: N813

    for channels in (1, 3):
        spec = oiio.ImageSpec(7, 7, channels, oiio.HALF)
        spec.attribute("DateTime", _DATE)
        spec.attribute("Software", "a program with a name")
        image = oiio.ImageOutput.create(str(path))
        assert image.open(str(path), spec)
        assert image.write_image(np.repeat(mask()[::-1, :, None].astype(np.float32), channels, axis=2))
        image.close()
        yield None


def _npy(path: Path) -> Iterator[None]:
    np.save(path, mask())
    yield None


def _job(path: Path) -> Iterator[bytes]:
    yield write_job(path.parent, *FEW).read_bytes()


def _package(path: Path) -> Iterator[None]:
    pack(job(), load_shop("generic-chrome"), path)
    yield None


def _bundled(folder: str, *names: str) -> Callable[[Path], Iterator[bytes]]:
    return lambda _path: (resources.path(f"export_templates/{folder}/{name}.toml").read_bytes() for name in names)


def _written(reader: str) -> Callable[[Path], Iterator[object]]:
    return lambda path: (product.write(path) for product in made(reader).products)


FILES: dict[str, Callable[[Path], Iterator[object]]] = {
    "gdsii": _gdsii,
    "oasis": _oasis,
    "dxf": _dxf,
    "gerber": _gerber,
    "cif": _cif,
    "png": _picture,
    "tiff": _picture,
    "exr": _exr,
    "toml": lambda _path: iter([OPENING.encode()]),
    "text": lambda _path: iter([DRAWING.encode()]),
    "npy": _npy,
    "job": _job,
    "map": lambda _path: iter([MAP.encode()]),
    "template": _bundled("plates", "4in", "5in"),
    "shop": _bundled("shops", "generic-chrome", "mr_nanotec"),
    "package": _package,
    **{reader: _written(reader) for reader in WRITTEN},
}
