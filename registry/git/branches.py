"""Check whether a repository that seems empty really is."""

from __future__ import annotations

from calibrary.errors import RegistryError
from calibrary.registry.git.damage import damaged
from calibrary.registry.git.objects import HEX
from calibrary.registry.git.repository import Repository

__all__ = ["require_branch"]


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
