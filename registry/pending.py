"""The calibrations that wait for approval: what a state proposes, and what other branches add to it."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.history import changed, common_ancestor
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import CAMERAS, PROPOSED, file_path, id_of, is_entry
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
        return (
            f"{id_of(self.path)}@{self.branch}"
            if self.branch is not None
            else f"{id_of(self.path)}{PROPOSED}"
        )


def pending(snapshot: Snapshot, *, of: str | None = None) -> Iterator[Pending]:
    """Yield what a state proposes, then what other branches propose or use since they parted from it.

    Args:
        snapshot: the state.
        of: the one branch that is asked about; None for all. What several propose alike is otherwise of the first.
    """
    for name, entry in snapshot.parsed(sorted(snapshot.proposed)):
        said = str(entry) if isinstance(entry, InputError) else entry
        yield Pending(path=file_path(name), entry=said)
    repo, commit = snapshot.repo, snapshot.commit
    if repo is None or commit is None:
        return
    seen = {*snapshot.cameras.items()}
    for branch, tip in _branches(repo):
        if of not in (None, branch):
            continue
        try:
            base = common_ancestor(repo, commit, tip)
        except RegistryError as error:
            # Other content may share the repository, such as pages that are published from it.
            if repo.listing(tip, CAMERAS):
                yield Pending(path=CAMERAS, entry=str(error), branch=branch)
            continue
        for file in changed(repo, base, tip, CAMERAS):
            what = (file.path, file.after)
            if is_entry(file.path) and file.after is not None and what not in seen:
                seen.add(what)
                yield _read(file.path, repo.blob(file.after), branch)


def _read(path: str, data: bytes, branch: str) -> Pending:
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
