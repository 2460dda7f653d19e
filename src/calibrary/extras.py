"""Libraries that only some jobs need: a plain install leaves them out, an extra brings them.

``[calibrate]`` names no OpenCV: opencv-python, opencv-contrib-python and their headless twins all install the same
folder ``cv2``, and pip would put the one that is named over the one that is there. ``[opencv]`` brings one where there
is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as version_of
from importlib.util import find_spec

from msgspec import Struct

from calibrary.errors import MissingExtraError

__all__ = ["CALIBRATE", "LIBRARIES", "PAGES", "SFM", "SURVEY", "TABLES", "Library", "missing", "require"]


class Library(Struct, frozen=True, kw_only=True):
    """A library of an extra.

    Attributes:
        name: as people write it.
        extras: what to install to have it, as in ``pip install "calibrary[…]"``.
        floor: the oldest (major, minor) that serves, where another package than ours may have brought it.
    """

    name: str
    extras: tuple[str, ...]
    floor: tuple[int, int] | None = None


LIBRARIES = {
    "cv2": Library(name="OpenCV", extras=("calibrate", "opencv"), floor=(4, 10)),
    "PIL": Library(name="Pillow", extras=("calibrate",)),
    "distributed": Library(name="Dask.distributed", extras=("cluster",)),
    "fsspec": Library(name="fsspec", extras=("remote",)),
    "jinja2": Library(name="Jinja2", extras=("pages",)),
    "matplotlib": Library(name="Matplotlib", extras=("pages",)),
    "obstore": Library(name="obstore", extras=("remote",)),
    "pyarrow": Library(name="pyarrow", extras=("tables",), floor=(17, 0)),
    "pycolmap": Library(name="pycolmap", extras=("sfm",), floor=(4, 0)),
    "pyproj": Library(name="pyproj", extras=("sfm",), floor=(3, 6)),
}
"""By the name they are imported by."""

CALIBRATE = ("cv2", "PIL")
PAGES = ("jinja2", "matplotlib")
SFM = ("pycolmap",)
SURVEY = ("pyproj",)
TABLES = ("pyarrow",)


def require(modules: Sequence[str], job: str) -> None:
    """Check, before any work is done, that what ``job`` needs is installed.

    Args:
        modules: names in :data:`LIBRARIES`.
        job: what needs them, as the message's subject.

    Raises:
        MissingExtraError: one is not installed, too old, or cannot be loaded.
    """
    absent = [module for module in modules if find_spec(module) is None]
    if absent:
        raise missing(absent, job)
    for module in modules:
        _check(module, job)


def missing(modules: Sequence[str], job: str) -> MissingExtraError:
    """The error that names the libraries and the command that installs them."""
    libraries = [LIBRARIES[module] for module in modules]
    names = " and ".join(library.name for library in libraries)
    extras = ",".join(dict.fromkeys(extra for library in libraries for extra in library.extras))
    verb = "is" if len(libraries) == 1 else "are"
    return MissingExtraError(
        f'{job} needs {names}, which {verb} not installed: pip install "calibrary[{extras}]"'
    )


def _check(module: str, job: str) -> None:
    """Look how old a library is that another package may have brought.

    One that is installed under its own name is not loaded for that: pycolmap takes over the signals of its process.
    """
    library = LIBRARIES[module]
    if library.floor is None:
        return
    try:
        version = version_of(module)
    except PackageNotFoundError:
        version = _loaded_version(module, job)
    if tuple(map(int, version.split(".")[:2])) < library.floor:
        wanted = ".".join(map(str, library.floor))
        raise MissingExtraError(f"{job} needs {library.name} {wanted} or newer, found {version}: upgrade it")


def _loaded_version(module: str, job: str) -> str:
    """The version that a module states, such as cv2, which five packages install."""
    try:
        return str(import_module(module).__version__)
    except ImportError as error:
        reason = str(error).splitlines()[0]
        raise MissingExtraError(
            f"{job} needs {LIBRARIES[module].name}, which does not load: {reason}"
        ) from None
