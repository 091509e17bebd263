"""Ground motion between its samples: where it is linear, and what of it a chain at rest bears."""

import numpy as np
import pytest

from archfrag.mechanics.ground import find_breaks, rest_margin, segment_at
from archfrag.mechanics.types import GroundMotion


class TestSegments:
    """Pieces over which the acceleration is linear in time."""

    across = np.array([0.0, 1.0, 2.0, 3.0, 1.0, -1.0, -1.0])
    upward = np.array([0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0])
    ground = GroundMotion(across, upward, 0.5)

    def test_breaks_are_where_either_component_bends(self):
        assert list(find_breaks(self.ground)) == [2, 2, 3, 5, 5, 6, 6]

    def test_acceleration_is_the_line_between_the_samples_up_to_the_next_break(self):
        breaks, knots = find_breaks(self.ground), 0.5 * np.arange(7)
        for time in np.random.default_rng(2).uniform(0.0, 3.0, 200):
            end, x, rate_x, y, rate_y = segment_at(time, self.ground, breaks)
            assert end >= time
            for later in np.linspace(time, end, 5):
                ahead = later - time
                assert x + rate_x * ahead == pytest.approx(np.interp(later, knots, self.across))
                assert y + rate_y * ahead == pytest.approx(np.interp(later, knots, self.upward))

    def test_nothing_moves_the_ground_after_the_record(self):
        breaks = find_breaks(self.ground)
        assert segment_at(3.0, self.ground, breaks) == (np.inf, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("across", "upward", "plus", "minus", "expected"),
    [
        (1.0, 0.0, 0.35, 0.2, 2.5),  # what is left to the nearer limit
        (-1.0, 0.0, 0.35, 0.2, 1.0),
        (4.0, 0.0, 0.35, 0.2, -0.5),
        (2.5, 5.0, 0.2, 0.2, 0.5),  # upward acceleration widens the range
        (2.5, -5.0, 0.2, 0.2, -1.5),
        (99.0, -9.0, np.inf, np.inf, 1.0),  # the ground falls faster than an arch of any range
        (0.0, -11.0, np.inf, np.inf, -1.0),
    ],
)
def test_margin_of_rest(across, upward, plus, minus, expected):
    assert rest_margin(across, upward, 10.0, plus, minus) == pytest.approx(expected)
