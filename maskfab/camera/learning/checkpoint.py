"""The file that training leaves: the network, what it was trained behind, and all that training needs to go on."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.camera.learning.network import COLOURS, Network
from maskfab.camera.learning.training import MEAN, Arrays, Course, named
from maskfab.camera.learning.view import PLANES, View
from maskfab.camera.restorers.learned import Learned
from maskfab.camera.restorers.restorer import Blur, Transfer
from maskfab.errors import JobError, SourceError
from maskfab.files.checkpoint import RUN, read_state, save_state

_KIND = "maskfab learned restorer 1"
_PROBED = (32, 32)
_ALIKE = 1e-3
"""Most that the transfer of the same die differs, by rounding."""
_WIDEST, _DEEPEST = 512, 8
_USE = "Train one for this job with maskfab learn, or give the one that was"
_GO_ON = "Give the settings it was trained with, add --force to train anew, or choose another --out"
ROW = ("minutes", "step", "loss", "gain", "gain_over_filter")
"""Numbers of a history: time and steps from the beginning, loss, gains over both pictures that are shown, dB."""


@dataclass(frozen=True, eq=False)
class Trade:
    """The die, camera and light that a network is trained behind.

    Attributes:
        job: its file.
        digest: SHA-256 of the resolved job.
        die: by name.
        camera: in one line.
        sensor: in one line.
        light: of scenes, linear or code values taken for it.
        levels: of light, dB.
        images: names of the photographs, none where scenes were drawn alone.
        transfer: H of the die at some frequencies.
    """

    job: str
    digest: str
    die: str
    camera: str
    sensor: str
    light: str
    levels: tuple[float, ...]
    images: tuple[str, ...]
    transfer: Transfer

    def require(self, other: Trade, where: str, cure: str = _USE) -> None:
        """Refuse a checkpoint for another die, camera, sensor or light; some of its levels may be asked for.

        Args:
            other: what it is wanted for.
            where: the file.
            cure: told with a refusal.

        Raises:
            JobError: MF148.
        """
        for what in ("die", "camera", "sensor", "light"):
            own, wanted = getattr(self, what), getattr(other, what)
            if own != wanted:
                raise another(f"{what} {own}", wanted, where, cure)
        if not set(other.levels) <= set(self.levels):
            raise another(f"light of {_decibels(self.levels)}", _decibels(other.levels), where, cure)
        if float(abs(self.transfer - other.transfer).max()) > _ALIKE:
            raise another(f"a die {self.die} of other openings, layout or scene", f"that of {other.job}", where, cure)


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A network and where its training stands.

    Attributes:
        trade: what it is trained behind.
        course: of the training.
        view: of records.
        seconds: that were trained.
        history: rows of :data:`ROW`, one each time that it was judged by scenes that are not taught.
        state: of the training.
    """

    trade: Trade
    course: Course
    view: View
    seconds: float
    history: Sequence[Mapping[str, float]]
    state: Arrays

    def require(self, trade: Trade, seed: int, where: str) -> None:
        """Refuse to train it further for anything else, or with other levels, photographs or seed.

        Raises:
            JobError: MF148.
        """
        own = self.trade
        own.require(trade, where, _GO_ON)
        if set(own.levels) != set(trade.levels):
            raise another(f"light of {_decibels(own.levels)}", _decibels(trade.levels), where, _GO_ON)
        if own.images != trade.images:
            raise another(f"{len(own.images)} photographs", f"{len(trade.images)} others", where, _GO_ON)
        if self.course.seed != seed:
            raise another(f"seed {self.course.seed}", f"seed {seed}", where, _GO_ON)

    def restorer(self) -> Learned:
        """The network as a restorer."""
        network = Network(PLANES, self.course.widths)
        network.load_state_dict(named(MEAN, self.state))
        return Learned(network.eval(), self.view)

    def about(self) -> dict[str, Any]:
        """All but weights and transfer, as data."""
        told = asdict(self.trade)
        del told["transfer"]
        return {
            "maskfab": __version__,
            **told,
            "course": asdict(self.course),
            "strengths": sorted(self.view.strengths.items()),
            "seconds": self.seconds,
            "history": [dict(each) for each in self.history],
        }

    def write(self, path: Path) -> None:
        """Keep it in a file, aside first and renamed.

        Raises:
            OutputError: MF401 if it cannot be written.
        """
        about = np.array(json.dumps(self.about()))
        save_state(path, _KIND, {"about": about, "transfer": self.trade.transfer, **self.state})

    @classmethod
    def read(cls, path: Path) -> Checkpoint:
        """Of a file; no code in it is run.

        Raises:
            SourceError: MF301 without a file, MF303 for a damaged one, MF304 for one of another kind.
        """
        if not os.path.isfile(path):
            raise SourceError("MF301", f"there is no file {path}", cure="Train one with maskfab learn")
        found = read_state(path)
        if str(found.pop(RUN, "")) != _KIND:
            raise SourceError(
                "MF304", "the file is no checkpoint of maskfab learn", where=str(path), cure="Train one with it"
            )
        try:
            read = cls._of(found)
            read.restorer()
        except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
            raise SourceError(
                "MF303", "the checkpoint is damaged", where=str(path), cure="Delete it and train again"
            ) from error
        return read

    @classmethod
    def _of(cls, found: dict[str, NDArray[np.generic]]) -> Checkpoint:
        about = json.loads(str(found.pop("about")))
        texts = {key: str(about[key]) for key in ("job", "digest", "die", "camera", "sensor", "light")}
        levels, images = tuple(map(float, about["levels"])), tuple(map(str, about["images"]))
        trade = Trade(**texts, levels=levels, images=images, transfer=np.asarray(found["transfer"]))
        settings = about["course"]
        course = Course(**(settings | {key: tuple(settings[key]) for key in ("widths", "patch")}))
        view = View({float(electrons): float(epsilon) for electrons, epsilon in about["strengths"]})
        history = tuple({key: float(row[key]) for key in ROW} for row in about["history"])
        read = cls(trade, course, view, float(about["seconds"]), history, found)
        read._check()
        del found["transfer"]
        return read

    def _check(self) -> None:
        """Raise a ValueError for what no training leaves."""
        widths, strengths = self.course.widths, [*self.view.strengths, *self.view.strengths.values()]
        finite = all(np.isfinite(array).all() for array in self.state.values() if array.dtype.kind in "fc")
        small = 0 < len(widths) <= _DEEPEST and max(widths) <= _WIDEST
        rows, columns = _PROBED
        probed = self.trade.transfer.shape == (COLOURS, rows, columns // 2 + 1)
        if not (finite and small and probed and strengths and min(strengths) > 0):
            raise ValueError(self.about())


def probe(blur: Blur) -> Transfer:
    """H at the frequencies by which dies are told apart."""
    return blur.on(_PROBED)


def another(own: str, wanted: str, where: str, cure: str = _USE) -> JobError:
    """The refusal of a checkpoint for something else."""
    return JobError(
        "MF148",
        f"the checkpoint was trained for {own}; asked for is {wanted}",
        where=where,
        cure=cure,
    )


def _decibels(levels: Sequence[float]) -> str:
    return ", ".join(f"{level:g} dB" for level in levels)
