"""A simulated drive: the log as a file, and the true poses."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(sys.executable).parent / "ipslam"


@pytest.fixture(scope="session")
def drive(tmp_path_factory):
    """Folder of a minute's drive through the simulated building: the log and truth.tum."""
    folder = tmp_path_factory.mktemp("drive")
    subprocess.run([PROGRAM, "simulate", "--out", folder, "--duration", "60"], check=True, capture_output=True)
    (folder / "building-seed1.log").rename(folder / "drive.log")
    (folder / "building-seed1.truth.tum").rename(folder / "truth.tum")
    return folder


@pytest.fixture(scope="session")
def log_path(drive):
    """The log of the drive."""
    return drive / "drive.log"
