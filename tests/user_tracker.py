"""Trackers of a user, which the tests of the benchmark run as ``user_tracker:NAME``."""

import os
import signal
from typing import Any

import numpy as np


def still(images: Any, circle: tuple[float, float, float]) -> dict[str, Any]:
    """A ball at rest at the given circle; no position from the fourth frame on."""
    n = len(images)
    x = np.where(np.arange(n) < 3, circle[0], np.nan)
    return {"x_px": x, "y_px": np.full(n, circle[1])}


def short(images: Any, circle: tuple[float, float, float]) -> dict[str, Any]:
    """Return one value too few."""
    return {"x_px": np.full(len(images) - 1, circle[0]), "y_px": np.full(len(images), circle[1])}


def raises(images: Any, circle: tuple[float, float, float]) -> dict[str, Any]:
    """Fail in one of the suites."""
    if circle[0] > 40:
        raise RuntimeError(f"no ball in\n{images.shape}")
    return still(images, circle)


def long_quaternions(images: Any, circle: tuple[float, float, float]) -> dict[str, Any]:
    """Return quaternions that are not of unit length, which the check of the file refuses."""
    two = {name: np.full(len(images), 2.0) for name in ("qw", "qx", "qy", "qz")}
    return {**still(images, circle), **two}


def stopped(images: Any, circle: tuple[float, float, float]) -> dict[str, Any]:
    """Raise the interrupt of a user."""
    raise KeyboardInterrupt


def exits(images: Any, circle: tuple[float, float, float]) -> dict[str, Any]:
    """End the program, as scripts do."""
    raise SystemExit(0 if circle[0] > 40 else "no licence")


def ended(images: Any, circle: tuple[float, float, float]) -> dict[str, Any]:
    """Receive the signal of a job scheduler to end."""
    os.kill(os.getpid(), signal.SIGTERM)
    return still(images, circle)


not_a_function = 3
