"""Addresses, names, hooks and settings of a foreign registry run nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import RegistryError
from calibrary.registry.git.history import changed, history
from calibrary.registry.git.program import check_url, without_secret
from calibrary.registry.git.remotes import clone, fetch, pull, push, set_remote
from calibrary.registry.git.repository import Repository, maintain
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]


@pytest.mark.parametrize(
    "url",
    [
        "ext::sh -c 'touch /nowhere'",
        "fd::17",
        "--upload-pack=touch /nowhere",
        "-u",
        "ssh://-oProxyCommand=touch/x",
        "ssh://%2doProxyCommand=x/y",
        "-oProxyCommand=x:y",
        "host:-x",
        "http://example.com/x",
        "git://example.com/x",
        "ftp://example.com/x",
        "https://",
        "https://-x/y",
        "file://elsewhere/x",
        "https://example.com:port/x",
        "https://example.com/\nx",
        "",
    ],
)
def test_an_address_that_could_run_something_is_refused(url: str, tmp_path: Path, bare: Repository) -> None:
    with pytest.raises(RegistryError, match="not an address of a registry"):
        clone(url, tmp_path / "copy")
    assert not (tmp_path / "copy").exists()
    git(bare.path, "config", "remote.origin.url", url)
    if url:
        with pytest.raises(RegistryError, match="not an address of a registry"):
            fetch(Repository.open(bare.path))


@pytest.mark.parametrize(
    "url",
    [
        "https://user:secret@example.com:8443/fleet.git",
        "ssh://git@example.com:22/fleet.git",
        "ssh://git@[::1]/fleet.git",
        "git@example.com:fleet/cameras.git",
        "file:///srv/fleet.git",
        "/srv/fleet.git",
    ],
)
def test_addresses_of_https_ssh_and_files_are_taken(url: str) -> None:
    assert check_url(url) == url


def test_a_password_in_an_address_is_not_told() -> None:
    assert without_secret("fatal: https://ada:secret@example.com/x") == "fatal: https://ada:…@example.com/x"
    assert without_secret("https://ada:s/e@c@example.com/x: no") == "https://ada:…@example.com/x: no"
    assert without_secret(f"https://{'ghp_' + 'x' * 36}@example.com/x") == "https://…@example.com/x"
    assert (
        without_secret("https://example.com/x?a=1&access_token=T&b=2")
        == "https://example.com/x?a=1&access_token=…&b=2"
    )
    assert without_secret("ssh://git@example.com/x") == "ssh://git@example.com/x"
    with pytest.raises(RegistryError) as caught:
        check_url("http://ada:secret@example.com/x")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("name", ["-x", "a b", "../x", "", "a\nb", "x.lock"])
def test_a_remote_named_like_an_option_is_refused(bare: Repository, name: str) -> None:
    with pytest.raises(RegistryError, match="not a remote name"):
        set_remote(bare, name, "/srv/x")
    with pytest.raises(RegistryError, match="not a remote name"):
        fetch(bare, name)


EVIL = """
[core]
\tfsmonitor = {run}
\thooksPath = {hooks}
\tsshCommand = {run}
\taskPass = {run}
\tgitProxy = {run}
\talternateRefsCommand = {run}
\teditor = {run}
\tpager = {run}
[credential]
\thelper = !{run}
[filter "evil"]
\tclean = {run}
\tsmudge = {run}
\tprocess = {run}
\trequired = true
[diff]
\texternal = {run}
[diff "evil"]
\ttextconv = {run}
\tcommand = {run}
[gpg]
\tprogram = {run}
[gpg "ssh"]
\tprogram = {run}
\tdefaultKeyCommand = {run}
[remote "origin"]
\tuploadpack = {run}
\treceivepack = {run}
\tvcs = evil
[protocol "ext"]
\tallow = always
[log]
\tshowSignature = true
"""


def test_the_configuration_and_hooks_of_a_foreign_registry_run_nothing(
    bare: Repository, tmp_path: Path
) -> None:
    ran = tmp_path / "ran"
    run = tmp_path / "run"
    run.write_text(f'#!/bin/sh\necho "$0 $*" >> {ran}\nexit 1\n')
    run.chmod(0o755)
    repo = clone(str(bare.path), tmp_path / "foreign", durable=False)
    hooks = repo.git_dir / "hooks"
    hooks.mkdir(exist_ok=True)
    for hook in HOOKS:
        (hooks / hook).write_bytes(run.read_bytes())
        (hooks / hook).chmod(0o755)
    put(repo, {".gitattributes": b"* filter=evil diff=evil\n"})
    git(repo.path, "config", "extensions.worktreeConfig", "true")
    with (repo.git_dir / "config").open("a") as file:
        file.write(EVIL.format(run=run, hooks=hooks))
    (repo.git_dir / "config.worktree").write_text(f"[core]\n\tfsmonitor = {run}\n\tsshCommand = {run}\n")

    repo = Repository.open(repo.path, durable=False)
    put(repo, {ENTRY: b"fx: 2.0\n"})
    put(repo, {OTHER: b"fx: 2.0\n"}, branch="side")
    assert (repo.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    fetch(repo)
    push(repo)
    put(bare, {OTHER: b"theirs\n"})
    pull(repo)
    use_everything_that_reads(repo)
    assert not ran.exists(), ran.read_text()
    assert {"core.sshcommand", "filter.evil.smudge", "credential.helper"} <= set(repo.silenced)
    set_remote(repo, "far", "git@localhost.invalid:x")
    with pytest.raises(RegistryError):
        fetch(repo, "far")
    assert not ran.exists(), ran.read_text()


def use_everything_that_reads(repo: Repository) -> None:
    tip = repo.tip()
    assert tip is not None
    assert history(repo, ENTRY, tip)
    assert changed(repo, None, tip)
    assert list(repo.objects([*repo.listing(tip).values()]))
    maintain(repo)
    repo.close()


HOOKS = (
    "applypatch-msg",
    "fsmonitor-watchman",
    "post-checkout",
    "post-commit",
    "post-index-change",
    "post-merge",
    "post-rewrite",
    "pre-auto-gc",
    "pre-commit",
    "pre-push",
    "reference-transaction",
)


def test_the_users_own_helpers_hold_where_a_foreign_registry_names_others(
    bare: Repository, nobodys_git: Path
) -> None:
    with nobodys_git.open("a") as file:
        file.write("[credential]\n\thelper = mine\n[core]\n\tsshCommand = my-ssh\n")
    git(bare.path, "config", "--add", "credential.helper", "!theirs")
    git(bare.path, "config", "core.sshCommand", "their-ssh")
    repo = Repository.open(bare.path)
    assert repo.run("config", "--get", "core.sshCommand").out == b"my-ssh\n"
    helpers = repo.run("config", "--get-all", "credential.helper").out.decode().splitlines()
    assert helpers[-2:] == ["", "mine"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("include.path", "/nowhere/evil"),
        ("includeIf.gitdir:/.path", "/nowhere/evil"),
        ("remote.origin.promisor", "true"),
        ("gc.recentObjectsHook", "evil"),
        ("hook.evil.command", "evil"),
    ],
)
def test_a_setting_that_cannot_be_silenced_is_a_registry_that_is_not_opened(
    bare: Repository, key: str, value: str
) -> None:
    git(bare.path, "config", key, value)
    with pytest.raises(RegistryError, match=r"config --local --unset-all"):
        Repository.open(bare.path)


def test_a_tree_that_reaches_into_the_git_folder_is_not_fetched(bare: Repository, tmp_path: Path) -> None:
    blob = bare.run("hash-object", "-w", "--stdin", stdin=b"[core]\n").out.decode().strip()
    inner = bare.run("mktree", stdin=f"100644 blob {blob}\tconfig\n".encode()).out.decode().strip()
    tree = bare.run("mktree", stdin=f"040000 tree {inner}\t.git\n".encode()).out.decode().strip()
    commit = git(bare.path, "commit-tree", "-m", "evil", "-p", "main", tree)
    git(bare.path, "update-ref", "refs/heads/main", commit)
    with pytest.raises(RegistryError, match=r"\.git"):
        clone(str(bare.path), tmp_path / "copy")
    assert not (tmp_path / "copy").exists()
