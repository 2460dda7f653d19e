"""Every error calibrary raises on purpose.

::

    CalibraryError
    ├── InputError (ValueError)          something that was read or given is wrong: .source, .place
    │   ├── MissingTagError              a tag that is needed is not there
    │   ├── BadRationalError             an EXIF rational that is no number (zero denominator)
    │   ├── FrameError                   a calibration's frame cannot be brought to this image's size
    │   ├── ParseError                   a file is not what it claims to be
    │   ├── UnknownFormatError           no reader claims the file
    │   ├── AmbiguousFormatError         two readers claim it equally
    │   └── UnsupportedModelError        a model with no exact counterpart here
    ├── ValidationError                  a policy was broken: .report
    ├── RegistryError
    │   ├── UnknownCameraError (KeyError)
    │   └── ConflictError                somebody changed the entry since
    └── CalibrationError                 a calibration could not be computed

A message says what was found, what was expected and what to do; ``source`` and ``place`` say where.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.validation import Report

__all__ = [
    "AmbiguousFormatError",
    "BadRationalError",
    "CalibraryError",
    "CalibrationError",
    "ConflictError",
    "FrameError",
    "InputError",
    "MissingTagError",
    "ParseError",
    "RegistryError",
    "UnknownCameraError",
    "UnknownFormatError",
    "UnsupportedModelError",
    "ValidationError",
]


class CalibraryError(Exception):
    """The root of all errors raised on purpose."""


class InputError(CalibraryError, ValueError):
    """Something that was read or given is wrong.

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


class BadRationalError(InputError):
    """An EXIF rational that is no number, such as 0/0 or 5/0."""


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
        report: every rule measured, with the limit it was held against.
    """

    def __init__(self, message: str, report: Report) -> None:
        super().__init__(message)
        self.report = report


class RegistryError(CalibraryError):
    """The registry cannot be read or written."""


class UnknownCameraError(RegistryError, KeyError):
    """The registry holds no such camera."""

    def __str__(self) -> str:
        return Exception.__str__(self)


class ConflictError(RegistryError):
    """Somebody changed the entry since it was read."""


class CalibrationError(CalibraryError):
    """A calibration could not be computed from what was given."""
