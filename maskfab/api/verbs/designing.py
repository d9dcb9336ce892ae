"""Openings that are found."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel

from maskfab.api.camera import F1, Camera
from maskfab.api.lengths import Length, length_text, lengths_as_text
from maskfab.api.opening import Opening
from maskfab.base import provenance
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError, OutputError
from maskfab.base.folders import check_file, check_target, write_text
from maskfab.base.units import parse_time_s
from maskfab.base.work import Clock, Progress, one_thread, silent
from maskfab.designs.design import design as design_spec
from maskfab.designs.rules.display_fit import DieFit
from maskfab.designs.search.result import Designed
from maskfab.job.read import read, validate
from maskfab.job.sections import EmittersSection, WiresSection
from maskfab.mask import opening_file, panels
from maskfab.mask.panels import CellMap
from maskfab.report.documents.design import Made, designed_document
from maskfab.report.pages.design import write_design

if TYPE_CHECKING:
    from maskfab.report.figures.sheet import Drawing


_FURTHER = ("light", "plate", "process", "sensor", "exposure", "scene")
"""Sections of a job that a design uses beside those that are arguments."""


@dataclass(frozen=True, eq=False, repr=False)
class Design:
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
    def psnr(self) -> dict[float, float]:
        """Expected PSNR of restored photographs in dB, by the light: the signal-to-noise ratio of white in dB."""
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
    def save(self, path: str | Path, *, force: bool = False) -> list[Path]:
        """Write the opening (.toml), its map beside it as X_map.toml; or a folder with these, a page and its numbers.

        Raises:
            OutputError: MF430 for another suffix, MF401 or MF402 for a place that cannot be written.
        """
        target = Path(path)
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

    def _repr_svg_(self) -> str:
        return self.plot().svg()

    def __repr__(self) -> str:
        told = ", ".join(f"{value:.2f} dB at {level:g} dB" for level, value in self.psnr.items())
        return f"<Design {self.found.opening.name}: {self.found.shape}; restored {told}>"


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


@checked_arguments
@one_thread
def design(
    job: str | Path | None = None,
    *,
    dots: int | None = None,
    pitch: Length | None = None,
    clear_dots: int | None = None,
    camera: Camera | None = None,
    name: str | None = None,
    method: Literal["search", "relax"] | None = None,
    tiling: str | None = None,
    map: Literal["equal_light", "edge_packing", "none"] | None = None,
    rules: Mapping[str, Any] | None = None,
    emitters: Mapping[str, Any] | None = None,
    wires: Mapping[str, Any] | None = None,
    sections: Mapping[str, Any] | None = None,
    images: str | Path | None = None,
    budget: str | None = None,
    checkpoint: str | Path | None = None,
    price_rules: bool = False,
    progress: Progress = silent,
    **keys: Any,
) -> Design:
    """Find the opening through which photographs restore best, and the map that suits it.

    Args:
        job: a job file with [design], which then says all but images, budget and checkpoint.
        dots: along the side of a pixel.
        pitch: side of the pixel.
        clear_dots: met exactly.
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
        images: folder of photographs to design for; synthetic scenes if None.
        budget: ``"60 s"`` from the call on: take the best that was found by then. It is kept within a fifth; bounds and
            the like are left out where they would take most of it.
        checkpoint: file that saves the state, from which it goes on if it exists.
        price_rules: anneal once more without each rule, beyond the budget, to tell what each costs.
        progress: told where the work stands.
        keys: any other key of [design], such as ``anneal=2000`` or ``families=["bars", "discs"]``.

    Raises:
        JobError: as for a job file with such a [design]; MF102 for a section that a design does not use; MF105 for what
            is stated beside a job; MF123 for rules that contradict each other, and for a display that does not fit;
            MF150 for a budget that the first openings exceed.
        OutputError: MF401 for a checkpoint in a directory that does not exist.
    """
    clock = Clock(None if budget is None else parse_time_s(budget, where="budget"), refuses=True)
    stated: dict[str, Any] = {
        "name": name,
        "method": method,
        "dots": dots,
        "pitch": length_text(pitch),
        "clear_dots": clear_dots,
        "tiling": tiling,
        "map": map,
        "rules": None if rules is None else dict(rules),
        **keys,
    }
    given = {key: value for key, value in stated.items() if value is not None}
    if job is not None:
        others = {"camera": camera, "emitters": emitters, "wires": wires, "sections": sections}
        _refuse_beside_job([*given, *(key for key, value in others.items() if value is not None)])
        spec, where = read(Path(job)), str(job)
        command = f"maskfab design {Path(job).as_posix()}"
        command += "" if images is None else f" --images {Path(images).as_posix()}"
    else:
        where = "design()"
        lens = (camera or F1).section.model_dump(mode="json", exclude_none=True)
        section = _with_defaults(given)
        display = _display(emitters, wires)
        more = _further(sections or {})
        spec = validate({"camera": lens, "design": section, **display, **more}, where=where)
        stated = {**section, **display, **({"sections": more} if more else {})}
        command = _call(stated, camera=None if camera is None else lens, images=images)
    began, processor = time.monotonic(), time.process_time()
    found = design_spec(
        spec,
        command,
        where=where,
        images=None if images is None else Path(images),
        progress=progress,
        clock=clock,
        checkpoint=None if checkpoint is None else Path(checkpoint),
        price_rules=price_rules,
    )
    taken = time.monotonic() - began, time.process_time() - processor
    return Design(found, Made(provenance.job_hash(spec.dump()), *taken))


def _refuse_beside_job(given: Sequence[str]) -> None:
    if given:
        raise JobError(
            "MF105",
            f"{', '.join(given)} cannot be stated beside a job, which says what is designed",
            where=given[0],
            cure="State it in the job, or leave the job out",
        )


def _display(emitters: Mapping[str, Any] | None, wires: Mapping[str, Any] | None) -> dict[str, Any]:
    """[emitters] and [wires] as a job file has them, of those that are stated."""
    stated: dict[str, tuple[Mapping[str, Any] | None, type[BaseModel]]] = {
        "emitters": (emitters, EmittersSection),
        "wires": (wires, WiresSection),
    }
    # What is no mapping is left to the job file's own checks.
    return {
        key: lengths_as_text(held, kind) if isinstance(held, Mapping) else held
        for key, (held, kind) in stated.items()
        if held is not None
    }


def _further(sections: Mapping[str, Any]) -> dict[str, Any]:
    """Sections that are not stated otherwise.

    Raises:
        JobError: MF102 for those that no design uses.
    """
    for key in sections:
        if key not in _FURTHER:
            raise JobError(
                "MF102",
                f"a design has no use for a section {key!r}",
                where="design(): sections",
                cure=f"Use {', '.join(_FURTHER)}; emitters, wires and camera are arguments of their own",
            )
    return dict(sections)


def _with_defaults(given: Mapping[str, Any]) -> dict[str, Any]:
    """[design] as a job file has it; a map is designed unless there can be none, or none is wanted."""
    section = {"name": "found", "method": "search", "tiling": "random", **given}
    if section["method"] == "search" and section["tiling"] == "random":
        section.setdefault("map", "equal_light")
    if section.get("map") == "none":
        del section["map"]
    return section


def _call(section: Mapping[str, Any], *, camera: Mapping[str, Any] | None, images: object) -> str:
    """The call that repeats a design, for its provenance."""
    arguments = [f"{key}={value!r}" for key, value in section.items()]
    if "map" not in section:
        arguments.append("map='none'")
    if camera is not None:
        arguments.append(f"camera=maskfab.Camera({', '.join(f'{key}={value!r}' for key, value in camera.items())})")
    if images is not None:
        arguments.append(f"images={str(images)!r}")
    return f"maskfab.design({', '.join(arguments)})"
