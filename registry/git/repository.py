"""The one module that starts git: commands that run undisturbed, and objects read by the bytes and checked.

GitPython is used for what it is good at, starting git and talking to it. Its index and its shared ``Repo`` are
not: the documented ``index.add`` + ``index.commit`` loses entries when two processes write, and one ``Repo`` used by
two threads, or on both sides of a fork, answers with another file's bytes. So every thread of every process talks to
a ``git cat-file`` of its own, and the hash of whatever that answers is computed again.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, cast

from calibrary.errors import RegistryError
from calibrary.registry.git.errors import explain
from calibrary.registry.git.foreign import (
    ALWAYS,
    PEACE,
    Environment,
    Setting,
    judge_settings,
    parse_settings,
    repository_environment,
)
from calibrary.registry.git.names import check_path
from calibrary.registry.git.objects import HEX, Blob, ObjectReader, object_id

if TYPE_CHECKING:
    from git import Git

__all__ = ["Output", "Repository", "git_version", "run_git"]

OLDEST_GIT = (2, 24)
CHUNK = 20_000
STALE_LOCK_S = 10.0
COMMITTED = re.compile(rb"^committer .*> (\d+) [+-]\d+$", re.MULTILINE)
LAST_SECOND = 253_402_300_799
"""End of the year 9999, the last that datetime has."""
REGULAR = (b"100644", b"100755")


@dataclass(frozen=True, slots=True)
class Output:
    """What a command of git gave back."""

    code: int
    out: bytes
    errors: str


def run_git(
    arguments: Sequence[str],
    *,
    folder: Path,
    environment: Mapping[str, str],
    stdin: bytes | None = None,
    timeout_s: float | None = None,
) -> Output:
    """Run git to its end and return what it said, whatever that is.

    Raises:
        RegistryError: git is not installed or too old, or took longer than ``timeout_s``.
    """
    git = _git_in(folder)
    process = _started(git, arguments, environment)
    try:
        out, told = process.communicate(stdin if stdin is not None else b"", timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise RegistryError(
            f"git {arguments[-1]}: did not finish within {timeout_s:g} s; try again later"
        ) from None
    return Output(process.returncode, out, told.decode("utf-8", "replace"))


def _started(git: Git, arguments: Sequence[str], environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
    command = [git.GIT_PYTHON_GIT_EXECUTABLE, *arguments]
    started = git.execute(command, istream=subprocess.PIPE, as_process=True, env=environment)
    return cast("subprocess.Popen[bytes]", started)


def _git_in(folder: Path) -> Git:
    if shutil.which(os.environ.get("GIT_PYTHON_GIT_EXECUTABLE", "git")) is None:
        raise RegistryError("git is not installed, and a registry needs it: https://git-scm.com/downloads")
    from git import Git

    git = Git(folder)
    version = _version(git.GIT_PYTHON_GIT_EXECUTABLE)
    if version < OLDEST_GIT:
        found, oldest = (".".join(map(str, numbers)) for numbers in (version, OLDEST_GIT))
        raise RegistryError(f"found git {found}, expected {oldest} or newer")
    return git


def git_version(folder: Path) -> tuple[int, ...]:
    """Which git is used, as two numbers.

    Raises:
        RegistryError: there is none, or it is too old.
    """
    return _version(_git_in(folder).GIT_PYTHON_GIT_EXECUTABLE)


@lru_cache(maxsize=4)
def _version(executable: str) -> tuple[int, ...]:
    told = subprocess.run([executable, "version"], capture_output=True, check=False).stdout  # noqa: S603
    found = re.search(rb"(\d+)\.(\d+)", told)
    if found is None:
        raise RegistryError(f"{executable}: printed {told!r}, expected git's version")
    return int(found[1]), int(found[2])


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
        git_dir, common_dir, is_bare = _discover(path)
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
    def head_ref(self) -> str | None:
        """The full name of the branch that is checked out, or that a bare repository points to; else ``None``."""
        told = (self.git_dir / "HEAD").read_text(encoding="utf-8").strip()
        return told.removeprefix("ref: ") if told.startswith("ref: ") else None

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
        """
        found = self._ask(f"{ref or 'HEAD'}^{{commit}}")
        return found[0] if found else None

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
        known = self.tip(revision) if HEX.match(revision) else None
        if known is not None:
            return known
        found = self.run(
            "rev-parse", "--verify", "--end-of-options", f"{revision}^{{commit}}", good=(0, 1, 128)
        )
        oid = found.out.decode("ascii", "replace").strip()
        if "is ambiguous" in found.errors and found.code == 0:
            raise RegistryError(
                f"{revision}: ambiguous in {self.path}; write refs/tags/{revision} or refs/heads/{revision}"
            )
        if found.code or HEX.match(oid) is None:
            hint = "; this clone is shallow: git fetch --unshallow brings the rest" if self.is_shallow else ""
            raise RegistryError(f"{revision}: no such revision in {self.path}{hint}")
        return oid

    def read(self, commit: str, path: str) -> Blob | None:
        """A file as it was in a commit; ``None`` if it was not there.

        Raises:
            RegistryError: what git answered is not what it claims to be.
        """
        if "\n" in path or HEX.match(commit) is None:
            raise RegistryError(
                f"{commit}:{path!r}: expected a commit's 40 hex digits and a path of one line"
            )
        found = self._ask(f"{commit}:{path}")
        return Blob(found[0], found[2]) if found and found[1] == b"blob" else None

    def blob(self, oid: str) -> bytes:
        """The content of this id.

        Raises:
            RegistryError: there is none.
        """
        found = self._ask(oid) if HEX.match(oid) else None
        if found is None or found[0] != oid or found[1] != b"blob":
            raise RegistryError(f"{self.path}: has no file content {oid}; git fsck shows what is missing")
        return found[2]

    def listing(self, commit: str, *prefixes: str) -> dict[str, str]:
        """The id of every regular file below some folders, by path; links and other repositories are left out."""
        listed = self._listed(commit, prefixes)
        return {path: head[12:52].decode("ascii") for path, head in listed if head.startswith(REGULAR)}

    def irregular(self, commit: str, *prefixes: str) -> list[str]:
        """The links and other repositories below some folders, which no listing holds and no reader follows."""
        return [path for path, head in self._listed(commit, prefixes) if not head.startswith(REGULAR)]

    def _listed(self, commit: str, prefixes: Sequence[str]) -> Iterator[tuple[str, bytes]]:
        folders = [f"{prefix.rstrip('/')}/" for prefix in prefixes if prefix]
        where = ("--", *folders) if folders else ()
        for line in self.run("ls-tree", "-r", "-z", "--full-tree", commit, *where).out.split(b"\0"):
            head, _, path = line.partition(b"\t")
            if head:
                yield os.fsdecode(path), head

    def read_many(self, oids: Sequence[str]) -> Iterator[bytes]:
        """The content of many ids, in their order, through one process for each twenty thousand.

        Raises:
            RegistryError: one is missing, too large or not what it claims to be.
        """
        for start in range(0, len(oids), CHUNK):
            chunk = oids[start : start + CHUNK]
            asked = "".join(f"{oid}\n" for oid in chunk).encode()
            answers = self.run("cat-file", "--batch", "--buffer", stdin=asked).out
            at = 0
            for oid in chunk:
                end = answers.find(b"\n", at)
                parts = answers[at:end].split()
                if len(parts) != 3 or parts[1] != b"blob":
                    raise RegistryError(f"{self.path}: has no file content {oid}; git fsck shows more")
                at = end + 1 + int(parts[2]) + 1
                yield self._checked(oid, b"blob", answers[end + 1 : at - 1])

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
        told = self.run("cat-file", "--batch-check", stdin=b"").errors
        raise RegistryError(f"{self.path}: git cat-file ends before it answers: {explain(told)}")

    def _reader(self) -> ObjectReader:
        reader: ObjectReader | None = getattr(self._own, "reader", None)
        if reader is None or reader.pid != os.getpid():
            git = _git_in(self.path)
            command = (*self.flags, "cat-file", "--batch")
            reader = self._own.reader = ObjectReader(_started(git, command, self.environment))
        return reader

    def _checked(self, oid: str, kind: bytes, data: bytes) -> bytes:
        if object_id(kind, data) != oid:
            raise RegistryError(
                f"{self.path}: {oid} is damaged: its content has another hash; git fsck shows more"
            )
        return data


def _discover(path: Path) -> tuple[Path, Path, bool]:
    """The git folder, the one it shares with linked work trees, and whether it is bare."""
    environment = PEACE | {"GIT_CEILING_DIRECTORIES": str(path.parent)}
    if "GIT_DIR" in os.environ:
        place = path / ".git"
        environment["GIT_DIR"] = str(place if place.exists() else path)
    if "GIT_OBJECT_DIRECTORY" in os.environ:
        # It only has to be a folder here; which one it is follows from what is found.
        environment["GIT_OBJECT_DIRECTORY"] = str(path)
    # A person may have git overlook bare repositories it comes by (git-config(1)); this one was named.
    command = ("-c", "safe.bareRepository=all", "rev-parse")
    found = run_git(
        (*command, "--is-bare-repository", "--absolute-git-dir", "--git-common-dir"),
        folder=path,
        environment=environment,
    )
    lines = os.fsdecode(found.out).splitlines()
    if found.code or len(lines) != 3:
        if "not a git repository" in found.errors:
            raise RegistryError(
                f"{path}: not a git repository; expected a registry: calibrary registry init makes one"
            )
        raise RegistryError(f"{path}: cannot be opened: {explain(found.errors)}")
    git_dir = Path(os.path.realpath(lines[1]))
    common_dir = Path(os.path.realpath(path / lines[2]))
    is_bare = lines[0] == "true" or not (path / ".git").exists()
    return git_dir, common_dir, is_bare
