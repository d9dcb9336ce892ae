"""Dies of several reports side by side, as far as the same camera, light and scenes make their numbers equal.

What was measured otherwise is left out, and said. The page, and the same in words, hold light against restored
photographs, with the intervals of their differences.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from markupsafe import Markup
from matplotlib.figure import Figure

from maskfab.base.errors import JobError
from maskfab.base.quantities import columns
from maskfab.camera.scores import CONFIDENCE
from maskfab.findings.photographs import middle_level
from maskfab.report.documents.report import FinishedReport
from maskfab.report.documents.shape import Document, Record
from maskfab.report.figures.die import MARKS, OKABE_ITO
from maskfab.report.figures.sheet import INK, QUIET, Drawing, place, styled
from maskfab.report.pages.breaches import broken
from maskfab.report.pages.front import best as best_kept
from maskfab.report.pages.tables import DieLine, Table, best_photographed, die_table, difference, mean_psnr, scores
from maskfab.report.pages.template import page_template, style

_WORDS = frozenset({"told", "reference", "reference_stated", "scenes", "dies", "unused"})
"""Parts of a report's photographs that say nothing of how they were taken."""
_OF_ITS_OWN = frozenset({"open_ratio", "min_feature", "min_gap"})
"""Numbers of a die that no camera enters."""
_MOST_TEXT = 60


@dataclass(frozen=True)
class JobDifference:
    """A field in which jobs differ: its path, and its value in each report; None where it is not stated."""

    field: str
    values: tuple[str | None, ...]


@dataclass(frozen=True)
class Compared:
    """Reports side by side.

    Attributes:
        reports: in the order in which they were named.
        document: of all dies, those of several reports by ``REPORT:DIE``, in the form of report.json; with photographs
            only of those that were taken alike.
        left_out: sentences on what cannot be compared, and why.
    """

    reports: tuple[FinishedReport, ...]
    document: Record
    left_out: tuple[str, ...]
    differences: tuple[JobDifference, ...]

    @property
    def table(self) -> Table[DieLine]:
        """Dies, the best first."""
        return die_table(self.document)

    def to_dict(self) -> Document:
        """The ranking at every level of light, with paired differences to the best, and what else was found."""
        taken = self.document.get("photographs")
        return {
            "reports": [
                {"name": report.name, "job_hash": report.document["job_hash"], "proved": report.proved}
                for report in self.reports
            ],
            "levels": [] if taken is None else [_ranked(taken, level) for level in taken["levels_db"]],
            "dies": [
                {"name": die["name"], "quantities": die["quantities"], "display": die.get("display", {}).get("verdict")}
                for die in self.document["dies"]
            ],
            "left_out": list(self.left_out),
            "job_differences": [vars(difference) for difference in self.differences],
        }


def compare_reports(
    reports: Sequence[FinishedReport], dies: Sequence[str] = (), reference: str | None = None
) -> Compared:
    """Put the dies of reports side by side.

    Args:
        dies: by ``DIE`` or ``REPORT:DIE``; all if none is named.
        reference: that gains are over, named likewise; by default that of the first report.

    Raises:
        JobError: MF105 for a die that is not there, or is in several reports, or for fewer than two dies.
    """
    first, left_out = reports[0], list[str]()
    alone = len(reports) == 1
    chosen = {_name(report, die["name"], alone): (report, die) for report in reports for die in report.document["dies"]}
    if dies:
        wanted = [_found(name, chosen, "--die") for name in dies]
        chosen = {name: place for name, place in chosen.items() if name in wanted}
    if len(chosen) < 2:
        cure = "Name two dies, or two reports"
        raise JobError("MF105", "there is nothing to compare with", where="--die" if dies else "reports", cure=cure)
    stated = None if reference is None else _found(reference, chosen, "--reference")
    merged = []
    for name, (report, die) in chosen.items():
        other = report.document["camera"] != first.document["camera"]
        rows = [row for row in die["quantities"] if not other or row["name"] in _OF_ITS_OWN]
        renamed = [{**row, "die": name} if "die" in row else row for row in rows]
        merged.append({**die, "name": name, "quantities": renamed})
    for report in reports[1:]:
        if report.document["camera"] != first.document["camera"]:
            camera = ", ".join(_parted(first.document["camera"], report.document["camera"]))
            left_out.append(
                f"{report.name} has another camera than {first.name} ({camera}): its optics are not compared."
            )
        if any("spread" in run.document for run in (first, report)) and _made(report) != _made(first):
            left_out.append(
                f"{report.name} states another process of the writer than {first.name}, or another spread of it: bands "
                "of the displays made are not comparable."
            )
    photographs = _photographs(reports, chosen, stated, alone, left_out)
    over = None if photographs is None else photographs["reference"]
    # Bands of gains over another die than all are held against here go.
    for judged in merged:
        report, _ = chosen[judged["name"]]
        own = report.document.get("photographs", {}).get("reference")
        if own is None or _name(report, own, alone) != over:
            judged["quantities"] = [row for row in judged["quantities"] if row["name"] != "band_restored_gain"]
    document = {**first.document, "dies": merged}
    document.pop("photographs", None)
    if photographs is not None:
        document["photographs"] = photographs
    left_out += [
        f"{report.name} has no manifest beside it: whether it was edited is not known."
        for report in reports
        if not report.proved
    ]
    return Compared(tuple(reports), document, tuple(left_out), tuple(_job_differences(reports)))


def _photographs(
    reports: Sequence[FinishedReport],
    chosen: Mapping[str, tuple[FinishedReport, Record]],
    reference: str | None,
    alone: bool,
    left_out: list[str],
) -> Document | None:
    """Photographs of the first report that has some, with those of others that were taken of the same scenes alike."""
    first = next((report for report in reports if "photographs" in report.document), None)
    if first is None:
        left_out.append("No report has photographs: dies are not ranked.")
        return None
    taken, dies = first.document["photographs"], []
    for report in reports:
        other = report.document.get("photographs")
        if other is None:
            left_out.append(f"{report.name} has no photographs.")
            continue
        parts = ", ".join(_parted(_taken(taken), _taken(other)))
        if parts:
            left_out.append(
                f"Photographs of {report.name} were taken otherwise than those of {first.name} ({parts}): they are not "
                "compared."
            )
            continue
        names = {_name(report, die["name"], alone): die for die in other["dies"]}
        dies += [{**die, "name": name} for name, die in names.items() if name in chosen]
    photographed = {die["name"] for die in dies if not die["refused"]}
    own = None if taken["reference"] is None else _name(first, taken["reference"], alone)
    over = next((name for name in (reference, own) if name in photographed), next(iter(sorted(photographed)), None))
    if reference is not None and over != reference:
        left_out.append(f"The reference {reference} has no photographs of these scenes: gains are over {over}.")
    return {**taken, "dies": dies, "reference": over, "reference_stated": reference}


def _made(report: FinishedReport) -> tuple[object, object]:
    return report.document.get("process"), report.document.get("spread")


def _taken(photographs: Record) -> Record:
    return {key: value for key, value in photographs.items() if key not in _WORDS} | {"scenes": photographs["scenes"]}


def _ranked(taken: Record, level: float) -> Document:
    """Dies from the highest mean down, each with its paired difference to the first."""
    by_die = scores(taken, level)
    means = {name: sum(own) / len(own) for name, own in by_die.items()}
    order = sorted(means, key=lambda name: -means[name])
    best = best_photographed(taken, level)
    rows = []
    for name in order:
        gap, gain = (
            difference(taken, level, name, other) if name != other else None for other in (order[0], taken["reference"])
        )
        rows.append(
            {
                "name": name,
                "psnr": means[name],
                "to_best": None if gap is None else {"mean": gap.mean, "half_width": gap.half_width, "tie": gap.tie},
                "gain": None if gain is None else {"mean": gain.mean, "half_width": gain.half_width, "tie": gain.tie},
                "best": name in best,
            }
        )
    return {
        "level_db": level,
        "reference": taken["reference"],
        "scenes": len(taken["scenes"]),
        "interval": CONFIDENCE,
        "dies": rows,
    }


def _job_differences(reports: Sequence[FinishedReport]) -> Iterator[JobDifference]:
    stated = [report.job for report in reports if report.job is not None]
    if len(stated) < len(reports):
        return
    dies = [{die["name"]: die for die in job.get("die", ())} for job in stated]
    shared = [name for name in dies[0] if all(name in own for own in dies)]
    for name in dict.fromkeys(name for own in dies for name in own if name not in shared):
        yield JobDifference(f"die.{name}", tuple(own[name]["label"] if name in own else None for own in dies))
    jobs = [
        dict(_fields({**job, "die": [die for name, die in own.items() if name in shared]}))
        for job, own in zip(stated, dies, strict=True)
    ]
    for field in dict.fromkeys(field for job in jobs for field in job):
        values = tuple(job.get(field) for job in jobs)
        if len(set(values)) > 1:
            yield JobDifference(field, values)


def _fields(value: object, path: str = "") -> Iterator[tuple[str, str]]:
    """Every field of a job with its value as text; dies by their names."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _fields(part, f"{path}.{key}".lstrip("."))
    elif isinstance(value, list) and value and all(isinstance(part, Mapping) and "name" in part for part in value):
        for part in value:
            yield from _fields({key: inner for key, inner in part.items() if key != "name"}, f"{path}.{part['name']}")
    elif value is not None:
        text = " ".join(str(value).split())
        yield path, text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}…"


def _parted(one: Record, other: Record) -> Iterator[str]:
    for key in dict.fromkeys([*one, *other]):
        if one.get(key) != other.get(key):
            yield key.replace("_", " ")


def _name(report: FinishedReport, die: str, alone: bool) -> str:
    return die if alone else f"{report.name}:{die}"


def _found(name: str, chosen: Mapping[str, object], where: str) -> str:
    if name in chosen:
        return name
    alike = [candidate for candidate in chosen if candidate.rpartition(":")[2] == name]
    if len(alike) == 1:
        return alike[0]
    what = f"several reports have a die {name!r}" if alike else f"no report has a die {name!r}"
    raise JobError("MF105", what, where=where, cure=f"Name one of {', '.join(alike or chosen)}")


@styled
def trade(document: Record) -> Drawing:
    """Open ratio in the stop against gain over the reference, a mark for each die; one that none betters is filled."""
    taken = document["photographs"]
    level, reference = middle_level(taken["levels_db"]), taken["reference"]
    light = {
        die["name"]: 100 * row["value"]
        for die in document["dies"]
        for row in die["quantities"]
        if row["name"] == "stop_open_ratio"
    }
    names = [name for name in scores(taken, level) if name in light]
    figure = Figure(figsize=(8.6, 4.2))
    axes = place(figure, (0.7, 0.5, 4.9, 3.4))
    base = mean_psnr(taken, level, reference)
    gains = {name: mean_psnr(taken, level, name) - base for name in names}
    for number, name in enumerate(names):
        bettered = any(
            light[other] >= light[name] and gains[other] >= gains[name] and other != name
            and (light[other], gains[other]) != (light[name], gains[name])
            for other in names
        )  # fmt: skip
        colour = OKABE_ITO[number % len(OKABE_ITO)]
        width = 0.0 if name == reference else difference(taken, level, name, reference).half_width
        axes.errorbar(
            light[name],
            gains[name],
            yerr=width if width > 0 else None,
            color=colour,
            marker=MARKS[number % len(MARKS)],
            markerfacecolor="white" if bettered else colour,
            markersize=6,
            capsize=2,
            linestyle="none",
            label=name,
        )
    axes.axhline(0, color=QUIET, linewidth=0.7)
    axes.set(xlabel="open ratio in the stop (%)", ylabel=f"gain over {reference} (dB)")
    axes.grid(visible=True, color=QUIET, alpha=0.25, linewidth=0.5)
    axes.tick_params(colors=INK)
    figure.legend(loc="upper left", bbox_to_anchor=(5.75 / 8.6, 3.95 / 4.2), fontsize=7)
    said = f"Gain over {reference} at {level:g} dB of light against open ratio in the stop, {len(names)} dies"
    return Drawing(figure, said)


_MOST_FIELDS = 20


def compare_page(compared: Compared) -> str:
    """The page, with nothing from outside it; equal reports give equal pages."""
    table = compared.table
    return page_template("compare.html.j2").render(
        style=style(),
        compared=compared,
        table=table,
        verdict=verdict(compared),
        confidence=f"{CONFIDENCE:.0%}",
        figure=None if table.level_db is None else Markup(trade(compared.document).img()),
    )


def verdict(compared: Compared) -> str:
    """Ranking and the best die, in words; a die whose display breaks a limit is never called best."""
    table = compared.table
    if table.level_db is None:
        return "No photographs to rank by."
    taken, level = compared.document["photographs"], table.level_db
    by_die, best = scores(taken, level), best_photographed(taken, level)
    count = f"{len(taken['scenes'])} photographs at {level:g} dB of light"
    if len(by_die) < 2:
        return f"One die alone has photographs that can be compared: {next(iter(by_die), 'none')}."
    if not best:
        return f"Nobody can tell which is best: all {len(by_die)} dies tie over {count}."
    tied = [line.name for line in table.lines if line.name in best]
    others = f", tied with {', '.join(tied[1:])}," if len(tied) > 1 else "; every other die is worse"
    if not any(broken(die) for die in compared.document["dies"] if die["name"] in best):
        return f"Best: {tied[0]}{others} over {count}."
    ranking, leader = f"Highest PSNR: {tied[0]}{others} over {count}.", best_kept(compared.document)
    if isinstance(leader, str):
        return ranking
    kept = "" if leader.broken else f" Best of those that keep FITS, LOOKS and LIVES: {leader.name}."
    return f"{ranking}{kept} {leader.limits}"


def compare_records(compared: Compared) -> list[Document]:
    """Lines of the table as plain data, by headings with their units."""
    table, reference = compared.table, compared.table.reference
    ranked = [] if table.level_db is None else _ranked(compared.document["photographs"], table.level_db)["dies"]
    scored = {row["name"]: row for row in ranked}
    records = []
    for line in table.lines:
        record: Document = {"die": line.name}
        if ranked:
            row = scored.get(line.name, {})
            gain = row.get("gain") or {}
            record |= {"PSNR (dB)": row.get("psnr"), f"gain over {reference} (dB)": gain.get("mean")}
            record["± (dB)"] = gain.get("half_width")
        if any(each.display for each in table.lines):
            record["display"] = line.display
        for words, cell in zip(table.columns, line.cells, strict=True):
            record[" ".join(words)] = None if cell is None else _number(cell.text)
        records.append(record)
    return records


def _number(text: str) -> float | str:
    """A cell as a number; as it is where it holds more than one."""
    try:
        return float(text.replace("−", "-"))
    except ValueError:
        return text


def _shown(compared: Compared) -> tuple[list[tuple[str, ...]], list[list[str]]]:
    """Headings, each in lines, and rows of the table; a column that no die fills is left out."""
    table = compared.table
    headings = [("die",), ("PSNR", "dB"), (f"gain over {table.reference}", "dB"), ("display",), *table.columns]
    rows = [
        [
            line.name,
            line.psnr.text,
            line.gain.text,
            line.display or "-",
            *(cell.text if cell else "-" for cell in line.cells),
        ]
        for line in table.lines
    ]
    kept = [k for k, column in enumerate(zip(*rows, strict=True)) if set(column) - {"-", "–"}]
    return [headings[k] for k in kept], [[row[k] for k in kept] for row in rows]


def compare_html(compared: Compared, notes: Sequence[str] = ()) -> str:
    """The table and what is said of it, for a notebook."""
    headings, rows = _shown(compared)
    head = "".join(f"<th>{'<br>'.join(map(escape, words))}</th>" for words in headings)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    said = "<br>".join(escape(line) for line in (*_said(compared), *notes))
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table><p>{said}</p>"


def compare_text(compared: Compared) -> Iterator[str]:
    """Lines for a terminal: a table whose headings take as many lines as their words do, and what is said of it."""
    headings, rows = _shown(compared)
    high = max(map(len, headings))
    yield from columns([*zip(*(("",) * (high - len(words)) + words for words in headings), strict=True), *rows])
    yield from _said(compared)


def _said(compared: Compared) -> Iterator[str]:
    yield verdict(compared)
    yield from compared.left_out
    names = [report.name for report in compared.reports]
    for field in compared.differences[:_MOST_FIELDS]:
        values = (f"{name} {'-' if value is None else value}" for name, value in zip(names, field.values, strict=True))
        yield f"{field.field}: {', '.join(values)}"
    if len(compared.differences) > _MOST_FIELDS:
        yield f"{len(compared.differences) - _MOST_FIELDS} more fields differ: the page and the JSON list all"
