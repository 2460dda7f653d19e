"""``registry.yaml``, the configuration at a registry's root, and which folder is the registry that is meant."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

from platformdirs import user_data_path

from calibrary.distortion.described import DOCUMENT
from calibrary.errors import InputError, ParseError, RegistryError
from calibrary.policy import FLEET, POLICIES, Policy
from calibrary.records import Json, Meta, Record, from_json, to_json
from calibrary.registry.entry_form import CURRENT
from calibrary.registry.git.repository import Repository
from calibrary.strictyaml import YamlValue, line_of, load_yaml

__all__ = [
    "CONFIGURATION_FILE",
    "LAYOUT",
    "VARIABLE",
    "ApprovalRule",
    "Configuration",
    "configuration_at",
    "configuration_yaml",
    "default_place",
    "find_registry",
    "named_registries",
    "parse_configuration",
    "plain_folder",
    "require_registry",
]

CONFIGURATION_FILE: Final = "registry.yaml"
"""The file at a registry's root."""

LAYOUT: Final = 1
"""How files lie: ``cameras/<make>/<model>/[sn-<hash>/]<variant>.yaml``."""

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
    """What it takes for an entry to be used; ``calibrary registry check BASE..HEAD`` judges by what BASE asks for.

    Attributes:
        by: whose approvals count: names or addresses as git has them, or public ssh keys or the 40 digits of OpenPGP
            fingerprints, with which the approving commit then has to be signed; everybody's where none is listed.
        count: of different people.
        not_author: whether the approval of whoever proposed it does not count.
    """

    by: Annotated[tuple[Annotated[str, Meta(min_length=1, max_length=2000)], ...], Meta(max_length=200)] = ()
    count: Annotated[int, Meta(ge=1, le=20)] = 1
    not_author: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """The public ssh keys among those who approve."""
        return tuple(one for one in self.by if KEY.match(one))

    @property
    def fingerprints(self) -> tuple[str, ...]:
        """The OpenPGP keys among them, as 40 capital hex digits."""
        return tuple(one.replace(" ", "").upper() for one in self.by if FINGERPRINT.fullmatch(one))

    @property
    def is_signed(self) -> bool:
        """Whether an approval counts only in a signed commit."""
        return bool(self.keys or self.fingerprints)

    @property
    def people(self) -> tuple[str, ...]:
        """The names and addresses among them."""
        return tuple(one for one in self.by if not (KEY.match(one) or FINGERPRINT.fullmatch(one)))


class Configuration(Record, tag_field="schema", tag="calibrary/registry-1"):
    """What a registry says of itself: by which rules it is kept, and how its files lie.

    Attributes:
        layout: 1: cameras/<make>/<model>/[sn-<hash>/]<variant>.yaml.
        entries: the newest schema that entries are written in.
        policy: whose limits entries are held to; fleet when absent.
        approvals: what it takes for an entry to be used; anybody's approval when absent.
    """

    layout: Annotated[int, Meta(ge=1, le=LAYOUT)] = LAYOUT
    entries: Annotated[str, Meta(pattern="^calibrary/entry-[0-9]{1,6}$")] = f"calibrary/entry-{CURRENT}"
    policy: Policy = FLEET
    approvals: ApprovalRule | None = None

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        """A policy that ships is written by its name; fields of others are read over."""
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
    """The file of a new registry.

    Args:
        policy: one of those that ship, by name.
        not_author: whether the approval of whoever proposed an entry does not count.
    """
    approvals = "approvals: {not_author: true}\n" if not_author else ""
    text = TEXT.format(layout=LAYOUT, entries=CURRENT, policy=policy, models=DOCUMENT, approvals=approvals)
    return text.encode()


def parse_configuration(data: bytes, name: str = CONFIGURATION_FILE) -> Configuration:
    """Read it.

    Raises:
        ParseError: it is not YAML, does not match schemas/registry-1.schema.json, or is of a newer layout than is read.
        InputError: a limit of its policy is out of range.
    """
    value = load_yaml(data, source=name, max_bytes=LARGEST)
    if isinstance(value, dict):
        _refuse_newer(value, name)
    return from_json(Configuration, value, source=name, locate=partial(line_of, data))


def configuration_at(repo: Repository, commit: str) -> Configuration:
    """What a registry said of itself at a commit; the default where it said nothing.

    Raises:
        RegistryError: it cannot be read.
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


VARIABLE: Final = "CALIBRARY_REGISTRY"
SEPARATOR: Final = ";"
"""Between the registries that the variable names; ``:`` is in every address."""
ADDRESS: Final = re.compile(r"https?:/", re.IGNORECASE)


def named_registries(
    named: Sequence[str | Path] = (), *, environment: Mapping[str, str] | None = None
) -> tuple[str | Path, ...]:
    """The registries that are asked, in their order: folders, and addresses of published ones.

    Args:
        named: on the command line; else those in ``$CALIBRARY_REGISTRY``, with ``;`` between them; else the one of
            :func:`require_registry`.
        environment: in place of the process's own.

    Raises:
        RegistryError: there is none.
    """
    variable = (os.environ if environment is None else environment).get(VARIABLE, "")
    if not named and SEPARATOR in variable:
        return tuple(part.strip() for part in variable.split(SEPARATOR) if part.strip())
    return tuple(named) or (variable,) if named or variable else (require_registry(),)


def _folder_of(variable: str) -> Path:
    """The first folder that the variable names: what changes a registry, or needs its history, is of that one.

    Raises:
        RegistryError: it names published registries only.
    """
    parts = [part.strip() for part in variable.split(SEPARATOR) if part.strip()]
    folder = next((part for part in parts if not ADDRESS.match(part)), None)
    if folder is None:
        raise RegistryError(
            f"${VARIABLE} names {variable}, which is read over HTTP; expected the folder of a registry: "
            "--registry PATH"
        )
    return Path(folder)


FOLDER: Final = "folder:"
"""Before a path: the files that lie there are meant, whether or not git knows of them."""


def plain_folder(place: Path) -> Path | None:
    """The folder that ``folder:PATH`` names; None for any other place."""
    text = str(place)
    return Path(text.removeprefix(FOLDER)) if text.startswith(FOLDER) else None


def find_registry(named: Path | None = None, *, environment: Mapping[str, str] | None = None) -> Path | None:
    """The registry's folder: as named, else ``$CALIBRARY_REGISTRY``, else around here, else a user's own.

    Args:
        named: on the command line.
        environment: in place of the process's own.

    Returns:
        None where there is none yet. What is named is returned whether or not it is there.

    Raises:
        RegistryError: the variable names published registries only.
    """
    if named is not None:
        return named
    variable = (os.environ if environment is None else environment).get(VARIABLE)
    if variable:
        return _folder_of(variable)
    here = Path.cwd()
    for folder in (here, *here.parents):
        if (folder / CONFIGURATION_FILE).is_file():
            return folder
    own = default_place()
    return own if own.exists() else None


def require_registry(named: Path | None = None) -> Path:
    """The same, where there has to be one.

    Raises:
        RegistryError: there is none; the message says how to come by one.
    """
    place = find_registry(named)
    if place is None:
        raise RegistryError(
            f"no registry: none named with --registry or ${VARIABLE}, no {CONFIGURATION_FILE} in this folder or "
            f"above it, none at {default_place()}; 'calibrary registry init' makes one"
        )
    return place


def default_place() -> Path:
    """Where a user's own registry lies on this system."""
    return user_data_path("calibrary", appauthor=False) / "registry"
