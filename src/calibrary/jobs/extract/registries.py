"""Opening of the registries of a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calibrary.errors import RegistryError
from calibrary.jobs.exchange.layers import Asked, Layers, Place, open_layers
from calibrary.registry.locking import locked
from calibrary.registry.paths import in_use_path
from calibrary.registry.published.address import is_address
from calibrary.registry.registry import open_snapshot, uncommitted
from calibrary.registry.snapshot import Snapshot

__all__ = ["opened", "warnings_of"]


def opened(places: Sequence[Place], lock: Path | None) -> tuple[Asked, tuple[str, ...]]:
    """Open the registries; also returns warnings on them.

    Args:
        places: at least one, in order of precedence.
        lock: file that pins entries of a single registry; no others are used then.

    Raises:
        RegistryError: there is no registry at the path, or the pinned entries are not available unchanged.
        InputError: the lock cannot be read.
    """
    if lock is not None:
        if len(places) > 1 or is_address(str(places[0])):
            raise RegistryError(f"{lock}: a lock is of one registry on this machine; name its folder alone")
        pinned = locked(open_snapshot(Path(places[0])), lock)
        return pinned.index, pinned.warnings
    layers = open_layers(places, many=True)
    return layers, _warnings(layers)


def warnings_of(registry: Asked) -> tuple[str, ...]:
    """Warnings found while querying registries."""
    return registry.warnings if isinstance(registry, Layers) else ()


def _warnings(layers: Layers) -> tuple[str, ...]:
    """Warnings known before registries are queried."""
    git = [layer.snapshot for layer in layers.layers if layer.snapshot is not None]
    return tuple(warning for snapshot in git for warning in _not_used(snapshot))


def _not_used(snapshot: Snapshot) -> tuple[str, ...]:
    """Warnings on uncommitted edits and waiting proposals, which are not used."""
    waiting = snapshot.waiting(
        in_use_path(path) for path in snapshot.proposed if in_use_path(path) in snapshot.paths
    )
    pending = () if waiting is None else (waiting,)
    edited = uncommitted(snapshot.repo) if snapshot.repo is not None else ()
    if not edited:
        return pending
    more = f" and {len(edited) - 1} more" if len(edited) > 1 else ""
    return (
        f"the registry is used as committed; {edited[0]}{more} differs in its work tree and is not committed "
        "('calibrary registry add FILE' does that)",
        *pending,
    )
