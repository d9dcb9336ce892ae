#!/usr/bin/env python3
# Copyright the maskfab authors. SPDX-License-Identifier: Apache-2.0
"""Referee of a plate: says whether a GDSII file is the plate that a job's text asks for, or what is not, and where.

    python3 referee.py                      in the unpacked folder of a package
    python3 referee.py FOLDER | PACKAGE.zip
    python3 referee.py JOB.json PLATE.gds [TEMPLATE.toml] [--version 0.1.0]

JOB.json is the resolved job. Exit code 0: it is this plate; 1: it is not; 2: cannot tell. Any Python from 3.9 on runs
it; it needs nothing else, and shares nothing with maskfab but rules: docs/reference/layout.md, whose headings are
named below. Lengths are whole nanometres, and nothing is compared but exactly.

How two drawings are compared: the sum of the indicators of all polygons is known by its upright derivative, which lives
on edges that are not upright. Ends of edges are counted along each line, plus where an edge starts and minus where it
ends. Two drawings that are equal leave nothing, however they are cut into polygons, and no sorting is needed.
"""

import array
import hashlib
import io
import json
import math
import os
import re
import struct
import sys
import zipfile
from fractions import Fraction

MM = 1_000_000
UNITS = {"nm": 1, "um": 1000, "µm": 1000, "mm": MM, "cm": 10 * MM, "m": 1000 * MM, "in": 25_400_000, "mil": 25_400}
SPAN = 1 << 33  # a point is one number, x SPAN + y
HALF = SPAN >> 1
WRONG, CANNOT = 1, 2


class CannotTell(Exception):
    """Something that this file does not know how to judge."""


# --- Text: TOML (toml.io, v1.0.0), as far as openings, maps and templates use it ---

VALUE = re.compile(
    r"""\s*(?:\#[^\n]*\n\s*)*(?:(?P<long>\"{3}\n?(?P<lines>.*?)\"{3})|"(?P<text>(?:[^"\\]|\\.)*)"|'(?P<plain>[^']*)'"""
    r"""|(?P<open>\[)|(?P<brace>\{)|(?P<word>[^\s,\]}\#]+))""",
    re.DOTALL,
)
HEAD = re.compile(r"\s*(?:(?P<name>[\w.-]+|\"[^\"]*\")\s*=|(?P<tables>\[\[?)\s*(?P<table>[^\]]+?)\s*\]\]?)")
GAP = re.compile(r"(?:[\s,]|\#[^\n]*)*")


def toml(text):
    """Tables of a TOML text; tomllib's where Python has it (3.11)."""
    try:
        import tomllib
    except ImportError:
        return small_toml(text)
    return tomllib.loads(text)


def small_toml(text):
    root = {}
    table, at = root, GAP.match(text).end()
    while at < len(text):
        head = HEAD.match(text, at)
        if head is None:
            raise CannotTell(f"text {text[at : at + 40]!r}: no TOML that this file reads")
        at = head.end()
        if head["tables"]:
            table = root
            *above, last = head["table"].split(".")
            for name in above:
                table = table.setdefault(name, {})
                table = table[-1] if isinstance(table, list) else table
            if head["tables"] == "[[":
                table.setdefault(last, []).append({})
                table = table[last][-1]
            else:
                table = table.setdefault(last, {})
        else:
            table[head["name"].strip('"')], at = value(text, at)
        at = GAP.match(text, at).end()
    return root


def value(text, at):
    found = VALUE.match(text, at)
    at = found.end()
    if found["long"] is not None:
        return found["lines"], at
    if found["text"] is not None:
        return json.loads(f'"{found["text"]}"'), at
    if found["plain"] is not None:
        return found["plain"], at
    if found["open"] or found["brace"]:
        items, close = ([], "]") if found["open"] else ({}, "}")
        while True:
            at = GAP.match(text, at).end()
            if text[at] == close:
                return items, at + 1
            if close == "]":
                item, at = value(text, at)
                items.append(item)
            else:
                head = HEAD.match(text, at)
                items[head["name"].strip('"')], at = value(text, head.end())
    word = found["word"].replace("_", "")
    if word in ("true", "false"):
        return word == "true", at
    try:
        return int(word), at
    except ValueError:
        try:
            return float(word), at
        except ValueError:
            return word, at


def nm(text):
    """A length with its unit in nanometres, to the nearest, of two the even one."""
    number, unit = re.fullmatch(r"\s*([-+.\deE]+)\s*(\S+)\s*", text).groups()
    return round(Fraction(number) * UNITS[unit])


# --- Random numbers (numpy.org, NEP 19 and numpy/random: SeedSequence, PCG64, bounded integers after Lemire) ---

M32, M64, M128 = (1 << 32) - 1, (1 << 64) - 1, (1 << 128) - 1
STEP = 0x2360ED051FC65DA44385DF649FCCF645


class Random:
    """``numpy.random.default_rng(seed)``."""

    def __init__(self, seed):
        words = []
        while seed or not words:
            words.append(seed & M32)
            seed >>= 32
        constant = 0x43B0D7E5

        def hashed(word):
            nonlocal constant
            word ^= constant
            constant = constant * 0x931E8875 & M32
            word = word * constant & M32
            return word ^ word >> 16

        def mixed(one, other):
            word = (one * 0xCA01F9DD - other * 0x4973F715) & M32
            return word ^ word >> 16

        pool = [hashed(words[i] if i < len(words) else 0) for i in range(4)]
        for source in range(4):
            for target in range(4):
                if source != target:
                    pool[target] = mixed(pool[target], hashed(pool[source]))
        for word in words[4:]:
            for target in range(4):
                pool[target] = mixed(pool[target], hashed(word))
        constant, drawn = 0x8B51F9DD, []
        for i in range(8):
            word = pool[i % 4] ^ constant
            constant = constant * 0x58F38DED & M32
            word = word * constant & M32
            drawn.append(word ^ word >> 16)
        state, odd = (
            (drawn[i + 1] << 96) | (drawn[i] << 64) | (drawn[i + 3] << 32) | drawn[i + 2] for i in (0, 4)
        )
        self.odd = (odd << 1 | 1) & M128
        self.state = ((self.odd + state) * STEP + self.odd) & M128
        self.kept = None

    def word(self):
        """32 bits: the lower half of 64 first, the upper half on the next call."""
        if self.kept is not None:
            word, self.kept = self.kept, None
            return word
        self.state = state = (self.state * STEP + self.odd) & M128
        folded, turn = (state >> 64) ^ (state & M64), state >> 122
        folded = (folded >> turn | folded << (64 - turn)) & M64
        self.kept = folded >> 32
        return folded & M32

    def integer(self, below):
        """A whole number from 0, evenly drawn (Lemire 2019)."""
        if below == 1:
            return 0
        product = self.word() * below
        if product & M32 < below:
            threshold = ((1 << 32) - below) % below
            while product & M32 < threshold:
                product = self.word() * below
        return product >> 32

    def table(self, below, rows, columns):
        return [[self.integer(below) for _ in range(columns)] for _ in range(rows)]

    def permutation(self, items):
        items = list(items)
        for i in range(len(items) - 1, 0, -1):
            j = self.integer(i + 1)
            items[i], items[j] = items[j], items[i]
        return items


# --- Sums of edges: see the head of this file ---


class Sum:
    """Ends of edges, counted. ``flat`` is of lying edges, by point; ``slant`` of oblique ones, by line and point."""

    def __init__(self):
        self.flat, self.slant, self.area2 = {}, {}, 0

    def polygon(self, points, sign=1):
        """Add a closed outline of either sense, keyholes included; ``sign`` -1 takes it away."""
        area2 = 0
        x0, y0 = points[-1]
        for x1, y1 in points:
            area2 += (x0 - x1) * (y0 + y1)
            x0, y0 = x1, y1
        if area2 < 0:
            sign = -sign
        self.area2 += sign * area2
        flat, slant = self.flat, self.slant
        for x1, y1 in points:
            if y1 == y0:
                if x1 != x0:
                    start, end = x0 * SPAN + y0, x1 * SPAN + y1
                    flat[start] = flat.get(start, 0) + sign
                    flat[end] = flat.get(end, 0) - sign
            elif x1 != x0:
                dx, dy = x1 - x0, y1 - y0
                common = math.gcd(dx, dy) if dx > 0 else -math.gcd(dx, dy)
                dx, dy = dx // common, dy // common
                line = slant.setdefault((dx, dy, dx * y0 - dy * x0), {})
                line[x0] = line.get(x0, 0) + sign
                line[x1] = line.get(x1, 0) - sign
            x0, y0 = x1, y1

    def box(self, x0, y0, x1, y1, sign=1):
        self.polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], sign)

    def add(self, other, x, y, sign=1):
        """Add another sum, moved by (x, y)."""
        base, flat = x * SPAN + y, self.flat
        for key, count in other.flat.items():
            key += base
            flat[key] = flat.get(key, 0) + sign * count
        for (dx, dy, c), ends in other.slant.items():
            line = self.slant.setdefault((dx, dy, c + dx * y - dy * x), {})
            for at, count in ends.items():
                line[at + x] = line.get(at + x, 0) + sign * count
        self.area2 += sign * other.area2

    def left(self):
        """Points at which something is left."""
        for key, count in self.flat.items():
            if count:
                yield (key + HALF) // SPAN, (key + HALF) % SPAN - HALF
        for (dx, dy, c), ends in self.slant.items():
            for x, count in ends.items():
                if count:
                    yield x, (c + dy * x) // dx


# --- The file (GDSII Stream Format, release 6.0) ---

ENDS = {0x0800: "BOUNDARY", 0x0900: "PATH", 0x0A00: "SREF", 0x0B00: "AREF", 0x0C00: "TEXT", 0x1500: "NODE", 0x2D00: "BOX"}
SKIPPED = (0x0002, 0x0102, 0x0502, 0x1601, 0x1701, 0x1906, 0x1F06, 0x2206, 0x2306, 0x2601, 0x2B02, 0x2C06, 0x3602, 0x3706)


def real8(data):
    """Excess-64 floating point: sign, exponent of 16, 56 bits."""
    mantissa = Fraction(int.from_bytes(data[1:8], "big"), 1 << 56)
    return (-1 if data[0] & 128 else 1) * mantissa * Fraction(16) ** ((data[0] & 127) - 64)


class Cell:
    def __init__(self):
        self.outlines = {}  # layer: places of XY records in the file
        self.calls = []  # name, turn (x' = a x + b y, y' = c x + d y), places
        self.known = {}  # sums of it, as turned

    def points(self, data, at):
        size = (data[at - 4] << 8 | data[at - 3]) - 4
        flat = struct.unpack_from(f">{size // 4}i", data, at)
        return list(zip(flat[:-2:2], flat[1:-2:2]))


def read_gds(data, notes):
    """Cells by name, and the layers' count of shapes; refuses what plates of maskfab never hold."""
    cells, cell, at, end = {}, None, 0, len(data)
    header = struct.Struct(">HH").unpack_from
    units = kind = None
    while at + 4 <= end:
        size, record = header(data, at)
        if size < 4 or at + size > end:
            raise CannotTell(f"the file breaks off at byte {at}")
        body = at + 4
        if record == 0x1003:
            xy = body, size
        elif record == 0x1100:
            if kind in (0x0800, 0x2D00):
                if cell.points(data, xy[0])[0:1] and data[xy[0] : xy[0] + 8] != data[xy[0] + xy[1] - 12 : xy[0] + xy[1] - 4]:
                    raise CannotTell(f"an outline that is not closed, in {name}")
                if layer not in cell.outlines:
                    cell.outlines[layer] = array.array("Q")
                cell.outlines[layer].append(xy[0])
            elif kind in (0x0A00, 0x0B00):
                flat = struct.unpack_from(f">{(xy[1] - 4) // 4}i", data, xy[0])
                cell.calls.append(call(called, strans, angle, magnification, grid, flat, kind == 0x0B00))
            elif kind == 0x0900 or kind == 0x1500:
                raise CannotTell(f"a {ENDS[kind]} in {name}, which no plate of maskfab holds")
            else:
                notes.setdefault("texts", set()).add(layer)
            kind = None
        elif record in ENDS:
            kind, strans, angle, magnification, grid, layer = record, 0, 0, 1, (1, 1), None
        elif record == 0x0D02:
            number = header(data, body)[0]
        elif record in (0x0E02, 0x1602, 0x2E02, 0x2A02):
            layer = number, header(data, body)[0]
        elif record == 0x1206:
            called = bytes(data[body : at + size]).rstrip(b"\0")
        elif record == 0x1A01:
            strans = header(data, body)[0]
        elif record == 0x1B05:
            magnification = real8(data[body : body + 8])
        elif record == 0x1C05:
            angle = real8(data[body : body + 8])
        elif record == 0x1302:
            grid = header(data, body)
        elif record == 0x0606:
            name = bytes(data[body : at + size]).rstrip(b"\0")
            if name in cells:
                raise CannotTell(f"two cells are called {name}")
            cell = cells[name] = Cell()
        elif record == 0x0305:
            units = real8(data[body : body + 8]), real8(data[body + 8 : body + 16])
        elif record == 0x0400:
            return cells, units
        at += size
    raise CannotTell("the file has no end")


def call(name, strans, angle, magnification, grid, flat, many):
    quarters = Fraction(angle) / 90
    if strans & ~0x8000 or magnification != 1 or quarters.denominator != 1:
        raise CannotTell(f"a call of {name} that is scaled, or turned by other than quarters")
    turn = TURNS[int(quarters) % 4]
    if strans & 0x8000:  # mirrored about the x axis first
        turn = (turn[0], -turn[1], turn[2], -turn[3])
    if not many:
        return name, turn, [(flat[0], flat[1])]
    (columns, rows), (x, y, x1, y1, x2, y2) = grid, flat
    steps = [x1 - x, y1 - y, x2 - x, y2 - y]
    if not columns or not rows or any(s % n for s, n in zip(steps, (columns, columns, rows, rows))):
        raise CannotTell(f"an array of {name} whose steps are no whole numbers")
    ax, ay, bx, by = (s // n for s, n in zip(steps, (columns, columns, rows, rows)))
    return name, turn, [(x + i * ax + j * bx, y + i * ay + j * by) for j in range(rows) for i in range(columns)]


TURNS = ((1, 0, 0, 1), (0, -1, 1, 0), (-1, 0, 0, -1), (0, 1, -1, 0))


def after(outer, inner):
    """Two linear maps in one."""
    a, b, c, d = outer
    e, f, g, h = inner
    return (a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h)


class Drawing:
    """What a file draws on one layer, as sums of each of some boxes, and of what begins in none of them."""

    def __init__(self, data, cells, layer, mirrored):
        self.data, self.cells, self.layer = data, cells, layer
        called = {name for cell in cells.values() for name, _, _ in cell.calls}
        tops = [name for name in cells if name not in called]
        if missing := called - set(cells):
            raise CannotTell(f"cells that are called and not there: {missing}")
        if len(tops) != 1:
            raise CannotTell(f"{len(tops)} cells that no other calls: {tops[:5]}")
        self.top, self.mirrored = tops[0], mirrored
        self.placed = {}
        self._walk(self.top, (-1, 0, 0, 1) if mirrored else (1, 0, 0, 1), [(0, 0)], ())

    def _walk(self, name, turn, places, above):
        if name in above:
            raise CannotTell(f"cell {name} calls itself")
        cell = self.cells[name]
        if self.layer in cell.outlines:
            self.placed.setdefault((name, turn), []).extend(places)
        a, b, c, d = turn
        for inner, how, at in cell.calls:
            moved = [(a * x + b * y, c * x + d * y) for x, y in at]
            moved = moved if places == [(0, 0)] else [(x + u, y + v) for x, y in places for u, v in moved]
            self._walk(inner, after(turn, how), moved, (*above, name))

    def split(self, boxes):
        """Numbers of the boxes and what lies there: (sum, x, y) or (outline, turn, x, y); the last is the rest."""
        shares = [[] for _ in range(len(boxes) + 1)]

        def home(x, y):
            for i, (x0, y0, x1, y1) in enumerate(boxes):
                if x0 <= x <= x1 and y0 <= y <= y1:
                    return i
            return len(boxes)

        for (name, turn), places in self.placed.items():
            outlines = [self.turned(at, turn) for at in self.cells[name].outlines[self.layer]] if len(
                self.cells[name].outlines[self.layer]) < 4096 else None
            if outlines is None:
                for at in self.cells[name].outlines[self.layer]:
                    u, v = self.turned(at, turn, first=True)[0]
                    for x, y in places:
                        shares[home(u + x, v + y)].append((at, turn, x, y))
                continue
            whole = Sum()
            for outline in outlines:
                whole.polygon(outline)
            xs, ys = [x for each in outlines for x, _ in each], [y for each in outlines for _, y in each]
            x0, y0, x1, y1 = min(xs), min(ys), max(xs), max(ys)
            for x, y in places:
                here = home(x0 + x, y0 + y)
                if here == home(x1 + x, y1 + y):
                    shares[here].append((whole, x, y))
                else:
                    for at, outline in zip(self.cells[name].outlines[self.layer], outlines):
                        shares[home(outline[0][0] + x, outline[0][1] + y)].append((at, turn, x, y))
        return shares

    def turned(self, at, turn, first=False):
        size = 8 if first else (self.data[at - 4] << 8 | self.data[at - 3]) - 12
        flat = struct.unpack_from(f">{size // 4}i", self.data, at)
        a, b, c, d = turn
        if turn == (1, 0, 0, 1):
            return list(zip(flat[::2], flat[1::2]))
        return [(a * x + b * y, c * x + d * y) for x, y in zip(flat[::2], flat[1::2])]

    def sum(self, share, into):
        for item in share:
            if len(item) == 3:
                into.add(*item)
            else:
                at, turn, x, y = item
                outline = self.turned(at, turn)
                into.polygon([(u + x, v + y) for u, v in outline] if x or y else outline)
        return into


# --- layout.md, "Dies", and "What a cell shows" ---


class Opening:
    def __init__(self, text):
        read = toml(text)
        rows = [line.strip() for line in read["grid"].split("\n") if line.strip()]
        self.rows = [[mark == "#" for mark in row] for row in reversed(rows)]  # from below
        self.n = len(self.rows)
        if any(len(row) != self.n for row in self.rows):
            raise CannotTell("an opening that is not square")

    def turned(self, turn):
        rows = [row[::-1] for row in self.rows] if turn >= 4 else self.rows
        for _ in range(turn % 4):  # by a quarter, counter-clockwise: what was on the right comes above
            rows = [list(column) for column in zip(*rows)]
            rows = [row[::-1] for row in rows]
        return rows

    def clear_runs(self, gutter):
        """Lengths in dots of clear runs along x and y that end."""
        for rows in (self.rows, zip(*self.rows)):
            for row in rows:
                marks = "".join("#" if dot else "." for dot in row)
                if gutter == 0 and "." in marks:  # begin behind a dark dot
                    first = marks.index(".")
                    marks = marks[first:] + marks[:first]
                if gutter or "." in marks:
                    yield from map(len, re.findall("#+", marks))


def raster(rows, xs, ys):
    """The sum of clear dots, rows from below, between the lines xs and ys."""
    found, blank = Sum(), [False] * len(rows[0])
    flat = found.flat
    below = blank
    for j in range(len(rows) + 1):
        here = rows[j] if j < len(rows) else blank
        before = 0
        for i in range(len(xs)):
            step = here[i] - below[i] if i < len(here) else 0
            if step != before:
                flat[xs[i] * SPAN + ys[j]] = step - before
                before = step
        below = here
    for j, row in enumerate(rows):
        found.area2 += 2 * (ys[j + 1] - ys[j]) * sum(xs[i + 1] - xs[i] for i, dot in enumerate(row) if dot)
    return found


class Die:
    """A die as the job asks for it: ``cells`` are opening and turn of each, rows from below."""

    def __init__(self, job, number, say):
        die, plate = job["die"][number], job["plate"]
        self.name, self.label, self.number = die["name"], die.get("label", ""), number
        self.dot, self.gutter, self.tiling = nm(die["dot"]), nm(die.get("gutter", "0 um")), die["tiling"]
        self.size = nm(die.get("size") or plate["die_size"])
        count, pitch = len(job["die"]), nm(plate["die_pitch"])
        columns = min(plate["columns"], count)
        lines = -(-count // columns)
        self.x = -(columns - 1) * pitch // 2 + number % columns * pitch
        self.y = (lines - 1) * pitch // 2 - number // columns * pitch
        names = [die["opening"], *die.get("others", [])]
        seed, chart, self.shifts = die.get("seed"), None, None
        if die.get("map"):
            chart = toml(job["maps"][die["map"]])
            names = self.of_map(chart, names, say)
        texts = [job["openings"][name] for name in names]
        self.openings = [Opening(text) for text in texts]
        fits = (chart or toml(texts[0])).get("die_seeds_fit") if seed is None else None
        self.seed = fits[0] if fits else seed or 0
        self.n = self.openings[0].n
        self.pitch = self.n * self.dot + self.gutter
        room = self.size // self.pitch
        if self.tiling == "hexagonal":
            self.sheet()
            return
        rows = columns = room
        if chart:
            table = [[int(k) for k in line] for line in reversed(chart["map"].split())]
            rows -= (rows - len(table)) % 2
            columns -= (columns - len(table[0])) % 2
        self.cells = self.drawn(rows, columns, len(names), bool(die.get("others")))
        if chart:
            numbers = chart.get("openings")
            numbers = [[int(j) for j in line] for line in reversed(numbers.split())] if numbers else None
            up, right = (rows - len(table)) // 2, (columns - len(table[0])) // 2
            for i in range(rows):
                for j in range(columns):
                    u, v = i - up, j - right
                    inside = 0 <= u < len(table) and 0 <= v < len(table[0])
                    if inside:
                        self.cells[i][j] = (numbers[u][v] if numbers else self.cells[i][j][0], table[u][v])
                    elif chart.get("beyond"):
                        self.cells[i][j] = tuple(chart["beyond"])
        self.height, self.width = rows * self.pitch, columns * self.pitch
        self.left, self.below = self.x - self.width // 2, self.y - self.height // 2

    def of_map(self, chart, names, say):
        if chart.get("shifts"):
            raise CannotTell("shifts")
        return names

    def drawn(self, rows, columns, openings, others):
        """Table of the tilings."""
        draw, tiling = Random(self.seed), self.tiling
        if tiling == "blue":
            return blue_noise(draw, rows, columns, openings)
        if tiling in ("random", "map"):
            turns = draw.table(8, rows, columns)
        elif tiling in ("paper4", "flips"):
            of = (0, 5, 4, 3) if tiling == "paper4" else (0, 2, 4, 6)
            turns = [[of[k] for k in row] for row in draw.table(4, rows, columns)]
        elif tiling in ("rot90", "rot90flip"):
            of = ((0, 1), (3, 2)) if tiling == "rot90" else ((0, 5), (7, 2))
            turns = [[of[i % 2][j % 2] for j in range(columns)] for i in range(rows)]
        elif tiling == "periodic":
            turns = [[0] * columns for _ in range(rows)]
        else:
            raise CannotTell(f"tiling {tiling}")
        chosen = draw.table(openings, rows, columns) if others else [[0] * columns for _ in range(rows)]
        return [list(zip(*pair)) for pair in zip(chosen, turns)]

    def box(self):
        return (self.left, self.below, self.left + self.width, self.below + self.height)

    def take(self, into):
        """Take what is asked for away from a sum."""
        known, half = {}, self.gutter // 2
        for i, row in enumerate(self.cells):
            for j, (opening, turn) in enumerate(row):
                if (opening, turn) not in known:
                    lines = [half + k * self.dot for k in range(self.n + 1)]
                    known[opening, turn] = raster(self.openings[opening].turned(turn), lines, lines)
                into.add(known[opening, turn], self.left + j * self.pitch, self.below + i * self.pitch, -1)


def main(args):
    job = json.load(open(args[0]))
    data = open(args[1], "rb").read()
    cells, units = read_gds(data, {})
    dies = [Die(job, i, print) for i in range(len(job["die"]))]
    drawing = Drawing(data, cells, (1, 0), False)
    shares = drawing.split([die.box() for die in dies])
    for die, share in zip(dies, shares):
        total = drawing.sum(share, Sum())
        die.take(total)
        print(die.name, len(list(total.left())), list(total.left())[:3])


if __name__ == "__main__":
    main(sys.argv[1:])
