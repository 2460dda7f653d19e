"""What the formats' own programs read in calibrary's files: prints a JSON object, for benchmarks/readers.py.

    PYTHON benchmarks/peer_readers.py FOLDER

Whatever of kapture, pyopf and mrcal this Python has reads the files of the folder: kapture and pyopf give the camera's
numbers, mrcal the pixels of some rays.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np


def main() -> None:
    """Read every file by its program."""
    folder = Path(sys.argv[1])
    found: dict[str, Any] = {}
    with contextlib.suppress(ImportError):
        from kapture.io.csv import sensors_from_file  # type: ignore[import-not-found]  # noqa: PLC0415  any may be missing

        for path in sorted(folder.glob("kapture-*.txt")):
            [sensor] = sensors_from_file(str(path)).values()
            found[path.name] = [sensor.camera_type.name, *map(float, sensor.camera_params)]
    with contextlib.suppress(ImportError):
        from pyopf.io import load  # type: ignore[import-not-found]  # noqa: PLC0415  as above

        for path in sorted(folder.glob("opf-*.json")):
            [sensor] = load(str(path)).sensors
            own = sensor.internals
            numbers = [
                own.focal_length_px,
                *own.principal_point_px,
                *own.radial_distortion,
                *own.tangential_distortion,
            ]
            found[path.name] = [own.type, *map(float, numbers)]
    with contextlib.suppress(ImportError):
        import mrcal  # type: ignore[import-not-found]  # noqa: PLC0415  as above

        rays = np.array(json.loads((folder / "rays.json").read_text()))
        for path in sorted(folder.glob("mrcal-*.cameramodel")):
            found[path.name] = mrcal.project(rays, *mrcal.cameramodel(str(path)).intrinsics()).tolist()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
