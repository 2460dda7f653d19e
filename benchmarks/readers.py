"""Do the formats' own programs read calibrary's files as calibrary means them?

    python -m benchmarks.readers --python PY [--python PY …] [--ros-convert FILE] [--nerfstudio FOLDER]

Writes cameras in the formats of kapture, OPF and mrcal, and lets these programs read them, in whatever Python has them
(``pip install kapture pyopf``, Debian's ``python3-mrcal``). The tool of ROS's ``camera_calibration_parsers`` (Debian's
``camera-calibration-parsers-tools``) reads YAML and writes it again, which calibrary reads. nerfstudio needs a
gigabyte of PyTorch, so the functions that undistort its pixels are taken from its source (a checkout's folder) and run
on numpy's arrays, on the numbers of the file that its data parser takes. A line for each format: the number of files,
and the largest difference.
"""

from __future__ import annotations
import __future__

import argparse
import ast
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational
from calibrary.records import replace
from tests.parsers.cameras import BROWN, camera

PEER = Path(__file__).with_name("peer_readers.py")
WIDE = Rational(k1=-0.12, k2=0.02, p1=2e-4, p2=-1e-4, k3=0.003, k4=0.01, k5=-0.004, k6=0.002)
LENSES: dict[str, tuple[Distortion, ...]] = {
    "kapture": (NoDistortion(), BROWN, WIDE, KannalaBrandt(k1=0.01, k2=-0.002, k3=0.001, k4=-0.0003)),
    "opf": (BROWN,),
    "mrcal": (NoDistortion(), BROWN, WIDE),
    "ros": (BROWN, WIDE),
    "nerfstudio": (NoDistortion(), BROWN, KannalaBrandt(k1=0.01, k2=-0.002, k3=0.001, k4=-0.0003)),
}
FORMATS = {
    "kapture": ("kapture", ".txt"),
    "opf": ("opf_calibrated_cameras", ".json"),
    "mrcal": ("mrcal", ".cameramodel"),
    "ros": ("ros_camera_info", ".yaml"),
    "nerfstudio": ("transforms_json", ".json"),
}


def main() -> int:
    """Write, let the programs read, and compare."""
    command = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    command.add_argument(
        "--python", action="append", default=[], help="a Python with kapture, pyopf or mrcal"
    )
    command.add_argument(
        "--ros-convert", type=Path, default=Path("/usr/lib/camera_calibration_parsers/convert")
    )
    command.add_argument("--nerfstudio", type=Path, help="a checkout of nerfstudio")
    given = command.parse_args()
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 13), np.linspace(-0.4, 0.4, 9))
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    worst: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "rays.json").write_text(json.dumps(rays.tolist()))
        made = {file: item for peer in FORMATS for file, item in _written(folder, peer).items()}
        for python in given.python:
            done = subprocess.run([python, str(PEER), name], capture_output=True, text=True, check=True)
            for file, seen in json.loads(done.stdout).items():
                worst.setdefault(file.partition("-")[0], []).append(_apart(file, seen, made[file], rays))
        if given.ros_convert.exists():
            for file, item in made.items():
                if file.startswith("ros-"):
                    worst.setdefault("ros", []).append(_by_ros(given.ros_convert, folder / file, item, rays))
        if given.nerfstudio is not None:
            worst["nerfstudio"] = _by_nerfstudio(given.nerfstudio, folder, made, rays)
    for peer, found in worst.items():
        print(f"{peer}: {len(found)} files, largest difference {max(found):.3g}")
    if not worst:
        print("no program was there to read; see --help")
    return int(not worst or max(map(max, worst.values())) > 1e-6)


def _written(folder: Path, peer: str) -> dict[str, Calibration]:
    form, suffix = FORMATS[peer]
    made: dict[str, Calibration] = {}
    for number, lens in enumerate(LENSES[peer]):
        item = camera(lens)
        if peer == "opf":
            item = replace(item, intrinsics=replace(item.intrinsics, fy=item.intrinsics.fx))
        file = f"{peer}-{number}{suffix}"
        parsers.write([item], folder / file, form)
        made[file] = item
    return made


def _apart(file: str, seen: list[Any], item: Calibration, rays: Any) -> float:
    """How far a program is from what was meant: in px for mrcal, else the largest difference of two numbers."""
    if file.startswith("mrcal"):
        return float(np.abs(np.array(seen) + 0.5 - item.project(rays)).max())
    kind, *numbers = seen
    K, lens = item.intrinsics, item.distortion
    if file.startswith("opf"):
        assert isinstance(lens, BrownConrady)
        expected = [K.fx, K.cx, K.cy, lens.k1, lens.k2, lens.k3, lens.p1, lens.p2]
        return float(np.abs(np.array(numbers) - expected).max()) if kind == "perspective" else float("inf")
    held = item.to_colmap()
    if kind != held.model:
        return float("inf")
    width, height, *parameters = numbers
    return float(
        np.abs(
            np.array([width - held.width, height - held.height, *np.subtract(parameters, held.params)])
        ).max()
    )


def _by_ros(convert: Path, path: Path, item: Calibration, rays: Any) -> float:
    """Largest difference in px after ROS's own tool read the YAML and wrote it again."""
    again = path.with_name(f"again-{path.name}")
    subprocess.run([str(convert), str(path), str(again)], check=True, capture_output=True)
    [read] = parsers.read(again, format="ros_camera_info")
    return float(np.abs(read.project(rays) - item.project(rays)).max())


def _of_nerfstudio(checkout: Path) -> Callable[..., Any]:
    """Nerfstudio's radial_and_tangential_undistort, on arrays."""
    source = ast.parse((checkout / "nerfstudio/cameras/camera_utils.py").read_text())
    names = {"_compute_residual_and_jacobian", "radial_and_tangential_undistort"}
    functions = [node for node in source.body if isinstance(node, ast.FunctionDef) and node.name in names]
    for node in functions:
        node.decorator_list = []
    source.body = [*functions]
    torch = SimpleNamespace(
        where=np.where,
        abs=np.abs,
        zeros_like=np.zeros_like,
        stack=lambda parts, dim: np.stack(parts, axis=dim),
    )
    space: dict[str, Any] = {"torch": torch}
    exec(compile(source, str(checkout), "exec", flags=__future__.annotations.compiler_flag), space)  # noqa: S102  its code is the peer
    undistort: Callable[..., Any] = space["radial_and_tangential_undistort"]
    return undistort


def _by_nerfstudio(checkout: Path, folder: Path, made: dict[str, Calibration], rays: Any) -> list[float]:
    """Largest difference in px of the pixels' rays, as its cameras make them of what its data parser takes."""
    undistort = _of_nerfstudio(checkout)
    found = []
    for file in sorted(folder.glob("nerfstudio-*")):
        item, meta = made[file.name], json.loads(file.read_text())
        at = (item.project(rays) - [meta["cx"], meta["cy"]]) / [meta["fl_x"], meta["fl_y"]]
        seen = undistort(at, np.array([meta.get(key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2")]))
        if meta["camera_model"] == "OPENCV_FISHEYE":
            theta = np.hypot(*seen.T)[:, None]
            seen = seen * np.tan(theta) / np.where(theta == 0, 1.0, theta)
        found.append(float(np.abs(seen - rays[:, :2]).max() * item.intrinsics.fx))
    return found


if __name__ == "__main__":
    sys.exit(main())
