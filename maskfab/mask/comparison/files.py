"""Written files of a plate read back and compared with it: layouts by polygons, all else as its format says.

plate -> :class:`maskfab.mask.houses.files.PlateFiles` -> written -> :func:`read_mask` -> :func:`compare_mask`

What takes long in processes of its own is read in threads beside the rest, what keeps this one busy in copies of it.
"""

from __future__ import annotations

import os
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias, get_type_hints

from klayout import db

from maskfab.base.effort import Costs, Effort, measured
from maskfab.base.errors import InputError, SourceError
from maskfab.base.model import CIRCUIT, CLEAR, Quantity
from maskfab.base.processes import release_memory
from maskfab.base.work import Progress
from maskfab.mask.comparison.roundtrip import RoundTrip, Sifted, compare_biased, compare_layout, named_chrome
from maskfab.mask.formats.content import find_cell
from maskfab.mask.formats.format import Product
from maskfab.mask.formats.table import layout_format, read_layout
from maskfab.mask.houses.files import PlateFiles
from maskfab.mask.judge.awake import PLANTED, missing, planted
from maskfab.mask.judge.headers import header_row
from maskfab.mask.judge.verdict import judged
from maskfab.mask.layout import count_vertices, layer_info
from maskfab.mask.sandbox import begun, library_errors, seconds_of

_MOST_AHEAD = 3
"""A process takes up to half a gigabyte."""

_LARGE_BYTES = 1_000_000
"""Of a file that takes longer than to copy a process."""

_LIKE = 2
"""A file of more vertices than so many times the design's is not looked through."""

_FEW_VERTICES = 10_000

_HANDED_OVER: Mapping[str, Any] = MappingProxyType(
    {
        name: kind
        for name, kind in get_type_hints(RoundTrip).items()
        if name not in {"path", "layout", "differing", "slivers"}
    }
)
"""Findings of a comparison within limits, and their kinds."""

_Taken: TypeAlias = db.Layout | RoundTrip | tuple[Quantity, ...]
"""A mask file as a layout, to be compared, or compared already; of other files what the comparison has shown."""


@dataclass(frozen=True, eq=False)
class ReadBack:
    """Result of reading files back: of layouts, the first measured further, and every row of the report.

    Only the first layout is kept; those of the others are empty, for a flat one takes a hundred megabytes. ``read`` has
    it by the name of its file, chrome named as such where that has no layers.
    """

    trips: tuple[RoundTrip, ...]
    quantities: tuple[Quantity, ...]
    read: Mapping[str, db.Layout]


def read_back(
    made: PlateFiles,
    folder: Path,
    progress: Progress,
    refused: list[tuple[str, InputError]] | None = None,
    costs: Costs | None = None,
) -> ReadBack:
    """Read the files of a folder through libraries that did not write them, and compare each with the plate.

    The first layout is compared dot by dot too.

    Args:
        refused: takes the files that cannot be read, and why; they are then left out. Then they may be anybody's, and
            layouts are read and compared within the limits of :mod:`maskfab.mask.sandbox`.
    """
    trips, quantities, read = dict[int, RoundTrip](), dict[int, tuple[Quantity, ...]](), dict[str, db.Layout]()
    errors: dict[int, tuple[str, InputError]] = {}
    waiting = deque(enumerate(made.products))
    first = next((number for number, product in waiting if product.polygons), None)

    costs = costs or Costs()

    def model() -> RoundTrip | None:
        return next(iter(trips.values()), None)

    def take(number: int, *, dots: bool) -> _Taken:
        product = made.products[number]
        if refused is not None and product.polygons:
            with _within_limits(made, product, folder, costs, dots=dots, judge=not _sound(model())) as answer:
                return answer()
        with costs.reading(product.form.name):
            return _take(made, product, folder)

    slow = [number for number, planned in waiting if planned.form.reading == "thread"]
    aside = [
        number
        for number, planned in waiting
        if number != first
        and planned.form.reading == "fork"
        and (path := folder / planned.name).is_file()
        and path.stat().st_size > _LARGE_BYTES
    ]
    if refused is not None or (os.cpu_count() or 1) < 2:
        aside = []  # a foreign file is read in a copy anyhow, one after the other
    with _ahead(made, slow, aside, lambda number: take(number, dots=number == first), folder, costs) as coming:
        while waiting:
            number, product = waiting.popleft()
            taken = coming.get(product.name)
            # Background reads are collected last; the first layout comes before anything else.
            others = any(planned.name not in coming for _, planned in waiting)
            if taken and not taken.done() and others and (trips or not product.polygons):
                waiting.append((number, product))
                continue
            coming.pop(product.name, None)
            progress("read back", len(quantities) + len(errors), len(made.products))
            try:
                result = taken.result() if taken else take(number, dots=not trips)
                if isinstance(result, RoundTrip) and _owes(result, model()):
                    result = take(number, dots=not trips)  # what should have been the first is no model
                if isinstance(result, db.Layout):
                    read = read or {product.name: result}
                    with costs.reading(product.form.name):
                        result = compare_mask(
                            made, result, folder / product.name, dots=not trips, judge=not _sound(model())
                        )
                if isinstance(result, RoundTrip):
                    result = _judged_as(model(), result)
                    quantities[number] = result.quantities()
                    trips[number] = result if not trips else replace(result, layout=db.Layout())
                else:
                    quantities[number] = result
            except InputError as error:
                if refused is None:
                    raise
                errors[number] = product.name, error
            release_memory()
    progress("read back", len(made.products), len(made.products))
    if refused is not None:
        refused += [errors[number] for number in sorted(errors)]
    rows = tuple(chain.from_iterable(quantities[number] for number in sorted(quantities)))
    rows += _owed(rows, [made.products[number].name for number in sorted(trips)], made)
    return ReadBack(tuple(trips[number] for number in sorted(trips)), rows, read)


def _owed(rows: Iterable[Quantity], files: Sequence[str], made: PlateFiles) -> tuple[Quantity, ...]:
    """Whether the judge has given every row on every file; one that lacks is else read as nothing wrong."""
    if made.asked is None or not files:
        return ()
    shown = [file for file in files if made.asked.displays and _shows_display(made, file)]
    lost = missing(rows, files, [die.name for die in made.asked.dies], shown)
    method = f"rows that the judge owes for {', '.join(files)} and has not given{''.join(f'; {row}' for row in lost)}"
    return (Quantity("judged_rows", len(lost), method, limit=0, passed=not lost),)


def _shows_display(made: PlateFiles, name: str) -> bool:
    """Whether a file has layers that are not written, such as those of the display."""
    form, names = layout_format(Path(name)), made.settings.drawing.layer_names
    if form is None or form.layers == "named":
        return names is None or CIRCUIT.name in names
    return form.layers != "one"


@contextmanager
def _ahead(
    made: PlateFiles,
    slow: Sequence[int],
    aside: Sequence[int],
    take: Callable[[int], _Taken],
    folder: Path,
    costs: Costs,
) -> Iterator[dict[str, Future[_Taken]]]:
    """Start slow reads in threads and in copies of this process, both ended on exit; yields futures by file name."""
    workers = min(_MOST_AHEAD, max(1, (os.cpu_count() or 1) - 1))
    with ExitStack() as stack:
        # Copied before there are threads that read: what those hold would be held in the copy for ever.
        copies = {
            number: stack.enter_context(
                _within_limits(made, made.products[number], folder, costs, dots=False, judge=False)
            )
            for number in aside[: os.cpu_count()]
        }
        pool = stack.enter_context(ThreadPoolExecutor(workers + len(copies)))
        stack.callback(pool.shutdown, wait=False, cancel_futures=True)
        reads = {made.products[number].name: pool.submit(take, number) for number in slow}
        yield reads | {
            made.products[number].name: pool.submit(_answer, made, made.products[number], folder, answer)
            for number, answer in copies.items()
        }


def _answer(made: PlateFiles, product: Product, folder: Path, answer: Callable[[], RoundTrip]) -> _Taken:
    """The finding of a copy of this process; the file itself if that was ended for its limits, for it is ours."""
    try:
        return answer()
    except SourceError as error:
        if error.code != "MF322":
            raise
        return _take(made, product, folder)


def _take(made: PlateFiles, product: Product, folder: Path) -> _Taken:
    path, form = folder / product.name, product.form
    if product.polygons:
        return read_mask(path)
    header = () if made.asked is None else (header_row(path, made.asked.header),)
    if product.die is None:
        assert form.compare_plate is not None  # a format says how what it writes is compared
        return (*form.compare_plate(made, path), *header)
    assert form.compare_die is not None
    (die,) = (own for own in made.plate.dies if own.name == product.die.name)
    return (*form.compare_die(made, die, path), *header)


def read_mask(path: Path) -> db.Layout:
    """A mask file, by a library that did not write it; it has one top cell."""
    form = layout_format(path)
    if form is not None and form.read is not None and not form.suffixes:
        return form.read(path)  # only files of ours are read
    read = read_layout(path)
    find_cell(read)
    return read


def compare_mask(made: PlateFiles, read: db.Layout, path: Path, *, dots: bool = True, judge: bool = True) -> RoundTrip:
    """A mask file that was read, against the design and against what its job asks for.

    If ``dots``, each dot is held against its opening, and the judge has to find faults in copies of the file. Unless
    ``judge``, a file alike to the design is judged by its header alone: another with its polygons is judged in whole.

    Raises:
        SourceError: MF323 if the polygon library fails on the file.
    """
    names: Mapping[str, str] | None = None
    form, asked = layout_format(path), made.asked
    if form is not None and form.layers == "one":
        names = {CLEAR.name: CLEAR.name}
        if made.figures.options.tone == "dark":
            named_chrome(read)
    elif form is not None and form.layers == "named":
        names = made.settings.drawing.layer_names
    polygons, bias = made.figures.account.polygons, made.figures.options.bias_nm
    compare = partial(compare_biased, bias_nm=bias) if bias else compare_layout
    with library_errors(path):
        trip = compare(made.plate, made.design, read, path, dots=dots, drawn_polygons=polygons, layer_names=names)
        if asked is None:
            return trip
        if not _shows_display(made, path.name):
            asked = replace(asked, displays=())
        rows: tuple[Quantity, ...] = (header_row(path, asked.header),)
        if judge or not trip.alike:
            rows = (*judged(read, path.name, asked), *rows)
        if dots and all(row.passed for row in rows):
            rows += (planted(read, path.name, asked),)
        return replace(trip, judged=rows)


def _sound(model: RoundTrip | None) -> bool:
    """Whether a file has the design's polygons in the design's cells and was judged, and nothing was found."""
    return model is not None and model.alike and all(row.passed for row in model.judged)


def _owes(trip: RoundTrip, model: RoundTrip | None) -> bool:
    """Whether a comparison lacks dots or rows that no file before it has."""
    return (model is None and trip.dies[0].wrong_dots is None) or (len(trip.judged) == 1 and not _sound(model))


def _judged_as(model: RoundTrip | None, trip: RoundTrip) -> RoundTrip:
    """A comparison with all rows: those of a model are those of a file with its polygons in its cells."""
    if model is None or len(trip.judged) != 1:
        return trip
    name, (header,) = trip.path.name, trip.judged
    rows = (
        replace(row, method=f"{name}: as {row.method}, whose polygons this file has in the same cells")
        for row in model.judged
        if row.name not in (header.name, PLANTED)
    )
    return replace(trip, judged=(*rows, header))


@contextmanager
def _within_limits(
    made: PlateFiles, product: Product, folder: Path, costs: Costs, *, dots: bool, judge: bool
) -> Iterator[Callable[[], RoundTrip]]:
    """A layout that anybody may have written, read and compared in a copy of this process; yields who waits for that.

    What comes back holds no differing shapes, and a layout only if ``dots``: the design where they are equal.

    Raises:
        SourceError: as :func:`read_layout` and :func:`maskfab.mask.sandbox.bounded`; MF313 if the file
            differs and has so many vertices that its optics would take far longer than the design's.
    """
    path = folder / product.name

    def work(_tell: Progress) -> tuple[Any, ...]:
        with measured() as effort:
            read = _take(made, product, folder)
            assert isinstance(read, db.Layout)
            trip = compare_mask(made, read, path, dots=dots, judge=judge)
        if dots and trip.differences:
            _refuse_many_vertices(made, read, path)
            trip.layout.write(str(differing), _clear_alone(trip.layout))
        return effort.seconds, effort.bytes, *(getattr(trip, name) for name in _HANDED_OVER)

    with tempfile.TemporaryDirectory(prefix="maskfab-verify-") as aside:
        differing = Path(aside) / "differing.oas"
        seconds = seconds_of(made.figures.account.polygons)
        kind: Any = tuple[float, float, *_HANDED_OVER.values()]  # type: ignore[misc]
        with begun(path, work, kind=kind, seconds=seconds) as answer:

            def found() -> RoundTrip:
                took_s, held, *found = answer()
                costs.read(product.form.name, Effort(took_s, held))
                values = dict(zip(_HANDED_OVER, found, strict=True))
                layout = made.design if dots else db.Layout()
                if differing.is_file():
                    layout = db.Layout()
                    layout.read(str(differing))
                slivers = Sifted(db.Region(), db.Region())
                return RoundTrip(path=path, layout=layout, differing=db.Region(), slivers=slivers, **values)

            yield found


def _clear_alone(read: db.Layout) -> db.SaveLayoutOptions:
    options = db.SaveLayoutOptions()
    options.format = "OASIS"
    options.deselect_all_layers()
    index = read.find_layer(layer_info(CLEAR))
    if index is not None:
        options.add_layer(index, layer_info(CLEAR))
    return options


def _refuse_many_vertices(made: PlateFiles, read: db.Layout, path: Path) -> None:
    vertices, drawn = count_vertices(read), max(count_vertices(made.design), made.figures.account.vertices)
    if vertices > _LIKE * drawn + _FEW_VERTICES:
        what = f"{path.name} draws {vertices:.3g} vertices, references followed, where the plate has {drawn:.3g}"
        cure = "Put the file back that the run wrote, or hold this one against the job with --against"
        raise SourceError("MF313", what, where=str(path), cure=cure)
