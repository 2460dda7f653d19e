"""Every error calibrary raises on purpose.

::

    CalibraryError
    ├── InputError (ValueError)          an input or argument is wrong: .source, .place
    │   ├── MissingTagError              a tag that is needed is not there
    │   │   └── MissingSizeError         a calibration file does not state its image size
    │   ├── BadRationalError             an EXIF rational that is not a number (zero denominator)
    │   ├── FrameError                   a calibration's frame cannot be brought to this image's size
    │   ├── ParseError                   a file is not what it claims to be
    │   ├── UnknownFormatError           no reader claims the file
    │   ├── AmbiguousFormatError         two readers claim it equally
    │   └── UnsupportedModelError        a model with no exact counterpart here
    ├── ValidationError                  a policy was broken: .report
    ├── RegistryError
    │   ├── UnknownCameraError (KeyError)
    │   ├── AmbiguousCameraError         a KEY is of several entries; they are named
    │   ├── AmbiguousEntryError          several entries fit a camera equally well; they are named
    │   └── ConflictError                the entry has changed since it was read
    ├── CalibrationError                 a calibration could not be computed
    └── MissingExtraError (ImportError)  a library that the job needs is not installed

A message states what was found, what was expected and what to do; ``source`` and ``place`` say where.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

__all__ = [
    "AmbiguousCameraError",
    "AmbiguousEntryError",
    "AmbiguousFormatError",
    "BadRationalError",
    "CalibraryError",
    "CalibrationError",
    "ConflictError",
    "FrameError",
    "InputError",
    "MissingExtraError",
    "MissingSizeError",
    "MissingTagError",
    "ParseError",
    "RegistryError",
    "UnknownCameraError",
    "UnknownFormatError",
    "UnsupportedModelError",
    "ValidationError",
]


class ValidationReport(Protocol):
    """What is known here of the report of a ValidationError, a :class:`calibrary.validation.Report`."""

    @property
    def policy(self) -> str:
        """Name of the policy."""

    @property
    def verdict(self) -> str:
        """Whether K may be used."""

    @property
    def failures(self) -> Sequence[object]:
        """The findings that failed, worst first."""


class CalibraryError(Exception):
    """The root of all errors raised on purpose."""


class InputError(CalibraryError, ValueError):
    """An input or an argument is wrong.

    Attributes:
        source: the file (or argument) it came from, if known.
        place: where in it: a line, a tag, a key.
    """

    def __init__(self, message: str, *, source: str | None = None, place: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.source = source
        self.place = place

    def __str__(self) -> str:
        return ": ".join(part for part in (self.source, self.place, self.message) if part)

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.message, self.source, self.place)


def _rebuild(kind: type[InputError], message: str, source: str | None, place: str | None) -> InputError:
    """Unpickle an InputError with its keyword-only fields (workers send errors across processes)."""
    return kind(message, source=source, place=place)


class MissingTagError(InputError):
    """A tag that is needed is not there."""


class MissingSizeError(MissingTagError):
    """A calibration file does not state the size of its images, and the caller does not either."""


class BadRationalError(InputError):
    """An EXIF rational that is not a number, such as 0/0 or 5/0."""


class FrameError(InputError):
    """A calibration's reference frame cannot be brought to the image's size without stretching."""


class ParseError(InputError):
    """A file is broken, or not what it claims to be."""


class UnknownFormatError(InputError):
    """No reader claims the file."""


class AmbiguousFormatError(InputError):
    """Two readers claim the file equally; the message names both."""


class UnsupportedModelError(InputError):
    """A camera model without an exact counterpart here; nothing is approximated silently."""


class ValidationError(CalibraryError):
    """A calibration broke a policy.

    Attributes:
        report: the calibrary.validation.Report: the finding of every rule, with its limit.
    """

    def __init__(self, message: str, report: ValidationReport) -> None:
        super().__init__(message)
        self.report = report


class RegistryError(CalibraryError):
    """The registry cannot be read or written."""


class UnknownCameraError(RegistryError, KeyError):
    """The registry contains no such camera."""

    def __str__(self) -> str:
        return Exception.__str__(self)


class AmbiguousCameraError(RegistryError):
    """A KEY fits several entries; the message names them."""


class AmbiguousEntryError(RegistryError):
    """Several entries fit a camera equally well; the message names them."""


class ConflictError(RegistryError):
    """The entry has changed since it was read."""


class CalibrationError(CalibraryError):
    """A calibration could not be computed from what was given."""


class MissingExtraError(CalibraryError, ImportError):
    """A library that only some jobs need is not installed; the message names the command that installs it."""
