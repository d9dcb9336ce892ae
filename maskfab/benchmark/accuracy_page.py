"""The result of a benchmark as a table, a figure and JSON."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from maskfab import provenance
from maskfab.benchmark.accuracy import Timing
from maskfab.benchmark.cases import CaseResult
from maskfab.files.staging import check_target, staged

_COLOURS = {"ours": "#0072b2", "peer": "#d55e00", "published": "#000000"}
_MARKS = {"double": "o", "single": "^"}


def race_document(
    timings: Sequence[Timing], bound_ms: Mapping[str, float], absent: Mapping[str, str]
) -> dict[str, Any]:
    """Everything that was measured, with the versions of what was raced, and who could not take part and why."""
    return {
        "versions": provenance.versions(),
        "gemm_bound_ms": dict(bound_ms),
        "absent": dict(absent),
        "timings": [asdict(timing) for timing in timings],
    }


def race_table(timings: Iterable[Timing], bound_ms: Mapping[str, float], absent: Mapping[str, str]) -> list[str]:
    """One line a contestant, fastest first, then those who could not take part."""
    ordered = sorted(timings, key=lambda timing: timing.milliseconds)
    width = max(len(timing.name) for timing in ordered)
    times = f"{'cold ms':>8}  {'warm ms':>8}  {'quartiles':>17}"
    lines = [f"{'method':{width}}  precision  {times}  {'error as given':>14}  {'with dot factor':>15}"]
    for t in ordered:
        spread = f"{t.spread[0]:.2f} to {t.spread[1]:.2f}"
        lines.append(
            f"{t.name:{width}}  {t.precision:9}  {t.cold_milliseconds:8.2f}  {t.milliseconds:8.2f}  {spread:>17}  "
            f"{t.error:14.1e}  {t.error_with_dots:15.1e}"
        )
    bounds = ", ".join(f"{value:.2f} ms {precision}" for precision, value in bound_ms.items())
    lines += [f"not compared: {name}, {reason}" for name, reason in absent.items()]
    return [
        *lines,
        "processor time on one thread; cold: a first call and what it sets up, warm: the next",
        f"products alone of the parity path, the bound of its method without interpolation: {bounds}",
    ]


def race_figure(timings: Sequence[Timing]) -> bytes:
    """Error against time, both on logarithmic axes, as PNG; down and to the left is better.

    A peer stands twice: as given, hollow, and with the dot's factor applied afterwards, filled.
    """
    with rc_context({"font.size": 9}):
        figure = Figure(figsize=(10.5, 5.0), dpi=120, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        for number, t in enumerate(sorted(timings, key=lambda timing: timing.milliseconds), start=1):
            colour, mark = _COLOURS[t.kind], _MARKS[t.precision]
            if t.error != t.error_with_dots:
                axes.plot(t.milliseconds, t.error, mark, markerfacecolor="none", color=colour)
                axes.plot([t.milliseconds] * 2, [t.error, t.error_with_dots], ":", color=colour, linewidth=0.8)
            label = f"{number}  {t.name}, {t.precision}: {t.milliseconds:.1f} ms"
            axes.plot(t.milliseconds, t.error_with_dots, mark, color=colour, label=label)
            place, offset = (t.milliseconds, t.error_with_dots), (5, 4 if number % 2 else -11)
            axes.annotate(str(number), place, offset, textcoords="offset points", color=colour)
        axes.set(xscale="log", yscale="log", xlabel="processor time of one PSF, warm (ms, median, one thread)")
        axes.set(ylabel="relative L2 error of the unit-sum PSF")
        axes.set_title("Speed against error: filled with the dot factor, hollow as given; blue maskfab, orange peers")
        axes.grid(alpha=0.3)
        axes.margins(x=0.1, y=0.08)
        figure.legend(loc="outside right upper", frameon=False, fontsize=8)
        stream = io.BytesIO()
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def case_table(outcomes: Iterable[CaseResult]) -> Iterable[str]:
    """One line a hard case, as each is done."""
    yield f"{'case':38}  {'error':>8}  {'limit':>7}  verdict  {'s':>6}  method"
    for o in outcomes:
        verdict = "pass" if o.passed else "FAIL"
        yield f"{o.case.name:38}  {o.error:8.1e}  {o.case.limit:7.0e}  {verdict:7}  {o.seconds:6.2f}  {o.case.method}"


def case_document(outcomes: Sequence[CaseResult]) -> dict[str, Any]:
    """The outcomes of the cases as plain data."""
    rows = [
        {
            "name": o.case.name,
            "method": o.case.method,
            "error": o.error,
            "limit": o.case.limit,
            "passed": o.passed,
            "seconds": round(o.seconds, 3),
        }
        for o in outcomes
    ]
    return {"verdict": "pass" if all(o.passed for o in outcomes) else "fail", "cases": rows}


def write_accuracy(target: Path, document: dict[str, Any], figure: bytes) -> list[Path]:
    """Put a race's figure and numbers into a new directory."""
    with staged(check_target(target, force=False)) as folder:
        (folder / "bench.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        (folder / "bench.png").write_bytes(figure)
    return sorted(target.iterdir())
