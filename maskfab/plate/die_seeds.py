"""Die seeds: those of the dies that an opening's display fits, as its map or the opening itself names them.

Beyond a map, and in a random tiling, a seed draws how cells are turned, and wires laid across a die may find no way in
what it draws. A file names the seeds that were tried in its provenance: ``die_seeds_fit = "1 2"``, and
``die_seeds_unfit = "0"``. A die that states no seed takes the first that fits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

_FIT, _UNFIT = "die_seeds_fit", "die_seeds_unfit"


@dataclass(frozen=True)
class DieSeeds:
    """Seeds that were tried of a die.

    Attributes:
        fit: of dies that the display fits, ascending.
        unfit: of dies that it does not.
    """

    fit: tuple[int, ...]
    unfit: tuple[int, ...] = ()

    @classmethod
    def of(cls, facts: Mapping[str, object]) -> DieSeeds | None:
        """Seeds by the provenance of a map or an opening; None where it names none that fits."""
        fit, unfit = (_seeds(facts.get(key)) for key in (_FIT, _UNFIT))
        return cls(fit, unfit) if fit else None

    @property
    def facts(self) -> dict[str, str]:
        """Provenance that names them."""
        named = {_FIT: self.fit, _UNFIT: self.unfit}
        return {key: " ".join(map(str, sorted(seeds))) for key, seeds in named.items() if seeds}

    def against(self, seed: int, name: str) -> str | None:
        """Sentence on a die of another seed; None for one that fits, and where every seed that was tried does.

        Args:
            seed: of the die.
            name: of the map, or of the opening, that names the seeds.
        """
        if seed in self.fit or not self.unfit:
            return None
        tried = "does not fit" if seed in self.unfit else "was not tried on"
        return (
            f"the display {tried} a die of seed {seed}: by {name} it fits with {_listed(self.fit)}, and not with "
            f"{_listed(self.unfit)}"
        )


def _seeds(value: object) -> tuple[int, ...]:
    """Whole numbers of a text; none of anything else, since provenance may hold any text."""
    words = str(value).split() if value is not None else []
    return tuple(sorted({int(word) for word in words})) if all(word.isdecimal() for word in words) else ()


def _listed(seeds: Iterable[int]) -> str:
    *first, last = map(str, seeds)
    return f"{', '.join(first)} and {last}" if first else last
