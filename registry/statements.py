"""Statements: small signed files in the tree of a registry that say what is approved or retired, and by whom.

A statement is a file ``events/<subject>/<day>-<action>-<who>-<32 hex>.json``: JSON, then the signature in the form
of ssh-keygen. The digits are of the SHA-256 of the JSON. Files are only ever added, and never changed or moved. An
approval holds the content that it approves, so that no change of another file takes it away. What they put in force
does not depend on their order; see :mod:`calibrary.registry.in_force`.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from datetime import date
from typing import Any, Final, Literal

import msgspec
from msgspec import Struct, field, structs

from calibrary.errors import InputError
from calibrary.records import Json, from_json, replace, to_json
from calibrary.registry.configuration import RuleSet
from calibrary.registry.entry import Entry, Status
from calibrary.registry.paths import EVENTS, SUFFIX, slug
from calibrary.registry.sshsig import ARMOR, BadSignatureError, fingerprint, signed_by

NAMESPACE: Final = "calibrary-statement-1"
RULES: Final = "rules"
"""Subject of the statements on who may approve."""
FOUNDATION: Final = "found"
LARGEST_STATEMENT: Final = 1 << 20
FREE: Final = ("label", "tags", "notes")
"""Fields of an entry that an approval does not cover: they do not decide which K an image gets."""
DIGITS: Final = 32

Action = Literal["found", "rules", "approve", "retire", "label"]


class Body(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a statement says.

    Attributes:
        action: what is stated.
        person, email: who says so; where people have keys, their keys decide.
        made: when, for people; nothing is decided by it.
        reason: why.
        subject: what it is about: an entry's path without its ending, ``labels/<unit>``, or ``rules``.
        registry: id of the foundation; empty in the foundation itself.
        replaces: ids of the contents that the approved one takes the place of.
        restores: ids of the retirements that do not end it.
        contents: ids of the contents that a retirement ends; None for all that do not restore themselves.
        start: first day of a retirement; None if it is of all days.
        label: name of a unit; empty if it has none any more.
        over: ids of the labels, or of the changes of the rules, that this one was made after.
        previous: id of the rules that a change of the rules follows.
        keeps: ids of contents and statements that stay in force although the new rules do not allow them.
        terms: people and requirements of a foundation or a change of the rules.
        content: the approved entry, without what an approval does not cover.
    """

    schema: Literal["calibrary/statement-2"] = "calibrary/statement-2"
    action: Action
    person: str
    email: str = ""
    made: str
    reason: str | None = None
    subject: str
    registry: str = ""
    replaces: tuple[str, ...] = ()
    restores: tuple[str, ...] = ()
    contents: tuple[str, ...] | None = None
    start: date | None = field(name="from", default=None)
    label: str | None = None
    over: tuple[str, ...] = ()
    previous: str = ""
    keeps: tuple[str, ...] = ()
    terms: dict[str, Any] | None = None
    content: dict[str, Any] | None = None


class Signed(Struct, frozen=True, kw_only=True):
    """A statement as it was read, with the key of its signature.

    Attributes:
        path: path of its file.
        key: fingerprint of the key; None if it is not signed.
    """

    path: str
    body: Body
    key: str | None

    @property
    def id(self) -> str:
        """Its digits."""
        return id_in(self.path)

    @property
    def subject(self) -> str:
        """What it is about."""
        return self.body.subject


class Broken(Struct, frozen=True, kw_only=True):
    """A file among the statements that is none, or whose signature is wrong.

    Attributes:
        path: path of the file.
        why: in words.
        ends: whether it may be a retirement.
    """

    path: str
    why: str
    ends: bool = False

    @property
    def id(self) -> str:
        """Its digits, if its name is that of a statement."""
        return id_in(self.path)


def id_in(path: str) -> str:
    """Return the digits in the name of a statement's file."""
    return path.removesuffix(ENDING)[-DIGITS:]


ENDING: Final = ".json"


def canonical(value: Json) -> bytes:
    """Return the one form of a JSON value: sorted keys, no blanks, a line end."""
    text = json.dumps(value, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return f"{text}\n".encode()


def sha256(data: bytes) -> str:
    """Return the SHA-256 as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def approved_of(entry: Entry) -> dict[str, Any]:
    """Return what an approval covers of an entry, as it stands in a statement."""
    return {
        name: _stated(value)
        for name, value in to_json(entry).items()
        if name not in FREE and _is_stated(value)
    }


def _stated(value: Json) -> Json:
    if isinstance(value, dict):
        return {name: _stated(one) for name, one in value.items() if _is_stated(one)}
    return [_stated(one) for one in value] if isinstance(value, list) else value


def _is_stated(value: Json) -> bool:
    return value is not None and value not in ([], {})


def content_of(entry: Entry) -> str:
    """Return the digest of everything in an entry that an approval covers, however its file is written."""
    return sha256(canonical(approved_of(entry)))


def entry_in(content: Mapping[str, Any], source: str) -> Entry:
    """Return the entry that a statement approves.

    Raises:
        InputError: it is none.
    """
    return replace(from_json(Entry, dict(content), source=source), status=Status.APPROVED)


def subject_of(path: str) -> str:
    """Return the subject of the statements on an entry, by its path in ``cameras/``."""
    return path.removesuffix(SUFFIX)


def subject_in(path: str) -> str:
    """Return the subject of a statement by its path."""
    return path.removeprefix(EVENTS).rpartition("/")[0]


def entry_path(path: str) -> str:
    """Return the path of the entry that a statement is on, by the statement's path; any other path as it is."""
    return f"{subject_in(path)}{SUFFIX}" if path.startswith(EVENTS) else path


def action_in(path: str) -> str | None:
    """Return what a statement does, by its path; None if it is no path of one."""
    found = re.search(r"/\d{4}-\d\d-\d\d-([a-z]+)-[^/]*$", path)
    return found[1] if found is not None else None


def statement_path(body: Body) -> str:
    """Return the path of a statement."""
    name = f"{body.made[:10]}-{body.action}-{slug(body.person)}-{sha256(encoded(body))[:DIGITS]}{ENDING}"
    return f"{EVENTS}{body.subject}/{name}"


def encoded(body: Body) -> bytes:
    """Return the JSON of a statement, which is what is signed."""
    return msgspec.json.format(msgspec.json.encode(body), indent=1) + b"\n"


def statement_bytes(body: Body, signature: str = "") -> bytes:
    """Return the file of a statement."""
    return encoded(body) + signature.encode()


def parse_statement(path: str, data: bytes) -> Signed | Broken:
    """Read a statement and verify its signature, if it has one."""
    found = _parsed(path, data)
    if isinstance(found, Broken):
        return structs.replace(found, ends=may_end(path) or b'"action": "retire"' in data)
    return found


def may_end(path: str) -> bool:
    """Return whether a file has the name of a retirement."""
    return "-retire-" in path.rpartition("/")[2]


def _parsed(path: str, data: bytes) -> Signed | Broken:
    if len(data) > LARGEST_STATEMENT:
        return Broken(path=path, why=f"is larger than {LARGEST_STATEMENT >> 10} KiB")
    at = data.find(ARMOR.encode())
    text, armor = (data, b"") if at < 0 else (data[:at], data[at:])
    try:
        body = msgspec.json.decode(text, type=Body)
    except (ValueError, RecursionError) as error:
        return Broken(path=path, why=f"is not a statement: {error}")
    if encoded(body) != text:
        return Broken(path=path, why="is not in the form that statements are written in")
    if statement_path(body) != path:
        return Broken(path=path, why="its name is not that of what it says: it was edited, moved or renamed")
    try:
        key = fingerprint(signed_by(text, armor.decode("ascii"), NAMESPACE)) if armor else None
    except (BadSignatureError, UnicodeDecodeError) as error:
        return Broken(path=path, why=f"its signature is {error}")
    return Signed(path=path, body=body, key=key)


def state_after(body: Body) -> str:
    """Return the id of the rules that a foundation or a change of the rules puts in force."""
    stated: Json = {
        "previous": body.previous,
        "terms": body.terms,
        "keeps": [*body.keeps],
        "over": [*body.over],
    }
    return sha256(canonical(stated))[:DIGITS]


def rule_set(body: Body) -> RuleSet:
    """Return the people and requirements that a statement on the rules states.

    Raises:
        InputError: it states none, or they are not valid.
    """
    if body.terms is None:
        raise InputError("states no rules")
    return RuleSet.parsed(body.terms)
