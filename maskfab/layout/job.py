"""A job with everything it refers to: the validated spec and its openings, self-contained and hashed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from maskfab import provenance, spec, units
from maskfab.errors import JobError
from maskfab.layout import openings
from maskfab.layout.plate import compose
from maskfab.model import Camera, Opening, Plate
from maskfab.spec import DieSection, JobSpec


@dataclass(frozen=True, eq=False)
class Job:
    """A resolved job.

    Attributes:
        spec: validated; its dies name openings that ``spec.openings`` holds as text.
        openings: the opening of every die, by the die's name.
        digest: SHA-256 of the resolved spec.
        where: the file it came from.
    """

    spec: JobSpec
    openings: Mapping[str, Opening]
    digest: str
    where: str

    @property
    def seeds(self) -> dict[str, int]:
        return {die.name: die.seed for die in self.spec.die if die.seed is not None}

    @property
    def camera(self) -> Camera:
        return self.spec.camera.camera()

    @property
    def signature(self) -> str:
        return provenance.signature(self.digest, self.seeds)

    def plate(self) -> Plate:
        """The job laid out; see :func:`maskfab.layout.plate.compose` for what is refused."""
        return compose(self.spec, self.openings, self.signature, where=self.where)


def load(path: str | Path) -> Job:
    """Read a job file and every opening it names; nothing is computed yet.

    Raises:
        JobError, OpeningError, SourceError: for the first thing that is wrong.
    """
    path = Path(path)
    stated = spec.read(path)
    found = {die.name: _opening(die, i, stated, path) for i, die in enumerate(stated.die)}
    texts: dict[str, str] = {}
    for i, die in enumerate(stated.die):
        opening = found[die.name]
        text = openings.dumps(opening)
        if texts.setdefault(opening.name, text) != text:
            raise JobError(
                "MF109",
                f"two different openings have the name {opening.name!r}",
                where=f"{path}: die[{i}].opening",
                cure="Rename one of them",
            )
    dies = tuple(
        die.model_copy(update={"opening": found[die.name].name, "opening_layer": None, "opening_cell": None})
        for die in stated.die
    )
    resolved = stated.model_copy(update={"die": dies, "openings": texts})
    return Job(resolved, found, provenance.job_hash(resolved.dump()), str(path))


def _opening(die: DieSection, number: int, stated: JobSpec, path: Path) -> Opening:
    where = f"{path}: die[{number}]"
    if die.opening in stated.openings:
        return openings.parse(stated.openings[die.opening], f"{path}: openings.{die.opening}")
    source = path.parent / die.opening
    if source.suffix.lower() == ".toml":
        return openings.load(source)
    dot_nm = units.to_nm(die.dot, where=f"{where}.dot", name="dot")
    dots = None if die.pitch is None else round((die.pitch - die.gutter) / die.dot)
    return openings.load(source, dots=dots, dot_nm=dot_nm, layer=die.opening_layer, cell=die.opening_cell)
