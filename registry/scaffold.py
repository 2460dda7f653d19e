"""The files of a new registry: its configuration, a page for people who know git, and a check for each push."""

from __future__ import annotations

from datetime import date
from importlib.metadata import PackageNotFoundError, version
from typing import Final

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import BrownConrady
from calibrary.registry.charter import CHARTER, charter_yaml
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import entry_yaml

__all__ = ["DRIVER", "DRIVER_COMMAND", "WORKFLOW", "example_entry", "scaffold"]

ATTRIBUTES: Final = b"*.yaml text eol=lf\n*.md text eol=lf\n*.yml text eol=lf\n*.json text eol=lf\n"
"""``.gitattributes``: the bytes of an entry are the same in every checkout, or its digest would not hold."""

DRIVER: Final = "diff.calibrary.textconv"
DRIVER_COMMAND: Final = 'f() { calibrary registry show --textconv "$1" 2>/dev/null || cat "$1"; }; f'
"""What git runs to show an entry; ``.gitattributes`` names the driver, each user's configuration the command. Where
calibrary is not at hand, the file itself is shown: git diff would otherwise show nothing at all."""

WORKFLOW: Final = ".github/workflows/registry-check.yml"

README: Final = """\
# Camera calibrations

One YAML file a camera, in `cameras/<make>/<model>/<variant>.yaml`; a unit with a calibration of its own has a
folder `sn-<hash>/` between the two, and its serial number itself stands nowhere. The history of a camera is the
history of its file, in git and nowhere else. `registry.yaml` says by which rules this is kept.

## An entry

```yaml
{example}```

- `status`: `draft` is proposed, `approved` is used, `held` is used and pinned by a person, `retired` is used no more.
- `intrinsics` is K. `distortion` stands apart and is no part of it: `null` is unknown, `model: none` is known to
  be none.
- `grade`, best first: `calibrated` (measured on this unit), `adjusted` (from a bundle adjustment), `design` (the
  maker's nominal), `derived` (focal length over pixel pitch).
- `digest` seals the numbers. To change one by hand, take that line out and run `calibrary registry add FILE`.

## Reading it with git alone

    git log -p --follow cameras/dji/fc6310r/5472x3648.yaml     what became of a camera, and why
    git log --grep '^Camera: dji/fc6310r'                      the commits that name it
    git diff main...proposal                                   what a branch proposes
    git show v2026.1:cameras/dji/fc6310r/5472x3648.yaml        as it was at a tag

Each commit says in trailers which cameras it is of (`Camera:`), from which files (`Source-File:`,
`Source-Sha256:`), of which grade, for which firmware, and why (`Reason:`). With calibrary installed git shows
entries by their fields, with one line a number:

    git config {driver} '{command}'

## Reviewing a change

1. Is the camera the right one: make, model, sub-camera, lens, image size?
2. Do fx and fy move by more than their uncertainty? 0.05 % of the focal length is a drift, and some per cent are
   another lens, another frame or a wrong sensor.
3. Are cx and cy near the middle, within 5 % of the sides?
4. Does `provenance` name a file with its sha256 and say when it was made, and does the `Reason:` tell why?
5. Does `calibrary registry check` pass? It runs on every push ({workflow}).

## With calibrary

    calibrary registry list                       what there is
    calibrary registry add camera.xml             propose; shows the difference, and asks
    calibrary registry approve KEY                put it to use
    calibrary registry log KEY                    what became of it
    calibrary diff KEY@2026-05-01 KEY             whether it moved by more than noise
"""

CHECK: Final = """\
# Holds every entry against the schema, its digest, its path and the policy of registry.yaml.
name: registry check
on: [push, pull_request]
permissions:
  contents: read
jobs:
  check:
    runs-on: ubuntu-latest
    steps:
      - uses: actions/checkout@v4
        with:
          fetch-depth: 0
          persist-credentials: false
      - uses: actions/setup-python@v5
        with:
          python-version: "3.13"
      - run: pip install "calibrary{requirement}"
      - run: calibrary registry check --registry .
"""


def scaffold() -> dict[str, bytes]:
    """The files of a new registry by their paths."""
    readme = README.format(
        example=entry_yaml(example_entry()).decode(),
        driver=DRIVER,
        command=DRIVER_COMMAND,
        workflow=WORKFLOW,
    )
    return {
        CHARTER: charter_yaml(),
        "README.md": readme.encode(),
        ".gitattributes": ATTRIBUTES + b"/cameras/**/*.yaml diff=calibrary\n",
        WORKFLOW: CHECK.format(requirement=_requirement()).encode(),
    }


def example_entry() -> Entry:
    """An entry of no real camera."""
    size = (4000, 3000)
    return Entry.of(
        Calibration(
            camera=CameraKey(make="Example", model="Camera One", focal_mm=8.8, image_size=size),
            intrinsics=Intrinsics(fx=2931.4, fy=2930.85, cx=2004.25, cy=1496.1, image_size=size),
            distortion=BrownConrady(k1=-0.021, k2=0.0135, p1=0.0002, p2=-0.0001, k3=-0.004),
            grade=Grade.CALIBRATED,
            quality=Quality(rms_px=0.31, views=42, std={"fx": 0.41, "fy": 0.4, "cx": 0.29, "cy": 0.33}),
            provenance=Provenance(
                kind="calibration-file",
                source="camera-one.xml",
                sha256="0" * 64,
                tool="board calibration 1.0",
                date=date(2026, 1, 31).isoformat(),
                operator="A. Keeper",
            ),
        )
    )


def _requirement() -> str:
    """At least the version that began this registry, so that its check reads what it writes."""
    try:
        return f">={version('calibrary')}"
    except PackageNotFoundError:
        return ""
