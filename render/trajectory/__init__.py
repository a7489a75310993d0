"""Trajectories: motions of the ball whose poses and derivatives are known exactly at any time."""

from __future__ import annotations

from .drop import DropWeight
from .flight import FreeFlight
from .frontal import FrontalImpact
from .oblique import ObliqueImpact
from .spin import SpinInPlace
from .state import State, Trajectory
from .table import Table

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
