"""The program: its verbs in groups, its help, its exit codes, and the printing of errors."""

from __future__ import annotations

import os
import signal
import sys
import textwrap
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer

import maskfab
from maskfab.base.errors import InputError, InternalError, JobError, MaskfabError, is_lack_of_memory
from maskfab.cli.command import JSON, QUIET, Command, command_of, summary_of, tables
from maskfab.cli.printing import one_line, print_json, print_told, progress_bar, tell
from maskfab.mask.process_limits import limit_in_force

GROUPS: dict[str, tuple[str, ...]] = {
    "Decide": ("advise", "design", "check", "compare"),
    "Make": ("new", "run", "view", "verify"),
    "Order": ("order list", "order compare", "order fill", "order pack"),
    "Photograph and measure": ("analyse", "simulate", "learn", "restore", "measure", "edge"),
    "Study": ("sweep", "study"),
    "About": ("explain", "self doctor", "self cache", "self bench", "self cite"),
}
"""Every command, in the order in which help lists them."""
VERBS = tuple(name for names in GROUPS.values() for name in names)

_HELP = "Photomask plates for under-panel cameras: openings, panels, mask files, and their PSF and MTF."
_SHARED = {
    "-o, --out PATH": "Where results go: a page is a folder, a file has its ending.",
    "--force": "Replace what is there.",
    "--json": JSON.help,
    "--quiet": QUIET.help,
    "--help": "Explain a command, with examples.",
}
_OWN = {
    "--version": "Print the version.",
    "--install-completion": "Install completion for this shell: bash, zsh or fish.",
    "--show-completion": "Show it, to copy it or to fit the installation.",
}
_EPILOG = (
    "Exit codes: 0 all checks pass; 1 a check failed; 2 bad input, nothing written; 3 internal error; "
    "128 + n ended by signal n."
)
_COMPLETION = ("--install-completion", "--show-completion")
_INNER = {"order": "Mask shops, and what is ordered of them.", "self": "This installation of maskfab."}

# Newer releases of typer carry a copy of click of their own, so that class is found through typer.
_UsageError: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")

_PASSED_OVER = frozenset(
    getattr(signal, name)
    for name in (
        *("SIGKILL", "SIGSTOP", "SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL"),
        *("SIGTSTP", "SIGTTIN", "SIGTTOU", "SIGCONT", "SIGCHLD", "SIGURG", "SIGWINCH"),
    )
    if hasattr(signal, name)
)
"""Signals that nobody can catch, that come from a fault to which a handler would only return, and that end nothing."""


def run_command_line(arguments: Sequence[str]) -> int:
    """Run one command; every failure becomes an exit code and one message."""
    try:
        with _ended_by_signals():
            code = _run(list(arguments))
            # Typer makes a code of Ctrl-C.
            return code if code != _INTERRUPTED else _ended_early(code, "--json" in arguments)
    except _Ended as ended:
        return _ended_early(128 + ended.number, "--json" in arguments)
    except typer.Exit as leaving:
        return leaving.exit_code
    except (typer.Abort, KeyboardInterrupt):
        return _ended_early(_INTERRUPTED, "--json" in arguments)
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
            said = (str(fault).strip() or type(fault).__name__).splitlines()[0]
            most = limit_in_force("RLIMIT_AS")
            limit = "no limit of its own" if most is None else f"a limit of {most / 1e6:.0f} MB (ulimit -v)"
            cure = "Raise ulimit -v, close other programs, or ask for fewer dies, a smaller stop or a coarser accuracy"
            what = f"the system refuses maskfab, which has {limit}, more memory: {said}"
            return _tell(InputError("MF325", what, cure=cure), "--json" in arguments)
        traceback.print_exc()
        problem = InternalError(
            "MF901", f"{type(fault).__name__}: {fault}", cure="Please report this with the job file"
        )
        return _tell(problem, "--json" in arguments)


def _run(words: list[str]) -> int:
    completing = "_MASKFAB_COMPLETE" in os.environ
    if not completing and words[:1] in ([], ["--help"]):
        typer.echo(overview(), err=not words)
        return 0 if words else 2
    name = next((verb for verb in VERBS if verb.split() == words[: verb.count(" ") + 1]), None)
    alike = tuple(verb for verb in VERBS if verb.split()[:1] == words[:1])
    chosen = VERBS if completing or not alike else (name,) if name else alike
    program: Any = typer.main.get_command(
        _app(chosen, complete=completing or words[:1] in ([option] for option in _COMPLETION))
    )
    if name is not None and words[name.count(" ") + 1 :] == ["--help"]:
        # Without the library that typer reads arguments with.
        context, command = typer.Context(program, info_name="maskfab"), program
        for word in name.split():
            command = command.commands[word]
            context = typer.Context(command, info_name=word, parent=context)
        typer.echo(command.get_help(context))
        return 0
    code = program.main(words, prog_name="maskfab", standalone_mode=False, obj=words)
    return code if isinstance(code, int) else 0


def overview() -> str:
    """Text of ``maskfab --help``."""
    width = max(map(len, VERBS)) + 2

    def row(name: str, text: str) -> str:
        return textwrap.fill(text, 80, initial_indent=f"  {name:<{width}}", subsequent_indent=" " * (width + 2))

    lines = ["Usage: maskfab COMMAND [OPTIONS] ...", "", textwrap.fill(_HELP, 80)]
    for group, names in GROUPS.items():
        lines += ["", f"{group}:", *(row(name, summary_of(name)) for name in names)]
    width = max(map(len, _OWN)) + 2
    lines += ["", "Options of every command that has a use for them:", *(row(*pair) for pair in _SHARED.items())]
    lines += ["", "Options of the program:", *(row(*pair) for pair in _OWN.items())]
    return "\n".join([*lines, "", textwrap.fill(_EPILOG, 80)])


def _app(names: Sequence[str], *, complete: bool) -> typer.Typer:
    """The program with some of its commands; all others would only have to be read."""
    app = typer.Typer(
        help=_HELP, epilog=_EPILOG, add_completion=complete, no_args_is_help=True, pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )  # fmt: skip

    @app.callback(invoke_without_command=True)
    def _common(
        version: Annotated[bool, typer.Option("--version", help=_OWN["--version"], is_eager=True)] = False,
    ) -> None:
        if version:
            typer.echo(f"maskfab {maskfab.__version__}")
            raise typer.Exit

    inner: dict[str, typer.Typer] = {}
    for name in names:
        group, _, last = name.partition(" ")
        if last and group not in inner:
            inner[group] = typer.Typer(help=_INNER[group], no_args_is_help=True, rich_markup_mode=None)
            app.add_typer(inner[group], name=group)
        command = command_of(name)
        holder = inner[group] if last else app
        examples = " | ".join(command.examples)
        title = "Examples" if len(command.examples) > 1 else "Example"
        holder.command(last or group, epilog=f"{title}: {examples}")(command.callback(_act))
    return app


def _act(command: Command, context: typer.Context, typed: dict[str, Any]) -> None:
    """Import the function of a command, call it, and print what it answers."""
    from importlib import import_module

    from maskfab.api.results import Asked, answer
    from maskfab.base.checks import options_kept

    as_json, quiet = typed.pop("as_json"), typed.pop("quiet", True)
    with _named_as_options(command), options_kept():
        stated: dict[str, Any] = {}
        for parameter in command.parameters:
            value = typed.get(parameter.name)
            if value is not None and value is not False and value != []:
                flag = value if parameter.default is not True else False
                stated[parameter.name] = tables(parameter, value) if parameter.keys else flag
        out, force = (stated.pop("out", None), stated.pop("force", False)) if command.saves else (None, False)
        function = getattr(import_module(command.module), command.function)
        with progress_bar(quiet) as progress:
            if QUIET in command.parameters:
                stated["progress"] = progress
            asked = Asked(
                function, stated, context.obj, out, force, as_json, quiet, sys.stdin.isatty(), progress, tell, _prompt
            )
            reply = answer(asked)
    print_told(reply, as_json=as_json)
    if not reply.passed:
        raise typer.Exit(1)


def _prompt(question: str) -> str:
    try:
        answer: str = typer.prompt(one_line(question), default="", show_default=False, err=True)
    except typer.Abort:
        raise KeyboardInterrupt from None
    return answer


@contextmanager
def _named_as_options(command: Command) -> Iterator[None]:
    """Errors that name an argument of a function name the option that states it instead."""
    try:
        yield
    except MaskfabError as error:
        options = {option.name: option.spelling[0] for option in command.options}
        function, _, argument = error.where.rpartition(": ")
        if argument not in options or not (function.isidentifier() or not function) or len(error.faults) > 1:
            raise
        raise type(error)(error.code, error.what, where=options[argument], cure=error.cure) from error


class _Ended(BaseException):
    """A signal to end came; no handler of errors takes it for one."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let signals that end a process end the work as Ctrl-C does, so that nothing half-written is left; each once."""

    def end(number: int, _: object) -> None:
        for sign in before:
            signal.signal(sign, signal.SIG_IGN)
        raise _Ended(number)

    before: dict[int, Any] = {}
    # What somebody else handles, or ignores as nohup does, stays so; and only the main thread may ask.
    if threading.current_thread() is threading.main_thread():
        numbers = (sign for sign in signal.valid_signals() if sign not in _PASSED_OVER)
        before = {sign: signal.SIG_DFL for sign in numbers if signal.getsignal(sign) is signal.SIG_DFL}
    for sign in before:
        signal.signal(sign, end)
    try:
        yield
    finally:
        for sign, handler in before.items():
            signal.signal(sign, handler)


_INTERRUPTED = 130


def _ended_early(code: int, as_json: bool) -> int:
    cure = "Give the same command again: run, sweep, study and learn go on from what they had finished"
    _tell(
        InputError("MF157", "the work was ended before it was done; nothing is left half-written", cure=cure), as_json
    )
    return code


def _tell(error: MaskfabError, as_json: bool) -> int:
    tell(f"error: {error}".partition("\n  MF")[0] if len(error.faults) > 1 else f"error: {error}")
    for fault in error.faults if len(error.faults) > 1 else ():
        tell(f"  {fault}")
    if as_json:
        _print_error(error)
    return error.exit_code


def _print_error(error: MaskfabError) -> None:
    print_json({"error": error.to_dict()})
