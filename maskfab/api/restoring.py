"""Photographs that were really taken behind a die, restored: in memory, as files, in words."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from maskfab.api.asked import AnyJob, AnyPhoto, dies_of, job_of, sources, way_round
from maskfab.api.camera import Camera
from maskfab.api.lengths import Length, length_text
from maskfab.api.results import Asked, FolderResult, Told, answers, saved
from maskfab.base import __version__
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError, SourceError
from maskfab.base.folders import Place, staged, write_mark
from maskfab.base.units import parse_length_um
from maskfab.base.work import Progress, one_thread, silent
from maskfab.camera.blur import MeasuredBlur, StandingBlur, WholeBlur, read_psfs, stand_words
from maskfab.camera.chart import ChartMatrix, chart_matrix, read_patches
from maskfab.camera.imaging import Blur, MadeBlur
from maskfab.camera.photo import (
    RestoredPhoto,
    Stated,
    balanced,
    read_photo,
    require_stops,
    restored_light,
)
from maskfab.camera.protocol import AUTO
from maskfab.camera.registration import RegisteredPhoto, brought
from maskfab.camera.restorers import named
from maskfab.findings.photographs import Conditions, Surroundings
from maskfab.job.reference import USES, in_words, unused
from maskfab.mask.formats.exr import write_exr, write_png
from maskfab.optics.colour import code_of_light
from maskfab.report.pages.restored import PAGE, restored_page


@checked_arguments
@one_thread
def restore(
    photos: Annotated[AnyPhoto | Sequence[AnyPhoto], "PHOTO"],
    job: AnyJob | None = None,
    camera: Camera | None = None,
    *,
    die: str | Sequence[str] | None = None,
    stands: str | None = None,
    psf: str | Path | Sequence[str | Path] | None = None,
    restore: str | Sequence[str] = AUTO,
    epsilon: float | None = None,
    trust: bool = False,
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
    """Restore photographs taken behind a die, by its PSF as designed or as measured: PNG and linear EXR of each.

    Examples:
        $ maskfab restore photo.dng --job job.toml --die TOLED_R150 --out restored
        $ maskfab restore *.dng --psf light.exr --gain 1.7 --read-noise 4.9 --bin --out restored
        $ maskfab restore photo.dng --job job.toml --trust --out restored
        $ maskfab restore photo.jpg --psf red.exr --psf green.exr --psf blue.exr --restore wiener --out restored

    Args:
        photos: RAW, linear TIFF or PNG of 16 bits, EXR; any other picture is taken for code values of sRGB. In Python
            also arrays of linear light, [rows, columns, 3] or with mosaic [rows, columns], row 0 the top.
        job: job file (.toml) whose camera took them; its pixel is the photographs'. In Python also a plate, panels or a
            loaded job.
        die: die of the job that they were taken through, or one for each photograph; by default its only one.
        stands: how the dies stood before the camera: drawn, turned (by 90 degrees), mirrored or mirrored-turned; by
            default what the job says, mirrored if the plate's chrome is away from the lens.
        camera: of a plate or of panels; by default the plate's, or that of protocol F1.
        psf: EXR of a point light's capture, or one or three that ``maskfab run`` wrote, or as many captures as
            photographs, one for each; beyond its pixels light is that of job and die, if these are given.
        restore: restorer: wiener, dct+wiener, gradient, dct+gradient or tv; of several the best, by default of all.
        epsilon: strength of the restorer's prior; by default what each record speaks for.
        trust: undo the PSF as it is said to be, even if a photograph speaks against it; a given strength does too.
        bin: restore means over 2 x 2 pixels.
        pixel: side of the photographs' pixels, held against that of the PSF's file or of the job.
        black: counts of no light; by default what the file states.
        white: counts of a full pixel; by default what the file states.
        mosaic: mosaic that a picture in grey holds: rggb, bggr, grbg or gbrg.
        gain: electrons per count, not the analog gain; by default full_well over the analog gain is white above black,
            where [sensor] has bits and a gain, or a base_iso; else the noise is estimated from the photograph.
        read_noise: read noise in electrons, goes with the gain.
        stops: stops to brighten the pictures by.
        chart: table (.csv) of a colour chart's patches in the first photograph, by which the colours of all are made.
        register: bring every further photograph onto the first, which shows the same scene.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for an unknown die, stand or restorer, neither a job nor a PSF, photographs of one name,
            or one photograph to register; MF104 for stops or a pixel that cannot be; MF121, MF142 for photographs that
            are too small or too large; else as :func:`maskfab.camera.die_transfer.die_transfer`.
        SourceError: MF351 for a PSF most of whose light is wider than a photograph, MF352 of another pixel, MF354 for
            photographs that do not show one scene, MF355 for a chart that cannot tell colours, MF356 for
            one in another order; as :func:`maskfab.camera.blur.read_psf`,
            :func:`maskfab.camera.chart.read_patches` and :func:`maskfab.camera.photo.read_photo`.
    """
    require_stops(stops)
    if epsilon is not None and not 0 < epsilon < np.inf:
        what = f"a strength of {epsilon:g} is not above 0"
        raise JobError("MF104", what, where="epsilon", cure="Give a number such as 0.03")
    paths = sources(photos, "photo")
    stems = [Path(path.name).stem for path in paths]
    if not stems or len(set(stems)) < len(stems):
        twice = next((stem for stem in stems if stems.count(stem) > 1), "")
        what = f"two photographs have the name {twice}" if stems else "there is no photograph"
        raise JobError("MF105", what, where="photos", cure="Give one or more, each with a name of its own")
    names = (restore,) if isinstance(restore, str) else tuple(restore)
    restorers = named([name for name in names if name != AUTO])
    sensor = None if job is None else job_of(job, camera).spec.sensor
    stated = Stated(black, white, mosaic, gain, read_noise, sensor)
    if register and len(paths) == 1:
        what = "there is one photograph"
        raise JobError("MF105", what, where="register", cure="Give two or more photographs of one scene")
    patches = None if chart is None else read_patches(Path(chart))
    undone = blurs_of(len(paths), job=job, die=die, camera=camera, psf=psf, pixel=pixel, stands=stands)
    if not bin and any(isinstance(blur, MeasuredBlur) and blur.of_cells for blur, *_ in undone):
        what = "the PSF was captured with a mosaic, which tells it for cells of 2 x 2 pixels alone"
        raise SourceError("MF353", what, where="psf", cure="Add --bin (bin=True), or give the PSF of the job's die")
    results: list[RestoredPhoto] = []
    colours: ChartMatrix | None = None
    for done, (path, (blur, said, rivals)) in enumerate(zip(paths, undone, strict=True)):
        progress("photographs", done, len(paths))
        of_cells = isinstance(blur, MeasuredBlur) and blur.of_cells
        photo = read_photo(path, stated, cells=of_cells)
        record, won, explained, sentences = restored_light(
            photo, blur, restorers, chosen=AUTO in names, epsilon=epsilon, bin=bin and not of_cells, trust=trust,
            rivals=rivals,
        )  # fmt: skip
        if patches is not None and colours is None:
            neutral = balanced(photo, won.picture)
            colours = chart_matrix(patches, neutral, record, photo.balance, 2 if bin else 1)
        light = replace(photo, told=sentences)
        results.append(RestoredPhoto.of(light, record, won, explained, said, colours, stops))
    progress("photographs", len(paths), len(paths))
    first, *others = results
    onto = [
        brought((first.name, other.name), first.picture, first.full, other.picture, other.full)
        for other in (others if register else [])
    ]
    return Restoration(tuple(results), tuple(onto), colours)


@answers(restore)
def _restore(asked: Asked) -> Told:
    answer = saved(asked)
    assert asked.out is not None
    return replace(answer, document={**answer.document, "files": [str(file) for file in sorted(asked.out.iterdir())]})


DOCUMENT = "restore.json"
_SHOWN_PX = 480
"""Pixels along a side of a photograph in a notebook."""


@dataclass(frozen=True, eq=False, repr=False)
class Restoration(FolderResult):
    """Restored photographs.

    Attributes:
        photos: in the order of their files.
        brought: each but the first as it lies on the first, if that was asked for.
        chart: colours by a chart in the first, if one was stated.
    """

    photos: tuple[RestoredPhoto, ...]
    brought: tuple[RegisteredPhoto, ...] = field(default=())
    chart: ChartMatrix | None = None

    def to_dict(self) -> dict[str, Any]:
        """Numbers and words, without the pictures."""
        return {
            "maskfab_version": __version__,
            "photos": [photo.to_dict() for photo in self.photos],
            **({"registered": [photo.to_dict() for photo in self.brought]} if self.brought else {}),
            **({} if self.chart is None else {"chart": self.chart.to_dict()}),
        }

    def _write(self, place: Annotated[Place, "FOLDER!"]) -> list[Path]:
        """``NAME.png`` (sRGB) and ``NAME.exr`` (linear, half), ``NAME_on_FIRST`` if moved, document and page."""
        of = {photo.name: photo for photo in self.photos}
        pictures = [(photo.name, photo.picture, photo) for photo in self.photos]
        pictures += [(f"{photo.name}_on_{photo.onto}", photo.picture, of[photo.name]) for photo in self.brought]
        with staged(place) as folder:
            for name, picture, photo in pictures:
                write_png(picture[:, ::-1], folder / f"{name}.png", exif=photo.exif)
                write_exr(picture[:, ::-1], folder / f"{name}.exr", photo.facts)
            document = json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
            (folder / DOCUMENT).write_text(document + "\n", encoding="utf-8")
            (folder / PAGE).write_text(self._page(), encoding="utf-8")
            write_mark(folder, None)
            names = sorted(file.name for file in folder.iterdir())
        return [place.asked / name for name in names]

    def _page(self) -> str:
        chart, left_out = ("", ()) if self.chart is None else (str(self.chart), self.chart.left_out)
        pictures = [(photo.before, photo.picture) for photo in self.photos]
        onto = [(str(photo), photo.picture) for photo in self.brought]
        return restored_page(self.to_dict(), pictures, onto, chart, left_out)

    def _shown(self) -> str:
        from maskfab.report.figures.scene import tile

        shown = []
        for photo in self.photos:
            step = math.ceil(max(photo.picture.shape) / _SHOWN_PX)
            shown.append(tile(code_of_light(photo.picture[:, ::step, ::step]).astype(np.float32), photo.name))
        return "".join(shown)

    def __str__(self) -> str:
        lines = []
        for photo in self.photos:
            _, rows, columns = photo.picture.shape
            by = "as it was taken"
            if photo.epsilon > 0:
                by = f"restored by {photo.restorer}, epsilon {photo.epsilon:.3g}"
            lines.append(f"{photo.name}: {photo.explained.sentence}")
            lines.append(f"  {columns} x {rows}, {by}; {100 * photo.clipped:.2g} % full")
            lines += [f"  blur: {sentence}" for sentence in photo.blur]
            lines += [f"  {sentence}" for sentence in photo.told]
        if self.chart is not None:
            lines += [str(self.chart), *(f"  {sentence}" for sentence in self.chart.left_out)]
        return "\n".join([*lines, *map(str, self.brought)])


_PIXEL_TOLERANCE = 1e-3
Undone = tuple[Blur, tuple[str, ...], Mapping[str, Blur]]
"""A blur, sentences on it, and those of the job's other dies."""


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
    """The blur of each of so many photographs, of pictures whose first row is the top, sentences on it, and rivals.

    Args:
        photos: how many there are.
        job, camera, pixel, stands: as of :func:`maskfab.api.restoring.restore`.
        die: of all, or of each photograph.
        psf: of all, in one file or three; or one file for each photograph.

    Raises:
        JobError: MF105 for neither a job nor a PSF, another number of dies, or what goes with a job without one; else
            as :func:`maskfab.camera.die_transfer.die_transfer`.
        SourceError: MF352 of another pixel, MF353 for a PSF of a mosaic's cells with a job; as
            :func:`maskfab.camera.blur.read_psf`.
    """
    pixel_um = None if pixel is None else parse_length_um(length_text(pixel, "pixel"), where="pixel")
    if job is None:
        for key, value in (("die", die), ("camera", camera), ("stands", stands)):
            if value is not None:
                what = f"{key} goes with a job, and none is given"
                raise JobError("MF105", what, where=key, cure=f"Give the job, or remove {key}")
    if psf is None:
        if job is None:
            what = "the blur is that of a job's die or of a PSF, and neither is given"
            raise JobError("MF105", what, where="psf", cure="Give a job and a die, or the EXR file of a PSF")
        return _of_dies(job, die, camera, photos, pixel_um, stands)
    files = [Path(psf)] if isinstance(psf, str | Path) else [Path(file) for file in psf]
    blurs = read_psfs(files, photos)
    if job is not None:
        pixel_um = job_of(job, camera).camera.pixel_um if pixel_um is None else pixel_um
    for blur in blurs:
        _require_pixel(pixel_um, blur.pixel_um, "the PSF")
    if job is None:
        return tuple((blur, (*blur.told, blur.lack), {}) for blur in blurs)
    if any(blur.of_cells for blur in blurs):
        what = "the PSF was captured with a mosaic, which tells it for cells, and the job's die for pixels"
        raise SourceError("MF353", what, where="psf", cure="Give fitted_psf.exr of maskfab measure, or no job")
    made = _of_dies(job, die, camera, photos, pixel_um, stands)
    wholes = [WholeBlur.of(blur, design) for blur, (design, *_) in zip(blurs, made, strict=True)]
    return tuple((whole, (*whole.told, *said), rivals) for whole, (_, said, rivals) in zip(wholes, made, strict=True))


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
        what = f"{len(asked)} dies for {photos} photographs" if die else f"the job has {len(asked)} dies"
        cure = f"Name the one in use, or one for each photograph: {', '.join(panels)}"
        raise JobError("MF105", what, where="die", cure=cure)
    way = way_round(stands, loaded)
    _require_pixel(pixel_um, loaded.camera.pixel_um, "the job")
    conditions = Conditions.of(loaded, "camera")
    of_scene = () if loaded.scene is None else USES["simulate a scene"]
    sensor = loaded.spec.sensor
    of_sensor = () if sensor is None or not sensor.known_gain else USES["restore by its sensor"]
    rest = in_words(unused(loaded.spec, *USES["restore"], *of_scene, *of_sensor))

    def made(name: str) -> tuple[Blur, tuple[str, ...]]:
        design, left_out = conditions.design(name, panels[name], Surroundings.of(loaded))
        said = f"die {name} as designed, {stand_words(way)}, pixels of {loaded.camera.pixel_um:g} um"
        return StandingBlur(design, way), (said, *left_out, *rest)

    every = {name: MadeBlur(partial(lambda other: made(other)[0], name)) for name in panels}
    mine = {name: (*made(name), {other: every[other] for other in panels if other != name}) for name in set(asked)}
    return tuple(mine[name] for name in (asked if len(asked) == photos else asked * photos))


def _require_pixel(stated_um: float | None, known_um: float | None, whose: str) -> None:
    if stated_um is None or known_um is None or abs(stated_um - known_um) <= _PIXEL_TOLERANCE * known_um:
        return
    what = f"the photographs have pixels of {stated_um:g} um, and {whose} has pixels of {known_um:g} um"
    raise SourceError("MF352", what, where="pixel", cure="Give a PSF, or a job, of the camera that took them")
