"""The calibrations that wait for approval: proposals of a state, and what other branches add to it."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import changed, common_ancestor
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import CAMERAS, PROPOSALS, PROPOSED, id_of, is_entry, is_proposal
from calibrary.registry.snapshot import Snapshot


class Pending(Struct, frozen=True, kw_only=True):
    """A calibration that waits for approval, or that could not be read.

    Attributes:
        path: of its file.
        entry: the entry, or why it cannot be read.
        branch: where it waits; None for the state that was asked about.
    """

    path: str
    entry: Entry | str
    branch: str | None = None

    @property
    def key(self) -> str:
        """KEY by which ``registry show`` and ``diff`` find it."""
        name = f"{PROPOSED}{id_of(self.path)}" if is_proposal(self.path) else id_of(self.path)
        return f"{name}@{self.branch}" if self.branch is not None else name


def pending(snapshot: Snapshot, *, of: str | None = None) -> Iterator[Pending]:
    """Yield the proposals of a state, then what other branches propose or use since they parted from it.

    Args:
        snapshot: the state.
        of: the one branch that is asked about; None for all. What several propose alike is otherwise of the first.
    """
    seen: set[tuple[str, str | None]] = set()
    for path in sorted(snapshot.proposed):
        seen.add((path, snapshot.proposed[path]))
        yield _read(path, snapshot.read(path))
    repo, commit = snapshot.repo, snapshot.commit
    if repo is None or commit is None:
        return
    for branch, tip in _branches(repo):
        if of not in (None, branch):
            continue
        try:
            base = common_ancestor(repo, commit, tip)
        except RegistryError as error:
            # Other content may share the repository, such as pages that are published from it.
            if repo.listing(tip, CAMERAS, PROPOSALS):
                yield Pending(path=CAMERAS, entry=str(error), branch=branch)
            continue
        files = [one for folder in (CAMERAS, PROPOSALS) for one in changed(repo, base, tip, folder)]
        for file in files:
            here = snapshot.proposed if is_proposal(file.path) else snapshot.paths
            what = (file.path, file.after)
            if (
                not is_entry(file.path)
                or file.after is None
                or file.after == here.get(file.path)
                or what in seen
            ):
                continue
            seen.add(what)
            yield _read(file.path, repo.blob(file.after), branch)


def _read(path: str, data: bytes, branch: str | None = None) -> Pending:
    try:
        return Pending(path=path, entry=parse_entry(data, path, require_digest=False), branch=branch)
    except (InputError, RegistryError) as error:
        return Pending(path=path, entry=str(error), branch=branch)


def _branches(repo: Repository) -> Iterator[tuple[str, str]]:
    """Yield name and commit of every branch, those of remotes last."""
    form = "--format=%(refname) %(objectname) %(symref)"
    listed = repo.run("for-each-ref", form, "refs/heads", "refs/remotes").out.decode("utf-8", "replace")
    for line in listed.splitlines():
        name, tip, symbolic = line.split(" ")
        if not symbolic:
            yield name.removeprefix("refs/heads/").removeprefix("refs/remotes/"), tip
