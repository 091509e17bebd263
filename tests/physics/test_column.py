"""Multi-drum column: overturning under a pulse in two parts, and the jump of its mode."""

import pytest

from tests.physics.audit import pulse
from tests.validation.scenes import column, falls


@pytest.mark.parametrize(
    "options",
    [{"method": "event_driven", "rtol": 1e-4}, {"method": "time_stepping", "dt": 5e-4}],
    ids=["event_driven", "time_stepping"],
)
def test_least_amplitude_and_its_jump(options):
    for duration, least in ((0.20, 1.4637), (0.33, 0.7825), (0.36, 0.3722)):
        assert not falls(column(), pulse(0.995 * least, duration), **options)
        assert falls(column(), pulse(1.005 * least, duration), **options)
    assert not falls(column(), pulse(0.465, 0.33), **options)
    assert falls(column(), pulse(0.465, 0.34), **options)
