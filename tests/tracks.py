"""Tracks with given increments."""

import numpy as np

import torchsphere as ts
from torchsphere.geometry.orientation import chain
from torchsphere.motion.findings import Findings
from torchsphere.sphere_map.decision import MadeMap, NoMap


def made_map(track: ts.Track) -> MadeMap:
    """The map that was made for a track."""
    assert isinstance(track.findings.map, MadeMap), track.findings.map
    return track.findings.map


def no_map(track: ts.Track) -> NoMap:
    """Why no map was made for a track."""
    assert isinstance(track.findings.map, NoMap), track.findings.map
    return track.findings.map


def made_track(increment: np.ndarray, sd: np.ndarray, circle: ts.Circle) -> ts.Track:
    n = len(increment) + 1
    position = np.array([circle.x, circle.y]) + np.concatenate((np.zeros((1, 2)), increment[:, :2].cumsum(0)))
    rotation = np.concatenate((np.zeros((1, 3)), increment[:, 2:]))
    return ts.Track(
        position=position,
        increment=increment,
        covariance=np.tile(np.diag(sd**2), (n - 1, 1, 1)),
        orientation=chain(rotation, np.ones(n, dtype=bool)),
        zncc=np.ones(n),
        iterations=np.ones(n, dtype=np.int64),
        status=np.full(n, "ok"),
        radius=np.full(n, circle.radius),
        sd_growth=np.zeros(n - 1),
        sd_steady=np.zeros(5),
        circle=circle,
        settings={},
        findings=Findings(map=MadeMap()),
    )


def falling_track() -> ts.Track:
    """Nine frames: 2 px per frame to the right, downwards faster by 0.1 px in each frame, clockwise rotation."""
    k = np.arange(8)
    zero = np.zeros(8)
    increment = np.stack((zero + 2.0, 0.1 * k, zero, zero, zero + 0.01), 1)
    return made_track(increment, np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0))
