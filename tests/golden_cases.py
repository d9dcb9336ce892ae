"""The cases of the golden set, and what of their answers no two runs share.

A case is named GROUP/WHAT by what it shows, not by its verb; its command stands here and nowhere else.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

DROPPED = {"timing.json": "how long each stage took, on which machine, and what was kept since when"}
"""Files of which only the presence is recorded, and why."""

MEASURED = re.compile(
    r"\.versions"  # of a manifest: Python and libraries, which golden/environment.json states once
    # Of a forecast, by a probe of this machine and its cores.
    r"|\.stages\[\]\.(seconds|longest_s|each_s)|\.total\.(seconds|wall_s|all_bytes|chain_s)|\.on_cores|\.processes"
    r"|\.time|\.fit\.seconds"  # of a design: what its search took
    r"|\.history"  # of a network: as many looks at it as its time allows
    # Of a run: a kept finding is known by the module that found it, the time of day, and a hash of the program's files.
    r"|\.findings\[\]\.(since|what|entry|version)"
    r"|\.kept|\.removed\.bytes"  # of the store, for the same reason
    r"|\.digest|\.key|\.cases\[\]\.key"  # of a sweep, for the same reason
)
"""Places in documents where no two runs, machines or arrangements of modules agree."""

KEYED = re.compile(r"[0-9a-f]{2}/[0-9a-f]{64}")
"""Part of a file's name that is such a key; files of one such name are recorded as a list."""

UNORDERED = re.compile(r"\.findings")
"""Lists in the order in which two processes happen to finish."""


@dataclass(frozen=True)
class Case:
    """One command.

    Attributes:
        name: group and what it shows.
        command: words after ``maskfab``, or a script after ``python``; ``--json`` is added.
        inputs: laid into its folder, see ``golden_inputs.py``.
        after: case whose folder this one goes on in.
        edits: (file, old, new) in the inputs.
        exits: exit codes that need no attention while it is recorded.
        quick: belongs to the subset for every commit.
        slow: is left out unless asked for.
        text: without ``--json``.
        shape: only the shape of the answer is recorded, for its numbers are measured on this machine.
        timed: files that tell a duration, or the hash of one that does; only their presence is recorded.
        store: kept findings of ``after`` are at hand.
        longest_text: characters of a text that is recorded whole.
    """

    name: str
    command: str
    inputs: tuple[str, ...] = ()
    after: str = ""
    edits: tuple[tuple[str, str, str], ...] = ()
    exits: tuple[int, ...] = (0, 1, 2)
    quick: bool = False
    slow: bool = False
    text: bool = False
    shape: bool = False
    timed: tuple[str, ...] = ()
    store: bool = False
    longest_text: int = 2500


SMALL = ("small.toml", "ring.toml")
_STOP = 'stop = { shape = "circle", diameter = "400 um" }, focal = "5 mm", wavelengths = ["530 nm"]'
LOOK = f"--camera '{{ {_STOP}, window = \"64 um\" }}'"
WIDE = LOOK.replace("64 um", "240 um")
SQUARE = LOOK.replace("circle", "square").replace(" }'", ', pixel = "1 um" }\'')
LAYOUTS = ("layouts",)
PHOTOGRAPHS = ("layouts", "photographs")
FRONT = ("front.toml", "given.toml")
NO_PARETO = (
    "front.toml",
    '[pareto]\nclear_dots = { from = 9, to = 12, step = 3 }\nlines = [0, 1]\ncompare = ["given.toml"]\n',
    "",
)
VERBS = (
    "design check compare new run view verify order analyse simulate learn restore measure edge study "
    "sweep explain self",
    "order_list order_compare order_fill order_pack self_doctor self_cache self_bench self_cite",
)
EXAMPLES = "analyse_a_file display_in_the_eye opening_from_array plate_of_two psf_and_mtf sweep_of_gutters"

DESIGNED = ("design.html", "manifest.json")
"""The page tells how long the search took, and the manifest has the page's hash."""

ALL_FORMATS = (
    "small.toml",
    "[plate]",
    '[export]\nformats = ["gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif", "svg", "step", "glb", "3mf", '
    '"stl", "png", "tiff", "exr"]\ndots_per_um = 0.25\n\n[plate]',
)
PROCESS = ("small.toml", "[plate]", '[process]\ncd_bias = "0.2 um"\ncorner_radius = "0.5 um"\n\n[plate]')
SHOP = ("small.toml", "[plate]", '[export]\nshop = "generic-chrome"\n\n[plate]')
SCENE = ("small.toml", "[plate]", '[scene]\naccuracy = "draft"\ndepth = ["1 m", "inf"]\ngap = "0.2 mm"\n\n[plate]')
LIMITS = ("small.toml", "[plate]", '[limits]\nmin_feature = "9 um"\n\n[plate]')

_CASES = (
    # make a plate
    Case("new/first_plate", "new mine", quick=True),
    Case("new/display_that_fits", "new mine --from display_that_fits"),
    Case("new/folder_in_use", "new .", SMALL),
    Case("new/no_such_job", "new mine --from nothing", quick=True),
    Case("run/small", "run small.toml --out out", SMALL, quick=True),
    Case("run/small_in_words", "run small.toml --out out", SMALL, text=True),
    Case("run/all_formats", "run small.toml --out out", SMALL, edits=(ALL_FORMATS,)),
    Case("run/written_by_a_process", "run small.toml --out out", SMALL, edits=(PROCESS, SHOP)),
    Case("run/scene", "run small.toml --out out", SMALL, edits=(SCENE,)),
    Case("run/small_twice", "run small.toml --out old", after="run/small", edits=(PROCESS,)),
    Case("run/check_fails", "run small.toml --out out", SMALL, edits=(LIMITS,)),
    Case("run/kept_findings", "run small.toml --out out --force", after="run/small", store=True),
    Case("run/nothing_kept", "run small.toml --out other --no-cache", SMALL),
    Case("run/in_use", "run small.toml --out out", after="run/small"),
    Case("run/forecast", "run small.toml --out out --dry-run", SMALL, quick=True),
    Case("run/forecast_of_upc12", "run layouts/upc12.toml --out out --dry-run", LAYOUTS),
    Case("run/no_job", "run none.toml --out out", quick=True),
    Case("run/first_plate", "run layouts/first_plate.toml --out out", LAYOUTS),
    Case("run/toled_against_ours", "run layouts/toled_against_ours.toml --out out", LAYOUTS),
    Case("run/fits", "run layouts/display_that_fits.toml --out out", LAYOUTS),
    Case("run/order_film", "run layouts/order_film.toml --out out", LAYOUTS),
    Case("run/upc12", "run layouts/upc12.toml --out out", LAYOUTS, slow=True),
    Case("view/small", "view out", after="run/small", quick=True),
    Case("view/in_use", "view out", after="view/small"),
    Case("view/replaced", "view out --force", after="view/small"),
    Case("view/inside_the_run", "view out --out out/report.html", after="run/small"),
    Case("view/no_run", "view .", SMALL),
    Case("verify/small", "verify out", after="run/small", quick=True),
    Case("verify/edited", "verify out", after="run/small", edits=(("out/report.json", "SMALL PLATE", "OTHER PLATE"),)),
    Case("verify/file", "verify out/SMALL.gds --against small.toml", after="run/small"),
    Case(
        "verify/one_die", "verify out/SMALL.oas --against small.toml --die PLAIN --tolerance '1 nm'", after="run/small"
    ),
    Case("verify/drawing", "verify out/SMALL_R12.dxf --against small.toml --unit um --layer CLEAR", after="run/small"),
    Case("verify/wrong_unit", "verify out/SMALL_R12.dxf --against small.toml --unit mm", after="run/small"),
    Case("verify/other_tone", "verify out/SMALL.gds --against small.toml --tone dark", after="run/small"),
    Case("verify/no_layer", "verify out/SMALL.gds --against small.toml --layer 77/0", after="run/small"),
    Case("verify/package", "verify film.zip", after="package/film"),
    Case(
        "verify/package_at_another_shop",
        "verify film.zip --shop generic-chrome --against layouts/order_film.toml",
        after="package/film",
    ),
    Case("verify/solids", "verify out", after="run/all_formats"),
    Case("reproduce/small", "verify --again out", after="run/small"),
    Case("reproduce/edited", "verify --again out", after="run/small", edits=(("out/report.json", "SMALL", "LARGE"),)),
    Case("reproduce/no_run", "verify --again .", SMALL),
    Case("cite/program", "self cite", quick=True),
    Case("cite/run", "self cite out", after="run/small"),
    Case("cite/no_run", "self cite nothing"),
    # decide
    Case("analyse/ring", f"analyse ring.toml {LOOK} --out seen", SMALL, quick=True),
    Case("analyse/light", f"analyse ring.toml {WIDE} --out seen", SMALL),
    Case("analyse/in_words", f"analyse ring.toml {LOOK}", SMALL, text=True),
    Case("analyse/random", "analyse layouts/openings/toled.toml --tiling random --seed 1 --gutter '8 um'", LAYOUTS),
    Case("analyse/mask", f"analyse out/SMALL.gds --cell TURNED {LOOK}", after="run/small"),
    Case("analyse/drawing", f"analyse out/SMALL_R2010.dxf --cell PLAIN {LOOK} --unit um", after="run/small"),
    Case(
        "analyse/scene",
        'analyse layouts/openings/toled.toml --camera \'{ stop = { shape = "circle", diameter = "1 mm" } }\' --scene '
        '\'{ depth = ["0.3 m", "inf"], gap = "0.5 mm", field = "0.5 mm", aberrations = [[4, 0.05]], '
        'distortion = { ratio = 0.02, height = "2 mm" }, accuracy = "draft" }\'',
        LAYOUTS,
    ),
    Case(
        "analyse/lines", f'analyse ring.toml {LOOK} --scene \'{{ spectrum = "lines", illuminant = "6500 K" }}\'', SMALL
    ),
    Case(
        "analyse/stop_and_chrome",
        "analyse layouts/openings/stripe.toml --plate '{ optical_density = 3, film_phase = 0.4 }' --camera '{ stop = "
        '{ shape = "ellipse", width = "2 mm", height = "1.9 mm" }, wavelengths = ["530 nm"] }\'',
        LAYOUTS,
    ),
    Case("analyse/square_stop", f"analyse ring.toml {SQUARE}", SMALL),
    Case("analyse/random_without_seed", f"analyse ring.toml {LOOK} --tiling random", SMALL, quick=True),
    Case("analyse/no_unit", f"analyse ring.toml {LOOK} --gutter 8", SMALL, quick=True),
    Case("analyse/not_a_layout", f"analyse small.toml {LOOK}", SMALL),
    Case("analyse/no_such_option", "analyse ring.toml --nothing", SMALL),
    Case("plan/upc12", "check --optics layouts/upc12.toml --die TOLED_P150", LAYOUTS, quick=True),
    Case("plan/scene", "check --optics small.toml", SMALL, edits=(SCENE,)),
    Case("plan/in_words", "check --optics small.toml", SMALL, text=True),
    Case("plan/no_die", "check --optics small.toml --die NONE", SMALL),
    Case("check/fits", "check layouts/display_that_fits.toml", LAYOUTS),
    Case("check/fits_in_words", "check layouts/display_that_fits.toml --die FITS", LAYOUTS, text=True),
    Case("check/largest_gap", "check layouts/first_plate.toml --die OURS --largest-gap", LAYOUTS),
    Case("check/density", "check layouts/display_density.toml", LAYOUTS, quick=True),
    Case("check/no_emitters", "check layouts/displays.toml", LAYOUTS),
    Case("check/shop", "order pack small.toml --shop generic-chrome --format gdsii --dry-run", SMALL),
    Case("check/no_shop", "order pack small.toml --shop nobody --dry-run", SMALL),
    Case("check/no_display", "check small.toml", SMALL),
    Case(
        "render/fits",
        "check --look layouts/display_that_fits.toml --die FITS --pixels 12 --samples 9 --out seen",
        LAYOUTS,
    ),
    Case(
        "render/picture",
        "check --look layouts/displays.toml photographs/leaves.tif --pixels 10 --samples 9 --dpi 300 "
        "--distance '400 mm'",
        (*LAYOUTS, "photographs"),
        quick=True,
    ),
    Case("render/no_emitters", "check --look small.toml", SMALL),
    Case("compare/dies", "compare out --out side", after="run/toled_against_ours"),
    Case("compare/reference", "compare out --die TOLED --die OURS --reference OURS", after="run/toled_against_ours"),
    Case("compare/runs", "compare out old --reference old:PLAIN", after="run/small_twice"),
    Case("compare/no_such_die", "compare out --die NONE", after="run/small"),
    Case("compare/small", "compare out", after="run/small", quick=True),
    Case("compare/no_run", "compare nothing"),
    # find a design
    Case(
        "shape/stripe",
        "new s.toml --shape stripe --dots 21 --pitch '168 um' --set width_dots=5 --clear-dots 90",
        quick=True,
    ),
    Case(
        "shape/blobs",
        "new b.toml --shape blobs --clear-dots 88 --set size_ratio=0.6 --set aspect=1.5 --set exponent=3 --name B",
    ),
    Case("shape/diamond_discs", "new d.toml --shape diamond-discs --clear-dots 89"),
    Case("shape/not_reached", "new d.toml --shape diamond-discs --clear-dots 90"),
    *(
        Case(f"shape/{kind}", f"new shape.toml --shape {kind}")
        for kind in ("rgb-stripe", "pentile-diamond", "pentile-lines", "delta", "circular", "window")
    ),
    Case("shape/ring", "new ring.toml --shape circular --set diameter=18 --force", ("ring.toml",)),
    Case("shape/in_use", "new ring.toml --shape circular", ("ring.toml",)),
    Case("shape/no_such_kind", "new s.toml --shape heart", quick=True),
    Case("shape/picture", "new s.png --shape stripe --clear-dots 90"),
    Case("design/bars", "design front.toml --out found", FRONT, edits=(NO_PARETO,), timed=DESIGNED),
    Case("design/priced", "design front.toml --out f.toml --price-rules --checkpoint c.npz", FRONT, edits=(NO_PARETO,)),
    Case("design/resumed", "design front.toml --out f.toml --checkpoint c.npz --force", after="design/priced"),
    Case(
        "design/for_photographs",
        "design front.toml -o f.toml --images photographs",
        (*FRONT, "large_photographs"),
        edits=(NO_PARETO,),
    ),
    Case("design/descent", "design descent.toml --out found", ("descent.toml",), timed=DESIGNED),
    Case("design/no_section", "design small.toml --out found.toml", SMALL),
    Case(
        "design/no_room",
        "design front.toml --out found",
        FRONT,
        edits=(NO_PARETO, ("front.toml", "clear_dots = 12", "clear_dots = 65")),
    ),
    Case("design/budget", "design front.toml --out found --budget '1 ms'", FRONT, edits=(NO_PARETO,), shape=True),
    Case("pareto/front", "design --front front.toml --out front", FRONT, quick=True),
    Case("pareto/no_section", "design --front small.toml --out front", SMALL),
    # order
    Case("shops/all", "order list", quick=True),
    Case("shops/in_words", "order list", text=True),
    *(
        Case(f"shops/{shop}", f"order list {shop}")
        for shop in ("generic-chrome", "compugraphics", "jd_photo_data_film")
    ),
    Case("shops/compared", "order compare layouts/upc12.toml", LAYOUTS),
    Case("shops/compared_on_film", "order compare layouts/order_film.toml", LAYOUTS),
    Case("shops/nobody", "order list nobody", quick=True),
    Case("order/asked", "order fill small.toml --shop compugraphics", SMALL, quick=True),
    Case(
        "order/answered",
        "order fill small.toml --shop compugraphics --set quantity=1 --set 'glass=soda lime' --set "
        "'contact.name=A. Reader'",
        SMALL,
    ),
    Case("order/film", "order fill layouts/order_film.toml --shop jd_photo_data_film", LAYOUTS),
    Case("order/wrong_answer", "order fill small.toml --shop compugraphics --set quantity=many", SMALL),
    Case(
        "package/film",
        "order pack layouts/order_film.toml --shop jd_photo_data_film --out film.zip",
        LAYOUTS,
        quick=True,
    ),
    Case("package/chrome", "order pack layouts/order_chrome.toml --shop compugraphics --out .", LAYOUTS),
    Case(
        "package/through_glass",
        "order pack layouts/order_through_glass.toml --shop generic-chrome --format oasis",
        LAYOUTS,
    ),
    Case(
        "package/small",
        "order pack small.toml --shop compugraphics --out small.zip --format gdsii --format oasis",
        SMALL,
    ),
    Case("package/refused", "order pack small.toml --shop jd_photo_data_film", SMALL),
    Case("package/not_a_package", "order pack small.toml --shop compugraphics --out packed", SMALL),
    Case(
        "package/in_use",
        "order pack layouts/order_film.toml --shop jd_photo_data_film --out film.zip",
        after="package/film",
    ),
    # photograph and measure
    Case(
        "simulate/wiener",
        "simulate layouts/toled_against_ours.toml --images photographs --level 32 --restore wiener --out seen.png",
        PHOTOGRAPHS,
        quick=True,
    ),
    Case(
        "simulate/all_restorers",
        "simulate layouts/toled_against_ours.toml --die OURS --images photographs --level 32",
        PHOTOGRAPHS,
    ),
    Case(
        "simulate/f1",
        "simulate layouts/toled_against_ours.toml --die TOLED --images photographs --protocol f1 --light "
        "code --level 40",
        PHOTOGRAPHS,
    ),
    Case(
        "simulate/paper",
        "simulate layouts/toled_against_ours.toml --die TOLED --images photographs --protocol paper",
        PHOTOGRAPHS,
    ),
    Case(
        "simulate/learned",
        "simulate layouts/toled_against_ours.toml --die TOLED --images photographs --level 32 --restore wiener "
        "--checkpoint toled.npz",
        after="learn/minutes",
        slow=True,
        shape=True,
    ),
    Case("simulate/one_colour", "simulate small.toml", SMALL),
    Case("simulate/no_photographs", "simulate layouts/toled_against_ours.toml --images layouts", LAYOUTS),
    Case(
        "learn/minutes",
        "learn layouts/toled_against_ours.toml --die TOLED --images photographs --level 32 --minutes 8 -o "
        "toled.npz --device cpu",
        PHOTOGRAPHS,
        slow=True,
        shape=True,
    ),
    Case(
        "learn/too_short",
        "learn layouts/toled_against_ours.toml --die TOLED --minutes 0.001 -o toled.npz",
        LAYOUTS,
        shape=True,
    ),
    Case("learn/no_die", "learn layouts/toled_against_ours.toml -o toled.npz", LAYOUTS, quick=True),
    Case(
        "measure/point",
        "measure 1ms.tif 8ms.tif 64ms.tif --job small.toml --gain 1.7 --read-noise 4.87 --black 64 --white "
        "8190 --window 64 --times '1 ms' --times '8 ms' --times '64 ms' -o measured",
        ("exposures",),
        after="analyse/light",
    ),
    Case(
        "measure/one_time_for_two",
        "measure 1ms.tif 8ms.tif --job small.toml --gain 1.7 --read-noise 4.87 --times '1 ms'",
        ("exposures",),
        after="analyse/light",
    ),
    Case("measure/no_gain", "measure 1ms.tif --job small.toml", ("exposures",), after="analyse/light"),
    Case(
        "measure/edge",
        "edge edge.tif --black 500 --white 60000 --pixel '2 um' -o measured",
        ("edge",),
        quick=True,
    ),
    Case(
        "measure/edge_of_a_die",
        "edge edge.tif --black 500 --white 60000 --job small.toml --die PLAIN --line '530 nm'",
        (*SMALL, "edge"),
    ),
    Case("measure/no_edge", "edge 1ms.tif --black 64 --white 8190", ("exposures",), after="analyse/light"),
    Case("measure/mtf", "edge curve.csv --job small.toml --die PLAIN --angle 90 -o measured", (*SMALL, "curve")),
    Case("measure/no_mtf", "edge none.csv --job small.toml --die PLAIN", SMALL),
    Case(
        "restore/by_job",
        "restore photographs/leaves.tif --job layouts/toled_against_ours.toml --die OURS --restore wiener "
        "--out restored",
        PHOTOGRAPHS,
    ),
    Case(
        "restore/by_psf",
        "restore photographs/leaves.tif --psf seen/psf_pixel_530nm.exr --restore tv --epsilon 0.01 --stops "
        "0.5 --out restored",
        ("photographs",),
        after="analyse/ring",
    ),
    Case("restore/no_psf", "restore photographs/leaves.tif --out restored", ("photographs",)),
    # study
    Case("study/fig7", "study layouts/studies/fig7.toml -o fig7", LAYOUTS, quick=True),
    *(Case(f"study/{name}", f"study layouts/studies/{name}.toml -o out", LAYOUTS) for name in ("fig9", "fig18")),
    *(
        Case(f"study/{name}", f"study layouts/studies/{name}.toml -o out", LAYOUTS, slow=True)
        for name in ("fig19", "fig21")
    ),
    Case("study/no_section", "study small.toml -o out", SMALL),
    Case("sweep/bias", "sweep bias.toml -o swept --engine serial", (*SMALL, "bias.toml"), quick=True),
    Case(
        "sweep/no_case",
        "sweep bias.toml -o swept",
        (*SMALL, "bias.toml"),
        edits=(("bias.toml", "count = 2", "count = 0"),),
    ),
    Case("sweep/two_processes", "sweep bias.toml -o swept --engine processes --workers 2", (*SMALL, "bias.toml")),
    Case("sweep/resumed", "sweep bias.toml -o swept --engine serial", after="sweep/bias"),
    Case("sweep/no_such_engine", "sweep bias.toml -o swept --engine nothing", (*SMALL, "bias.toml")),
    # about
    *(
        Case(f"schema/{document}", f"explain --schema {document}", quick=True)
        for document in ("job", "report", "check")
    ),
    Case("schema/no_such_document", "explain --schema nothing", quick=True),
    Case("explain/codes", "explain", quick=True),
    Case("explain/code", "explain MF106", text=True, quick=True),
    Case("explain/nothing", "explain camera.nothing", quick=True),
    Case("explain/everything", "python {tests}/golden_probes.py explain", quick=True),
    Case("names/python", "python {tests}/golden_probes.py names", quick=True),
    Case("errors/exits", "python {tests}/golden_probes.py exits", LAYOUTS, quick=True),
    Case("doctor/here", "self doctor", shape=True),
    Case("bench/quick", "self bench small.toml --die PLAIN --rounds 2 --out bench", SMALL, shape=True, quick=True),
    Case("bench/no_die", "self bench small.toml --die NONE", SMALL),
    Case("cache/small", "self cache", after="run/small", store=True, quick=True),
    Case("cache/emptied", "self cache --limit 0", after="run/small", store=True),
    Case("cache/bad_limit", "self cache --limit much", quick=True),
    *(
        Case(f"help/{verb}", f"{verb.replace('_', ' ')} --help", text=True, longest_text=9000)
        for verb in " ".join(VERBS).split()
    ),
    Case("help/all", "--help", text=True, longest_text=9000, quick=True),
    Case("help/no_such_verb", "nothing", quick=True),
    *(Case(f"example/{name}", f"python examples/{name}.py", (*LAYOUTS, "examples")) for name in EXAMPLES.split()),
)

_IN_WORDS = (
    "new/first_plate run/forecast_of_upc12 view/small verify/small verify/edited reproduce/small reproduce/edited "
    "cite/run check/largest_gap check/shop render/fits compare/dies shape/stripe design/bars pareto/front "
    "shops/generic-chrome shops/compared_on_film order/answered package/film simulate/wiener measure/point "
    "measure/edge measure/mtf restore/by_job study/fig7 sweep/bias schema/check doctor/here cache/small "
    "analyse/scene plan/upc12"
)
"""Cases that are also asked for what people read."""

_TIMED_IN_WORDS = {"run/forecast_of_upc12", "cache/small", "design/bars"}

CASES = (
    *_CASES,
    *(
        replace(
            case, name=f"{case.name}_in_words", text=True, quick=False, shape=case.shape or case.name in _TIMED_IN_WORDS
        )
        for case in _CASES
        if case.name in _IN_WORDS.split()
    ),
)
