"""Plots of speed against error and of growth, measured here and now: ``make bench``.

``speed.png`` races every path and other libraries in each class of jobs; ``growth.png`` shows how long a user's calls
take as their scene grows. Times are of one processor; both go into the folder that is named, ``build/bench`` otherwise.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import maskfab as mf
from maskfab.base.model import Panel
from maskfab.job.camera import Stop
from maskfab.optics.field.polygons import boundary
from maskfab.optics.stop_edges import edges_in_stop
from maskfab.trials.race import (
    Race,
    Workload,
    absent,
    gemm_bound_ms,
    race,
    race_figure,
    slit_panel,
    standard_workload,
)

LINE = "530 nm"
Spent = tuple[float, float]
"""Milliseconds of a first and of a second call."""


@dataclass(frozen=True)
class Growth:
    """Times of one call over a size.

    Attributes:
        what: the call.
        size: of the scene, in words.
        sizes: [n].
        spent: milliseconds of a first and a second call for each.
        limit: least time of its arithmetic for each, and how that was measured; none where it is not a product.
    """

    what: str
    size: str
    sizes: Sequence[float]
    spent: Sequence[Spent]
    limit: Sequence[float] = ()

    def exponent(self, call: int) -> float:
        """Power of the size with which the time of a call grows between the two largest."""
        (early, late), (small, large) = (one[call] for one in self.spent[-2:]), self.sizes[-2:]
        return float(np.log(late / early) / np.log(large / small))


def job_classes() -> dict[str, Workload]:
    """The standard workload and others that differ from it in what decides which path is best, by what they are."""
    usual = standard_workload()
    return {
        "4 mm stop, dots of 8 um, 512² of 0.5 um": usual,
        "a look: 128² of 2 um": replace(usual, step_um=2.0, samples=128),
        "wide window: 1024² of 0.5 um": replace(usual, samples=1024),
        "small stop: 0.5 mm": replace(usual, panel=slit_panel(cells=4), diameter_um=500.0),
        "100 cells across: 16.8 mm stop": replace(usual, panel=slit_panel(cells=100), diameter_um=16_800.0),
        "fine dots: 2 um": replace(usual, panel=slit_panel(84)),
    }


def timed(function: Callable[[], object]) -> float:
    start = time.process_time()
    function()
    return 1e3 * (time.process_time() - start)


def calls(make: Callable[[int], Callable[[], object]], rounds: int = 3) -> Spent:
    """A first and a second call of what is made for each seed; medians."""
    spent = []
    for seed in range(rounds + 1):
        function = make(seed)
        spent.append((timed(function), timed(function)))
    first, second = np.median(spent[1:], axis=0)
    return float(first), float(second)


def scene(dots: int = 21, stop_mm: float = 4.0, samples: int = 512, seed: int = 0) -> tuple[mf.Camera, Panel]:
    """A slower lens for a wider stop, so that the window holds as many rings: f/2.5, no shorter than 10 mm."""
    focal_mm = max(10.0, 2.5 * stop_mm)
    lens = mf.Camera(
        f"{focal_mm:g} mm",
        stop=f"{stop_mm:g} mm",
        pixel="2 um",
        wavelengths=LINE,
        window=f"{samples / 2:g} um",
    )
    return lens, slit_panel(dots, 2 * int(np.ceil(stop_mm / 2 / 0.168)), seed)


def psf_of(dots: int = 21, stop_mm: float = 4.0, samples: int = 512) -> Spent:
    def fresh(seed: int) -> Callable[[], object]:
        lens, panel = scene(dots, stop_mm, samples, seed)
        return lambda: lens.psf(panel, LINE)

    return calls(fresh)


def least_of(stop_mm: float = 4.0, samples: int = 512) -> float:
    """Milliseconds of the matrix products alone for as many samples as the camera takes."""
    lens, panel = scene(stop_mm=stop_mm, samples=samples)
    side = len(lens.psf(panel, LINE).values) // 2 * 2
    asked = replace(standard_workload(), panel=panel, diameter_um=1e3 * stop_mm, samples=side)
    return gemm_bound_ms(asked, rounds=3)["double"]


def mtf_of(stop_mm: float = 4.0, dots: int = 21) -> Spent:
    def fresh(seed: int) -> Callable[[], object]:
        lens, panel = scene(dots, stop_mm, 256, seed)
        return lambda: lens.mtf(panel, LINE)

    return calls(fresh)


def polygon_psf_of(edges: int) -> Spent:
    """Boxes at random in a stop of 4 mm."""
    draw = np.random.default_rng(1)
    low = draw.integers(-1_350_000, 1_350_000, (edges // 4, 2))
    boxes = np.concatenate([low, low + draw.integers(1_000, 4_000, (edges // 4, 2))], axis=1)
    found, area = edges_in_stop(boxes, Stop("circle", 4000.0), (0.0, 0.0))
    step = 0.5 / 5300.0

    def fresh(_: int) -> Callable[[], object]:
        outline = boundary(found, area, 255 * step * np.sqrt(2))
        return lambda: outline.field(step, 511)

    return calls(fresh)


def growths() -> Iterator[Growth]:
    stops = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0)
    spent = [psf_of(stop_mm=d) for d in stops]
    yield Growth("camera.psf, window 256 um", "stop (mm)", stops, spent, [least_of(stop_mm=d) for d in stops])
    sides = (21, 42, 84, 168)
    yield Growth("camera.psf, window 256 um", "dots along a pixel", sides, [psf_of(dots=n) for n in sides])
    windows = (64, 128, 256, 512)
    spent = [psf_of(samples=2 * w) for w in windows]
    yield Growth("camera.psf", "window (um)", windows, spent, [least_of(samples=2 * w) for w in windows])
    yield Growth("camera.mtf with bars", "stop (mm)", stops, [mtf_of(d) for d in stops])
    yield Growth("camera.mtf with bars", "dots along a pixel", sides, [mtf_of(dots=n) for n in sides])
    edges = (1_000, 10_000, 100_000, 1_000_000)
    yield Growth("PSF 511² of polygons", "edges", edges, [polygon_psf_of(n) for n in edges])


def growth_figure(found: Sequence[Growth]) -> Figure:
    figure = Figure(figsize=(13.0, 7.5), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    plots = figure.subplots(2, 3).ravel()
    for axes, one in zip(plots, found, strict=True):
        for call, (mark, colour, name) in enumerate(
            (("o-", "#0072b2", "first call"), ("s-", "#56b4e9", "second call"))
        ):
            label = f"{name}: grows as size^{one.exponent(call):.2f} at its end"
            axes.plot(one.sizes, [spent[call] for spent in one.spent], mark, color=colour, label=label)
        if one.limit:
            axes.plot(one.sizes, one.limit, "--", color="grey", label="its matrix products alone")
        axes.set(xscale="log", yscale="log", xlabel=one.size, ylabel="processor time (ms, one thread)", title=one.what)
        axes.set_xticks(one.sizes, [f"{size:g}" for size in one.sizes], minor=False)
        axes.minorticks_off()
        axes.legend(fontsize=8)
        axes.grid(alpha=0.3)
    return figure


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/bench")
    folder.mkdir(parents=True, exist_ok=True)
    with threadpool_limits(1):
        races = {}
        for title, workload in job_classes().items():
            races[title] = Race(race(workload, rounds=3), gemm_bound_ms(workload))
            ours = [t for t in races[title].timings if t.kind == "ours" and t.precision == "double"]
            (chosen,) = (t for t in ours if t.chosen)
            best = min(ours, key=lambda t: t.milliseconds)
            ratio = chosen.milliseconds / best.milliseconds
            print(
                f"{title:42}  {chosen.name}: {chosen.milliseconds:.1f} ms, {ratio:.2f}x of the best path, {best.name}"
            )
        for name, reason in absent().items():
            print(f"not compared: {name}, {reason}")
        (folder / "speed.png").write_bytes(race_figure(races))
        found = list(growths())
        for one in found:
            for size, (first, second) in zip(one.sizes, one.spent, strict=True):
                print(f"{one.what:24}  {size:>9g} {one.size:24}  first {first:9.1f} ms, second {second:9.1f} ms")
        growth_figure(found).savefig(folder / "growth.png", metadata={"Software": None})


if __name__ == "__main__":
    main()
