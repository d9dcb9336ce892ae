#!/usr/bin/env bash
# ezdxf's `path.make_path(entity).flattening(distance)` does not keep to the distance for circles, arcs and bulges.
# 
# Version: ezdxf 1.4.5.
# Guess: no point of the polygon is farther from the curve than `distance`.
# Seen: a path holds cubic Bezier curves, of which a quarter circle is 2.7e-4 of its radius off; a rational spline of the
# exact circle 3.5e-4. For a radius of 50 mm that is 14 and 18 um, at any distance. The entity's own `flattening`
# keeps to it.
# Matters to: whoever takes DXF of rings, lenses and round blanks through paths, as most recipes do.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check ezdxf==1.4.5
own/bin/python - <<'END'
import math

import ezdxf
from ezdxf import path

space = ezdxf.new("R2010", units=4).modelspace()
half = math.sqrt(0.5)
corners = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
spline = space.add_rational_spline(
    [(50 * x, 50 * y) for x, y in corners], [1, half] * 4 + [1], degree=2, knots=[0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
)
circle = space.add_circle((0, 0), 50)


def off_circle(points):
    return max(abs(point.magnitude - 50) for point in points)


for entity, least in ((circle, 2.7e-4), (spline, 3.5e-4)):
    for distance in (1e-2, 1e-3, 1e-4):
        by_path = off_circle(path.make_path(entity).flattening(distance)) / 50
        by_entity = off_circle(entity.flattening(distance)) / 50
        print(f"{entity.dxftype()} at {distance} mm: vertices off by {by_path:.2e} of the radius by its path, {by_entity:.0e} by itself")
        assert least < by_path < 1.1 * least and by_entity < 1e-12
END
