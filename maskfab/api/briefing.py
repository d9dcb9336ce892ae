"""Questions to a display engineer, one after the other on a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from maskfab.api.results import Asked
from maskfab.job.brief import Brief, merged, modules, questions


def ask_brief(asked: Asked, given: Mapping[str, object]) -> Brief:
    """The brief of given answers and, on a terminal, of those that a person types to the other questions.

    Enter takes the default that a question shows; an answer that cannot be, or that contradicts an earlier one, is
    asked again. Elsewhere, and with ``--json``, nothing is asked.

    Args:
        given: answers by their keys, as :meth:`maskfab.job.brief.Brief.of` takes them.

    Raises:
        JobError: MF105 for answers without a default that are missing where nobody can be asked; else as that does.
    """
    stated = merged(given)
    if asked.attended and not asked.as_json:
        asked.tell("Enter takes the answer in brackets; Ctrl-C ends, and nothing is written.")
        for question in questions():
            if question.key in stated:
                continue
            if question.key == "camera":
                for name, camera in modules().items():
                    asked.tell(f"  {name}: {camera.title}")
            default = question.default_of(stated)
            shown = f"{question.text} [{f'{default}: ' if default else ''}{question.why}]"
            typed = asked.answered(shown, partial(_with, stated, question.key))
            if answer := default if typed is None else typed[0]:
                stated[question.key] = answer
    return Brief.of(stated)


def _with(stated: Mapping[str, object], key: str, answer: str) -> Brief:
    """The brief with one more answer, as if all questions that are not asked yet had their defaults."""
    needed = {question.key: question.default_of(stated) for question in questions() if question.needed}
    return Brief.of({**needed, **stated, key: answer})
