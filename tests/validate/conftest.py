"""The small job, its plate, and the plate as a mask file."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_job import write_job

from maskfab.export.gds import write_gdsii
from maskfab.geometry.region import plate_layout
from maskfab.layout.job import Job, load
from maskfab.model import Plate


@pytest.fixture(scope="module")
def job(tmp_path_factory) -> Job:
    return load(write_job(tmp_path_factory.mktemp("job")))


@pytest.fixture(scope="module")
def plate(job) -> Plate:
    return job.plate()


@pytest.fixture(scope="module")
def gds(plate, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("gds") / "plate.gds"
    write_gdsii(plate_layout(plate), path)
    return path
