"""A git repository: isolated commands, and verified reading of objects.

GitPython is used only to start git where it changes something. Its index and its shared ``Repo`` are not used: the
documented ``index.add`` + ``index.commit`` loses entries if two processes write, and a ``Repo`` used by two threads,
or on both sides of a fork, returns the content of other files. So every thread of every process has its own ``git
cat-file``, and the hash of every object is verified.

A repository that git does not open is diagnosed: for git, a branch with an empty file or a lost commit looks like one
without commits, and a folder without HEAD is not a repository. Neither must be mistaken for an empty registry, or for a
plain folder.
"""

from __future__ import annotations

import os
import re
import stat
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from calibrary.errors import RegistryError
from calibrary.registry.git.errors import TooLargeError, explain
from calibrary.registry.git.objects import (
    HEX,
    REGULAR,
    TREE,
    Answer,
    Blob,
    Member,
    ObjectReader,
    difference,
    members,
    object_id,
    walk,
)
from calibrary.registry.git.program import (
    ISOLATED,
    OPTIONS_OF,
    Environment,
    Output,
    Setting,
    check_branch,
    check_path,
    git_version,
    judge_settings,
    parse_settings,
    repository_environment,
    run_git,
    started,
)


def discover(path: Path) -> tuple[Path, Path, bool]:
    """Return the git folder, the one shared with linked work trees, and whether the repository is bare."""
    environment = ISOLATED | {"GIT_CEILING_DIRECTORIES": str(path.parent)}
    if "GIT_DIR" in os.environ:
        place = path / ".git"
        environment["GIT_DIR"] = str(place if place.exists() else path)
    if "GIT_OBJECT_DIRECTORY" in os.environ:
        # Any existing folder; git only requires one here.
        environment["GIT_OBJECT_DIRECTORY"] = str(path)
    # git can be configured to ignore bare repositories that it finds (git-config(1)); this one was given explicitly.
    command = ("-c", "safe.bareRepository=all", "rev-parse")
    found = run_git(
        (*command, "--is-bare-repository", "--absolute-git-dir", "--git-common-dir"),
        folder=path,
        environment=environment,
    )
    lines = os.fsdecode(found.out).splitlines()
    if found.code or len(lines) != 3:
        raise refusal(path, found.errors)
    git_dir = Path(os.path.realpath(lines[1]))
    common_dir = Path(os.path.realpath(path / lines[2]))
    is_bare = lines[0] == "true" or not (path / ".git").exists()
    return git_dir, common_dir, is_bare


AT_ONCE: Final = 64
"""Number of objects that git is asked for before its answers are read: their names fit into any system's pipe."""
KEPT_TREES: Final = 1024
STALE_LOCK_S = 10.0
COMMITTED = re.compile(rb"^committer .*> (\d+) [+-]\d+$", re.MULTILINE)
LAST_SECOND = 253_402_300_799
"""End of the year 9999, the latest time of datetime."""
TREE_OF_COMMIT: Final = re.compile(rb"tree ([0-9a-f]{40})\n")
WHAT: Final = {b"blob": "the content of a file", b"tree": "a folder", b"commit": "a commit"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Repository:
    """A git repository for reading and writing files.

    Safe to share between threads and to carry over a fork.

    Attributes:
        path: folder at which it was opened.
        work_tree: folder with the files; ``None`` in a bare repository.
        flags: ``-c`` options of every command.
        silenced: keys of the repository's own configuration that are ignored, because they run programs.
        settings: settings of the repository and of the user.
        durable: whether a write waits for the disk.
        stale_lock_s: age in s from which a lock file of a dead git may be removed.
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
        """Open an existing repository, bare or checked out.

        Raises:
            RegistryError: there is none at exactly this folder, it belongs to another user, its kind is not supported,
                or its own configuration would run a program.
        """
        path = Path(os.path.realpath(path.parent if path.name == ".git" else path))
        if not path.is_dir():
            raise RegistryError(
                f"{path}: no such folder; expected a registry, which is a git repository; a relative path, as in "
                "$CALIBRARY_REGISTRY, counts from the folder that you are in"
            )
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
        """Whether the clone lacks older history."""
        return (self.common_dir / "shallow").exists()

    @property
    def unshallow_hint(self) -> str:
        """Suffix for messages whose cause may be the missing history of a shallow clone."""
        where = f"git -C {self.path} fetch --unshallow"
        return f"; this clone is shallow, and {where} brings the rest" if self.is_shallow else ""

    @property
    def shallow_commits(self) -> frozenset[str]:
        """Oldest commits of a shallow clone, which look as if they had added all their files."""
        file = self.common_dir / "shallow"
        return frozenset(file.read_text("utf-8", "replace").split()) if file.is_file() else frozenset()

    @property
    def head_ref(self) -> str | None:
        """Full name of the branch that is checked out, or that a bare repository points to; else ``None``."""
        head = (self.git_dir / "HEAD").read_text("utf-8", "replace").strip()
        return head.removeprefix("ref: ") if head.startswith("ref: ") else None

    def setting(self, key: str) -> str | None:
        """Return the effective value of a configuration key, given in lower case."""
        return next((setting.value for setting in reversed(self.settings) if setting.key == key), None)

    def run(
        self,
        *arguments: str,
        stdin: bytes | None = None,
        good: tuple[int, ...] = (0,),
        extra: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
    ) -> Output:
        """Run a git command in this repository.

        ``good`` are the exit codes of success, ``extra`` additional environment variables.

        Raises:
            RegistryError: the command failed; the message is git's.
        """
        command, *rest = arguments
        output = run_git(
            (*self.flags, command, *OPTIONS_OF.get(command, ()), *rest),
            folder=self.path,
            environment=self.environment | dict(extra or {}),
            stdin=stdin,
            timeout_s=timeout_s,
        )
        if output.code not in good:
            raise RegistryError(f"{self.path}: git {arguments[0]}: {explain(output.errors)}")
        return output

    def tip(self, ref: str | None = None) -> str | None:
        """Return the commit of a branch; ``None`` if it has none.

        Args:
            ref: full name of the branch; by default the one that is checked out.

        Raises:
            RegistryError: the branch is damaged: its file is empty, or its commit is lost.
        """
        found = self._asked([f"{ref or 'HEAD'}^{{commit}}"])[0]
        if found is not None:
            return found[0]
        complaint = lost_ref(self.git_dir, self.common_dir, ref or "HEAD")
        if complaint is not None:
            raise damaged(self.path, complaint, self._reflog_of(ref))
        return None

    def newest(self) -> str:
        """Return the commit of the branch that is checked out.

        Raises:
            RegistryError: there is none yet, or the branch is damaged.
        """
        tip = self.tip()
        if tip is None:
            raise RegistryError(f"{self.path}: an empty registry, without a first commit")
        return tip

    def _reflog_of(self, ref: str | None) -> str:
        name = (ref or self.head_ref or "HEAD").removeprefix("refs/heads/")
        return f"'git -C {self.path} reflog show {name}' lists the commits that it was at before. "

    def holds(self, commit: str) -> bool:
        """Return whether a commit, given by 40 hex digits, exists here."""
        found = self._asked([commit])[0] if HEX.match(commit) else None
        return found is not None and found[1] == b"commit"

    def committed_at(self, commit: str) -> int:
        """Return the time of a commit in seconds since 1970; 0 if it states no date.

        Raises:
            RegistryError: the commit does not exist.
        """
        found = self._asked([commit])[0]
        if found is None or found[1] != b"commit":
            raise RegistryError(f"{self.path}: has no commit {commit}")
        line = COMMITTED.search(found[2].partition(b"\n\n")[0])
        return min(int(line[1][:20]), LAST_SECOND) if line is not None else 0

    def commit_of(self, revision: str) -> str:
        """Return the 40 hex digits of a commit, tag or branch; no other part of the text is passed to a command.

        Raises:
            RegistryError: the name does not exist, or is ambiguous.
        """
        if any(ord(letter) < 32 for letter in revision) or not revision or len(revision) > 250:
            raise RegistryError(f"{revision!r} is not a revision: expected a commit, a tag, a branch")
        known = self._asked([f"{revision}^{{commit}}"])[0] if HEX.match(revision) else None
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
        """Return a file of a commit; ``None`` if it does not exist there, or is a link.

        Raises:
            RegistryError: the commit does not exist, or an object is damaged.
        """
        if "\n" in path or HEX.match(commit) is None:
            raise RegistryError(
                f"{commit}:{path!r}: expected a commit's 40 hex digits and a path of one line"
            )
        mode, oid = self._member(commit, path) or (b"", "")
        return Blob(oid, self.blob(oid)) if mode in REGULAR else None

    def _member(self, commit: str, path: str) -> Member | None:
        """Return mode and id of what is at a path; an empty path is the root."""
        found: Member | None = self._root(commit)
        for name in path.strip("/").split("/") if path.strip("/") else ():
            if found is None or found[0] != TREE:
                return None
            found = self._tree(found[1]).get(name)
        return found

    def _root(self, commit: str) -> Member:
        if commit not in self._trees:
            answer = self._asked([commit])[0]
            tree = TREE_OF_COMMIT.match(answer[2]) if answer is not None and answer[1] == b"commit" else None
            if tree is None:
                raise RegistryError(f"{self.path}: has no commit {commit}{self.unshallow_hint}")
            self._keep_tree(commit, {"": (TREE, tree[1].decode())})
        return self._trees[commit][""]

    def _tree(self, oid: str) -> dict[str, Member]:
        if oid not in self._trees:
            [data] = self.objects([oid], b"tree")
            self._keep_tree(oid, members(data))
        return self._trees[oid]

    def _keep_tree(self, oid: str, found: dict[str, Member]) -> None:
        if len(self._trees) >= KEPT_TREES:
            self._trees.clear()
        self._trees[oid] = found

    def _load(self, oids: Sequence[str]) -> Iterator[bytes]:
        return self.objects(oids, b"tree")

    def blob(self, oid: str) -> bytes:
        """Return the content of a blob id.

        Raises:
            RegistryError: the blob does not exist.
        """
        [data] = self.objects([oid])
        return data

    def listing(self, commit: str, *prefixes: str, irregular: bool = False) -> dict[str, str]:
        """Return the id of every regular file below some folders, by path, sorted.

        With ``irregular`` the links and submodules instead, which are never read as files.
        """
        found: dict[str, Member] = {}
        for prefix in prefixes or ("",):
            folder = f"{prefix.strip('/')}/".removeprefix("/")
            mode, oid = self._member(commit, folder) or (b"", "")
            if mode == TREE:
                found.update(walk(self._load, [(folder, oid)]))
        return {path: oid for path, (mode, oid) in sorted(found.items()) if (mode in REGULAR) != irregular}

    def folder_id(self, commit: str, folder: str) -> str | None:
        """Return the id of a folder at a commit, which follows from all that is in it; None if there is none."""
        mode, oid = self._member(commit, folder) or (b"", "")
        return oid if mode == TREE else None

    def folders(self, commit: str, top: str, depth: int) -> tuple[dict[str, str], dict[str, str]]:
        """Return the ids of the folders so many levels below one, by path with a trailing slash, and of files above."""
        level = {f"{top.strip('/')}/": oid} if (oid := self.folder_id(commit, top)) is not None else {}
        files: dict[str, str] = {}
        for _ in range(depth):
            trees, level = zip(level, map(members, self._load([*level.values()])), strict=True), {}
            for prefix, found in trees:
                level |= {f"{prefix}{name}/": oid for name, (mode, oid) in found.items() if mode == TREE}
                files |= {f"{prefix}{name}": oid for name, (mode, oid) in found.items() if mode in REGULAR}
        return level, files

    def files_in(self, folders: Sequence[tuple[str, str]]) -> dict[str, str]:
        """Return the ids of all regular files below folders, given by path and id, by path."""
        return {path: oid for path, (mode, oid) in walk(self._load, folders) if mode in REGULAR}

    def difference(
        self, before: str | None, after: str, prefix: str = ""
    ) -> list[tuple[str, Member | None, Member | None]]:
        """Return the paths below a folder that differ between two commits, sorted, with mode and id on each side.

        Without ``before`` all paths are new.
        """
        folder = f"{prefix.strip('/')}/".removeprefix("/")
        commits = (before, after)
        roots = [self._member(commit, folder) if commit is not None else None for commit in commits]
        old, new = (root[1] if root is not None and root[0] == TREE else None for root in roots)
        return sorted(difference(self._load, old, new, folder), key=lambda one: one[0])

    def readable(self, oids: Sequence[str]) -> Iterator[bytes]:
        """Yield the contents of many files; empty for one that is too large, which is an error of its own path only.

        Raises:
            RegistryError: as for :meth:`objects`.
        """
        for start in range(0, len(oids), AT_ONCE):
            some = oids[start : start + AT_ONCE]
            try:
                yield from [*self.objects(some)]
            except TooLargeError:
                for oid in some:
                    try:
                        yield self.blob(oid)
                    except TooLargeError:
                        yield b""

    def objects(self, oids: Sequence[str], kind: bytes = b"blob") -> Iterator[bytes]:
        """Yield the contents of many objects, in the order of their ids, with few of them in memory.

        Raises:
            RegistryError: an object is missing, too large or damaged.
        """
        for start in range(0, len(oids), AT_ONCE):
            some = oids[start : start + AT_ONCE]
            if (wrong := next((oid for oid in some if not HEX.match(oid)), None)) is not None:
                raise self._lacks(wrong, kind)
            for oid, found in zip(some, self._asked(some), strict=True):
                if found is None or found[0] != oid or found[1] != kind:
                    raise self._lacks(oid, kind)
                yield found[2]

    def _lacks(self, oid: str, kind: bytes) -> RegistryError:
        return damaged(self.path, f"it lacks {WHAT[kind]}, object {oid[:40]}")

    def close(self) -> None:
        """End the reader process of this thread; the next read starts another one."""
        reader: ObjectReader | None = getattr(self._own, "reader", None)
        self._own.reader = None
        if reader is not None and reader.pid == os.getpid():
            reader.close()

    def _asked(self, names: Sequence[str]) -> list[Answer | None]:
        for _ in range(2):
            try:
                answers = self._reader().ask(names)
            except EOFError:
                self.close()
                continue
            except BaseException:
                # An answer that was not read (Ctrl-C) would be taken for the answer to the next question.
                self.close()
                raise
            for found in answers:
                if found is not None and object_id(found[1], found[2]) != found[0]:
                    raise self._swapped(found[0])
            return answers
        head = self.run("cat-file", "--batch-check", stdin=b"").errors
        complaint = lost_ref(self.git_dir, self.common_dir, "HEAD")
        if complaint is not None:
            raise damaged(self.path, complaint)
        raise RegistryError(f"{self.path}: git cat-file ends before it answers: {explain(head)}")

    def _reader(self) -> ObjectReader:
        reader: ObjectReader | None = getattr(self._own, "reader", None)
        if reader is None or reader.pid != os.getpid():
            command = (*self.flags, "cat-file", "--batch")
            reader = self._own.reader = ObjectReader(started(self.path, command, self.environment))
        return reader

    def _swapped(self, oid: str) -> RegistryError:
        return damaged(self.path, f"object {oid} has the content of another one")


def require_branch(repo: Repository) -> None:
    """If the current branch has no commit, check that none was lost.

    Raises:
        RegistryError: there are other branches, or the branch had commits, or there are commits without a branch.
    """
    if repo.tip() is not None:
        return
    head = repo.head_ref or "HEAD"
    name, here = head.removeprefix("refs/heads/"), f"git -C {repo.path}"
    listed = repo.run("for-each-ref", "--format=%(refname)", "refs/heads").out.decode("utf-8", "replace")
    if others := [one.removeprefix("refs/heads/") for one in listed.split()]:
        raise RegistryError(
            f"{repo.path}: HEAD points to the branch {name}, which has no commit; there are: {', '.join(others[:8])}. "
            f"Point it to one of them: {here} symbolic-ref HEAD refs/heads/{others[0]}"
        )
    log = repo.common_dir / "logs" / head
    last = log.read_text("utf-8", "replace").splitlines()[-1:] if log.is_file() else []
    if last and HEX.match(was := last[0].split(" ")[1]):
        raise damaged(
            repo.path,
            f"the branch {name} is lost; its reflog says that it was at {was[:12]}",
            f"To bring it back: {here} update-ref refs/heads/{name} {was}. ",
        )
    if not repo.run("for-each-ref", "--count=1").out:
        kinds = repo.run("cat-file", "--batch-all-objects", "--batch-check=%(objecttype)").out.split()
        if (count := kinds.count(b"commit")) > 0:
            raise damaged(
                repo.path,
                f"it has no branch, but {count} commit{'s' * (count != 1)} to which a branch led",
                f"'{here} fsck --lost-found' names the newest; then: {here} update-ref refs/heads/{name} COMMIT. ",
            )


SAMPLE = "17"
DUE_IN_SAMPLE = 10
"""Objects in one of 256 folders, as ``git gc --auto`` estimates; about 500 writes of an entry make this many."""


def is_due(repo: Repository) -> bool:
    """Return whether about 500 writes have accumulated since the last maintenance."""
    with suppress(OSError):
        return sum(1 for _ in (repo.common_dir / "objects" / SAMPLE).iterdir()) >= DUE_IN_SAMPLE
    return False


def maintain(repo: Repository, *, in_background: bool = False) -> None:
    """Pack loose objects and write the commit-graph; optionally in the background, as git does after its own commits.

    Raises:
        RegistryError: git failed.
    """
    if in_background:
        repo.run("-c", "gc.auto=1", "-c", "gc.autoDetach=true", "gc", "--auto", "--quiet")
        return
    if not is_locked(repo):
        repo.run("gc", "--quiet")
    index_paths(repo)


def index_paths(repo: Repository) -> None:
    """Store the paths changed by each commit in the commit-graph; gc keeps this up to date from then on."""
    repo.run("commit-graph", "write", "--reachable", "--changed-paths", "--no-progress")


def is_locked(repo: Repository) -> bool:
    """Return whether a gc is running."""
    return Path(repo.common_dir, "gc.pid").exists()


FORMATS = (("object", "sha1", (2, 29)), ("ref", "files", (2, 45)))
"""Set where git knows the option: GitPython cannot read git's future defaults."""


def create(
    path: Path,
    *,
    bare: bool = False,
    branch: str = "main",
    durable: bool = True,
    check_path: Callable[[str], str] = check_path,
) -> Repository:
    """Create a repository without a commit, and without the hooks of git's templates.

    Raises:
        RegistryError: there already is one, or the folder cannot be created.
    """
    if (path / ".git").exists() or (path / "HEAD").exists():
        raise RegistryError(f"{path}: there is a git repository already; expected a folder without one")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RegistryError(f"{path}: cannot be created: {error.strerror}") from None
    path = path.resolve()
    place = path if bare else path / ".git"
    version = git_version()
    formats = [f"--{name}-format={kind}" for name, kind, since in FORMATS if version >= since]
    # Set the variables explicitly, since those of an enclosing hook would override the folder.
    where = ISOLATED | {"GIT_DIR": str(place), "GIT_OBJECT_DIRECTORY": str(place / "objects")}
    where |= {} if bare else {"GIT_WORK_TREE": str(path)}
    shape = ("--bare",) if bare else ()
    made = run_git(("init", "--quiet", "--template=", *formats, *shape), folder=path, environment=where)
    if made.code:
        raise RegistryError(f"{path}: cannot create a repository: {made.errors.strip()}")
    (place / "HEAD").write_text(f"ref: refs/heads/{check_branch(branch)}\n", encoding="utf-8")
    if not bare:
        # git init stores the path of the work tree; with it the folder could not be moved.
        forget = ("config", "--unset-all", "core.worktree")
        run_git(forget, folder=path, environment=ISOLATED | {"GIT_DIR": str(place)})
    return Repository.open(path, durable=durable, check_path=check_path)


REF: Final = re.compile(r"refs/(?!.*\.\.)[^\0-\040\\:?*\[~^]+\Z")
PACKED: Final = re.compile(r"(#.*|\^[0-9a-f]{40}|[0-9a-f]{40} \S+)?\Z")
DEEPEST: Final = 5


def damaged(place: Path, what: str, remedy: str = "") -> RegistryError:
    """Return the error for a damaged repository, with the commands that diagnose or repair it."""
    return RegistryError(
        f"{place}: the repository is damaged: {what}. {remedy}'git -C {place} fsck --full' lists what is missing or "
        "broken; what is pushed is whole in a new clone: calibrary registry init FOLDER --remote URL"
    )


def lost_ref(git_dir: Path, common_dir: Path, ref: str, depth: int = DEEPEST) -> str | None:
    """Return what is wrong with a ref that git does not resolve to a commit; None if it does not exist.

    Args:
        git_dir: git folder of the work tree.
        common_dir: git folder of the repository.
        ref: ``HEAD`` or the full name.
        depth: allowed number of symbolic refs.
    """
    if ref != "HEAD" and (REF.match(ref) is None or not depth):
        return f"HEAD points to {ref[:60]!r}, expected a branch such as refs/heads/main"
    file = git_dir / ref if ref == "HEAD" else common_dir / ref
    try:
        content = file.read_bytes()[:200].decode("utf-8", "replace").strip()
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        return _lost_packed(common_dir / "packed-refs", ref)
    except OSError as error:
        return f"{file} cannot be read: {error.strerror}"
    if content.startswith("ref: "):
        return lost_ref(git_dir, common_dir, content.removeprefix("ref: ").strip(), depth - 1)
    if HEX.match(content) is not None:
        return f"{ref} is at commit {content[:12]}, which is missing or is not a commit"
    return (
        f"{file} is empty"
        if not content.strip("\0")
        else f"{file} contains {content[:40]!r}, expected a commit"
    )


def _lost_packed(file: Path, ref: str) -> str | None:
    try:
        lines = file.read_bytes().decode("utf-8", "replace").splitlines()
    except FileNotFoundError:
        return None
    except OSError as error:
        return f"{file} cannot be read: {error.strerror}"
    for number, line in enumerate(lines, start=1):
        if PACKED.match(line) is None:
            return f"line {number} of {file} is {line[:40]!r}, expected a commit and the name of a branch"
        if line[40:] == f" {ref}":
            return f"{ref} is at commit {line[:12]}, which is missing or is not a commit"
    return None


def refusal(path: Path, content: str) -> RegistryError:
    """Return the error for a folder that git does not open as a repository, with a remedy.

    Args:
        path: the folder.
        content: message of git.
    """
    git_dir = path / ".git" if os.path.lexists(path / ".git") else path
    if "dubious ownership" in content:
        return _of_another_user(path)
    if "not a git repository" not in content:
        return RegistryError(f"{path}: cannot be opened: {explain(content)}")
    if git_dir != path or any(os.path.lexists(path / name) for name in ("objects", "refs")):
        return _broken(path, git_dir)
    around = next((folder for folder in path.parents if os.path.lexists(folder / ".git")), None)
    if around is not None:
        inside = path.relative_to(around).as_posix()
        return RegistryError(
            f"{path}: not a git repository, but a folder of the one in {around}; expected a registry that is a "
            "repository of its own, with its own history and approvals. To make it one, with its history: git -C "
            f"{around} subtree split --prefix={inside} -b registry, then calibrary registry init FOLDER --remote URL "
            "of what you push it to"
        )
    return RegistryError(
        f"{path}: not a git repository; expected a registry: calibrary registry init makes one"
    )


def _of_another_user(path: Path) -> RegistryError:
    return RegistryError(
        f"{path}: it belongs to another user, and git reads it only if you say that you trust it. For one command, "
        "without writing anything: GIT_CONFIG_COUNT=1 GIT_CONFIG_KEY_0=safe.directory GIT_CONFIG_VALUE_0="
        f"{path} calibrary …; for good: git config --global --add safe.directory {path}"
    )


def _broken(path: Path, git_dir: Path) -> RegistryError:
    """Return the error that names the missing part of a git folder."""
    try:
        if stat.S_ISREG(git_dir.stat().st_mode):
            points = git_dir.read_text("utf-8", "replace").strip()[:200]
            return damaged(path, f"{git_dir} says {points!r}, and no repository is there")
        next(git_dir.iterdir(), None)
        head = (git_dir / "HEAD").read_bytes()[:60]
    except FileNotFoundError as error:
        return damaged(path, f"{error.filename} is missing", _head_remedy(git_dir))
    except OSError as error:
        return RegistryError(
            f"{path}: {error.filename} cannot be read: {error.strerror}; expected read access for this user: "
            f"ls -ld {error.filename}"
        )
    missing = [name for name in ("objects", "refs") if not (git_dir / name).is_dir()]
    if missing:
        return damaged(path, f"{git_dir} has no {' and no '.join(missing)}")
    return damaged(
        path, f"{git_dir / 'HEAD'} contains {head!r}, expected 'ref: refs/heads/main'", _head_remedy(git_dir)
    )


def _head_remedy(git_dir: Path) -> str:
    return f"Put it back: echo 'ref: refs/heads/main' > {git_dir / 'HEAD'} (or the name of your branch). "
