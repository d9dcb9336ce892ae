"""A job of one's own to begin with, or an opening drawn from numbers."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from maskfab.api.results import Asked, InPython, Result, Told, answers
from maskfab.base import resources
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.files import writing
from maskfab.base.folders import check_file, check_target, staged, write_text
from maskfab.base.units import NM_PER_UM, UM_PER_INCH

if TYPE_CHECKING:
    from maskfab.api.lengths import Length
    from maskfab.api.opening import Opening
    from maskfab.api.tracing import Traced
    from maskfab.report.figures.sheet import Drawing


# A job is begun in less time than openings take to load.

FIRST = "first_plate"
"""Shipped job that one begins with unless another is named."""
JOB = "job.toml"
_LAYOUTS = "layouts"


@dataclass(frozen=True)
class Begun(Result):
    """A folder with a job and everything that it names.

    designed: whether everything is there; else ``design`` is to find the opening first.
    """

    job: Path
    files: tuple[Path, ...]
    designed: bool = True

    def __str__(self) -> str:
        named = "\n".join(str(path) for path in self.files)
        first = "check" if self.designed else "design"
        return (
            f"{named}\nNext: maskfab {first} {self.job}, then maskfab run {self.job} --out {self.job.parent / 'plate'}"
        )

    def to_dict(self) -> dict[str, Any]:
        """The paths."""
        return {"job": str(self.job), "files": [str(path) for path in self.files]}


@dataclass(frozen=True, repr=False)
class Drawn(Result):
    """An opening that was drawn and written.

    opening: what is in it.
    pixels_across: pixels of the display that the opening's cell holds along its side.
    """

    path: Path
    opening: Opening
    pixels_across: int = 1

    def to_dict(self) -> dict[str, Any]:
        """Facts of the opening, and where it is."""
        facts = {"name": self.opening.name, "path": str(self.path), "clear_dots": self.opening.clear_dots}
        return {**facts, "open_ratio": self.opening.open_ratio, "provenance": dict(self.opening.provenance)}

    def plot(self) -> Drawing:
        """The opening."""
        return self.opening.plot()

    def __str__(self) -> str:
        dots, dot_um, across = self.opening.dots, self.opening.dot_nm / NM_PER_UM, self.pixels_across
        pixel_um = self.opening.pitch_um / across
        held = f" for {across} x {across} pixels of {pixel_um:g} um, {UM_PER_INCH / pixel_um:.0f} dpi" * (across > 1)
        drawn = f"{self.path}: {dots} dots, {self.opening.open_ratio:.1%} clear{held}; in the job: "
        return f'{drawn}dot = "{dot_um:g} um", pitch = "{self.opening.pitch_um:.10g} um"'


def templates() -> tuple[str, ...]:
    """Names of the shipped jobs that lay out a plate, sorted."""
    every = sorted(resources.path(_LAYOUTS).glob("*.toml"))
    return tuple(path.stem for path in every if "die" in tomllib.loads(path.read_text(encoding="utf-8")))


@checked_arguments
def new(
    place: Annotated[str | Path, "FOLDER|FILE.toml"],
    source: Annotated[str | None, "--from NAME"] = None,
    *,
    shape: str | None = None,
    dots: int | None = None,
    pitch: Length | None = None,
    clear_dots: int | None = None,
    numbers: Annotated[Mapping[str, str | float] | None, "--set NAME=VALUE"] = None,
    micrograph: str | Path | None = None,
    camera: str | None = None,
    name: str | None = None,
    command: InPython[str | None] = None,
    force: bool = False,
) -> Begun | Drawn | Traced:
    """Begin a job of your own: a folder with a commented job, and the openings and maps that it names.

    With --shape, draw a parametric opening instead, or the opening of a display with its emitters. With --micrograph,
    read the opening of a real display from a picture of several of its pixels, with a bar on its edge.

    Examples:
        $ maskfab new mine
        $ maskfab new mine --from display_that_fits
        $ maskfab new mine --from galaxy_z_fold_3 --camera '2.4 mm'
        $ maskfab new s.toml --shape stripe --dots 21 --pitch '168 um' --set width_dots=5 --clear-dots 90
        $ maskfab new ring.toml --shape circular --set diameter=18
        $ maskfab new phone --micrograph panel.png --pitch '78 um'
        $ maskfab new phone --micrograph panel.png --pitch '78 um' --set clear=bright --dots 78

    Args:
        place: folder to make, new or empty; with shape the file for the opening.
        source: a shipped job, such as upc12 or display_that_fits; by default first_plate. Or a device with a camera
            behind its display, by what was published of it: galaxy_z_fold_3, galaxy_z_fold_4, axon_20, axon_30, mix_4.
        shape: kind of opening: stripe, blobs or diamond-discs; with emitters rgb-stripe, pentile-diamond,
            pentile-lines, delta, circular or window.
        dots: dots along the side of a cell; by default 21, or a display's own, or near it where they make the pitch.
        pitch: side of a cell, to the nearest that dots of whole nanometres make; by default ``"168 um"``, or a
            display's own. Cells of pentile-diamond, pentile-lines and delta are two pixels wide.
        clear_dots: number of clear dots; blobs and discs need it.
        numbers: of a stripe: width_dots, by default 5. Of blobs: size_ratio, small over large, by default 0.7; aspect,
            length over width, by default 1.25; exponent, 2 for an ellipse, larger for squarer ones, by default 4. Of a
            display: its lengths in dots, which stand in the manual, and in the answer to a wrong one. Of a micrograph:
            clear=bright where light shines through the openings, by default dark; pixels along the repeating cell.
        micrograph: a microscope picture of at least 2 x 2 pixels of a display, wires bright and openings dark.
        camera: of a device what was not published: the focal length, such as ``"2.4 mm"``, or all three numbers, such
            as ``"2.4 mm f/1.8 2 um"``.
        name: name of the opening; by default the file's stem.
        command: what reproduces an opening, for its provenance; by default this call.
        force: replace an existing file of an opening.

    Raises:
        JobError: MF105 for another name, or what goes with another form; of a shape as :meth:`maskfab.Opening.shape`.
        OutputError: MF401 or MF402 if the place cannot be written, or is not empty.
    """
    from maskfab.api.asked import require_form

    made = shape is not None or micrograph is not None
    both = {"dots": dots, "pitch": pitch, "numbers": numbers, "name": name}
    require_form("shape or micrograph", both, of=made)
    require_form("shape", {"clear_dots": clear_dots, "force": force}, of=shape is not None)
    if micrograph is not None:
        from maskfab.api.tracing import traced

        for key, value in {"shape": shape, "source": source, "camera": camera}.items():
            if value is not None:
                what = f"a micrograph takes no {key}"
                raise JobError("MF105", what, where=key, cure=f"Leave {key} out, or micrograph")
        folder, photograph = Path(place), Path(micrograph)
        called = name or re.sub(r"\W", "_", folder.name, flags=re.ASCII) or "display"
        by = command or f"maskfab.new({str(place)!r}, micrograph={photograph.name!r}, pitch={pitch!r})"
        return traced(folder, photograph, pitch=pitch, dots=dots, settings=numbers or {}, name=called, command=by)
    if shape is None:
        return _job(Path(place), FIRST if source is None else source, camera)
    if camera is not None:
        raise JobError("MF105", "a shape has no camera", where="camera", cure="Leave camera out")
    if source is not None:
        raise JobError("MF105", "a shape is drawn from numbers", where="source", cure="Leave source out, or shape")
    from maskfab.api.opening import Opening
    from maskfab.mask.emitter_layouts import DISPLAYS
    from maskfab.mask.opening_file import opening_text

    target = Path(place)
    if target.parent.exists():
        check_file(target, force=force)
    opening = Opening.shape(
        shape, dots=dots, pitch=pitch, clear_dots=clear_dots, name=name or target.stem,
        command=command or f"maskfab.new({str(place)!r}, shape={shape!r})", **_numbers_of(shape, numbers or {}),
    )  # fmt: skip
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
    write_text(target, opening_text(opening), replace=force)
    display = DISPLAYS.get(shape)
    return Drawn(target, opening, 1 if display is None else display.pixels_across)


_NUMBERS: Mapping[str, Mapping[str, type]] = {
    "stripe": {"width_dots": int},
    "blobs": {"size_ratio": float, "aspect": float, "exponent": float},
}
"""Numbers that shapes have beside dots and pitch; a display has its lengths in dots."""


def _numbers_of(shape: str, stated: Mapping[str, str | float]) -> dict[str, Any]:
    """Arguments of :meth:`maskfab.Opening.shape`. Raises JobError MF102 for another name, MF105 for no number."""
    from maskfab.mask.emitter_layouts import DISPLAYS, read_lengths

    if shape in DISPLAYS:
        return {"lengths": read_lengths(f"{key}={value}" for key, value in stated.items())}
    kinds, found = _NUMBERS.get(shape, {}), dict[str, Any]()
    for key, value in stated.items():
        if key not in kinds:
            cure = f"It has: {', '.join(kinds)}" if kinds else f"Leave {key} out"
            raise JobError("MF102", f"the shape {shape} has no number {key!r}", where=key, cure=cure)
        try:
            found[key] = kinds[key](value)
        except ValueError:
            what = f"{key} = {value!r} is no {'whole ' * (kinds[key] is int)}number"
            raise JobError("MF105", what, where=key, cure=f"Write {key}=5") from None
    return found


def _job(folder: Path, source: str, camera: str | None) -> Begun:
    if source not in templates():
        return _of_device(folder, source, camera)
    if camera is not None:
        cure = "Leave camera out, and change [camera] in the job"
        raise JobError("MF105", f"the shipped job {source} states its camera", where="camera", cure=cure)
    place, layouts = check_target(folder, force=False), resources.path(_LAYOUTS)
    text = (layouts / f"{source}.toml").read_text(encoding="utf-8")
    named = sorted({name for name in _texts(tomllib.loads(text)) if name and (layouts / name).is_file()})
    with staged(place) as made:
        (made / JOB).write_text(text, encoding="utf-8")
        for name in named:
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes((layouts / name).read_bytes())
    return Begun(folder / JOB, tuple(folder / name for name in (JOB, *named)))


def _of_device(folder: Path, name: str, camera: str | None) -> Begun:
    """A folder with the job of a device's published numbers, which says what was not published."""
    from maskfab.job.brief import Brief, job_text, snapped
    from maskfab.job.devices import devices

    if name not in devices():
        cure = f"Begin with {', '.join(templates())}; or with a device: {', '.join(devices())}"
        raise JobError("MF105", f"there is no shipped job {name!r}", where="source", cure=cure)
    device, place = devices()[name], check_target(folder, force=False)
    text = job_text(snapped(Brief.of({"device": name, "camera": camera})))
    told = [device.title, f"Published, read on {device.day}: {device.source}"]
    told += [f"Not published: {', '.join(device.missing)}."]
    told += ["What this job states of these is an answer or a default, no fact of the device."]
    with staged(place) as made:
        (made / JOB).write_text("".join(f"# {line}\n" for line in told) + text, encoding="utf-8")
    return Begun(folder / JOB, (folder / JOB,), designed=False)


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _texts(item)


@answers(new)
def _new(asked: Asked) -> Told:
    """A drawn opening names the command that draws it, as it was typed."""
    if "shape" in asked.stated or "micrograph" in asked.stated:
        words = (word for word in asked.words if word not in {"--force", "--json"})
        return Told.of(asked.found(command=shlex.join(["maskfab", *words])))
    return Told.of(asked.found())


@checked_arguments
def shapes() -> tuple[str, ...]:
    """Every kind that :meth:`maskfab.Opening.shape` draws."""
    from maskfab.api.opening import SHAPES

    return SHAPES
