"""Running git: the only module that starts it, with what may be passed to it and which settings it may follow.

Names: git itself accepts ``../x`` and ``.git/config`` as paths in a fast-import stream, and lets a file replace a
folder. The names accepted here are also valid on file systems that ignore case and on Windows. Addresses must use a
transport that runs no other program, and a password never appears in a message.

Settings: a registry may come from any source, as a folder with its own ``.git/config``, and git's settings can name
programs to run. So settings in the repository's own files are not followed where they could run a program: such keys
are reset, for every command, to the value in the user's own configuration, or to nothing. A repository with settings
that cannot be reset is not opened. The user's own files (``~/.gitconfig``, the system's) apply as usual: credential
helpers, ssh, signing keys.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final, cast
from urllib.parse import urlsplit

from msgspec import Struct

from calibrary.errors import RegistryError

OLDEST_GIT = (2, 24)
READING: Final = frozenset(
    {
        "cat-file",
        "config",
        "diff-index",
        "for-each-ref",
        "log",
        "ls-tree",
        "merge-base",
        "rev-list",
        "rev-parse",
        "status",
    }
)
"""Commands that every reader waits for; the others, which change a repository or talk to another, go by GitPython."""


class Output(Struct, frozen=True):
    """Result of a git command."""

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
    """Run git to its end and return its output, whatever the exit code.

    Raises:
        RegistryError: git is not installed or too old, or took longer than ``timeout_s``.
    """
    process = started(folder, arguments, environment)
    try:
        out, errors = process.communicate(stdin if stdin is not None else b"", timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise RegistryError(
            f"git {arguments[-1]}: did not finish within {timeout_s:g} s; try again later"
        ) from None
    return Output(process.returncode, out, errors.decode("utf-8", "replace"))


def started(
    folder: Path, arguments: Sequence[str], environment: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    """Start git in a folder; the caller holds its pipes.

    Raises:
        RegistryError: git is not installed or too old.
    """
    executable = _executable()
    if READING & set(arguments):
        # Importing GitPython takes longer than most of these commands.
        return subprocess.Popen(  # noqa: S603  git as the user has it, with arguments of ours
            [executable, *arguments],
            cwd=folder,
            env={**os.environ, "LANGUAGE": "C", "LC_ALL": "C", **environment},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
    from git import Git

    process = Git(folder).execute(
        [executable, *arguments], istream=subprocess.PIPE, as_process=True, env=environment
    )
    return cast("subprocess.Popen[bytes]", process)


def git_version() -> tuple[int, ...]:
    """Return the version of git as two numbers.

    Raises:
        RegistryError: git is not installed or too old.
    """
    return _version(_executable())


def _executable() -> str:
    executable = os.environ.get("GIT_PYTHON_GIT_EXECUTABLE", "git")
    if shutil.which(executable) is None:
        raise RegistryError(
            "git is not installed, and a registry needs it: https://git-scm.com/downloads; --registry folder:PATH "
            "reads the files of a clone without git"
        )
    version = _version(executable)
    if version < OLDEST_GIT:
        found, oldest = (".".join(map(str, numbers)) for numbers in (version, OLDEST_GIT))
        raise RegistryError(f"found git {found}, expected {oldest} or newer")
    return executable


@lru_cache(maxsize=4)
def _version(executable: str) -> tuple[int, ...]:
    printed = subprocess.run([executable, "version"], capture_output=True, check=False).stdout  # noqa: S603
    found = re.search(rb"(\d+)\.(\d+)", printed)
    if found is None:
        raise RegistryError(f"{executable}: printed {printed!r}, expected git's version")
    return int(found[1]), int(found[2])


LONGEST_NAME = 120
NAME = re.compile(r"[A-Za-z0-9_.][A-Za-z0-9._~+-]*\Z")
DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9]|conin\$|conout\$)(\.|\Z)", re.IGNORECASE)
BRANCH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._+-]*(/[A-Za-z0-9_][A-Za-z0-9._+-]*)*\Z")
REMOTE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,60}\Z")


def check_path(path: str) -> str:
    """Return the path, if it is a file below the repository's root on every system.

    Raises:
        RegistryError: the path is not allowed.
    """
    if not all(is_safe_name(name) for name in path.split("/")):
        raise RegistryError(
            f"{path!r} is not a path in a repository: expected names of letters, digits, . _ ~ + -"
        )
    return path


def is_safe_name(name: str) -> bool:
    """Return whether a part of a path is valid on every file system and has no special meaning for git."""
    return (
        len(name) <= LONGEST_NAME
        and NAME.match(name) is not None
        and DEVICE.match(name) is None
        and not name.endswith((".", ".lock"))
        and ".." not in name
        and name.casefold() not in {".git", "git~1"}
    )


def check_branch(name: str) -> str:
    """Return the branch name, if git accepts it on every system and it does not look like an option.

    Raises:
        RegistryError: the name is not allowed.
    """
    parts = name.split("/")
    if (
        BRANCH.match(name) is None
        or len(name) > LONGEST_NAME
        or name == "HEAD"
        or any(".." in part or part.endswith((".", ".lock")) for part in parts)
    ):
        raise RegistryError(f"{name!r} is not a branch name: expected letters, digits and . _ + - /")
    return name


def check_remote_name(name: str) -> str:
    """Return the remote's name, if it is a plain word.

    Raises:
        RegistryError: the name is not allowed.
    """
    if REMOTE.match(name) is None or ".." in name or name.endswith((".", ".lock")):
        raise RegistryError(f"{name!r} is not a remote name: expected a word such as origin")
    return name


SCP_LIKE = re.compile(r"(?:(?P<user>[\w.+-]+)@)?(?P<host>[\w.-]+|\[[0-9A-Fa-f:.]+\]):(?P<path>[^:].*)\Z")
DRIVE = re.compile(r"[A-Za-z]:[\\/]")
HOST = re.compile(r"[A-Za-z0-9_]")
LONGEST = 2000


def check_url(url: str) -> str:
    """Return the address, if it is valid; that of a folder as an absolute path.

    Raises:
        RegistryError: the address is not supported.
    """
    if not url or len(url) > LONGEST or any(ord(letter) < 33 for letter in url.replace(" ", "")):
        raise _refused(url, "empty, too long or with control characters")
    if url.startswith("-"):
        raise _refused(url, "it looks like an option")
    if "::" in url.partition("[")[0].partition("/")[0]:
        raise _refused(url, "it names a helper program")
    scheme, separator, _ = url.partition("://")
    if separator:
        return _with_scheme(url, scheme.lower())
    scp = None if DRIVE.match(url) else SCP_LIKE.match(url)
    if scp is not None and "/" not in url.partition(":")[0]:
        if scp["host"].startswith("-") or (scp["user"] or "").startswith("-") or scp["path"].startswith("-"):
            raise _refused(url, "part of it looks like an option")
        return url
    return os.path.abspath(Path(url).expanduser())  # noqa: PTH100  links are the remote's own affair


def _with_scheme(url: str, scheme: str) -> str:
    if scheme not in {"https", "ssh", "file"}:
        raise _refused(url, f"{scheme} is not supported")
    try:
        parts = urlsplit(url)
        host, user = parts.hostname or "", parts.username or ""
        _ = parts.port
    except ValueError:
        raise _refused(url, "it cannot be read") from None
    if scheme == "file":
        if host not in {"", "localhost"}:
            raise _refused(url, "a file address names no host: file:///path")
        return url
    if (
        (HOST.match(host) is None and ":" not in host)
        or user.startswith("-")
        or "%2d" in parts.netloc.lower()
    ):
        raise _refused(url, "it names no host")
    return url


def _refused(url: str, why: str) -> RegistryError:
    return RegistryError(
        f"{without_secret(url)!r} is not an address of a registry ({why}): expected https://, ssh://, user@host:path "
        "or a folder"
    )


def without_secret(text: str) -> str:
    """Return the text without passwords and tokens in its addresses, also those that should have been escaped."""
    text = re.sub(r"(://[^/@\s:]*):\S*@", r"\1:…@", text)
    text = re.sub(rf"(://)[^/@\s:]{{{TOKEN_LENGTH},}}@", r"\1…@", text)
    return re.sub(
        r"([?&][^=&#\s]*(?:token|key|secret|password|sig)[^=&#\s]*=)[^&#\s]+",
        r"\1…",
        text,
        flags=re.IGNORECASE,
    )


TOKEN_LENGTH: Final = 20
"""Least length of what stands for a name in an address and is a host's access token."""


Environment = dict[str, str]

PINNED: tuple[tuple[str, str], ...] = (
    # These two run a program of the repository at almost every command.
    ("core.hooksPath", os.devnull),
    ("core.fsmonitor", "false"),
    ("core.filesRefLockTimeout", "50"),
    ("core.protectHFS", "true"),
    ("core.protectNTFS", "true"),
    ("core.quotePath", "false"),
    # Of 100 000 entries, git keeps the bases of its differences in memory; with 96 MB it would unpack them six times.
    ("core.deltaBaseCacheLimit", "512m"),
    ("core.warnAmbiguousRefs", "true"),
    ("color.ui", "false"),
    ("diff.renames", "false"),
    # Git's own value: a small write stays loose objects, which maintenance packs, instead of a pack of its own.
    ("fastimport.unpackLimit", "100"),
    ("fetch.fsckObjects", "true"),
    ("fetch.recurseSubmodules", "false"),
    # Maintenance runs only where Repository asks for it, and keeps what another writer has just begun to write.
    ("gc.auto", "0"),
    ("gc.pruneExpire", "2.weeks.ago"),
    ("http.lowSpeedLimit", "1000"),
    ("http.lowSpeedTime", "60"),
    ("i18n.commitEncoding", "UTF-8"),
    ("i18n.logOutputEncoding", "UTF-8"),
    ("log.follow", "false"),
    # With false, the first revision of an entry would be missing from its history.
    ("log.showRoot", "true"),
    ("log.showSignature", "false"),
    ("maintenance.auto", "false"),
    ("submodule.recurse", "false"),
)
"""Options of every command: no program of the repository runs, and no user setting changes what is read."""

RUNS_A_PROGRAM: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"core\.sshcommand\Z"), "ssh"),
    (re.compile(r"core\.(askpass|gitproxy|editor|pager)\Z"), ""),
    (re.compile(r"core\.alternaterefscommand\Z"), "true"),
    (re.compile(r"credential\.(.*\.)?helper\Z"), ""),
    (re.compile(r"filter\..*\.(clean|smudge|process)\Z"), ""),
    (re.compile(r"filter\..*\.required\Z"), "false"),
    (re.compile(r"diff\.external\Z|diff\..*\.(command|textconv)\Z"), ""),
    (re.compile(r"gpg\.(openpgp\.)?program\Z"), "gpg"),
    (re.compile(r"gpg\.x509\.program\Z"), "gpgsm"),
    (re.compile(r"gpg\.ssh\.program\Z"), "ssh-keygen"),
    (re.compile(r"gpg\.ssh\.defaultkeycommand\Z"), ""),
    # Cookies could be written to any file; a foreign proxy with a foreign certificate could read passwords.
    (re.compile(r"http\.(.*\.)?(cookiefile|sslcainfo|sslcapath)\Z"), ""),
    (re.compile(r"http\.(.*\.)?savecookies\Z"), "false"),
    (re.compile(r"http\.(.*\.)?sslverify\Z"), "true"),
)
"""Keys and the values they are reset to. Keys of remotes are not included: remotes are addressed only by URL."""

OPTIONS_OF: dict[str, tuple[str, ...]] = {"status": ("--ignore-submodules=all",)}
"""Options of commands that would otherwise enter other repositories, where the settings of those would apply."""

REFUSED = re.compile(r"include\.path\Z|includeif\..+|gc\.recentobjectshook\Z|hook\..+", re.DOTALL)

PARTIAL = re.compile(r"extensions\.partialclone\Z|remote\..+\.(promisor|partialclonefilter)\Z", re.DOTALL)
"""With these, git fetches missing objects during reading from a place that the repository chooses."""


class Setting(Struct, frozen=True, kw_only=True):
    """A line of git's configuration.

    Attributes:
        key: section and name in lower case, the part between them as written.
        is_local: whether it is from the repository itself, and not from the user or the system.
    """

    key: str
    value: str
    is_local: bool


def parse_settings(listed: bytes, folders: Sequence[Path], base: Path) -> tuple[Setting, ...]:
    """Parse the output of ``git config --list --show-origin -z``.

    A setting from a file below one of ``folders``, those of the repository, is local, also if that file is a link;
    file names are relative to ``base``.
    """
    fields = listed.split(b"\0")
    settings = []
    for origin, line in zip(fields[0::2], fields[1::2], strict=False):
        key, _, value = os.fsdecode(line).partition("\n")
        kind, _, name = os.fsdecode(origin).partition(":")
        file = base / name
        places = (Path(os.path.realpath(file)), Path(os.path.realpath(file.parent), file.name))
        is_local = kind == "file" and any(
            place.is_relative_to(folder) for place in places for folder in folders
        )
        settings.append(Setting(key=key, value=value, is_local=is_local))
    return tuple(settings)


def judge_settings(settings: Sequence[Setting], source: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the ``-c`` options that disable dangerous settings of a repository, and the keys disabled by them.

    Raises:
        RegistryError: a setting must be removed, or this kind of repository is not supported.
    """
    _check_kind(settings, source)
    local = [setting.key for setting in settings if setting.is_local]
    if lazy := [key for key in dict.fromkeys(local) if PARTIAL.match(key)]:
        unset = "; ".join(f"git -C {source} config --local --unset-all {key}" for key in lazy)
        raise RegistryError(
            f"{source}: a partial clone, which lacks files that git would fetch while it is read. To make it whole: "
            f"git -C {source} fetch --refetch --no-filter; {unset}. Or clone it without a filter: calibrary registry "
            "init FOLDER --remote URL"
        )
    flags = [f"{key}={value}" for key, value in PINNED]
    silenced = []
    for key in dict.fromkeys(local):
        fallback = next((value for pattern, value in RUNS_A_PROGRAM if pattern.match(key)), None)
        # For -c, the name of a key ends at the first "=".
        if REFUSED.match(key) or (fallback is not None and "=" in key):
            raise RegistryError(
                f"{source}: its own git configuration sets {key}, which can make reading it run a program or "
                f"reach elsewhere; check it, then remove it: git -C {source} config --local --unset-all {key}"
            )
        if fallback is None:
            continue
        silenced.append(key)
        mine = [setting.value for setting in settings if setting.key == key and not setting.is_local]
        flags.append(f"{key}={fallback}")
        flags += [f"{key}={value}" for value in mine]
    return tuple(part for flag in flags for part in ("-c", flag)), tuple(silenced)


def _check_kind(settings: Sequence[Setting], source: str) -> None:
    for setting in settings:
        found = setting.value.lower()
        if setting.key == "extensions.objectformat" and found != "sha1":
            raise RegistryError(
                f"{source}: a git repository with {found} object names; GitPython reads sha1 only. Make the "
                "registry with calibrary, or by: git init --object-format=sha1"
            )
        if setting.key == "extensions.refstorage" and found != "files":
            raise RegistryError(
                f"{source}: a git repository that stores its branches as {found}; expected plain files. Convert "
                "it: git refs migrate --ref-format=files"
            )


def repository_environment(git_dir: Path, common_dir: Path, work_tree: Path | None) -> Environment:
    """Return the variables that tie every command to this repository, whatever a hook or a shell has set.

    For a hook of this repository that checks a push (pre-receive), the pushed objects are in a separate folder inside
    it, which is included.
    """
    objects = common_dir / "objects"
    pushed = Path(os.path.realpath(os.environ.get("GIT_QUARANTINE_PATH", "")))
    is_judging = pushed != objects and pushed.is_relative_to(objects)
    return ISOLATED | {
        "GIT_DIR": str(git_dir),
        "GIT_COMMON_DIR": str(common_dir),
        "GIT_WORK_TREE": str(work_tree or git_dir),
        "GIT_INDEX_FILE": str(git_dir / "index"),
        "GIT_OBJECT_DIRECTORY": str(pushed if is_judging else objects),
        "GIT_ALTERNATE_OBJECT_DIRECTORIES": str(objects) if is_judging else "",
        # A file that does not exist; info/grafts would change the history.
        "GIT_GRAFT_FILE": str(git_dir / "info" / "no-grafts"),
    }


ISOLATED: Environment = {
    "GIT_ALLOW_PROTOCOL": "https:ssh:file",
    "GIT_EDITOR": ":",
    "GIT_GLOB_PATHSPECS": "0",
    "GIT_ICASE_PATHSPECS": "0",
    "GIT_LITERAL_PATHSPECS": "1",
    "GIT_NAMESPACE": "",
    "GIT_NOGLOB_PATHSPECS": "0",
    "GIT_NO_LAZY_FETCH": "1",
    "GIT_NO_REPLACE_OBJECTS": "1",
    "GIT_OPTIONAL_LOCKS": "0",
    "GIT_PAGER": "cat",
    "GIT_TERMINAL_PROMPT": "0",
}
"""git asks no questions, fetches nothing during a read, and uses no other protocol."""
