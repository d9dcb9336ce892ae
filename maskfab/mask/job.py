"""A job with everything it refers to: the validated spec and its openings, self-contained and hashed."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from maskfab.base import provenance, units
from maskfab.base.cell_size import CellSize
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import AtFault, Faults, JobError, SourceError
from maskfab.base.files import suffix_of
from maskfab.base.model import Opening, Panel, Plate, Quantity, Tiling
from maskfab.job.camera import Camera
from maskfab.job.die import DieSection, check_seed, check_window
from maskfab.job.faults import JobFaults
from maskfab.job.grid import check_grid
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.job.read import check_windows, document, examined
from maskfab.job.sections import EmittersSection, JobSpec
from maskfab.job.values import is_table
from maskfab.mask import opening_file, panels
from maskfab.mask.panels import DieSeeds, die_panels

if TYPE_CHECKING:
    from maskfab.optics.scene.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
class Job:
    """A resolved job.

    Attributes:
        spec: validated; its dies name openings that ``spec.openings`` holds as text.
        openings: the openings of every die, by the die's name; most have one. A map that moves an opening makes
            several of the one that the spec holds.
        digest: SHA-256 of the resolved spec, as far as it shows in the data.
        laid_out: dies of which Python stated an opening alone.
        camera_assumed: whether Python stated no camera, and that of protocol F1 stands for it.
        file: that holds all of the job, which was read from it as it is.
    """

    spec: JobSpec
    openings: Mapping[str, tuple[Opening, ...]]
    digest: str
    where: str
    laid_out: frozenset[str] = frozenset()
    camera_assumed: bool = False
    file: Path | None = None

    def __repr__(self) -> str:
        name = Path(self.where).stem if self.spec.job is None else self.spec.job.name
        return f"<Job {name}: {', '.join(die.name for die in self.spec.die)}>"

    @property
    def seeds(self) -> dict[str, int]:
        return {die.name: die.seed for die in self.spec.die if die.seed is not None}

    @property
    def camera(self) -> Camera:
        return self.spec.camera

    @property
    def blank(self) -> MaskBlank:
        """The mask blank, as far as the job states it."""
        return UNSTATED if self.spec.plate is None else self.spec.plate.mask_blank

    @cached_property
    def scene(self) -> Scene | None:
        """The scene of the camera; None if the job has no [scene]."""
        if self.spec.scene is None:
            return None
        from maskfab.optics.scene.scene import Scene

        return Scene.of(self.spec.scene, self.spec.curves, camera=self.camera, where=self.where).through(self.blank)

    @property
    def notes(self) -> dict[str, Quantity]:
        """Notes by die: an opening alone was tiled periodically; or its map or opening names the seeds that its
        display fits, and not this one."""
        notes = {}
        for die in self.spec.die:
            if die.name in self.laid_out:
                told = panels.periodic_note(
                    die.opening, die.size or (self.spec.plate.die_size if self.spec.plate else None)
                )
                notes[die.name] = Quantity("assumed_tiling", Tiling.PERIODIC.value, told, die=die.name)
            name, seeds = named_seeds(die, self.spec, self.openings[die.name])
            message = None if seeds is None or die.seed is None else seeds.against(die.seed, name)
            if message is not None:
                notes[die.name] = Quantity("display_seed", die.seed, message, die=die.name)
        return notes

    def assumptions(self, dies: Collection[str] | None = None) -> tuple[str, ...]:
        """Sentences on what was assumed of those dies, of some or of all, that Python stated as openings alone."""
        return tuple(
            f"{name}: {note.method}."
            for name, note in self.notes.items()
            if name in self.laid_out and (dies is None or name in dies)
        )

    @property
    def compared_with(self) -> str | None:
        """Die that the others are compared with: the one that [report] names, or the first."""
        stated = None if self.spec.report is None else self.spec.report.reference
        return stated or next((die.name for die in self.spec.die), None)

    @property
    def signature(self) -> str:
        return provenance.signature(self.digest, self.seeds)

    def check_window(self) -> None:
        """Refuse a window that shows replicas of the PSF, for verbs that show a PSF."""
        check_windows(self.spec, self.where)
        for band in () if self.scene is None else self.scene.bands:
            for number, die in enumerate(self.spec.die):
                place = f"{self.where}: scene.spectrum, {band.name}: die[{number}]"
                check_window(replace(self.camera, wavelengths_nm=band.range_nm), die.dot, where=place)

    def panels(self) -> dict[str, Panel]:
        """The panel of every die, by its name; see :func:`maskfab.mask.panels.die_panels` for what is refused."""
        with self._camera_asked_for():
            return die_panels(self.spec, self.openings, where=self.where)

    def plate(self) -> Plate:
        """The job laid out; see :func:`maskfab.mask.composition.compose` for what is refused."""
        from maskfab.mask.composition import compose

        with self._camera_asked_for():
            return compose(self.spec, self.openings, self.signature, where=self.where)

    @contextmanager
    def _camera_asked_for(self) -> Iterator[None]:
        """Ask for the camera where only the stop of one that was assumed is too wide."""
        try:
            yield
        except JobError as refusal:
            if not self.camera_assumed or refusal.code != "MF114":
                raise
            cure = 'Give the camera that looks through it, camera=Camera("5.6 mm", ...), to the plate or to the call'
            raise JobError(refusal.code, refusal.what, where=refusal.where, cure=cure) from None


Further: TypeAlias = "Callable[[Job, JobFaults], object]"
"""Refusals of a verb, of a job before any work."""


@checked_arguments
def load_job(path: str | Path, further: Further | None = None) -> Job:
    """Read a job file and every file it names; nothing is computed yet.

    Args:
        further: what a verb refuses before any work; called where there are faults, to tell it with them. Of the job
            that it gets nothing that is at fault can be read (:class:`maskfab.base.errors.AtFault`).

    Raises:
        JobError, OpeningError, SourceError, OutputError: for all that is wrong, at once.
    """
    stated = Path(path)
    data = document(stated, "job")
    faults = JobFaults.of(data)
    job = _job(examined(data, faults, where=str(stated)), stated, faults)
    if further is not None and faults:
        with faults:
            further(job, faults)
    faults.refuse()
    return replace(job, file=stated)


def resolve(stated: JobSpec, path: Path) -> Job:
    """The job of a validated spec from the file ``path``, with the files that it names relative to its folder."""
    faults = JobFaults.of_spec(stated)
    job = _job(stated, path, faults)
    faults.refuse()
    return job


class _Sound(dict[str, Any]):
    """Files that were read, by name; the rest is at fault, as was told."""

    def __missing__(self, name: str) -> Any:
        raise AtFault


def _job(stated: JobSpec, path: Path, faults: JobFaults) -> Job:
    openings, drawings = _Sound(), dict[str, str]()
    spec = stated.model_copy(update={"openings": drawings})
    with faults:
        spec = spec.model_copy(update={"die": _drawn(stated, openings, drawings, path, faults)})
        spec = _with_maps(spec, path, faults)
        spec = _with_seeds(spec, openings, path, faults)
    lit = None
    with faults:
        lit = _with_curves(spec, path)
    # Curves at fault leave nothing of a scene's light to judge; a house at fault, nothing of files.
    spec = lit or spec.model_copy(update={"scene": None, "curves": {}})
    sold = None
    with faults:
        sold = _with_shop(spec, path)
    spec = sold or spec.model_copy(update={"export": None, "shops": {}})
    if faults:
        return Job(spec, openings, "", str(path))
    return Job(spec, _moved(spec, openings, path), provenance.job_hash(spec.drawn()), str(path))


def _drawn(
    stated: JobSpec, openings: dict[str, tuple[Opening, ...]], texts: dict[str, str], path: Path, faults: JobFaults
) -> tuple[DieSection, ...]:
    """The dies with their openings by name; the openings, by die, and their texts are put into the mappings."""
    dies, lost = list(stated.die), set[str]()
    for i, die in enumerate(stated.die):
        with faults:
            names = (die.opening, *(die.others or ()))
            if not lost.isdisjoint(names):
                continue  # told of an earlier die
            lost.update(names)
            with faults.of_die(die.name):
                held = tuple(_opening(name, die, i, stated, path) for name in names)
            lost.difference_update(names)
            panels.check_alike(held, f"{path}: die[{i}].others")
            with faults:
                check_die_grid(die, held[0], stated.emitters, f"{path}: ", f"die[{i}]", pitch_alone=True)
            for opening in held:
                _keep(texts, opening.name, opening_file.opening_text(opening), "openings", f"{path}: die[{i}].opening")
            openings[die.name], dies[i] = held, _resolved(die, held)
    return tuple(dies)


def masks_in(folder: Path) -> dict[str, Path]:
    """Files of a folder by their names in small letters, to take the place of openings of these names.

    Raises:
        SourceError: MF301 for no folder, or an empty one.
        JobError: MF109 for two files of one name.
    """
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name[0] == ".":
            continue
        other = found.setdefault(path.stem.lower(), path)
        if other != path:
            what = f"{other.name} and {path.name} would take the place of one opening"
            raise JobError("MF109", what, where=str(folder), cure="Leave one of them out")
    if not found:
        raise SourceError("MF301", f"there are no masks in {folder}", cure="Give a folder of openings")
    return found


def with_masks(job: Job, masks: Mapping[str, Path]) -> tuple[Job, dict[str, Path]]:
    """The job with files in place of its openings of those names, and which were used.

    Returns:
        The job, and the file of every opening that was replaced, by the opening's name.

    Raises:
        JobError: MF147 for a mask of other dots or another pitch than the opening, and as for a job.
    """
    texts, used = dict(job.spec.openings), {}
    for name, text in job.spec.openings.items():
        path = masks.get(name.lower())
        if path is None:
            continue
        held = opening_file.parse_opening(text, f"{job.where}: openings.{name}")
        grid = path.suffix.lower() in opening_file.GRIDS
        stated = path.suffix.lower() == ".toml"
        given = opening_file.load_opening(
            path, name=name, dots=None if grid else held.dots, dot_nm=None if stated else held.dot_nm
        )
        if (given.dots, given.dot_nm) != (held.dots, held.dot_nm):
            sizes = [f"{one.dots} x {one.dots} dots of {one.dot_nm / units.NM_PER_UM:g} um" for one in (given, held)]
            what = f"the mask has {sizes[0]}, and the opening {name!r} {sizes[1]}"
            raise JobError("MF147", what, where=str(path), cure="Draw both with as many dots of one size")
        texts[name], used[name] = opening_file.opening_text(given), path
    if not used:
        return job, used
    return resolve(job.spec.model_copy(update={"openings": texts}), Path(job.where)), used


def _keep(texts: dict[str, str], name: str, text: str, kind: str, where: str) -> None:
    """Hold a file's text under its name, which must not stand for another text already."""
    if texts.setdefault(name, text) != text:
        what = f"two different {kind} have the name {name!r}"
        raise JobError("MF109", what, where=where, cure="Give one of them another name in its file")


def _with_maps(stated: JobSpec, path: Path, faults: JobFaults) -> JobSpec:
    """The spec with the text of every map that its dies name, by the map's own name."""
    texts, dies = _Sound(), list(stated.die)
    for i, die in enumerate(stated.die):
        with faults:
            if die.map is None:
                continue
            given = stated.maps.get(die.map)
            with faults.of_die(die.name):
                cells = (
                    panels.read_map(path.parent / die.map)
                    if given is None
                    else panels.parse_map(given, f"{path}: maps.{die.map}")
                )
            _keep(texts, cells.name, panels.map_text(cells), "maps", f"{path}: die[{i}].map")
            dies[i] = die.model_copy(update={"map": cells.name})
    return stated.model_copy(update={"die": tuple(dies), "maps": texts if faults else dict(texts)})


def _with_seeds(stated: JobSpec, openings: Mapping[str, tuple[Opening, ...]], path: Path, faults: JobFaults) -> JobSpec:
    """The spec with a seed for dies that need one and state none: the first their files name; MF111 without any."""
    dies = list(stated.die)
    for i, die in enumerate(stated.die):
        with faults:
            dies[i] = _seeded(die, stated, openings[die.name])
            check_seed(dies[i], f"{path}: die[{i}]")
    return stated.model_copy(update={"die": tuple(dies)})


def _seeded(die: DieSection, spec: JobSpec, held: Sequence[Opening]) -> DieSection:
    if die.seed is not None or not (die.tiling.seeded or die.others):
        return die
    _, named = named_seeds(die, spec, held)
    return die if named is None else die.model_copy(update={"seed": named.fit[0]})


def named_seeds(die: DieSection, spec: JobSpec, held: Sequence[Opening]) -> tuple[str, DieSeeds | None]:
    """The map of a die, or else its opening, by name, and the seeds of dies that it names; None where it names none.

    Nothing is drawn round a map that says what lies there, so that one seed is as good as another.
    """
    if die.map is not None:
        cells = panels.parse_map(spec.maps[die.map], die.map)
        return cells.name, DieSeeds((0,)) if cells.beyond is not None else DieSeeds.of(cells.provenance)
    return held[0].name, DieSeeds.of(held[0].provenance)


def _moved(
    resolved: JobSpec, openings: Mapping[str, tuple[Opening, ...]], path: Path
) -> dict[str, tuple[Opening, ...]]:
    """The openings of every die with those that its map makes by moving one."""
    held = dict(openings)
    for i, die in enumerate(resolved.die):
        if die.map is not None:
            where = f"{path}: die[{i}].map"
            held[die.name] = panels.shifted_openings(
                panels.parse_map(resolved.maps[die.map], where), held[die.name], where=where
            )
    return held


def _with_curves(stated: JobSpec, path: Path) -> JobSpec:
    """The spec with the text of every table of curves that its scene names, by the file's own name."""
    if stated.scene is None:
        return stated.model_copy(update={"curves": {}})
    from maskfab.optics.response import curves_text

    named: dict[str, str] = {}
    texts: dict[str, str] = {}
    for key in ("spectrum", "illuminant", "projection"):
        value = getattr(stated.scene, key)
        if not isinstance(value, str) or not is_table(value):
            continue
        where = f"{path}: scene.{key}"
        text = stated.curves[value] if value in stated.curves else curves_text(path.parent / value, where)
        named[key] = Path(value).name
        _keep(texts, named[key], text, "tables", where)
    return stated.model_copy(update={"scene": stated.scene.model_copy(update=named), "curves": texts})


def _with_shop(stated: JobSpec, path: Path) -> JobSpec:
    """The spec with the profile of the house that its [export] names by a file, under the file's own name."""
    section = stated.export
    if section is None or section.shop is None or not section.shop.endswith(".toml"):
        return stated.model_copy(update={"shops": {}})
    from maskfab.job.shop import dump_shop, parse_shop, read_shop

    name, text = Path(section.shop).name, stated.shops.get(section.shop)
    if text is None:
        shop = read_shop(path.parent / section.shop, f"{path}: export.shop")
    else:
        shop = parse_shop(text, Path(name).stem, where=f"{path}: shops.{section.shop}")
    return stated.model_copy(
        update={"export": section.model_copy(update={"shop": name}), "shops": {name: dump_shop(shop)}}
    )


def _resolved(die: DieSection, held: tuple[Opening, ...]) -> DieSection:
    first, *others = (opening.name for opening in held)
    names = {"opening": first, "others": tuple(others) or None}
    return die.model_copy(update={**names, "opening_layer": None, "opening_cell": None, "opening_unit": None})


def check_die_grid(
    die: DieSection, opening: Opening, emitters: EmittersSection | None, where: str, key: str, *, pitch_alone: bool
) -> None:
    """Refuse the lengths of a die and its emitters that share no grid; see :func:`maskfab.job.grid.check_grid`.

    Args:
        pitch_alone: refuse a pitch that is not that of dots and gutter, and leave rules on too fine a grid.

    Raises:
        JobError: MF106 or MF118.
    """
    lengths: list[int] = []
    with Faults():
        lengths = [units.to_nm(die.dot), units.to_nm(die.gutter)]
    if not lengths:
        return  # off the grid of 1 nm, as is told of the die
    dot_nm, gutter_nm = lengths
    made = CellSize(opening.dots, dot_nm, gutter_nm)
    pitch_um = made.pitch_um if die.pitch is None else die.pitch
    if die.tiling is Tiling.HEXAGONAL or (pitch_alone and made.has_pitch(pitch_um)):
        return
    rules = {} if emitters is None else emitters.grid_lengths
    check_grid(pitch_um, opening.dots, dot_nm, gutter_nm, rules, key=key, dots_given=True, where=where)


def _opening(name: str, die: DieSection, number: int, stated: JobSpec, path: Path) -> Opening:
    where = f"{path}: die[{number}]"
    if name in stated.openings:
        return opening_file.parse_opening(stated.openings[name], f"{path}: openings.{name}")
    source = path.parent / name
    if die.opening_unit is not None and suffix_of(source) != ".dxf":
        what = f"{source.name} is no DXF; only the unit of a DXF can be stated"
        raise JobError(
            "MF105", what, where=f"{where}.opening_unit", cure="State it of a DXF alone: other files state their own"
        )
    if source.suffix.lower() == ".toml":
        return opening_file.load_opening(source)
    dot_nm = units.to_nm(die.dot, where=f"{where}.dot", name="dot")
    dots = None if die.pitch is None else CellSize.filling(die.pitch, dot_nm, units.to_nm(die.gutter)).dots
    unit_um = None if die.opening_unit is None else units.UM_PER_UNIT[die.opening_unit]
    try:
        return opening_file.load_opening(
            source, dots=dots, dot_nm=dot_nm, layer=die.opening_layer, cell=die.opening_cell, unit_um=unit_um
        )
    except SourceError as error:
        error.reword(lambda text: re.sub(r"--(layer|cell|unit)\b", r"opening_\1", text))
        raise
