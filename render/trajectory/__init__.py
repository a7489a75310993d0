"""Trajectories: motions of the ball whose poses and derivatives are known exactly at any time."""

from __future__ import annotations

from render.trajectory.drop import DropWeight
from render.trajectory.flight import FreeFlight
from render.trajectory.frontal import FrontalImpact
from render.trajectory.oblique import ObliqueImpact
from render.trajectory.spin import SpinInPlace
from render.trajectory.state import State, Trajectory
from render.trajectory.table import Table

#: The trajectories by the name that a preset gives them.
KINDS: dict[str, type[Trajectory]] = {
    "free-flight": FreeFlight,
    "frontal-impact": FrontalImpact,
    "oblique-impact": ObliqueImpact,
    "spin-in-place": SpinInPlace,
    "drop-weight": DropWeight,
    "table": Table,
}

__all__ = [
    "KINDS",
    "DropWeight",
    "FreeFlight",
    "FrontalImpact",
    "ObliqueImpact",
    "SpinInPlace",
    "State",
    "Table",
    "Trajectory",
]
