"""Changes of the label, tags, notes and validity days of one or many entries.

Label, tags and notes do not affect which K is used, and are changed in the entry itself, approved or not. Days do: an
entry with new days is proposed again and needs approval, as after ``calibrary registry add``. K is never changed here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import date
from difflib import get_close_matches
from typing import Final

from msgspec import Struct

from calibrary.errors import AmbiguousCameraError, InputError, RegistryError
from calibrary.records import replace
from calibrary.registry.entry import Entry, Validity
from calibrary.registry.paths import in_use_path, proposal_path, unit_folder
from calibrary.registry.proposals import Proposals, proposal_of
from calibrary.registry.proposing import checked, propose
from calibrary.registry.snapshot import Snapshot

__all__ = ["EDITABLE", "Assignment", "assigned", "edit", "labelling", "parse_assignment", "retagged"]

OPERATORS: Final = ("+=", "-=", "=")
EDITABLE: Final[Mapping[str, tuple[str, ...]]] = {
    "label": ("=",),
    "tags": OPERATORS,
    "notes": ("=", "+="),
    "valid-from": ("=",),
    "valid-until": ("=",),
}
"""Editable fields, and their operators."""

Edit = Callable[[Entry], Entry]


class Assignment(Struct, frozen=True, kw_only=True):
    """One assignment to a field.

    Attributes:
        field: a field of :data:`EDITABLE`.
        operator: "=" sets, "+=" adds, "-=" removes.
        value: value as text; an empty one removes the field.
    """

    field: str
    operator: str = "="
    value: str


def parse_assignment(text: str) -> Assignment:
    """Parse ``field=value``, ``tags+=value`` or ``tags-=value``.

    Raises:
        InputError: the text is not an assignment, or the field cannot be set this way; the message states the right
            way.
    """
    name, is_set, value = text.partition("=")
    operator = f"{name[-1:]}=" if name.endswith(("+", "-")) else "="
    name = name.removesuffix(operator[0]) if operator != "=" else name
    field = name.strip().lower().replace("_", "-")
    if not is_set:
        raise InputError(f"{text!r:.60} is not an assignment, expected field=value")
    if field not in EDITABLE:
        near = get_close_matches(field, EDITABLE, n=1)
        meant = f"; {near[0]}?" if near else f"; {', '.join(EDITABLE)} can be"
        raise InputError(
            f"{name} cannot be set here{meant}. What K is, and which camera it is of, is changed with 'calibrary "
            "registry add' and 'approve'"
        )
    if operator not in EDITABLE[field]:
        raise InputError(f"{field}{operator} is not possible, expected {' or '.join(EDITABLE[field])}")
    return Assignment(field=field, operator=operator, value=value.strip())


def assigned(assignments: Sequence[Assignment]) -> Edit:
    """Return a function that applies assignments to an entry, in order."""

    def edit_one(entry: Entry) -> Entry:
        for one in assignments:
            entry = _set(entry, one)
        return entry

    return edit_one


def _set(entry: Entry, one: Assignment) -> Entry:
    if one.field == "label":
        return replace(entry, label=one.value or None)
    if one.field == "tags":
        words = [word.strip() for word in one.value.split(",") if word.strip()]
        if one.operator == "=":
            return replace(entry, tags=tuple(words))
        add, remove = (words, ()) if one.operator == "+=" else ((), words)
        return retagged(add, remove)(entry)
    if one.field == "notes":
        said = tuple(line.strip() for line in one.value.splitlines() if line.strip())
        notes = (*entry.notes, *said) if one.operator == "+=" else said
        return replace(entry, calibration=replace(entry.calibration, notes=notes))
    first, last = (entry.validity.first, entry.validity.last) if entry.validity is not None else (None, None)
    stated = _day(one)
    first, last = (stated, last) if one.field == "valid-from" else (first, stated)
    valid = Validity(first=first, last=last) if first is not None or last is not None else None
    return replace(entry, validity=valid)


def retagged(add: Sequence[str], remove: Sequence[str]) -> Edit:
    """Return a function that adds tags to an entry and removes others."""
    return lambda entry: replace(entry, tags=tuple(({*entry.tags} - {*remove}) | {*add}))


def _day(one: Assignment) -> date | None:
    try:
        return date.fromisoformat(one.value) if one.value else None
    except ValueError:
        raise InputError(f"{one.field}={one.value:.40} is not a day such as 2026-05-01") from None


def labelling(snapshot: Snapshot, key: str, label: str | None) -> Proposals:
    """Propose a label, or its removal, for all entries of a unit.

    Args:
        snapshot: newest state of the registry.
        key: key of the unit, or of one of its entries.
        label: new label; None removes it.

    Raises:
        UnknownCameraError: the unit does not exist.
        AmbiguousCameraError: the KEY matches several units.
        RegistryError: an entry cannot be read.
    """
    found = snapshot.matching(key)
    units = {unit_folder(path) or in_use_path(path) for path in found}
    if len(units) != 1:
        # Raises the error that there is no match, or names the matches.
        snapshot.find(key)
        raise AmbiguousCameraError(
            f"{key} fits {len(units)} units: {', '.join(sorted(units))}; name one of them"
        )
    [unit] = units
    paths = [path for path in (*snapshot.paths, *snapshot.proposed) if in_use_path(path).startswith(unit)]
    return edit(snapshot, dict.fromkeys(paths, lambda entry: replace(entry, label=label)), verb="Label")


def edit(snapshot: Snapshot, changes: Mapping[str, Edit], *, verb: str, approve: bool = False) -> Proposals:
    """Propose changed entries, and changes of their proposals; nothing is written.

    Args:
        snapshot: newest state of the registry.
        changes: function that returns the changed entry, by path; K is not changed.
        verb: first word of the commit's subject.
        approve: approve new days at once; otherwise they are proposed.

    Raises:
        InputError: a label, tag, note or day is not valid.
        RegistryError: an entry cannot be read, or is held and its days would change.
    """
    beside = {
        proposal_path(path): change
        for path, change in changes.items()
        if proposal_path(path) in snapshot.proposed
    }
    every = {**beside, **changes}
    stored = [one for path in every if (one := snapshot.at(path)) is not None]
    after = {one.path: _changed(one.entry, every[one.path]) for one in stored}
    dated = [one for one in stored if after[one.path].validity != one.entry.validity]
    if not dated:
        items = [proposal_of(after[one.path], one.entry, one.oid, path=one.path) for one in stored]
        return checked(snapshot, items, verb, only_new=True)
    edited = [one for one in dated if _without_days(after[one.path]) != _without_days(one.entry)]
    if edited:
        raise InputError(
            f"{edited[0].id}: a label, tags and notes are written at once and days wait for approval; set them one "
            "after the other"
        )
    waiting = next((one for one in stored if one.proposal is not None), None)
    if waiting is not None:
        raise RegistryError(
            f"{waiting.id}: another K is proposed for it; approve that, with its days, or retire it first"
        )
    return propose(snapshot, [after[one.path] for one in stored], approve=approve, edited=True)


def _changed(entry: Entry, change: Edit) -> Entry:
    try:
        return change(entry)
    except InputError as error:
        raise InputError(error.message, source=entry.id, place=error.place) from None


def _without_days(entry: Entry) -> Entry:
    return replace(entry, validity=None)
