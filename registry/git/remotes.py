"""Other copies of a registry: clone, fetch, pull (entry by entry) and push.

A remote is accessed by its address, never by its name, so that nothing else in its section of the configuration
(helpers, programs of the other side) is used. A pull never merges text: local commits are repeated on top of the
remote's, each change is checked against the content it started from, and an entry changed on both sides is a conflict,
unless the caller says which side counts.
"""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal, TypeAlias
from urllib.parse import quote, urlsplit

from msgspec import Struct

from calibrary.errors import ConflictError, RegistryError
from calibrary.progress import log
from calibrary.registry.git.errors import (
    Conflict,
    FileConflictError,
    NoBranchError,
    RewrittenError,
    Withdrawn,
    explain,
)
from calibrary.registry.git.history import ChangedFile, Revision, changed, common_ancestor, history
from calibrary.registry.git.locks import backoff, writer_lock
from calibrary.registry.git.program import (
    Output,
    check_branch,
    check_path,
    check_remote_name,
    check_url,
    without_secret,
)
from calibrary.registry.git.repository import Repository, create
from calibrary.registry.git.writing import (
    GIVE_UP_S,
    LOCK_WAIT_S,
    File,
    Step,
    advance,
    branch_ref,
    build,
    finish_update,
    identity,
    is_checked_out,
    moment_after,
    move_branch,
    require_clean,
    subject_of,
)

NETWORK_S = 600.0
TRIES = 4
TRANSIENT = (
    "could not resolve host",
    "connection timed out",
    "connection reset",
    "operation timed out",
    "early eof",
    "remote end hung up unexpectedly",
    "the requested url returned error: 5",
    "temporary failure in name resolution",
)
LONGEST_ANSWER = 2000
PROPOSALS_OF = "proposal/"
"""Beginning of the branches that are pushed for review."""
FETCH_OPTIONS = ("--upload-pack=git-upload-pack", "--no-recurse-submodules", "--no-auto-gc")


Removed: TypeAlias = Literal["drop", "keep"]
"""What becomes of commits that a remote had and no longer has."""
Chosen: TypeAlias = Mapping[str, Literal["ours", "theirs"]]
"""Which version counts of files that both sides changed, by their paths."""
UNDECIDED: Final[Chosen] = MappingProxyType({})


class Pulled(Struct, frozen=True, kw_only=True):
    """Result of a pull.

    Attributes:
        before: local commit before; ``None`` if there was none.
        commit: local commit now.
        theirs: the remote's commit.
        replayed: number of local commits repeated on top of the remote's.
        warnings: warnings for the user.
    """

    before: str | None
    commit: str
    theirs: str
    replayed: int
    warnings: tuple[str, ...] = ()


def clone(
    url: str,
    path: Path,
    *,
    bare: bool = False,
    depth: int | None = None,
    durable: bool = True,
    check_path: Callable[[str], str] = check_path,
) -> Repository:
    """Clone a registry, checked out unless it is bare; its hooks and settings are not copied.

    Raises:
        RegistryError: the address is not valid, has no registry, or the folder is not empty; nothing is left behind.
    """
    url = check_url(url)
    existed = path.exists()
    if existed and (not path.is_dir() or any(path.iterdir())):
        raise RegistryError(f"{path}: expected a new or empty folder to clone into")
    try:
        repo = create(path, bare=bare, durable=durable, check_path=check_path)
        set_remote(repo, "origin", url)
        fetch(repo, "origin", depth=depth)
        branch = _default_branch(repo, url)
        repo.run("symbolic-ref", "HEAD", f"refs/heads/{branch}")
        _check_out(repo, f"refs/heads/{branch}", repo.tip(f"refs/remotes/origin/{branch}"))
    except BaseException:
        for made in path.iterdir() if existed else [path]:
            shutil.rmtree(made, ignore_errors=True)
        raise
    return repo


def _check_out(repo: Repository, ref: str, theirs: str | None) -> None:
    if theirs is None:
        return
    paths = [*repo.listing(theirs)]
    with writer_lock(repo.common_dir, wait_s=LOCK_WAIT_S) as lock:
        new, warnings = advance(repo, lock, ref, None, paths, partial(move_branch, repo, ref, None, theirs))
    if new is None or warnings:
        raise RegistryError(f"{repo.path}: cannot be checked out: {' '.join(warnings)}")


def _default_branch(repo: Repository, url: str) -> str:
    """Return the default branch of a remote."""
    listed = _over_network(repo, "ls-remote", "--upload-pack=git-upload-pack", "--symref", "--", url, "HEAD")
    if listed.code:
        raise RegistryError(f"{without_secret(url)}: {explain(without_secret(listed.errors))}")
    for line in listed.out.decode("utf-8", "replace").splitlines():
        if line.startswith("ref: refs/heads/") and line.endswith("\tHEAD"):
            return check_branch(line.removeprefix("ref: refs/heads/").removesuffix("\tHEAD"))
    return "main"


def set_remote(repo: Repository, name: str, url: str) -> None:
    """Store a remote's address under a name, as ``git remote add`` does.

    Raises:
        RegistryError: the name or the address is not valid.
    """
    name, url = check_remote_name(name), check_url(url)
    repo.run("config", "--local", "--replace-all", f"remote.{name}.url", url)
    repo.run(
        "config", "--local", "--replace-all", f"remote.{name}.fetch", f"+refs/heads/*:refs/remotes/{name}/*"
    )


def _address(repo: Repository, name: str, *, pushing: bool = False) -> str:
    check_remote_name(name)
    listed = repo.run(
        "config", "--get-regexp", "-z", rf"^remote\.{re.escape(name)}\.(push)?url$", good=(0, 1)
    )
    pairs = [line.partition("\n") for line in listed.out.decode("utf-8", "replace").split("\0") if line]
    urls = {key.rpartition(".")[2]: value for key, _, value in pairs}
    url = urls.get("pushurl", urls.get("url")) if pushing else urls.get("url")
    if url is None:
        raise RegistryError(
            f"{repo.path}: no remote {name!r}; name one: git -C {repo.path} remote add {name} URL"
        )
    return check_url(url)


def _tracking(name: str, ref: str) -> str:
    return f"refs/remotes/{name}/{ref.removeprefix('refs/heads/')}"


def _exchanged(name: str, ref: str) -> str:
    """Name of our own ref to the commit of a remote's branch that was pulled or pushed last."""
    return f"refs/calibrary/exchanged/{name}/{ref.removeprefix('refs/heads/')}"


def fetch(repo: Repository, name: str = "origin", *, depth: int | None = None) -> None:
    """Fetch from a remote without changing any local branch; network failures are retried.

    Raises:
        RegistryError: the remote cannot be reached, or its repository is damaged.
    """
    url = _address(repo, name)
    options = (*FETCH_OPTIONS, "--prune", "--quiet", *((f"--depth={depth:d}",) if depth is not None else ()))
    refspec = f"+refs/heads/*:refs/remotes/{name}/*"
    _with_retries(url, lambda: _over_network(repo, "fetch", *options, "--", url, refspec))


def _over_network(repo: Repository, *arguments: str) -> Output:
    return repo.run(*arguments, good=(0, 1, 128), timeout_s=NETWORK_S)


def _with_retries(url: str, attempt: Callable[[], Output]) -> Output:
    """Retry a command a few times, with growing random pauses, if it fails because of the network."""
    for tries, pause_s in enumerate(backoff(first_s=0.5, longest_s=8.0), start=1):
        output = attempt()
        is_transient = any(sign in output.errors.lower() for sign in TRANSIENT)
        if output.code == 0 or (output.code == 1 and output.out):
            return output
        if not is_transient or tries == TRIES:
            break
        log.info("%s: attempt %d failed; trying again in %.1f s", without_secret(url), tries, pause_s)
        time.sleep(pause_s)
    raise RegistryError(f"{without_secret(url)}: {explain(without_secret(output.errors))}")


def pull(
    repo: Repository,
    name: str = "origin",
    *,
    branch: str | None = None,
    chosen: Chosen = UNDECIDED,
    removed: Removed | None = None,
) -> Pulled:
    """Update a branch from a remote: fast-forward if possible, else repeat the local commits on top of the remote's.

    Args:
        repo: the repository.
        name: name of the remote.
        branch: branch to update; by default the one that is checked out.
        chosen: which version counts of files that both sides changed; of any other they are a conflict.
        removed: what becomes of commits that the remote had and no longer has; None refuses if there are any.

    Raises:
        RewrittenError: the remote was rewritten, and commits that it had would come back; nothing was changed.
        FileConflictError: both sides changed an entry; nothing was changed, and all conflicts are reported.
        NoBranchError: the remote has no such branch yet.
        RegistryError: the remote cannot be reached.
    """
    ref = branch_ref(repo, branch)
    theirs, gone = _fetched(repo, name, ref)
    if theirs is None:
        short = ref.removeprefix("refs/heads/")
        raise NoBranchError(f"{repo.path}: {name} has no branch {short}")
    pulled = _pull(repo, name, ref, theirs, gone, chosen=chosen, removed=removed)
    repo.run("update-ref", _exchanged(name, ref), theirs)
    return pulled


def _fetched(repo: Repository, name: str, ref: str) -> tuple[str | None, str | None]:
    """Fetch; return the remote's commit, and one that it had and, rewritten, no longer has.

    A fetch of another program moves the remote-tracking branch, so what was pulled or pushed last is kept beside it.
    """
    before = [repo.tip(place(name, ref)) for place in (_tracking, _exchanged)]
    fetch(repo, name)
    theirs = repo.tip(_tracking(name, ref))
    if theirs is None:
        return None, None
    gone = next((one for one in before if one is not None and not is_ancestor(repo, one, theirs)), None)
    if gone is not None:
        repo.run("update-ref", _exchanged(name, ref), gone)
    return theirs, gone


def _pull(
    repo: Repository,
    name: str,
    ref: str,
    theirs: str,
    gone: str | None,
    *,
    chosen: Chosen,
    removed: Removed | None,
) -> Pulled:
    """Put a branch on top of the remote's, which no longer has ``gone``."""
    with writer_lock(repo.common_dir, wait_s=LOCK_WAIT_S) as lock:
        if is_checked_out(repo, ref):
            finish_update(repo)
        deadline = time.monotonic() + GIVE_UP_S + repo.stale_lock_s
        for pause_s in backoff():
            ours = repo.tip(ref)
            back = _coming_back(repo, ours, theirs, gone) if gone is not None else []
            if back and removed is None:
                raise RewrittenError(name, back)
            if ours is not None and (not back or removed == "keep") and is_ancestor(repo, theirs, ours):
                return Pulled(before=ours, commit=ours, theirs=theirs, replayed=0)
            base = common_ancestor(repo, ours, theirs)
            without = gone if removed == "drop" else None
            steps, warnings = ours_on_theirs(repo, ours, theirs, chosen=chosen, without=without)
            move = partial(_move, repo, ref, ours, theirs, steps)
            # Dropped commits have changed files that theirs has not.
            starts = {base, ours} if gone is not None else {base}
            paths = sorted({file.path for start in starts for file in changed(repo, start, theirs)})
            new, words = advance(repo, lock, ref, ours, paths, move)
            if new is not None:
                return Pulled(
                    before=ours, commit=new, theirs=theirs, replayed=len(steps), warnings=(*warnings, *words)
                )
            if time.monotonic() > deadline:
                raise RegistryError(f"{repo.path}: {ref} kept moving; nothing was pulled, try again")
            time.sleep(pause_s)
    raise AssertionError  # backoff() has no end


def _coming_back(repo: Repository, ours: str | None, theirs: str, gone: str) -> list[Withdrawn]:
    """Return the local commits that a remote had, and that change something on top of what it has now."""
    if ours is None:
        return []
    here, final = repo.listing(theirs), repo.listing(ours)
    return [
        Withdrawn(commit=revision.commit, subject=subject_of(revision.message))
        for revision, files in _own_commits(repo, ours, theirs)
        if is_ancestor(repo, revision.commit, gone)
        and any(here.get(file.path) not in {file.after, final.get(file.path)} for file in files)
    ][::-1]


def _move(repo: Repository, ref: str, ours: str | None, theirs: str, steps: Sequence[Step]) -> Output:
    if not steps:
        return move_branch(repo, ref, ours, theirs)
    built = build(repo, theirs, steps)
    return built if built.code else move_branch(repo, ref, ours, built.out.split()[-1].decode())


def is_ancestor(repo: Repository, older: str, newer: str) -> bool:
    """Return whether ``older`` is in the history of ``newer``."""
    return repo.run("merge-base", "--is-ancestor", older, newer, good=(0, 1)).code == 0


def push(repo: Repository, name: str = "origin", *, branch: str | None = None) -> str:
    """Push a local branch: fast-forward only, and only from the commit last seen.

    Returns:
        The commit that both sides now have.

    Raises:
        ConflictError: the remote has new commits.
        RegistryError: the remote cannot be reached, or rejects the push.
    """
    ref = branch_ref(repo, branch)
    ours, known = repo.tip(ref), repo.tip(_tracking(name, ref))
    if ours is None:
        raise RegistryError(f"{repo.path}: nothing to push; the branch has no commit")
    if known is not None and not is_ancestor(repo, known, ours):
        raise ConflictError(
            f"{name} holds commits that are not here; nothing was sent: calibrary registry sync, again"
        )
    url = _address(repo, name, pushing=True)
    options = ("--porcelain", "--no-verify", "--receive-pack=git-receive-pack", "--no-recurse-submodules")
    lease = f"--force-with-lease={ref}:{known or ''}"
    pushed = _with_retries(
        url, lambda: _over_network(repo, "push", *options, lease, "--", url, f"{ours}:{ref}")
    )
    if pushed.code:
        raise _push_refused(url, pushed)
    repo.run("update-ref", _tracking(name, ref), ours)
    repo.run("update-ref", _exchanged(name, ref), ours)
    return ours


def _push_refused(url: str, pushed: Output) -> RegistryError:
    output = pushed.out.decode("utf-8", "replace") + pushed.errors
    if "stale info" in output or "fetch first" in output or "non-fast-forward" in output:
        return ConflictError(
            f"{without_secret(url)} has moved on; nothing was sent: calibrary registry sync, again"
        )
    if "checked out" in output:
        return RegistryError(
            f"{without_secret(url)}: that branch is checked out there, so git does not change it; "
            "push to a bare registry"
        )
    reasons = [line.rpartition("\t")[2] for line in output.splitlines() if line.startswith("!")]
    why = "; ".join(reasons) or explain(pushed.errors)
    if words := _server_message(pushed.errors):
        why = f"{why}; the server says: {words}"
    if "remote rejected" in output:
        why = f"{why}; if that branch is protected, propose your commits: 'calibrary registry sync --propose'"
    return RegistryError(f"{without_secret(url)}: nothing was pushed: {without_secret(why)}")


class Proposed(Struct, frozen=True, kw_only=True):
    """Result of :func:`propose`.

    Attributes:
        before: commit of the local branch before.
        branch: the remote's new branch.
        commit: its commit.
        theirs: commit of the remote's own branch, where the local one stands now; None if that could not be moved.
        address: where to open the change for review; None if it is not known.
        warnings: warnings for the user.
    """

    before: str
    branch: str
    commit: str
    theirs: str | None
    address: str | None
    warnings: tuple[str, ...] = ()


def propose(repo: Repository, name: str = "origin") -> Proposed:
    """Push the local commits as a new branch for review, and take them off the local branch.

    Raises:
        RewrittenError: some of them are commits that the remote had and no longer has.
        RegistryError: there are none, the remote cannot be reached or rejects the branch, is another registry, or
            uncommitted edits are in the way; the local branch stays as it was.
    """
    ref = branch_ref(repo, None)
    theirs, gone = _fetched(repo, name, ref)
    ours, target = repo.tip(ref), ref.removeprefix("refs/heads/")
    if theirs is None:
        raise RegistryError(
            f"{repo.path}: {name} has no branch {target} to propose to: calibrary registry sync makes it"
        )
    if ours is None or is_ancestor(repo, ours, theirs):
        raise RegistryError(f"{repo.path}: nothing to propose; {name} has every commit")
    common_ancestor(repo, ours, theirs)
    if gone is not None and (back := _coming_back(repo, ours, theirs, gone)):
        raise RewrittenError(name, back)
    paths = [file.path for file in changed(repo, ours, theirs)]
    if is_checked_out(repo, ref):
        require_clean(repo, ours, paths)
    whose = re.sub(r"[^a-z0-9]+", "-", identity(repo)[0].name.casefold()).strip("-") or "proposal"
    branch = check_branch(f"{PROPOSALS_OF}{whose[:40]}-{ours[:8]}")
    url = _address(repo, name, pushing=True)
    options = ("--porcelain", "--no-verify", "--receive-pack=git-receive-pack", "--no-recurse-submodules")
    pushed = _with_retries(
        url, lambda: _over_network(repo, "push", *options, "--", url, f"{ours}:refs/heads/{branch}")
    )
    if pushed.code:
        raise _push_refused(url, pushed)
    repo.run("update-ref", _tracking(name, f"refs/heads/{branch}"), ours)
    moved, warnings = None, tuple[str, ...]()
    try:
        with writer_lock(repo.common_dir, wait_s=LOCK_WAIT_S) as lock:
            move = partial(move_branch, repo, ref, ours, theirs)
            moved, warnings = advance(repo, lock, ref, ours, paths, move)
    except RegistryError as error:
        warnings = (str(error),)
    if moved is None:
        warnings = (*warnings, f"your {target} still has these commits")
    return Proposed(
        before=ours,
        branch=branch,
        commit=ours,
        theirs=theirs if moved is not None else None,
        address=review_address(url, target, branch),
        warnings=warnings,
    )


def review_address(url: str, target: str, branch: str) -> str | None:
    """Return the page of a git host that opens a branch for review; None for a host whose pages are not known.

    The forms are those of GitHub (``/compare/A...B?expand=1``), GitLab (``/-/merge_requests/new``), and Gitea and
    Forgejo (``/compare/A...B``).
    """
    scheme = "https"
    if "://" in url:
        parts = urlsplit(url)
        host, path = parts.hostname or "", parts.path
        if parts.scheme in {"http", "https"}:
            scheme, host = parts.scheme, host + (f":{parts.port}" if parts.port else "")
    else:
        host, _, path = url.rpartition("@")[2].partition(":")
        # ``github.com-work`` is the usual name of another key in ~/.ssh/config.
        host = re.sub(r"^(github|gitlab)\.com-.*", r"\1.com", host)
    path = path.strip("/").removesuffix(".git")
    if (
        not path
        or re.fullmatch(r"[A-Za-z0-9.-]+(:\d+)?", host) is None
        or url.startswith(("/", ".", "file:"))
    ):
        return None
    between = f"{quote(target)}...{quote(branch)}"
    if host == "github.com" or host.startswith("github."):
        return f"{scheme}://{host}/{path}/compare/{between}?expand=1"
    if "gitlab" in host:
        source = quote(branch, safe="")
        return f"{scheme}://{host}/{path}/-/merge_requests/new?merge_request%5Bsource_branch%5D={source}"
    if any(word in host for word in ("gitea", "forgejo", "codeberg")):
        return f"{scheme}://{host}/{path}/compare/{between}"
    return None


def _server_message(errors: str) -> str:
    """Return the output of the other side's hooks, which git passes on line by line, without control characters."""
    lines = [
        line.removeprefix("remote:").strip() for line in errors.splitlines() if line.startswith("remote:")
    ]
    said = " ".join(line for line in lines if line)
    return "".join(letter for letter in said if letter.isprintable())[:LONGEST_ANSWER]


def ours_on_theirs(
    repo: Repository,
    ours: str | None,
    theirs: str,
    *,
    chosen: Chosen = UNDECIDED,
    without: str | None = None,
) -> tuple[list[Step], tuple[str, ...]]:
    """Return the local commits that the remote lacks, as steps on top of the remote's, and warnings.

    Authors, their dates and messages are kept; the committer and the commit date are new. Changes that the remote
    already contains are omitted, and so are commits without remaining changes.

    Args:
        repo: the repository.
        ours: local commit.
        theirs: the remote's commit.
        chosen: which version counts of files that both sides changed.
        without: leaves out this commit and those before it.

    Raises:
        FileConflictError: both sides changed a file; all conflicts are reported.
        RegistryError: the local history contains a merge, or changes other files than those of a registry.
    """
    if ours is None:
        return [], ()
    committer, warnings = identity(repo)
    moment, skew = moment_after(repo, theirs, None)
    current = dict[str, str | None](repo.listing(theirs))
    final = repo.listing(ours)
    steps: list[Step] = []
    conflicts: dict[str, Conflict] = {}
    for revision, files in _own_commits(repo, ours, theirs, without):
        due = []
        for file in files:
            repo.check_path(file.path)
            now = current.get(file.path)
            if now == file.after or file.path in conflicts:
                continue
            if now != file.before:
                if now == final.get(file.path) or chosen.get(file.path) == "theirs":
                    continue
                if file.path not in chosen:
                    conflicts[file.path] = Conflict(
                        path=file.path,
                        base_oid=file.before,
                        base=_data(repo, file.before),
                        ours=_data(repo, final.get(file.path)),
                        theirs=_data(repo, now),
                        theirs_oid=now,
                    )
                    continue
            current[file.path] = file.after
            due.append(File(path=file.path, data=_data(repo, file.after)))
        if due:
            steps.append(
                Step(
                    files=due,
                    message=revision.message,
                    author=revision.author,
                    authored=revision.authored,
                    committer=committer,
                    committed=moment,
                )
            )
    if conflicts:
        raise FileConflictError([*conflicts.values()], "sync again with --ours KEY or --theirs KEY for each")
    return steps, (*warnings, *skew) if steps else ()


def _own_commits(
    repo: Repository, ours: str, theirs: str, without: str | None = None
) -> Iterator[tuple[Revision, tuple[ChangedFile, ...]]]:
    for revision in reversed(history(repo, None, f"{theirs}..{ours}")):
        if without is not None and is_ancestor(repo, revision.commit, without):
            continue
        if len(revision.parents) > 1:
            raise RegistryError(
                f"{repo.path}: {revision.commit[:12]} is a merge that theirs does not have; a pull does not "
                "replay merges: merge the two histories with git"
            )
        parent = revision.parents[0] if revision.parents else None
        yield revision, changed(repo, parent, revision.commit)


def _data(repo: Repository, oid: str | None) -> bytes | None:
    return repo.blob(oid) if oid is not None else None
