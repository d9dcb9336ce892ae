"""Other libraries' ways to the same PSF, for those that are installed (``pip install 'maskfab[peers]'``).

Each takes the dots as points, as its users would give them, and returns intensity at multiples of the step from
-samples/2. None is imported before it is asked for.
"""

from __future__ import annotations

import importlib
import importlib.util
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.units import UM_PER_MM


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
