"""Optional libraries, installed as extras of the package.

``[calibrate]`` does not include OpenCV: opencv-python, opencv-contrib-python and their headless variants all install
the folder ``cv2``, and pip would overwrite the installed one. ``[opencv]`` installs OpenCV where there is none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec

from msgspec import Struct

from calibrary.errors import MissingExtraError
from calibrary.version import __version__


class Library(Struct, frozen=True, kw_only=True):
    """An optional library.

    Attributes:
        name: the library's name, as shown in messages.
        extras: extras that install it, as in ``pip install "calibrary[…]"``.
        floor: oldest usable (major, minor) version, checked when another package may have installed the library.
    """

    name: str
    extras: tuple[str, ...]
    floor: tuple[int, int] | None = None


LIBRARIES = {
    "av": Library(name="PyAV", extras=("recordings",), floor=(14, 0)),
    "cv2": Library(name="OpenCV", extras=("calibrate", "opencv"), floor=(4, 10)),
    "PIL": Library(name="Pillow", extras=("calibrate",)),
    "python_multipart": Library(name="python-multipart", extras=("desk",)),
    "starlette": Library(name="Starlette", extras=("desk",)),
    "uvicorn": Library(name="Uvicorn", extras=("desk",)),
    "distributed": Library(name="Dask.distributed", extras=("cluster",)),
    "jinja2": Library(name="Jinja2", extras=("pages",)),
    "matplotlib": Library(name="Matplotlib", extras=("pages",)),
    "obstore": Library(name="obstore", extras=("remote",)),
    "pyarrow": Library(name="pyarrow", extras=("tables",), floor=(17, 0)),
    "pycolmap": Library(name="pycolmap", extras=("sfm",), floor=(4, 0)),
    "pyproj": Library(name="pyproj", extras=("sfm",), floor=(3, 6)),
    "rosbags": Library(name="rosbags", extras=("recordings",)),
    "threadpoolctl": Library(name="threadpoolctl", extras=("calibrate",)),
}
"""Libraries by the name under which they are imported."""

CALIBRATE = ("cv2", "PIL")
DESK = ("starlette", "uvicorn", "python_multipart", "jinja2", "matplotlib")
PAGES = ("jinja2", "matplotlib")
SFM = ("pycolmap",)
SURVEY = ("pyproj",)
TABLES = ("pyarrow",)


def require(modules: Sequence[str], job: str) -> None:
    """Check, before any work is done, that the libraries ``job`` needs are installed.

    Args:
        modules: names in :data:`LIBRARIES`.
        job: what needs them; the subject of the error message.

    Raises:
        MissingExtraError: a library is not installed, too old, or cannot be loaded.
    """
    absent = [module for module in modules if find_spec(module) is None]
    if absent:
        raise missing(absent, job)
    for module in modules:
        _check(module, job)


def missing(modules: Sequence[str], job: str) -> MissingExtraError:
    """Return the error that names the libraries and the command that installs them."""
    libraries = [LIBRARIES[module] for module in modules]
    names = " and ".join(library.name for library in libraries)
    extras = ",".join(dict.fromkeys(extra for library in libraries for extra in library.extras))
    verb = "is" if len(libraries) == 1 else "are"
    return MissingExtraError(
        f'{job} needs {names}, which {verb} not installed: pip install "calibrary[{extras}]"'
    )


def _check(module: str, job: str) -> None:
    """Check the version of a library that another package may have installed.

    A library installed under its own name is not loaded for this: loading pycolmap replaces the signal handlers.
    """
    library = LIBRARIES[module]
    if library.floor is None:
        return
    from importlib import metadata  # noqa: PLC0415  it loads zipfile and email

    try:
        version = metadata.version(module)
    except metadata.PackageNotFoundError:
        version = _loaded_version(module, job)
    if tuple(map(int, version.split(".")[:2])) < library.floor:
        wanted = ".".join(map(str, library.floor))
        raise MissingExtraError(f"{job} needs {library.name} {wanted} or newer, found {version}: upgrade it")


def _loaded_version(module: str, job: str) -> str:
    """Return the version a module states; needed for cv2, which five packages install."""
    try:
        return str(import_module(module).__version__)
    except ImportError as error:
        reason = str(error).splitlines()[0]
        raise MissingExtraError(
            f"{job} needs {LIBRARIES[module].name}, which does not load: {reason}"
        ) from None


def programs(*further: str) -> dict[str, str]:
    """Return the versions of calibrary, numpy and ``further`` modules, which took part in a calibration."""
    versions = {"calibrary": __version__}
    for name in (*further, "numpy"):
        versions["opencv" if name == "cv2" else name] = str(import_module(name).__version__)
    return versions


def versions_in_words(versions: Mapping[str, str]) -> str:
    """Return ``versions`` in the form of a provenance: ``calibrary 1.0.0, OpenCV 4.12.0``."""
    names = {"calibrary": "calibrary", "opencv": "OpenCV", "pycolmap": "pycolmap"}
    return ", ".join(f"{names[name]} {text}" for name, text in versions.items() if name in names)
