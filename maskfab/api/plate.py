"""Panels on a photomask."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maskfab.api.camera import Camera, protocol_f1
from maskfab.api.lengths import Length, length_text, sections_as_text
from maskfab.api.panel import Panel
from maskfab.base import model
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.files import partial
from maskfab.base.units import NM_PER_UM
from maskfab.display.feasibility import displays
from maskfab.job.faults import parse_section
from maskfab.job.read import validate
from maskfab.job.sections import JobSection, JobSpec, PlateSection
from maskfab.job.values import um_text
from maskfab.mask import opening_file
from maskfab.mask import panels as maps
from maskfab.mask.formats.table import format_of, products, require_packages
from maskfab.mask.houses.files import check_stated
from maskfab.mask.job import Job, resolve
from maskfab.runs.plate_files import check_pictures, draw_files

if TYPE_CHECKING:
    from klayout import db

    from maskfab.report.figures.sheet import Drawing


_WHERE = "Plate"
_OWN = frozenset({"job", "camera", "plate", "die", "openings", "maps", "design", "pareto"})
_STREET_NM, _STREET_SHARE = 1_000_000, 4
"""Space between slots, labels included: a millimetre and a fourth of a die."""


@dataclass(frozen=True, eq=False, repr=False)
class Plate:
    """Named panels on a photomask, as a job file states them.

    Examples:
        >>> import maskfab as mf
        >>> bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
        >>> plate = mf.Plate.of(BAR=mf.Panel.tile(bar, "random", seed=1, size="4.4 mm"), template="5in")
        >>> plate
        <Plate PLATE: BAR>
        >>> plate.layout().blank_nm
        127000000

    Attributes:
        heading: [job] of a job file.
        section: [plate] of a job file.
        panels: by the names of their dies.
        labels: texts under the dies, by name.
        camera: looks through the plate where no other is named; part of the job, and so of the signature in the files.
        sections: further sections of a job file.
    """

    heading: JobSection
    section: PlateSection
    panels: Mapping[str, Panel]
    labels: Mapping[str, str]
    camera: Camera | None
    sections: Mapping[str, Any]

    @classmethod
    @checked_arguments
    def of(
        cls,
        dies: Mapping[str, Panel] | Sequence[Panel] | Panel | None = None,
        /,
        *,
        template: str | None = None,
        blank: Length | None = None,
        writable: Length | None = None,
        die_size: Length | None = None,
        die_pitch: Length | None = None,
        columns: int | None = None,
        name: str = "PLATE",
        title: str | None = None,
        labels: Mapping[str, str] | None = None,
        camera: Camera | None = None,
        sections: Mapping[str, Any] | None = None,
        **panels: Panel,
    ) -> Plate:
        """Put panels on a plate, row by row, in the order in which they are given.

        Args:
            dies: panels by name; or in a list, named after their openings, or P1, P2 and so on where two have one name;
                or one, called PANEL. Or each as a keyword of its own.
            template: blank and marks: 4in, 5in, 6in or 7in; 5in if there is no blank either.
            blank: side of the blank.
            writable: side of the square in its middle that may be written.
            die_size: side of the slots; by default the largest panel's.
            die_pitch: distance between slots; by default room for the labels.
            columns: of dies; by default as many as rows.
            name: of the plate, and of its files.
            title: written on the plate; by default its name.
            labels: written under dies, by name; by default the name of the opening.
            camera: looks through the plate; by default the camera of protocol F1.
            sections: further sections as a job file has them, such as ``{"scene": {"gap": "0.5 mm"}}``.

        Raises:
            JobError: MF102 to MF110 for a section, a name or a length; what does not fit is refused by :meth:`layout`.
        """
        every = {**(dies if isinstance(dies, Mapping) else named(() if dies is None else dies)), **panels}
        for die, panel in every.items():
            if not isinstance(panel, Panel):
                what = f"{die} = {panel!r} is not a panel"
                raise JobError("MF105", what, where=f"{_WHERE}.of", cure="Make one: Panel.tile(opening, size=...)")
        if not every:
            raise JobError("MF105", "there is no panel", where=f"{_WHERE}.of", cure="Give at least one: A=panel")
        size = max(panel.side_nm for panel in every.values())
        default_pitch = size + size // _STREET_SHARE + _STREET_NM
        stated = {
            "template": "5in" if template is None and blank is None else template,
            "blank": length_text(blank, "blank", f"{_WHERE}.of: blank"),
            "writable": length_text(writable, "blank", f"{_WHERE}.of: writable"),
            "die_size": um_text(size / NM_PER_UM)
            if die_size is None
            else length_text(die_size, "size", f"{_WHERE}.of"),
            "die_pitch": um_text(default_pitch / NM_PER_UM)
            if die_pitch is None
            else length_text(die_pitch, "size", f"{_WHERE}.of"),
            "columns": math.isqrt(len(every) - 1) + 1 if columns is None else columns,
        }
        made = cls(
            parse_section(JobSection, {"name": name, "title": title or name}, where=_WHERE),
            parse_section(PlateSection, stated, where=_WHERE),
            every,
            dict(labels or {}),
            camera,
            {},
        )
        return made.with_sections(sections or {})

    def with_sections(self, sections: Mapping[str, Any]) -> Plate:
        """The plate with further sections of a job file, in place of those that it has of these names.

        Raises:
            JobError: MF102 for a section that no job has, or that the plate states itself.
        """
        for key in sections:
            if key in _OWN or key not in JobSpec.model_fields:
                cure = f"Use {', '.join(sorted(set(JobSpec.model_fields) - _OWN - {'curves', 'shops'}))}"
                raise JobError("MF102", f"unknown section {key!r}", where=f"{_WHERE}.of: sections", cure=cure)
        return replace(self, sections={**self.sections, **sections_as_text(sections)})

    @checked_arguments
    def job(self, camera: Camera | None = None) -> Job:
        """The plate and a camera as a validated job, as one read from a file.

        Raises:
            JobError, OpeningError: for the first thing that is wrong, as for a job file.
        """
        camera = camera or self.camera
        where = _WHERE if camera is not None else f"{_WHERE} without a camera, so behind that of protocol F1"
        texts: dict[str, dict[str, str]] = {"openings": {}, "maps": {}}
        for die, panel in self.panels.items():
            for opening in panel.held:
                _keep(texts["openings"], opening.name, opening_file.opening_text(opening), "openings", die)
            if panel.cells is not None:
                _keep(texts["maps"], panel.cells.name, maps.map_text(panel.cells), "maps", die)
        document = {
            "job": _plain(self.heading),
            "camera": _plain((camera or protocol_f1()).section),
            "plate": _plain(self.section),
            "die": [self._die(name, panel) for name, panel in self.panels.items()],
            **self.sections,
            **{key: held for key, held in texts.items() if held},
        }
        return replace(resolve(validate(document, where=where), Path(where)), camera_assumed=camera is None)

    def _die(self, name: str, panel: Panel) -> dict[str, Any]:
        stated = _plain(panel.section) | {"name": name, "label": self.labels.get(name, panel.held[0].name)}
        if panel.section.size == self.section.die_size:
            del stated["size"]
        return stated

    @checked_arguments
    def layout(self, camera: Camera | None = None) -> model.Plate:
        """Dies, marks and gauges in their places.

        Raises:
            JobError: MF106 to MF108, MF114, MF124 to MF126, as a job file's plate; MF109 if two openings or two maps
                have one name.
        """
        return self.job(camera).plate()

    @checked_arguments
    def write(self, path: str | Path, camera: Camera | None = None, *, die: str | None = None) -> Path:
        """Write the plate in the format that the suffix names: .oas .gds .dxf .gbr .cif .svg .step .tif .bmp.

        Of one die: .step .glb .3mf .stl .png .tif.

        The file is the one that a run writes, byte for byte; an earlier one is replaced.

        Args:
            path: of the file; a name that ends in _R12.dxf is of that version, any other .dxf of R2010.
            camera: that the job in the file's signature has; by default the plate's.
            die: name of the die to write alone.

        Raises:
            OutputError: MF430 for another suffix, MF401 if the file cannot be written, and as the writer of the format.
            MissingPackageError: MF152 for a format that this installation could not write, or not read back.
            JobError: as :meth:`layout`; MF105 for a die that is not there, or a .tif or .bmp of the plate without
                ``sections={"export": {"dpi": ...}}``.
        """
        target = Path(path)
        if die is not None and die not in self.panels:
            cure = f"Use {', '.join(self.panels)}"
            raise JobError("MF105", f"there is no die {die!r}", where=f"{_WHERE}.write: die", cure=cure)
        kind = format_of(target, die=die is not None)
        require_packages([kind], where=f"{_WHERE}.write: path", otherwise="choose another suffix")
        job = self.job(camera)
        plate = displays(job).plate
        check_pictures(job, plate, [kind])
        made = draw_files(job, plate)
        check_stated(made.settings.dpi, [kind])
        written = products(made.figures, [kind], [job.signature, plate.title], made.settings)
        (product,) = (file for file in written if (None if file.die is None else file.die.name) == die)
        with partial(target) as aside:
            product.write(aside)
        return target

    def to_klayout(self) -> db.Layout:
        """The plate as a layout of klayout, in nanometres, with the cells and layers of its files."""
        from maskfab.mask.layout import plate_layout

        return plate_layout(self.layout())

    def plot(self) -> Drawing:
        """The plate in millimetres: blank, writable area, dies by name, marks."""
        from maskfab.report.figures import die as die_figures

        return die_figures.plate_drawing(self.layout())

    def __getitem__(self, die: str) -> Panel:
        return self.panels[die]

    def _repr_svg_(self) -> str:
        return self.plot().svg()

    def __repr__(self) -> str:
        return f"<Plate {self.heading.name}: {', '.join(self.panels)}>"


def named(panels: Panel | Sequence[Panel]) -> dict[str, Panel]:
    """Panels by names of dies: one is PANEL; those of a list are named after their openings, or P1, P2 and so on where
    two have one name."""
    if not isinstance(panels, Sequence):
        return {"PANEL": panels}
    names = [panel.held[0].name if isinstance(panel, Panel) else f"P{n}" for n, panel in enumerate(panels, 1)]
    alike = len(set(names)) < len(names)
    return {f"P{n}" if alike else name: one for n, (name, one) in enumerate(zip(names, panels, strict=True), 1)}


def _keep(texts: dict[str, str], name: str, text: str, kind: str, die: str) -> None:
    if texts.setdefault(name, text) != text:
        cure = "Give one of them another name, with the argument name"
        raise JobError("MF109", f"two different {kind} have the name {name!r}", where=f"{_WHERE}: {die}", cure=cure)


def _plain(section: Any) -> dict[str, Any]:
    stated: dict[str, Any] = section.model_dump(mode="json", exclude_none=True)
    return stated
