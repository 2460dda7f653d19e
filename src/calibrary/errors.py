"""All errors that calibrary raises deliberately.

::

    CalibraryError
    ├── InputError (ValueError)          an input or argument is wrong: .source, .place
    │   ├── UsageError                   arguments that do not go together, or one that is missing
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

A message states what was found, what was expected and what to do; ``source`` and ``place`` state the location.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol


class ValidationReport(Protocol):
    """The part of :class:`calibrary.validation.Report` that a ValidationError needs."""

    @property
    def policy(self) -> str:
        """Name of the policy."""

    @property
    def verdict(self) -> str:
        """Verdict on the use of K."""

    @property
    def failures(self) -> Sequence[object]:
        """Findings that failed, worst first."""


class CalibraryError(Exception):
    """Base class of all errors that calibrary raises deliberately.

    >>> try:
    ...     calibrary.read("not-there.xml")
    ... except calibrary.CalibraryError as error:
    ...     print(error)
    not-there.xml: cannot be read: No such file or directory
    """

    @property
    def why(self) -> str:
        """What is wrong, without the source and the place."""
        return str(getattr(self, "message", self))


class InputError(CalibraryError, ValueError):
    """An input or an argument is wrong.

    Attributes:
        source: file or argument with the error, if known.
        place: location inside the source: a line, a tag or a key.
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


def first_of(names: Iterable[str], most: int = 3, separator: str = ", ") -> str:
    """Return the first ``most`` of some names for a message, and how many more there are."""
    every = list(names)
    more = f" and {len(every) - most} more" if len(every) > most else ""
    return separator.join(every[:most]) + more


def _rebuild(kind: type[InputError], message: str, source: str | None, place: str | None) -> InputError:
    """Unpickle an InputError with its keyword-only fields (workers send errors across processes)."""
    return kind(message, source=source, place=place)


class UsageError(InputError):
    """Arguments do not go together, or one that is needed is missing; nothing was read."""


class MissingTagError(InputError):
    """A required tag is missing."""


class MissingSizeError(MissingTagError):
    """Neither the calibration file nor the caller states the image size."""


class BadRationalError(InputError):
    """An EXIF rational is not a number, such as 0/0 or 5/0."""


class FrameError(InputError):
    """A calibration cannot be converted to the image's size without stretching."""


class ParseError(InputError):
    """A file is damaged, or is not in the expected format."""


class UnknownFormatError(InputError):
    """No reader recognises the file."""


class AmbiguousFormatError(InputError):
    """Two readers recognise the file equally well; the message names both."""


class UnsupportedModelError(InputError):
    """A camera model has no exact counterpart here; calibrary never approximates one silently."""


class ValidationError(CalibraryError):
    """A calibration violates a policy.

    Attributes:
        report: the calibrary.validation.Report, with the finding and the limit of every rule.
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
    """A KEY matches several entries; the message names them."""


class AmbiguousEntryError(RegistryError):
    """Several entries match a camera equally well; the message names them."""


class ConflictError(RegistryError):
    """The entry has changed since it was read."""


class CalibrationError(CalibraryError):
    """A calibration could not be computed from the given data."""


class MissingExtraError(CalibraryError, ImportError):
    """An optional library is not installed; the message contains the command that installs it."""
