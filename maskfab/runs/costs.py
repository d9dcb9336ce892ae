"""Seconds of a processor, and bytes, that the tasks and stages of a run are expected to take.

Notes:
    Constants are those of one thread of the machine of the reference numbers. What another machine takes follows from
    what its earlier tasks took, see :class:`Pace`, or, where it has done none, from a probe of it.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from klayout import db

from maskfab.base.units import NM_PER_UM
from maskfab.mask.houses.files import PlateFiles
from maskfab.report.rows.scene import peak_bytes
from maskfab.runs.recall import words
from maskfab.runs.store import Entry

PROBE_S = 0.1
"""That :func:`probe` takes there."""
STARTED_S = 2.0
"""Of a process, for its imports."""
HELD = 400e6
"""Bytes of a process that has imported what it needs."""
SCENES_S = 2.0
"""Of each process that takes photographs, for drawing their scenes."""
_PROBED = 512
_TIMES = 3

_COLOURS = _LEVELS = 3
"""Of light, in what a photographed die takes; a die that is not seen in so many colours is not photographed."""
_OF_PRICE = 0.75
"""Time of the PSFs of scenes over that which plans foretell."""
_VIEWS_OF_FIELD = 25
"""Places on the sensor whose PSFs a report shows, where they differ."""
_DRAWN_WINDOW_PX = 128.0
"""Side of the window in what the optics of a die take for each wavelength."""


def _of_photographs(conditions: Any, around: Any, *_: Any) -> float:
    bands = () if around.scene is None else around.scene.bands
    seen = len(bands or conditions.camera.wavelengths_nm)
    return 4.5 * float(len(conditions.levels)) / _LEVELS if seen == _COLOURS else 0.0


def _of_optics(die: Any, camera: Any, *_: Any) -> float:
    """Dots in the stop set the transform's length, pixels of the window its points."""
    side = camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    dots = camera.stop.diameter_um / (die.panel.dot_nm / NM_PER_UM)
    return float(len(camera.wavelengths_nm) * (0.02 + 0.08 * side**2 + 0.1 * (dots / 500) ** 2))


def _of_scene(_die: Any, camera: Any, scene: Any, _openings: Any, plan: Any, *_: Any) -> float:
    """The plan's price is that of the whole scene; a report shows some of its PSFs, and one by the fullest model."""
    choice, side = plan.choice, camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    depths = len({scene.nearest_um, scene.focus_um, scene.farthest_um}) if choice.defocus else 0
    off_axis = scene.differs_off_axis and (choice.places > 1 or choice.distortion > 0)
    of_bands = plan.wavelengths if scene.bands else 0
    fuller = plan.fullest.samples_per_dot / choice.samples_per_dot if choice.samples_per_dot else 1.0
    shown = 1 + fuller + depths + _VIEWS_OF_FIELD * off_axis + of_bands
    one = float(plan.price.seconds) / (plan.wavelengths * plan.depths * choice.places**2)
    resampled = 0.03 * side**2 * _VIEWS_OF_FIELD * off_axis * choice.distortion**2
    return float(0.2 + _OF_PRICE * shown * one + resampled)


_MODELS: Mapping[str, Callable[..., float]] = MappingProxyType(
    {
        "display.feasibility.feasibility": lambda *_, **__: 2.0,
        "report.rows.photographs.photograph_die": _of_photographs,
        "report.rows.optics.measure_with_bar": _of_optics,
        "report.rows.scene.measure_scene": _of_scene,
        "report.rows.as_written.measure_written": lambda *_: 1.5,
        "report.rows.bands.band_quantities": lambda _written, _camera, spread, *_: 4.0 if spread else 0.0,
        "report.rows.bands.restored_expansion": lambda *_: 11.0,
        "report.figures.die.overview": lambda *_: 0.5,
        "report.figures.die.of_plate": lambda *_: 0.3,
        "report.figures.die.of_die": lambda *_: 0.4,
        "report.figures.scene.pictures": lambda *_: 0.5,
        "report.figures.display.pictures": lambda *_: 0.3,
        "report.figures.scene.photograph_pictures": lambda *_: 0.3,
        "report.figures.scene.truth": lambda *_: 0.05,
        "report.figures.scene.front": lambda *_: 0.05,
        "report.figures.die.written_pictures": lambda *_: 0.35,
    }
)


_PHOTOGRAPHS_BYTES = 200e6
_HELD: Mapping[str, Callable[..., float]] = MappingProxyType(
    {
        "report.rows.photographs.photograph_die": lambda *_: _PHOTOGRAPHS_BYTES,
        "report.rows.as_written.measure_written": lambda *_: 400e6,
        "report.rows.bands.restored_expansion": lambda *_: 500e6,
        "report.rows.scene.measure_scene": lambda die, camera, scene, _, plan, *__: _scene_bytes(
            die, camera, scene, plan
        ),
    }
)
"""Bytes of tasks that hold more than others."""


def _scene_bytes(die: Any, camera: Any, scene: Any, plan: Any) -> float:
    """Of a process that has taken photographs, whose memory it keeps; samples of a lens that distorts are finer."""
    side = camera.window_um / camera.pixel_um / _DRAWN_WINDOW_PX
    return float(
        _PHOTOGRAPHS_BYTES + peak_bytes(die, camera, scene, plan) + 9e6 * (side * plan.fullest.distortion) ** 2
    )


def expected(function: Callable[..., Any], given: tuple[Any, ...]) -> float | None:
    """Seconds that a function of a module is expected to take; None for one of which nothing is known."""
    model = _MODELS.get(words(function))
    return None if model is None else float(model(*given))


@dataclass(frozen=True)
class Pace:
    """Time that this machine takes over that of the machine of the reference numbers.

    Attributes:
        of_all: tasks without one of their own.
        of_kind: tasks, by the name of their function.
        source: of the numbers, in words.
    """

    of_all: float
    of_kind: Mapping[str, float]
    source: str

    @classmethod
    def of(cls, entries: Iterable[Entry]) -> Pace:
        """By what earlier tasks took; by a probe where there are none."""
        took: dict[str, list[tuple[float, float]]] = defaultdict(list)
        for entry in entries:
            if entry.seconds is not None and entry.expected_s:
                took[entry.what].append((entry.seconds, entry.expected_s))
        if not took:
            return cls(probe() / PROBE_S, {}, "by constants, and a probe of this machine")
        number = sum(map(len, took.values()))
        of_kind = {what: _ratio(each) for what, each in took.items()}
        every = [pair for each in took.values() for pair in each]
        return cls(_ratio(every), of_kind, f"by {number} earlier tasks on this machine")

    def seconds(self, function: Callable[..., Any], given: tuple[Any, ...]) -> float:
        """That a task is expected to take here."""
        own = expected(function, given)
        return 0.0 if own is None else own * self.of_kind.get(words(function), self.of_all)


@dataclass(frozen=True)
class _FileCost:
    """Seconds that a kind of file takes, written and read back: for each vertex that stands in a cell, for each
    reference, for each vertex with all references followed, and for each file."""

    vertex: tuple[float, float] = (0.0, 0.0)
    reference: tuple[float, float] = (0.0, 0.0)
    drawn: tuple[float, float] = (0.0, 0.0)
    file: tuple[float, float] = (0.03, 0.05)


_FILES: Mapping[str, _FileCost] = MappingProxyType(
    {
        ".gds": _FileCost((0.6e-6, 1e-6), (1.4e-6, 25e-6)),
        ".oas": _FileCost((1e-6, 1e-6), (1.6e-6, 32e-6)),
        "_R12.dxf": _FileCost((1.9e-6, 4.8e-6), (5.8e-6, 38e-6)),
        "_R2010.dxf": _FileCost((1e-6, 2.8e-6), (4.5e-6, 35e-6)),
        ".gbr": _FileCost(drawn=(0.46e-6, 11e-6)),
        ".cif": _FileCost((1e-6, 2e-6), (1e-6, 26e-6)),
        ".svg": _FileCost(reference=(0.6e-6, 17e-6)),
        ".step": _FileCost(file=(0.35, 2.2)),
    }
)
"""By how a file's name ends."""
_OTHER = _FileCost(file=(0.3, 0.8))
"""Solids and pictures of a die."""
_DOTS_S = 0.08
"""Of comparing a die dot by dot."""
_VERTEX_BYTES = 900.0
_DRAWN_BYTES = 150.0
_DOT_BYTES = 19.0
"""Of a dot, as it was read and as it was designed, in the die that has most of them."""
_BOX_BYTES = 22.0
"""Of a vertex among the boxes that the die's dots are found from."""


@dataclass(frozen=True)
class Amounts:
    """Size of the work of drawing, writing and reading the files of a plate.

    Attributes:
        vertices: that stand in cells of the design.
        references: of the design.
        drawn: vertices with all references followed.
        dots: of the die that has most, its gutters among them.
        share: of that die in the dots of all.
        dies: on the plate.
    """

    vertices: int
    references: int
    drawn: int
    dots: int
    share: float
    dies: int

    @classmethod
    def of(cls, made: PlateFiles) -> Amounts:
        """Amounts of the files that a plate becomes."""
        vertices = references = 0
        for cell in made.design.each_cell():
            references += cell.child_instances()
            for layer in made.design.layer_indexes():
                drawn = db.Region(cell.shapes(layer))
                drawn.merged_semantics = False
                vertices += drawn.edges().count()
        panels = [die.panel for die in made.plate.dies]
        dots = [panel.orientations.size * (len(panel.cell_size.edges_nm) - 1) ** 2 for panel in panels]
        most = max(dots, default=0)
        share = most / sum(dots) if most else 0.0
        return cls(vertices, references, made.figures.account.vertices, most, share, len(dots))


def layout_s(dies: int) -> float:
    """Of laying out so many dies."""
    return 0.1 + 0.01 * dies


def draw_s(amounts: Amounts) -> float:
    """Of drawing the polygons that the files are written from."""
    return 0.05 + 1.5e-6 * amounts.vertices + 3e-6 * amounts.references


def write_s(made: PlateFiles, amounts: Amounts) -> float:
    """Of writing every file."""
    return _files_s(made, amounts, 0)


def read_s(made: PlateFiles, amounts: Amounts) -> float:
    """Of reading every file back, and comparing it with the design."""
    return _files_s(made, amounts, 1) + _DOTS_S * amounts.dies


def read_bytes(made: PlateFiles, amounts: Amounts) -> float:
    """Of memory, for the design, a file that is held against it, and the dots of one die."""
    flat = any(product.name.endswith(".gbr") for product in made.products)
    of_die = _DOT_BYTES * amounts.dots + _BOX_BYTES * amounts.share * amounts.drawn
    return _VERTEX_BYTES * amounts.vertices + max(of_die, _DRAWN_BYTES * amounts.drawn * flat)


def figures_s(tasks: int) -> float:
    """Of drawing so many pages of figures."""
    return 0.25 + 0.3 * tasks


def task_bytes(function: Callable[..., Any], given: tuple[Any, ...]) -> float:
    """Of memory that a task holds at its most."""
    held = _HELD.get(words(function))
    return 0.0 if held is None else float(held(*given))


def _files_s(made: PlateFiles, amounts: Amounts, way: int) -> float:
    counted = amounts.vertices, amounts.references, amounts.drawn
    total = 0.0
    for product in made.products:
        cost = next((cost for ending, cost in _FILES.items() if product.name.endswith(ending)), _OTHER)
        each = (cost.vertex[way], cost.reference[way], cost.drawn[way])
        total += cost.file[way] + sum(one * amount for one, amount in zip(each, counted, strict=True))
    return total


def _ratio(pairs: Iterable[tuple[float, float]]) -> float:
    known = list(pairs)
    return sum(seconds for seconds, _ in known) / sum(expected_s for _, expected_s in known)


def probe() -> float:
    """Seconds of a processor for a fixed piece of work of the kind that tasks do, a quarter of a second at most."""
    values = np.random.default_rng(1).random((_PROBED, _PROBED))
    begun = time.thread_time()
    for _ in range(_TIMES):
        np.fft.ifft2(np.fft.fft2(values))
        values @ values
        sorted(values.ravel().tolist()[:20_000])
    return time.thread_time() - begun
