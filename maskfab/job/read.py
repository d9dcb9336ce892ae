"""A valid job from a file or parsed data, or all that is wrong with it.

Every section is checked by its own type; here are the checks that involve more than one.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Sequence, Set
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from maskfab.base import __version__, resources, units
from maskfab.base.errors import AtFault, Faults, JobError, SourceError
from maskfab.base.model import Tiling
from maskfab.base.units import NM_PER_UM
from maskfab.job.die import check_across, check_lens, check_lines, check_tiling, check_window, even_nm
from maskfab.job.faults import JobFaults, problems, sound_part
from maskfab.job.grid import check_grid, widest_dot_nm
from maskfab.job.sections import DesignSection, JobSpec, RelaxSection, SearchSection
from maskfab.job.toml import loads
from maskfab.job.values import METHODS, SOLIDS

_ROUNDING_NM = 1e-6
_FILM_UM = (0.01, 1e6)
"""Films that solids show: STEP, to which 0.1 nm is nothing, cuts thinner ones wrongly; thicker ones dwarf any plate."""


def check_dies(spec: JobSpec, faults: Faults, where: str) -> None:
    """Dies of different names, on the grid of 1 nm, before a fit camera; each is judged by itself.

    Args:
        faults: gets MF105 to MF131, see :func:`check_lens` and :func:`check_pupil` for the camera; its window is left
            to what shows a PSF, see :func:`check_windows`.
    """
    with faults:
        check_lens(spec.camera, where=f"{where}: camera.stop")
        number, die = min(enumerate(spec.die), key=lambda pair: pair[1].dot, default=(0, None))
        if die is not None:
            check_across(spec.camera, die.dot, f"{where}: die[{number}]")
    with faults:
        check_lines(spec.camera, where=f"{where}: camera.wavelengths")
    with faults:
        check_names([die.name for die in spec.die], where=f"{where}: die")
    with faults:
        for number, die in enumerate(spec.die):
            place = f"{where}: die[{number}]"
            with faults:
                check_tiling(die, place)
            with faults:
                units.to_nm(die.dot, where=f"{place}.dot", name="dot")
            with faults:
                even_nm(die.gutter, where=f"{place}.gutter", name="gutter")


def check_names(names: Sequence[str], *, where: str) -> None:
    """Names of dies that differ, in more than their case. Raises JobError MF109."""
    for name, count in Counter(names).items():
        if count > 1:
            what = f"{count} dies have the name {name!r}"
            raise JobError("MF109", what, where=where, cure="Give each die a name of its own")
    for folded, count in Counter(name.lower() for name in names).items():
        if count > 1:
            alike = ", ".join(repr(name) for name in names if name.lower() == folded)
            what = f"the dies {alike} differ in case only, and many systems would write their files over each other"
            raise JobError("MF109", what, where=where, cure="Give each die a name of its own")


def check_display(spec: JobSpec, where: str) -> None:
    """Circuits, wires and light belong to a display whose emitters the job describes. Raises JobError MF105."""
    for name in ("circuits", "display", "wires", "light"):
        if getattr(spec, name) is not None and spec.emitters is None:
            cure = 'Add [emitters] with colour_gap = "8 um" and min_width = "8 um"'
            raise JobError("MF105", f"the job has [{name}] and no [emitters]", where=f"{where}: {name}", cure=cure)


def check_method(document: object, faults: Faults, where: str) -> Set[str]:
    """Keys of [design] that belong to the other method, told as such rather than as unknown.

    Args:
        faults: gets MF102; MF105 for a method that there is not.

    Returns:
        Keys of [design] that are told.
    """
    design = document.get("design") if isinstance(document, dict) else None
    if not isinstance(design, dict):
        return frozenset()
    method = design.get("method", "search")
    if method not in METHODS:
        what, place = f"design.method = {method!r} is not a design method", f"{where}: design.method"
        faults.add(JobError("MF105", what, where=place, cure=f"Use {' or '.join(map(repr, METHODS))}"))
        return frozenset(design)
    own, other = (SearchSection, RelaxSection) if method == "search" else (RelaxSection, SearchSection)
    another = "relax" if method == "search" else "search"
    strange = [key for key in design if key in other.model_fields and key not in own.model_fields]
    for key in strange:
        what = f'the key {key!r} belongs to method = "{another}", and the method is "{method}"'
        cure = f'Remove it, or set method = "{another}"'
        faults.add(JobError("MF102", what, where=f"{where}: design.{key}", cure=cure))
    return frozenset(strange)


def check_design(spec: JobSpec, where: str) -> None:
    """Keys of [design] that need another, or leave it nothing to do; a tiling that its method can judge."""
    design = spec.design
    if isinstance(design, SearchSection):
        _check_search(design, f"{where}: design")
    elif isinstance(design, RelaxSection):
        _check_relax(design, f"{where}: design")


def check_design_grid(spec: JobSpec, where: str) -> None:
    """Refuse a [design] whose dots do not make its pitch (MF106), or share too fine a grid with its display (MF118)."""
    design = spec.design
    if design is None:
        return
    held = spec.emitters is not None and (spec.pareto is not None or getattr(design, "fit", False))
    widest_nm = math.inf
    with Faults():  # a camera that is at fault itself bounds nothing
        widest_nm = widest_dot_nm(spec.camera, spec.camera.wavelengths_nm)
    check_grid(
        design.pitch,
        design.dots,
        None,
        0,
        spec.emitters.grid_lengths if held and spec.emitters is not None else {},
        key="design",
        dots_given=False,
        widest_nm=widest_nm,
        also=[f"[[die]] {die.name}" for die in spec.die if die.pitch == design.pitch],
        where=f"{where}: ",
    )


def _check_search(design: SearchSection, where: str) -> None:
    if design.tiling not in {Tiling.RANDOM, Tiling.PERIODIC}:
        what = f"a search judges openings for random and periodic tilings, not for {design.tiling}"
        raise JobError("MF122", what, where=f"{where}.tiling", cure='Use tiling = "random", or method = "relax"')
    stated = _asked(design)
    needs = (
        ("map_output", design.map is not None, "a map to write", 'Add map = "equal_light"'),
        ("positions", design.map is not None or design.positions == 1, "a map", 'Add map = "equal_light"'),
        ("joint", design.map is not None or not design.joint, "a map", 'Add map = "equal_light"'),
        ("shortlist", design.map is not None or design.shortlist == 1, "a map", 'Add map = "equal_light"'),
        ("density", design.map is not None, "a map", 'Add map = "equal_light"'),
        ("density", design.density != "search" or design.fit, "a display to fit", "Add fit = true"),
        ("outer_dots", design.density is not None, "a denser middle", 'Add density, such as "search"'),
        ("map", design.tiling is Tiling.RANDOM, 'tiling = "random"', "Remove it: periodic cells are laid alike"),
    )
    for key, met, needed, cure in needs:
        if key in stated and getattr(design, key) is not None and not met:
            raise JobError("MF105", f"{key} needs {needed}", where=f"{where}.{key}", cure=cure)
    for needless in ("positions", "joint", *(("shortlist",) if design.shortlist > 1 else ())):
        if design.density is not None and needless in stated:
            what = f"density = {design.density!r} makes {needless} useless"
            raise JobError("MF105", what, where=f"{where}.{needless}", cure=f"Remove {needless}, or density")


def _asked(design: DesignSection) -> set[str]:
    """Keys with other values than their defaults; a job that was written out states those too."""
    stated = set()
    for name, field in type(design).model_fields.items():
        try:
            if getattr(design, name) != field.default:
                stated.add(name)
        except AtFault:
            stated.add(name)
    return stated


def _check_relax(design: RelaxSection, where: str) -> None:
    # Hexagonal sheets are no cells on a square lattice, which every loss is built on; a map is made for an opening
    # that is there.
    if design.tiling in {Tiling.HEXAGONAL, Tiling.MAP}:
        what = f"no opening can be designed for the {design.tiling} tiling"
        cure = f"Use {', '.join(tiling for tiling in Tiling if tiling not in {Tiling.HEXAGONAL, Tiling.MAP})}"
        raise JobError("MF122", what, where=f"{where}.tiling", cure=cure)
    if design.tiling.seeded and design.tiling_seed is None:
        what = f"the {design.tiling} tiling has no seed"
        raise JobError("MF111", what, where=f"{where}.tiling_seed", cure="Add tiling_seed = 1")
    own = set(RelaxSection.model_fields) - set(DesignSection.model_fields) - {"recipe", "epochs"}
    stated = _asked(design)
    needless = own & stated if design.recipe is not None else {"epochs"} & stated
    for key in sorted(needless):
        what = f"the recipe {design.recipe!r} has its own {key}" if design.recipe else f"{key} counts for recipes alone"
        cure = f"Remove {key}, or the recipe" if design.recipe else "Use iterations"
        raise JobError("MF105", what, where=f"{where}.{key}", cure=cure)
    if not any(weight > 0 for name, weight in design.objectives.items() if name != "area"):
        what = f"the objectives {', '.join(design.objectives)} leave nothing to minimise"
        raise JobError("MF105", what, where=f"{where}.objectives", cure="Add invertibility = 1.0")


def check_scene(spec: JobSpec, where: str) -> None:
    """Objects within the focal length have no image (MF104), and a camera of lines no illuminant (MF105)."""
    if spec.scene is None:
        return
    if spec.scene.spectrum == "lines" and spec.scene.illuminant != "equal":
        what = "an illuminant lights a camera of colours, and the spectrum is the camera's own lines"
        cure = 'Add spectrum = "rgb" or a file such as "camera.csv" to [scene], or remove the illuminant'
        raise JobError("MF105", what, where=f"{where}: scene.illuminant", cure=cure)
    for key, distance in (("depth", spec.scene.depth[0]), ("focus", spec.scene.focus)):
        if not distance > spec.camera.focal_um:
            what = f"{distance:g} um is not beyond the focal length of {spec.camera.focal_um:g} um"
            cure = "Give a distance from the lens, beyond its focal length"
            raise JobError("MF104", what, where=f"{where}: scene.{key}", cure=cure)


def check_windows(spec: JobSpec, where: str) -> None:
    """Refuse the window of a PSF that a die has no room for, by :func:`check_window`; photographs use none.

    Coarse dots leave the least room.
    """
    if spec.die:
        number, die = max(enumerate(spec.die), key=lambda pair: pair[1].dot)
        check_window(spec.camera, die.dot, where=f"{where}: die[{number}]")


def check_order(spec: JobSpec, where: str) -> None:
    """An [order] that does not contradict the plate, and asks for no bias that nobody states. Raises JobError MF128."""
    order, plate = spec.order, spec.plate
    if order is None:
        return
    glass = None if plate is None else plate.glass
    if glass is not None and (order.parity or order.chrome) and order.mirrored != (glass.chrome == "away"):
        parity, chrome = order.parity or "right reading", order.chrome or "up"
        side = "the chrome" if glass.chrome == "lens" else "the glass"
        what = f"{parity}, chrome {chrome}, would show the design mirrored to a lens that looks at {side}"
        cure = f'Set parity = "right reading" and chrome = "{"up" if glass.chrome == "lens" else "down"}" in [order]'
        raise JobError("MF128", what, where=f"{where}: order.parity", cure=cure)
    for key, wish, stated, of in (
        ("thickness", order.thickness, None if glass is None else glass.thickness_um, "plate.glass.thickness"),
        ("optical_density", order.optical_density, None if plate is None else plate.optical_density,
         "plate.optical_density"),
    ):  # fmt: skip
        if wish is not None and stated is not None and wish != stated:
            what = f"{key} is {wish:g} in [order], and {of} is {stated:g}"
            raise JobError("MF128", what, where=f"{where}: order.{key}", cure="State it once: leave it out of [order]")
    if order.bias in ("house", "data") and (spec.process is None or not spec.process.cd_bias_um):
        by = "the house is" if order.bias == "house" else "the data are"
        what = f"{by} to make good a bias that [process] does not state"
        cure = 'Add cd_bias = "0.2 um" to [process], by which clear widths come out wider, or set bias = "none"'
        raise JobError("MF128", what, where=f"{where}: order.bias", cure=cure)
    if order.bias == "data":
        _check_biased_data(spec, where)


def _check_biased_data(spec: JobSpec, where: str) -> None:
    """Data that can be biased, by a multiple of their grid at either edge. Raises JobError MF107."""
    grid = 1 if spec.export is None or spec.export.grid is None else max(1, round(spec.export.grid * NM_PER_UM))
    bias_nm = 0.0 if spec.process is None else spec.process.cd_bias_um * NM_PER_UM
    step = 2 * grid
    if abs(bias_nm - step * round(bias_nm / step)) > _ROUNDING_NM:
        near = math.copysign(step * max(1, round(abs(bias_nm) / step)), bias_nm)
        what = f"a bias of {bias_nm:g} nm moves edges by {bias_nm / 2:g} nm, off the data's grid of {grid} nm"
        cure = f'Use a multiple of {step} nm, such as "{near:g} nm"'
        raise JobError("MF107", what, where=f"{where}: process.cd_bias", cure=cure)


def check_report(spec: JobSpec, where: str) -> None:
    """A [report] that compares with a die of the job, at frequencies that the sensor samples.

    Raises:
        JobError: MF105 for a die that there is not, MF104 for a frequency beyond half a cycle per pixel.
    """
    report = spec.report
    if report is None:
        return
    names = [die.name for die in spec.die]
    if report.reference is not None and report.reference not in names:
        what = f"there is no die {report.reference!r} to compare with"
        cure = f"Use one of {', '.join(names)}" if names else "Add a [[die]] of that name, or remove the key"
        raise JobError("MF105", what, where=f"{where}: report.reference", cure=cure)
    highest = spec.camera.nyquist_cy_per_mm
    for frequency in report.frequencies or ():
        if frequency > highest * (1 + 1e-12):
            what = f"{frequency:g} cy/mm is beyond half a cycle per pixel, {highest:g} cy/mm"
            raise JobError("MF104", what, where=f"{where}: report.frequencies", cure=f"Use at most {highest:g} cy/mm")


def check_film(spec: JobSpec, where: str) -> None:
    """Chrome that solids can show, as thick as they draw it. Raises JobError MF104."""
    section = spec.export
    if section is None or set(SOLIDS).isdisjoint(section.formats or ()):
        return
    (least, most), film = _FILM_UM, section.chrome * section.exaggeration
    if least * (1 - 1e-9) <= film <= most * (1 + 1e-9):
        return
    key, cure = "chrome", f'Use chrome = "{least * NM_PER_UM:g} nm" or more, or leave solids out of export.formats'
    if section.chrome > most:
        cure = f'Use chrome = "{most / 1e6:g} m" or less'
    elif film > most:
        key, cure = "exaggeration", f"Use at most {most / section.chrome:g}, or thinner chrome"
    what = (
        f"chrome of {section.chrome:g} um, drawn {section.exaggeration:g} times as thick, is a film of {film:g} um; "
        f"solids show films of {least * NM_PER_UM:g} nm to {most / 1e6:g} m"
    )
    raise JobError("MF104", what, where=f"{where}: export.{key}", cure=cure)


def read(path: Path, further: Callable[[JobSpec], None] | None = None) -> JobSpec:
    """Load and validate a job file (.toml, or the .json that a run keeps).

    Args:
        further: what a verb refuses before any work; called where there are faults, to tell it with them.

    Raises:
        SourceError: MF301, MF302, MF303 or MF308 if the file cannot be read.
        JobError: MF101 to MF131 for what is wrong with its content, all of it at once.
    """
    data, where = document(path, "job"), str(path)
    faults = JobFaults.of(data)
    spec = examined(data, faults, where=where)
    if further is not None and faults:
        with faults:
            further(spec)
    faults.refuse()
    return spec


def document(path: Path, kind: str) -> object:
    """Plain data of a file that a user writes, unchecked.

    Args:
        path: of a .toml, or of the .json that a run keeps.

    Raises:
        SourceError: MF301, MF302, MF303, MF304 or MF308 if the file cannot be read.
        JobError: MF101 for what is no TOML.
    """
    if os.path.isdir(path):
        jobs = sorted(file.name for file in path.glob("*.toml"))
        inside = f" such as {path / ('job.toml' if 'job.toml' in jobs else jobs[0])}" if jobs else ""
        what = f"{path} is a folder, and a {kind} file is meant"
        raise SourceError("MF301", what, cure=f"Give a file (.toml) in it{inside}")
    if not os.path.isfile(path):
        cure = f"Give the path of a {kind} file (.toml); the shipped ones are in {resources.path('layouts')}"
        raise SourceError("MF301", f"there is no {kind} file {path}", cure=cure)
    data = path.read_bytes()
    if not data.strip():
        raise SourceError("MF302", f"the {kind} file {path} is empty", cure="Start from a shipped one, in layouts")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError("MF304", f"the {kind} file {path} is not text: {error}", cure="Save it as UTF-8") from error
    if path.suffix == ".json":
        try:
            return json.loads(text)
        except (ValueError, RecursionError) as error:
            what = f"{path} is not valid JSON: {error}"
            raise SourceError("MF303", what, cure="Run the job again to rewrite it") from error
    if path.suffix != ".toml":
        raise SourceError("MF308", f"{path} has the suffix {path.suffix!r}", cure=f"A {kind} file ends in .toml")
    return _toml(text, str(path))


def validate(document: object, *, where: str) -> JobSpec:
    """A spec from parsed data; ``where`` names the file in errors, which come all at once."""
    faults = JobFaults.of(document)
    spec = examined(document, faults, where=where)
    faults.refuse()
    return spec


def examined(document: object, faults: JobFaults, *, where: str) -> JobSpec:
    """A spec from parsed data, and all that is wrong with it.

    Returns:
        The spec; with faults one of which no value that is at fault can be read (:class:`AtFault`).

    Raises:
        InputError: for what leaves nothing to judge, such as a list.
    """
    check_version(document, where)
    told = check_method(document, faults, where)
    try:
        spec = JobSpec.model_validate(document)
    except ValidationError as error:
        for fault in problems(error, JobSpec, document, where):
            if fault.where.removeprefix(f"{where}: design.") not in told:
                faults.add(fault)
        try:
            spec = sound_part(error, JobSpec, document, faults, where)
        except AtFault:
            faults.refuse()
            raise
    for check in (check_design, check_design_grid, check_display, check_scene, check_film, check_order, check_report):
        with faults:
            check(spec, where)
    with faults:
        check_dies(spec, faults, where)
    return spec


def check_version(document: object, where: str) -> None:
    """Refuse a job that says it needs a later version (MF154), before its keys are found to be unknown."""
    needed = document.get("maskfab") if isinstance(document, dict) else None
    if needed is None:
        return
    if not (isinstance(needed, str) and _VERSION.fullmatch(needed)):
        what, cure = f"maskfab = {needed!r} is not a version", f'Write maskfab = "{__version__}", or leave it out'
        raise JobError("MF105", what, where=f"{where}: maskfab", cure=cure)
    asked, own = ([int(part) for part in version.split(".")] for version in (needed, __version__))
    if asked > own:
        what = f"the job needs maskfab {needed} or later, and this is {__version__}"
        cure = f"Install maskfab {needed} or later; or remove the key, and mend what is then refused"
        raise JobError("MF154", what, where=f"{where}: maskfab", cure=cure)


_VERSION = re.compile(r"\d{1,6}(\.\d{1,6}){0,3}")


def _toml(text: str, where: str) -> dict[str, Any]:
    try:
        return loads(text)
    except (ValueError, RecursionError) as error:
        match = re.search(r"line (\d+), column (\d+)", str(error))
        place = f"{where}:{match[1]}:{match[2]}" if match else f"{where}, at the end"
        cure = "Correct the TOML there: close quotes and brackets, give every key one value"
        raise JobError("MF101", f"TOML syntax: {error}", where=place, cure=cure) from error
