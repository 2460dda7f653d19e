"""Additional files of a public registry: its licence and its review rules.

Its entries come from the catalogue of known cameras and are proposals: they contain what makers and public sources
state about a model. They were not measured on the unit that will use them.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from typing import Final

from calibrary.errors import RegistryError

__all__ = ["CONTRIBUTING", "LICENSE", "NOTICE", "starter_files"]

LICENSE: Final = "LICENSE"
NOTICE: Final = "NOTICE"
CONTRIBUTING: Final = "CONTRIBUTING.md"

README: Final = """\
# Public camera calibrations

Starting values of K for cameras of drones, phones and survey payloads, one YAML file per camera, kept in git and
reviewed entry by entry. The first entries are derived from the catalogue of known cameras that calibrary ships: image
size, focal length and pixel pitch as makers and public images state them. Each entry names its sources.

- **A value for a model is not a calibration of your unit.** Entries are of grade `derived`: square pixels, the
  principal point in the middle, the distortion unknown (`null`). A reconstruction can start from them and has to
  refine them.
- **No entry states an uncertainty that was not measured.** Those from the catalogue state none. What was measured on
  one unit is in `x-evidence` of its entry, and is not to be taken for the uncertainty of another unit.
- **What is in `proposals/` is not used** by any program until two people have looked at it: who proposed it and
  who approves it. That is so for every entry of the first commit.

Use it:

    git clone URL camera-calibrations
    calibrary registry resolve DJI_0001.JPG --registry camera-calibrations
    calibrary extract flight/ --registry my-fleet --registry camera-calibrations

Licence of the data: Apache-2.0 ([LICENSE](LICENSE), [NOTICE](NOTICE)). How to contribute, and what a review looks at:
[CONTRIBUTING.md](CONTRIBUTING.md).

## Where what is

One YAML file per camera, in `cameras/<make>/<model>/<variant>.yaml`; what is proposed and not approved yet is at the
same path in `proposals/`. The history of a camera is the git history of its file. `registry.yaml` is the configuration:
the schema versions, the limits that entries are checked against, and who may approve.

"""

RULES: Final = """\
# Contributing

## What belongs here

K of a camera *model*, with where it is from: computed from what the maker states, or measured on one unit and stated
as an estimate for its model. Not: lens profiles, guesses, values without a source that others can check, focal lengths
out of a 35 mm equivalent.

## From your own registry

    calibrary registry contribute KEY camera-calibrations    (the clone of this registry)
    cd camera-calibrations
    calibrary registry check --worktree
    git switch -c MODEL && git add proposals && git commit && git push

`contribute` writes the entry to `proposals/`, without serial number, label, notes, and the names of files and people.
One unit's K becomes an estimate for its model: grade `derived`, tolerance at least 3 %, and what was measured (rms,
views, uncertainty) in `x-evidence`. Look at the file before you send it.

By contributing you agree that the data is given under the licence of this repository, Apache-2.0 (section 5 of it).

## What a review looks at

1. `registry check` passes. It runs on every push and pull request (.github/workflows/registry-check.yml), and judges by
   the `registry.yaml` of the branch that the change goes to.
2. Make and model are as EXIF writes them; image size, lens and focal length are those that K holds for.
3. The source can be looked up: a data sheet, a public image with its tags, or the SHA-256 of a calibration file with
   date and tool. The reviewer looks it up.
4. fx agrees with focal length over pixel pitch, and with the other entries of the model. Where units differ by more
   than 3 %, there is no K of the model: the entry is refused.
5. Nothing private: no serial number in clear, no position, no person, no path of a file.
6. No uncertainty that was not measured.

Then a person other than the author approves: `calibrary registry approve KEY` shows the entry and what it changes, and
commits the approval (`approvals: {not_author: true}` in registry.yaml). A change of an approved entry goes the same
way; the former one stays in use until then. An entry that is found wrong is retired with a reason, not deleted.
"""


def starter_files(readme: bytes) -> dict[str, bytes]:
    """Return the files of a public registry by path.

    Args:
        readme: README of any registry; its section about entries is copied.

    Raises:
        RegistryError: the text of the licence is not installed with this package.
    """
    _, heading, rest = readme.decode().partition("## An entry\n")
    return {
        "README.md": (README + heading + rest).encode(),
        CONTRIBUTING: RULES.encode(),
        LICENSE: _installed(LICENSE),
        NOTICE: (
            b"Camera calibrations\n"
            b"Licensed under the Apache License, Version 2.0; see LICENSE.\n\n"
            b"The entries whose provenance is of kind 'catalogue' are derived from the catalogue of calibrary\n"
            b"(Apache-2.0). They state facts of cameras, each with its source.\n"
        ),
    }


def _installed(name: str) -> bytes:
    try:
        text = distribution("calibrary").read_text(f"licenses/{name}")
    except PackageNotFoundError:
        text = None
    if text is None:
        raise RegistryError(
            f"calibrary is installed without its {name}, which an open registry needs; reinstall it"
        )
    return text.encode()
