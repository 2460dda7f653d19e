"""Policies given as arguments."""

from __future__ import annotations

from pathlib import Path
from typing import TypeAlias

from calibrary.policy import Policy
from calibrary.policy_file import policy_named

__all__ = ["PolicyLike", "policy_of"]

PolicyLike: TypeAlias = Policy | str | Path
"""A policy, the name of an included one ("fleet", "source"), or a policy file."""


def policy_of(policy: PolicyLike) -> Policy:
    """Return the policy that an argument names.

    Raises:
        InputError: the policy does not exist, or its file cannot be read.
    """
    return policy if isinstance(policy, Policy) else policy_named(str(policy))
