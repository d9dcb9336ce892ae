"""Pairs of photographs to train restorers on, in memory one after the other, or as a folder of files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from maskfab.api.asked import AnyJob, dies_of, laid_out
from maskfab.api.camera import Camera
from maskfab.api.results import Result
from maskfab.base import __version__
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.provenance import sha256_of_file
from maskfab.base.work import one_thread
from maskfab.camera.field_transfer import OverField
from maskfab.camera.imaging import Design, Transfer
from maskfab.camera.pairs import SPLITS, PairDie, Pairs, Plan, Source, Wanted, Window, by_split, light_of
from maskfab.camera.scenes import beyond, picture_files
from maskfab.camera.sensor import Exposure
from maskfab.display.pictures import picture_shape
from maskfab.findings.photographs import Conditions
from maskfab.job.camera import Sensor
from maskfab.job.reference import named
from maskfab.mask.job import Job
from maskfab.runs.pair_files import ARRAYS, notes_of, terms
from maskfab.runs.store import of_installation

_ASSUMED_BITS, _ASSUMED_BLACK, _MOST_BITS = 10, 64, 16
"""Of a sensor that states no converter those of Sony's IMX219, of phones' kind; and as many bits as files hold."""
_ON_AXIS = "over the field the point spread changes, and every crop has that of the axis"


@checked_arguments
@one_thread
def pairs(
    job: AnyJob,
    photos: str | Path,
    *,
    count: int,
    seed: int = 0,
    crop: int = 256,
    bits: int = 8,
    validation: float = 0.1,
    test: float = 0.1,
    split: str | None = None,
    die: str | Sequence[str] | None = None,
    levels: Annotated[Sequence[float] | None, "DB"] = None,
    white: float | None = None,
    camera: Camera | None = None,
) -> Pairs:
    """Pairs of clean and degraded crops of photographs, for torch's ``DataLoader``, made when they are asked for.

    They are those that ``simulate(job, images=photos, pairs=folder)`` writes.

    Examples:
        >>> train = mf.pairs("job.toml", "photographs", count=10_000, split="train")  # doctest: +SKIP
        >>> batches = torch.utils.data.DataLoader(train, 16, sampler=train.order(seed=1))  # doctest: +SKIP

    Args:
        job: job file (.toml), loaded job, plate or panels.
        photos: folder of photographs.
        count: of pairs in all splits.
        seed: of crops, dies, light, noise and splits.
        crop: pixels along a side, even.
        bits: of the camera's picture: 8 or 10.
        validation, test: shares of photographs of which no pair is for training.
        split: train, validation or test; by default all pairs, in this order.
        die: die of the job; by default all that can be photographed.
        levels: signal-to-noise ratio of white behind the published display, dB; by default the job's, or 24, 32 and 40.
        white: light that is white in photographs that hold light.
        camera: of a plate; by default its own. It has three wavelengths.

    Raises:
        JobError: MF104 for a count, crop or share that cannot be; MF121 for a photograph that is too small, or there
            twice; MF140 for a sensor of more than 16 bits; as :func:`maskfab.api.photographs.simulate`.
        SourceError: MF301 without photographs in the folder; MF303, MF308 for one that is none.
    """
    wanted = Wanted(count, seed, crop, bits, validation, test, white)
    conditions = partial(Conditions.of, protocol="camera", levels=levels, brackets=())
    loaded, panels = laid_out(job, Job.panels, conditions, camera=camera)
    asked = conditions(loaded)
    sensor, assumed = _reading(asked.protocol.sensor)
    asked = replace(asked, protocol=replace(asked.protocol, sensor=sensor))
    if loaded.spec.exposure is not None and loaded.spec.exposure.brackets:
        asked = replace(asked, unused=(*asked.unused, named("exposure.brackets")))
    chosen = {name: panels[name] for name in dies_of(die, panels)}
    paths, skipped = picture_files(Path(photos).resolve())
    order, splits = by_split([path.name for path in paths], wanted)
    every = [Source(path, sha256_of_file(path), picture_shape(path)) for path in paths]
    _check_apart(every)
    for path in paths:
        # Files of light alone can be of no use for what is in them.
        if path.suffix.lower() in (".exr", ".hdr"):
            light_of(path, wanted.white)
    sources = tuple(every[place] for place in order)
    window = Window.of(wanted.crop, sources, -(-wanted.count // len(sources)))
    transfers = dict[str, Transfer]()

    def taken(design: Design, told: tuple[str, ...]) -> PairDie:
        if isinstance(design, OverField):
            design, told = design.transfer, (*told, _ON_AXIS)
        transfers[design.name] = design.on(window.margin.shape)
        electrons = tuple(Exposure.at(level, sensor).behind(design.transmission) for level in asked.levels)
        return PairDie(design.name, design.transmission, electrons, beyond(design, window.margin), told)

    dies, refused = asked.designs(loaded, chosen, taken, named=bool(die))
    plan = Plan(wanted, sources, splits, tuple(dies), asked.levels, sensor, window)
    reasons = {name: f"{refusal.code} {refusal.what}" for name, refusal in refused.items()}
    about = {
        "schema_version": 1,
        "maskfab_version": __version__,
        "installation": of_installation(),
        "job_hash": loaded.digest,
        **_sheet(plan),
        **asked.to_dict(),
        "conditions": asked.lines,
        "assumed": (*assumed, *loaded.assumptions(list(chosen))),
        "pixel_um": loaded.camera.pixel_um,
        "refused": reasons,
        "skipped": skipped,
    }
    made = Pairs(plan, transfers, range(count), about)
    return made if split is None else made.of_split(split)


def _reading(sensor: Sensor) -> tuple[Sensor, tuple[str, ...]]:
    """A sensor that reads a mosaic, and sentences on what was assumed of it."""
    assumed = []
    if sensor.mosaic == "none":
        sensor = replace(sensor, mosaic="rggb")
        assumed.append('assumed: mosaic = "rggb", for [sensor] states none')
    if sensor.bits is None:
        sensor = replace(sensor, bits=_ASSUMED_BITS, black_level=_ASSUMED_BLACK)
        assumed.append(f"assumed: bits = {_ASSUMED_BITS} and black_level = {_ASSUMED_BLACK}, for [sensor] states none")
    assert sensor.bits is not None
    if sensor.bits > _MOST_BITS:
        what = f"pairs have codes of {_MOST_BITS} bits, and the sensor's converter has {sensor.bits}"
        raise JobError("MF140", what, where="sensor.bits", cure=f"Give {_MOST_BITS} or fewer")
    return sensor, tuple(assumed)


def _check_apart(sources: Sequence[Source]) -> None:
    seen: dict[str, Source] = {}
    for source in sources:
        if (other := seen.setdefault(source.sha256, source)) is not source:
            what = f"{other.path.name} and {source.path.name} are one photograph, which could be trained on and tested"
            raise JobError("MF121", what, where=str(source.path), cure="Remove one of them")


def _sheet(plan: Plan) -> dict[str, Any]:
    """Part of a data sheet that follows from a plan."""
    wanted, window = plan.wanted, plan.window
    coded = f"uint{8 if wanted.bits <= 8 else 16} of {wanted.bits} bits"
    types = {"clean": "float16", "blurred": "float16", "raw": f"uint16 of {plan.sensor.bits} bits", "coded": coded}
    of_each = [split for split, held in zip(SPLITS, plan.splits, strict=True) for _ in range(held)]
    files = [
        {"name": source.path.name, "sha256": source.sha256, "shape": source.shape, "split": split}
        for source, split in zip(plan.sources, of_each, strict=True)
    ]
    return {
        "count": wanted.count,
        "seed": wanted.seed,
        "crop_pixels": wanted.crop,
        "window_pixels": window.margin.shape,
        "surroundings_pixels": window.margin.width,
        "pairs_of_one_window": window.groups,
        "pairs_of_one_photograph": -(-wanted.count // len(plan.sources)),
        "crops_side_by_side": plan.side_by_side,
        "arrays": {name: {"dtype": types[name], "holds": text} for name, text in ARRAYS.items()},
        "rounding": "half precision errs by 2^-11 of a value at most, or 3e-8 of white; light is blurred as it is in "
        "clean, in single precision, and rounded again",
        "noise": "Poisson's counts of electrons and normal read noise, cut at a full well, rounded to codes; one draw "
        "for each pair",
        "dies": [asdict(die) for die in plan.dies],
        "splits": {
            split: {"photographs": held, "pairs": len(plan.of_split(split))}
            for split, held in zip(SPLITS, plan.splits, strict=True)
        },
        "photographs": {
            "terms": [file.name for file in terms(plan.sources[0].path.parent)],
            "white": wanted.white,
            "files": files,
        },
    }


@dataclass(frozen=True, eq=False, repr=False)
class PairSet(Result):
    """A folder of pairs.

    Attributes:
        made: pairs that were not there before.
        datasheet: what datasheet.json holds.
    """

    path: Path
    made: int
    datasheet: Mapping[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """Its data sheet, and how many pairs were made."""
        return {"path": str(self.path), "made": self.made, **self.datasheet}

    def __str__(self) -> str:
        return f"{notes_of(self.datasheet)}\n{self.made} pairs made\n{self.path}"
