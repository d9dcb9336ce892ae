"""PSFs as OpenEXR files: float32, linear, with what a reader needs to use them, and to make them again, in the header.

The finest sampling that a report shows is written: intensity at points, from the polygons read back.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maskfab.base import __version__
from maskfab.export.images.exr import Fact, Facts, write_channels
from maskfab.model import Camera, Die, DieOptics, Plate, Psf, Stop
from maskfab.units import NM_PER_UM

if TYPE_CHECKING:
    from maskfab.job import Job

AXES = (
    "x to the right and y upwards, as the plate's files draw them; the first row of pixels is the uppermost; "
    "the optical axis is the middle pixel"
)


@dataclass(frozen=True, eq=False)
class PsfFile:
    """One PSF of a die, as a file.

    Attributes:
        name: of the file.
        die: whose PSF it is.
        psf: what it holds.
        facts: of its header.
    """

    name: str
    die: Die
    psf: Psf
    facts: Facts

    def write(self, path: Path) -> None:
        """Write it; raises as :func:`write_psf`."""
        write_psf(self.psf, path, self.facts, f"maskfab {self.facts['maskfab_version']}")


def psf_files(
    job: Job, plate: Plate, optics: Sequence[DieOptics], source: str, version: str = __version__
) -> tuple[PsfFile, ...]:
    """One file for each die and wavelength.

    Args:
        job: what was asked for.
        plate: what was made of it.
        optics: what was measured of dies.
        source: name of the file whose polygons were measured.
        version: of the maskfab that writes, or has written, them.
    """
    common = {"plate": plate.name, "source": source, "job_sha256": job.digest, "maskfab_version": version}
    return tuple(
        PsfFile(
            f"{plate.name}_{item.die.name}_psf_{psf.wavelength_nm:.12g}nm.exr",
            item.die,
            psf,
            {**psf_facts(psf), **camera_header(job.camera), **dict(_of_die(job, item.die)), **common},
        )
        for item in optics
        for psf in item.psfs
        if psf.kind == "point"
    )


def psf_facts(psf: Psf) -> dict[str, Fact]:
    """Meaning of the values of a PSF, as header entries."""
    return {
        "wavelength_nm": psf.wavelength_nm,
        "step_um": psf.step_um,
        "kind": psf.kind,
        "unit": "1/um^2",
        "axes": AXES,
    }


def camera_header(camera: Camera) -> dict[str, Fact]:
    """The camera that a PSF holds for."""
    return {
        "focal_um": camera.focal_um,
        "stop": camera.stop.shape,
        "stop_um": camera.stop.diameter_um,
        **stop_facts(camera.stop),
        "sensor_pixel_um": camera.pixel_um,
    }


def stop_facts(stop: Stop) -> dict[str, Fact]:
    """Facts of a stop beyond shape and diameter: its sides, its dark middle, its corners."""
    facts: dict[str, Fact] = {}
    if stop.size_um is not None:
        facts |= {"stop_width_um": stop.size_um[0], "stop_height_um": stop.size_um[1]}
    if stop.inner_share:
        facts["stop_inner_um"] = stop.inner_share * stop.diameter_um
    if stop.outline_um:
        facts["stop_corners_um"] = "; ".join(f"{x:.12g} {y:.12g}" for x, y in stop.outline_um)
    return facts


def write_psf(psf: Psf, path: Path, facts: Facts, software: str) -> None:
    """Write a PSF as one float32 channel, intensity per square micrometre of sensor; row 0 of the file is the top.

    Args:
        psf: what to write.
        path: the file; nothing is left under its name if it fails.
        facts: of the header; those of :func:`psf_facts` at least.
        software: who made it.

    Raises:
        OutputError: MF401 if the file cannot be written.
    """
    # Of an array without the axis of channels OpenImageIO takes the first axis for x.
    write_channels(psf.values[::-1, :, None].astype(np.float32), ("Y",), path, facts, software)


def _of_die(job: Job, die: Die) -> Iterator[tuple[str, Fact]]:
    """Numbers of the panel, and its openings by name and by the hash of their text in the resolved job."""
    panel = die.panel
    section = next(each for each in job.spec.die if each.name == die.name)
    named = (section.opening, *(section.others or ()))
    yield "die", die.name
    yield "pitch_um", panel.cell_size.pitch_um
    yield "dot_um", panel.dot_nm / NM_PER_UM
    yield "gutter_um", panel.gutter_nm / NM_PER_UM
    yield "tiling", panel.tiling.value
    yield "seed", "none" if panel.seed is None else str(panel.seed)
    yield "opening", ", ".join(named)
    yield "opening_sha256", ", ".join(hashlib.sha256(job.spec.openings[name].encode()).hexdigest() for name in named)
