"""Whose a statement is: of the person that it names, if the key of its signature is theirs."""

from __future__ import annotations

import pytest

from calibrary.registry.configuration import Keyholder, RuleSet
from calibrary.registry.in_force import People
from calibrary.registry.statements import Body, Signed


@pytest.mark.parametrize(("key", "person"), [("key of bob", "bob"), ("key of ada", None), (None, None)])
def test_a_key_signs_for_nobody_but_its_owner(key: str | None, person: str | None) -> None:
    names = ("ada", "bob")
    rules = RuleSet(people=tuple(Keyholder(name=name, keys=(f"key of {name}",)) for name in names))
    people = People(rules=rules)
    people.__dict__["owners"] = {f"key of {name}": name for name in names}
    body = Body(action="approve", subject="cameras/dji/p4r", person="bob", made="2026-03-01T12:00:00Z")
    assert people.person_of(Signed(path="", body=body, key=key)) == person
