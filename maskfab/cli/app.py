"""The program: its verbs in the order in which help lists them, its exit codes, and the printing of errors."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from maskfab.base import __version__
from maskfab.base.errors import InputError, InternalError, JobError, MaskfabError, is_lack_of_memory
from maskfab.cli.common.printing import one_line, print_json
from maskfab.cli.verbs.analyse import analyse
from maskfab.cli.verbs.bench import bench
from maskfab.cli.verbs.cache import cache
from maskfab.cli.verbs.check import check
from maskfab.cli.verbs.cite import cite
from maskfab.cli.verbs.compare import compare
from maskfab.cli.verbs.design import design
from maskfab.cli.verbs.doctor import doctor
from maskfab.cli.verbs.explain import explain
from maskfab.cli.verbs.learn import learn
from maskfab.cli.verbs.measure import measure
from maskfab.cli.verbs.new import new
from maskfab.cli.verbs.order import order
from maskfab.cli.verbs.package import package
from maskfab.cli.verbs.pareto import pareto
from maskfab.cli.verbs.plan import plan
from maskfab.cli.verbs.render import render
from maskfab.cli.verbs.reproduce import reproduce
from maskfab.cli.verbs.restore import restore
from maskfab.cli.verbs.run import run
from maskfab.cli.verbs.schema import schema
from maskfab.cli.verbs.shape import shape
from maskfab.cli.verbs.shops import shops
from maskfab.cli.verbs.simulate import simulate
from maskfab.cli.verbs.study import study
from maskfab.cli.verbs.sweep import sweep
from maskfab.cli.verbs.verify import verify
from maskfab.cli.verbs.view import view
from maskfab.mask.limits import limit_in_force

_EPILOG = (
    "Exit codes: 0 all checks pass; 1 a check failed; 2 bad input, nothing written; 3 internal error; "
    "128 + n ended by signal n."
)

_VERBS: tuple[tuple[Callable[..., None], str], ...] = (
    (new, "Examples: maskfab new mine | maskfab new mine --from display_that_fits"),
    (run, "Example: maskfab run layouts/upc12.toml --out build/upc12"),
    (
        design,
        "Examples: maskfab design layouts/design_bar.toml --out bar.toml --force | "
        "maskfab design job.toml --budget '60 s' --checkpoint state.npz",
    ),
    (pareto, "Example: maskfab pareto layouts/pareto.toml --out build/pareto"),
    (
        analyse,
        "Examples: maskfab analyse layouts/openings/toled.toml --tiling random --seed 1 | "
        "maskfab analyse plate.gds --cell TOLED_P150 --json | maskfab analyse photo.png --pitch '168 um' | "
        "maskfab analyse layouts/openings/toled.toml --stop '1 mm' --depth '0.3 m, inf' --accuracy draft",
    ),
    (
        measure,
        "Examples: maskfab measure 1ms.dng 4ms.dng 16ms.dng --job layouts/upc12.toml --gain 1.3 --read-noise 4.9 "
        "-o build/measured | maskfab measure led.tif --job job.toml --line '530 nm' --pair a.tif --pair b.tif | "
        "maskfab measure --edge chart.dng --job layouts/upc12.toml --die TOLED_P150 -o build/edge | "
        "maskfab measure --mtf curve.csv --job job.toml --die TOLED_P150 --angle 90",
    ),
    (verify, "Example: maskfab verify build/upc12"),
    (
        shape,
        "Examples: maskfab shape stripe --dots 21 --pitch '168 um' --width-dots 5 --clear-dots 90 --out s.toml | "
        "maskfab shape circular --length diameter=18 --out ring.toml",
    ),
    (
        bench,
        "Examples: maskfab bench --out bench | maskfab bench layouts/upc12.toml --die TOLED_R150 | "
        "maskfab bench --hard",
    ),
    (plan, "Examples: maskfab plan layouts/upc12.toml | maskfab plan job.toml --die TOLED_R150 --json"),
    (
        check,
        "Examples: maskfab check job.toml | maskfab check job.toml --die TOLED_R150 --largest-gap --json | "
        "maskfab check job.toml --shop generic-chrome",
    ),
    (
        shops,
        "Examples: maskfab shops | maskfab shops generic-chrome --json | maskfab shops --compare layouts/upc12.toml",
    ),
    (
        order,
        "Examples: maskfab order job.toml --shop compugraphics | "
        "maskfab order job.toml --shop compugraphics --set quantity=1 --set glass='soda lime' "
        "--set contact.name='A. Reader' | maskfab order job.toml --shop compugraphics --json",
    ),
    (
        package,
        "Examples: maskfab package layouts/upc12.toml --shop generic-chrome | "
        "maskfab package layouts/upc12.toml --shop generic-chrome --format oasis --out upc12.zip",
    ),
    (
        render,
        "Examples: maskfab render job.toml --out seen | maskfab render job.toml photo.jpg --die TOLED_R300 --json",
    ),
    (
        simulate,
        "Examples: maskfab simulate layouts/upc12.toml --die TOLED_P150 --die PINV_R150 | "
        "maskfab simulate job.toml --images photographs --reference TOLED_P150 --json",
    ),
    (
        restore,
        "Examples: maskfab restore photo.dng --job job.toml --die TOLED_R150 --out restored | "
        "maskfab restore *.dng --psf light.exr --gain 1.7 --read-noise 4.9 --bin --out restored | "
        "maskfab restore photo.jpg --psf red.exr --psf green.exr --psf blue.exr --restore wiener --out restored",
    ),
    (
        learn,
        "Examples: maskfab learn job.toml --die TOLED --level 32 -o toled.npz | "
        "maskfab learn job.toml --die TOLED --images photographs --minutes 60 -o toled.npz",
    ),
    (
        study,
        "Examples: maskfab study layouts/studies/fig7.toml -o build/fig7 | "
        "maskfab study layouts/studies/*.toml --images photographs -o build/studies",
    ),
    (
        compare,
        "Examples: maskfab compare build/upc12 | "
        "maskfab compare build/upc12 build/mine --reference upc12:TOLED_P150 --out build/side_by_side",
    ),
    (
        sweep,
        "Examples: maskfab sweep layouts/sweeps/bias.toml -o build/bias | "
        "maskfab sweep layouts/sweeps/shapes.toml -o build/shapes --engine dask --scheduler tcp://127.0.0.1:8786",
    ),
    (view, "Examples: maskfab view build/upc12 | maskfab view build/upc12 --out plate.html --force"),
    (explain, "Example: maskfab explain MF106"),
    (schema, "Example: maskfab schema job > job.schema.json"),
    (reproduce, "Example: maskfab reproduce build/upc12"),
    (doctor, "Example: maskfab doctor"),
    (cite, "Examples: maskfab cite | maskfab cite build/upc12"),
    (cache, "Examples: maskfab cache | maskfab cache --limit '1 GB'"),
)

# Newer releases of typer carry a copy of click of their own, so that class is found through typer.
_UsageError: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")

app = typer.Typer(
    name="maskfab",
    help="Photomask plates for under-panel cameras: openings, panels, mask files, and their PSF and MTF.",
    epilog=_EPILOG,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def _common(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
) -> None:
    if version:
        typer.echo(f"maskfab {__version__}")
        raise typer.Exit


for _verb, _examples in _VERBS:
    app.command(epilog=_examples)(_verb)

_PASSED_OVER = frozenset(
    getattr(signal, name)
    for name in (
        *("SIGKILL", "SIGSTOP", "SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL"),
        *("SIGTSTP", "SIGTTIN", "SIGTTOU", "SIGCONT", "SIGCHLD", "SIGURG", "SIGWINCH"),
    )
    if hasattr(signal, name)
)
"""Signals that nobody can catch, that come from a fault to which a handler would only return, and that end nothing."""

_program: Any = typer.main.get_command(app)


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command; every failure becomes an exit code and one message."""
    try:
        with _ended_by_signals():
            match arguments:
                case [verb, "--help"] if verb in _program.commands:
                    typer.echo(_help(verb))
                    return 0
            code = _program.main(list(arguments), prog_name="maskfab", standalone_mode=False, obj=list(arguments))
        return code if isinstance(code, int) else 0
    except _Ended as ended:
        return 128 + ended.number
    except typer.Exit as leaving:
        return leaving.exit_code
    except typer.Abort:
        return 130
    except _UsageError as wrong:
        wrong.show()
        if "--json" in arguments:
            cure = "See maskfab --help"
            _print_error(JobError("MF105", wrong.format_message(), where="the command line", cure=cure))
        return 2
    except MaskfabError as error:
        return _tell(error, "--json" in arguments)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as fault:
        if is_lack_of_memory(fault):
            return _tell(_refused_memory(fault), "--json" in arguments)
        traceback.print_exc()
        problem = InternalError(
            "MF901", f"{type(fault).__name__}: {fault}", cure="Please report this with the job file"
        )
        return _tell(problem, "--json" in arguments)


def _refused_memory(fault: BaseException) -> InputError:
    said = (str(fault).strip() or type(fault).__name__).splitlines()[0]
    most = limit_in_force("RLIMIT_AS")
    limit = "no limit of its own" if most is None else f"a limit of {most / 1e6:.0f} MB (ulimit -v)"
    cure = "Raise ulimit -v, close other programs, or ask for fewer dies, a smaller stop or a coarser accuracy"
    return InputError("MF325", f"the system refuses maskfab, which has {limit}, more memory: {said}", cure=cure)


def _help(verb: str) -> str:
    """Text of ``maskfab VERB --help``, without the library that typer reads arguments with."""
    whole, command = typer.Context(_program, info_name="maskfab"), _program.commands[verb]
    told: str = command.get_help(typer.Context(command, info_name=verb, parent=whole))
    return told


class _Ended(BaseException):
    """A signal to end came; no handler of errors takes it for one."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let signals that end a process end the work as Ctrl-C does, so that nothing half-written is left; each once."""

    def end(number: int, _: object) -> None:
        for each in before:
            signal.signal(each, signal.SIG_IGN)
        raise _Ended(number)

    before: dict[int, Any] = {}
    # What somebody else handles, or ignores as nohup does, stays so; and only the main thread may ask.
    if threading.current_thread() is threading.main_thread():
        numbers = (each for each in signal.valid_signals() if each not in _PASSED_OVER)
        before = {each: signal.SIG_DFL for each in numbers if signal.getsignal(each) is signal.SIG_DFL}
    for each in before:
        signal.signal(each, end)
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _tell(error: MaskfabError, as_json: bool) -> int:
    typer.echo(f"error: {one_line(error)}", err=True)
    if as_json:
        _print_error(error)
    return error.exit_code


def _print_error(error: MaskfabError) -> None:
    told = {"code": error.code, "what": error.what, "where": error.where, "cure": error.cure}
    print_json({"error": told})
