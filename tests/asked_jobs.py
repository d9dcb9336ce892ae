"""Small jobs that between them use every rule by which a plate is laid out and drawn."""

from __future__ import annotations

import tomllib
from pathlib import Path

from maskfab.job.read import validate
from maskfab.mask.job import Job, resolve

LETTER = "......\n.#....\n.#....\n.##...\n.####.\n......"
OTHER = "......\n......\n.##...\n.#..#.\n......\n......"
_JOB = """
[job]
name = "SMALL"
title = "a small plate, (test) 100%"
[camera]
focal = "10 mm"
stop = {{ shape = "circle", diameter = "0.3 mm" }}
wavelengths = ["530 nm"]
pixel = "2 um"
[plate]
{plate}
die_size = "{size}"
die_pitch = "9.001 mm"
columns = 2
{dies}
{more}
[openings]
L = \"\"\"
name = "l"
pitch = "48 um"
dots = 6
grid = '''
{LETTER}
'''
\"\"\"
M = \"\"\"
name = "m"
pitch = "48 um"
dots = 6
grid = '''
{OTHER}
'''
\"\"\"
"""
_DIE = """
[[die]]
name = "D{number}"
label = "die {number}"
opening = "L"
dot = "8 um"
{rest}
"""
_MAPS = '''
[maps]
X = """
name = "x"
map = \'\'\'
012
345
670
\'\'\'
"""
Y = """
name = "y"
shifts = [[0, 0], [1, 0], [-1, 1]]
map = \'\'\'
0123
3452
\'\'\'
openings = \'\'\'
0120
1202
\'\'\'
"""
'''
RANDOM = 'tiling = "random"\nseed = 3'
GUTTER = f'{RANDOM}\ngutter = "3 um"'
_TURNED = '[order]\nparity = "wrong reading"\n'
_PROCESS = '[process]\ncd_bias = "{} um"\n'

JOBS = {
    "without a template": {
        "plate": 'blank = "5 in"\nwritable = "100 mm"',
        "dies": [
            f'tiling = "{each}"\nseed = 1' for each in ("random", "periodic", "paper4", "flips", "rot90", "rot90flip")
        ],
    },
    "tilings": {
        "dies": [
            GUTTER,
            'tiling = "blue_noise"\nseed = 5',
            'tiling = "hexagonal"\nseed = 2',
            'tiling = "random"\nseed = 1\nothers = ["M"]',
            'tiling = "blue_noise"\nseed = 1\nothers = ["M"]\ngutter = "2 um"',
            'tiling = "periodic"\nothers = ["M"]\nseed = 9\nsize = "0.4 mm"',
        ]
    },
    "maps": {"dies": [f'tiling = "map"\nmap = "{each}"\nseed = 4' for each in "XY"], "more": _MAPS},
    "odd sizes, mirrored": {"dies": [RANDOM] * 3, "size": "0.501 mm", "more": _TURNED},
    "coarse grid": {"dies": [RANDOM], "more": '[export]\ngrid = "100 nm"\n'},
    "coarse grid, mirrored": {"dies": [RANDOM], "more": f'[export]\ngrid = "100 nm"\n{_TURNED}'},
    "dark through the glass": {"dies": [RANDOM, GUTTER], "more": '[order]\ntone = "dark"\nchrome = "down"\n'},
    "narrowed data": {"dies": [RANDOM, GUTTER], "more": f'[order]\nbias = "data"\n{_PROCESS.format(0.2)}'},
    "widened dark data, mirrored": {
        "dies": [RANDOM, GUTTER],
        "more": f'{_TURNED}tone = "dark"\nbias = "data"\n{_PROCESS.format(-0.2)}',
    },
    "merged": {"dies": [RANDOM], "more": '[export]\nhierarchy = "merged"\ncorners = "joined"\n'},
    "merged dark": {"dies": [RANDOM] * 2, "more": '[export]\nhierarchy = "merged"\n[order]\ntone = "dark"\n'},
    "flat": {"dies": [RANDOM], "more": '[export]\nhierarchy = "flat"\nholes = "keyhole"\nmax_vertices = 200\n'},
    "pairs of cells": {"dies": [RANDOM], "more": '[export]\nholes = "trapezoids"\nmax_references = 60\n'},
}


RIM = (LETTER, "##....\n......\n......\n......\n......\n....##")
"""Drawings of an opening, and of one that is clear at its rim, to stand in its place."""
PERIODIC = 'tiling = "periodic"'


def _named(*names):
    return [(f'name = "D{number}"', f'name = "{name}"') for number, name in enumerate(names)]


JOBS |= {
    "names side by side": {
        "dies": [PERIODIC] * 2,
        "size": "6 mm",
        "edits": [*_named("GRID4", "GRIDX"), ("9.001 mm", "12 mm")],
    },
    "numbers in the map": {"dies": [PERIODIC] * 40, "edits": [("columns = 2", "columns = 7"), ("9.001 mm", "6 mm")]},
    "odd dots": {"dies": [PERIODIC], "edits": [('dot = "8 um"', 'dot = "8.001 um"'), ('"48 um"', '"48.006 um"')]},
    "clear rims widened": {
        "dies": [GUTTER],
        "more": f'[order]\nbias = "data"\n{_PROCESS.format(-2.9)}',
        "edits": [RIM],
    },
    "one opening all clear": {
        "dies": ['tiling = "random"\nseed = 1\nothers = ["M"]'],
        "edits": [(OTHER, "\n".join(["######"] * 6))],
    },
    "spaces at the end": {"dies": [PERIODIC] * 2, "size": "2 mm", "edits": [('"die 0"', f'"x{39 * " "}"')]},
    "no title": {"dies": [PERIODIC], "edits": [('"a small plate, (test) 100%"', '"   "')]},
}


def asked_job(dies=(RANDOM, GUTTER), plate='template = "5in"', size="0.5 mm", more="", edits=()) -> Job:
    """A job of 6 dots a cell and ten cells a die; edits are pairs of what stands in its text, and what shall."""
    drawn = "".join(_DIE.format(number=number, rest=rest) for number, rest in enumerate(dies))
    text = _JOB.format(LETTER=LETTER, OTHER=OTHER, plate=plate, size=size, more=more, dies=drawn)
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    return resolve(validate(tomllib.loads(text), where="job.toml"), Path("job.toml"))
