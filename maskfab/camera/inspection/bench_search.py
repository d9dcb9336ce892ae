"""Which values of the bench a capture asks for, beside those of die and lens, and where the search for them begins.

A value that is small bends the picture as its slope says, so residuals tell by the equations of one step what it would
bring. A light that is no point, a die off the axis, or a barrel that vignettes widen the picture, as errors of the lens
do; left out, they come out as many errors that the lens does not have, and as a CD bias. So one of them is taken in
before further terms if it explains more than all of those together, and after them if residuals ask for it still.

Slopes of a die's place are straight within a dot. Farther off, chi² falls with the area before the stop that is the
die's own, from wherever one comes: steps along both axes, wide ones first, find the place. So with the depth and the
direction to which a barrel cuts the light.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from maskfab.base.model import Tiling
from maskfab.base.work import Progress, silent
from maskfab.camera.inspection.bench import (
    AXIAL,
    AXIAL_BEND,
    BANDS,
    CUT,
    CUT_BEND,
    FULL,
    LATERAL,
    LIGHTS,
    PLACE,
    STEPS,
    STOP,
)
from maskfab.camera.inspection.die_image import DieImage, Setting, gathered
from maskfab.camera.inspection.fit import (
    FIRST_TERMS,
    Fit,
    NormalEquations,
    Taken,
    fitted,
    judged,
    most_noise,
    normal_equations,
    with_lacking_terms,
    with_terms,
)

_WIDEST_UM, _FINEST_UM = 256.0, 1.0
_FARTHEST_UM, _STOP_SHARE = 1000.0, 0.1
_PER_PERIOD = 4
_DEMANDED = 25.0
"""Fall of chi², over the noise that is left, from which a value is another than stated."""
_PLACE_DEMANDED = 13.0
_EXPLAINED = 0.25
"""Share of what is left over that a value must explain: of a model that is wrong otherwise it explains little."""
_ROUNDS = 6
_BENDS = (1.0, 0.7)
_CUT_STEPS = 8
_REACH_UM = 45.0


def place_found(image: DieImage, taken: Sequence[Taken], setting: Setting) -> Setting:
    """A setting with the place of the die before the stop, to about a micrometre; as it was where none explains.

    A light that is no point is told first where that explains more.
    """
    fit = judged(taken, image.pictures(setting), setting)
    if fit.chi2 / fit.freedom <= most_noise(fit):
        return setting
    found = _placed(image, taken, setting)
    if found == setting:
        wide = _begun(image, taken, setting, LIGHTS[:1])
        if _explains(image, taken, setting, wide):
            found = _placed(image, taken, wide)
    return found


def _placed(image: DieImage, taken: Sequence[Taken], setting: Setting) -> Setting:
    panel, widest = image.panel, _WIDEST_UM
    if panel.tiling is Tiling.PERIODIC:
        widest = min(widest, panel.cell_size.pitch_um / _PER_PERIOD)
    bench = dict(setting.bench)
    start = setting.beside({name: bench.get(name, 0.0) for name in (*PLACE, STOP)})
    found = _steps(image, taken, start, (*PLACE, STOP), widest)
    if not _explains(image, taken, setting, found):
        return setting
    return replace(found, bench=tuple((name, value) for name, value in found.bench if value or name in PLACE))


def _explains(image: DieImage, taken: Sequence[Taken], before: Setting, after: Setting) -> bool:
    """Whether a setting leaves far less than another: of another die's picture some place explains a little."""
    one, other = (judged(taken, image.pictures(at), at) for at in (before, after))
    return one.chi2 - other.chi2 > max(_PLACE_DEMANDED, _EXPLAINED * (one.chi2 - one.freedom))


def _steps(image: DieImage, taken: Sequence[Taken], start: Setting, names: Sequence[str], step: float) -> Setting:
    """The best setting that steps along values of the bench lead to, each halved where none leads on."""

    def chi2(at: Setting) -> float:
        return judged(taken, image.pictures(at), at).chi2

    panel, diameter_um = image.panel, image.camera.stop.diameter_um
    # A die that has left the stop makes no picture.
    farthest = dict.fromkeys(names, min(_FARTHEST_UM, min(panel.orientations.shape) * panel.cell_size.pitch_um / 2))
    farthest[STOP] = _STOP_SHARE * diameter_um
    best = chi2(start)
    while step >= _FINEST_UM:
        bench = dict(start.bench)
        tried = [start.beside({name: bench[name] + sign * step}) for name in names for sign in (1, -1)]
        near = (each for each in tried if all(abs(dict(each.bench)[name]) <= farthest[name] for name in names))
        least, there = min(((chi2(each), each) for each in near), key=lambda pair: pair[0], default=(best, start))
        if least < best:
            best, start = least, there
        else:
            step /= 2
    return start


def gain_of_others(image: DieImage, taken: Sequence[Taken], fit: Fit) -> float:
    """The most that chi² would fall if all errors of the lens, or else one fault of the bench, were fitted too."""
    now, groups, terms = _asked(image, taken, fit, lens=True)
    held = [*range(fit.setting.values.size)]
    return max(now.gain([*held, *each]) for each in (*groups.values(), terms)) - now.gain(held)


def _asked(
    image: DieImage, taken: Sequence[Taken], fit: Fit, *, lens: bool
) -> tuple[NormalEquations, dict[tuple[str, ...], list[int]], list[int]]:
    """The equations of a step with all that a fit lacks: places in them of what the bench may be, and of terms."""
    present = {name for name, _ in fit.setting.bench}
    several = len({float(line) for lines in image.light.values() for line in lines.wavelengths_nm}) > 1
    groups: list[tuple[str, ...]] = [PLACE, (STOP,), *((kind[0],) for kind in (LIGHTS, BANDS) if not present & {*kind})]
    if several and len(image.light) > 1:
        groups += [(AXIAL,), LATERAL] + ([(AXIAL_BEND,)] if len(image.light) > 2 and AXIAL in present else [])
    groups = [group for group in groups if not present & {*group}]
    wide = (with_lacking_terms(fit.setting) if lens else fit.setting).beside(
        {name: 0.0 for group in groups for name in group}
    )
    slopes = dict(zip(wide.names, image.slopes(wide), strict=True))
    asked = [name for group in groups for name in group]
    terms = [name for name in wide.names if name not in fit.setting.names and name not in asked]
    names = [*fit.setting.names, *asked, *terms]
    now = normal_equations(taken, image.pictures(fit.setting), [slopes[name] for name in names])
    first = len(fit.setting.names)
    places = {}
    for group in groups:
        places[group] = [*range(first, first + len(group))]
        first += len(group)
    return now, places, [*range(first, len(names))]


def _wanted(image: DieImage, taken: Sequence[Taken], fit: Fit, *, lens: bool) -> tuple[tuple[str, ...], bool]:
    """Values of the bench that bring most; none if that is too little, or with ``lens`` less than all terms do; and
    whether they bring enough by themselves."""
    now, groups, terms = _asked(image, taken, fit, lens=lens)
    held = [*range(fit.setting.values.size)]
    gains = {group: now.gain([*held, *places]) - now.gain(held) for group, places in groups.items()}
    group = max(gains, key=lambda each: gains[each])
    noise, left_over = max(1.0, fit.chi2 / fit.freedom), fit.chi2 - fit.freedom
    least = _PLACE_DEMANDED if group == PLACE else _DEMANDED
    share = 0.0 if group == PLACE else _EXPLAINED
    if gains[group] < max(least * noise, share * left_over):
        return (), False
    widens = group[0] not in FULL or float(now.covariance[groups[group][0]] @ now.gradient) > 0
    if not widens:
        return (), False
    least = now.gain([*held, *terms]) - now.gain(held) if lens else 0.0
    return (group if gains[group] >= least else ()), True


def with_bench_and_terms(image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress = silent) -> Fit:
    """The fit with all of the bench and the lens that residuals ask for."""
    # A light that was begun with while the die was told has had no other shape yet.
    fit = _asked_for(image, taken, _of_better_shape(image, taken, fit, progress), progress)
    for searched in (_with_cut, _with_place):
        if fit.chi2 / fit.freedom <= most_noise(fit):
            break
        begun = searched(image, taken, fit, progress)
        if begun is not None:
            further = _asked_for(image, taken, begun, progress)
            fit = further if further.chi2 < fit.chi2 else fit
    return _without_idle(image, taken, fit, progress)


def _asked_for(image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress) -> Fit:
    for lens in (True, False):
        for _ in range(_ROUNDS):
            wanted, some = _wanted(image, taken, fit, lens=lens)
            if not wanted:
                break
            more = fitted(image, taken, _begun(*_middle(image, taken), fit.setting, wanted), progress)
            if more.chi2 >= fit.chi2:
                break
            fit = _of_better_shape(image, taken, more, progress)
            if not lens:
                fit = with_terms(image, taken, fit, progress)
        if lens:
            wide = with_terms(image, taken, fit, progress)
            if wide is fit and not wanted and not some:
                break
            fit = wide
    return fit


def _middle(image: DieImage, taken: Sequence[Taken]) -> tuple[DieImage, list[Taken]]:
    """The pixels about the light, and the image of them: a search needs no more."""
    near = [capture.within(_REACH_UM) for capture in taken]
    few = {colour: gathered(lines, image.camera, _REACH_UM) for colour, lines in image.light.items()}
    pixels = [capture.pixels for capture in near]
    return DieImage.of(image.panel, image.way_round, image.camera, few, pixels), near


def _with_place(image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress) -> Fit | None:
    found = place_found(*_middle(image, taken), fit.setting)
    return None if found == fit.setting else fitted(image, taken, found, progress)


def _with_cut(image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress) -> Fit | None:
    terms = tuple((term, 0.0) for term in FIRST_TERMS)
    fresh = replace(fit.setting, terms=terms, bias_um=0.0, turn_rad=0.0, scale=0.0)
    found = cut_found(*_middle(image, taken), fresh)
    return None if found == fresh else fitted(image, taken, found, progress)


def cut_found(image: DieImage, taken: Sequence[Taken], setting: Setting) -> Setting:
    """A setting with a barrel that cuts the light, if one explains much of what is left; else as it was."""
    fit = judged(taken, image.pictures(setting), setting)
    if fit.chi2 / fit.freedom <= most_noise(fit) or CUT_BEND in dict(setting.bench):
        return setting
    tried = []
    for bend in _BENDS:
        start = setting.beside({**dict.fromkeys(CUT[:2], 0.0), CUT_BEND: bend})
        found = _steps(image, taken, start, CUT[:2], image.camera.stop.diameter_um / _CUT_STEPS)
        tried.append((judged(taken, image.pictures(found), found).chi2, found))
    _, found = min(tried, key=lambda pair: pair[0])
    return found if _explains(image, taken, setting, found) else setting


def _begun(image: DieImage, taken: Sequence[Taken], at: Setting, names: Sequence[str]) -> Setting:
    """A setting with more values, from which steps lead on; a variance is doubled as long as that explains more."""
    start = at.beside({name: STEPS[name] if name in FULL else 0.0 for name in names})
    if names[0] not in FULL:
        return start
    best, tried = math.inf, start
    while (found := judged(taken, image.pictures(tried), tried).chi2) < best:
        best, start = found, tried
        tried = tried.beside({names[0]: 2 * dict(tried.bench)[names[0]]})
    return start


def _of_better_shape(image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress) -> Fit:
    """The fit with a light or a band of the other shape, if that is nearer to what was taken."""
    for kind in (LIGHTS, BANDS):
        for name, _ in fit.setting.bench:
            if name not in kind:
                continue
            other = kind[1 - kind.index(name)]
            renamed = tuple((other if each == name else each, size) for each, size in fit.setting.bench)
            rival = fitted(image, taken, replace(fit.setting, bench=renamed), progress)
            fit = rival if rival.chi2 < fit.chi2 else fit
    return fit


def _without_idle(image: DieImage, taken: Sequence[Taken], fit: Fit, progress: Progress) -> Fit:
    """The fit without values of the bench that are not told from what is stated."""
    errors = fit.errors
    idle = {
        name for name, value in fit.setting.bench if name not in CUT and value**2 < _PLACE_DEMANDED * errors[name] ** 2
    }
    idle -= set() if idle >= {*PLACE} else {*PLACE}
    if not idle:
        return fit
    kept = tuple(pair for pair in fit.setting.bench if pair[0] not in idle)
    return fitted(image, taken, replace(fit.setting, bench=kept), progress)
