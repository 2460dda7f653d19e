"""The desk: a registry's daily work in a browser on this machine, for people who do not live in a terminal.

>>> from calibrary.jobs.desk import desk
>>> server = desk("fleet")
>>> server.address.startswith("http://127.0.0.1:")
True
>>> server.close()
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from calibrary.arguments import File, Place

if TYPE_CHECKING:
    from calibrary.jobs.desk.guard import Desk

__all__ = ["desk"]


def desk(
    registry: Place | None = None,
    *,
    port: Annotated[int, Meta(ge=0, le=65_535)] = 0,
    host: Annotated[str, Meta(title="ADDRESS")] | None = None,
    let_others_act_as_me: bool = False,
    password_file: File | None = None,
) -> Desk:
    """Open the desk of a registry, which answers once its ``run`` is called.

    Args:
        registry: the registry; calibrary registry --help explains the default.
        port: port number; 0 for any free port.
        host: listen at this address of this machine, for others in a network that you trust, instead of for this
            machine alone; needs ``let_others_act_as_me`` and ``password_file``.
        let_others_act_as_me: whoever has the password reads any images of this machine by their path, and approves with
            your key; password and pages travel unencrypted.
        password_file: file whose first line is the password that others type, of at least 12 characters.

    Raises:
        UsageError: one of ``host``, ``let_others_act_as_me`` and ``password_file`` is without the others.
        InputError: the port is in use, or the address is not one of this machine.
        RegistryError: there is no registry, or it is a published one.
        MissingExtraError: the libraries of the desk are not installed.
    """
    from calibrary.extras import DESK, require

    require(DESK, "the desk")
    from calibrary.jobs.desk.guard import Desk, Guarded, Keys
    from calibrary.jobs.fleet import Fleet

    fleet = Fleet.named(registry)
    folder = fleet.registry.repo.path

    def load(keys: Keys, scratch: Path) -> Guarded:
        from calibrary.jobs.desk.pages import Pages

        return Pages(folder, keys, scratch)

    return Desk(load, port=port, host=host, is_agreed=let_others_act_as_me, password_file=password_file)
