"""The registry's configuration, ``registry.yaml``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from typing import Annotated, Any, Final

from calibrary.errors import InputError, RegistryError
from calibrary.policy import FLEET, POLICIES, Policy
from calibrary.records import Json, Meta, Record, from_json, replace, to_json
from calibrary.registry.entry import CURRENT
from calibrary.registry.firmware import Version, compare
from calibrary.registry.git.errors import TooLargeError
from calibrary.registry.git.history import history
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import DOCUMENT, id_of
from calibrary.registry.places import CONFIGURATION_FILE
from calibrary.registry.sshsig import KEY, fingerprint, key_blob
from calibrary.strictyaml import YamlValue, line_of, load_yaml

LAYOUT: Final = 3
"""Version of the layout: ``cameras/<make>/<model>/[sn-<hash>/]<variant>.yaml``, and ``events/`` since the third."""
LARGEST: Final = 64 << 10
SCHEMA: Final = re.compile(r"calibrary/(registry|entry)-(\d{1,6})")

TEXT: Final = """\
# yaml-language-server: $schema=schema/registry-1.schema.json
# A registry of camera calibrations, written by calibrary; README.md explains how to read and review it.
schema: "calibrary/registry-1"
layout: {layout}
# {models} has the formula of each distortion model with its parameters in order.
# The newest schema that entries are written in; older ones are still read.
entries: "calibrary/entry-{entries}"
# The limits that an entry is checked against before it is approved: "fleet", "source", or limits of your own, as in
# policy: {{schema: "calibrary/policy-1", name: "ours", base: "fleet", focal_symmetry_max: 0.05}}
policy: "{policy}"
# Whose approval it takes before an entry is used. Where people have keys, what they state is signed with them, such as
# people: [{{name: "Ada", keys: ["ssh-ed25519 AAAA…"]}}, {{name: "Bob", keys: ["ssh-ed25519 AAAB…"]}}]
# approvals: {{by: ["Ada", "Bob"], count: 2}}
# With count: 0 nobody has to: what stands in cameras/ is used.
# A change of these three takes effect with 'calibrary registry approve registry.yaml'.
"""


FINGERPRINT: Final = re.compile(r"(?:[0-9A-Fa-f]{4} *){10}")


class ApprovalRule(Record):
    """Requirements for the use of an entry.

    Attributes:
        by: people whose approvals count: names of people:, or where those have no keys names or addresses as in git; if
            empty, all people.
        count: required number of different people; 0 if what stands in ``cameras/`` is used as it is.
    """

    by: Annotated[tuple[Annotated[str, Meta(min_length=1, max_length=2000)], ...], Meta(max_length=200)] = ()
    count: Annotated[int, Meta(ge=0, le=20)] = 1

    @property
    def keys(self) -> tuple[str, ...]:
        """Public ssh keys in ``by``."""
        return tuple(one for one in self.by if KEY.match(one))

    @property
    def fingerprints(self) -> tuple[str, ...]:
        """OpenPGP fingerprints in ``by``, as 40 upper-case hexadecimal digits."""
        return tuple(one.replace(" ", "").upper() for one in self.by if FINGERPRINT.fullmatch(one))


class Keyholder(Record):
    """A person of a registry, and the keys that this person signs with.

    Attributes:
        name: name, by which approvals: may ask for this person.
        keys: public ssh keys; no key is of two people.
    """

    name: Annotated[str, Meta(min_length=1, max_length=200)]
    keys: Annotated[tuple[Annotated[str, Meta(min_length=1, max_length=4000)], ...], Meta(max_length=20)] = ()


class RuleSet(Record):
    """Who belongs to a registry, whose approval an entry takes, and its limits: what a statement puts in force.

    Attributes:
        people: people with their keys.
        approvals: requirements; one approval by anybody when absent.
        policy: limits of the entries.
    """

    people: tuple[Keyholder, ...] = ()
    approvals: ApprovalRule = ApprovalRule()
    policy: Policy = FLEET

    @classmethod
    def parsed(cls, document: Json) -> RuleSet:
        """Read the rules of a statement.

        Raises:
            InputError: they are not valid, or one key is of two people.
        """
        rules = from_json(cls, document, source="the rules of a statement")
        if (problem := rules.problem) is not None:
            raise InputError(problem)
        return rules

    @property
    def is_signed(self) -> bool:
        """Whether statements count only if they are signed: somebody has a key."""
        return any(one.keys for one in self.people)

    @property
    def owners(self) -> Mapping[str, Keyholder]:
        """The people by the fingerprints of their keys."""
        blobs = ((key_blob(key), one) for one in self.people for key in one.keys)
        return {fingerprint(blob): one for blob, one in blobs if blob is not None}

    @property
    def problem(self) -> str | None:
        """Return why these rules cannot be in force; None if they can."""
        keys = [(key_blob(key), one.name) for one in self.people for key in one.keys]
        if wrong := next((name for blob, name in keys if blob is None), None):
            return f"people: what {wrong} has for a key is no public ssh key"
        if len({blob for blob, _ in keys}) < len(keys):
            twice = next(blob for blob, _ in keys if sum(one == blob for one, _ in keys) > 1)
            names = sorted(name for blob, name in keys if blob == twice)
            return f"people: one key stands {len(names)} times, for {' and '.join(names)}; a key is of one person"
        names = [one.name for one in self.people]
        if len(set(names)) < len(names):
            return f"people: {next(one for one in names if names.count(one) > 1)} stands twice"
        rule = self.approvals
        if rule.keys or rule.fingerprints:
            return (
                'approvals: by names people, and their keys stand in people: - {name: NAME, keys: ["ssh-…"]}; OpenPGP '
                "keys sign no statements"
            )
        if self.is_signed:
            able = {one.name for one in self.people if one.keys}
            if unknown := [name for name in rule.by if name not in able]:
                return f"approvals: by names {unknown[0]}, who has no key in people:"
            asked = [*rule.by] or [*able]
            if len(set(asked)) < rule.count:
                return f"approvals: {rule.count} approvals cannot come together from {len(set(asked))} people"
        return None


class Repeat(Record):
    """When the calibrations of a model are to be made again.

    Attributes:
        of: beginning of their KEYs, such as dji/fc6310r.
        months: age in whole months from which one is; by default what --stale-after-months says.
        firmware: one that was made under an earlier firmware is, too.
    """

    of: Annotated[str, Meta(min_length=1, max_length=200)]
    months: Annotated[int, Meta(ge=1, le=1200)] | None = None
    firmware: Version | None = None

    def __post_init__(self) -> None:
        if self.firmware is not None:
            compare(self.firmware, self.firmware)

    def is_on(self, path: str) -> bool:
        """Whether the entry at a path is one of those."""
        return f"{id_of(path)}/".startswith(f"{self.of.lower().strip('/')}/")


class Configuration(Record, tag_field="schema", tag="calibrary/registry-1"):
    """Configuration of a registry: its rules and its layout.

    Attributes:
        layout: 3: cameras/<make>/<model>/[sn-<hash>/]<variant>.yaml, and events/, which say what is approved.
        entries: newest schema version in which entries are written.
        policy: policy for the entries; fleet when absent.
        people: people of the registry with the keys that they sign with.
        approvals: requirements for the use of an entry; one approval by any person when absent.
        repeat: when the calibrations of some models are to be made again; of those that fit, the longest name counts.
        damage: why the file cannot be read, and that this is what it said before; None if it can.
    """

    layout: Annotated[int, Meta(ge=LAYOUT, le=LAYOUT)] = LAYOUT
    entries: Annotated[str, Meta(pattern="^calibrary/entry-[0-9]{1,6}$")] = f"calibrary/entry-{CURRENT}"
    policy: Policy = FLEET
    people: Annotated[tuple[Keyholder, ...], Meta(max_length=200)] = ()
    approvals: ApprovalRule | None = None
    repeat: Annotated[tuple[Repeat, ...], Meta(max_length=200)] = ()
    damage: str | None = None
    _unwritten = frozenset({"damage"})

    def repeat_of(self, path: str, months: int) -> Repeat:
        """Return when the calibration at a path is to be made again; after so many months if nothing says otherwise."""
        fits = [one for one in self.repeat if one.is_on(path)]
        rule = max(fits, key=lambda one: len(one.of), default=Repeat(of=id_of(path)))
        return replace(rule, months=rule.months or months)

    @property
    def rules(self) -> RuleSet:
        """What this file asks for; a statement puts it in force."""
        return RuleSet(people=self.people, approvals=self.approvals or ApprovalRule(), policy=self.policy)

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        """Replace the name of an included policy by its content, and ignore ``x-`` fields."""
        if "layout" not in document:
            raise InputError("lacks layout")
        if isinstance(name := document.get("policy"), str):
            if name not in POLICIES:
                raise InputError(f"is not one of {', '.join(POLICIES)}", place="policy")
            document["policy"] = to_json(POLICIES[name])
        return {key: value for key, value in document.items() if not key.startswith("x-")}

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        policy = schema["properties"]["policy"]
        schema["properties"]["policy"] = {
            "anyOf": [{"enum": list(POLICIES)}, {"$ref": policy["$ref"]}],
            "description": policy["description"],
        }
        return schema | {"required": ["schema", "layout"], "patternProperties": {"^x-": {}}}


def configuration_yaml(policy: str = FLEET.name) -> bytes:
    """Return the file for a new registry.

    Args:
        policy: name of an included policy.
    """
    text = TEXT.format(layout=LAYOUT, entries=CURRENT, policy=policy, models=DOCUMENT)
    return text.encode()


def parse_configuration(data: bytes, name: str = CONFIGURATION_FILE) -> Configuration:
    """Read a configuration.

    Raises:
        ParseError: it is not YAML, or does not match schemas/registry-1.schema.json.
        InputError: a limit of its policy is out of range.
        RegistryError: it has another layout than is supported.
    """
    value = load_yaml(data, source=name, max_bytes=LARGEST)
    if isinstance(value, dict):
        _refuse_other(value, name)
    return from_json(Configuration, value, source=name, locate=partial(line_of, data))


def configuration_at(repo: Repository, commit: str) -> Configuration | None:
    """Return the configuration at a commit, if need be the last one that can be read; None if there is none.

    Raises:
        RegistryError: it is of another layout than is supported, or git cannot read it.
    """
    try:
        blob = repo.read(commit, CONFIGURATION_FILE)
        return parse_configuration(blob.data) if blob is not None else None
    except (InputError, TooLargeError) as error:
        damage = f"{error}; until it is corrected, what it said before counts"
    for revision in history(repo, CONFIGURATION_FILE, commit):
        with suppress(InputError, TooLargeError):
            if revision.oid is not None:
                return replace(parse_configuration(repo.blob(revision.oid)), damage=damage)
    return Configuration(damage=damage)


def _refuse_other(document: Mapping[str, YamlValue], name: str) -> None:
    supported = {"registry": 1, "entry": CURRENT}
    for place in ("schema", "entries"):
        said = document.get(place)
        found = SCHEMA.fullmatch(said) if isinstance(said, str) else None
        if found is not None and int(found[2]) > supported[found[1]]:
            raise _newer(name, place, str(said), f"calibrary/{found[1]}-{supported[found[1]]}")
    layout = document.get("layout")
    if type(layout) is int and layout > LAYOUT:
        raise _newer(name, "layout", str(layout), str(LAYOUT))
    if type(layout) is int and 0 < layout < LAYOUT:
        raise RegistryError(
            f"{name}: layout: is {layout}, an earlier one; 'calibrary registry init FOLDER --migrate' brings it to "
            f"{LAYOUT}"
        )


def _newer(name: str, place: str, found: str, supported: str) -> RegistryError:
    return RegistryError(
        f"{name}: {place}: is {found}, and this calibrary reads up to {supported}; upgrade calibrary: the registry was "
        "written by a newer version, and git log shows when"
    )
