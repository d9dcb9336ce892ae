"""Photographs that were really taken behind a die, restored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from maskfab.api.camera import Camera
from maskfab.api.jobs import AnyJob
from maskfab.api.lengths import Length
from maskfab.api.verbs.blurs import Undone, blurs_of
from maskfab.api.verbs.restored import Restoration, RestoredPhoto
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError, SourceError
from maskfab.base.work import Progress, one_thread, silent
from maskfab.camera.blur import MeasuredBlur
from maskfab.camera.imaging import LARGE, Blur
from maskfab.camera.photo import (
    ChartMatrix,
    Photo,
    Stated,
    balanced,
    chart_matrix,
    developed,
    read_patches,
    read_photo,
    require_stops,
)
from maskfab.camera.protocol import AUTO
from maskfab.camera.record import BinnedBlur, Record, Restorer, binned
from maskfab.camera.registration import brought
from maskfab.camera.restorers import named
from maskfab.camera.restorers.choice import Chosen, restored
from maskfab.camera.restorers.wiener import Wiener


@dataclass(frozen=True, eq=False)
class _Light:
    """A photograph's restored light, in units of each colour's own white, before its colours are made.

    Attributes:
        photo: as it was read.
        record: that was restored.
        won: by the restorer that was chosen.
        told: sentences.
    """

    photo: Photo
    record: Record
    won: Chosen
    told: tuple[str, ...]


@checked_arguments
@one_thread
def restore(
    photos: str | Path | Sequence[str | Path],
    *,
    job: AnyJob | None = None,
    die: str | Sequence[str] | None = None,
    stands: str | None = None,
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
    chart: str | Path | None = None,
    register: bool = False,
    progress: Progress = silent,
) -> Restoration:
    """Restore photographs that were taken behind a die, by its PSF as designed or as measured.

    Args:
        photos: RAW, linear TIFF or PNG of 16 bits, EXR; any other picture is taken for code values of sRGB.
        job: a plate, a loaded job, or the path of a job file, whose camera took them; its pixel is the photographs'.
        die: of the job, by name, for all or one for each photograph; of a job with one die, that.
        stands: ``drawn``, ``turned`` (by 90 degrees), ``mirrored`` or ``mirrored-turned``: how the dies stood before
            the camera; None for what the job says, mirrored if the plate's chrome is away from the lens.
        camera: of a plate; by default its own.
        psf: in place of job and die: an EXR of a point light's capture, or one or three that ``maskfab run`` wrote; or
            as many captures as photographs, one for each.
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
        chart: table (.csv) of a colour chart's patches in the first photograph, by which the colours of all are made;
            see :func:`maskfab.camera.photo.read_patches`.
        register: bring every further photograph onto the first, which shows the same scene.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for an unknown die, stand or restorer, both a job and a PSF or neither, photographs of one name,
            or one photograph to register; MF104 for stops or a pixel that cannot be; MF121, MF142 for photographs that
            are too small or too large; else as :func:`maskfab.camera.die_transfer.die_transfer`.
        SourceError: MF351 for a PSF that is wider than a photograph, MF352 of another pixel, MF354 for photographs that
            do not show one scene, MF355 for a chart that cannot tell colours; as
            :func:`maskfab.camera.blur.read_psf`,
            :func:`maskfab.camera.photo.read_patches` and
            :func:`maskfab.camera.photo.read_photo`.
    """
    require_stops(stops)
    if epsilon is not None and not 0 < epsilon < np.inf:
        raise JobError(
            "MF104", f"a strength of {epsilon:g} is not above 0", where="epsilon", cure="Give a number such as 0.03"
        )
    paths = [Path(photos)] if isinstance(photos, str | Path) else [Path(each) for each in photos]
    _require_names(paths)
    names = (restore,) if isinstance(restore, str) else tuple(restore)
    restorers = named([name for name in names if name != AUTO])
    stated = Stated(black, white, mosaic, gain, read_noise)
    if register and len(paths) == 1:
        raise JobError(
            "MF105", "there is one photograph", where="register", cure="Give two or more photographs of one scene"
        )
    patches = None if chart is None else read_patches(Path(chart))
    undone = blurs_of(len(paths), job=job, die=die, camera=camera, psf=psf, pixel=pixel, stands=stands)
    if not bin and any(each.of_cells for each in undone):
        raise SourceError(
            "MF353",
            "the PSF was captured with a mosaic, which tells it for cells of 2 x 2 pixels alone",
            where="psf",
            cure="Add --bin (bin=True), or give the PSF of the job's die",
        )
    found: list[RestoredPhoto] = []
    colours: ChartMatrix | None = None
    for done, (path, each) in enumerate(zip(paths, undone, strict=True)):
        progress("photographs", done, len(paths))
        photo = read_photo(path, stated, cells=each.of_cells)
        _require_fit(each.blur, photo)
        light = _restored(
            photo, each.blur, restorers, chosen=AUTO in names, epsilon=epsilon, bin=bin and not each.of_cells
        )
        if patches is not None and colours is None:
            neutral = balanced(photo, light.won.picture)
            colours = chart_matrix(patches, neutral, light.record, photo.balance, 2 if bin else 1)
        found.append(_developed(light, each, colours, stops))
    progress("photographs", len(paths), len(paths))
    first, *others = found
    onto = [
        brought((first.name, each.name), first.picture, first.full, each.picture, each.full)
        for each in (others if register else [])
    ]
    return Restoration(tuple(found), tuple(onto), colours)


def _restored(
    photo: Photo,
    blur: Blur,
    restorers: Sequence[Restorer],
    *,
    chosen: bool,
    epsilon: float | None,
    bin: bool,
) -> _Light:
    record, seen, told = photo.record, blur, photo.told
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
    return _Light(photo, record, restored(record, seen, restorers, epsilon), told)


def _developed(light: _Light, undone: Undone, colours: ChartMatrix | None, stops: float) -> RestoredPhoto:
    photo, told = light.photo, light.told
    if colours is not None:
        photo = replace(photo, matrix=colours.matrix)
        told = (*(each for each in told if "colour matrix" not in each), "colours by the chart")
    noise, dark = light.record.noise, np.zeros(1, dtype=np.float32)
    picture = developed(photo, light.won.picture, stops)
    return RestoredPhoto(
        photo.name,
        photo.sha256,
        picture,
        np.asarray(light.record.clipped.any(axis=0) | (picture >= 1).any(axis=0)),
        undone.told,
        light.won.name,
        light.won.epsilon,
        noise.electrons,
        float(noise.variance(dark)[0]) ** 0.5 * noise.electrons,
        float(photo.record.clipped.mean()),
        told,
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
