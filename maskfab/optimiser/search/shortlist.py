"""Which of a scan's shapes a designed map makes the most of: thick ones gain more from a map than slender ones.

A scan judges openings turned at random. A map gains most where the halo that it can take away is strongest, so the best
under a map need not be the best of the scan. The best shapes that differ in family or size are each given one descent
of a map, and the best of these goes on.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from maskfab.clock import Clock
from maskfab.optimiser.maps.orientation_map import MapMode, design_map
from maskfab.optimiser.model.layout_error import PanelError
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.discrete import Ranked
from maskfab.optimiser.rules.families import Candidate, kind
from maskfab.optimiser.search.scan import Best
from maskfab.progress import Progress


def shortlisted(
    found: Best,
    most: int,
    error: PanelError,
    rules: Constraints,
    clock: Clock,
    progress: Progress,
    *,
    mode: MapMode,
    seed: int,
    positions: int = 1,
) -> Best:
    """The search with that opening as its best which restores best under a quick map; of equals, the earlier.

    Args:
        found: its best is on the list, then those that were looked at, best first.
        most: openings on the list; 1 leaves everything as it is.
        error: of panels of such units; the levels weigh in it as they do in the scan.
        rules: that all on the list keep.
        clock: no further map is begun or compared when its time is over.
        progress: told after every map.
        mode, seed, positions: of :func:`maskfab.optimiser.maps.orientation_map.design_map`.

    Raises:
        JobError: as ``design_map``.
    """
    listed = different([Candidate(found.best.name, found.best.unit), *found.looked], rules, most)
    if len(listed) < 2:
        return found
    # A random map's light differs by chance, and more of it is no merit of a shape: all have what is expected.
    count = int(listed[0].unit.sum())
    light = round(float(error.inside.sum()) * count / error.dots**2)

    def restored(each: Candidate) -> float | None:
        if clock.over:
            return None
        quick = design_map(
            each.unit,
            error,
            mode=mode,
            seed=seed,
            kicks=0,
            positions=positions,
            allows=rules.allows,
            light=light,
            clock=clock,
        )
        # Maps that were ended early are not compared.
        return None if clock.over else float(np.dot(error.weights, quick.psnr))

    values: list[float] = []
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for value in pool.map(restored, listed):
            if value is None:
                break
            values.append(value)
            progress("shortlist", len(values), len(listed))
    cut = len(values) < len(listed)
    notes = [f"The budget ended the shortlist after {len(values)} of {len(listed)} quick maps."] if cut else []
    best = max(range(len(values)), key=values.__getitem__, default=0)
    if best:
        notes.append(
            f"Under quick maps, {listed[best].name} restores {values[best] - values[0]:.3f} dB better than "
            f"{listed[0].name}, which is the better one turned at random."
        )
    chosen = found.best if best == 0 else Ranked(listed[best].name, listed[best].unit, found.best.value)
    return replace(
        found,
        best=chosen,
        notes=(*found.notes, *notes),
        cut=found.cut or cut,
        stages=(*found.stages, ("quick maps", len(values))),
    )


def different(candidates: Iterable[Candidate], rules: Constraints, most: int) -> tuple[Candidate, ...]:
    """At most so many that keep the rules: of every family and size, turned or not, the first."""
    kept: dict[tuple[str, int, int], Candidate] = {}
    for each in candidates:
        if len(kept) >= most:
            break
        key = kind(each.name, each.unit)
        if key not in kept and rules.allows(each.unit):
            kept[key] = each
    return tuple(kept.values())
