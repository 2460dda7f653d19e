"""Reading of policy files: YAML that follows schemas/policy-1.schema.json."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from calibrary.arguments import PolicyLike
from calibrary.errors import InputError, ParseError
from calibrary.policy import POLICIES, Policy
from calibrary.records import from_json
from calibrary.strictyaml import line_of, load_yaml

LARGEST_POLICY = 1 << 20


def policy_of(policy: PolicyLike) -> Policy:
    """Return the policy that an argument is or names: an included one, or a policy file.

    Raises:
        InputError: as for :func:`read_policy`.
    """
    if isinstance(policy, Policy):
        return policy
    return POLICIES.get(str(policy)) or read_policy(Path(policy))


def read_policy(path: Path) -> Policy:
    """Read a policy file; values that it does not state come from its ``base`` ("fleet" when absent).

    Raises:
        InputError: the file does not exist, or a limit is out of range.
        ParseError: the file is not YAML, or violates the schema.
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
    return from_json(Policy, value, source=path.name, locate=partial(line_of, data))
