"""Trajectories: motions of the ball with exact poses and derivatives at any time."""

from __future__ import annotations

from .drop import DropWeight
from .flight import FreeFlight
from .frontal import FrontalImpact
from .oblique import ObliqueImpact
from .spin import SpinInPlace
from .state import State, Trajectory
from .table import Table

#: The trajectories by their name in a preset.
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
