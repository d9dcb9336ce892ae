"""The blur of each photograph that is to be restored: of a job's dies, or of files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from maskfab.api.camera import Camera
from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.api.lengths import Length, length_text
from maskfab.api.stands import way_round
from maskfab.base.errors import JobError, SourceError
from maskfab.base.units import parse_length_um
from maskfab.camera.blur import StandingBlur, read_psfs, stand_words
from maskfab.camera.imaging import Blur
from maskfab.job.reference import USES, in_words, unused
from maskfab.report.rows.photographs import Conditions, Surroundings

_PIXEL_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Undone:
    """A blur that is to be undone.

    Attributes:
        blur: of pictures whose first row is the top.
        told: sentences on it.
        of_cells: whether it is of cells of a mosaic alone.
    """

    blur: Blur
    told: tuple[str, ...]
    of_cells: bool = False


def blurs_of(
    photos: int,
    *,
    job: AnyJob | None,
    die: str | Sequence[str] | None,
    camera: Camera | None,
    psf: str | Path | Sequence[str | Path] | None,
    pixel: Length | None,
    stands: str | None,
) -> tuple[Undone, ...]:
    """The blur of each of so many photographs.

    Args:
        photos: how many there are.
        job, camera, pixel, stands: as of :func:`maskfab.api.verbs.restoring.restore`.
        die: of all, or of each photograph.
        psf: of all, in one file or three; or one file for each photograph.

    Raises:
        JobError: MF105 for both a job and a PSF or neither, another number of dies, or what goes with a job beside a
            PSF; else as :func:`maskfab.camera.die_transfer.die_transfer`.
        SourceError: MF352 of another pixel; as :func:`maskfab.camera.blur.read_psf`.
    """
    if (job is None) == (psf is None):
        raise JobError(
            "MF105",
            "the blur is that of a job's die or of a PSF, and " + ("neither" if job is None else "both") + " is given",
            where="psf",
            cure="Give a job and a die, or the EXR file of a PSF",
        )
    pixel_um = None if pixel is None else parse_length_um(length_text(pixel), where="pixel")
    if psf is not None:
        for key, value in (("die", die), ("camera", camera), ("stands", stands)):
            if value is not None:
                raise JobError(
                    "MF105", f"{key} goes with a job, and a PSF is given", where=key, cure=f"Remove {key}, or the PSF"
                )
        files = [Path(psf)] if isinstance(psf, str | Path) else [Path(each) for each in psf]
        return _of_files(files, photos, pixel_um)
    assert job is not None
    return _of_dies(job, die, camera, photos, pixel_um, stands)


def _of_files(files: Sequence[Path], photos: int, pixel_um: float | None) -> tuple[Undone, ...]:
    found = read_psfs(files, photos)
    for each in found:
        _require_pixel(pixel_um, each.pixel_um, "the PSF")
    return tuple(Undone(each, each.told, each.of_cells) for each in found)


def _of_dies(
    job: AnyJob,
    die: str | Sequence[str] | None,
    camera: Camera | None,
    photos: int,
    pixel_um: float | None,
    stands: str | None,
) -> tuple[Undone, ...]:
    loaded = job_of(job, camera)
    panels = loaded.panels()
    asked = dies_of(die, panels) if die is None or isinstance(die, str) else tuple(die)
    dies_of(asked, panels)
    if len(asked) not in (1, photos):
        raise JobError(
            "MF105",
            f"{len(asked)} dies for {photos} photographs" if die else f"the job has {len(asked)} dies",
            where="die",
            cure=f"Name the one in use, or one for each photograph: {', '.join(panels)}",
        )
    way = way_round(stands, loaded)
    _require_pixel(pixel_um, loaded.camera.pixel_um, "the job")
    conditions = Conditions.of(loaded, "camera")
    of_scene = () if loaded.scene is None else USES["simulate a scene"]
    rest = in_words(unused(loaded.spec, *USES["restore"], *of_scene))
    found = {}
    for name in dict.fromkeys(asked):
        design, left_out = conditions.design(name, panels[name], Surroundings.of(loaded))
        said = f"die {name} as designed, {stand_words(way)}, pixels of {loaded.camera.pixel_um:g} um"
        found[name] = Undone(StandingBlur(design, way), (said, *left_out, *rest))
    return tuple(found[name] for name in (asked if len(asked) == photos else asked * photos))


def _require_pixel(stated_um: float | None, known_um: float | None, whose: str) -> None:
    if stated_um is None or known_um is None or abs(stated_um - known_um) <= _PIXEL_TOLERANCE * known_um:
        return
    raise SourceError(
        "MF352",
        f"the photographs have pixels of {stated_um:g} um, and {whose} has pixels of {known_um:g} um",
        where="pixel",
        cure="Give a PSF, or a job, of the camera that took them",
    )
