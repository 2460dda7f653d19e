"""What must be in force, told in plain values: no files, signatures, digests or clock.

Written by somebody who has not seen :mod:`calibrary.registry.in_force`, from the sentences alone. Days are whole
numbers. ``Model(world).answer(camera, day)`` is a content's id, None (nothing is in force) or "refused".
"""

from __future__ import annotations

from typing import Any, NamedTuple


class Rules(NamedTuple):
    """People by their keys; ``by`` are those whose approval counts, None for all."""

    people: Any
    least: int
    by: Any


class Change(NamedTuple):
    id: str
    previous: Any
    rules: Rules
    keeps: Any
    over: Any


class Content(NamedTuple):
    id: str
    camera: Any
    start: Any
    until: Any
    date: int
    replaces: Any
    restores: Any


class Event(NamedTuple):
    id: str
    act: str
    camera: Any
    key: Any
    claim: str
    here: bool
    content: Any
    contents: Any
    start: Any


class World(NamedTuple):
    foundation: Rules
    changes: Any
    signed: Any
    followed: Any
    contents: Any
    events: Any
    fake: Any


class Model:
    def __init__(self, w: Any) -> None:
        self.w, self.events = w, [*w.events.values()]  # 1, 2
        self.rules, self.chain, self.memo = w.foundation, list[Any](), dict[Any, Any]()  # 13
        while (
            step := self.choose(
                [
                    c
                    for c in w.changes.values()
                    if c.previous == (self.chain[-1].id if self.chain else None)
                    and self.enough(w.signed.get(c.id, ()))
                ]
            )
        ) not in (None, "refused"):
            self.chain.append(step)
            self.rules = step.rules
        self.refused, self.kept = step == "refused", self.keeps()

    def keeps(self) -> Any:
        return {i for c in self.chain for i in c.keeps}

    def owner(self, rules: Any, key: Any, claim: Any) -> Any:
        return rules.people.get(key) if rules.people else claim  # 4

    def enough(self, keys: Any) -> Any:
        return len(
            {
                p
                for k in keys
                if (p := self.rules.people.get(k)) and (self.rules.by is None or p in self.rules.by)
            }
        ) >= max(1, self.rules.least)

    def stands(self, a: Any, b: Any) -> Any:  # a's signers suffice without the keys that b takes out
        return self.enough({k for k in self.w.signed[a.id] if k in b.rules.people})

    def beats(self, a: Any, b: Any) -> Any:  # 14
        if (a.id in self.w.followed) != (b.id in self.w.followed):
            return a.id in self.w.followed
        return self.stands(a, b) and (not self.stands(b, a) or b.id in a.over)

    def choose(self, some: Any) -> Any:  # 13, 14
        for a in some:
            if all(self.beats(a, b) for b in some if b is not a):
                return a
        pairs = [(a, b) for a in some for b in some if a.id < b.id]
        return "refused" if any(not self.stands(a, b) and not self.stands(b, a) for a, b in pairs) else None

    def counts(self, e: Any) -> Any:
        return (e.here and self.owner(self.rules, e.key, e.claim) is not None) or e.id in self.kept  # 5

    def signers(self, i: Any, rules: Any) -> Any:
        return {
            p
            for e in self.events
            if e.act == "approve"
            and e.content == i
            and e.here
            and (p := self.owner(rules, e.key, e.claim)) is not None
            and (rules.by is None or p in rules.by)
        }

    def approved(self, i: Any) -> Any:  # 6, 7
        return i in self.kept or len(self.signers(i, self.rules)) >= self.rules.least

    def known(self, i: Any) -> Any:
        return i in self.w.contents and self.memo.setdefault(i, self.approved(i))

    def hits(self, e: Any, c: Any) -> Any:
        return (
            c.id in e.contents if e.contents is not None else e.camera == c.camera and e.id not in c.restores
        )

    def ended(self, c: Any, day: Any) -> Any:  # 8
        return any(
            e.act == "retire" and self.hits(e, c) and (e.start is None or e.start <= day) and self.counts(e)
            for e in self.events
        )

    def live(self, c: Any, day: Any) -> Any:  # 9
        return (
            self.known(c.id)
            and (c.start is None or c.start <= day)
            and (c.until is None or day <= c.until)
            and not self.ended(c, day)
        )

    def replaced(self, c: Any) -> Any:  # 10
        return {*c.replaces}.union(*(self.replaced(self.w.contents[i]) for i in c.replaces if self.known(i)))

    def rank(self, c: Any) -> Any:
        return -1 if c.start is None else c.start, c.date  # 11

    def broken(self, camera: Any) -> Any:  # 3, 7
        return camera in self.w.fake or sum(e.camera == camera for e in self.events) > 10_000

    def answer(self, camera: Any, day: Any) -> Any:
        if self.refused or self.broken(camera):
            return "refused"
        live = [c for c in self.w.contents.values() if c.camera == camera and self.live(c, day)]
        gone = set().union(*map(self.replaced, live))
        best = sorted((c for c in live if c.id not in gone), key=self.rank)[-2:]
        if not best:
            return None
        return best[-1].id if len(best) < 2 or self.rank(best[0]) != self.rank(best[1]) else "refused"
