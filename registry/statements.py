"""Statements: small signed files in the tree of a registry that say what is approved or retired, and by whom.

A statement is a file ``statements/<subject>/<32 hex>``: canonical JSON, then the signature in the form of ssh-keygen.
The name is the SHA-256 of the JSON. Files are only ever added. They are content, so that they survive a squash, a
rebase, a cherry-pick and a force push of the history.

The order of a subject's statements comes from the statements themselves: each names those that were the newest when it
was made (``after``). Neither git's history nor a clock orders them.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from datetime import date
from typing import Any, Final, Literal

import msgspec
from msgspec import Struct, field

from calibrary.errors import InputError
from calibrary.records import Json, to_json
from calibrary.registry.configuration import RuleSet
from calibrary.registry.entry import Entry
from calibrary.registry.paths import STATEMENTS, SUFFIX
from calibrary.registry.sshsig import ARMOR, BadSignatureError, fingerprint, signed_by

NAMESPACE: Final = "calibrary-statement-1"
RULES: Final = "rules"
"""Subject of the statements on who may approve."""
FOUNDATION: Final = "found"
LEDGERS: Final = f"{STATEMENTS}closed/"
"""Lists that a foundation or a change of the rules names by their digest."""
LARGEST_STATEMENT: Final = 256 << 10
FREE: Final = ("status", "reason", "label", "tags", "notes")
"""Fields of an entry that an approval does not cover: they do not decide which K an image gets."""
NAME: Final = re.compile("[0-9a-f]{32}")

Action = Literal["found", "rules", "propose", "approve", "retire", "label"]


class Body(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a statement says.

    Attributes:
        action: what is stated.
        registry: id of the foundation; empty in the foundation itself.
        rules: id of the rules in force when it was made; empty in the foundation.
        subject: what it is about: an entry's path without its ending, ``labels/<unit>``, or ``rules``.
        after: ids of the statements on this subject that were the newest.
        content: digest of the entry without status, reason, label, tags and notes; see :func:`content_of`.
        blob: git's id of a file with this content, to find it again.
        start: first day of a retirement; None if it is of all days.
        label: name of a unit; empty if it has none any more.
        reason: why.
        person, email: who says so.
        made: when, for people; nothing is decided by it but the first and last day of a person.
        terms: people and requirements of a foundation or a change of the rules.
        ledger: digests of the lists that it names, by the part of the subjects: what a foundation adopts, which
            statements there were when the rules changed.
    """

    schema: Literal["calibrary/statement-1"] = "calibrary/statement-1"
    action: Action
    registry: str = ""
    rules: str = ""
    subject: str
    after: tuple[str, ...] = ()
    content: str | None = None
    blob: str | None = None
    start: date | None = field(name="from", default=None)
    label: str | None = None
    reason: str | None = None
    person: str
    email: str = ""
    made: str
    terms: dict[str, Any] | None = None
    ledger: dict[str, str] | None = None


class Signed(Struct, frozen=True, kw_only=True):
    """A statement as it was read, with the key of its signature.

    Attributes:
        id: 32 hexadecimal digits.
        key: fingerprint of the key; None if it is not signed.
    """

    id: str
    body: Body
    key: str | None

    @property
    def subject(self) -> str:
        """What it is about."""
        return self.body.subject


class Broken(Struct, frozen=True, kw_only=True):
    """A file among the statements that is none, or whose signature is wrong.

    Attributes:
        path: path of the file.
        why: in words.
        body: what it says, if that is intact and only the signature is wrong.
    """

    path: str
    why: str
    body: Body | None = None

    @property
    def id(self) -> str:
        """Its name."""
        return self.path.rpartition("/")[2]


def canonical(value: Json) -> bytes:
    """Return the one form of a JSON value: sorted keys, no blanks, a line end."""
    text = json.dumps(value, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return f"{text}\n".encode()


def sha256(data: bytes) -> str:
    """Return the SHA-256 as 64 hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def content_of(entry: Entry) -> str:
    """Return the digest of everything in an entry that an approval covers, however its file is written."""
    document = to_json(entry)
    return sha256(canonical({name: value for name, value in document.items() if name not in FREE}))


def subject_of(path: str) -> str:
    """Return the subject of the statements on an entry, by its path in ``cameras/``."""
    return path.removesuffix(SUFFIX)


def statement_path(body: Body) -> str:
    """Return the path of a statement."""
    return f"{STATEMENTS}{body.subject}/{sha256(encoded(body))[:32]}"


def encoded(body: Body) -> bytes:
    """Return the JSON of a statement, which is what is signed."""
    return canonical(msgspec.to_builtins(body))


def statement_bytes(body: Body, signature: str = "") -> bytes:
    """Return the file of a statement."""
    return encoded(body) + signature.encode()


def parse_statement(path: str, data: bytes) -> Signed | Broken:
    """Read a statement and verify its signature, if it has one."""
    folder, _, name = path.removeprefix(STATEMENTS).rpartition("/")
    if len(data) > LARGEST_STATEMENT:
        return Broken(path=path, why=f"is larger than {LARGEST_STATEMENT >> 10} KiB")
    at = data.find(ARMOR.encode())
    text, armor = (data, b"") if at < 0 else (data[:at], data[at:])
    if NAME.fullmatch(name) is None or sha256(text)[:32] != name:
        return Broken(path=path, why="its name is not the digest of what it says: it was edited or renamed")
    try:
        plain = json.loads(text)
        body = msgspec.convert(plain, Body)
        if canonical(plain) != text:
            return Broken(path=path, why="is not in the form that statements are written in")
    except (ValueError, RecursionError, msgspec.ValidationError) as error:
        return Broken(path=path, why=f"is not a statement: {error}")
    if body.subject != folder:
        return Broken(path=path, why=f"is about {body.subject} and lies with {folder}", body=body)
    try:
        key = fingerprint(signed_by(text, armor.decode("ascii"), NAMESPACE)) if armor else None
    except (BadSignatureError, UnicodeDecodeError) as error:
        return Broken(path=path, why=f"its signature is {error}", body=body)
    return Signed(id=name, body=body, key=key)


def state_after(previous: str, body: Body) -> str:
    """Return the id of the rules that a foundation or a change of the rules puts in force."""
    stated: Json = {"previous": previous, "terms": body.terms, "ledger": dict(body.ledger or {})}
    return sha256(canonical(stated))


def rule_set(body: Body) -> RuleSet:
    """Return the people and requirements that a statement on the rules states.

    Raises:
        InputError: it states none, or they are not valid.
    """
    if body.terms is None:
        raise InputError("states no rules")
    return RuleSet.parsed(body.terms)


def ledger_path(digest: str) -> str:
    """Return the path of a part of a list."""
    return f"{LEDGERS}{digest}"


FEW: Final = 2000
"""Lines of a list up to which it is one file."""


def line_key(subject: str) -> str:
    """Return the first word of a subject's lines in a list."""
    return sha256(subject.encode())[:24]


def ledger_files(lines: Mapping[str, Sequence[str]]) -> tuple[dict[str, str], dict[str, bytes]]:
    """Return the digests of the parts of a list, and the files with them, by path.

    Args:
        lines: what the list says of each subject.
    """
    is_one = sum(map(len, lines.values())) <= FEW
    parts: dict[str, list[str]] = {}
    for subject, those in lines.items():
        part = "" if is_one else sha256(subject.encode())[:2]
        parts.setdefault(part, []).extend(f"{line_key(subject)} {line}\n" for line in those)
    data = {part: "".join(sorted(those)).encode() for part, those in parts.items()}
    digests = {part: sha256(text) for part, text in data.items()}
    return digests, {ledger_path(digests[part]): text for part, text in data.items()}
