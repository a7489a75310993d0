"""The smoother on pulses of force and torque with exact truth: bands that hold in flight and in contact, and gaps."""

import dataclasses

import numpy as np
import pytest
import torch
from pulses import FRAMES, M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, Pulse, pulse
from shots import shot

import torchsphere as ts
from torchsphere.dynamics.ball import ball
from torchsphere.dynamics.impact import impact
from torchsphere.dynamics.kinematics import Kinematics, kinematics_of_many
from torchsphere.estimation import rts
from torchsphere.estimation.force_forms import FORMS, NAMES

#: Shots by the noise of the positions, m: more where a half-sine is hardly told from other forms.
SHOTS = dict(zip(NOISES_M, (12, 24), strict=True))

#: By the noise of the positions, N: most that the peak of any of the shots may be off by, and largest error of the
#: force in contact, root mean square. Seen in these and in 24 or 48 other shots: peaks 13 and 24 N, 359 and 655 N (of
#: 29 kN); forces 13 and 14 N, 115 and 113 N.
PEAK_OFF_N = dict(zip(NOISES_M, (40, 500), strict=True))
FORCE_OFF_N = dict(zip(NOISES_M, (18, 150), strict=True))


@pytest.fixture(scope="module", params=NOISES_M)
def noise_m(request: pytest.FixtureRequest) -> float:
    return float(request.param)


@pytest.fixture(scope="module")
def shots(noise_m: float) -> tuple[list[Pulse], list[Kinematics]]:
    made = [pulse(seed, noise_m) for seed in range(SHOTS[noise_m])]
    return made, kinematics_of_many([p.track for p in made], frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)


def covered(shots: tuple[list[Pulse], list[Kinematics]], name: str, part: bool) -> float:
    """Share of all values in contact, or in flight, within 1.96 standard deviations of the truth."""
    made, found = shots
    within = []
    for truth, motion in zip(made, found, strict=True):
        off = np.abs(getattr(motion, name) - getattr(truth, name)) <= 1.96 * getattr(motion, f"sd_{name}")
        within.append(off[truth.touching == part])
    return float(np.concatenate(within).mean())


@pytest.mark.parametrize("part", [False, True], ids=["flight", "contact"])
@pytest.mark.parametrize("name", ["velocity_m_s", "force_N", "spin_rad_s"])
def test_bands_of_95_percent_hold_nine_of_ten_values_in_flight_and_contact(
    shots: tuple[list[Pulse], list[Kinematics]], name: str, part: bool
) -> None:
    # An upper limit needs more shots: the errors within a flight are one error each, so that 24 shots give a share to
    # 2 percent and 12 to 3. Of 72 other shots the shares are 96 to 98 (velocity, spin) and 97 to 99 percent (force).
    # The next tests limit errors and widths of the bands.
    assert covered(shots, name, part) >= 0.9


def errors_in_contact(shots: tuple[list[Pulse], list[Kinematics]], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Errors and stated standard deviations of all values along x in contact."""
    off = [(getattr(k, name) - getattr(p, name))[p.touching, 0] for p, k in zip(*shots, strict=True)]
    sd = [getattr(k, f"sd_{name}")[p.touching, 0] for p, k in zip(*shots, strict=True)]
    return np.concatenate(off), np.concatenate(sd)


@pytest.mark.parametrize(("name", "most"), [("velocity_m_s", 1.5), ("force_N", 1.9)])
def test_bands_in_contact_are_as_wide_as_the_errors_or_wider_by_the_forms_that_the_force_might_have(
    shots: tuple[list[Pulse], list[Kinematics]], name: str, most: float
) -> None:
    off, sd = errors_in_contact(shots, name)
    # 24 shots give the ratio to some 15 percent, 12 to 21, as the errors of shots differ by a factor of three. Of 168
    # and 48 shots it is 1.8 (force, 7.5 um), 1.25 (1.5 um), 1.4 and 1.1 (velocity). At 7.5 um a half-sine is hardly
    # told from other forms, which the bands have to hold: the next test limits the errors instead.
    assert 0.85 < np.sqrt((sd**2).mean() / (off**2).mean()) < most


def test_the_force_in_contact_is_right_to_half_a_percent_of_its_peak_or_better(
    noise_m: float, shots: tuple[list[Pulse], list[Kinematics]]
) -> None:
    off, _ = errors_in_contact(shots, "force_N")
    assert np.sqrt((off**2).mean()) < FORCE_OFF_N[noise_m]


def test_the_peak_force_of_every_shot_is_right(noise_m: float, shots: tuple[list[Pulse], list[Kinematics]]) -> None:
    found = [impact(motion, ball(MASS_KG, 150 * M_PER_PX), normal_deg=180.0)[0] for motion in shots[1]]
    peaks = [one.peak_force for one in found if one is not None and one.peak_force is not None]
    assert len(peaks) == SHOTS[noise_m]
    off = np.array([float(peak.value) - PEAK_N for peak in peaks])
    assert np.abs(off).max() < PEAK_OFF_N[noise_m]
    assert abs(off.mean()) < 0.2 * PEAK_OFF_N[noise_m]
    # A half-sine is one of the forms and departs from none: the errors of five times 24 shots are 0.5 to 0.8 of the
    # standard deviations, which have to hold for other forces, too. 24 shots give the ratio to 15 percent, 12 to 21.
    assert 0.35 < np.sqrt(np.mean((off / [float(peak.sd) for peak in peaks]) ** 2)) < 1.1


def test_the_edges_of_the_contact_have_the_stated_accuracy(
    shots: tuple[list[Pulse], list[Kinematics]],
) -> None:
    off = np.array([(k.contact_s - p.edges_s) / k.sd_contact_s for p, k in zip(*shots, strict=True)])
    # Noise may make a wrong form likelier, which moves both edges of a shot: the standard deviations hold the edges of
    # every form that is left with a twentieth of the candidates. 2.1 and rms of 0.6 and 0.8 are seen.
    assert np.abs(off).max() < 3.5
    assert 0.3 < np.sqrt((off**2).mean()) < 1.3
    assert all(np.all(k.sd_contact_s < 1.0 / RATE) for k in shots[1])


def test_the_drawn_contacts_of_every_shot_reach_the_true_edges(shots: tuple[list[Pulse], list[Kinematics]]) -> None:
    for truth, motion in zip(*shots, strict=True):
        assert motion.draws is not None
        first, last = motion.draws.contact_s.min(0), motion.draws.contact_s.max(0)
        # 32 of them may end short of the truth: by 0.4 standard deviations in 1 of 120 shots.
        beyond = np.maximum(first - truth.edges_s, truth.edges_s - last)
        assert np.all(beyond < motion.sd_contact_s)


def test_a_batch_gives_each_recording_the_result_that_it_gets_alone(
    shots: tuple[list[Pulse], list[Kinematics]],
) -> None:
    alone = ts.kinematics(shots[0][1].track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    for name in ("velocity_m_s", "force_N", "spin_rad_s", "contact_s"):
        # Another order of sums may choose a neighbour of one of the 32 candidates: a tenth of the uncertainty.
        off = np.abs(getattr(alone, name) - getattr(shots[1][1], name))
        assert np.all(off < 0.1 * getattr(alone, f"sd_{name}"))


def test_a_gap_is_bridged_with_bands_that_grow_into_it() -> None:
    made = pulse(3, NOISES_M[1])
    hidden = slice(8, 16)
    arrays = {"position": hidden, "orientation": hidden, "increment": slice(7, 16)}
    changed = {name: getattr(made.track, name).copy() for name in arrays}
    for name, part in arrays.items():
        changed[name][part] = np.nan
    track = dataclasses.replace(made.track, **changed)
    motion = ts.kinematics(track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    whole = ts.kinematics(made.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    assert np.isfinite(motion.velocity_m_s).all()
    assert np.all(motion.sd_position_m[11:13, 0] > 1.2 * whole.sd_position_m[11:13, 0])
    assert np.all(np.abs(motion.velocity_m_s - made.velocity_m_s)[hidden] < 4 * motion.sd_velocity_m_s[hidden])
    assert np.all(np.abs(motion.spin_rad_s - made.spin_rad_s)[hidden] < 4 * motion.sd_spin_rad_s[hidden])


def test_frames_before_the_first_and_after_the_last_measured_frame_are_empty() -> None:
    made = pulse(4, NOISES_M[1])
    ends = np.r_[0:5, 70:FRAMES]
    position, orientation = made.track.position.copy(), made.track.orientation.copy()
    position[ends], orientation[ends] = np.nan, np.nan
    increment = made.track.increment.copy()
    increment[np.r_[0:5, 69 : FRAMES - 1]] = np.nan
    track = dataclasses.replace(made.track, position=position, orientation=orientation, increment=increment)
    motion = ts.kinematics(track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    for name in ("position_m", "velocity_m_s", "force_N", "spin_rad_s", "sd_spin_rad_s"):
        values = getattr(motion, name)
        assert np.isnan(values[ends]).all()
        assert np.isfinite(values[5:70]).all()


def test_a_track_without_rotation_has_translation_and_force() -> None:
    made = pulse(5, NOISES_M[1])
    increment, covariance = made.track.increment.copy(), made.track.covariance.copy()
    increment[:, 2:], covariance[:, 2:], covariance[:, :, 2:] = np.nan, np.nan, np.nan
    track = dataclasses.replace(
        made.track, increment=increment, covariance=covariance, orientation=np.full((FRAMES, 3, 3), np.nan)
    )
    motion = ts.kinematics(track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    assert np.isnan(motion.spin_rad_s).all()
    assert np.isfinite(motion.sd_force_N).all()
    assert abs(np.abs(motion.force_N[:, 0]).max() - PEAK_N) < 1500


def test_steady_flight_has_no_contact_and_states_its_bandwidth() -> None:
    made = pulse(6, NOISES_M[1])
    steady = dataclasses.replace(
        made.track,
        **{
            name: getattr(made.track, name)[:30] for name in ("position", "orientation", "status", "zncc", "iterations")
        },
        increment=made.track.increment[:29],
        covariance=made.track.covariance[:29],
    )
    motion = ts.kinematics(steady, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    assert motion.contact_s is None
    assert motion.about["contact_found"] is False
    # A parabola through 30 frames passes periods of about twice their length and more.
    assert motion.about["bandwidth_flight_translation_Hz"]["acceleration"] < RATE / 15
    # With 30 independent errors the slope of a line has sd * sqrt(12 / 30^3), that of a parabola up to twice as much at
    # its ends. 30 frames give the noise to 15 percent.
    slope = NOISES_M[1] * RATE * np.sqrt(12 / 30**3)
    assert 0.85 * slope < motion.sd_velocity_m_s[15, 0] < 6 * slope


def test_the_smoother_passes_more_in_contact_than_in_flight(shots: tuple[list[Pulse], list[Kinematics]]) -> None:
    for motion in shots[1]:
        about = motion.about
        assert about["contact_found"]
        in_contact, in_flight = (about[f"bandwidth_{part}_translation_Hz"] for part in ("contact", "flight"))
        # A half-sine of 14 frames has its power below a period of 28 frames. A force with a form has the frequencies of
        # the form, whatever passes beside it: 0.9 of that frequency and more at 7.5 um, 1.8 at 1.5 um.
        assert in_contact["acceleration"] > 0.8 * RATE / 28 > in_flight["acceleration"]
        assert in_contact["acceleration"] > 3 * in_flight["acceleration"]


def test_the_summary_names_the_form_of_a_half_sine(shots: tuple[list[Pulse], list[Kinematics]]) -> None:
    half_sine = dict(zip(NAMES, FORMS[0], strict=True))
    # Noise makes another form likelier in 2 of 168 shots.
    assert sum(motion.about["form"] == half_sine for motion in shots[1]) >= len(shots[1]) - 1
    for motion in shots[1]:
        # Most of the drawn motions, and the rotations like the translation; nothing pushes along y.
        assert len(motion.about["share_with_form"]) == len(motion.about["intensity_contact"]) == 5
        assert motion.about["share_with_form"][0] > 0.4
        assert motion.about["intensity_contact"][1] < 1e-4 * motion.about["intensity_contact"][0]


def test_an_impact_between_two_frames_is_smoothed_although_its_covariance_is_singular() -> None:
    # In one of the 32 intervals the covariance is singular but for rounding.
    before = shot(2, n=20, step=(9, 1), start=(80, 60), radius=40)
    after = shot(2, n=14, step=(-5, 4), start=(250, 80), radius=40)
    tracked = ts.track(torch.cat((before.images, after.images)), before.circle, sphere_map=False)
    motion = ts.kinematics(tracked, frame_rate=1000, diameter_m=0.03)
    m_s = 0.03 / 80 * 1000  # of a px per frame; the steps scatter by 0.3 px
    np.testing.assert_allclose(motion.velocity_m_s[5:15].mean(0), [9 * m_s, 1 * m_s], atol=0.3 * m_s)
    np.testing.assert_allclose(motion.velocity_m_s[24:30].mean(0), [-5 * m_s, 4 * m_s], atol=0.3 * m_s)
    assert np.isfinite(motion.sd_velocity_m_s).all()


def test_a_system_that_is_singular_but_for_rounding_is_solved_in_its_regular_part() -> None:
    direction = torch.tensor([[1.0, 1e3, -1e-3]], dtype=torch.float64)
    matrix = direction.mT @ direction * (1 + 1e-14 * torch.randn(3, 3, generator=torch.Generator().manual_seed(1)))
    matrix[0, 0] -= 1e-11
    both = torch.stack((matrix, torch.eye(3, dtype=torch.float64)))
    solution = torch.from_numpy(rts._solve(both.numpy(), both.numpy()))
    assert torch.linalg.cholesky_ex(matrix / matrix.diagonal().sqrt()[:, None] / matrix.diagonal().sqrt()).info > 0
    torch.testing.assert_close(matrix @ solution[0], matrix, rtol=1e-8, atol=0.0)
    torch.testing.assert_close(solution[1], both[1])


def test_a_root_reproduces_its_covariance_and_is_stable_against_rounding() -> None:
    generator = torch.Generator().manual_seed(4)
    some = torch.randn(6, 6, generator=generator, dtype=torch.float64)
    alike = torch.eye(6, dtype=torch.float64) * 1e-4
    singular = some[:, :4] @ some[:, :4].mT
    both = torch.stack((some @ some.mT, alike, singular))
    found = rts.covariance_root(both)
    torch.testing.assert_close(found @ found.mT, both, rtol=1e-7, atol=1e-9)
    rounding = 1e-15 * torch.randn(6, 6, generator=generator, dtype=torch.float64)
    again = rts.covariance_root(both + both * (rounding + rounding.mT))
    torch.testing.assert_close(again[:2], found[:2], rtol=1e-10, atol=1e-13)
