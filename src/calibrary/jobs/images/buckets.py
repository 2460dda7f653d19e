"""Images in object stores: S3, Google and Azure, through obstore.

Credentials come from the environment, a profile or the machine's role, as in each store's own programs. Error
messages of a store are replaced by our own, because they may contain a signed URL.

AWS: a profile in ~/.aws and an endpoint with http:// are read here, because obstore does not. The order is that of the
AWS programs (https://docs.aws.amazon.com/cli/latest/userguide/cli-configure-files.html): keys, region and endpoint come
from the environment, else from the profile named by AWS_PROFILE, or ``default``: ``[NAME]`` in the credentials file,
``[profile NAME]`` in the configuration.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from configparser import ConfigParser, Error
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from calibrary.extras import require
from calibrary.jobs.images.ranged import First, Store, StoreError

OBSTORE: Final = frozenset({"s3", "s3a", "gs", "az", "azure", "abfs", "abfss", "adl"})
NEEDS: Final = "reading images from object stores"
_STATUS = re.compile(r"status code: ([45]\d\d)\b")


@cache
def bucket(scheme: str, netloc: str) -> Store:
    """Open the store of a URL.

    Raises:
        MissingExtraError: obstore is not installed.
        StoreError: there is no such kind of store, or it is not configured.
    """
    if scheme not in OBSTORE:
        raise StoreError(
            f"{scheme}:// is not a store that can be read, as s3://, gs://, az:// and https:// can"
        )
    require(["obstore"], NEEDS)
    return _Bucket(f"{scheme}://{netloc}")


class _Bucket:
    """One bucket or container, through obstore."""

    def __init__(self, url: str) -> None:
        self._obstore: Any = import_module("obstore")
        self._errors: Any = import_module("obstore.exceptions")
        try:
            # Retries are made in one place, for every kind of store.
            self._store = import_module("obstore.store").from_url(
                url, retry_config={"max_retries": 0}, **(options() if url.startswith("s3") else {})
            )
        except (OSError, ValueError, self._errors.BaseError) as error:
            raise StoreError(f"the store is not set up: {type(error).__name__}") from None

    def first(self, key: str, size: int) -> First:
        """The first ``size`` bytes of a file, with its total size and version."""
        try:
            found = self._obstore.get(self._store, key, options={"range": (0, size)})
            data = bytes(found.bytes())
            meta = found.meta
        except (OSError, ValueError, self._errors.BaseError) as error:
            raise self._as_store_error(error) from None
        if len(data) != min(size, meta["size"]):
            raise StoreError(f"the store sent {len(data)} of {min(size, meta['size'])} bytes", passing=True)
        return First(data, meta["size"], meta["e_tag"])

    def part(self, key: str, start: int, end: int, version: str | None) -> bytes:
        """The bytes from ``start`` up to, not including, ``end``; fails if the version differs."""
        options = {"range": (start, end)} | ({"if_match": version} if version else {})
        try:
            return bytes(self._obstore.get(self._store, key, options=options).bytes())
        except (OSError, ValueError, self._errors.BaseError) as error:
            raise self._as_store_error(error) from None

    def listed(self, prefix: str) -> Iterator[str]:
        """Yield the keys of all files below a prefix, in the order of their bytes."""
        try:
            for chunk in self._obstore.list(self._store, prefix=prefix or None, chunk_size=1000):
                for one in chunk:
                    yield one["path"]
        except (OSError, ValueError, self._errors.BaseError) as error:
            raise self._as_store_error(error) from None

    def _as_store_error(self, error: Exception) -> StoreError:
        errors = self._errors
        found = _STATUS.search(str(error))
        status = found[1] if found is not None else None
        if isinstance(error, errors.NotFoundError | FileNotFoundError) or status == "404":
            return StoreError("is not there (404)")
        denied = errors.PermissionDeniedError | errors.UnauthenticatedError | PermissionError
        if isinstance(error, denied) or status in {"401", "403"}:
            return StoreError(f"access is denied ({status or 403})")
        if isinstance(error, errors.PreconditionError):
            return StoreError("was changed while it was read (412)")
        if status == "416":
            return StoreError("is empty, or was cut while it was read (416)")
        if "error sending request" in str(error):
            return StoreError("the store's server cannot be reached", passing=True)
        return StoreError(f"the store cannot be read ({status or type(error).__name__})", passing=True)


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
