"""Signatures of commits, verified with the reader's list of signers, never with what the repository itself trusts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from calibrary.registry.git.repository import Repository

__all__ = ["Signature", "signatures"]

GOOD = "G"
STATES = {
    "G": "good",
    "U": "good, but the key is not trusted",
    "X": "the signature has expired",
    "Y": "the key has expired",
    "R": "made with a revoked key",
    "B": "bad: the commit differs from what was signed",
    "E": "cannot be checked: the key is missing",
    "N": "none",
}


class Signature(Struct, frozen=True, kw_only=True):
    """Result of verifying a commit's signature.

    Attributes:
        state: git's letter for the result; only ``G`` is good.
        signer: person, by the list of signers.
        key: fingerprint of the key: ``SHA256:…`` for ssh, 40 hex digits for OpenPGP.
        primary: for an OpenPGP subkey, the fingerprint of its primary key.
    """

    commit: str
    state: str
    signer: str
    key: str
    primary: str = ""

    @property
    def is_intact(self) -> bool:
        """Whether the signature matches the commit, whether or not the key is trusted."""
        return self.state in {"G", "U"}

    @property
    def is_good(self) -> bool:
        """Whether a listed person signed this commit."""
        return self.state == GOOD

    def __str__(self) -> str:
        return f"{self.commit[:12]}: {STATES.get(self.state, self.state)}"


def signatures(
    repo: Repository, commits: Sequence[str], allowed_signers: Path | None
) -> tuple[Signature, ...]:
    """Verify the signature of each commit.

    ssh keys are verified with ``allowed_signers``, an "ALLOWED SIGNERS" file of ssh-keygen(1), OpenPGP keys with the
    keyring of the current user.
    """
    if not commits:
        return ()
    signers = str(allowed_signers.absolute()) if allowed_signers is not None else ""
    options = ("-c", f"gpg.ssh.allowedSignersFile={signers}", "-c", "gpg.minTrustLevel=fully")
    command = (
        "log",
        "--no-walk=unsorted",
        "--stdin",
        "--format=%H%x00%G?%x00%GS%x00%GF%x00%GP",
        "--no-color",
        "--no-notes",
    )
    printed = repo.run(*options, *command, stdin="".join(f"{commit}\n" for commit in commits).encode()).out
    found = {}
    for line in printed.decode("utf-8", "replace").splitlines():
        commit, state, signer, key, primary = line.split("\0")
        found[commit] = Signature(commit=commit, state=state, signer=signer, key=key, primary=primary)
    return tuple(found[commit] for commit in commits)
