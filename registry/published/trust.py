"""What a published registry vouches for, as verified by the client of The Update Framework.

The first root of an address is trusted as it is read, unless accepted signers are named. From then on only its keys, or
those that it hands over to, are accepted there, no state is older than the last one, and none is read after it expired.
If the server cannot be reached, what was read last serves until then.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import load_ssh_public_key
from securesystemslib.exceptions import UnverifiedSignatureError
from securesystemslib.signer import Signature, SSlibKey
from tuf.api import exceptions
from tuf.api.metadata import Metadata, Root, Snapshot, Timestamp
from tuf.ngclient import FetcherInterface, Updater

from calibrary.errors import RegistryError
from calibrary.records import from_json
from calibrary.registry.git.locks import writer_lock
from calibrary.registry.published.fetch import Fetch, FetchError
from calibrary.registry.published.layout import METADATA_FOLDER, PublishedState
from calibrary.registry.published.metadata import STATE_FIELD

SIGNERS: Final = "CALIBRARY_SIGNERS"
"""Environment variable with an "ALLOWED SIGNERS" file of ssh-keygen(1); the root's keys must then be among them."""
NAMESPACE: Final = "calibrary-published"
"""Namespace for which such a file may restrict a key."""

LARGEST: Final = 5_000_000
"""Largest metadata in bytes, python-tuf's own limit for lists of targets."""
GONE: Final = frozenset({403, 404, 410})
"""Statuses by which servers say that there is no such file; buckets that may not be listed answer 403."""
FIRST: Final = "first.json"
READ: Final = "read"
WAIT_S: Final = 30.0
MOST_ROOTS: Final = 256


class Trust:
    """The metadata of one address at one state.

    Attributes:
        state: what is published.
        read: when the server last confirmed it.
        expires: when it must not be used any more.
        offline: why the server could not be asked; None if it was.
    """

    def __init__(
        self, url: str, folder: Path, fetch: Fetch, signers: Path | None, *, fresh: bool = False
    ) -> None:
        """Read and verify the metadata.

        Args:
            url: address of the registry, with a trailing slash.
            folder: where what is trusted at this address is kept.
            fetch: function that downloads a file.
            signers: accepted signers; None for trust on first use.
            fresh: ask intermediate caches to revalidate.

        Raises:
            RegistryError: there is no published registry, or it must not be used.
            FetchError: it cannot be reached, and was never read before.
            OSError: the folder cannot be written.
        """
        self.url: Final = url
        self._folder: Final = folder
        self._fetcher: Final = _Fetcher(fetch, folder, fresh=fresh)
        folder.mkdir(parents=True, exist_ok=True)
        with _locked(folder), self._refusals():
            first = self._first_root()
            if signers is not None:
                # Before anything is kept, so that a server that is refused is not trusted the next time.
                _require_signers(url, self._newest_root(first), signers)
            self._updater: Final = Updater(
                str(folder), f"{url}{METADATA_FOLDER}/", fetcher=self._fetcher, bootstrap=first
            )
            self._updater.refresh()
            _keep(folder / FIRST, first)
            if self._fetcher.offline is None:
                (folder / READ).touch()
            stamp: Metadata[Timestamp] = Metadata.from_file(str(folder / "timestamp.json"))
            snapshot: Metadata[Snapshot] = Metadata.from_file(str(folder / "snapshot.json"))
            root: Metadata[Root] = Metadata.from_file(str(folder / "root.json"))
        stated = snapshot.signed.unrecognized_fields.get(STATE_FIELD)
        self.state: Final = from_json(PublishedState, stated, source=f"{url}{METADATA_FOLDER}/snapshot.json")
        self.expires: Final = min(stamp.signed.expires, snapshot.signed.expires, root.signed.expires)
        self.read: Final = datetime.fromtimestamp((folder / READ).stat().st_mtime, UTC)

    @property
    def offline(self) -> FetchError | None:
        """Why the server could not be asked."""
        return self._fetcher.offline

    def digest(self, path: str) -> str | None:
        """Return the SHA-256 of a camera file; None if there is none.

        Raises:
            RegistryError: its list must not be used.
            FetchError: its list cannot be read.
        """
        with self._refusals():
            found = self._updater.get_targetinfo(path)
        return found.hashes["sha256"] if found is not None else None

    def _first_root(self) -> bytes:
        """Return the root with which trust in this address began, or begins now.

        Raises:
            RegistryError: the one that is kept is damaged.
        """
        kept = self._folder / FIRST
        try:
            data = kept.read_bytes()
        except FileNotFoundError:
            return self._fetcher.root(f"{self.url}{METADATA_FOLDER}/1.root.json")
        if not data.endswith(b"}"):
            raise RegistryError(f"{kept}: is damaged; remove {self._folder}, and {self.url} is trusted anew")
        return data

    def _newest_root(self, first: bytes) -> Metadata[Root]:
        """Return the newest root that is kept or served; the client verifies the way to it before it uses any."""
        found: Metadata[Root] = Metadata.from_bytes(first)
        for _ in range(MOST_ROOTS):
            name = f"{found.signed.version + 1}.root.json"
            try:
                kept = self._folder / "root_history" / name
                data = (
                    kept.read_bytes()
                    if kept.exists()
                    else self._fetcher.root(f"{self.url}{METADATA_FOLDER}/{name}")
                )
            except FetchError:
                break
            found = Metadata.from_bytes(data)
        return found

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        """Say in words of this program why the client refuses."""
        try:
            yield
        except exceptions.DownloadError as error:
            raise self._fetcher.failed or FetchError(f"{self.url}: {error}", is_temporary=False) from None
        except exceptions.ExpiredMetadataError as error:
            or_anew = self._or_anew if "root" in str(error) else ""
            raise RegistryError(
                f"{self.url}: what is published has expired ({error}): nobody published it again in time, or an old "
                f"copy of it is served; its keeper runs 'calibrary registry publish' again{or_anew}"
            ) from None
        except exceptions.BadVersionNumberError as error:
            raise RegistryError(
                f"{self.url}: is older than what was read there before ({error}), as a restored backup or an attacker "
                "would serve it; its keeper runs 'calibrary registry publish' again"
            ) from None
        except exceptions.UnsignedMetadataError as error:
            raise MixedError(
                f"{self.url}: is not signed by the keys that were trusted there before ({error}); if its keeper "
                f"confirms that the keys were replaced, remove {self._folder} and it is trusted anew"
            ) from None
        except exceptions.RepositoryError as error:
            raise RegistryError(f"{self.url}: its metadata is damaged: {error}{self._or_anew}") from None

    @property
    def _or_anew(self) -> str:
        """What helps where publishing again does not."""
        return f"; if that does not help, remove {self._folder}, and it is trusted anew"


class MixedError(RegistryError):
    """Files of two states were read, or of two keepers."""


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Let one process at a time keep what it reads.

    Raises:
        OSError: the folder cannot be locked.
    """
    with ExitStack() as stack:
        try:
            stack.enter_context(writer_lock(folder, wait_s=WAIT_S))
        except RegistryError as error:
            raise OSError(str(error)) from None
        yield


def _keep(file: Path, data: bytes) -> None:
    if not file.exists():
        temporary = file.with_suffix(".new")
        temporary.write_bytes(data)
        temporary.replace(file)


class _Fetcher(FetcherInterface):
    """Downloads metadata; serves what is kept if the server cannot be reached.

    Attributes:
        offline: why nothing is downloaded any more.
        failed: why the last download failed.
    """

    def __init__(self, fetch: Fetch, folder: Path, *, fresh: bool) -> None:
        self._get: Final = fetch
        self._folder: Final = folder
        self._fresh: Final = fresh
        self.offline: FetchError | None = None
        self.failed: FetchError | None = None
        self._roots: dict[str, bytes | FetchError] = {}

    def needed(self, url: str) -> bytes:
        """Download a file.

        Raises:
            FetchError: it cannot be downloaded, or is no metadata.
        """
        data = self._get(url, most=LARGEST, fresh=self._fresh)
        if not data.lstrip().startswith(b"{") or b'"signed"' not in data:
            raise FetchError(f"{url}: this is no metadata", is_temporary=True)
        return data

    def root(self, url: str) -> bytes:
        """Download a root once, so that the one that was looked at is the one that is used; errors as for needed()."""
        if url not in self._roots:
            try:
                self._roots[url] = self.needed(url)
            except FetchError as error:
                self._roots[url] = error
        found = self._roots[url]
        if isinstance(found, FetchError):
            raise found
        return found

    def _fetch(self, url: str) -> Iterator[bytes]:
        name = unquote(urlsplit(url).path.rpartition("/")[2])
        is_root = name.endswith(".root.json")
        self.failed = None
        if self.offline is None:
            try:
                return iter([self.root(url) if is_root else self.needed(url)])
            except FetchError as error:
                self.failed = error
                if error.status in GONE or (is_root and error.status is None and "no metadata" in str(error)):
                    raise exceptions.DownloadHTTPError(str(error), 404) from None
                if not error.is_temporary or not (self._folder / "timestamp.json").exists():
                    raise exceptions.DownloadError(str(error)) from None
                self.offline = error
        if is_root:
            raise exceptions.DownloadHTTPError("the server cannot be asked", 404)
        try:
            return iter(
                [(self._folder / (name if name == "timestamp.json" else name.partition(".")[2])).read_bytes()]
            )
        except OSError:
            self.failed = FetchError(f"{self.offline}; it is not in the cache", is_temporary=False)
            raise exceptions.DownloadError(str(self.failed)) from None


def _require_signers(url: str, root: Metadata[Root], signers: Path) -> None:
    """Check that enough accepted signers signed a root; what the root says of keys is not believed.

    Raises:
        RegistryError: they did not, or the file of signers does not exist.
    """
    try:
        lines = signers.read_text("utf-8", "replace").splitlines()
    except OSError:
        raise RegistryError(
            f"{signers}: no such file, expected one of allowed signers, as of ssh-keygen(1)"
        ) from None
    accepted = {key.keyid: key for line in lines if (key := _key(line)) is not None}
    signed = sum(_has_signed(key, root) for key in accepted.values())
    if signed < max(1, root.signed.roles["root"].threshold):
        raise RegistryError(f"{url}: is not signed by a key in {signers}")


def _has_signed(key: SSlibKey, root: Metadata[Root]) -> bool:
    """Whether a key made any of a root's signatures, whatever key the file says did."""
    for one in root.signatures.values():
        try:
            key.verify_signature(Signature(key.keyid, one.signature), root.signed_bytes)
        except UnverifiedSignatureError:
            continue
        return True
    return False


def _key(line: str) -> SSlibKey | None:
    """Return the key in a line of allowed signers; None if it is of none that may sign a publication."""
    try:
        words = shlex.split(line, comments=True)
        at = next(at for at, word in enumerate(words) if at and word.startswith(("ssh-", "ecdsa-")))
        found = SSlibKey.from_crypto(load_ssh_public_key(" ".join(words[at : at + 2]).encode()))
    except (ValueError, StopIteration, UnsupportedAlgorithm):
        return None
    for option in words[1:at]:
        name, _, value = option.partition("=")
        if name != "namespaces" or NAMESPACE not in value.split(","):
            return None
    return found
