"""Policies of your own: YAML against schemas/policy-1.schema.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import cast

from calibrary.errors import InputError, ParseError
from calibrary.policy import POLICIES, Policy
from calibrary.records import replace
from calibrary.schemas import require
from calibrary.strictyaml import YamlValue, line_of, load_yaml

__all__ = ["policy_from", "policy_named", "read_policy"]

LARGEST_POLICY = 1 << 20


def policy_named(name: str) -> Policy:
    """One of the policies that ship, by its name, or that of a file.

    Raises:
        InputError: as for :func:`read_policy`.
    """
    return POLICIES.get(name) or read_policy(Path(name))


def read_policy(path: Path) -> Policy:
    """Read a policy file; what it does not say it takes from its ``base`` ("fleet" when absent).

    Raises:
        InputError: no such file, or a limit out of range.
        ParseError: it is no YAML, or breaks the schema.
    """
    try:
        if not path.is_file():
            wanted = ", ".join(POLICIES)
            raise InputError(f"no such policy; expected {wanted} or a YAML file", source=str(path))
        with path.open("rb") as file:
            data = file.read(LARGEST_POLICY + 1)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=str(path)) from None
    if len(data) > LARGEST_POLICY:
        raise ParseError("is larger than 1 MiB, expected a policy", source=str(path))
    value = load_yaml(data, source=path.name)
    require(value, "policy-1", source=path.name, locate=partial(line_of, data))
    return policy_from(cast("dict[str, YamlValue]", value))


def policy_from(document: Mapping[str, YamlValue]) -> Policy:
    """The policy that a document means which keeps schemas/policy-1.schema.json.

    Raises:
        InputError: a limit is out of range.
    """
    base = POLICIES[str(document.get("base", "fleet"))]
    limits = {field.name: document[field.name] for field in fields(Policy) if field.name in document}
    for band in ("focal_over_width", "measured_over_width"):
        if isinstance(values := limits.get(band), list):
            limits[band] = tuple(values)  # type: ignore[assignment]  # the schema says two numbers
    return replace(base, **limits)
