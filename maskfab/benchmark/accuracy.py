"""Speed against error: every way to the PSF of one panel, timed side by side and held against an exact answer.

All contestants see the same dots behind a stop that takes whole dots by their centres, and give as many samples of the
same window. The exact answer is the complex matrix transform of whole dots in float64, taken at each contestant's own
sample positions; tests hold it to 1e-14 of a direct sum. Peers treat a dot as a point, so each is judged twice: as
given, and multiplied by the dot's factor sinc(u dot) sinc(v dot) afterwards.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median, quantiles
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from maskfab.base.arrays import Floats
from maskfab.benchmark.other_libraries import PEERS, PsfTask
from maskfab.benchmark.published import published_intensity, published_size
from maskfab.errors import JobError
from maskfab.model import Camera, Opening, Panel, Stop, Tiling
from maskfab.optics.field.methods import PATHS
from maskfab.optics.field.parity import direct_field
from maskfab.optics.image.psf import point_step_um
from maskfab.optics.pupil.aperture import panel_aperture
from maskfab.optics.pupil.pupil import Pupil
from maskfab.plate.tiling import orientations
from maskfab.progress import Progress, silent
from maskfab.units import NM_PER_UM, UM_PER_NM


@dataclass(frozen=True)
class Workload:
    """One PSF to compute: a panel of square dots, a round stop, and a window of samples.

    Attributes:
        panel: without gutters, wide enough for the stop.
        diameter_um: of the stop; a dot counts as open if its centre lies inside.
        wavelength_nm, focal_um: of the camera.
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
        name, precision: who.
        kind: ours, peer, or published.
        milliseconds: processor time of a call that finds what the last one kept; median over the rounds.
        spread: lower and upper quartile of it, milliseconds.
        cold_milliseconds: of a first call, with all that it sets up; median likewise.
        error: relative L2 of the unit-sum PSF, as given.
        error_with_dots: the same after the dot's factor; equal to ``error`` where it is part of the method.
    """

    name: str
    precision: str
    kind: str
    milliseconds: float
    spread: tuple[float, float]
    cold_milliseconds: float
    error: float
    error_with_dots: float


@dataclass(frozen=True)
class _Contestant:
    name: str
    precision: str
    kind: str
    offset: float
    set_up: Callable[[], Callable[[], NDArray[Any]]]
    """Makes the function to be timed; its first call is cold."""


def standard_workload() -> Workload:
    """A slit of 5 x 18 in 21 x 21 dots of 8 um, tiled at random over a stop of 4 mm; 512 x 512 samples of 0.5 um."""
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[2:20, 8:13] = True
    chosen = orientations(Tiling.RANDOM, 24, 24, 0)
    panel = Panel(Opening("slit", mask, 8000), 8000, 0, chosen, Tiling.RANDOM, 0)
    return Workload(panel, 4000.0, 530.0, 10_000.0, 0.5, 512)


def gemm_bound_ms(workload: Workload, rounds: int = 15) -> dict[str, float]:
    """Median time of the parity path's products alone, eight of them on operands of their sizes, by precision."""
    half = sum(len(edges) - 1 for edges in (workload.pupil().x.edges_um(), workload.pupil().y.edges_um())) // 4
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
        raise JobError(
            "MF105", "peers cannot take a panel with gutters", where="--die", cure="Name a die without gutters"
        )
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
    for path in PATHS:
        if not path.accepts(pupil, quadrant, quadrant):
            continue
        for precision in path.precisions:
            compute = partial(path.intensity, pupil, quadrant, quadrant, precision)
            yield _Contestant(f"maskfab {path.name}", precision, "ours", 0.5, partial(_nothing_to_set_up, compute))


def _nothing_to_set_up(function: Callable[[], NDArray[Any]]) -> Callable[[], NDArray[Any]]:
    return function


def _others(workload: Workload, pupil: Pupil) -> Iterator[_Contestant]:
    dot_um = workload.panel.dot_nm / NM_PER_UM
    size = published_size(workload.wavelength_nm, workload.focal_um, dot_um, workload.step_um)
    recipe = partial(published_intensity, pupil.whole, size, workload.samples)
    yield _Contestant("published recipe, padded FFT", "double", "published", 0.0, partial(_nothing_to_set_up, recipe))
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
    found: NDArray[Any],
    exact: Floats,
    workload: Workload,
) -> Timing:
    def error(intensity: NDArray[Any]) -> float:
        unit_sum = intensity / intensity.sum(dtype=np.float64)
        return float(np.linalg.norm(unit_sum - exact) / np.linalg.norm(exact))

    given = error(found)
    factor = np.sinc(workload.frequencies(0.0) * workload.panel.dot_nm / NM_PER_UM) ** 2
    with_dots = given if contestant.kind == "ours" else error(found * factor * factor[:, None])
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
    )
