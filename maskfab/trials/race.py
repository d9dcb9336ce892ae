"""Speed against error: every way to the PSF of one panel, timed side by side and held against an exact answer.

All contestants see the same dots behind a stop that takes whole dots by their centres, and give as many samples of the
same window. The exact answer is the complex matrix transform of whole dots in float64, taken at each contestant's own
sample positions; tests hold it to 1e-14 of a direct sum. Peers treat a dot as a point, so each is judged twice: as
given, and multiplied by the dot's factor sinc(u dot) sinc(v dot) afterwards.

**Other libraries** are timed where they are installed (the extra ``peers``). Each takes the dots as
points, as its users would give them, and returns intensity at multiples of the step from -samples/2. None is imported
before it is asked for.

**The published recipe** for the PSF of a display panel is our own port, the baseline. Dots become points of a square
array that is padded with zeros to λf / (dot x step) samples, rounded down to an even number, and sent through one
complex FFT; a window is cut from the middle of the squared modulus.

Notes:
    A dot as a point lacks the factor sinc(u dot) sinc(v dot), 1.8e-2 of the PSF. The rounding of the size changes the
    wavelength by up to a part in a thousand, to another value for every colour, which costs 1.6e-2 to 3.4e-2 more.
"""

from __future__ import annotations

import importlib
import importlib.util
import io
import json
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median, quantiles
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from maskfab.base import provenance
from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target, staged
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.base.units import NM_PER_UM, UM_PER_MM, UM_PER_NM
from maskfab.base.work import Progress, silent
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import direct_field
from maskfab.optics.field.methods import PATHS, FieldTask, admissible
from maskfab.optics.psf import point_step_um
from maskfab.optics.pupil import Pupil, panel_aperture
from maskfab.optics.tiling import orientations
from maskfab.trials.hard_cases import CaseResult


@dataclass(frozen=True)
class PsfTask:
    """One PSF to compute.

    Attributes:
        dots: [n, n] amplitude of every dot.
        dot_um, focal_um, step_um: as everywhere; the step is that of the sensor's samples.
        wavelength_um: in micrometres here.
        samples: along each axis.
    """

    dots: Floats
    dot_um: float
    focal_um: float
    wavelength_um: float
    step_um: float
    samples: int


@dataclass(frozen=True)
class Peer:
    """A library's transform: what to import, what it is called, and how to make a function that computes the task."""

    module: str
    name: str
    precision: str
    prepare: Callable[[Any, PsfTask], Callable[[], NDArray[np.floating[Any]]]]

    def missing(self) -> str | None:
        """Why the library cannot be used here; None if it can."""
        try:
            if importlib.util.find_spec(self.module.partition(".")[0]) is None:
                return "not installed"
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                importlib.import_module(self.module)
        except Exception as error:  # whatever somebody else's module does when it is imported
            return f"installed, but does not import: {error}"
        return None

    def function(self, task: PsfTask) -> Callable[[], NDArray[np.floating[Any]]]:
        """The function that computes the task; calls after the first may use what the first has kept."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self.prepare(importlib.import_module(self.module), task)


def _prysm(engine: str, bits: int) -> Callable[[Any, PsfTask], Callable[[], Any]]:
    def prepare(module: Any, task: PsfTask) -> Callable[[], Any]:
        config = importlib.import_module("prysm.conf").config
        # An engine of its own: the library's shared one keeps its matrices in the precision it met first.
        transform = getattr(importlib.import_module("prysm.fttools"), engine)()
        apply = getattr(transform, "dft2" if engine == "MatrixDFTExecutor" else "czt2")
        side_mm, focal_mm = task.dots.shape[0] * task.dot_um / UM_PER_MM, task.focal_um / UM_PER_MM
        padding = module.Q_for_sampling(side_mm, focal_mm, task.wavelength_um, task.step_um)
        wave = task.dots.astype(np.complex64 if bits == 32 else np.complex128)

        def run() -> Any:
            config.precision = bits
            field = apply(ary=wave, Q=padding, samples=task.samples)
            config.precision = 64
            return abs(field) ** 2

        return run

    return prepare


def _poppy(module: Any, task: PsfTask) -> Callable[[], Any]:
    side = task.dots.shape[0] * task.dot_um
    width = task.samples * task.step_um / (task.wavelength_um * task.focal_um / side)
    wave = task.dots.astype(np.complex128)
    return lambda: abs(module.matrix_dft(wave, width, task.samples, centering="FFTSTYLE")) ** 2


def _hcipy(module: Any, task: PsfTask) -> Callable[[], Any]:
    n = task.dots.shape[0]
    pupil = module.make_uniform_grid([n, n], [n * task.dot_um, n * task.dot_um])
    width = task.samples * task.step_um
    scale = 2 * np.pi / (task.wavelength_um * task.focal_um)
    centre = [-task.step_um / 2 * scale] * 2
    focal = module.make_uniform_grid([task.samples] * 2, [width * scale] * 2, center=centre)
    field = module.Field(task.dots.ravel().astype(np.complex128), pupil)
    transform = module.MatrixFourierTransform(pupil, focal)

    def run() -> Any:
        return abs(np.asarray(transform.forward(field))).reshape(task.samples, task.samples) ** 2

    return run


def _lentil(module: Any, task: PsfTask) -> Callable[[], Any]:
    alpha = task.dot_um * task.step_um / (task.wavelength_um * task.focal_um)
    wave = task.dots.astype(np.complex128)
    return lambda: abs(module.dft2(wave, alpha, task.samples)) ** 2


PEERS = (
    Peer("prysm.propagation", "prysm matrix DFT", "double", _prysm("MatrixDFTExecutor", 64)),
    Peer("prysm.propagation", "prysm matrix DFT", "single", _prysm("MatrixDFTExecutor", 32)),
    Peer("prysm.propagation", "prysm chirp-z", "double", _prysm("ChirpZTransformExecutor", 64)),
    Peer("poppy.matrixDFT", "poppy matrix_dft", "double", _poppy),
    Peer("hcipy", "HCIPy matrix Fourier transform", "double", _hcipy),
    Peer("lentil.fourier", "lentil dft2", "double", _lentil),
)


def published_size(wavelength_nm: float, focal_um: float, dot_um: float, step_um: float) -> int:
    """Samples of the padded array: λf / (dot x step) rounded down to an even number."""
    exact = wavelength_nm * UM_PER_NM * focal_um / (dot_um * step_um)
    return int(exact + 1e-9) // 2 * 2


def published_intensity(dots: Floats, size: int, samples: int) -> Floats:
    """Intensity in the window, [samples, samples], at multiples of the step from -samples/2; not normalised."""
    padded = np.zeros((size, size), dtype=np.complex128)
    padded[: dots.shape[0], : dots.shape[1]] = dots
    spectrum = np.fft.fftshift(np.fft.fft2(padded))
    first = size // 2 - samples // 2
    window = spectrum[first : first + samples, first : first + samples]
    intensity: Floats = np.abs(window) ** 2
    return intensity


@dataclass(frozen=True)
class Workload:
    """One PSF to compute: a panel of square dots, a round stop, and a window of samples.

    Attributes:
        panel: without gutters, wide enough for the stop.
        diameter_um: of the stop; a dot counts as open if its centre lies inside.
        step_um: distance between samples on the sensor.
        samples: along each axis, even.
    """

    panel: Panel
    diameter_um: float
    wavelength_nm: float
    focal_um: float
    step_um: float
    samples: int

    def pupil(self) -> Pupil:
        """The dots that count, none of them cut."""
        aperture = panel_aperture(self.panel)
        x, y = ((edges[1:] + edges[:-1]) / 2 for edges in (aperture.x.edges_um(), aperture.y.edges_um()))
        inside = x**2 + y[:, None] ** 2 <= (self.diameter_um / 2) ** 2
        whole = np.where(inside, aperture.transmission, 0.0)
        return Pupil.of_whole_dots(aperture.x, aperture.y, whole, Stop("circle", self.diameter_um))

    def frequencies(self, offset: float) -> Floats:
        """Frequencies of all samples along an axis, cycles per micrometre, the one at ``samples / 2`` being offset."""
        position = self.step_um * (np.arange(self.samples, dtype=np.float64) - self.samples // 2 + offset)
        return position / (self.wavelength_nm * UM_PER_NM * self.focal_um)


@dataclass(frozen=True)
class Timing:
    """Time and error of one contestant.

    Attributes:
        kind: ours, peer, or published.
        milliseconds: processor time of a call that finds what the last one kept; median over the rounds.
        spread: lower and upper quartile of it, milliseconds.
        cold_milliseconds: of a first call, with all that it sets up; median likewise.
        error: relative L2 of the unit-sum PSF, as given.
        error_with_dots: the same after the dot's factor; equal to ``error`` where it is part of the method.
        chosen: whether it is the path that maskfab takes where nobody asks for another.
    """

    name: str
    precision: str
    kind: str
    milliseconds: float
    spread: tuple[float, float]
    cold_milliseconds: float
    error: float
    error_with_dots: float
    chosen: bool = False


@dataclass(frozen=True)
class Race:
    """Times and errors of one workload, and the processor time of the matrix products alone, by precision."""

    timings: Sequence[Timing]
    bound_ms: Mapping[str, float]


@dataclass(frozen=True)
class _Contestant:
    name: str
    precision: str
    kind: str
    offset: float
    set_up: Callable[[], Callable[[], NDArray[Any]]]
    """Makes the function to be timed; its first call is cold."""
    chosen: bool = False


def slit_panel(dots: int = 21, cells: int = 24, seed: int = 0) -> Panel:
    """A slit of 5 x 18 in 21 parts of a pixel of 168 um, drawn in so many dots and tiled at random."""
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[dots * 2 // 21 : dots * 20 // 21, dots * 8 // 21 : dots * 13 // 21] = True
    chosen = orientations(Tiling.RANDOM, cells, cells, seed)
    dot_nm = 168_000 // dots
    return Panel(Opening("slit", mask, dot_nm), dot_nm, 0, chosen, Tiling.RANDOM, seed)


def standard_workload() -> Workload:
    """A slit of 5 x 18 in 21 x 21 dots of 8 um, tiled at random over a stop of 4 mm; 512 x 512 samples of 0.5 um."""
    return Workload(slit_panel(), 4000.0, 530.0, 10_000.0, 0.5, 512)


def gemm_bound_ms(workload: Workload, rounds: int = 15) -> dict[str, float]:
    """Median time of the parity path's products alone, eight of them on operands of their sizes, by precision."""
    pupil = workload.pupil()
    half = sum(lattice.cells * lattice.period for lattice in (pupil.x, pupil.y)) // 4
    bounds = {}
    for name, kind in (("double", np.float64), ("single", np.float32)):
        waves = np.ones((workload.samples // 2, half), dtype=kind)
        core = np.ones((half, half), dtype=kind)
        with threadpool_limits(1):
            seconds = []
            for _ in range(rounds):
                start = time.process_time()
                for _ in range(4):
                    (waves @ core) @ waves.T
                seconds.append(1e3 * (time.process_time() - start))
        bounds[name] = median(seconds)
    return bounds


def workload_of(panel: Panel, camera: Camera) -> Workload:
    """A die's panel as a workload: the camera's middle wavelength, and an even number of samples of its window.

    Raises:
        JobError: MF105 for a panel with gutters, whose dots have no common grid that peers could take.
    """
    if panel.gutter_nm:
        what = "peers cannot take a panel with gutters"
        raise JobError("MF105", what, where="--die", cure="Name a die without gutters")
    lines = sorted(camera.wavelengths_nm)
    step = point_step_um(camera)
    samples = 2 * int(camera.window_um / step / 2)
    return Workload(panel, camera.stop.diameter_um, lines[len(lines) // 2], camera.focal_um, step, samples)


def race(workload: Workload, rounds: int = 9, progress: Progress = silent) -> list[Timing]:
    """Time every contestant in turn, round after round, on one thread: from nothing, and again with what is kept."""
    pupil = workload.pupil()
    contestants = [*_ours(workload, pupil), *_others(workload, pupil)]
    cold: list[list[float]] = [[] for _ in contestants]
    warm: list[list[float]] = [[] for _ in contestants]
    results: list[NDArray[Any]] = []
    with threadpool_limits(1):
        for number in range(rounds):
            progress("bench", number, rounds)
            results = []
            for contestant, firsts, seconds in zip(contestants, cold, warm, strict=True):
                start = time.process_time()
                function = contestant.set_up()
                function()
                between = time.process_time()
                results.append(function())
                firsts.append(1e3 * (between - start))
                seconds.append(1e3 * (time.process_time() - between))
        progress("bench", rounds, rounds)
        exact = {offset: _exact(workload, pupil, offset) for offset in {c.offset for c in contestants}}
    return [
        _judged(contestant, firsts, seconds, result, exact[contestant.offset], workload)
        for contestant, firsts, seconds, result in zip(contestants, cold, warm, results, strict=True)
    ]


def absent() -> dict[str, str]:
    """Peers that cannot race here, each with the reason."""
    return {peer.name: reason for peer in PEERS if (reason := peer.missing()) is not None}


def _ours(workload: Workload, pupil: Pupil) -> Iterator[_Contestant]:
    """Our paths take a quadrant; with no sample on the axis it mirrors to an even number of samples."""
    quadrant = workload.frequencies(0.5)[workload.samples // 2 :]
    taken = admissible(FieldTask.of(pupil, quadrant, quadrant))
    for path in (path for path in PATHS if path in taken):
        for precision in path.precisions:
            compute = partial(path.intensity, pupil, quadrant, quadrant, precision)
            set_up = partial(partial, compute)
            yield _Contestant(f"maskfab {path.name}", precision, "ours", 0.5, set_up, path is taken[0])


def _others(workload: Workload, pupil: Pupil) -> Iterator[_Contestant]:
    dot_um = workload.panel.dot_nm / NM_PER_UM
    size = published_size(workload.wavelength_nm, workload.focal_um, dot_um, workload.step_um)
    if size >= max(pupil.whole.shape[0], workload.samples):  # samples so wide that the dots do not fit have no recipe
        recipe = partial(partial, partial(published_intensity, pupil.whole, size, workload.samples))
        yield _Contestant("published recipe, padded FFT", "double", "published", 0.0, recipe)
    task = PsfTask(
        pupil.whole, dot_um, workload.focal_um, workload.wavelength_nm * UM_PER_NM, workload.step_um, workload.samples
    )
    for peer in PEERS:
        if peer.missing() is None:
            yield _Contestant(peer.name, peer.precision, "peer", 0.0, partial(peer.function, task))


def _exact(workload: Workload, pupil: Pupil, offset: float) -> Floats:
    u = workload.frequencies(offset)
    intensity: Floats = np.abs(direct_field(pupil, u, u)) ** 2
    unit_sum: Floats = intensity / intensity.sum()
    return unit_sum


def _judged(
    contestant: _Contestant,
    cold: Sequence[float],
    warm: Sequence[float],
    values: NDArray[Any],
    exact: Floats,
    workload: Workload,
) -> Timing:
    def error(intensity: NDArray[Any]) -> float:
        unit_sum = intensity / intensity.sum(dtype=np.float64)
        return float(np.linalg.norm(unit_sum - exact) / np.linalg.norm(exact))

    given = error(values)
    factor = np.sinc(workload.frequencies(0.0) * workload.panel.dot_nm / NM_PER_UM) ** 2
    with_dots = given if contestant.kind == "ours" else error(values * factor * factor[:, None])
    low, _, high = quantiles(warm, n=4)
    return Timing(
        contestant.name,
        contestant.precision,
        contestant.kind,
        median(warm),
        (low, high),
        median(cold),
        given,
        with_dots,
        contestant.chosen,
    )


_COLOURS = {"ours": "#0072b2", "peer": "#d55e00", "published": "#000000"}
_MARKS = "osDv^P*"
_LARGE, _SMALL = 7.0, 4.0


def race_document(
    timings: Sequence[Timing], bound_ms: Mapping[str, float], absent: Mapping[str, str]
) -> dict[str, Any]:
    """Everything that was measured, with the versions of what was raced, and who could not take part and why."""
    return {
        "versions": provenance.versions(),
        "gemm_bound_ms": dict(bound_ms),
        "absent": dict(absent),
        "timings": [asdict(timing) for timing in timings],
    }


def race_table(timings: Iterable[Timing], bound_ms: Mapping[str, float], absent: Mapping[str, str]) -> list[str]:
    """One line a contestant, fastest first, then those who could not take part."""
    ordered = sorted(timings, key=lambda timing: timing.milliseconds)
    width = max(len(timing.name) for timing in ordered)
    times = f"{'cold ms':>8}  {'warm ms':>8}  {'quartiles':>17}"
    lines = [f"{'method':{width}}  precision  {times}  {'error as given':>14}  {'with dot factor':>15}"]
    for t in ordered:
        spread = f"{t.spread[0]:.2f} to {t.spread[1]:.2f}"
        lines.append(
            f"{t.name:{width}}  {t.precision:9}  {t.cold_milliseconds:8.2f}  {t.milliseconds:8.2f}  {spread:>17}  "
            f"{t.error:14.1e}  {t.error_with_dots:15.1e}{'  chosen' if t.chosen else ''}"
        )
    bounds = ", ".join(f"{value:.2f} ms {precision}" for precision, value in bound_ms.items())
    lines += [f"not compared: {name}, {reason}" for name, reason in absent.items()]
    return [
        *lines,
        "processor time on one thread; cold: a first call and what it sets up, warm: the next",
        f"products alone of the parity path, the bound of its method without interpolation: {bounds}",
    ]


def race_figure(races: Mapping[str, Race]) -> bytes:
    """Error against time, one plot for each race, as PNG; down and to the left is better.

    A peer stands twice: as given, hollow, and with the dot's factor applied afterwards, filled. Single precision is
    drawn small. The path that maskfab takes has a ring; the time of its products alone is a line.
    """
    columns = min(3, len(races))
    rows = -(-len(races) // columns)
    with rc_context({"font.size": 9}):
        figure = Figure(figsize=(max(9.0, 4.3 * columns), 1.2 + 3.6 * rows), dpi=120, layout="constrained")
        FigureCanvasAgg(figure)
        plots = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        marks: dict[tuple[str, str], str] = {}
        for axes, (title, race) in zip(plots, races.items(), strict=False):
            _draw_race(axes, race, marks)
            axes.set_title(title, fontsize=9)
        for axes in plots[len(races) :]:
            axes.set_axis_off()
        for axes in plots[-columns:]:
            axes.set_xlabel("processor time, warm (ms, median, one thread)")
        for axes in plots[::columns]:
            axes.set_ylabel("relative L2 error of the PSF")
        handles = [
            Line2D([], [], linestyle="", marker=mark, color=_COLOURS[k], label=n) for (k, n), mark in marks.items()
        ]
        hollow: dict[str, Any] = {"linestyle": "", "marker": "o", "markerfacecolor": "none"}
        handles += [
            Line2D([], [], label="chosen by maskfab", markersize=13, color=_COLOURS["ours"], **hollow),
            Line2D([], [], linestyle="--", color="grey", label="matrix products alone, double"),
            Line2D([], [], linestyle="", marker="o", markersize=_SMALL, color="grey", label="small: single precision"),
            Line2D([], [], label="hollow: without dot's size", color="grey", **hollow),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8)
        stream = io.BytesIO()
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def _draw_race(axes: Axes, race: Race, marks: dict[tuple[str, str], str]) -> None:
    """One race; ``marks`` gets each contestant's, by kind and name, so that all plots share them."""
    for t in race.timings:
        mark = marks.setdefault((t.kind, t.name), _MARKS[sum(kind == t.kind for kind, _ in marks)])
        style: dict[str, Any] = {"color": _COLOURS[t.kind], "markersize": _LARGE if t.precision == "double" else _SMALL}
        if t.error != t.error_with_dots:
            axes.plot(t.milliseconds, t.error, mark, markerfacecolor="none", **style)
            axes.plot([t.milliseconds] * 2, [t.error, t.error_with_dots], ":", color=style["color"], linewidth=0.8)
        axes.plot(t.milliseconds, t.error_with_dots, mark, **style)
        if t.chosen and t.precision == "double":
            axes.plot(t.milliseconds, t.error_with_dots, "o", **style | {"markersize": 13, "markerfacecolor": "none"})
    axes.axvline(race.bound_ms["double"], linestyle="--", linewidth=0.8, color="grey")
    axes.set(xscale="log", yscale="log")
    axes.grid(alpha=0.3)
    axes.margins(x=0.1, y=0.08)


def case_table(outcomes: Iterable[CaseResult]) -> Iterable[str]:
    """One line a hard case, as each is done."""
    yield f"{'case':38}  {'error':>8}  {'limit':>7}  verdict  {'s':>6}  method"
    for o in outcomes:
        verdict = "pass" if o.passed else "FAIL"
        yield f"{o.case.name:38}  {o.error:8.1e}  {o.case.limit:7.0e}  {verdict:7}  {o.seconds:6.2f}  {o.case.method}"


def case_document(outcomes: Sequence[CaseResult]) -> dict[str, Any]:
    """The outcomes of the cases as plain data."""
    rows = [
        {
            "name": o.case.name,
            "method": o.case.method,
            "error": o.error,
            "limit": o.case.limit,
            "passed": o.passed,
            "seconds": round(o.seconds, 3),
        }
        for o in outcomes
    ]
    return {"verdict": "pass" if all(o.passed for o in outcomes) else "fail", "cases": rows}


def write_accuracy(target: Path, document: dict[str, Any], figure: bytes) -> list[Path]:
    """Put a race's figure and numbers into a new directory."""
    with staged(check_target(target, force=False)) as folder:
        (folder / "bench.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        (folder / "bench.png").write_bytes(figure)
    return sorted(target.iterdir())
