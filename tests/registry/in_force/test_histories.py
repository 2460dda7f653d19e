"""What is in force, beside a model of it and beside functions that get it wrong in one place."""

from __future__ import annotations

import random
from pathlib import Path
from types import ModuleType

import pytest

from calibrary.registry import in_force
from tests.registry.in_force.histories import REFUSED, answered, expected, random_history
from tests.thorough import examples

HISTORIES = examples(50, 2000)
MOST = 4000
"""Histories within which a mistake has to show; few take more than a hundred."""


def seeded(seed: int) -> random.Random:
    return random.Random(seed)  # noqa: S311  a seed gives the same history


def differing(core: ModuleType, histories: int) -> int | None:
    """The first of some histories whose answers are not those of the model; None if there is none."""
    for seed in range(histories):
        history = random_history(seeded(seed), core)
        if answered(history, core) != expected(history, core):
            return seed
    return None


def test_every_history_has_the_answers_of_the_model() -> None:
    assert differing(in_force, HISTORIES) is None


def test_the_histories_reach_k_in_use_none_and_refusals() -> None:
    said = [
        one
        for seed in range(HISTORIES)
        for one in answered(random_history(seeded(seed), in_force), in_force).values()
    ]
    shares = [said.count(None), said.count(REFUSED)]
    assert min(*shares, len(said) - sum(shares)) > len(said) / 10


MUTANTS = {
    "a stranger's statement counts": (
        "return person if person == one.body.person else None",
        "return one.body.person",
    ),
    "another registry's statement counts": (
        "if one.body.registry != self.foundation:",
        "if False and one.body.registry != self.foundation:",
    ),
    "one approval is enough": (">= max(self.rules.approvals.count, 1)", ">= 1"),
    "two keys of a person are two people": (
        "people = {self.person_of(one) for one in approvals if self.may_approve(one)}",
        "people = {one.key for one in approvals if self.person_of(one) and self.may_approve(one)}",
    ),
    "who is not asked for approves": (
        "for one in approvals if self.may_approve(one)}",
        "for one in approvals}",
    ),
    "what a change keeps is forgotten": ("kept |= {*found.made[after][0].body.keeps}", "pass"),
    "a kept content is not in force": ("if name in book.kept or book", "if book"),
    "a kept retirement does not count": ("if one.id in self.kept or (why", "if (why"),
    "restores is ignored": ("else said.id not in one.restores", "else True"),
    "a retirement that names contents ends all": ("one.id in said.body.contents\n", "True\n"),
    "a retirement from a day is of all days": ("said.body.start or date.min", "date.min"),
    "a retirement begins a day late": ("day is not None and end <= day", "day is not None and end < day"),
    "validity is ignored": ("return day is None or first <= day.isoformat() <= last", "return True"),
    "replaces is ignored": ("return [one for one in live if one.id not in gone]", "return live"),
    "replaces is followed one step": (
        "todo += self.approved[name].replaces if name in self.approved else ()",
        "pass",
    ),
    "the first day does not decide": (
        'return first, str((self.entry.get("provenance")',
        'return "", str((self.entry.get("provenance")',
    ),
    "the date does not decide": (
        'return first, str((self.entry.get("provenance") or {}).get("date") or "")',
        'return first, ""',
    ),
    "of two at once the first counts": ("if len({one.says for one in best}) > 1:", "if False:"),
    "one who was followed does not count": ("if (one in followed) != (other in followed):", "if False:"),
    "who is taken out forbids it": ("if said.key not in gone)", "if said.key)"),
    "a third change that knows both does not count": ("knows = other in", "knows = False and other in"),
    "changes that take each other out are passed over": ("if torn := next(", "if torn := False and next("),
    "a change without enough people counts": (
        "if people.suffice(those):",
        "if those:",
    ),
    "a retirement by a stranger is passed over": (
        'elif one.body.action == "retire" and why != FORMER:',
        "elif False:",
    ),
    "a retirement by a former person counts": (
        'elif one.body.action == "retire" and why is None:',
        'elif one.body.action == "retire" and why in {None, FORMER}:',
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", MUTANTS)
def test_a_function_that_is_wrong_in_one_place_is_noticed(name: str) -> None:
    right, wrong = MUTANTS[name]
    text = Path(str(in_force.__file__)).read_text("utf-8")
    assert right in text
    mutant = ModuleType("calibrary.registry.mutant")
    mutant.__dict__["__name__"] = in_force.__name__
    exec(compile(text.replace(right, wrong), name, "exec"), mutant.__dict__)  # noqa: S102  our own module
    assert differing(mutant, MOST) is not None
