"""The policy that an argument means."""

from __future__ import annotations

from pathlib import Path
from typing import TypeAlias

from calibrary.policy import Policy
from calibrary.policy_file import policy_named

__all__ = ["PolicyLike", "policy_of"]

PolicyLike: TypeAlias = Policy | str | Path
"""A policy, the name of one that is shipped ("fleet", "source"), or a policy file."""


def policy_of(policy: PolicyLike) -> Policy:
    """The policy itself.

    Raises:
        InputError: there is no such policy, or its file cannot be read.
    """
    return policy if isinstance(policy, Policy) else policy_named(str(policy))
