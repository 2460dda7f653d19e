"""Three clones of a registry with real git, beside the model of what is in force."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from calibrary.registry import in_force
from calibrary.registry.in_force import Content
from tests.registry.git.repositories import nobodys_git
from tests.registry.in_force.git_histories import CAMERA, PEOPLE, Clones
from tests.registry.in_force.histories import DAYS, REFUSED, day, expected
from tests.thorough import examples

__all__ = ["nobodys_git"]


def said(clones: Clones, who: str) -> dict[int, float | str | None]:
    """The K of the camera on some days, as a reader of a clone finds it."""
    standing = clones.opened(who).snapshot().standing(CAMERA.path)
    found: dict[int, float | str | None] = {}
    for number in DAYS:
        of_day = [
            one
            for one in standing.entries
            if one.is_usable and (one.validity is None or one.validity.holds(day(number)))
        ]
        K = of_day[0].calibration.intrinsics.fx if of_day else None
        found[number] = REFUSED if standing.problem is not None else K
    return found


def must(clones: Clones, who: str) -> dict[int, float | str | None]:
    """The same, as the model says it of what the clone must have."""
    history = clones.history(who)
    fx = {
        Content.of(one.body).id: one.body.content["intrinsics"]["fx"]
        for one in history.statements
        if one.body.content is not None
    }
    return {number: fx.get(one or "", one) for number, one in expected(history, in_force).items()}


@pytest.mark.parametrize("seed", range(examples(2, 120)))
def test_every_clone_answers_as_the_model_and_nothing_is_lost(tmp_path: Path, seed: int) -> None:
    clones = Clones(tmp_path, random.Random(seed))  # noqa: S311  a seed gives the same history
    clones.play(24)
    for who in PEOPLE:
        found, right = said(clones, who), must(clones, who)
        if REFUSED in found.values():
            assert clones.is_torn(who), (found, right)
        else:
            assert found == right
    if not clones.reverted:
        for who in (*PEOPLE, *PEOPLE):
            clones.sync(who)
        assert clones.facts[clones.head("ada")] == clones.everything
        assert len({clones.head(who) for who in PEOPLE}) == 1
        assert clones.files("ada") == clones.everything
