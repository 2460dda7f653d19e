"""Values that jobs take from a caller. Each is declared here once, and is a group of flags of the command line too.

A caller in Python makes one and hands it on whole; the command line makes it from flags (:mod:`calibrary.cli.flags`),
which are named and explained by the fields. This module loads no NumPy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta, Struct, defstruct

from calibrary.errors import UsageError
from calibrary.image_size import ImageSize
from calibrary.known_camera import CameraKey
from calibrary.policy import Policy
from calibrary.provenance import ABOUT, Provenance
from calibrary.records import replace
from calibrary.records.schema import descriptions

if TYPE_CHECKING:
    from calibrary.calibration import Calibration

    FileOrCalibration: TypeAlias = str | Path | Calibration
else:
    FileOrCalibration = str | Path  # the class loads NumPy, and a flag never gives one

Day: TypeAlias = date
File: TypeAlias = Annotated[str | Path, Meta(title="FILE")]
Folder: TypeAlias = Annotated[str | Path, Meta(title="DIR")]
Place: TypeAlias = Annotated[str | Path, Meta(title="PATH|URL")]
"""A registry: its folder, ``folder:PATH`` for files without git, or the https:// address of a published one."""
CalibrationLike: TypeAlias = Annotated[FileOrCalibration, Meta(title="FILE|KEY")]
"""A calibration, a file with one, or the KEY of an entry in a registry."""
FormatName: TypeAlias = Annotated[str, Meta(title="FORMAT")]
"""A format of calibration files, or the program that reads it, as ``calibrary formats`` lists them."""
Text: TypeAlias = Annotated[str, Meta(title="TEXT")]
Edge: TypeAlias = Annotated[float, Meta(ge=0.01, le=10_000)]
"""A length on a board, mm."""
LensModel: TypeAlias = Literal[
    "auto", "k1k2", "k1k2k3", "k1k2p1p2", "brown", "rational", "fisheye", "double_sphere", "mei"
]
"""A lens model that the solver of ``calib`` has; auto chooses one."""
Workers: TypeAlias = Annotated[int, Meta(ge=0, le=256)]
PolicyLike: TypeAlias = Annotated[Policy | str | Path, Meta(title="fleet|source|FILE")]
"""A policy, the name of an included one ("fleet", "source"), or a policy file."""
CameraLike: TypeAlias = CameraKey | Callable[[CameraKey], CameraKey]
"""Stated fields, where None leaves a field to the files; or a function from the known key to the final one."""


class Reading(Struct, frozen=True, kw_only=True):
    """What a file does not state itself.

    Attributes:
        format: format of the file, or its program, if the file itself does not show it.
        image_size: image size in px, if the file states none.
        size_from_centre: if nothing states the image size, assume twice the principal point.
        pixel_origin: what the principal point counts from, if the file does not say: the outer corner of the top-left
            pixel, or its centre (default: as who wrote such files counts).
        set: an answer that only the owner of the file knows, as the error message asks for it.
        camera: which camera of a file with several, by number from 1 or by name.
        max_size_mib: largest file that is read, in MiB.
    """

    format: FormatName | None = None
    image_size: ImageSize | None = None
    size_from_centre: bool = False
    pixel_origin: Literal["corner", "centre"] | None = None
    set: Mapping[str, str] | None = None
    camera: Annotated[str | int, Meta(title="N|NAME")] | None = None
    max_size_mib: Annotated[int, Meta(ge=1, le=1 << 20)] = 64

    @property
    def max_bytes(self) -> int:
        """Largest file that is read, in bytes."""
        return self.max_size_mib << 20

    @property
    def options(self) -> Mapping[str, str]:
        """``set``, with ``pixel_origin`` as the option of that meaning."""
        return {**(self.set or {}), **({"origin": self.pixel_origin} if self.pixel_origin else {})}


class Terms(Struct, frozen=True, kw_only=True):
    """On what terms the registry changes.

    Attributes:
        reason: why, for the history.
        approve: approve it at once, if the check reports no error.
        force: accept a K that contradicts what is known of its camera; needs ``reason``, which stays in the entry.
        branch: propose it on this branch, for a pull request; the branch is created if it does not exist.
        valid_from: first day of images for which this K is valid.
        valid_until: last day of images for which this K is valid.

    Raises:
        UsageError: ``force`` without ``reason``, or a last day before the first.
    """

    reason: Text | None = None
    approve: bool = False
    force: bool = False
    branch: str | None = None
    valid_from: date | None = None
    valid_until: date | None = None

    def __post_init__(self) -> None:
        if self.force and not self.reason:
            raise UsageError("--force goes with --reason TEXT, which stays with the entry")
        if (
            self.valid_from is not None
            and self.valid_until is not None
            and self.valid_until < self.valid_from
        ):
            raise UsageError("--valid-until: expected a day after --valid-from")

    @property
    def override(self) -> str | None:
        """The reason to accept a contradiction; None if none is accepted."""
        return self.reason if self.force else None


class Sides(Struct, frozen=True, kw_only=True):
    """Which version counts of an entry that both sides changed.

    Attributes:
        ours: entry of which your version counts; or all.
        theirs: entry of which their version counts; or all.
    """

    ours: Sequence[Annotated[str, Meta(title="KEY")]] = ()
    theirs: Sequence[Annotated[str, Meta(title="KEY")]] = ()


class _Statement(Struct, frozen=True, kw_only=True):
    # The fields of Stated are those that the provenance declares with a flag.
    def of(self, made: Provenance) -> Provenance:
        """Return the provenance with what is stated here instead of what the source states."""
        return replace(made, **self._texts())

    def completing(self, made: Provenance) -> Provenance:
        """Return the provenance with what is stated here where the source states nothing."""
        return replace(made, **{name: getattr(made, name) or text for name, text in self._texts().items()})

    def warnings(self, made: Provenance) -> Iterator[str]:
        """Yield a warning for each statement that differs from the source's."""
        for name, said in self._texts().items():
            found = getattr(made, name)
            if found is not None and said != found:
                yield f"the source states the {name} {found!r:.80}, and --{name.replace('_', '-')} replaces it"

    def _texts(self) -> dict[str, str]:
        said = {name: getattr(self, name) for name in self.__struct_fields__}
        return {name: str(value) for name, value in said.items() if value is not None}


if TYPE_CHECKING:

    class Stated(_Statement, frozen=True, kw_only=True):
        """How it was calibrated, for what the source does not state."""

        date: Day | None

        def __init__(self, **stated: str | Day | None) -> None: ...
        def __getattr__(self, name: str) -> str | None: ...

else:
    _FLAGS = {name: one.flag for name, one in ABOUT.items() if one.flag is not None}
    Stated = defstruct(
        "Stated",
        [(name, (Day if flag == "day" else str) | None, None) for name, flag in _FLAGS.items()],
        bases=(_Statement,),
        module=__name__,
        namespace={
            "__doc__": "How it was calibrated, for what the source does not state.\n\nAttributes:\n"
            + "".join(f"    {name}: {descriptions(Provenance)[name]}.\n" for name in _FLAGS)
        },
        frozen=True,
        kw_only=True,
    )


def paths(given: str | Path | Sequence[str | Path]) -> tuple[Path, ...]:
    """One path or several, as an argument may have them, as paths."""
    return tuple(Path(one) for one in ([given] if isinstance(given, str | Path) else given))
