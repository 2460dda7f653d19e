"""Random sets of statements on one camera, as the model and as the registry see them."""

from __future__ import annotations

import base64
import random
from collections.abc import Sequence
from datetime import date, timedelta
from types import ModuleType
from typing import Any, Final

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.records import to_json
from calibrary.registry.configuration import ApprovalRule, Keyholder, RuleSet
from calibrary.registry.sshsig import fingerprint, key_blob
from calibrary.registry.statements import RULES, Body, Signed, rule_set, state_after, statement_path
from tests.registry.in_force import model

START: Final = date(2026, 1, 1)
DAYS: Final = range(0, 60, 7)
CAMERA: Final = ("m", None)
SUBJECT: Final = "cameras/example/m/100x100"
OWNERS: Final = {"k1": "p1", "k1b": "p1", "k2": "p2", "k3": "p3", "k4": "p4"}
STRANGER: Final = "k9"
REFUSED: Final = "refused"


def _public(name: str) -> str:
    raw = name.encode().ljust(32, b".")
    blob = b"\0\0\0\x0bssh-ed25519\0\0\0 " + raw
    return f"ssh-ed25519 {base64.b64encode(blob).decode()}"


KEYS: Final = {name: _public(name) for name in (*OWNERS, STRANGER)}
PRINTS: Final = {name: fingerprint(key_blob(text) or b"") for name, text in KEYS.items()}
NAMES: Final = {value: name for name, value in PRINTS.items()}


def day(number: int) -> date:
    return START + timedelta(days=number)


def rules(keys: Sequence[str], count: int, by: Sequence[str] = ()) -> RuleSet:
    people: dict[str, list[str]] = {}
    for key in keys:
        people.setdefault(OWNERS[key], []).append(KEYS[key])
    holders = tuple(Keyholder(name=name, keys=tuple(own)) for name, own in people.items())
    return RuleSet(people=holders, approvals=ApprovalRule(count=count, by=tuple(by)))


class History(Struct):
    """Statements, with what a reader has followed."""

    statements: list[Signed]
    changes: list[Signed]
    followed: list[str]

    def said(self, key: str, **members: Any) -> Signed:
        body = Body(
            **{
                "person": OWNERS.get(key, "p9"),
                "made": f"2026-01-01T{[*KEYS].index(key):02}",
                "subject": SUBJECT,
                **members,
            }
        )
        return Signed(path=statement_path(body), body=body, key=PRINTS[key])


def content(number: int, first: int | None, until: int | None, made: int) -> dict[str, Any]:
    found: dict[str, Any] = {"fx": number, "provenance": {"date": day(made).isoformat()}}
    days = {"from": first, "until": until}
    validity = {name: day(one).isoformat() for name, one in days.items() if one is not None}
    return found | ({"validity": validity} if validity else {})


class _Writer:
    """Makes a history that begins with a K in use, as most cameras have."""

    def __init__(self, rng: random.Random, core: ModuleType) -> None:
        self.rng, self.core, self.made = rng, core, History([], [], [])
        some = rng.choice((["k1", "k1b", "k2"], ["k1", "k2", "k3"], ["k1", "k1b", "k2", "k3", "k4"]))
        by = (
            () if rng.random() < 0.7 else sorted({OWNERS[key] for key in some[:-1]} | {OWNERS[some[0]], "p2"})
        )
        terms = to_json(rules(some, rng.choice((1, 2, 2)), by))
        founding = self.made.said("k1", action="found", subject=RULES, terms=terms)
        self.made.changes.append(founding)
        self.states, self.here = [state_after(founding.body)], founding.id
        self.ids: list[str] = []
        self.endings: list[str] = []
        self.bodies: list[dict[str, Any]] = []
        members = self.new()
        for key in ("k1", "k2"):
            self.approve(key, members)

    def signer(self) -> str:
        return self.rng.choice([*OWNERS, *OWNERS, STRANGER])

    def pick(self, of: Sequence[str], most: int) -> tuple[str, ...]:
        some = [*dict.fromkeys(of)]
        return tuple(sorted(self.rng.sample(some, min(len(some), self.rng.randint(0, most)))))

    def approve(self, key: str, members: dict[str, Any], registry: str | None = None) -> None:
        one = self.made.said(key, action="approve", registry=registry or self.here, **members)
        self.made.statements.append(one)
        self.ids.append(self.core.Content.of(one.body).id)

    def new(self) -> dict[str, Any]:
        rng = self.rng
        first = rng.choice((None, None, rng.randint(0, 40)))
        until = None if rng.random() < 0.8 else (first or 0) + rng.randint(1, 30)
        self.bodies.append(
            {
                "content": content(len(self.bodies), first, until, rng.choice((5, 5, 9, 12))),
                "replaces": self.pick(self.ids, 2) if rng.random() < 0.7 else tuple(dict.fromkeys(self.ids)),
                "restores": self.pick(self.endings, 2) if rng.random() < 0.5 else tuple(self.endings),
            }
        )
        return self.bodies[-1]

    def approve_new(self) -> None:
        members = self.new()
        for key in self.rng.sample(("k1", "k1b", "k2", "k3"), self.rng.randint(1, 3)):
            self.approve(key, members, self.here if self.rng.random() < 0.85 else "f" * 32)

    def approve_known(self) -> None:
        registry = self.here if self.rng.random() < 0.93 else "f" * 32
        self.approve(self.signer(), self.rng.choice(self.bodies), registry)

    def retire(self) -> None:
        rng = self.rng
        named = None if rng.random() < 0.5 else self.pick(self.ids, 2)
        start = None if rng.random() < 0.5 else day(rng.randint(0, 50))
        key = self.signer() if rng.random() < 0.2 else rng.choice([*OWNERS])
        one = self.made.said(key, action="retire", registry=self.here, contents=named, start=start)
        self.made.statements.append(one)
        self.endings.append(one.id)

    def change_rules(self) -> None:
        rng = self.rng
        some = {"k1", "k2", *rng.sample([*OWNERS], rng.randint(0, 4))}
        keys = sorted(some - {rng.choice(["", "k1", "k2"])})
        able = sorted({OWNERS[key] for key in keys})
        by = () if rng.random() < 0.7 else rng.sample(able, rng.randint(1, len(able)))
        members = {
            "action": "rules",
            "subject": RULES,
            "registry": self.here,
            "previous": rng.choice([self.states[-1], self.states[-1], *self.states]),
            "terms": to_json(rules(keys, rng.randint(1, min(2, len(by or able))), by)),
            "keeps": self.pick([*self.ids, *self.endings], 3),
            "over": self.pick(self.states, 3),
        }
        made = [self.made.said(key, **members) for key in {self.signer(), *rng.sample(["k1", "k2", "k3"], 2)}]
        self.made.changes += made
        self.states.append(state_after(made[0].body))

    def remove(self) -> None:
        some = self.made.statements if self.rng.random() < 0.5 else self.made.changes
        if len(some) > 1:
            at = self.rng.randrange(len(some))
            some.pop(at if some[at].body.action != "found" else 1)


def random_history(rng: random.Random, core: ModuleType) -> History:
    """A history in which people approve, retire, change the rules and lose files, in any order."""
    writer = _Writer(rng, core)
    acts = (writer.approve_new, writer.approve_known, writer.retire, writer.change_rules, writer.remove)
    for _ in range(rng.randint(0, 14)):
        rng.choices(acts, (22, 23, 21, 24, 10))[0]()
    history = writer.made
    history.followed = [one for one in writer.states[1:] if rng.random() < 0.2]
    for statements in (history.statements, history.changes):
        rng.shuffle(statements)
    return history


def _rules(body: Body) -> model.Rules:
    found = rule_set(body)
    people = {NAMES[print_]: one.name for print_, one in found.owners.items()}
    return model.Rules(people, found.approvals.count, frozenset(found.approvals.by) or None)


def _number(one: date | str | None) -> int | None:
    one = date.fromisoformat(one) if isinstance(one, str) else one
    return (one - START).days if one is not None else None


def expected(history: History, core: ModuleType, asked: Sequence[int] = DAYS) -> dict[int, str | None]:
    """What the model answers on some days."""
    founding = next(one for one in history.changes if one.body.action == "found")
    root = state_after(founding.body)
    changes, signed = {}, dict[str, set[str]]()
    for one in history.changes:
        if one is not founding:
            body, name = one.body, state_after(one.body)
            previous = None if body.previous == root else body.previous
            changes[name] = model.Change(
                name, previous, _rules(body), frozenset(body.keeps), frozenset(body.over)
            )
            signed.setdefault(name, set()).add(NAMES[one.key or ""])
    contents, events = {}, {}
    for one in history.statements:
        body, name = one.body, ""
        if body.content is not None:
            name = core.Content.of(body).id
            days = body.content.get("validity", {})
            contents[name] = model.Content(
                name,
                CAMERA,
                _number(days.get("from")),
                _number(days.get("until")),
                _number(body.content["provenance"]["date"]) or 0,
                body.replaces,
                body.restores,
            )
        events[one.id] = model.Event(
            one.id,
            body.action,
            CAMERA,
            NAMES.get(one.key or "", ""),
            body.person,
            body.registry == founding.id,
            name,
            frozenset(body.contents) if body.contents is not None else None,
            _number(body.start),
        )
    world = model.World(_rules(founding.body), changes, signed, {*history.followed}, contents, events, set())
    found = model.Model(world)
    # A retirement by nobody who ever was of the people may be a damaged one: the camera is refused.
    ever = {key for one in [world.foundation, *(step.rules for step in found.chain)] for key in one.people}
    if any(
        one.act == "retire" and not found.counts(one) and (not one.here or one.key not in ever)
        for one in events.values()
    ):
        world.fake.add(CAMERA)
    return {number: found.answer(CAMERA, number) for number in asked}


def answered(history: History, core: ModuleType) -> dict[int, str | None]:
    """What the registry answers on the same days."""
    try:
        book = core.Rulebook.of(history.changes, None, history.followed)
    except RegistryError:
        return dict.fromkeys(DAYS, REFUSED)
    found = core.in_force(book, history.statements)
    answers: dict[int, str | None] = {}
    for number in DAYS:
        try:
            one = found.on(day(number))
            answers[number] = one.id if one is not None else None
        except RegistryError:
            answers[number] = REFUSED
    return answers
