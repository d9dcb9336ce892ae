"""Openings that are found for a display, and the front of those that none betters."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, overload

from numpy.typing import ArrayLike

from maskfab.api.asked import refuse_stated, spec_of
from maskfab.api.camera import Camera, protocol_f1
from maskfab.api.foreseen import Foreseen, sought
from maskfab.api.lengths import Length, length_text, sections_as_text
from maskfab.api.opening import Opening
from maskfab.api.panel import Panel
from maskfab.api.results import Asked, FolderResult, InPython, Result, Told, answers
from maskfab.base import model, provenance
from maskfab.base.arrays import Mask
from maskfab.base.checks import checked_arguments
from maskfab.base.effort import measured
from maskfab.base.errors import JobError, OutputError
from maskfab.base.folders import Place, check_file, check_target, write_text
from maskfab.base.units import NM_PER_UM, parse_time_s
from maskfab.base.work import Progress, budget_clock, ended_by_interrupt, one_thread, silent
from maskfab.base.workers import Workers
from maskfab.camera.stop_cells import PhotoCamera, lattice
from maskfab.designs.design import (
    capture_settings,
    check_possible,
    notes_of,
    require_able,
    require_weights,
    scenes_line,
    scenes_of,
    section_of,
    stated_display,
)
from maskfab.designs.design import design as design_spec
from maskfab.designs.front import Pareto, lines_of, require_uneven, rules_of, sweep
from maskfab.designs.front_designs import FrontDesign, designs
from maskfab.designs.model.statistics import F1_SETTINGS
from maskfab.designs.rules.display_fit import DieFit
from maskfab.designs.search.result import Designed
from maskfab.job.faults import JobFaults
from maskfab.job.read import read, validate
from maskfab.job.reference import USES
from maskfab.job.sections import JobSpec, RelaxSection, SearchSection
from maskfab.mask import opening_file, panels
from maskfab.mask.opening_file import load_opening, opening_text
from maskfab.mask.opening_masks import closed, from_array
from maskfab.mask.panels import CellMap
from maskfab.report.pages import pareto
from maskfab.report.pages.design import DOCUMENT, PAGE, Made, designed_document, write_design
from maskfab.report.text import designed_lines
from maskfab.runs.store import of_installation

if TYPE_CHECKING:
    from maskfab.api.asked import DesignJob  # at run time refused here, with its reason
    from maskfab.report.figures.sheet import Drawing


_FURTHER = ("circuits", "display", "light", "plate", "process", "sensor", "exposure", "scene")
"""Sections of a job that a design uses beside those that are arguments."""

_TASKS = 64
"""Of a search at a time: parts of a batch of shapes."""


@dataclass(frozen=True, eq=False, repr=False)
class Design(Result):
    """An opening that was found, and its map.

    Attributes:
        found: everything that is known of it: proven headroom, cost of rules, notes.
        made: the job and the time that it took.
    """

    found: Designed
    made: Made

    @property
    def opening(self) -> Opening:
        return Opening.of_model(self.found.opening)

    @property
    def outer(self) -> Opening | None:
        """The opening of the outer half of the stop, where the density was asked to differ."""
        return None if self.found.outer is None else Opening.of_model(self.found.outer)

    @property
    def map(self) -> CellMap | None:
        """Which way the cells are turned; None for a design without a map."""
        return self.found.cells

    @property
    def panel(self) -> Panel:
        """The opening laid out by its map.

        Raises:
            JobError: MF105 for a design without a map.
        """
        if self.map is None:
            cure = 'Lay it out: Panel.tile(found.opening, "random", seed=1, size="4.4 mm")'
            raise JobError("MF105", "the design has no map that lays it out", where="Design.panel", cure=cure)
        return Panel.tile(self.opening, self.map, others=() if self.outer is None else (self.outer,))

    @property
    def psnr(self) -> dict[float, float]:
        """Expected PSNR of restored photographs in dB, by the light: the signal-to-noise ratio of white in dB.

        For ranking openings of one design alone. By protocol F1 code values are taken for light and scored, and the die
        is one that is tiled anew for every photograph. :func:`maskfab.simulate` and :func:`maskfab.compare` photograph
        linear light and score it as sRGB: some decibels apart, so hold no number of one against one of the other.
        """
        return dict(zip(self.found.levels, self.found.psnr, strict=True))

    @property
    def headroom(self) -> dict[float, float] | None:
        """Proven bound in dB of what any other opening with as many clear dots could gain, by the light."""
        return None if self.found.head_room is None else dict(zip(self.found.levels, self.found.head_room, strict=True))

    def texts(self) -> dict[str, str]:
        """Contents of the files of the opening, and of the outer opening and the map where there are any."""
        written = {"opening": opening_file.opening_text(self.found.opening)}
        if self.found.outer is not None:
            written["outer"] = opening_file.opening_text(self.found.outer)
        if self.found.cells is not None:
            written["map"] = panels.map_text(self.found.cells)
        return written

    @property
    def passed(self) -> bool:
        """Whether it has as many clear dots as were asked for: a display may hold fewer."""
        return self.found.shortfall is None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for a user, as sentences."""
        cut = ("A run that its budget cut short is not repeated bit for bit.",) if self.found.cut else ()
        return (*self.found.notes, *cut)

    def to_dict(self, paths: Mapping[str, Path] | None = None) -> dict[str, Any]:
        """Everything that was found.

        Args:
            paths: of its files, by part; those of a folder if None.
        """
        return designed_document(self.found, paths or self.names, self.notes, self.made)

    @property
    def names(self) -> dict[str, Path]:
        """Names of its files in a folder, by part."""
        return beside(Path(f"{self.found.opening.name}.toml"))

    @checked_arguments
    def save(self, out: Annotated[str | Path, "FOLDER|FILE.toml"], *, force: bool = False) -> list[Path]:
        """Write the opening (.toml), its map beside it as X_map.toml; or a folder with these, a page and its numbers.

        Args:
            out: folder for page, numbers, opening and map; or file (.toml) for the opening, its map beside it. By
                default the file that the job names.
            force: replace existing files.
        """
        target = Path(out)
        if is_folder(target):
            files = {self.names[part].name: text for part, text in self.texts().items()}
            return write_design(check_target(target, force=force), self.to_dict(), files)
        paths, texts = beside(target), self.texts()
        for part in texts:
            check_file(paths[part], force=force)
        for part, text in texts.items():
            write_text(paths[part], text, replace=force)
        return [paths[part] for part in texts]

    @property
    def fit(self) -> DieFit | None:
        """The die on which the display was found to fit; None where none had to."""
        return self.found.fit

    def plot(self) -> Drawing:
        """The opening."""
        return self.opening.plot()

    def __repr__(self) -> str:
        scores = ", ".join(f"{value:.2f} dB at {level:g} dB" for level, value in self.psnr.items())
        by = "protocol F1, which is not compare's" if F1_SETTINGS.line in self.found.camera else "its own light"
        return f"<Design {self.found.opening.name}: {self.found.shape}; expected by {by}: {scores}>"


def is_folder(target: Path) -> bool:
    """Whether a design goes to a folder with its page, and not to the file of its opening.

    Raises:
        OutputError: MF430 for a file that is no TOML.
    """
    if target.suffix.lower() not in ("", ".toml"):
        problem = f"no opening is written with the suffix {target.suffix!r}"
        raise OutputError("MF430", problem, where=str(target), cure="Use .toml, or name a folder without a suffix")
    return not target.suffix


def beside(target: Path) -> dict[str, Path]:
    """Where the parts of a design go whose opening goes to ``target``."""
    return {
        "opening": target,
        "outer": target.with_name(f"{target.stem}_outer{target.suffix}"),
        "map": target.with_name(f"{target.stem}_map.toml"),
    }


@overload
def design(
    job: DesignJob, *, front: Literal[True], images: str | Path | None = ..., budget: str | None = ...,
    command: str | None = ..., workers: int | None = ..., scheduler: str | None = ..., progress: Progress = ...
) -> ParetoFront: ...  # fmt: skip
@overload
def design(
    job: DesignJob | None = ..., *, dry_run: Literal[True], front: bool = ..., images: str | Path | None = ...,
    budget: str | None = ..., checkpoint: str | Path | None = ..., command: str | None = ..., **keys: Any,
) -> Foreseen: ...  # fmt: skip
@overload
def design(
    job: DesignJob | None = ..., *, start: model.Opening | ArrayLike | None = ..., dots: int | None = ...,
    pitch: Length | None = ..., clear_dots: int | None = ...,
    camera: Camera | None = ..., name: str | None = ..., method: Literal["search", "relax"] | None = ...,
    tiling: str | None = ..., map: Literal["equal_light", "edge_packing", "none"] | None = ...,
    rules: Mapping[str, Any] | None = ..., emitters: Mapping[str, Any] | None = ...,
    wires: Mapping[str, Any] | None = ..., sections: Mapping[str, Any] | None = ...,
    images: str | Path | None = ..., budget: str | None = ..., checkpoint: str | Path | None = ...,
    price_rules: bool = ..., workers: int | None = ..., scheduler: str | None = ..., progress: Progress = ...,
    **keys: Any,
) -> Design: ...  # fmt: skip
@checked_arguments
@one_thread
def design(
    job: Annotated[DesignJob | None, "JOB"] = None,
    *,
    start: InPython[model.Opening | ArrayLike | None] = None,
    dots: InPython[int | None] = None,
    pitch: InPython[Length | None] = None,
    clear_dots: InPython[int | None] = None,
    camera: Camera | None = None,
    name: InPython[str | None] = None,
    method: InPython[Literal["search", "relax"] | None] = None,
    tiling: InPython[str | None] = None,
    map: InPython[Literal["equal_light", "edge_packing", "none"] | None] = None,
    rules: InPython[Mapping[str, Any] | None] = None,
    emitters: InPython[Mapping[str, Any] | None] = None,
    wires: InPython[Mapping[str, Any] | None] = None,
    sections: InPython[Mapping[str, Any] | None] = None,
    front: bool = False,
    images: str | Path | None = None,
    budget: Annotated[str | None, "TIME"] = None,
    checkpoint: str | Path | None = None,
    dry_run: bool = False,
    price_rules: bool = False,
    scheduler: Annotated[str | None, "ADDRESS"] = None,
    workers: Annotated[int | None, "1..1024"] = None,
    command: InPython[str | None] = None,
    progress: Progress = silent,
    **keys: Any,
) -> Design | ParetoFront | Foreseen:
    """Find the opening through which photographs restore best, and its map; or the front of designs for a display.

    Examples:
        $ maskfab design layouts/design_bar.toml -o bar.toml --force
        $ maskfab design job.toml --budget '60 s' --checkpoint state.npz
        $ maskfab design layouts/pareto.toml --front -o build/pareto

    Args:
        job: job file (.toml) with [design]; in Python also a loaded job.
        start: opening, or array of one, that the search or the descent begins at in place of families of shapes. Where
            it breaks rules the nearest opening that was found to keep them all is taken. Without ``anneal`` that is the
            design, so that an opening of one's own is made buildable.
        dots: along the side of a pixel; by default those of the start.
        pitch: side of the pixel; by default that of a start that is an opening.
        clear_dots: met exactly; by default those of the start.
        camera: designed for; by default that of protocol F1.
        name: of the opening; "found" by default.
        method: search among compact shapes, which is the default, or gradient descent.
        tiling: how pixels are turned; "random" by default.
        map: which orientations of the pixels before the stop are designed too; "equal_light" by default where a search
            is for a random tiling, where alone there can be one.
        rules: hard constraints, as design.rules of a job file has them.
        emitters: of the display, as [emitters] of a job file states them, lengths as here; with ``fit=True`` the
            display must fit round the opening, by the checks of :func:`maskfab.check`.
        wires: of the display likewise, as [wires].
        sections: further sections as a job file has them, of those that a design uses: light, plate (for its
            ``die_size``), process (for its ``spread``), sensor, exposure and scene.
        front: find the designs for the display that none betters in photographs, emitters, wires and grain; the job
            has [pareto], [emitters], and a [design] that searches.
        images: folder of photographs to design for; by default synthetic scenes.
        budget: time from the call on, such as ``"60 s"``, within a fifth: take the best that was found by then. Bounds
            and the like are left out where they would take most of it.
        checkpoint: file that saves the state of the search, from which it goes on if it exists.
        dry_run: tell what would be searched and for how long; write nothing. A checkpoint is not looked into.
        price_rules: anneal once more without each rule, beyond the budget, to tell what each costs.
        scheduler: address of a Dask scheduler whose workers share the work, such as tcp://127.0.0.1:8786.
        workers: processes; by default as many as processors and memory bear. The design is the same, unless a budget
            ends it early. A descent takes none.
        command: what reproduces a front, for the openings' provenance; by default this call.
        progress: told where the work stands.
        keys: any other key of [design], such as ``anneal=2000`` or ``families=["bars", "discs"]``.

    Raises:
        OpeningError: MF201 to MF203 for a start that is no opening; a grey one is refused.
        JobError: as for a job file with such a [design]; MF102 for a section that a design does not use; MF105 for
            what is stated beside a job, and for workers of a descent; MF123 for rules that contradict each other, and
            for a display that does not fit; where it fits fewer dots than were asked for, these are designed, and
            :attr:`Design.passed` is false; MF150 for a budget that the first openings exceed; of a front also MF105 for
            a job without its sections and MF109 for two openings of one name.
        OutputError: MF401 for a checkpoint in a directory that does not exist.
    """
    crew = Workers(workers, scheduler, of_installation)
    if front:
        refuse_stated(
            {"checkpoint": checkpoint, "price_rules": price_rules or None, "start": start}, "a front", "front"
        )
        if job is None:
            raise JobError("MF105", "a front is of a job", where="job", cure="Give a job file with [pareto]")
        return _front(
            *spec_of(job, "design"),
            images=images,
            budget=budget,
            workers=crew,
            command=command,
            progress=progress,
            dry_run=dry_run,
        )
    clock = budget_clock(None if budget is None else parse_time_s(budget, where="budget"))
    begin = None if start is None else _begun(start)
    stated: dict[str, Any] = {
        "name": name,
        "method": method,
        "dots": dots,
        "pitch": length_text(pitch, "pitch", "design(): pitch"),
        "clear_dots": clear_dots,
        "tiling": tiling,
        "map": map,
        "rules": None if rules is None else dict(rules),
        **keys,
    }
    given = {key: value for key, value in stated.items() if value is not None}
    if job is not None:
        others = {"camera": camera, "emitters": emitters, "wires": wires, "sections": sections}
        beside_job = [*given, *(key for key, value in others.items() if value is not None)]
        if beside_job:
            what = f"{', '.join(beside_job)} cannot be stated beside a job, which says what is designed"
            raise JobError("MF105", what, where=beside_job[0], cure="State it in the job, or leave the job out")
        spec, path = spec_of(job, "design", partial(check_possible, where=str(job)))
        where, command = str(path), f"maskfab design {path.as_posix()}"
        command += "" if images is None else f" --images {Path(images).as_posix()}"
    else:
        where = "design()"
        display = sections_as_text({k: v for k, v in (("emitters", emitters), ("wires", wires)) if v is not None})
        section = {**_counts(start, begin), **given}
        spec, command = _called(section, display, sections or {}, camera=camera, images=images)
    command += _start_words(start, begin)
    if isinstance(spec.design, RelaxSection):
        refuse_stated({"workers": workers, "scheduler": scheduler}, "a descent", 'method = "relax"')
    photographs, state = (None if path is None else Path(path) for path in (images, checkpoint))
    if dry_run:
        require_able(spec, where, photographs, state, begin)
        return Foreseen(sought(spec), command, clock.budget_s)
    began = time.monotonic()
    with measured(time.process_time) as effort, crew.executor(_TASKS) as executor, ended_by_interrupt(clock):
        best = design_spec(
            spec,
            command,
            where=where,
            images=photographs,
            progress=progress,
            clock=clock,
            checkpoint=state,
            price_rules=price_rules,
            begin=begin,
            executor=executor,
        )
    return Design(best, Made(provenance.job_hash(spec.dump()), time.monotonic() - began, effort.seconds))


@answers(design)
def _design(asked: Asked) -> Told:
    """Files are those of the job, or of ``-o``: places are looked at before any work."""
    job, out = Path(asked.stated["job"]), asked.out
    if asked.stated.get("front"):
        return _design_front(asked, job)
    spec = read(job, partial(check_possible, where=str(job)))
    folder = out if out is not None and is_folder(out) else None
    if folder is not None:
        section_of(spec, str(job))
        check_target(folder, force=asked.force)
    targets = {} if folder is not None else _targets(spec, job, out)
    for target in targets.values():
        check_file(target, force=asked.force)
    designed = asked.found()
    if isinstance(designed, Foreseen):
        files = [] if folder is None else [folder / name for name in (DOCUMENT, PAGE)]
        made = targets or _targets(spec, job, folder and folder / f"{section_of(spec, str(job)).name}.toml")
        return Told.of(replace(designed, makes=tuple(map(str, (*made.values(), *files)))))
    if folder is not None:
        written = designed.save(folder, force=asked.force)
        paths = {part: folder / name for part, name in designed.names.items()}
    else:
        paths = {part: targets[part] for part in designed.texts()}
        for part, text in designed.texts().items():
            write_text(paths[part], text, replace=asked.force)
        written = list(paths.values())
    lines = [*designed_lines(designed.found, designed.notes), *map(str, written)]
    return Told(designed.to_dict(paths), lines, designed.passed)


def _counts(start: object, begin: Mask | None) -> dict[str, Any]:
    """Dots, pitch and clear dots of a start, which a design has unless it is told others."""
    if begin is None:
        return {}
    counts: dict[str, Any] = {"dots": len(begin), "clear_dots": int(begin.sum())}
    if isinstance(start, model.Opening):
        counts["pitch"] = length_text(start.dots * start.dot_nm / NM_PER_UM)
    return counts


def _begun(start: object) -> Mask:
    """The start of a search, bool [dots, dots]."""
    where = "design(): start"
    if isinstance(start, model.Opening):
        return start.mask
    mask = from_array(cast(ArrayLike, start), where, cure="Say from where on a dot is clear: start > 0.5")
    if not mask.any():
        raise closed(0, mask.size, where=where, cure="Open some of its dots")
    return mask


def _start_words(start: object, begin: Mask | None) -> str:
    """A start behind the call that repeats a design: its name, and a hash of its dots."""
    if begin is None:
        return ""
    name = start.name if isinstance(start, model.Opening) else "an array"
    return f"  # start: {name}, sha256 {hashlib.sha256(begin.tobytes()).hexdigest()[:16]}"


def _design_front(asked: Asked, job: Path) -> Told:
    if asked.out is None:
        cure = "Add -o with a folder for the page, the designs with their jobs, and the figure"
        raise JobError("MF105", "a front has no output folder", where="--out", cure=cure)
    command = f"maskfab design {job.as_posix()} --front --out {asked.out.as_posix()}"
    for option in ("images", "budget"):
        value = asked.stated.get(option)
        text = value.as_posix() if isinstance(value, Path) else f"'{value}'"
        command += "" if value is None else f" --{option} {text}"
    check_target(asked.out, force=asked.force)
    front = asked.found(command=command)
    if isinstance(front, Foreseen):
        return Told.of(replace(front, makes=(str(asked.out),)))
    asked.progress("files", 0, 1)
    paths = front.save(asked.out, force=asked.force)
    asked.progress("files", 1, 1)
    return Told.of(front, paths, path=str(asked.out))


def _targets(spec: JobSpec, job: Path, out: Path | None) -> dict[str, Path]:
    """Where the opening goes, and the outer one and the map where there will be any."""
    section = section_of(spec, str(job))
    target = out or (None if section.output is None else job.parent / section.output)
    if target is None:
        cure = 'Add output = "openings/x.toml" to [design], or give --out x.toml'
        raise JobError("MF105", "the design has no output file", where=f"{job}: design.output", cure=cure)
    targets = {"opening": target}
    if isinstance(section, SearchSection) and section.map is not None:
        if section.map_output is None and out is None:
            cure = 'Add map_output = "maps/x.toml" to [design]'
            raise JobError("MF105", "the map has no output file", where=f"{job}: design.map_output", cure=cure)
        # The job's own map belongs to the opening that it names.
        own = section.map_output is not None and out is None
        targets["map"] = job.parent / str(section.map_output) if own else beside(target)["map"]
        if section.density is not None:
            targets["outer"] = beside(target)["outer"]
    return targets


def _called(
    stated: Mapping[str, Any],
    display: Mapping[str, Any],
    more: Mapping[str, Any],
    *,
    camera: Camera | None,
    images: object,
) -> tuple[JobSpec, str]:
    """The spec of a design that a call states, by the keys of its sections, and the call that repeats it."""
    where = "design()"
    for key in more:
        if key not in _FURTHER:
            what = f"a design has no use for a section {key!r}"
            cure = f"Use {', '.join(_FURTHER)}; emitters, wires and camera are arguments of their own"
            raise JobError("MF102", what, where=f"{where}: sections", cure=cure)
    section = {"name": "found", "method": "search", "tiling": "random", **stated}
    if section["method"] == "search" and section["tiling"] == "random":
        section.setdefault("map", "equal_light")
    if section.get("map") == "none":
        del section["map"]
    lens = (camera or protocol_f1()).section.model_dump(mode="json", exclude_none=True)
    spec = validate({"camera": lens, "design": section, **display, **more}, where=where)
    repeated = {**section, **display, **({"sections": dict(more)} if more else {})}
    arguments = [f"{key}={value!r}" for key, value in repeated.items()]
    if "map" not in section:
        arguments.append("map='none'")
    if camera is not None:
        arguments.append(f"camera=maskfab.Camera({', '.join(f'{key}={value!r}' for key, value in lens.items())})")
    if images is not None:
        arguments.append(f"images={str(images)!r}")
    return spec, f"maskfab.design({', '.join(arguments)})"


@dataclass(frozen=True, eq=False, repr=False)
class ParetoFront(FolderResult):
    """A Pareto front of designs for a display.

    Attributes:
        found: curves, the best of all, and what they are compared with.
        designs: those of the curves with their names, openings, maps and jobs.
        digest: of the job.
        scenes: that openings were judged by, in words.
        notes: what a user should know, as sentences.
    """

    found: Pareto
    designs: tuple[FrontDesign, ...]
    digest: str
    scenes: str
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Everything that was found."""
        return pareto.pareto_document(self.found, self.designs, self.digest, self.notes, self.scenes)

    def _write(self, place: Place) -> list[Path]:
        """Numbers, openings and figure."""
        return pareto.write_pareto(place, self.found, self.to_dict(), self.designs)

    def plot(self) -> Drawing:
        """The curves, and what they are compared with."""
        from maskfab.report.pages.pareto import pareto_drawing

        return pareto_drawing(self.found)

    def __str__(self) -> str:
        return "\n".join([*pareto.front_lines(self.found, self.designs), *(f"note: {note}" for note in self.notes)])


def _front(
    spec: JobSpec,
    path: Path,
    *,
    images: str | Path | None,
    budget: str | None,
    workers: Workers,
    command: str | None,
    progress: Progress,
    dry_run: bool,
) -> ParetoFront | Foreseen:
    clock = budget_clock(None if budget is None else parse_time_s(budget, where="budget"))
    section, faults = spec.design, JobFaults.of_spec(spec)
    for key, what, cure in (
        ("pareto", "the job has no [pareto] section", "Add a [pareto] section with clear_dots = [88, 100]"),
        ("emitters", "a front is of displays, and the job has no [emitters]", "Add [emitters], and [wires] for lines"),
    ):
        if getattr(spec, key) is None:
            faults.add(JobError("MF105", what, where=f"{path}: {key}", cure=cure))
    if not isinstance(section, SearchSection):
        what = "a sweep is among compact shapes, and the job has no [design] that searches them"
        faults.add(JobError("MF105", what, where=f"{path}: design", cure='Add [design] with method = "search"'))
    with faults:
        camera = PhotoCamera.of(spec.camera, where=str(path))
    faults.refuse()
    assert spec.pareto is not None
    assert isinstance(section, SearchSection)
    settings = capture_settings(spec)
    require_weights(section, settings, str(path))
    compared = [load_opening(path.parent / name) for name in spec.pareto.compare]
    texts = {opening.name: opening_text(opening) for opening in compared}
    if len(texts) < len(compared):
        cure = "Give one of the openings another name in its file"
        raise JobError("MF109", "two openings have one name", where=f"{path}: pareto.compare", cure=cure)
    display = stated_display(spec, section, str(path), key="pareto")
    lines_of(spec.pareto, display, where=f"{path}: pareto.lines")
    require_uneven(spec.pareto, section, display, where=f"{path}: pareto")
    rules = rules_of(section, display, compared)
    lattice(section.dots, rules.dot_nm, camera=camera, where=f"{path}: design.dots")
    scenes = scenes_of(None if images is None else Path(images), section)
    command = command or f"maskfab.design({path.as_posix()!r}, front=True)"
    if dry_run:
        counts = " and ".join(map(str, spec.pareto.clear_dots))
        return Foreseen(f"{sought(spec, counts)}; a front of them", command, clock.budget_s)
    swept = sweep(
        spec.pareto,
        section,
        scenes.photographs,
        display,
        compared=compared,
        camera=camera,
        settings=settings,
        clock=clock,
        workers=workers,
        progress=progress,
    )
    made = designs(swept, spec, command, camera, settings)
    digest = provenance.job_hash(spec.model_copy(update={"openings": {**spec.openings, **texts}}).dump())
    scenes_words = scenes_line(scenes, None if images is None else Path(images))
    return ParetoFront(swept, made, digest, scenes_words, notes_of(spec, scenes, USES["design --front"], settings))
