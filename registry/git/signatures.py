"""Who signed a commit, by a list of signers that the reader names: never by what the repository itself trusts."""

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
    """What became known of a commit's signature.

    Attributes:
        state: git's letter for it; ``G`` alone is good.
        signer: who, by the list of signers.
        key: the key's fingerprint; of an ssh key ``SHA256:…``, of an OpenPGP key its 40 hex digits.
        primary: of an OpenPGP key, the fingerprint of the one that it is a part of.
    """

    commit: str
    state: str
    signer: str
    key: str
    primary: str = ""

    @property
    def is_intact(self) -> bool:
        """Whether the owner of the key signed this very commit, whether or not the reader trusts the key."""
        return self.state in {"G", "U"}

    @property
    def is_good(self) -> bool:
        """Whether a person on the list signed this very commit."""
        return self.state == GOOD

    def __str__(self) -> str:
        return f"{self.commit[:12]}: {STATES.get(self.state, self.state)}"


def signatures(
    repo: Repository, commits: Sequence[str], allowed_signers: Path | None
) -> tuple[Signature, ...]:
    """The signature of each commit.

    ssh keys are judged by ``allowed_signers``, a file as of ssh-keygen(1), "ALLOWED SIGNERS"; OpenPGP keys by the
    keyring of whoever reads.
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
