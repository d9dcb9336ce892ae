#!/usr/bin/env python3
# Copyright the maskfab authors. SPDX-License-Identifier: Apache-2.0
"""Referee of a plate: says whether a GDSII file is the plate that a job's text asks for, or what is not, and where.

    python3 referee.py                      in the unpacked folder of a package
    python3 referee.py FOLDER | PACKAGE.zip
    python3 referee.py JOB.json PLATE.gds [TEMPLATE.toml] [--version 0.2.0]
    python3 referee.py JOB.toml PLATE.gds [TEMPLATE.toml] [--version 0.2.0]

JOB.json is the resolved job; JOB.toml is its own text, with openings and maps beside it as it names them, and takes
Python 3.11. Its hash is not computed then, but taken as the title prints it. Exit code 0: it is this plate; 1: it is
not; 2: cannot tell. Any Python from 3.9 on runs it; it needs nothing else, and shares nothing with maskfab but rules:
docs/reference/layout.md, whose headings are named below. Lengths are whole nanometres, and nothing is compared but
exactly.

How two drawings are compared: the sum of the indicators of all polygons is known by its upright derivative, which lives
on edges that are not upright. Ends of edges are counted along each line, plus where an edge starts and minus where it
ends. Two drawings that are equal leave nothing, however they are cut into polygons, and no sorting is needed.
"""

import array
import copy
import hashlib
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
CUT = 2, 0  # a layer that is cut out of the data's, for houses that take no holes


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
        state, odd = ((drawn[i + 1] << 96) | (drawn[i] << 64) | (drawn[i + 3] << 32) | drawn[i + 2] for i in (0, 4))
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
            mask, j = (1 << i.bit_length()) - 1, i + 1
            while j > i:  # numpy shuffles by masked words, and draws integers after Lemire
                j = self.word() & mask
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
        flat = self.flat
        for x1, y1 in points:
            if y1 == y0:
                if x1 != x0:
                    start, end = x0 * SPAN + y0, x1 * SPAN + y1
                    flat[start] = flat.get(start, 0) + sign
                    flat[end] = flat.get(end, 0) - sign
            else:
                self.edge(x0, y0, x1, y1, sign)
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

    def points(self):
        """Ends of lying edges and their counts."""
        for key, count in self.flat.items():
            if count:
                yield ((key + HALF) // SPAN, (key + HALF) % SPAN - HALF), count

    def edges(self):
        """(x0, y0, x1, y1, count), x0 < x1: what fills the plane above it by its count."""
        lines = {}
        for (x, y), count in self.points():
            lines.setdefault((1, 0, y), {})[x] = count
        for (dx, dy, c), ends in [*lines.items(), *self.slant.items()]:
            before, weight = None, 0
            for x in sorted(x for x, count in ends.items() if count):
                if weight:
                    yield before, (c + dy * before) // dx, x, (c + dy * x) // dx, weight
                before, weight = x, weight + ends[x]

    def snapped(self, grid, mirrored):
        """Every corner on the nearest line, the upper of two; of x in the file's sense."""

        def near(at):
            return (2 * at + grid) // (2 * grid) * grid

        found = Sum()
        for x0, y0, x1, y1, count in self.edges():
            x0, x1 = (-near(-x) if mirrored else near(x) for x in (x0, x1))
            found.edge(x0, near(y0), x1, near(y1), count)
        return found

    def edge(self, x0, y0, x1, y1, count):
        if x0 == x1:
            return
        if y0 == y1:
            for x, sign in ((x0, count), (x1, -count)):
                self.flat[x * SPAN + y0] = self.flat.get(x * SPAN + y0, 0) + sign
            return
        dx, dy = x1 - x0, y1 - y0
        common = math.gcd(dx, dy) if dx > 0 else -math.gcd(dx, dy)
        dx, dy = dx // common, dy // common
        line = self.slant.setdefault((dx, dy, dx * y0 - dy * x0), {})
        line[x0] = line.get(x0, 0) + count
        line[x1] = line.get(x1, 0) - count

    def within(self, box):
        """The part with all ends in a box."""
        found, (x0, y0, x1, y1) = Sum(), box
        for edge in self.edges():
            if x0 <= edge[0] and edge[2] <= x1 and y0 <= min(edge[1::2][:2]) and max(edge[1::2][:2]) <= y1:
                found.edge(*edge)
        return found

    def thin_chrome(self, most):
        """Whether it is nothing but missing area, in which no square of more than ``most`` has room; and that area."""
        edges, tall, area = list(self.edges()), [], 0
        xs = sorted({x for edge in edges for x in (edge[0], edge[2])})
        for left, right in zip(xs, xs[1:]):
            here = []
            for x0, y0, x1, y1, count in edges:
                if x0 <= left and right <= x1:
                    low, high = (y0 + Fraction((x - x0) * (y1 - y0), x1 - x0) for x in (left, right))
                    here.append((low + high, low, high, count))
            here.sort()
            depth, until = 0, []
            for (_, low, high, count), (_, top, above, _) in zip(here, here[1:]):
                depth += count
                if depth not in (0, -1) or top < low or above < high:
                    return False, 0
                if depth:
                    area += Fraction((top - low + above - high) * (right - left), 2)
                    if max(top - low, above - high) > most:
                        bottom, end = min(low, high), max(top, above)
                        wide = [w for a, b, w in tall if min(b, end) - max(a, bottom) > 0]
                        until.append((bottom, end, max(wide, default=0) + right - left))
                        if until[-1][2] > most:
                            return False, 0
            tall = until
        return True, area

    def beside(self, raw, most):
        """Whether all are oblique edges, and no farther than ``most`` from one of a sum."""
        found = [(edge, Fraction(edge[3] - edge[1], edge[2] - edge[0])) for edge in raw.edges()]

        def near(x, y):
            return any(
                a - most <= x <= c + most and abs(b + (x - a) * slope - y) <= (1 + abs(slope)) * most
                for (a, b, c, _, _), slope in found
            )

        return all(y0 != y1 and near(x0, y0) and near(x1, y1) for x0, y0, x1, y1, _ in self.edges())

    def dark_modules(self, x, y, n, m):
        """Rows from above of the modules about a place, without the quiet zone of one.

        Two of three places of a module decide, for a bar of chrome may cross one of them.
        """
        left, below = x - n * m // 2, y - n * m // 2
        ends = sorted(
            (v, u, k) for (u, v), k in self.points() if abs(u - x) < (n + 2) * m // 2 and abs(v - y) < (n + 2) * m // 2
        )
        votes = [[0] * n for _ in range(n)]
        for eighths in (2, 4, 7):
            at, sums, inside = 0, {}, m * eighths // 8
            for j, row in enumerate(reversed(votes)):  # clear where the sum of all ends to the left and below is 1
                while at < len(ends) and ends[at][0] <= below + j * m + inside:
                    sums[ends[at][1]] = sums.get(ends[at][1], 0) + ends[at][2]
                    at += 1
                for i in range(n):
                    row[i] += sum(k for u, k in sums.items() if u <= left + i * m + inside) == 0
        return [[dark > 1 for dark in row[1:-1]] for row in votes[1:-1]]

    def left(self):
        """Points at which something is left."""
        for point, _ in self.points():
            yield point
        for (dx, dy, c), ends in self.slant.items():
            for x, count in ends.items():
                if count:
                    yield x, (c + dy * x) // dx


# --- The file (GDSII Stream Format, release 6.0) ---

ENDS = {
    0x0800: "BOUNDARY",
    0x0900: "PATH",
    0x0A00: "SREF",
    0x0B00: "AREF",
    0x0C00: "TEXT",
    0x1500: "NODE",
    0x2D00: "BOX",
}


def real8(data):
    """Excess-64 floating point: sign, exponent of 16, 56 bits."""
    mantissa = Fraction(int.from_bytes(data[1:8], "big"), 1 << 56)
    return (-1 if data[0] & 128 else 1) * mantissa * Fraction(16) ** ((data[0] & 127) - 64)


class Cell:
    def __init__(self):
        self.outlines = {}  # layer: places of XY records in the file
        self.calls = []  # name, turn (x' = a x + b y, y' = c x + d y), places


def read_gds(data):
    """Cells by name, and units; refuses what plates of maskfab never hold."""
    cells, cell, at, end = {}, None, 0, len(data)
    header = struct.Struct(">HH").unpack_from
    units = kind = name = called = number = layer = xy = None
    strans, angle, magnification, grid = 0, 0, 1, (1, 1)
    while at + 4 <= end:
        size, record = header(data, at)
        if size < 4 or at + size > end:
            raise CannotTell(f"the file breaks off at byte {at}")
        body = at + 4
        if record == 0x1003:
            xy = body, size
        elif record == 0x1100:
            if kind in (0x0800, 0x2D00):
                if data[xy[0] : xy[0] + 8] != data[xy[0] + xy[1] - 12 : xy[0] + xy[1] - 4]:
                    raise CannotTell(f"an outline that is not closed, in {name}")
                if layer not in cell.outlines:
                    cell.outlines[layer] = array.array("Q")
                cell.outlines[layer].append(xy[0])
            elif kind in (0x0A00, 0x0B00):
                flat = struct.unpack_from(f">{(xy[1] - 4) // 4}i", data, xy[0])
                cell.calls.append(call(called, strans, angle, magnification, grid, flat, kind == 0x0B00))
            elif kind in (0x0900, 0x1500):
                raise CannotTell(f"a {ENDS[kind]} in {name}, which no plate of maskfab holds")
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
            outlines = (
                [self.turned(at, turn) for at in self.cells[name].outlines[self.layer]]
                if len(self.cells[name].outlines[self.layer]) < 4096
                else None
            )
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
                far = all(x1 + x < a or c < x0 + x or y1 + y < b or d < y0 + y for a, b, c, d in boxes)
                if here == home(x1 + x, y1 + y) and (here < len(boxes) or far):
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

    def sum(self, share, into, sign):
        for item in share:
            if len(item) == 3:
                into.add(*item, sign)
            else:
                at, turn, x, y = item
                outline = self.turned(at, turn)
                into.polygon([(u + x, v + y) for u, v in outline] if x or y else outline, sign)


# --- layout.md, "Dies", and "What a cell shows" ---


class Opening:
    def __init__(self, text):
        read = toml(text)
        rows = [line.strip() for line in read["grid"].split("\n") if line.strip()]
        self.rows = [[mark == "#" for mark in row] for row in reversed(rows)]  # from below
        self.n = len(self.rows)
        if any(len(row) != self.n for row in self.rows):
            raise CannotTell("an opening that is not square")

    def shifted(self, right, up):
        found, n = copy.copy(self), self.n
        found.rows = [[self.rows[(r - up) % n][(c - right) % n] for c in range(n)] for r in range(n)]
        return found

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


def corner(inset):
    """What a line crossing adds, by the clear dots below it left and right, and above it: moves and counts."""
    e, join, table = abs(inset), max if inset < 0 else min, {}
    for number in range(16):
        a, b, c, d = near = [number >> k & 1 for k in range(4)]
        if e:  # the middles of sides, and of all, take part in the move
            q = (a, join(a, b), b), (join(a, c), join(near), join(b, d)), (c, join(c, d), d)
            ends = [
                ((2 * u - 1) * e, (2 * v - 1) * e, q[v + 1][u + 1] - q[v + 1][u] - q[v][u + 1] + q[v][u])
                for u in (0, 1)
                for v in (0, 1)
            ]
        else:
            ends = [(0, 0, d - c - b + a)]
        table[tuple(map(bool, near))] = [end for end in ends if end[2]]
    return table


def raster(rows, xs, ys, inset=0):
    """The sum of clear dots, rows from below, between the lines xs and ys; their edges moved inwards."""
    found, blank, ends = Sum(), [False] * len(rows[0]), corner(inset)
    below = [False, *blank, False]
    for y, row in zip(ys, [*rows, blank]):
        above = [False, *row, False]
        for x, *near in zip(xs, below, below[1:], above, above[1:]):
            for u, v, count in ends[tuple(near)]:
                key = (x + u) * SPAN + y + v
                found.flat[key] = found.flat.get(key, 0) + count
        below = above
    return found


def blue_noise(draw, rows, columns, openings):
    """layout.md, "Blue noise": opening and turn of each cell."""
    count, reach = rows * columns, 6
    cells = draw.permutation(i % (8 * openings) for i in range(count))
    kernel = {}
    for a in range(-reach, reach + 1):
        for b in range(-reach, reach + 1):
            key = a % rows, b % columns
            kernel[key] = kernel.get(key, 0) + round(2**20 * math.exp(-(a * a + b * b) / 4.5))
    del kernel[0, 0]

    def spread(sums, at, sign):
        i, j = divmod(at, columns)
        for (a, b), w in kernel.items():
            sums[(i + a) % rows * columns + (j + b) % columns] += sign * w

    field = [[0] * count for _ in range(8 * openings)]  # repulsion that a cell of each number would meet
    for at, number in enumerate(cells):
        spread(field[number], at, 1)
    for _ in range(6):
        changed = False
        for one in draw.permutation(range(count)):
            p, best, found = cells[one], 0, None
            for other in [draw.integer(count) for _ in range(24)]:
                q = cells[other]
                if q == p:
                    continue
                near = kernel.get(((one // columns - other // columns) % rows, (one - other) % columns), 0)
                gain = field[p][one] + field[q][other] - field[q][one] - field[p][other] + 2 * near
                if gain > best:
                    best, found = gain, other
            if found is not None:
                q, changed = cells[found], True
                for sums, at, sign in ((p, one, -1), (p, found, 1), (q, found, -1), (q, one, 1)):
                    spread(field[sums], at, sign)
                cells[one], cells[found] = q, p
        if not changed:
            break
    return [[divmod(cells[i * columns + j], 8) for j in range(columns)] for i in range(rows)]


class Die:
    """A die as the job asks for it: ``cells`` are opening and turn of each, rows from below."""

    def __init__(self, job, number):
        die, plate = job["die"][number], job["plate"]
        self.name, self.label, self.number = die["name"], die.get("label", ""), number
        self.dot, self.gutter, self.tiling = nm(die["dot"]), nm(die.get("gutter", "0 um")), die["tiling"]
        self.slot = nm(plate["die_size"])
        self.size = nm(die["size"]) if die.get("size") else self.slot
        count, pitch = len(job["die"]), nm(plate["die_pitch"])
        columns = min(plate["columns"], count)
        lines = -(-count // columns)
        self.x = -(columns - 1) * pitch // 2 + number % columns * pitch
        self.y = (lines - 1) * pitch // 2 - number // columns * pitch
        names = [die["opening"], *die.get("others", [])]
        seed, chart, shifts = die.get("seed"), None, None
        if die.get("map"):
            chart = toml(job["maps"][die["map"]])
            shifts = chart.get("shifts") or shifts
        texts = [job["openings"][name] for name in names]
        self.openings = [Opening(text) for text in texts]
        if shifts:
            self.openings = [self.openings[0].shifted(*shift) for shift in shifts]
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
        self.cells = self.drawn(rows, columns)
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

    def drawn(self, rows, columns):
        """Table of the tilings."""
        draw, tiling, openings = Random(self.seed), self.tiling, len(self.openings)
        if tiling == "blue_noise":
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
        chosen = draw.table(openings, rows, columns)  # of one nothing is drawn
        return [list(zip(*pair)) for pair in zip(chosen, turns)]

    def box(self, out=0):
        return self.left - out, self.below - out, self.left + self.width + out, self.below + self.height + out

    def sheet(self):
        """layout.md, "Hexagonal"."""
        d, n, self.cells = self.dot, self.n, []
        m, h = self.size // d, n * math.sqrt(3) / 2
        self.height = self.width = m * d
        self.left, self.below = self.x - self.width // 2, self.y - self.height // 2
        rows, columns = math.ceil(m / h) + 3, math.ceil(m / n) + 3
        turns, clear = Random(self.seed).table(6, rows, columns), self.openings[0].rows
        cosines, sines = ([f(k * math.pi / 3) for k in range(6)] for f in (math.cos, math.sin))
        self.dots = []
        for v in range(m):
            y, row = v + 0.5 - m / 2, []
            near = math.floor(y / h)
            for u in range(m):
                x, best = u + 0.5 - m / 2, None
                for i in (near, near + 1):
                    shift = i % 2 / 2
                    j = round(x / n - shift)
                    a, b = x - (j + shift) * n, y - i * h
                    if best is None or a * a + b * b < best[0]:
                        best = a * a + b * b, a, b, turns[(i + rows // 2) % rows][(j + columns // 2) % columns]
                _, a, b, k = best
                a, b = cosines[k] * a + sines[k] * b, cosines[k] * b - sines[k] * a
                a, b = math.floor(a + n / 2), math.floor(b + n / 2)
                row.append(0 <= a < n and 0 <= b < n and clear[b][a])
            self.dots.append(row)

    def take(self, into, inset=0):
        """Take what is asked for away from a sum, its edges moved inwards."""
        if not self.cells:
            xs, ys = ([at + k * self.dot for k in range(len(self.dots) + 1)] for at in (self.left, self.below))
            into.add(raster(self.dots, xs, ys, inset), 0, 0, -1)
            return
        half, turned = self.gutter // 2, {}
        if inset:  # dots of two cells meet
            for pair in {pair for row in self.cells for pair in row}:
                dots = self.openings[pair[0]].turned(pair[1])
                turned[pair] = [[*row, False] for row in [*dots, [False] * self.n]] if self.gutter else dots
            rows = [
                [dot for pair in row for dot in turned[pair][k]]
                for row in self.cells
                for k in range(len(turned[row[0]]))
            ]
            lines = [half + k * self.dot for k in range(self.n + bool(self.gutter))]
            counts = len(self.cells[0]), len(self.cells)
            xs, ys = (
                [at + j * self.pitch + k for j in range(count) for k in lines] + [at + count * self.pitch + half]
                for at, count in zip((self.left, self.below), counts)
            )
            into.add(raster(rows, xs, ys, inset), 0, 0, -1)
            return
        known = {}
        for i, row in enumerate(self.cells):
            for j, (opening, turn) in enumerate(row):
                if (opening, turn) not in known:
                    lines = [half + k * self.dot for k in range(self.n + 1)]
                    known[opening, turn] = raster(self.openings[opening].turned(turn), lines, lines)
                into.add(known[opening, turn], self.left + j * self.pitch, self.below + i * self.pitch, -1)


# --- layout.md, "Text" ---

LETTERS = """
0000000 4444404 AA00000 AAVAVAA 4FGE1U4 PP248JJ CIK8LID 4400000 2488842 8422248 04LEL40 044V440
0000048 000E000 0000004 11248GG EHJLPHE 4CK444V EH1248V EH161HE 26AIV22 VGU11HE 68GUHHE V124444
EHHEHHE EHHF12C 0040400 0040480 248G842 00V0V00 8421248 EH16404 EHNLNGF 4AHHVHH UHHUHHU EHGGGHE
UHHHHHU VGGUGGV VGGUGGG EHGNHHF HHHVHHH E44444E 1111HHE HHISIHH GGGGGGV HRLHHHH HHPLJHH EHHHHHE
UHHUGGG EHHHLID UHHUIHH EHGE1HE V444444 HHHHHHE HHHHHA4 HHHHLRH HHA4AHH HHA4444 V1248GV E88888E
GG84211 E22222E 4AH0000 000000V 8400000 6448446 4444444 C44244C 008L200
""".split()
PICTURES = dict(zip([chr(k) for k in range(32, 97)] + list("{|}~"), LETTERS))
HIGH, ADVANCE, BETWEEN = 28, 24, 4


def strokes(picture):
    """Tests of (x, y) in sixths of a step, y up, that are true inside some stroke of a letter."""
    squares = {(c, 6 - r) for r, row in enumerate(picture) for c in range(5) if int(row, 32) >> (4 - c) & 1}
    slants = {
        ((c, r), (c + s, r + 1))
        for c, r in squares
        for s in (1, -1)
        if (c + s, r + 1) in squares and (c + s, r) not in squares and (c, r + 1) not in squares
    }
    tests = []
    for square in squares:
        x, y = 24 * square[0] + 12, 24 * square[1] + 12
        sides = [(a, b) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1)) if (square[0] + a, square[1] + b) in squares]
        ends = sum(square in slant for slant in slants)
        cut = 18 if ends else 24
        if ends != 1 or sides:
            tests.append(lambda u, v, x=x, y=y, k=cut: abs(u - x) <= 12 >= abs(v - y) and abs(u - x) + abs(v - y) <= k)
        for a, b in sides if ends else ():  # whole up to the side that it shares
            tests.append(
                lambda u, v, x=x, y=y, a=a, b=b: 0 <= (u - x) * a + (v - y) * b <= 12 >= abs((u - x) * b + (v - y) * a)
            )
        for s, up in ((s, up) for s in (1, -1) for up in (1, -1)):  # half of each slanting stroke
            pair = (square, (square[0] + s, square[1] + up))
            if pair in slants or pair[::-1] in slants:
                low = 0 if ends != 1 or sides else -6
                tests.append(
                    lambda u, v, x=x, y=y, s=s, up=up, low=low: (
                        low <= s * (u - x) + up * (v - y) <= 24 and abs(s * (u - x) - up * (v - y)) <= 18
                    )
                )
    return tests


SIDES = ((0, -1), (1, 0), (0, 1), (-1, 0))


def inked(picture):
    """A letter's triangles: unit squares cut by both diagonals, by the side that each stands on, as in ``SIDES``."""
    tests, cells = strokes(picture), {}
    for x in range(20):
        for y in range(28):
            middles = ((6 * x + 3 + 2 * a, 6 * y + 3 + 2 * b) for a, b in SIDES)
            cells[x, y] = {i for i, (u, v) in enumerate(middles) if any(test(u, v) for test in tests)}
    filled = {}
    for (x, y), cell in cells.items():  # an inner edge of one step, between a slant and a wall
        for wall in range(4) if not cell else ():
            for end in ((wall + 1) % 4, (wall + 3) % 4):
                near = [cells.get((x + SIDES[k][0], y + SIDES[k][1]), ()) for k in (wall, end, (wall + 2) % 4)]
                if len(near[0]) == len(near[1]) == 4 and set(near[2]) == {end, (wall + 2) % 4}:
                    filled[x, y] = filled[x - SIDES[wall][0], y - SIDES[wall][1]] = {0, 1, 2, 3}
    return {**cells, **filled}


DRAWN = {}


def letter(mark):
    """The sum of a letter's outline, its step 1."""
    known = DRAWN
    if mark not in known:
        total, known[mark] = Sum(), Sum()
        for (x, y), cell in inked(PICTURES[mark]).items():
            corners = [(2 * x + a, 2 * y + b) for a, b in ((0, 0), (2, 0), (2, 2), (0, 2))]
            if len(cell) == 4:
                total.polygon(corners)
                continue
            for i in cell:
                total.polygon([corners[i], corners[(i + 1) % 4], (2 * x + 1, 2 * y + 1)])
        # Halved: what is left ends on whole steps.
        known[mark].flat = {key // 2: count for key, count in total.flat.items() if count}
        for (dx, dy, c), ends in total.slant.items():
            if ends := {x // 2: count for x, count in ends.items() if count}:
                known[mark].slant[dx, dy, c // 2] = ends
        known[mark].area2 = total.area2 // 4
    return known[mark]


def scaled(total, step):
    """A sum, larger."""
    found = Sum()
    found.flat = {key * step: count for key, count in total.flat.items()}
    found.slant = {
        (dx, dy, c * step): {x * step: n for x, n in ends.items()} for (dx, dy, c), ends in total.slant.items()
    }
    found.area2 = total.area2 * step * step
    return found


def width(text):
    """Of a line, in steps."""
    return max(0, ADVANCE * len(text.rstrip()) - BETWEEN)


def fitted(text, height, x, room=None):
    """Left end of a line about x, and its step."""
    steps = width(text)
    step = (2 * height + HIGH) // (2 * HIGH)
    if room is not None and steps * step > room:
        height = height * room // (steps * step)
        step = (2 * height + HIGH) // (2 * HIGH)
    return x - steps * step // 2, step


def line(text, height, x, y, room=None):
    """The sum of a line whose base line's middle is (x, y)."""
    text, total = text.rstrip().upper(), Sum()
    left, step = fitted(text, height, x, room)
    for i, mark in enumerate(text):
        total.add(scaled(letter(mark), step), left + ADVANCE * i * step, y)
    return total


# --- layout.md, "Marks": the data matrix (ISO/IEC 16022:2006, ECC 200) ---

SYMBOLS = (  # modules of a side, regions along it, data codewords, error codewords, blocks
    (10, 1, 3, 5, 1), (12, 1, 5, 7, 1), (14, 1, 8, 10, 1), (16, 1, 12, 12, 1), (18, 1, 18, 14, 1), (20, 1, 22, 18, 1),
    (22, 1, 30, 20, 1), (24, 1, 36, 24, 1), (26, 1, 44, 28, 1), (32, 2, 62, 36, 1), (36, 2, 86, 42, 1),
    (40, 2, 114, 48, 1), (44, 2, 144, 56, 1), (48, 2, 174, 68, 1), (52, 2, 204, 84, 2),
)  # fmt: skip


def edifact(words, at):
    """The text of codewords from ``at``, four letters in three, and where ASCII encodation goes on."""
    text = ""
    while len(words) - at > 2:
        four = int.from_bytes(bytes(words[at : at + 3]), "big")
        for k, shift in enumerate((18, 12, 6, 0), 1):
            value = four >> shift & 63
            if value == 31:
                return text, at + min(k, 3)
            text += chr(value if value & 32 else value | 64)
        at += 3
    return text, at


def decoded(words):
    """The text of data codewords in ASCII, C40, Text or EDIFACT encodation; None for any other, or for wrong pads."""
    shift2 = "!\"#$%&'()*+,-./:;<=>?@[\\]^_"
    text, at, mode, shift = "", 0, 0, 0
    while at < len(words):
        word = words[at]
        if not mode:
            at += 1
            if word == 129:
                pads = [129 + 149 * (k + 1) % 253 + 1 for k in range(at, len(words))]
                return text if words[at:] == [pad if pad <= 254 else pad - 254 for pad in pads] else None
            if 1 <= word <= 128:
                text += chr(word - 1)
            elif 130 <= word <= 229:
                text += f"{word - 130:02}"
            elif word in (230, 239):
                mode, shift = word, 0
            elif word == 240:
                more, at = edifact(words, at)
                text += more
            else:
                return None
            continue
        if word == 254 or at + 1 == len(words):
            mode, at = 0, at + (word == 254)
            continue
        three, at = word * 256 + words[at + 1] - 1, at + 2
        for k in (three // 1600, three // 40 % 40, three % 40):
            if shift == 0 and k < 3:
                shift = k + 1
                continue
            letters = "abcdefghijklmnopqrstuvwxyz" if mode == 239 else "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
            others = "`" + (letters.upper() if mode == 239 else letters.lower()) + "{|}~"
            table = (" " * 3 + " 0123456789" + letters, "", shift2, others)[shift]
            if shift == 1:
                text += chr(k)
            elif k < len(table):
                text += table[k]
            else:
                return None
            shift = 0
    return text


def codewords(text):
    """ASCII encodation: digits in pairs, all else one by one."""
    return [130 + int(part) if len(part) == 2 else ord(part) + 1 for part in re.findall(r"\d\d|.", text, re.DOTALL)]


def corrected(data, errors, blocks):
    """Data codewords with their check words behind them, Reed-Solomon over GF(256) of 0x12D."""
    power = [1]
    for _ in range(254):
        power.append(power[-1] << 1 ^ (0x12D if power[-1] & 128 else 0))
    log = {word: k for k, word in enumerate(power)}
    generator = [1]
    for k in range(1, errors // blocks + 1):
        generator = [a ^ (power[(log[b] + k) % 255] if b else 0) for a, b in zip([*generator, 0], [0, *generator])]
    checks = []
    for block in range(blocks):
        rest = [0] * (errors // blocks)
        for word in data[block::blocks]:
            first = word ^ rest[0]
            rest = [
                a ^ (power[(log[first] + log[b]) % 255] if first and b else 0)
                for a, b in zip([*rest[1:], 0], generator[1:])
            ]
        checks.append(rest)
    return data + [word for column in zip(*checks) for word in column]


def matrix(text, seen=None):
    """Dark modules of the smallest square symbol, rows from above; in the encodation that ``seen`` modules have, if
    they hold the text, for the standard leaves that free; None if they do not."""
    count = len(codewords(text))
    for row in SYMBOLS:
        if row[0] == len(seen) if seen else row[2] >= count:
            break
    side, regions, room, errors, blocks = row
    inner = side - 2 * regions
    part = inner // regions
    places = annex_f(inner)
    if seen:
        words = [0] * (room + errors)
        for (r, c), (word, bit) in places.items():
            if word < len(words) and seen[r // part * (part + 2) + 1 + r % part][c // part * (part + 2) + 1 + c % part]:
                words[word] |= 128 >> bit
        data = words[:room]
        if not re.fullmatch(
            re.escape(text) + f"[0-9a-f]{{{max(0, text.rindex(':') + 65 - len(text))}}}", decoded(data) or ""
        ):
            return None
    else:
        data = codewords(text)
        data += [129] * (len(data) < room)
        for k in range(len(data) + 1, room + 1):
            data.append((149 * k % 253 + 129) % 254 + 1)
    words = corrected(data, errors, blocks)
    rows = [[False] * side for _ in range(side)]
    for r in range(side):
        for c in range(side):
            u, v = r % (part + 2) - 1, c % (part + 2) - 1
            if v < 0 or u == part:
                rows[r][c] = True
            elif u < 0 or v == part:
                rows[r][c] = (c if u < 0 else r + 1) % 2 == 0
            else:
                word, bit = places.get((r // (part + 2) * part + u, c // (part + 2) * part + v), (None, None))
                if word is None:  # the corner that some sizes leave
                    rows[r][c] = (inner - r + c) % 2 == 0
                else:
                    rows[r][c] = bool(words[word] >> (7 - bit) & 1)
    return rows


def annex_f(n):
    """Codeword and bit (0 the highest) of each of n x n modules of the regions, after annex F."""
    table = {}

    def shape(places, word):
        for bit, (r, c) in enumerate(places):
            if r < 0:
                r, c = r + n, c + 4 - (n + 4) % 8
            if c < 0:
                r, c = r + 4 - (n + 4) % 8, c + n
            table[r, c] = word, bit

    corners = (
        [(n - 1, 0), (n - 1, 1), (n - 1, 2), (0, n - 2), (0, n - 1), (1, n - 1), (2, n - 1), (3, n - 1)],
        [(n - 3, 0), (n - 2, 0), (n - 1, 0), (0, n - 4), (0, n - 3), (0, n - 2), (0, n - 1), (1, n - 1)],
        [(n - 3, 0), (n - 2, 0), (n - 1, 0), (0, n - 2), (0, n - 1), (1, n - 1), (2, n - 1), (3, n - 1)],
        [(n - 1, 0), (n - 1, n - 1), (0, n - 3), (0, n - 2), (0, n - 1), (1, n - 3), (1, n - 2), (1, n - 1)],
    )
    utah = [(-2, -2), (-2, -1), (-1, -2), (-1, -1), (-1, 0), (0, -2), (0, -1), (0, 0)]
    word, r, c = 0, 4, 0
    while r < n or c < n:
        for hit, places in zip(
            (
                (r, c) == (n, 0),
                (r, c) == (n - 2, 0) and n % 4,
                (r, c) == (n - 2, 0) and n % 8 == 4,
                (r, c) == (n + 4, 2) and n % 8 == 0,
            ),
            corners,
        ):
            if hit:
                shape(places, word)
                word += 1
        while True:
            if r < n and c >= 0 and (r, c) not in table:
                shape([(r + u, c + v) for u, v in utah], word)
                word += 1
            r, c = r - 2, c + 2
            if not (r >= 0 and c < n):
                break
        r, c = r + 1, c + 3
        while True:
            if r >= 0 and c < n and (r, c) not in table:
                shape([(r + u, c + v) for u, v in utah], word)
                word += 1
            r, c = r + 2, c - 2
            if not (r < n and c >= 0):
                break
        r, c = r + 3, c + 1
    return table


# --- layout.md, "Marks" ---


def boxes(items, inset=0):
    """The sum of boxes' union, its edges moved inwards."""
    items = list(items)
    xs, ys = (sorted({each[k] for each in items for k in axis}) for axis in ((0, 2), (1, 3)))
    rows = [[any(a <= x < c and b <= y < d for a, b, c, d in items) for x in xs[:-1]] for y in ys[:-1]]
    return raster(rows, xs, ys, inset)


def cross(x, y, length, arm):
    h, w = length // 2, arm // 2
    return [
        (x - w, y - h, x + arm - w, y + length - h),
        (x - h, y - w, x - w, y + arm - w),
        (x + arm - w, y - w, x + length - h, y + arm - w),
    ]


def number(x):
    return f"{float(x):g}"


class Marks:
    """Marks of a plate by name, as sums."""

    def __init__(self, job, dies, template, version, digest, inset):
        self.job, self.dies, self.found, self.codes, self.inset = job, dies, {}, {}, inset
        self.texts = set()
        plate = job["plate"]
        source = template or plate
        self.blank, self.writable = (
            nm(plate.get("blank") or source["blank"]),
            nm(plate.get("writable") or source["writable"]),
        )
        self.f = self.feature()
        tone, side = job.get("order", {}).get("tone") or "clear", "down" if mirrored(job) else "up"
        self.version, self.digest = version, digest
        thickness = source.get("thickness")
        size = [self.blank, self.blank] + ([nm(thickness)] if thickness else [])
        titled = [(k, plate[k]) for k in ("serial",) if k in plate]
        self.lines = [
            f"maskfab {version} | job {digest[:16]}" + "".join(f" | {k} {v}" for k, v in titled),
            f"digitized data = {tone} | right reading, chrome {side} | "
            + " x ".join(number(Fraction(s, MM)) for s in size)
            + " mm",
        ]
        for die in dies:
            text = f"{die.name}  {die.label}" if die.label else die.name
            self.texts.add(f"LABEL_{die.name}")
            self.found[f"LABEL_{die.name}"] = line(text, 420_000, die.x, die.y - die.slot // 2 - 600_000, die.slot)
        for mark in template["mark"] if template else ():
            x, y = (nm(at) for at in mark["at"])
            w, h = (nm(at) for at in mark["room"])
            getattr(self, mark["kind"])(mark, x, y, w, h)
        if not template:
            self.plain()

    def feature(self):
        """f, in nanometres."""
        found = []
        for die in self.dies:
            runs = [run for opening in die.openings for run in opening.clear_runs(die.gutter)]
            found.append((1 if die.tiling == "hexagonal" else min(runs, default=1)) * die.dot)
        return min(50_000, *found) if found else 50_000

    def caption(self, mark, x, y, h, text, w):
        self.texts.add(f"{mark['name']}_TEXT")
        self.found[f"{mark['name']}_TEXT"] = line(f"{mark['name']}  {text}", 150_000, x, y - h // 2, w * 999 // 1000)

    def multiples(self, mark, x, y, h, w):
        text = ", ".join(number(m) for m in mark["multiples"])
        self.caption(mark, x, y, h, f"{number(Fraction(self.f, 1000))} um x {text}", w)
        return [(number(m).replace(".", "_"), round(Fraction(str(m)) * self.f)) for m in mark["multiples"]]

    def title(self, mark, x, y, w, h):
        high, small, room = nm(mark["height"]), nm(mark["small"]), w * 999 // 1000
        base = y + h - h // 2 - high
        total = line(self.job["job"].get("title") or self.job["job"]["name"], high, x, base, room)
        for i, text in enumerate(self.lines, 1):
            total.add(line(text, small, x, base - 2 * i * small, room), 0, 0)
        self.hash_at(self.lines[0], small, x, base - 2 * small, room)
        self.texts.add(mark["name"])
        self.found[mark["name"]] = total

    def hash_at(self, text, height, x, y, room):
        """Where the digits of the hash stand in a line."""
        (left, step), first = fitted(text, height, x, room), text.index("job ") + 4
        self.digits = [(left + ADVANCE * k * step, y, step) for k in range(first, first + 16)]

    def printed(self, drawn):
        """The digits of the hash as they are drawn."""
        found = ""
        for x, y, step in self.digits:
            here = drawn.within((x, y, x + (ADVANCE - BETWEEN) * step, y + HIGH * step))
            for digit in "0123456789abcdef":
                rest = scaled(letter(digit.upper()), step)
                rest.add(here, -x, -y, -1)
                if not any(rest.left()):
                    found += digit
        if len(found) != len(self.digits):
            raise CannotTell("the hash in the title cannot be read")
        return found

    def fiducial(self, mark, x, y, w, h):
        self.found[mark["name"]] = boxes(cross(x, y, nm(mark["length"]), nm(mark["line"])), self.inset)

    def alignment(self, mark, x, y, w, h):
        length, arm = nm(mark["length"]), nm(mark["line"])
        f, half, side = 3 * arm // 2, length // 2, length // 4
        ends = [
            (x - half, y - f, x - side, y - f + 3 * arm),
            (x + side, y - f, x - half + length, y - f + 3 * arm),
            (x - f, y - half, x - f + 3 * arm, y - side),
            (x - f, y + side, x - f + 3 * arm, y - half + length),
        ]
        self.found[mark["name"]] = boxes([*cross(x, y, 2 * side, arm), *ends], self.inset)

    def parity(self, mark, x, y, w, h):
        height = nm(mark["height"])
        s = height // 5
        self.f_at(mark["name"], x - 3 * s // 2, y - height // 2, s, height)

    def f_at(self, name, left, below, s, height):
        top = below + height
        self.found[name] = boxes(
            [
                (left, below, left + s, top),
                (left + s, top - s, left + 3 * s, top),
                (left + s, below + 2 * s, left + 2 * s, below + 3 * s),
            ],
            self.inset,
        )

    def cd_bars(self, mark, x, y, w, h):
        self.bars(mark["name"], self.multiples(mark, x, y, h, w), nm(mark["length"]), x, y)

    def bars(self, name, multiples, length, x, y):
        left = x - (2 * len(multiples) - 1) * 2 * length // 2
        for i, (called, wide) in enumerate(multiples):
            for j, axis in enumerate("XY"):
                u, v = (wide, length) if axis == "X" else (length, wide)
                at = left + (2 * i + j) * 2 * length
                self.found[f"{name}_{axis}_{called}X"] = boxes(
                    [(at - u // 2, y - v // 2, at - u // 2 + u, y - v // 2 + v)], self.inset
                )

    def row(self, sizes, x):
        """Left edges of figures in a row about x, 300 um between."""
        at = x - (sum(sizes) + 300_000 * (len(sizes) - 1)) // 2
        for size in sizes:
            yield at
            at += size + 300_000

    def line_space(self, mark, x, y, w, h):
        multiples, n = self.multiples(mark, x, y, h, w), mark["lines"]
        sides = [max(nm(mark["length"]), (2 * n - 1) * wide) for _, wide in multiples]
        for (called, wide), side, left in zip(multiples, sides, self.row(sides, x)):
            group = (2 * n - 1) * wide
            start = left + (side - group) // 2
            largest = max(sides)
            below = y - (2 * largest + 300_000) // 2 + (largest - side) // 2
            above = below + largest + 300_000
            self.found[f"{mark['name']}_V_{called}X"] = boxes(
                [(start + 2 * k * wide, above, start + (2 * k + 1) * wide, above + side) for k in range(n)], self.inset
            )
            start = below + (side - group) // 2
            self.found[f"{mark['name']}_H_{called}X"] = boxes(
                [(left, start + 2 * k * wide, left + side, start + (2 * k + 1) * wide) for k in range(n)], self.inset
            )

    def siemens_star(self, mark, x, y, w, h):
        n, radius = mark["spokes"], nm(mark["radius"])
        inner, total = self.f / (2 * math.sin(math.pi / (2 * n))), Sum()
        for k in range(n):
            low, high = (2 * math.pi / n * (k + q) for q in (-0.25, 0.25))
            places = ((radius, low), (radius, high), (inner, high), (inner, low))
            total.polygon(
                [(x + round(round(r * math.cos(t), 6)), y + round(round(r * math.sin(t), 6))) for r, t in places]
            )
        self.found[mark["name"]] = total
        self.caption(mark, x, y, h, f"{number(Fraction(self.f, 1000))} um inside", w)

    def checkerboard(self, mark, x, y, w, h):
        multiples, n = self.multiples(mark, x, y, h, w), mark["squares"]
        sides = [n * wide for _, wide in multiples]
        for (called, wide), side, left in zip(multiples, sides, self.row(sides, x)):
            below = y - side // 2
            rows = [[(i + j) % 2 == 0 for j in range(n)] for i in range(n)]
            xs, ys = [left + k * wide for k in range(n + 1)], [below + k * wide for k in range(n + 1)]
            self.found[f"{mark['name']}_{called}X"] = raster(rows, xs, ys, self.inset)

    def corners(self, mark, x, y, w, h):
        multiples = self.multiples(mark, x, y, h, w)
        sides = [6 * wide for _, wide in multiples]
        below = y - max(sides) // 2
        for (called, wide), side, left in zip(multiples, sides, self.row(sides, x)):
            self.found[f"{mark['name']}_{called}X"] = boxes(
                [(left, below, left + wide, below + side), (left + wide, below, left + side, below + wide)], self.inset
            )

    def data_matrix(self, mark, x, y, w, h):
        text, m = f"maskfab:{self.version}:{self.digest}", nm(mark["module"])
        self.codes[mark["name"]] = text, m, x, y
        if len(self.digest) == 64:
            self.code(mark["name"], matrix(text))

    def code(self, name, rows):
        _, m, x, y = self.codes[name]
        n = len(rows) + 2
        light = [[True] * n, *([True, *(not dark for dark in row), True] for row in reversed(rows)), [True] * n]
        xs, ys = ([at - n * m // 2 + k * m for k in range(n + 1)] for at in (x, y))
        self.found[name] = raster(light, xs, ys, self.inset)

    def read_codes(self, drawn):
        """Take each matrix in the encodation in which it is drawn, as far as it holds the text asked for."""
        for name, (text, m, x, y) in self.codes.items():
            for side, *_ in SYMBOLS:
                seen = drawn.dark_modules(x, y, side + 2, m)
                rows = matrix(text, seen) if seen else None
                if rows is not None:
                    self.code(name, rows)
                    break

    def die_map(self, mark, x, y, w, h):
        s, l = min(w, h), nm(mark["line"])

        def frame(x, y, side):
            left, below, half = x - side // 2, y - side // 2, side // 2 - l
            right, top = left + side, below + side
            if side < 8 * l:
                return [(left, below, right, top)]
            return [
                (left, below, left + l, top),
                (right - l, below, right, top),
                *((a, b, a + half - l, b + l) for b in (below, top - l) for a in (left + l, right - half)),
            ]

        total = boxes(frame(x, y, s))
        places = [(die.x * s // self.blank, die.y * s // self.blank, die.slot * s // self.blank) for die in self.dies]
        for u, v, side in places:
            total.add(boxes(frame(x + u, y + v, side)), 0, 0)
        pitch = nm(self.job["plate"]["die_pitch"]) * s // self.blank
        side = max(side for _, _, side in places)

        def highest(names):
            widest, room = max(width(name) for name in names), s // 2 - 2 * l
            inside = min(side - 4 * l, (side - 4 * l) * HIGH // widest)
            wide = min([Fraction(9 * pitch, 10), *(2 * (room - abs(u)) for u, _, _ in places)])
            high = min(
                [Fraction(3 * (pitch - side), 5), *(Fraction(2 * (room + v - side // 2), 3) for _, v, _ in places)]
            )
            under = math.floor(min(high, wide * HIGH / widest))
            return min(250_000, inside), min(250_000, under)

        for names in ([die.name for die in self.dies], [str(die.number + 1) for die in self.dies]):
            inside, under = highest(names)
            height = max(inside, under)
            if height >= 60_000:
                for name, (u, v, side) in zip(names, places):
                    middle = y + v - (0 if inside >= under else side // 2 + height)
                    total.add(line(name, height, x + u, middle - height // 2), 0, 0)
                break
        self.found[mark["name"]] = total

    def plain(self):
        """Marks of a plate without a template."""
        half = self.writable // 2
        room = self.writable - 8 * MM
        tone = self.job.get("order", {}).get("tone", "clear")
        total = line(self.job["job"].get("title") or self.job["job"]["name"], 1_500_000, 0, half - 2_750_000, room)
        second = f"{self.lines[0]} | digitized data = {tone}"
        total.add(line(second, 420_000, 0, half - 3_590_000, room), 0, 0)
        self.hash_at(second, 420_000, 0, half - 3_590_000, room)
        self.texts.add("TITLE")
        self.found["TITLE"] = total
        for u in (-1, 1):
            for v in (-1, 1):
                x, y = u * (half - 2 * MM), v * (half - 2 * MM)
                self.found[f"FIDUCIAL_{u}_{v}"] = boxes(cross(x, y, MM, 50_000), self.inset)
        left, below = -half + 6 * MM, -half + 2 * MM
        self.f_at("PARITY", left, below, 400_000, 2_000_000)
        self.bars("CD", [(str(m), m * self.f) for m in (1, 2, 5)], 500_000, 0, below)


# --- layout.md, "Order and data" ---


def digest_of(job):
    """SHA-256 of the resolved job as canonical JSON, without [report] and what [order] says on paper alone."""
    drawn = {key: part for key, part in job.items() if key not in ("report", "order")}
    order = {
        k: v for k, v in job.get("order", {}).items() if k in ("tone", "parity", "chrome") or (k, v) == ("bias", "data")
    }
    if order:
        drawn["order"] = order
    text = json.dumps(drawn, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


class Verdict:
    """What is wrong, and what was not judged."""

    def __init__(self):
        self.wrong, self.unjudged, self.unknown = [], [], []

    def left(self, total, what, box, die=None):
        """Name what a sum holds still, within a box (x0, y0, x1, y1) or anywhere."""
        points = [p for p in total.left() if box is None or (box[0] <= p[0] <= box[2] and box[1] <= p[1] <= box[3])]
        if points:
            x0, y0 = (min(axis) for axis in zip(*points))
            x1, y1 = (max(axis) for axis in zip(*points))
            where = f"between ({x0 / MM:.6f}, {y0 / MM:.6f}) and ({x1 / MM:.6f}, {y1 / MM:.6f}) mm"
            if die is not None and die.cells:
                wrong = {((y - die.below) // die.pitch, (x - die.left) // die.pitch) for x, y in points}
                row, column = min(wrong)
                where += (
                    f"; cells {len(wrong)} of {len(die.cells) * len(die.cells[0])}, the first row {row} column {column}"
                )
            self.wrong.append(f"{what}: {len(points)} corners are not as asked for, {where}")
        return points


def mirrored(job):
    """Whether the data hold the design mirrored about x = 0."""
    order = job.get("order", {})
    return (order.get("parity") == "wrong reading") != (order.get("chrome") == "down")


def house_grid(grids, own, dies):
    """The coarsest of a house's grids on which all dies lie; 1 where the job's own or 1 nm is among them."""
    lies = [at for die in dies for at in (die.left, die.below, die.width, die.dot, die.pitch, die.gutter // 2)]
    return 1 if own in grids or 1 in grids else max((g for g in grids if not any(at % g for at in lies)), default=1)


def check_units(units, verdict):
    wanted = real8(struct.pack(">Q", 0x3E4189374BC6A7F0)), real8(struct.pack(">Q", 0x3944B82FA09B5A54))
    near = [abs(a / b - 1) < Fraction(1, 10**12) for a, b in zip(units or (0, 0), wanted)]
    if not all(near):
        verdict.wrong.append(f"units: database and user unit {[float(u) for u in units or ()]}, not 0.001 and 1e-9 m")


def judge(job, template, version, data, manifest=None, shop=None):
    """A verdict, and what the plate is in a sentence."""
    verdict, shop = Verdict(), shop or {}
    order, export = job.get("order", {}), job.get("export", {})
    tone = order.get("tone") or "clear"
    bias = nm(job.get("process", {}).get("cd_bias", "0 um")) if order.get("bias") == "data" else 0
    if bias % 2:
        raise CannotTell(f"a bias of {bias} nm, which has no half")
    cells, units = read_gds(data)
    check_units(units, verdict)
    layer = (1, 0) if tone == "clear" else (3, 0)
    for other in sorted({layer for cell in cells.values() for layer in cell.outlines} - {layer, CUT}):
        if other[0] in (1, 3):
            verdict.wrong.append(
                f"layer {other[0]}/{other[1]}: holds shapes, and the tone is {tone} (layer {layer[0]}/0)"
            )
        else:
            verdict.unjudged.append(f"layer {other[0]}/{other[1]}, which is not written on the plate")
    dies = [Die(job, i) for i in range(len(job["die"]))]
    digest = digest_of(job) if "openings_read" not in job else "0" * 64
    if manifest and manifest.get("job_hash") not in (None, digest):
        verdict.wrong.append(f"job: its hash is {digest}, and the manifest says {manifest.get('job_hash')}")
    marks = Marks(job, dies, template, version, digest, bias // 2)
    regions = [die.box(max(0, -bias // 2)) for die in dies] if tone == "clear" else []
    drawings = [(Drawing(data, cells, each, mirrored(job)), sign) for each, sign in ((layer, 1), (CUT, -1))]
    shares = [(drawing, drawing.split(regions), sign) for drawing, sign in drawings]

    def drawn_in(region):
        total = Sum()
        for drawing, parts, sign in shares:
            drawing.sum(parts[region], total, sign)
        return total

    rest = drawn_in(-1)
    area2 = rest.area2
    half = marks.writable // 2
    if tone != "clear":
        dark, rest = rest, Sum()
        rest.box(-half, -half, marks.writable - half, marks.writable - half)
        area2 = rest.area2 - area2
        rest.add(dark, 0, 0, -1)
    if "openings_read" in job:
        digest = marks.printed(rest)
        marks = Marks(job, dies, template, version, digest, bias // 2)
        verdict.unjudged.append(f"the job's hash, which its text alone does not tell: the title says {digest}")
    bad = set()
    for i, die in enumerate(dies):
        total = drawn_in(i) if tone == "clear" else rest
        area2 += total.area2 if tone == "clear" else 0
        die.take(total, bias // 2)
        bad.update(
            verdict.left(total, f"die {die.name}", None if tone == "clear" else die.box(max(0, -bias // 2)), die)
        )
    marks.read_codes(rest)
    if set(marks.codes) - set(marks.found):
        verdict.wrong.append(f"data matrix: holds no maskfab:{version}:{digest}...")
    own = nm(export["grid"]) if export.get("grid") else 1
    drawn, grids = marks.found, 0
    for grid in (own, house_grid(shop.get("limits", {}).get("grid_nm", [1]), own, dies)):
        if grid > 1:
            grids += grid
            marks.found = {name: each.snapped(grid, mirrored(job)) for name, each in marks.found.items()}
    for each in marks.found.values():
        rest.add(each, 0, 0, -1)
    plate = shop.get("plate", {})
    if plate.get("corner_square_um"):
        side, (w, h) = round(1000 * plate["corner_square_um"]), (round(MM * at) for at in plate["extent_mm"])
        for x, y in ((x, y) for x in (-(w // 2), w - w // 2 - side) for y in (-(h // 2), h - h // 2 - side)):
            rest.box(x, y, x + side, y + side, -1)
    apart = shop.get("polygons", {}).get("shared_boundaries", True) is False
    bar = max(4000, round(2000 * shop.get("limits", {}).get("min_space_um", 0)))
    for name, each in marks.found.items():
        points = [p for p, _ in each.points()]
        if points:
            box = [f(axis) for f in (min, max) for axis in zip(*points)]
            if grids and name in marks.texts:  # a letter that is cut at its hole has a corner there that moves, too
                left = rest.within([box[0] - grids, box[1] - grids, box[2] + grids, box[3] + grids])
                if left.beside(drawn[name], grids):
                    rest.add(left, 0, 0, -1)
            if apart:
                left = rest.within(box)
                thin, area = left.thin_chrome(bar)
                if thin and area and (name not in marks.texts or 16 * area <= abs(each.area2)):
                    rest.add(left, 0, 0, -1)
            bad.update(verdict.left(rest, f"mark {name}", box))
    stray = Sum()
    stray.flat = {x * SPAN + y: 1 for x, y in rest.left() if (x, y) not in bad}
    verdict.left(stray, "plate", None)
    side = "chrome side" if not mirrored(job) else "glass side"
    share = area2 / 2 / marks.writable**2
    kind = "openings in the chrome" if tone == "clear" else "chrome"
    share = share if tone == "clear" else 1 - share  # of the chrome
    said = (
        f"seen from the {side}, F reads right; digitized data = {tone}: the drawn polygons are the {kind}, "
        f"they are {100 * share:.3f} % of the writable area of {marks.writable / MM:g} mm"
    )
    return verdict, said


# --- The package ---


def content(path):
    with open(path, "rb") as file:
        return file.read()


def files_of(path):
    """Files of a folder or of a zip, by their plain names."""
    if os.path.isdir(path):
        paths = {name: os.path.join(path, name) for name in os.listdir(path)}
        return {name: content(each) for name, each in paths.items() if os.path.isfile(each)}
    with zipfile.ZipFile(path) as archive:
        return {name.rpartition("/")[2]: archive.read(name) for name in archive.namelist() if not name.endswith("/")}


def raw_job(path):
    """A job's own text, as far as drawing goes, as its resolved one; its hash needs what is written out there."""
    try:
        import tomllib
    except ImportError:
        raise CannotTell("a raw job.toml is read by Python from 3.11 on; use the resolved job.json") from None
    job, folder = tomllib.loads(content(path).decode()), os.path.dirname(path)
    job.update(openings={}, maps={}, openings_read=True)
    for die in job["die"]:
        die.setdefault("tiling", "periodic")
        for name in [die["opening"], *die.get("others", [])]:
            job["openings"][name] = content(os.path.join(folder, name)).decode()
        if die.get("map"):
            job["maps"][die["map"]] = content(os.path.join(folder, die["map"])).decode()
        if "gutter" not in die and "pitch" in die:
            dots = Opening(job["openings"][die["opening"]]).n
            die["gutter"] = f"{nm(die['pitch']) - dots * nm(die['dot'])} nm"
    return job


def main(args):
    version = None
    if "--version" in args:
        at = args.index("--version")
        version = args[at + 1]
        del args[at : at + 2]
    try:
        if len(args) >= 2:
            files = {name: content(path) for name, path in zip(("job.json", "plate.gds", "template.toml"), args)}
            beside = os.path.join(os.path.dirname(args[0]), "manifest.json")
            manifest = json.loads(content(beside)) if os.path.isfile(beside) else {}
        else:
            files = files_of(args[0] if args else os.path.dirname(os.path.abspath(__file__)))
            manifest = json.loads(files.get("manifest.json", b"{}"))
        version = version or manifest.get("maskfab_version") or "0.2.0"
        job = raw_job(args[0]) if args and args[0].endswith(".toml") else json.loads(files["job.json"])
        template = toml(files["template.toml"].decode()) if "template.toml" in files else None
        if job["plate"].get("template") and template is None:
            raise CannotTell(f"the plate's template {job['plate']['template']} is not here (template.toml)")
        shop = toml(files["shop.toml"].decode()) if "shop.toml" in files else {}
        plates = [name for name in files if name.lower().endswith(".gds")]
        if len(plates) != 1:
            raise CannotTell(f"{len(plates)} GDSII files here; this file reads one, and no other format")
        verdict, said = judge(job, template, version, files[plates[0]], manifest if len(args) < 2 else None, shop)
        for row in manifest.get("files", []) if len(args) < 2 else []:
            held = files.get(row["path"])
            if held is None or hashlib.sha256(held).hexdigest() != row["sha256"]:
                verdict.wrong.append(f"file {row['path']}: is not what the manifest lists")
    except (
        CannotTell,
        LookupError,
        ValueError,
        AttributeError,
        TypeError,
        OSError,
        struct.error,
        zipfile.BadZipFile,
    ) as error:
        print(f"CANNOT TELL: {error!r}" if not isinstance(error, CannotTell) else f"CANNOT TELL: {error}")
        return CANNOT
    for text in verdict.wrong:
        print(f"WRONG {text}")
    for text in verdict.unjudged:
        print(f"not judged: {text}")
    print(said)
    if verdict.wrong:
        print("this plate is NOT what this text asks for")
        return WRONG
    for text in verdict.unknown:
        print(f"CANNOT TELL: {text}")
    print("all else is what this text asks for" if verdict.unknown else "this plate is what this text asks for")
    return CANNOT if verdict.unknown else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
