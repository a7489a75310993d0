"""Tables of a track and of a motion as data frames of pandas and data sets of xarray, with their units."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.motion.track import Track
from torchsphere.recording.refusal import LibraryMissingError
from torchsphere.results.columns import Columns, covariances, motion_columns, track_columns, unit_of
from torchsphere.results.exports import COVARIANCE_UNIT


def columns_of(subject: Track | Kinematics) -> Columns:
    """The columns of ``track.csv`` or of ``kinematics.csv``."""
    if isinstance(subject, Track):
        return track_columns(subject, subject.calibration.frame_rate, subject.first_frame)
    return motion_columns(subject, int(subject.frame[0]))


def to_pandas(subject: Track | Kinematics) -> Any:
    """A `pandas.DataFrame` with a row per frame; raises LibraryMissingError without pandas."""
    try:
        import pandas
    except ImportError as error:
        raise _missing("to_pandas", "pandas") from error
    columns = columns_of(subject)
    frame = pandas.DataFrame(columns)
    frame.attrs["units"] = {name: unit_of(name) for name in columns}
    return frame


def to_xarray(subject: Track | Kinematics) -> Any:
    """An `xarray.Dataset` over the numbers of the frames; raises LibraryMissingError without xarray."""
    try:
        import xarray
    except ImportError as error:
        raise _missing("to_xarray", "xarray") from error
    columns = columns_of(subject)
    frame, time = columns.pop("frame"), columns.pop("time_s")
    variables: dict[str, Any] = {name: ("frame", values, _attributes(name)) for name, values in columns.items()}
    coordinates: dict[str, Any] = {"frame": frame, "time_s": ("frame", time, {"units": "s"})}
    if isinstance(subject, Track):
        axes = ("frame", "component", "other_component")
        variables["covariance"] = (axes, covariances(subject), {"units": COVARIANCE_UNIT})
        coordinates |= dict.fromkeys(axes[1:], np.array(INCREMENTS))
    return xarray.Dataset(variables, coordinates)


def _attributes(column: str) -> dict[str, str]:
    """The unit in the attribute in which xarray expects it."""
    unit = unit_of(column)
    return {"units": unit} if unit else {}


def _missing(method: str, library: str) -> LibraryMissingError:
    return LibraryMissingError(f"{method} needs {library}, which is not installed: pip install 'torchsphere[export]'")
