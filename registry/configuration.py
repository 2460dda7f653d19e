"""The registry's configuration, ``registry.yaml``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Final

from calibrary.errors import InputError, ParseError, RegistryError
from calibrary.policy import FLEET, POLICIES, Policy
from calibrary.records import Json, Meta, Record, from_json, to_json
from calibrary.registry.entry import CURRENT
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import DOCUMENT
from calibrary.registry.places import CONFIGURATION_FILE
from calibrary.strictyaml import YamlValue, line_of, load_yaml

__all__ = [
    "LAYOUT",
    "ApprovalRule",
    "Configuration",
    "configuration_at",
    "configuration_yaml",
    "parse_configuration",
]

LAYOUT: Final = 1
"""Version of the folder layout ``cameras/<make>/<model>/[sn-<hash>/]<variant>.yaml``."""

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
# Whose approval it takes before an entry is used, such as
# approvals: {{by: ["ada@example.com", "ssh-ed25519 AAAA…"], count: 2, not_author: true}}
{approvals}"""


KEY: Final = re.compile(r"(?:sk-)?(?:ssh|ecdsa)-\S+ \S+")
FINGERPRINT: Final = re.compile(r"(?:[0-9A-Fa-f]{4} *){10}")


class ApprovalRule(Record):
    """Requirements for the use of an entry; ``calibrary registry check BASE..HEAD`` applies those of BASE.

    Attributes:
        by: people whose approvals count: names or addresses as in git, or public ssh keys or the 40 digits of OpenPGP
            fingerprints, with which the approving commit must then be signed; if empty, all people.
        count: required number of different people.
        not_author: whether the approval of the proposal's author does not count.
    """

    by: Annotated[tuple[Annotated[str, Meta(min_length=1, max_length=2000)], ...], Meta(max_length=200)] = ()
    count: Annotated[int, Meta(ge=1, le=20)] = 1
    not_author: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """Public ssh keys in ``by``."""
        return tuple(one for one in self.by if KEY.match(one))

    @property
    def fingerprints(self) -> tuple[str, ...]:
        """OpenPGP fingerprints in ``by``, as 40 upper-case hexadecimal digits."""
        return tuple(one.replace(" ", "").upper() for one in self.by if FINGERPRINT.fullmatch(one))

    @property
    def is_signed(self) -> bool:
        """Whether approvals must be in signed commits."""
        return bool(self.keys or self.fingerprints)

    @property
    def people(self) -> tuple[str, ...]:
        """Names and addresses in ``by``."""
        return tuple(one for one in self.by if not (KEY.match(one) or FINGERPRINT.fullmatch(one)))


class Configuration(Record, tag_field="schema", tag="calibrary/registry-1"):
    """Configuration of a registry: its rules and its layout.

    Attributes:
        layout: 1: cameras/<make>/<model>/[sn-<hash>/]<variant>.yaml.
        entries: newest schema version in which entries are written.
        policy: policy for the entries; fleet when absent.
        approvals: requirements for the use of an entry; one approval by any person when absent.
    """

    layout: Annotated[int, Meta(ge=1, le=LAYOUT)] = LAYOUT
    entries: Annotated[str, Meta(pattern="^calibrary/entry-[0-9]{1,6}$")] = f"calibrary/entry-{CURRENT}"
    policy: Policy = FLEET
    approvals: ApprovalRule | None = None

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


def configuration_yaml(policy: str = FLEET.name, *, not_author: bool = False) -> bytes:
    """Return the file for a new registry.

    Args:
        policy: name of an included policy.
        not_author: whether the approval of the proposal's author does not count.
    """
    approvals = "approvals: {not_author: true}\n" if not_author else ""
    text = TEXT.format(layout=LAYOUT, entries=CURRENT, policy=policy, models=DOCUMENT, approvals=approvals)
    return text.encode()


def parse_configuration(data: bytes, name: str = CONFIGURATION_FILE) -> Configuration:
    """Read a configuration.

    Raises:
        ParseError: it is not YAML, does not match schemas/registry-1.schema.json, or has a newer layout than is
            supported.
        InputError: a limit of its policy is out of range.
    """
    value = load_yaml(data, source=name, max_bytes=LARGEST)
    if isinstance(value, dict):
        _refuse_newer(value, name)
    return from_json(Configuration, value, source=name, locate=partial(line_of, data))


def configuration_at(repo: Repository, commit: str) -> Configuration:
    """Return the configuration at a commit; the default if there was none.

    Raises:
        RegistryError: the configuration cannot be read.
    """
    blob = repo.read(commit, CONFIGURATION_FILE)
    try:
        return parse_configuration(blob.data) if blob is not None else Configuration()
    except InputError as error:
        raise RegistryError(f"{repo.path}: {error}") from None


def _refuse_newer(document: Mapping[str, YamlValue], name: str) -> None:
    supported = {"registry": 1, "entry": CURRENT}
    for place in ("schema", "entries"):
        said = document.get(place)
        found = SCHEMA.fullmatch(said) if isinstance(said, str) else None
        if found is not None and int(found[2]) > supported[found[1]]:
            raise _newer(name, place, str(said), f"calibrary/{found[1]}-{supported[found[1]]}")
    layout = document.get("layout")
    if type(layout) is int and layout > LAYOUT:
        raise _newer(name, "layout", str(layout), str(LAYOUT))


def _newer(name: str, place: str, found: str, supported: str) -> ParseError:
    return ParseError(
        f"is {found}, and this calibrary reads up to {supported}; upgrade calibrary: the registry was written by a "
        "newer version, and git log shows when",
        source=name,
        place=place,
    )
