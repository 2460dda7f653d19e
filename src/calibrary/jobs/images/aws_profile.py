"""AWS settings that obstore does not read itself: a profile in ~/.aws, and an endpoint with http://.

The order is that of the AWS programs (https://docs.aws.amazon.com/cli/latest/userguide/cli-configure-files.html):
keys, region and endpoint come from the environment, else from the profile named by AWS_PROFILE, or ``default``:
``[NAME]`` in the credentials file, ``[profile NAME]`` in the configuration.
"""

from __future__ import annotations

import os
from configparser import ConfigParser, Error
from pathlib import Path
from typing import Any, Final

from calibrary.jobs.images.ranged import StoreError

__all__ = ["options"]

FROM_ENVIRONMENT: Final = (
    "AWS_ACCESS_KEY_ID",
    "AWS_SKIP_SIGNATURE",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
)
"""If one of these is set, obstore takes the credentials from the environment."""
KEYS: Final = {
    "access_key_id": "aws_access_key_id",
    "secret_access_key": "aws_secret_access_key",
    "session_token": "aws_session_token",
}
PLACE: Final = {"region": "region", "endpoint": "endpoint_url"}
"""obstore's options by their names in a profile."""
STATED: Final = {
    "region": ("AWS_REGION", "AWS_DEFAULT_REGION"),
    "endpoint": ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT"),
}
"""Options that the environment overrides in a profile."""


def options() -> dict[str, Any]:
    """Options for opening a store, in addition to the environment.

    Raises:
        StoreError: the profile named by AWS_PROFILE does not exist or contains no keys.
    """
    named = os.environ.get("AWS_PROFILE")
    profile = _section(
        "AWS_CONFIG_FILE", "config", f"profile {named}" if named not in {None, "default"} else "default"
    )
    profile |= _section("AWS_SHARED_CREDENTIALS_FILE", "credentials", named or "default")
    wanted = dict(PLACE)
    if not any(os.environ.get(name) for name in FROM_ENVIRONMENT):
        if "aws_access_key_id" in profile and "aws_secret_access_key" in profile:
            wanted |= KEYS
        elif named is not None:
            missing = "has no keys of its own" if profile else "is not in ~/.aws"
            raise StoreError(
                f"the profile {named} of AWS_PROFILE {missing}; where it signs in another way, run: "
                f'eval "$(aws configure export-credentials --profile {named} --format env)"'
            )
    stated = {
        option: [os.environ[name] for name in names if os.environ.get(name)]
        for option, names in STATED.items()
    }
    found: dict[str, Any] = {
        option: profile[key] for option, key in wanted.items() if key in profile and not stated.get(option)
    }
    # An endpoint with http:// was stated on purpose; obstore needs an additional option to accept it.
    if any(address.startswith("http://") for address in (*stated["endpoint"], found.get("endpoint", ""))):
        found["client_options"] = {"allow_http": True}
    return found


def _section(variable: str, name: str, section: str) -> dict[str, str]:
    path = Path(os.environ.get(variable) or Path.home() / ".aws" / name)
    parser = ConfigParser(interpolation=None, default_section="")
    try:
        parser.read(path, encoding="utf-8")
    except (Error, OSError, UnicodeDecodeError):
        raise StoreError(f"{path} cannot be read as a file of AWS profiles") from None
    return dict(parser[section]) if parser.has_section(section) else {}
