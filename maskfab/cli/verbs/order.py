"""``maskfab order``: the blanks of an order, asked for and written into the job."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from maskfab.base.errors import JobError
from maskfab.cli.common.options import JobFile, Json
from maskfab.cli.common.printing import leave, one_line, print_found
from maskfab.cli.common.shop_verdict import tell_age

if TYPE_CHECKING:
    from maskfab.mask.houses.order import OrderForm


def order(
    job: JobFile,
    shop: Annotated[
        str, typer.Option(help="Mask shop to order from: a name from maskfab shops, or a profile (.toml).")
    ],
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="An answer to a key of [order] (repeatable); asks nothing."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Ask for all that an order to a mask shop still lacks, and write the answers into the job.

    On a terminal one question after the other: Enter leaves a line blank, and Ctrl-C the job as it is. Elsewhere, and
    with --json, the missing keys are named. Exit code 1 while a line is blank, or asks for what the shop does not
    offer.
    """
    from maskfab.api.verbs.shops import order as order_job

    answers = dict(map(_answer, set_ or ()))
    found = order_job(job, shop, answers)
    tell_age(found.form.shop)
    if not answers and not as_json and sys.stdin.isatty() and found.form.questions:
        answers = _asked(found.form)
        if answers:
            found = order_job(job, shop, answers)
    print_found(found, as_json)
    leave(found.passed)


def _answer(text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        cure = "Write it as --set quantity=2, or --set contact.name='A. Reader'"
        raise JobError("MF105", f"{text!r} is no KEY=VALUE", where="--set", cure=cure)
    return key.strip().removeprefix("order."), value


def _asked(form: OrderForm) -> dict[str, str]:
    """Answers to all questions of a form, each held against the job and the house as it is typed."""
    answers: dict[str, str] = {}
    blank = f"{form.plate.name} at {form.shop.title}: {len(form.questions)} lines of the order are blank."
    typer.echo(one_line(f"{blank} Enter leaves one blank, Ctrl-C the job as it is."), err=True)
    try:
        for question in form.questions:
            while text := typer.prompt(one_line(question), default="", show_default=False, err=True).strip():
                try:
                    form = form.answered(question.key, text)
                except JobError as refusal:
                    typer.echo(one_line(f"  {refusal.what}. {refusal.cure}"), err=True)
                else:
                    answers[question.key] = text
                    break
    except typer.Abort:
        typer.echo("\nThe job is as it was.", err=True)
        raise
    return answers
