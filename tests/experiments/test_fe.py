"""The decks for CalculiX against exact volumes, masses and stresses, and one run against the theory of two bars."""

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments import experiment
from experiments.fe import bar as fe_bar
from experiments.fe import plate as fe_plate
from experiments.fe.cases import BarCase, PlateCase, ball_mesh, bar_deck, plate_deck, target_mesh
from experiments.fe.deck import Body, Material, Step, deck, write
from experiments.fe.hardening import ALUMINIUM, STEEL, STRAINS, JohnsonCook
from experiments.fe.mesh import FACE_CORNERS, FACES, Mesh, block, graded
from experiments.fe.read import Motion, force_peaks, velocities
from experiments.fe.run import MISSING, NotInstalledError, ccx
from experiments.fe.shapes import half_ball, half_plate, quarter_ball, quarter_bar

BAR = BarCase(size_mm=3.0, coarse_mm=4.0, long_mm=10.0)
PLATE = PlateCase(size_mm=8.0, long_mm=20.0, ball_size_mm=3.0)


def section(text: str, keyword: str) -> list[str]:
    """The lines of a deck that follow its line ``keyword``."""
    lines = text.splitlines()
    start = lines.index(keyword) + 1
    stop = next(i for i in range(start, len(lines)) if lines[i].startswith("*"))
    return lines[start:stop]


def numbers(lines: list[str]) -> np.ndarray:
    return np.array([[float(part) for part in line.split(",")] for line in lines])


def straight_bar(name: str, start_mm: float, touching: int, length_mm: float = 20.0, cells: int = 20) -> Body:
    """An elastic bar of 1 mm^2 along x without lateral contraction, which touches at the given end of x."""
    mesh = block(start_mm + np.linspace(0, length_mm, cells + 1), np.array((0.0, 1.0)), np.array((0.0, 1.0)))
    material = Material(100e3, 0.0, 4e-9)  # sound at 5 km/s
    every = np.arange(len(mesh.elements))
    return Body(name, mesh, {f"{name}STUFF": (every, material)}, (0, touching, mesh.side(0, touching)))


# Hardening


def test_at_the_reference_rate_the_table_is_a_plus_b_strain_to_the_n():
    stress = ALUMINIUM.table(0.18)[:, 0]
    np.testing.assert_allclose(stress, 175 + 223 * STRAINS**0.37, rtol=1e-14)


def test_the_first_stress_at_a_rate_is_the_yield_stress_times_the_rate_factor():
    assert STEEL.table(200.0)[0].tolist() == pytest.approx([400 * (1 + 0.12 * math.log(1000)), 0.0])


@pytest.mark.parametrize("law", [ALUMINIUM, STEEL])
def test_a_table_rises_in_stress_and_in_strain_as_calculix_wants(law: JohnsonCook):
    assert (np.diff(law.table(1000.0), axis=0) > 0).all()


def test_a_rate_below_the_reference_is_refused():
    with pytest.raises(ValueError, match=r"rate_hz = 0.01: expected at least 0.18"):
        ALUMINIUM.table(0.01)


def test_a_material_without_yield_stress_is_refused():
    with pytest.raises(ValueError, match="yield_mpa = 0"):
        replace(ALUMINIUM, yield_mpa=0)


# Meshes


def test_a_block_has_the_volume_of_its_edges():
    mesh = block(np.array((0.0, 1, 3)), np.array((-1.0, 4)), graded(2.0, 0.3, 0.6))
    assert mesh.volumes_mm3().sum() == pytest.approx(3 * 5 * 2, rel=1e-13)


def test_graded_places_end_at_the_length_and_grow_in_one_ratio():
    sizes = np.diff(graded(10.0, 0.5, 2.0))
    assert sizes.sum() == pytest.approx(10.0)
    np.testing.assert_allclose(sizes[1:] / sizes[:-1], sizes[1] / sizes[0])
    assert sizes[-1] / sizes[0] == pytest.approx(4.0)


def test_a_size_above_the_length_is_refused():
    with pytest.raises(ValueError, match="element sizes above 0 and up to 1"):
        graded(1.0, 2.0, 0.5)


@pytest.mark.parametrize(
    ("make", "true_mm3"),
    [
        (lambda h: quarter_ball(15.0, h, 2 * h), math.pi * 15**3 / 3),
        (lambda h: half_ball(9.5, h, 2 * h), math.pi * 9.5**3 * 2 / 3),
        (lambda h: quarter_bar(9.0, 150.0, h, 1.5 * h, 10.0), math.pi * 81 * 150 / 2),
    ],
)
def test_round_bodies_lose_volume_with_the_square_of_the_element_size(make, true_mm3: float):
    # A quarter of the size, a sixteenth of the loss; half of that is left for the rounding of counts of elements.
    lost = [1 - make(h).volumes_mm3().sum() / true_mm3 for h in (3.0, 0.75)]
    assert 0 < lost[1] < lost[0] / 8
    assert lost[0] < 0.1


@pytest.mark.parametrize("case", [BAR, PLATE, BarCase(size_mm=1.0), PlateCase()])
def test_no_element_is_turned_inside_out(case: BarCase | PlateCase):
    for mesh in (ball_mesh(case), target_mesh(case)):
        assert mesh.jacobians().min() > 0


@pytest.mark.parametrize("case", [BAR, PLATE])
def test_shares_of_the_nodes_put_the_centre_of_mass_where_symmetry_has_it(case: BarCase | PlateCase):
    mesh = ball_mesh(case)
    centre = mesh.shares() @ mesh.nodes_mm
    if isinstance(case, BarCase):
        assert centre[0] == pytest.approx(-24.0, abs=1e-9)
        assert centre[1] == pytest.approx(centre[2], rel=1e-9)
    else:
        assert centre[:2] == pytest.approx((0.0, 9.5), abs=1e-9)


@pytest.mark.parametrize("case", [BAR, PLATE])
def test_ball_and_target_touch_in_one_node_and_nowhere_else(case: BarCase | PlateCase):
    ball, target = ball_mesh(case), target_mesh(case)
    if isinstance(case, BarCase):
        assert ball.nodes_mm[:, 0].max() == pytest.approx(-9.0)
        assert target.nodes_mm[:, 0].min() == pytest.approx(-9.0)
    else:
        assert ball.nodes_mm[:, 1].min() == pytest.approx(0.0, abs=1e-12)
        assert target.nodes_mm[:, 1].max() == 0.0


def test_the_plate_has_its_size_and_its_fine_elements_where_the_ball_goes():
    mesh = half_plate(400.0, 200.0, 1.0, (-20.0, 60.0), 4.0, 10.0)
    assert mesh.volumes_mm3().sum() == pytest.approx(400 * 100 * 1)
    x = np.unique(mesh.nodes_mm[:, 0])
    inside = np.diff(x[(x > -20.1) & (x < 60.1)])
    np.testing.assert_allclose(inside, 4.0)


@pytest.mark.parametrize(("axis", "end"), [(axis, end) for axis in range(3) for end in range(2)])
def test_a_side_of_a_block_is_the_numbered_face_of_its_elements(axis: int, end: int):
    mesh: Mesh = block(np.arange(4.0), np.arange(3.0), np.arange(5.0))
    corners = np.array(FACE_CORNERS[FACES[axis][end]])
    found = mesh.nodes_mm[mesh.elements[mesh.side(axis, end)][:, corners], axis]
    wanted = mesh.nodes_mm[:, axis].max() if end else 0.0
    assert (found == wanted).all()


# Decks


def test_the_deck_gives_a_quarter_of_the_ball_a_quarter_of_its_mass():
    text = bar_deck(BAR)
    block_of_ball = text[text.index("NAME=STEELBALL") :]
    density = float(re.search(r"\*DENSITY\n(\S+)", block_of_ball)[1])
    assert density * ball_mesh(BAR).volumes_mm3().sum() == pytest.approx(0.110e-3 / 4, rel=1e-8)


def test_the_deck_gives_a_quarter_of_the_bar_a_quarter_of_its_mass():
    text = bar_deck(BAR)
    found = {float(re.search(r"\*DENSITY\n(\S+)", text[text.index(f"NAME={name}") :])[1]) for name in ("NEAR", "FAR")}
    mass_t = 2800e-12 * math.pi * 81 * 300 / 4
    assert [density * target_mesh(BAR).volumes_mm3().sum() for density in found] == pytest.approx([mass_t])


def test_the_deck_has_every_node_and_every_element_once_and_numbers_from_one():
    text = bar_deck(BAR)
    ball, bar = ball_mesh(BAR), target_mesh(BAR)
    nodes = [*section(text, "*NODE, NSET=BALL"), *section(text, "*NODE, NSET=BAR")]
    np.testing.assert_allclose(numbers(nodes)[:, 1:], np.vstack((ball.nodes_mm, bar.nodes_mm)), atol=1e-6)
    assert numbers(nodes)[:, 0].tolist() == list(range(1, len(nodes) + 1))
    elements = numbers(
        [x for name in ("STEELBALL", "NEAR", "FAR") for x in section(text, f"*ELEMENT, TYPE=C3D8, ELSET={name}")]
    )
    assert sorted(elements[:, 0].tolist()) == list(range(1, len(ball.elements) + len(bar.elements) + 1))
    ordered = elements[np.argsort(elements[:, 0]), 1:] - 1
    assert np.array_equal(ordered, np.vstack((ball.elements, bar.elements + len(ball.nodes_mm))))


def test_the_bar_has_the_contact_s_table_near_the_contact_and_that_of_bending_beyond():
    text = bar_deck(BAR)
    for name, rate in (("NEAR", 20_000.0), ("FAR", 100.0)):
        rows = re.search(rf"NAME={name}\n.*?\*PLASTIC\n(.*?)\n\*", text, re.DOTALL)[1]
        np.testing.assert_allclose(numbers(rows.splitlines()), ALUMINIUM.table(rate), rtol=1e-8)
    near = (
        numbers(section(text, "*ELEMENT, TYPE=C3D8, ELSET=NEAR"))[:, 0].astype(int) - 1 - len(ball_mesh(BAR).elements)
    )
    distance = np.linalg.norm(target_mesh(BAR).centres_mm - (-9, 0, 0), axis=1)
    assert set(near) == set(np.flatnonzero(distance < 9))


def test_nodes_on_the_planes_of_symmetry_are_held_across_them():
    text, bar = bar_deck(BAR), target_mesh(BAR)
    first = len(ball_mesh(BAR).nodes_mm) + 1
    for axis in (1, 2):
        held = np.concatenate(
            [np.array(line.split(","), dtype=int) for line in section(text, f"*NSET, NSET=BARHELD{axis + 1}")]
        )
        assert set(held - first) == set(np.flatnonzero(np.abs(bar.nodes_mm[:, axis]) < 1e-9))
        assert f"*BOUNDARY\nBARHELD{axis + 1}, {axis + 1}\n" in text


def test_the_ball_flies_at_its_speed_along_the_barrel_and_at_its_angle_to_the_plate():
    frontal = numbers([x.removeprefix("BALL,") for x in section(bar_deck(BAR), "*INITIAL CONDITIONS, TYPE=VELOCITY")])
    assert frontal.tolist() == [[1, 70e3], [2, 0], [3, 0]]
    oblique = [x.removeprefix("BALL,") for x in section(plate_deck(PLATE), "*INITIAL CONDITIONS, TYPE=VELOCITY")]
    angle = math.radians(15)
    assert numbers(oblique)[:, 1] == pytest.approx((80e3 * math.cos(angle), -80e3 * math.sin(angle), 0), rel=1e-8)


def test_the_plate_s_bricks_have_incompatible_modes_and_the_ball_s_have_not():
    text, plate = plate_deck(PLATE), target_mesh(PLATE)
    assert len(section(text, "*ELEMENT, TYPE=C3D8I, ELSET=PLATESTEEL")) == len(plate.elements)
    assert len(section(text, "*ELEMENT, TYPE=C3D8, ELSET=STEELBALL")) == len(ball_mesh(PLATE).elements)


def test_only_the_lower_ends_of_the_plate_rest_on_supports():
    text, plate = plate_deck(PLATE), target_mesh(PLATE)
    held = np.concatenate([np.array(x.split(","), dtype=int) for x in section(text, "*NSET, NSET=PLATEHELD2")])
    places = plate.nodes_mm[held - 1 - len(ball_mesh(PLATE).nodes_mm)]
    assert len(places) == 2 * (plate.grid[2] + 1)
    assert (np.abs(places[:, 0]) == 200).all()
    assert (places[:, 1] == -1).all()


def test_an_element_without_material_is_refused():
    bar, other = straight_bar("BALL", -20.0, 1), straight_bar("OTHER", 0.0, 0)
    (name, (members, material)) = next(iter(other.materials.items()))
    poor = replace(other, materials={name: (members[1:], material)})
    with pytest.raises(ValueError, match="OTHER: expected one material for each of 20 elements"):
        deck(bar, poor, (1.0, 0.0, 0.0), Step(1e-6, 1, 1e5, False))


# Reading


DAT = """
 velocities (vx,vy,vz) for set BALL and time  0.1000000E-05

         1  7.000000E+04  0.000000E+00  2.000000E+00
         2  6.000000E+04 -4.000000E+00  0.000000E+00

 velocities (vx,vy,vz) for set BALL and time  0.3000000E-05

         1  5.000000E+04  0.000000E+00  0.000000E+00
         2  5.000000E+04  0.000000E+00  0.000000E+00
"""


def test_velocities_are_the_nodes_means_by_their_shares_of_mass(tmp_path: Path):
    path = write(tmp_path / "small.dat", DAT)
    times, velocity = velocities(path, np.array((0.75, 0.25)))
    assert times.tolist() == [1e-6, 3e-6]
    assert velocity.tolist() == [[67_500, -1, 1.5], [50_000, 0, 0]]


def test_a_file_without_velocities_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match=r"empty.dat: no table of 'velocities'"):
        velocities(write(tmp_path / "empty.dat", "\n"), np.ones(1))


@pytest.mark.parametrize("lost", ["         1  7", "         2  5"])
def test_a_table_that_lacks_a_node_is_refused(tmp_path: Path, lost: str):
    path = write(tmp_path / "short.dat", "\n".join(x for x in DAT.splitlines() if not x.startswith(lost)))
    with pytest.raises(ValueError, match="expected the nodes 1 to 2 with three components"):
        velocities(path, np.full(2, 0.5))


def test_times_that_do_not_grow_are_refused(tmp_path: Path):
    path = write(tmp_path / "twice.dat", DAT.replace("0.3000000E-05", "0.1000000E-05"))
    with pytest.raises(ValueError, match="the times do not grow"):
        velocities(path, np.full(2, 0.5))


def test_the_force_is_mass_times_change_of_velocity_over_uneven_intervals():
    motion = Motion(np.array((0, 1e-6, 4e-6)), np.array(((70.0, 0, 0), (69.0, 0, 0), (63.0, 3.0, 0))), 0.1)
    time, force = motion.force()
    assert time.tolist() == pytest.approx([0.5e-6, 2.5e-6])
    np.testing.assert_allclose(force, [[-1e5, 0, 0], [-2e5, 1e5, 0]])


def test_a_constant_force_is_seen_as_it_is_one_interval_after_it_set_in_and_half_as_it_sets_in():
    time = np.linspace(0, 200e-6, 2001)
    velocity = np.zeros((2001, 3))
    velocity[:, 0] = 70 - 5e5 * time
    seen_at, force = Motion(time, velocity, 0.1).seen(20e-6)
    np.testing.assert_allclose(force[seen_at > 20e-6, 0], -5e4, rtol=1e-6)
    assert force[np.abs(seen_at).argmin(), 0] == pytest.approx(-2.5e4, rel=1e-6)
    assert force[0, 0] == pytest.approx(0, abs=1e-3)


def test_an_interval_longer_than_half_of_the_impact_is_refused():
    motion = Motion(np.array((0, 1e-5)), np.zeros((2, 3)), 0.1)
    with pytest.raises(ValueError, match="at most half"):
        motion.seen(1 / 36_000)


def test_a_ball_that_is_never_pushed_has_no_peaks():
    assert force_peaks(np.arange(5.0), np.zeros(5)) == ()


# Experiments


def test_flight_at_the_plate_s_angle_is_along_the_barrel_and_off_the_plate_is_up():
    angle = math.radians(15)
    flight, off = np.array((80 * math.cos(angle), -80 * math.sin(angle), 0)), np.array((0.0, 1.0, 0.0))
    found = fe_plate.in_camera_axes(np.array((flight, off)), 15.0)
    np.testing.assert_allclose(found, [[80, 0], [-math.sin(angle), -math.cos(angle)]], atol=1e-12)


def test_a_short_push_is_seen_highest_where_a_frame_falls_on_it_and_half_as_high_where_two_share_it():
    interval, step = 1 / fe_bar.FRAME_RATE_HZ, 1 / fe_bar.FRAME_RATE_HZ / fe_bar.PHASES
    time = np.arange(0, 6 * interval, step)
    velocity = np.zeros((len(time), 3))
    velocity[:, 0] = np.where(time < 2 * interval - step / 2, 70.0, 60.0)
    force = fe_bar.seen("push", Motion(time, velocity, 0.1))
    whole = 0.1 * 10 / interval
    # The push takes one step of the 28 in an interval.
    assert force.peaks[0].force_N == pytest.approx(whole, rel=1 / fe_bar.PHASES)
    assert force.lowest_N == pytest.approx(whole / 2, rel=2 / fe_bar.PHASES)


# Running


def test_without_calculix_the_message_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(NotInstalledError, match="apt-get install calculix-ccx") as caught:
        ccx(tmp_path, "impact")
    assert str(caught.value) == MISSING


def test_without_calculix_and_cache_the_experiment_says_so_and_has_no_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr(experiment, "CACHE", tmp_path)
    assert fe_plate.rows(fe_plate.compute()) == []
    assert fe_bar.computed((BAR,)) == ()
    assert capsys.readouterr().out.splitlines()[-1] == f"bar, 3 mm: {MISSING}"


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed: apt-get install calculix-ccx")
def test_of_two_equal_elastic_bars_the_second_takes_all_of_the_first_one_s_velocity(tmp_path: Path):
    # Saint-Venant: a force of density * sound * speed / 2 for the time in which sound runs to the end and back, 8 us.
    first, second = straight_bar("BALL", -20.0, 1), straight_bar("OTHER", 0.0, 0)
    # Contact as stiff as an element, as in the cases; printed at every increment, the first two times are in disorder.
    text = deck(first, second, (10e3, 0.0, 0.0), Step(12e-6, 2, 100e3, False))
    write(tmp_path / "bars.inp", text)
    ccx(tmp_path, "bars")
    time, velocity = velocities(tmp_path / "bars.dat", first.mesh.shares())
    motion = Motion(time, 1e-3 * velocity, 20 * 4e-9 * 1e3)
    # The mesh rounds the edges of the pulse and rings after them: 2 % in its middle and after it.
    speeds = np.interp((2e-6, 6e-6, 10e-6), motion.time_s, motion.velocity_m_s[:, 0])
    force = -motion.mass_kg * (speeds[1] - speeds[0]) / 4e-6
    assert force == pytest.approx(4e-9 * 5e6 * 10e3 / 2, rel=0.02)
    assert speeds[2] == pytest.approx(0.0, abs=0.2)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed: apt-get install calculix-ccx")
def test_a_body_that_rings_in_free_flight_has_a_steady_momentum_by_the_shares_of_its_nodes(tmp_path: Path):
    first, second = straight_bar("BALL", -20.0, 1, cells=10), straight_bar("OTHER", 0.0, 0, cells=10)
    # A waist at every other station: sums of rows would share the elements' masses otherwise.
    nodes = first.mesh.nodes_mm.copy()
    nodes[1:-1, 1:] *= np.where(np.round(nodes[1:-1, :1] / 2) % 2 == 0, 1.0, 0.5)
    ball = replace(first, mesh=replace(first.mesh, nodes_mm=nodes))
    write(tmp_path / "rings.inp", deck(ball, second, (10e3, 0.0, 0.0), Step(40e-6, 2, 50e3, False)))
    ccx(tmp_path, "rings")
    time, velocity = velocities(tmp_path / "rings.dat", ball.mesh.shares())
    late = velocity[time > 30e-6, 0]
    assert len(late) > 20
    # Seven digits are printed of velocities up to 10 m/s.
    assert np.ptp(late) < 0.05
    table = (tmp_path / "rings.dat").read_text().split("time")[-1].splitlines()[2:]
    assert np.ptp([float(line.split()[1]) for line in table if line.strip()]) > 100
