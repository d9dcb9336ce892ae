#!/usr/bin/env bash
# gerbonara passes over the rotation, mirroring and scaling of apertures (LR, LM, LS) and draws them upright.
# 
# Version: gerbonara 1.5.0.
# Guess: what it does not know it refuses, or it knows them: they are in the format since 2016.
# Seen: one SyntaxWarning each ("Unknown statement found ... ignoring"), which Python shows once, and the flash as it was:
# 1 x .2 mm in place of .4 x 2 mm.
# Matters to: step files of steppers and rotated flashes; turn warnings into errors before you read.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv own
own/bin/pip install --quiet --disable-pip-version-check gerbonara==1.5.0
own/bin/python - <<'END'
import warnings

from gerbonara import GerberFile
from gerbonara.utils import MM

with open("turned.gbr", "w") as file:
    file.write("%FSLAX46Y46*%\n%MOMM*%\n%ADD10R,1X0.2*%\nD10*\n%LR90*%\n%LS2*%\nX0Y0D03*\nM02*\n")
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    (x0, y0), (x1, y1) = GerberFile.open("turned.gbr").bounding_box(MM)
print(f"{x1 - x0:g} x {y1 - y0:g} mm of .4 x 2 mm;", *(str(each.message) for each in said))
assert (x1 - x0, y1 - y0) == (1, 0.2) and len(said) == 2 and all("ignoring" in str(each.message) for each in said)
END
