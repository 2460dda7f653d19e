"""A git repository: commands that run undisturbed, and objects read by the bytes and checked.

GitPython is used for what it is good at, starting git and talking to it. Its index and its shared ``Repo`` are
not: the documented ``index.add`` + ``index.commit`` loses entries when two processes write, and one ``Repo`` used by
two threads, or on both sides of a fork, answers with another file's bytes. So every thread of every process talks to
a ``git cat-file`` of its own, and the hash of whatever that answers is computed again.
"""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from calibrary.errors import RegistryError
from calibrary.registry.git.damage import REF, damaged, lost_ref
from calibrary.registry.git.discovery import discover
from calibrary.registry.git.errors import explain
from calibrary.registry.git.foreign import (
    ALWAYS,
    Environment,
    Setting,
    judge_settings,
    parse_settings,
    repository_environment,
)
from calibrary.registry.git.names import check_path
from calibrary.registry.git.objects import HEX, Blob, ObjectReader, object_id
from calibrary.registry.git.program import Output, git_in, run_git, started
from calibrary.registry.git.trees import REGULAR, TREE, Member, difference, members, walk

__all__ = ["Repository"]

CHUNK = 20_000
FEW: Final = 64
"""Objects that are asked for one by one; from there on a process of its own is quicker."""
KEPT_TREES: Final = 1024
STALE_LOCK_S = 10.0
COMMITTED = re.compile(rb"^committer .*> (\d+) [+-]\d+$", re.MULTILINE)
LAST_SECOND = 253_402_300_799
"""End of the year 9999, the last that datetime has."""
OF_A_COMMIT: Final = re.compile(rb"tree ([0-9a-f]{40})\n")
WHAT: Final = {b"blob": "the content of a file", b"tree": "a folder", b"commit": "a commit"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Repository:
    """A git repository that files are read from and written to.

    Safe to share between threads and to carry over a fork.

    Attributes:
        path: the folder it was opened at.
        work_tree: where a person sees the files; ``None`` in a bare repository.
        flags: the ``-c`` options of every command.
        silenced: keys of the repository's own configuration that are not followed, because they run programs.
        settings: what the repository's and the person's configuration say.
        durable: whether a write waits for the disk.
        stale_lock_s: age at which a lock file of a dead git may be taken away.
        check_path: raises RegistryError for a path that must not be written, else returns it.
    """

    path: Path
    git_dir: Path
    common_dir: Path
    work_tree: Path | None
    flags: tuple[str, ...]
    silenced: tuple[str, ...]
    settings: tuple[Setting, ...]
    environment: Environment
    durable: bool = True
    stale_lock_s: float = STALE_LOCK_S
    check_path: Callable[[str], str] = check_path
    _own: threading.local = field(default_factory=threading.local, repr=False)
    _trees: dict[str, dict[str, Member]] = field(default_factory=dict, repr=False)

    @classmethod
    def open(
        cls,
        path: Path,
        *,
        durable: bool = True,
        stale_lock_s: float = STALE_LOCK_S,
        check_path: Callable[[str], str] = check_path,
    ) -> Repository:
        """A repository that is there, bare or checked out.

        Raises:
            RegistryError: there is none at this very folder, it belongs to another user, it is of a kind that
                is not read, or its own configuration would run a program.
        """
        path = Path(os.path.realpath(path.parent if path.name == ".git" else path))
        if not path.is_dir():
            raise RegistryError(f"{path}: no such folder; expected a registry, which is a git repository")
        git_dir, common_dir, is_bare = discover(path)
        work_tree = None if is_bare else path
        environment = repository_environment(git_dir, common_dir, work_tree)
        listed = run_git(("config", "--list", "--show-origin", "-z"), folder=path, environment=environment)
        if listed.code:
            raise RegistryError(f"{path}: its git configuration cannot be read: {listed.errors.strip()}")
        settings = parse_settings(listed.out, (git_dir, common_dir), path)
        flags, silenced = judge_settings(settings, str(path))
        fsync = ("-c", "core.fsync=all") if durable else ("-c", "core.fsync=none")
        return cls(
            path=path,
            git_dir=git_dir,
            common_dir=common_dir,
            work_tree=work_tree,
            flags=(*flags, *fsync),
            silenced=silenced,
            settings=settings,
            environment=environment,
            durable=durable,
            stale_lock_s=stale_lock_s,
            check_path=check_path,
        )

    @property
    def is_shallow(self) -> bool:
        """Whether the history was cut off when this was cloned."""
        return (self.common_dir / "shallow").exists()

    @property
    def unshallow_hint(self) -> str:
        """What a message adds where the reason may be that the history was cut off."""
        where = f"git -C {self.path} fetch --unshallow"
        return f"; this clone is shallow, and {where} brings the rest" if self.is_shallow else ""

    @property
    def cut(self) -> frozenset[str]:
        """The oldest commits of a shallow clone, which look as if they had made all that they hold."""
        file = self.common_dir / "shallow"
        return frozenset(file.read_text("utf-8", "replace").split()) if file.is_file() else frozenset()

    @property
    def head_ref(self) -> str | None:
        """The full name of the branch that is checked out, or that a bare repository points to; else ``None``."""
        head = (self.git_dir / "HEAD").read_text("utf-8", "replace").strip()
        return head.removeprefix("ref: ") if head.startswith("ref: ") else None

    def setting(self, key: str) -> str | None:
        """What git's configuration says last of a key, in lower case."""
        return next((setting.value for setting in reversed(self.settings) if setting.key == key), None)

    def run(
        self,
        *arguments: str,
        stdin: bytes | None = None,
        good: tuple[int, ...] = (0,),
        extra: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
    ) -> Output:
        """A command of git in this repository.

        ``good`` are the exit codes that are not failures, ``extra`` further variables of its environment.

        Raises:
            RegistryError: it failed; the message is git's own.
        """
        command, *rest = arguments
        output = run_git(
            (*self.flags, command, *ALWAYS.get(command, ()), *rest),
            folder=self.path,
            environment=self.environment | dict(extra or {}),
            stdin=stdin,
            timeout_s=timeout_s,
        )
        if output.code not in good:
            raise RegistryError(f"{self.path}: git {arguments[0]}: {explain(output.errors)}")
        return output

    def tip(self, ref: str | None = None) -> str | None:
        """The commit of a branch; ``None`` before its first.

        Args:
            ref: its full name; what is checked out if left out.

        Raises:
            RegistryError: the branch is damaged: its file says nothing, or its commit is lost.
        """
        found = self._ask(f"{ref or 'HEAD'}^{{commit}}")
        if found is not None:
            return found[0]
        complaint = lost_ref(self.git_dir, self.common_dir, ref or "HEAD")
        if complaint is not None:
            raise damaged(self.path, complaint, self._reflog_of(ref))
        return None

    def _reflog_of(self, ref: str | None) -> str:
        name = (ref or self.head_ref or "HEAD").removeprefix("refs/heads/")
        return f"'git -C {self.path} reflog show {name}' lists the commits that it was at before. "

    def holds(self, commit: str) -> bool:
        """Whether a commit is here, by its 40 hex digits."""
        found = self._ask(commit) if HEX.match(commit) else None
        return found is not None and found[1] == b"commit"

    def committed_at(self, commit: str) -> int:
        """When a commit was made, in seconds since 1970; one that tells no date was made at the beginning.

        Raises:
            RegistryError: there is no such commit.
        """
        found = self._ask(commit)
        if found is None or found[1] != b"commit":
            raise RegistryError(f"{self.path}: has no commit {commit}")
        line = COMMITTED.search(found[2].partition(b"\n\n")[0])
        return min(int(line[1][:20]), LAST_SECOND) if line is not None else 0

    def commit_of(self, revision: str) -> str:
        """The 40 hex digits of a commit, tag or branch; nothing else of the text reaches another command.

        Raises:
            RegistryError: there is none of that name, or several.
        """
        if any(ord(letter) < 32 for letter in revision) or not revision or len(revision) > 250:
            raise RegistryError(f"{revision!r} is not a revision: expected a commit, a tag, a branch")
        known = self._ask(f"{revision}^{{commit}}") if HEX.match(revision) else None
        if known is not None:
            return known[0]
        found = self.run(
            "rev-parse", "--verify", "--end-of-options", f"{revision}^{{commit}}", good=(0, 1, 128)
        )
        oid = found.out.decode("ascii", "replace").strip()
        if "is ambiguous" in found.errors and found.code == 0:
            raise RegistryError(
                f"{revision}: ambiguous in {self.path}; write refs/tags/{revision} or refs/heads/{revision}"
            )
        if found.code or HEX.match(oid) is None:
            name = f"refs/heads/{revision.removeprefix('refs/heads/')}"
            complaint = lost_ref(self.git_dir, self.common_dir, name) if REF.match(name) else None
            if complaint is not None:
                raise damaged(self.path, complaint, self._reflog_of(name))
            raise RegistryError(f"{revision}: no such revision in {self.path}{self.unshallow_hint}")
        return oid

    def read(self, commit: str, path: str) -> Blob | None:
        """A file as it was in a commit; ``None`` if it was not there, or a link.

        Raises:
            RegistryError: there is no such commit, or what git answered is not what it claims to be.
        """
        if "\n" in path or HEX.match(commit) is None:
            raise RegistryError(
                f"{commit}:{path!r}: expected a commit's 40 hex digits and a path of one line"
            )
        mode, oid = self._member(commit, path) or (b"", "")
        return Blob(oid, self.blob(oid)) if mode in REGULAR else None

    def _member(self, commit: str, path: str) -> Member | None:
        """Mode and id of what is at a path; the whole commit's for an empty one."""
        found: Member | None = (TREE, self._root(commit))
        for name in path.strip("/").split("/") if path.strip("/") else ():
            if found is None or found[0] != TREE:
                return None
            found = self._tree(found[1]).get(name)
        return found

    def _root(self, commit: str) -> str:
        found = self._ask(commit)
        tree = OF_A_COMMIT.match(found[2]) if found is not None and found[1] == b"commit" else None
        if tree is None:
            raise RegistryError(f"{self.path}: has no commit {commit}{self.unshallow_hint}")
        return tree[1].decode()

    def _tree(self, oid: str) -> dict[str, Member]:
        found = self._trees.get(oid)
        if found is None:
            [data] = self.objects([oid], b"tree")
            if len(self._trees) >= KEPT_TREES:
                self._trees.clear()
            found = self._trees[oid] = members(data)
        return found

    def _load(self, oids: Sequence[str]) -> Iterator[bytes]:
        return self.objects(oids, b"tree")

    def blob(self, oid: str) -> bytes:
        """The content of this id.

        Raises:
            RegistryError: there is none.
        """
        [data] = self.objects([oid])
        return data

    def listing(self, commit: str, *prefixes: str) -> dict[str, str]:
        """The id of every regular file below some folders, by path; links and other repositories are left out."""
        return {path: oid for path, (mode, oid) in self._listed(commit, prefixes) if mode in REGULAR}

    def irregular(self, commit: str, *prefixes: str) -> list[str]:
        """The links and other repositories below some folders, which no listing holds and no reader follows."""
        return [path for path, (mode, _) in self._listed(commit, prefixes) if mode not in REGULAR]

    def _listed(self, commit: str, prefixes: Sequence[str]) -> list[tuple[str, Member]]:
        found: dict[str, Member] = {}
        for prefix in prefixes or ("",):
            folder = f"{prefix.strip('/')}/".removeprefix("/")
            mode, oid = self._member(commit, folder) or (b"", "")
            if mode == TREE:
                found.update(walk(self._load, oid, folder))
        return sorted(found.items())

    def difference(
        self, before: str | None, after: str, prefix: str = ""
    ) -> list[tuple[str, Member | None, Member | None]]:
        """The paths below a folder that differ between two commits, sorted, with mode and id of what each has there.

        Without ``before`` everything is new.
        """
        folder = f"{prefix.strip('/')}/".removeprefix("/")
        commits = (before, after)
        roots = [self._member(commit, folder) if commit is not None else None for commit in commits]
        old, new = (root[1] if root is not None and root[0] == TREE else None for root in roots)
        return sorted(difference(self._load, old, new, folder), key=lambda one: one[0])

    def read_many(self, oids: Sequence[str]) -> Iterator[bytes]:
        """The contents of many files, in the order of their ids; errors as of :meth:`objects`."""
        return self.objects(oids)

    def objects(self, oids: Sequence[str], kind: bytes = b"blob") -> Iterator[bytes]:
        """The bytes of many objects, in the order of their ids, through one process for each twenty thousand.

        Raises:
            RegistryError: one is missing, too large or not what it claims to be.
        """
        if len(oids) <= FEW:
            yield from (self._one(oid, kind) for oid in oids)
            return
        for start in range(0, len(oids), CHUNK):
            chunk = oids[start : start + CHUNK]
            asked = "".join(f"{oid}\n" for oid in chunk).encode()
            answers = self.run("cat-file", "--batch", "--buffer", stdin=asked).out
            at = 0
            for oid in chunk:
                end = answers.find(b"\n", at)
                parts = answers[at:end].split()
                if len(parts) != 3 or parts[1] != kind:
                    raise self._lacks(oid, kind)
                at = end + 1 + int(parts[2]) + 1
                yield self._checked(oid, kind, answers[end + 1 : at - 1])

    def _one(self, oid: str, kind: bytes) -> bytes:
        found = self._ask(oid) if HEX.match(oid) else None
        if found is None or found[0] != oid or found[1] != kind:
            raise self._lacks(oid, kind)
        return found[2]

    def _lacks(self, oid: str, kind: bytes) -> RegistryError:
        return damaged(self.path, f"it lacks {WHAT[kind]}, object {oid[:40]}")

    def close(self) -> None:
        """End the reader of this thread; the next read starts another."""
        reader: ObjectReader | None = getattr(self._own, "reader", None)
        self._own.reader = None
        if reader is not None and reader.pid == os.getpid():
            reader.close()

    def _ask(self, name: str) -> tuple[str, bytes, bytes] | None:
        for _ in range(2):
            try:
                found = self._reader().ask(name)
            except EOFError:
                self.close()
                continue
            except BaseException:
                # An answer that was asked for and not read (Ctrl-C) would be the next question's.
                self.close()
                raise
            if found is not None:
                self._checked(*found)
            return found
        head = self.run("cat-file", "--batch-check", stdin=b"").errors
        complaint = lost_ref(self.git_dir, self.common_dir, "HEAD")
        if complaint is not None:
            raise damaged(self.path, complaint)
        raise RegistryError(f"{self.path}: git cat-file ends before it answers: {explain(head)}")

    def _reader(self) -> ObjectReader:
        reader: ObjectReader | None = getattr(self._own, "reader", None)
        if reader is None or reader.pid != os.getpid():
            git = git_in(self.path)
            command = (*self.flags, "cat-file", "--batch")
            reader = self._own.reader = ObjectReader(started(git, command, self.environment))
        return reader

    def _checked(self, oid: str, kind: bytes, data: bytes) -> bytes:
        if object_id(kind, data) != oid:
            raise damaged(self.path, f"object {oid} has the content of another one")
        return data
