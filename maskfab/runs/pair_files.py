"""A folder of pairs to train restorers on: arrays in shards, PSFs, a table of all pairs and a data sheet.

The data sheet is written first and tells one set from every other; shards appear whole, so that a set that was cut off
goes on where it stood, to the same bytes. The table of pairs is written last: where it is, the set is complete.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy

from maskfab.base import files
from maskfab.base.arrays import write_arrays
from maskfab.base.errors import OutputError
from maskfab.base.folders import Place, staged, write_bytes, write_text
from maskfab.base.processes import Call
from maskfab.base.work import Progress
from maskfab.base.workers import Workers
from maskfab.camera.blur import HOLDS
from maskfab.camera.pairs import SPLITS, Pairs, Plan
from maskfab.mask.formats.exr import write_channels

_SHARD = 256
"""Pairs in each shard but the last one of a split."""
_HELD = 60
"""Bytes that are held for each pixel of the largest photograph or window."""
_DATASHEET, _NOTES, _TABLE, _PSFS = "datasheet.json", "README.md", "index.csv", "psf"
ARRAYS: Mapping[str, str] = MappingProxyType({
    "clean": "linear light of the photograph, white is 1; [pairs, 3, rows, columns], red, green, blue",
    "blurred": "that light as it falls on the sensor behind the die, without noise; as clean",
    "raw": "codes of the mosaic with the black level, red in the top left pixel; [pairs, rows, columns]",
    "coded": "the camera's picture: missing colours interpolated (Malvar, He, Cutler 2004; mirrored at the edges), "
             "white at the last code, sRGB curve; as clean",
})  # fmt: skip
_TERMS = ("license", "licence", "copying", "copyright", "notice", "sources", "credits", "attribution")


def terms(photographs: Path) -> list[Path]:
    """Files beside photographs that say whose they are, by their names, such as LICENSE or sources.csv."""
    return [file for file in sorted(photographs.iterdir()) if file.stem.lower() in _TERMS and file.is_file()]


def write_pairs(pairs: Pairs, folder: Path, crew: Workers, progress: Progress) -> int:
    """Write all that is not there yet; how many pairs were made.

    Raises:
        OutputError: MF401 if the folder cannot be written; MF402 if it holds anything else, or another set.
    """
    # Other processes may stand elsewhere.
    folder, plan = folder.resolve(), pairs.plan
    sheet = json.dumps(pairs.datasheet, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    _check(folder, json.loads(sheet))
    shards = list(_shards(plan))
    missing = [shard for shard in shards if not _place(folder, shard).is_dir()]
    made = [len(numbers) for _, _, numbers in missing]
    with files.writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / _DATASHEET, sheet)
        write_text(folder / _NOTES, notes_of(pairs.datasheet))
        for name in (_PSFS, *SPLITS):
            (folder / name).mkdir(exist_ok=True)
        for file in terms(plan.sources[0].path.parent):
            write_bytes(folder / f"photographs-{file.name}", file.read_bytes())
        _write_psfs(pairs, folder / _PSFS)

        def tell(done: int) -> None:
            progress("pairs", sum(made[:done]), sum(made))

        tell(0)
        held = _HELD * max(math.prod(shape) for shape in (plan.window.margin.shape, *(s.shape for s in plan.sources)))
        calls = [Call(write_shard, partial(tuple, (plan, folder, shard)), bytes=held) for shard in missing]
        with crew.executor(len(missing)) as executor:
            executor.run_all(calls, tell)
        rows = [
            {"split": split, "shard": f"{shard:05d}", "place": place, **plan.row(plan.drawn(number))}
            for split, shard, numbers in shards
            for place, number in enumerate(numbers)
        ]
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([rows[0], *(row.values() for row in rows)])
        write_text(folder / _TABLE, text.getvalue())
    return sum(made)


def _check(folder: Path, datasheet: dict[str, Any]) -> None:
    """Refuse a folder that holds anything but the set of a data sheet, or a part of it; MF401, MF402."""
    with files.writing(folder):
        shown = [path for path in folder.iterdir() if path.name[0] != "."] if folder.exists() else []
    try:
        before = json.loads((folder / _DATASHEET).read_text("utf-8")) if shown else datasheet
        other = next((key for key in datasheet if before[key] != datasheet[key]), None)
    except (OSError, ValueError, TypeError, KeyError) as error:
        what = f"the directory {folder} is not empty and holds no pairs"
        raise OutputError("MF402", what, cure="Give --pairs a new or empty folder") from error
    if other is not None:
        what = f"the directory {folder} holds pairs of another set: its {_DATASHEET} has another {other}"
        cure = f"Give --pairs a new folder, or the settings that {_DATASHEET} tells"
        raise OutputError("MF402", what, cure=cure)


_Shard = tuple[str, int, range]
"""Its split, its number there, and the numbers of its pairs."""


def _shards(plan: Plan) -> Iterator[_Shard]:
    for split in SPLITS:
        numbers = plan.of_split(split)
        for start in range(0, len(numbers), _SHARD):
            yield split, start // _SHARD, numbers[start : start + _SHARD]


def _place(folder: Path, shard: _Shard) -> Path:
    return folder / shard[0] / f"{shard[1]:05d}"


def write_shard(plan: Plan, folder: Path, shard: _Shard) -> None:
    """Write a shard, one file for each array, by the transfers that lie in the folder."""
    transfers = {die.name: np.load(folder / _PSFS / f"{die.name}.transfer.npy", mmap_mode="r") for die in plan.dies}
    target = _place(folder, shard)
    with staged(Place(target, target, None)) as aside, ExitStack() as stack:
        opened = {name: stack.enter_context((aside / f"{name}.npy").open("wb")) for name in ARRAYS}
        pairs = Pairs(plan, transfers, shard[2])
        for place in range(len(pairs)):
            pair = pairs[place]
            for name, file in opened.items():
                if place == 0:
                    about = {"descr": pair[name].dtype.str, "fortran_order": False}
                    shape = (len(pairs), *pair[name].shape)
                    np.lib.format.write_array_header_1_0(file, {**about, "shape": shape})
                file.write(pair[name].data)


def _write_psfs(pairs: Pairs, folder: Path) -> None:
    """Write H of each die on windows, and its PSF as far as the surroundings reach."""
    margin, sheet = pairs.plan.window.margin, pairs.datasheet
    near = np.arange(-margin.width, margin.width + 1)
    header = {
        "holds": HOLDS,
        "made": "as designed",
        "sensor_pixel_um": sheet["pixel_um"],
        "job_sha256": sheet["job_hash"],
    }
    for die in pairs.plan.dies:
        transfer, last = pairs.transfers[die.name], folder / f"{die.name}.exr"
        if last.exists():
            continue
        with files.partial(folder / f"{die.name}.transfer.npy") as aside, aside.open("wb") as file:
            np.save(file, transfer)
        psf = scipy.fft.irfft2(transfer, s=margin.shape, workers=1)[:, near[:, None], near].astype(np.float32)
        with files.partial(folder / f"{die.name}.npz") as aside, aside.open("wb") as file:
            write_arrays(file, {"psf": psf, "pixel_um": np.array(sheet["pixel_um"]), "beyond": np.array(die.beyond)})
        with files.partial(last) as aside:
            write_channels(psf.transpose(1, 2, 0), ("R", "G", "B"), aside, {**header, "die": die.name})


def notes_of(sheet: Mapping[str, Any]) -> str:
    """Words of a data sheet for people, with how to read the arrays."""
    (rows, columns), around = sheet["window_pixels"], sheet["surroundings_pixels"]
    listed = [
        *(f"`{name}`: {about['dtype']}; {about['holds']}" for name, about in sheet["arrays"].items()),
        f"`{_PSFS}/DIE.npz`, `DIE.exr`: light of each pixel round a point, float32 [3, rows, columns]; "
        "`DIE.transfer.npy`: H at the frequencies of rfft2 of windows",
        f"rounding: {sheet['rounding']}",
        *(f"{name}: {of['pairs']} pairs of {of['photographs']} photographs" for name, of in sheet["splits"].items()),
        f"each photograph gives up to {sheet['pairs_of_one_photograph']} pairs, at random places; the smallest holds "
        f"{sheet['crops_side_by_side']} crops side by side",
        f"licence and sources of the photographs: {', '.join(sheet['photographs']['terms']) or 'not stated'}",
        *sheet["conditions"],
        *sheet["assumed"],
        f"noise: {sheet['noise']}",
        f"blur: in windows of {columns} x {rows} pixels, in which {sheet['pairs_of_one_window']} pairs of a photograph "
        f"share a die; each crop has {around} pixels of the photograph round it, or more; light from farther is the "
        "window's own, from its other side",
        *(f"{die['name']}: {die['beyond']:.2%} of a point's light falls farther than that" for die in sheet["dies"]),
        *(f"{die['name']}: {sentence}" for die in sheet["dies"] for sentence in die["left_out"]),
        *(f"not photographed: {name}, {reason}" for name, reason in sheet["refused"].items()),
    ]
    return f"""\
# {sheet["count"]} pairs of {sheet["crop_pixels"]} x {sheet["crop_pixels"]} pixels

Made by maskfab {sheet["maskfab_version"]} of job {sheet["job_hash"]}, seed {sheet["seed"]}.
All facts are in `{_DATASHEET}`; `{_TABLE}`, which is written last, has a row for each pair. In numpy:

```python
folders = sorted(pathlib.Path("train").iterdir())
shards = [{{file.stem: np.load(file, mmap_mode="r") for file in folder.iterdir()}} for folder in folders]
number = 10
pair = {{name: array[number % {_SHARD}] for name, array in shards[number // {_SHARD}].items()}}
```

""" + "".join(f"- {line}\n" for line in listed)
