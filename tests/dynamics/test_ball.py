"""Moment of inertia of solid and hollow balls, and balls that cannot be."""

import pytest

from torchsphere.dynamics.ball import ball


def test_the_inertia_of_a_shell_lies_between_those_of_a_solid_ball_and_a_thin_skin() -> None:
    solid, thin = ball(1.0, 2.0), ball(1.0, 2.0, shell_m=1e-6)
    assert solid.inertia_kg_m2 == pytest.approx(0.4)
    assert thin.inertia_kg_m2 == pytest.approx(2 / 3, rel=1e-5)
    assert ball(1.0, 2.0, shell_m=0.5).inertia_kg_m2 == pytest.approx(0.4 * (1 - 0.5**5) / (1 - 0.5**3))
    assert ball(1.0, 2.0, inertia_kg_m2=0.5).inertia_kg_m2 == 0.5


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"mass_kg": 0.0}, "mass_kg"),
        ({"mass_kg": "0.1"}, "mass_kg = '0.1': expected a finite, positive number"),
        ({"mass_kg": None}, "mass_kg = None"),
        ({"diameter_m": float("nan")}, "diameter_m"),
        ({"shell_m": 1.5}, "thicker"),
        ({"shell_m": 0.1, "inertia_kg_m2": 0.1}, "both"),
    ],
)
def test_an_impossible_ball_is_refused(settings: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        ball(**({"mass_kg": 1.0, "diameter_m": 2.0} | settings))
