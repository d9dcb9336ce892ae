"""A job's [design] section as settings of the optimiser, and its run."""

from __future__ import annotations

from maskfab.design.relax import RelaxSettings, RelaxStep, optimise
from maskfab.errors import JobError
from maskfab.layout.openings import dot_of_pitch
from maskfab.model import Opening, Tiling
from maskfab.progress import Progress, silent
from maskfab.spec import JobSpec

# Hexagonal sheets are no cells that repeat on a square lattice, which is what the loss is built on; a map is made for
# an opening that is there.
_DESIGNED = tuple(tiling for tiling in Tiling if tiling not in {Tiling.HEXAGONAL, Tiling.MAP})


def settings(spec: JobSpec, *, where: str, command: str) -> RelaxSettings:
    """What the optimiser is to do.

    Args:
        spec: a validated job.
        where: the job file, for errors.
        command: how a user repeats the run; it goes into the opening's provenance.

    Raises:
        JobError: MF105 if the job has no [design] section; MF106 or MF107 if its pitch is no whole number of dots on
            the grid; MF111 if its tiling needs a seed and has none.
    """
    design, camera = spec.design, spec.camera.camera()
    if design is None:
        raise JobError("MF105", "the job has no [design] section", where=where, cure="Add [design]")
    if design.tiling not in _DESIGNED:
        raise JobError(
            "MF122",
            f"no opening can be designed for the {design.tiling} tiling",
            where=f"{where}: design.tiling",
            cure=f"Use {', '.join(_DESIGNED)}",
        )
    if design.tiling.seeded and design.tiling_seed is None:
        raise JobError(
            "MF111",
            f"the {design.tiling} tiling has no seed",
            where=f"{where}: design.tiling_seed",
            cure="Add tiling_seed = 1",
        )
    return RelaxSettings(
        name=design.name,
        dots=design.dots,
        dot_nm=dot_of_pitch(f"{design.pitch:.15g} um", design.dots, where=f"{where}: design.pitch"),
        open_ratio=design.open_ratio,
        tiling=design.tiling,
        tiling_seed=None if not design.tiling.seeded else design.tiling_seed,
        focal_um=camera.focal_um,
        stop=camera.stop,
        wavelengths_nm=camera.wavelengths_nm,
        pixel_um=camera.pixel_um,
        seed=design.seed,
        iterations=design.iterations,
        epsilon=design.epsilon,
        worst_fraction=design.worst_fraction,
        command=command,
    )


def find(wanted: RelaxSettings, progress: Progress = silent) -> Opening:
    """Run the optimiser and tell where it stands."""

    def watch(step: RelaxStep) -> None:
        progress(f"design, best loss {step.best_loss:.4f}", step.iteration + 1, wanted.iterations)

    return optimise(wanted, watch)
