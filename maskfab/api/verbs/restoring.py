"""Photographs that were really taken behind a die, restored."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab import __version__
from maskfab.api.camera import Camera
from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.api.lengths import Length, length_text
from maskfab.camera.protocol import AUTO
from maskfab.camera.restorers.named import RESTORERS, named
from maskfab.camera.restorers.restorer import Blur, Restorer
from maskfab.camera.restorers.wiener import LARGE, Wiener
from maskfab.capture.restoring.best import restored
from maskfab.capture.restoring.binned import BinnedBlur, binned
from maskfab.capture.restoring.developed import developed, require_stops
from maskfab.capture.restoring.measured_psf import MeasuredBlur, read_psf
from maskfab.capture.restoring.photo import Photo, Stated, read_photo
from maskfab.errors import JobError, SourceError
from maskfab.export.images.exr import Fact
from maskfab.export.images.light_image import write_exr, write_png
from maskfab.files.finished import write_mark
from maskfab.files.staging import check_target, staged
from maskfab.measurement.conditions import Conditions
from maskfab.progress import Progress, silent
from maskfab.threads import one_thread
from maskfab.units import parse_length_um

Singles = NDArray[np.float32]

DOCUMENT = "restore.json"
_PIXEL_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class RestoredPhoto:
    """One photograph, restored.

    Attributes:
        name: of its file, without suffix.
        sha256: of its file.
        picture: float32 [3, rows, columns] linear sRGB within 0 to 1, row 0 on top.
        restorer: that was used.
        epsilon: strength of its prior.
        electrons: of white, by which its noise is known.
        read_noise: in electrons.
        clipped: share of its values that were full.
        told: sentences on how it was read.
    """

    name: str
    sha256: str
    picture: Singles
    restorer: str
    epsilon: float
    electrons: float
    read_noise: float
    clipped: float
    told: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """All but the picture."""
        _, rows, columns = self.picture.shape
        return {
            "name": self.name,
            "sha256": self.sha256,
            "rows": rows,
            "columns": columns,
            "restorer": self.restorer,
            "epsilon": self.epsilon,
            "electrons_of_white": self.electrons,
            "read_noise_e": self.read_noise,
            "clipped": self.clipped,
            "told": list(self.told),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Restoration:
    """Restored photographs.

    Attributes:
        photos: in the order of their files.
        blur: sentences on the blur that was undone.
    """

    photos: tuple[RestoredPhoto, ...]
    blur: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """All but the pictures."""
        return {
            "maskfab_version": __version__,
            "blur": list(self.blur),
            "photos": [each.to_dict() for each in self.photos],
        }

    def save(self, out: str | Path, *, force: bool = False) -> list[Path]:
        """Write ``NAME.png`` (8-bit sRGB) and ``NAME.exr`` (linear sRGB, half) of each, and ``restore.json``.

        Raises:
            OutputError: MF401, MF402 if the directory cannot be written or is not empty.
        """
        place = check_target(Path(out), force=force)
        with staged(place) as folder:
            for each in self.photos:
                light = each.picture[:, ::-1].astype(np.float64)
                write_png(light, folder / f"{each.name}.png")
                facts: dict[str, Fact] = {
                    "restorer": each.restorer,
                    "epsilon": each.epsilon,
                    "photo_sha256": each.sha256,
                }
                write_exr(light, folder / f"{each.name}.exr", {**facts, "blur": "; ".join(self.blur)})
            document = json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
            (folder / DOCUMENT).write_text(document + "\n", encoding="utf-8")
            write_mark(folder, None)
            names = sorted(each.name for each in folder.iterdir())
        return [Path(out) / name for name in names]

    def __str__(self) -> str:
        lines = [f"blur: {each}" for each in self.blur]
        for each in self.photos:
            _, rows, columns = each.picture.shape
            lines.append(
                f"{each.name}: {columns} x {rows}, restored by {each.restorer}, epsilon {each.epsilon:.3g}; "
                f"{100 * each.clipped:.2g} % full"
            )
            lines += [f"  {sentence}" for sentence in each.told]
        return "\n".join(lines)


@one_thread
def restore(
    photos: str | Path | Sequence[str | Path],
    *,
    job: AnyJob | None = None,
    die: str | None = None,
    camera: Camera | None = None,
    psf: str | Path | Sequence[str | Path] | None = None,
    restore: str | Sequence[str] = AUTO,
    epsilon: float | None = None,
    bin: bool = False,
    pixel: Length | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
    gain: float | None = None,
    read_noise: float | None = None,
    stops: float = 0.0,
    progress: Progress = silent,
) -> Restoration:
    """Restore photographs that were taken behind a die, by its PSF as designed or as measured.

    Args:
        photos: RAW, linear TIFF or PNG of 16 bits, EXR; any other picture is taken for code values of sRGB.
        job: a plate, a loaded job, or the path of a job file, whose camera took them; its pixel is the photographs'.
        die: of the job, by name; of a job with one die, that.
        camera: of a plate; by default its own.
        psf: in place of job and die: an EXR of a point light's capture, or one or three that ``maskfab run`` wrote.
        restore: one or several restorers, or ``"auto"`` for the one of all that each record speaks for.
        epsilon: strength of the restorer's prior; what each record speaks for if None.
        bin: restore means over 2 x 2 pixels.
        pixel: side of the photographs' pixels, to be held against that of the PSF's file.
        black: counts of no light; what the file states if None.
        white: counts of a full pixel; what the file states if None.
        mosaic: ``"rggb"``, ``"bggr"``, ``"grbg"`` or ``"gbrg"`` of a picture that holds a mosaic in grey.
        gain: electrons per count; the noise is estimated from the photograph if None.
        read_noise: in electrons, goes with the gain.
        stops: by which pictures are brightened.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for an unknown die or restorer, both a job and a PSF or neither, or photographs of one name;
            MF104 for stops or a pixel that cannot be; MF121, MF142 for photographs that are too small or too large;
            else as :func:`maskfab.camera.die_transfer.die_transfer`.
        SourceError: MF351 for a PSF that is wider than a photograph, MF352 of another pixel; as
            :func:`maskfab.capture.restoring.measured_psf.read_psf` and
            :func:`maskfab.capture.restoring.photo.read_photo`.
    """
    require_stops(stops)
    if epsilon is not None and not 0 < epsilon < np.inf:
        raise JobError(
            "MF104", f"a strength of {epsilon:g} is not above 0", where="epsilon", cure="Give a number such as 0.03"
        )
    paths = [Path(photos)] if isinstance(photos, str | Path) else [Path(each) for each in photos]
    _require_names(paths)
    names = (restore,) if isinstance(restore, str) else tuple(restore)
    restorers = named(tuple(name for name in names if name != AUTO) or tuple(RESTORERS))
    stated = Stated(black, white, mosaic, gain, read_noise)
    blur, about = _blur(job, die, camera, psf, pixel)
    cells = isinstance(blur, MeasuredBlur) and blur.of_cells
    if cells and not bin:
        raise SourceError(
            "MF353",
            "the PSF was captured with a mosaic, which tells it for cells of 2 x 2 pixels alone",
            where="psf",
            cure="Add --bin (bin=True), or give the PSF of the job's die",
        )
    found = []
    for done, path in enumerate(paths):
        progress("photographs", done, len(paths))
        photo = read_photo(path, stated, cells=cells)
        _require_fit(blur, photo)
        found.append(
            _restored(photo, blur, restorers, chosen=AUTO in names, epsilon=epsilon, bin=bin and not cells, stops=stops)
        )
    progress("photographs", len(paths), len(paths))
    return Restoration(tuple(found), about)


def _restored(
    photo: Photo,
    blur: Blur,
    restorers: Sequence[Restorer],
    *,
    chosen: bool,
    epsilon: float | None,
    bin: bool,
    stops: float,
) -> RestoredPhoto:
    record, seen, told = photo.record, blur, photo.told
    clipped = float(record.clipped.mean())
    if bin:
        record, seen, told = binned(record), BinnedBlur(blur), (*told, "means over 2 x 2 pixels")
    if record.values[0].size > LARGE:
        if not chosen and [each.name for each in restorers] != [Wiener().name]:
            raise JobError(
                "MF142",
                f"{restorers[-1].name} keeps too much of {record.values[0].size / 1e6:.3g} million pixels; the limit "
                f"is {LARGE / 1e6:g} million",
                where=photo.name,
                cure="Restore it by wiener, or add --bin for a quarter of the pixels",
            )
        restorers, told = (Wiener(),), (*told, f"of more than {LARGE / 1e6:g} million pixels, so restored by wiener")
    won = restored(record, seen, restorers, epsilon)
    noise = record.noise
    read = float(record.noise.variance(np.zeros(1, dtype=np.float32))[0]) ** 0.5 * noise.electrons
    picture = developed(photo, won.picture, stops)
    return RestoredPhoto(photo.name, photo.sha256, picture, won.name, won.epsilon, noise.electrons, read, clipped, told)


def _blur(
    job: AnyJob | None,
    die: str | None,
    camera: Camera | None,
    psf: str | Path | Sequence[str | Path] | None,
    pixel: Length | None,
) -> tuple[Blur, tuple[str, ...]]:
    if (job is None) == (psf is None):
        raise JobError(
            "MF105",
            "the blur is that of a job's die or of a PSF, and " + ("neither" if job is None else "both") + " is given",
            where="psf",
            cure="Give a job and a die, or the EXR file of a PSF",
        )
    pixel_um = None if pixel is None else parse_length_um(length_text(pixel), where="pixel")
    if psf is not None:
        for key, value in (("die", die), ("camera", camera)):
            if value is not None:
                raise JobError(
                    "MF105", f"a {key} goes with a job, and a PSF is given", where=key, cure=f"Remove {key}, or the PSF"
                )
        files = [Path(psf)] if isinstance(psf, str | Path) else [Path(each) for each in psf]
        measured = read_psf(files)
        _require_pixel(pixel_um, measured.pixel_um, "the PSF")
        return measured, measured.told
    assert job is not None
    loaded = job_of(job, camera)
    panels = loaded.panels()
    names = dies_of(die, panels)
    if len(names) > 1:
        raise JobError(
            "MF105", f"the job has {len(names)} dies", where="die", cure=f"Name the one in use: {', '.join(names)}"
        )
    _require_pixel(pixel_um, loaded.camera.pixel_um, "the job")
    design, left_out = Conditions.of(loaded, "camera").design(names[0], panels[names[0]], loaded)
    return design, (
        f"die {names[0]} as designed, pixels of {loaded.camera.pixel_um:g} um",
        *left_out,
    )


def _require_names(paths: Sequence[Path]) -> None:
    names = [path.stem for path in paths]
    if not names or len(set(names)) < len(names):
        twice = next((name for name in names if names.count(name) > 1), "")
        raise JobError(
            "MF105",
            f"two photographs have the name {twice}" if names else "there is no photograph",
            where="photos",
            cure="Give one or more, each with a name of its own",
        )


def _require_pixel(stated_um: float | None, known_um: float | None, whose: str) -> None:
    if stated_um is None or known_um is None or abs(stated_um - known_um) <= _PIXEL_TOLERANCE * known_um:
        return
    raise SourceError(
        "MF352",
        f"the photographs have pixels of {stated_um:g} um, and {whose} has pixels of {known_um:g} um",
        where="pixel",
        cure="Give a PSF, or a job, of the camera that took them",
    )


def _require_fit(blur: Blur, photo: Photo) -> None:
    if not isinstance(blur, MeasuredBlur):
        return
    (high, wide), (rows, columns) = blur.kernels.shape[1:], photo.record.values.shape[1:]
    if high > rows or wide > columns:
        raise SourceError(
            "MF351",
            f"the PSF has {wide} x {high} pixels, and the photograph {columns} x {rows}",
            where=photo.name,
            cure="Crop the PSF's capture closer about the light, or give a larger photograph",
        )
