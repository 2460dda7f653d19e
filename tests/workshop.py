"""A folder with a file for every example of the door: what an engineer would have at hand."""

from __future__ import annotations

from pathlib import Path

from calibrary import Calibration, CameraKey, Grade, Intrinsics, Provenance, parsers
from calibrary.arguments import Terms
from calibrary.distortion import BrownConrady, InverseBrown
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.init import init
from calibrary.registry.proposals import propose, save
from calibrary.registry.registry import Registry
from tests.calib.rigs import write_rig_corners
from tests.imagery import ExifTags, Namespace, XmpDescription, XmpPacket, attributes, write_jpeg
from tests.jobs.calibrate.boards import frames
from tests.sfm.flights import Plan, fly
from tests.sfm.reconstructions import write_colmap

SIZE = (5472, 3648)
DJI = Namespace("drone-dji", "http://www.dji.com/drone-dji/1.0/")
DEWARP = "2019-03-05;3659.5,3655.0,-4.25,22.5,-0.267,0.111,0.0008,-0.0001,-0.033"
PHANTOM = ExifTags(make="DJI", model="FC6310R", focal_mm=(88, 10), focal_35mm=24)

CAMERA = Calibration(
    camera=CameraKey(make="DJI", model="FC6310R", image_size=SIZE),
    intrinsics=Intrinsics(fx=3659.5, fy=3655.0, cx=2731.75, cy=1846.5, image_size=SIZE),
    distortion=BrownConrady(k1=-0.267, k2=0.111, p1=0.0008, p2=-0.0001, k3=-0.033),
    grade=Grade.CALIBRATED,
    provenance=Provenance(kind="test"),
)


def survey(folder: Path) -> None:
    """Two images of a camera that writes its own calibration."""
    dewarp = XmpPacket(descriptions=(XmpDescription(items=attributes(DJI, DewarpData=DEWARP)),))
    for number in (1, 2):
        write_jpeg(folder / f"DJI_000{number}.JPG", SIZE, exif=PHANTOM, xmp=dewarp)


def furnish(folder: Path) -> None:
    """Everything that the examples read."""
    survey(folder / "survey")
    parsers.write([CAMERA], folder / "camera.xml", "agisoft_xml")
    pair = [replace(CAMERA, camera=replace(CAMERA.camera, sub_camera=side)) for side in ("left", "right")]
    parsers.write(pair, folder / "stereo.yml", "opencv_storage")
    frames(folder / "frames", 10)
    write_rig_corners(folder / "rig")
    plan = Plan(relief=0.05, heights=(1.0, 1.4), cross=True, rows=2, columns=4, points=250, outliers=0.0)
    write_colmap(folder / "sparse", *fly(plan, 3))
    registry = Registry.open(init(folder / "fleet").place)
    save(registry, propose(registry.snapshot(), [Entry(calibration=CAMERA)], Terms(approve=True)))
    inverse = InverseBrown(k1=-0.02, k2=0.01, k3=0.0, p1=0.0005, p2=0.0)
    one_focal = replace(CAMERA.intrinsics, fy=CAMERA.intrinsics.fx)
    adjusted = replace(CAMERA, intrinsics=one_focal, distortion=inverse, grade=Grade.ADJUSTED)
    parsers.write([adjusted], folder / "AutoCal.xml", "micmac_xml")
