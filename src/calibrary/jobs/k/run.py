"""One K from the doors that judge it, with whether it may be used."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calibrary.admission import admission
from calibrary.arguments import Place, Reading
from calibrary.calibration import Calibration, Intrinsics
from calibrary.errors import InputError, RegistryError
from calibrary.jobs.extract import extract
from calibrary.jobs.files import chosen
from calibrary.jobs.resolve import resolve
from calibrary.jobs.use import allowed
from calibrary.policy import FLEET
from calibrary.records import Record
from calibrary.validation import Use, Verdict


class OneK(Record, tag_field="schema", tag="calibrary/k-1"):
    """One K, and whether it may be used; output of ``calibrary k --json``.

    Attributes:
        use: what a solver may do with this K.
        why: what it is, or why it may not be used.
        calibration: with its K; None if there is only a seed.
        seed: values to start a self-calibration with, which are no K; None if there is a K.
    """

    use: Use
    why: str
    calibration: Calibration | None = None
    seed: Intrinsics | None = None

    @property
    def is_usable(self) -> bool:
        """Whether a program may be given this K."""
        return self.use is not Use.NONE

    @property
    def intrinsics(self) -> Intrinsics:
        """The K, or else the seed."""
        found = self.calibration.intrinsics if self.calibration is not None else self.seed
        if found is None:
            raise InputError(f"there is no K: {self.why}")
        return found


def of_image(path: Path, registry: Place | Sequence[Place] | None) -> OneK:
    """K of an image, as :func:`calibrary.extract` judges it."""
    report = extract([path], registry=registry, dry_run=True)
    if not report.cameras:
        raise InputError(
            next((one.reason for one in report.rejected), "is no camera's image"), source=path.name
        )
    camera = report.cameras[0]
    found, grade = camera.calibration, camera.calibration.grade.value if camera.calibration else "no K"
    why = f"{camera.verdict.value}, {grade}" + (f": {camera.why}" if camera.why else "")
    use = camera.use.use if camera.use is not None and camera.verdict is Verdict.VALID else Use.NONE
    seed = camera.seed.intrinsics if found is None and camera.seed is not None else None
    return OneK(use=use, why=why, calibration=found, seed=seed)


def of_file(path: Path, reading: Reading) -> OneK:
    """K of a calibration file, if it was measured or derived and can be a camera's."""
    found = chosen(path, reading)
    doubt = admission(found)
    why = f"{found.grade.value} ({found.grade.meaning})" + (f": {doubt.message}" if doubt is not None else "")
    use = allowed(found, FLEET, is_valid=found.grade.is_metric and doubt is None).use
    return OneK(use=use, why=why, calibration=found)


def of_key(key: str, registry: Place | Sequence[Place] | None) -> OneK:
    """K of the entry that applies to a KEY, or of the catalogue."""
    found = resolve(key, registry=registry)
    if found.path is None:
        raise RegistryError(f"no entry answers {key!r}, and no file has this name")
    if found.calibration is None or found.allowed is None:
        raise RegistryError(f"the K of {found.path} may not be used: {found.use_reason}")
    return OneK(use=found.allowed.use, why=f"{found.use}: {found.use_reason}", calibration=found.calibration)
