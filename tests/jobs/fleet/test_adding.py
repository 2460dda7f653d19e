from __future__ import annotations

import pytest

from calibrary.jobs.fleet.adding import SERIAL_IN_NAME


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("SN12345678.conf", "SN….conf"),
        ("sn_0V2KG123.yml", "sn….yml"),
        ("serial-00123456.cal", "serial….cal"),
        ("Snow2024.xml", "Snow2024.xml"),
        ("calib_2024-05-17.xml", "calib_2024-05-17.xml"),
    ],
)
def test_a_serial_number_in_a_files_name_stays_out_of_the_registry(name: str, kept: str) -> None:
    assert SERIAL_IN_NAME.sub(r"\1…", name) == kept
