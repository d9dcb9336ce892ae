"""Runs, packages and mask files from anywhere, verified: by their job, or by their readers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, overload

from maskfab.api.asked import AnyJob, folder_of, job_of
from maskfab.api.lengths import Length, drawing_unit_um, length_text
from maskfab.api.results import Asked, Result, Told, answers, verdict_lines
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.files import suffix_of
from maskfab.base.folders import check_file
from maskfab.base.model import Quantity
from maskfab.base.units import NM_PER_UM, parse_length_um
from maskfab.base.work import Progress, silent
from maskfab.findings.foreign import How
from maskfab.job.reference import USES, in_words, unused
from maskfab.mask.comparison.readings import Reading, View, readings
from maskfab.mask.comparison.readings import Readings as ByReader
from maskfab.mask.formats.picture import IMAGE_SUFFIXES
from maskfab.mask.formats.table import LAYOUT_SUFFIXES
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.package.archive import is_package
from maskfab.mask.package.pack import verify_package
from maskfab.mask.sandbox import bounded
from maskfab.report.text import Quantities, table_lines
from maskfab.report.verdicts import Verdicts
from maskfab.runs import verification
from maskfab.runs.verification import Reproduction, reproduce

if TYPE_CHECKING:
    from maskfab.api.asked import AnyPath  # at run time refused here, with the verb to call first
    from maskfab.report.figures.sheet import Drawing


class Verification(Quantities):
    """Checks of a run, a package or a mask file; of a file also how it was read.

    Attributes:
        verdicts: what the checks come to; displays are judged of a run alone.
        layer: of a layout, what was compared; None for a picture, a run or a package.
        tone: "clear" or "dark", what the file draws; None for a run or a package.
        other_layers: with shapes, which were not compared.
        unused: keys and tables of the job on which nothing of the comparison depends.
    """

    def __init__(
        self,
        checks: Iterable[Quantity],
        verdicts: Verdicts | None = None,
        *,
        layer: str | None = None,
        tone: str | None = None,
        other_layers: Sequence[str] = (),
        unused: Sequence[str] = (),
    ) -> None:
        super().__init__(checks)
        self.verdicts = verdicts or Verdicts.of(self, {}, 0)
        self.layer, self.tone, self.other_layers = layer, tone, tuple(other_layers)
        self.unused = tuple(unused)


@dataclass(frozen=True, eq=False, repr=False)
class Readings(Result):
    """A mask file as each of its readers has it.

    Attributes:
        readers: every reader alone, and last maskfab, which refuses what they draw otherwise.
        views: of layers, those first that readers draw otherwise.
    """

    path: Path
    readers: tuple[Reading, ...]
    alike: bool
    views: tuple[View, ...]

    @property
    def passed(self) -> bool:
        """Whether every reader reads it, and all draw the same but for chords and rounding."""
        return self.alike

    def to_dict(self) -> dict[str, Any]:
        """Every reading, lengths in micrometres, and where they differ."""
        unlike = [
            {"cell": view.cell, "layer": view.layer, "area_um2": view.unlike_um2, "box_um": view.unlike_um}
            for view in self.views
            if view.unlike_um is not None
        ]
        verdict, document = "pass" if self.passed else "fail", [asdict(reading) for reading in self.readers]
        return {"file": str(self.path), "verdict": verdict, "readers": document, "unlike": unlike}

    def __str__(self) -> str:
        # The last, maskfab itself, reads through the others; of CIF it is the only one.
        names = [f"{reading.reader} {reading.version}" for reading in self.readers[:-1] or self.readers]
        alike = f"read alike by {', '.join(names)}" if len(names) > 1 else f"read by {names[0]} alone"
        lines = [f"{self.path.name}: {alike if self.passed else 'not read alike'}"]
        why = ", within chords and rounding" if self.passed else ""
        layers = {(told.cell, told.layer) for reading in self.readers for told in reading.layers}
        for cell, layer in sorted(layers):
            lines.append(f"cell {cell}, layer {layer}")
            for reading in self.readers:
                told = [one for one in reading.layers if (one.cell, one.layer) == (cell, layer)]
                what = "  nothing" if not told and not reading.refused else "  refused" if reading.refused else ""
                for one in told:
                    shapes = "shape " if one.shapes == 1 else "shapes"
                    what += f"{one.shapes:9d} {shapes} {one.area_um2:16.10g} um^2  {_box(one.box_um)}"
                lines.append(f"  {reading.reader:10} {reading.version:10}{what}")
            for view in self.views:
                if (view.cell, view.layer) == (cell, layer) and view.unlike_um is not None:
                    lines.append(
                        f"  otherwise by some reader{why}: {view.unlike_um2:.10g} um^2 in {_box(view.unlike_um)}"
                    )
        return "\n".join([*lines, *(f"{each.reader} refuses: {each.refused}" for each in self.readers if each.refused)])

    def plot(self) -> Drawing:
        """Layers side by side: what the first reader draws, and on it what another has otherwise."""
        from maskfab.report.figures.readers import readers

        return readers(self.views, [f"{one.reader} {one.version}" for one in self.readers if not one.refused])

    def save(self, out: Annotated[str | Path, "PICTURE"], *, force: bool = False) -> list[Path]:
        """Write the picture.

        Args:
            out: picture (.png .svg) of the layers, with readers.
            force: replace an existing picture.
        """
        check_file(Path(out), force=force)
        return [self.plot().save(out)]


def _box(box_um: tuple[float, float, float, float]) -> str:
    left, bottom, right, top = box_um
    return f"({left:.10g}, {bottom:.10g}) to ({right:.10g}, {top:.10g}) um"


@overload
def verify(subject: AnyPath, *, again: Literal[True], progress: Progress = ...) -> Reproduction: ...
@overload
def verify(
    subject: AnyPath, *, readers: Literal[True], unit_um: str | float | None = ..., progress: Progress = ...
) -> Readings: ...  # fmt: skip
@overload
def verify(
    subject: AnyPath, *, against: AnyJob | None = ..., shop: str | None = ..., die: str | None = ...,
    layer: str | None = ..., cell: str | None = ..., dots_per_um: float | None = ..., unit_um: str | float | None = ...,
    tone: str | None = ..., ignore: Sequence[str] = ..., tolerance: Length | None = ..., progress: Progress = ...
) -> Verification: ...  # fmt: skip
@checked_arguments
def verify(
    subject: Annotated[AnyPath, "DIR|PACKAGE|FILE"],
    *,
    against: Annotated[AnyJob | None, "JOB"] = None,
    shop: str | None = None,
    die: str | None = None,
    layer: str | None = None,
    cell: str | None = None,
    dots_per_um: Annotated[float | None, "1e-6..1e6"] = None,
    unit_um: Annotated[str | float | None, "--unit nm|um|mm|mil|in"] = None,
    tone: Annotated[str | None, "clear|dark"] = None,
    ignore: Annotated[Sequence[str], "LAYER"] = (),
    tolerance: Length | None = None,
    again: bool = False,
    readers: bool = False,
    progress: Progress = silent,
) -> Verification | Reproduction | Readings:
    """Repeat every check on a finished run or package, compare a mask file with a job, or show how readers read it.

    Examples:
        $ maskfab verify build/upc12
        $ maskfab verify build/upc12 --again
        $ maskfab verify from_elsewhere.gds --against layouts/upc12.toml --layer 1/0
        $ maskfab verify from_elsewhere.gds --readers -o read.png

    Args:
        subject: the --out of a finished run, a .zip that maskfab order pack wrote, or a mask file (.gds .oas .dxf .gbr
            .cif .png .tif) from any source. In Python also the result of :func:`maskfab.run`.
        against: job (.toml) to compare a mask file or package with; by default for a package the job in it. In Python
            also a plate, panels or a loaded job.
        shop: shop profile to re-check the package against; by default the one in the package.
        die: compare only this die of the job.
        layer: clear layer of the mask file, such as 1/0 or CLEAR.
        cell: cell of a mask file; by default its only top cell.
        dots_per_um: image pixels per micrometre; by default the resolution stored in the file.
        unit_um: drawing unit of a DXF, by its name or in micrometres; overrides the one in the file.
        tone: what the polygons draw; by default clear.
        ignore: layer with shapes that are not part of the mask.
        tolerance: ignore differences (slivers) up to this width, such as ``"1 nm"``.
        again: make the finished run once more from its own job: every byte the same, or which file, stage and version.
        readers: show a mask file as each of its readers has it: area, shapes and box of every layer, and what differs.
        progress: told where the work stands.

    Raises:
        OutputError: MF403 for a directory that is no result.
        SourceError: for a file that cannot be read.
        JobError: MF105 for a file without a job to compare it with, and for arguments that do not apply.
    """
    path = folder_of(subject, "verify", "subject")
    unit_um = drawing_unit_um(unit_um)
    stated = {
        "against": against, "shop": shop, "die": die, "layer": layer, "cell": cell, "dots_per_um": dots_per_um,
        "unit_um": unit_um, "tone": tone, "ignore": tuple(ignore) or None, "tolerance": tolerance,
    }  # fmt: skip
    if again and readers:
        what, cure = "again and readers do not go together", "Leave one of them out"
        raise JobError("MF105", what, where="readers", cure=cure)
    if again:
        _refuse_strangers([name for name, value in stated.items() if value is not None], "a run made again", str)
        return reproduce(path, progress=progress)
    if readers:
        strangers = [name for name, value in stated.items() if value is not None and name != "unit_um"]
        _refuse_strangers(strangers, "a file shown by its readers", str)
        progress("read", 0, 1)
        found = bounded(path, lambda _: readings(path, unit_um), progress, kind=ByReader)
        return Readings(path, found.readings, found.alike, found.views)
    check_applies(stated, path)
    if is_package(path):
        profile, job = None if shop is None else load_shop(shop), None if against is None else job_of(against)
        progress("package", 0, 1)
        checks = verify_package(path, job, profile)
        progress("package", 1, 1)
        return Verification(checks)
    if against is None:
        verified = verification.verify(path, progress)
        return Verification(verified.checks, verified.verdicts)
    slivers = 0.0 if tolerance is None else parse_length_um(length_text(tolerance), where="tolerance")
    if tone not in {None, "clear", "dark"}:
        raise JobError("MF105", f"there is no tone {tone!r}", where="tone", cure="Use clear or dark")
    how = How(layer, cell, dots_per_um, unit_um, tuple(ignore), tone == "dark", slivers * NM_PER_UM)
    job = job_of(against)
    foreign = verification.verify_file(path, job, die, how, progress)
    return Verification(
        foreign.quantities,
        layer=foreign.layers.clear or None,
        tone="dark" if foreign.dark else "clear",
        other_layers=foreign.layers.others,
        unused=unused(job.spec, *USES["verify --against"]),
    )


@answers(verify)
def _verify(asked: Asked) -> Told:
    """A run and a package by their verdicts, a file also by how it was read."""
    path, stated = Path(asked.stated["subject"]), asked.stated
    if stated.get("readers"):
        from maskfab.report.figures.sheet import check_suffix

        if asked.out is not None:
            check_suffix(asked.out)
            check_file(asked.out, force=asked.force)
        found: Readings = asked.found()
        return Told.of(found, () if asked.out is None else found.save(asked.out, force=asked.force))
    if asked.out is not None:
        cure = "Add --readers, of which it is the picture, or leave --out out"
        raise JobError("MF105", "--out goes with --readers", where="--out", cure=cure)
    if stated.get("again"):
        return Told.of(asked.found())
    options = {key: value for key, value in stated.items() if key not in ("subject", "progress")}
    check_applies(options, path, lambda name: "--unit" if name == "unit_um" else f"--{name.replace('_', '-')}")
    answer: Verification = asked.found()
    against, shop = (None if stated.get(key) is None else str(stated[key]) for key in ("against", "shop"))
    document: dict[str, Any] = {"verdict": "pass" if answer.passed else "fail", "verdicts": answer.verdicts.to_dict()}
    if answer.tone is None:
        more = {"package": str(path), "against": against, "shop": shop} if is_package(path) else {}
        document |= {**more, "checks": answer.to_dict()}
        return Told(document, (), answer.passed, remarks=verdict_lines(answer, answer.verdicts))
    document |= {
        "layer": answer.layer, "tone": answer.tone, "other_layers": list(answer.other_layers), "file": str(path),
        "against": against, "die": stated.get("die"), "quantities": answer.to_dict(), "unused": list(answer.unused),
    }  # fmt: skip
    of_layer = f" on layer {answer.layer}" if answer.layer else ""
    beside = f"; ignored layers with shapes: {', '.join(answer.other_layers)}" if answer.other_layers else ""
    read_as = f"{path.name}: polygons{of_layer} are {'opaque' if answer.tone == 'dark' else 'clear'}{beside}"
    lines = [read_as, *table_lines(answer, dies=True), *in_words(answer.unused)]
    judged = [quantity for quantity in answer if quantity.passed is not None]
    return Told(document, lines, answer.passed, remarks=verdict_lines(judged, answer.verdicts))


def check_applies(stated: Mapping[str, object], subject: Path, spelt: Callable[[str], str] = str) -> None:
    """Refuse what cannot be said of the folder, package or file that is verified.

    Args:
        spelt: how the caller's user writes an argument.

    Raises:
        JobError: MF105 for all that do not apply, at the first; for what is missing.
    """
    said = [name for name, value in stated.items() if value is not None]
    if is_package(subject):
        _refuse_strangers([name for name in said if name not in {"against", "shop"}], "a package", spelt)
        if "shop" in said and "against" not in said:
            against, shop = spelt("against"), spelt("shop")
            what = f"{against} is missing: with {shop} the package is rebuilt from its job"
            cure = f"Add {against} with the job, or leave {shop} out: the package holds its job and its shop"
            raise JobError("MF105", what, where=against, cure=cure)
    elif "shop" in said:
        what = f"{spelt('shop')} {stated['shop']} applies to packages only, and {subject.name} is not one"
        cure = f"Name a .zip that maskfab order pack wrote, or leave {spelt('shop')} out"
        raise JobError("MF105", what, where=spelt("shop"), cure=cure)
    elif os.path.isdir(subject):
        _refuse_strangers(said, f"{subject.name}, which is a directory", spelt)
    elif "against" in said:
        meant = {"against", *_meant(subject)}
        _refuse_strangers([name for name in said if name not in meant], subject.name, spelt)
    elif os.path.isfile(subject):
        cure = f"Add {spelt('against')} with a job, or name the directory of a finished run"
        raise JobError("MF105", f"no job is given to compare {subject.name} with", where=spelt("against"), cure=cure)


def _refuse_strangers(strangers: Sequence[str], subject: str, spelt: Callable[[str], str]) -> None:
    names = " ".join(map(spelt, strangers))
    cure = f"Leave {names} out"
    if "against" in strangers:
        cure += ": a finished directory is held against the job in it. Or name one of its mask files"
    if strangers:
        raise JobError("MF105", f"{names} does not apply to {subject}", where=spelt(strangers[0]), cure=cure)


def _meant(file: Path) -> tuple[str, ...]:
    """Arguments with a meaning for a file of its kind; all of them where no such kind is read, which is told elsewhere.

    Only the unit of a DXF can be stated, which the reader of the others says.
    """
    kind, every = suffix_of(file), ("die", "unit_um", "tone", "tolerance")
    if kind in IMAGE_SUFFIXES:
        return (*every, "dots_per_um")
    return (*every, "layer", "cell", "ignore", *(() if kind in LAYOUT_SUFFIXES else ("dots_per_um",)))
