"""The keys of a profile in ~/.aws, which obstore does not read by itself.

As the AWS programs look for them: the environment's own keys come first, then the profile that AWS_PROFILE names, else
``default``: ``[NAME]`` in the credentials file, ``[profile NAME]`` in the configuration
(https://docs.aws.amazon.com/cli/latest/userguide/cli-configure-files.html).
"""

from __future__ import annotations

import os
from configparser import ConfigParser, Error
from pathlib import Path
from typing import Final

from calibrary.jobs.images.ranged import StoreError

__all__ = ["profile_options"]

FROM_ENVIRONMENT: Final = (
    "AWS_ACCESS_KEY_ID",
    "AWS_SKIP_SIGNATURE",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
)
"""Where one of these is set, obstore knows what to do."""
OPTIONS: Final = {
    "access_key_id": "aws_access_key_id",
    "secret_access_key": "aws_secret_access_key",
    "session_token": "aws_session_token",
    "region": "region",
    "endpoint": "endpoint_url",
}
"""obstore's options by their names in a profile."""
STATED: Final = {
    "region": ("AWS_REGION", "AWS_DEFAULT_REGION"),
    "endpoint": ("AWS_ENDPOINT_URL", "AWS_ENDPOINT"),
}
"""What the environment overrides in a profile."""


def profile_options() -> dict[str, str]:
    """What a store is to be opened with beside the environment; nothing where that has keys, or no profile has.

    Raises:
        StoreError: the profile that AWS_PROFILE names is not there, or has no keys of its own.
    """
    named = os.environ.get("AWS_PROFILE")
    if any(os.environ.get(name) for name in FROM_ENVIRONMENT):
        return {}
    found = _section(
        "AWS_CONFIG_FILE", "config", f"profile {named}" if named not in {None, "default"} else "default"
    )
    found |= _section("AWS_SHARED_CREDENTIALS_FILE", "credentials", named or "default")
    if "aws_access_key_id" not in found or "aws_secret_access_key" not in found:
        if named is None:
            return {}
        missing = "has no keys of its own" if found else "is not in ~/.aws"
        raise StoreError(
            f"the profile {named} of AWS_PROFILE {missing}; where it signs in another way, run: "
            f'eval "$(aws configure export-credentials --profile {named} --format env)"'
        )
    return {
        option: found[key]
        for option, key in OPTIONS.items()
        if key in found and not any(os.environ.get(name) for name in STATED.get(option, ()))
    }


def _section(variable: str, name: str, section: str) -> dict[str, str]:
    path = Path(os.environ.get(variable) or Path.home() / ".aws" / name)
    parser = ConfigParser(interpolation=None, default_section="")
    try:
        parser.read(path, encoding="utf-8")
    except (Error, OSError, UnicodeDecodeError):
        raise StoreError(f"{path} cannot be read as a file of AWS profiles") from None
    return dict(parser[section]) if parser.has_section(section) else {}
