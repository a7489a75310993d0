"""What was found out about a recording, in Python and in ``summary.json``."""

import json
import re
from dataclasses import fields
from pathlib import Path

import pytest

import torchsphere
from torchsphere.motion.findings import CameraShake, Findings, Place
from torchsphere.results.writer import plain
from torchsphere.sphere_map.decision import MadeMap, NoMap, Why

ALL = Findings(
    map=MadeMap(9, 70, 0.4, 0.2, 0.3, 0.1, 1.1, 1.2, 0.01, 0.05, 0.001, -0.08, 1e-4, 1.03, 2e-4, (319.5, 239.5)),
    sd_radius_over_distance=0.001,
    place=Place(True, (1.5, -0.5), 40.0, 12, True, 40.5, (0.01, 0.02, 0.03)),
    grows=True,
    interlaced=True,
    mosaic=("RGGB", "BGGR"),
    noise_memory=0.2,
    coded=True,
    hidden=True,
    repeated_frames=(5, 6),
    untried_frames=3,
    leaked=0.01,
    axis_ratio=1.5,
    outline_scatter=0.02,
    camera_assumed=True,
    texture_fineness=0.3,
    uneven_light=0.1,
    stretch=1.1,
    missing_frames=((4, 1), (9, 2)),
    pace_changes=((20, 2.0), (31, 0.5)),
    shake=CameraShake(0.3, 7),
)
OTHERS = Findings(
    map=NoMap(Why.MISFIT, "the residual is too large"),
    place=Place(False, (0.0, 0.0), 40.0, None, False),
)


@pytest.mark.parametrize("found", [ALL, OTHERS, Findings()], ids=["all", "no map, no limbs", "nothing"])
def test_findings_come_back_from_a_summary(found: Findings) -> None:
    read = Findings.read(json.loads(json.dumps(plain(found.items()))))
    assert repr(read) == repr(found)  # two values that are not known are NaN, which is not equal to itself


def test_no_field_of_the_first_example_is_the_default() -> None:
    assert [one.name for one in fields(ALL) if getattr(ALL, one.name) == one.default] == []


def test_a_summary_of_an_earlier_version_lacks_some() -> None:
    about = {"used": False, "reason": "not needed: it was not asked for"}
    found = Findings.read({"sphere_map": about, "model": "rigid"})
    assert isinstance(found.map, NoMap)
    assert (found.map.why, found.map.is_needed) == (Why.UNKNOWN, False)
    assert (found.coded, found.place) == (False, None)


def test_no_module_reads_a_finding_by_a_string() -> None:
    names = "|".join(Findings().items())
    key = re.compile(rf"""settings(\.get\(|\[)["']({names})["']""")
    package = Path(torchsphere.__file__).parent
    assert [path.name for path in package.rglob("*.py") if key.search(path.read_text(encoding="utf-8"))] == []
