import numpy as np
import pytest

from hssh_kb.perceive import SLIP, make_experience
from perception.places import PlaceReading, PlaceVisit
from perception.star import Star

DEAD_END = Star.parse(["a+1", "a-0"])


def visit(x, y, scan, arrive=1, depart=0):
    reading = PlaceReading(
        DEAD_END, arrive, depart, (0.0, np.pi), ((1.0, 0.0), (np.nan, np.nan)), 1.0
    )
    return PlaceVisit(
        scan, scan, scan, np.array([x, y]), 1.0, (reading,), np.zeros((2, 2), np.uint8), None
    )


def test_displacement_is_between_place_centres_in_drive_axes():
    poses = np.array([[0.1, 0, 0.3], [2, 1, 0.5], [4.2, 2.9, 1.0]])
    made = make_experience(
        [visit(0, 0, 0), visit(4, 3, 2)], poses, lambda i, j: np.diag([0.01, 0.02, 0.0003])
    )
    lam = made.visits[1].displacement
    assert (lam.x, lam.y, lam.theta) == (4.0, 3.0, 0.0)
    assert made.slip == SLIP


def test_covariance_is_turned_into_drive_axes():
    poses = np.array([[0.0, 0, np.pi / 2], [0.0, 5, np.pi / 2]])
    made = make_experience(
        [visit(0, 0, 0), visit(0, 5, 1)], poses, lambda i, j: np.diag([0.04, 0.01, 1e-6])
    )
    cov = np.array(made.visits[1].displacement.cov)
    assert cov[1, 1] == pytest.approx(0.04, abs=2e-3)  # along the robot's x, which is drive y
    assert cov[0, 0] == pytest.approx(0.01, abs=2e-3)


def test_heading_error_reaches_out_to_the_centre():
    poses = np.array([[0.0, 0, 0], [5.0, 0, 0]])
    made = make_experience(
        [visit(0, 0, 0), visit(7, 0, 1)], poses, lambda i, j: np.diag([1e-4, 1e-4, 0.01])
    )
    cov = np.array(made.visits[1].displacement.cov)
    assert cov[1, 1] == pytest.approx(4 * 0.01, rel=0.05)  # two metres beyond the laser


def test_ends_of_the_drive_have_no_way_in_or_out():
    poses = np.zeros((2, 3))
    made = make_experience([visit(0, 0, 0), visit(4, 0, 1)], poses, lambda i, j: np.eye(3) * 1e-3)
    assert made.visits[0].arrive is None
    assert made.visits[1].depart is None
    assert made.visits[0].depart == 0
