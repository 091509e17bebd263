"""Parts of dispersion: simulated studies with known parts, and the law of total variance."""

import numpy as np
import pytest

from archfrag.errors import FitError, InputError
from archfrag.fragility.dispersion import (
    combine,
    numerical_from_repeats,
    numerical_from_theta,
    split_capacities,
    split_curves,
)

MODEL, RECORD, INTERACTION, NUMERICAL = 0.25, 0.35, 0.1, 0.08
ARCHES, RECORDS, STUDIES = 12, 20, 400


def study(generator, shared=True):
    shape = (ARCHES, RECORDS)
    record = generator.normal(0.0, RECORD, (1, RECORDS) if shared else shape)
    logs = generator.normal(0.0, MODEL, (ARCHES, 1)) + record
    logs = logs + generator.normal(0.0, INTERACTION, shape) if shared else logs
    return logs + generator.normal(0.0, NUMERICAL, shape)


class TestCapacities:
    """Mean of squares over 400 studies: standard error of each beta about 1 %."""

    @pytest.mark.parametrize("shared", [True, False])
    def test_known_parts_come_back(self, shared):
        generator = np.random.default_rng(1)
        found = [
            split_capacities(
                np.exp(study(generator, shared)), same_records=shared, numerical=NUMERICAL
            )
            for _ in range(STUDIES)
        ]
        within = np.hypot(RECORD, INTERACTION) if shared else RECORD
        record = np.array([parts.beta_record_to_record for parts in found])
        model = np.array([parts.beta_model for parts in found])
        assert np.sqrt(np.mean(record**2)) == pytest.approx(within, rel=0.03)
        assert np.sqrt(np.mean(model**2)) == pytest.approx(MODEL, rel=0.05)
        errors = np.nanmean([parts.standard_errors for parts in found], axis=0)
        assert errors == pytest.approx([record.std(), model.std()], rel=0.2)

    def test_taking_shared_records_for_own_hides_the_model(self):
        """The mean of an arch shares the scatter of the records: removing it twice is wrong."""
        generator = np.random.default_rng(2)
        studies = [np.exp(study(generator)) for _ in range(STUDIES)]
        wrong = [split_capacities(c, same_records=False).beta_model ** 2 for c in studies]
        assert np.sqrt(np.mean(wrong)) < 0.97 * MODEL

    def test_law_of_total_variance(self):
        """Of a whole population, the parts add up to the variance of all its values."""
        logs = np.random.default_rng(3).normal(size=(200, 1)) * 0.3
        logs = logs + np.random.default_rng(4).normal(0.0, 0.4, (1, 300))
        parts = split_capacities(np.exp(logs))
        assert parts.combined() == pytest.approx(logs.std(), rel=0.01)
        assert parts.combined(numerical=True) == pytest.approx(parts.combined())

    def test_numerical_part_is_taken_from_record_to_record(self):
        capacity = np.exp(study(np.random.default_rng(5)))
        whole, less = split_capacities(capacity), split_capacities(capacity, numerical=0.2)
        assert less.beta_record_to_record**2 == pytest.approx(
            whole.beta_record_to_record**2 - 0.04
        )
        assert less.beta_model == whole.beta_model
        assert less.combined(numerical=True) == pytest.approx(whole.combined())
        assert "beta_model" in less.message

    def test_unequal_numbers_of_records(self):
        generator = np.random.default_rng(6)
        squares = []
        for _ in range(STUDIES):
            logs = generator.normal(0.0, MODEL, (ARCHES, 1)) + generator.normal(
                0.0, RECORD, (ARCHES, 60)
            )
            logs[2:, 3:] = np.nan
            squares.append(split_capacities(np.exp(logs), same_records=False).beta_model ** 2)
        assert np.sqrt(np.mean(squares)) == pytest.approx(MODEL, rel=0.08)

    def test_a_negative_part_is_zero_and_reported(self):
        logs = np.random.default_rng(7).normal(size=(1, 30)) * np.ones((5, 1))
        noise = np.random.default_rng(8).normal(0.0, 0.3, (5, 30))
        noise -= noise.mean(axis=1, keepdims=True)
        parts = split_capacities(np.exp(logs + noise))
        assert parts.beta_model == 0.0
        assert "modelling variance" in parts.notes[0]

    def test_what_cannot_be_divided(self):
        with pytest.raises(FitError, match="1 arches"):
            split_capacities([[1.0, 2.0]])
        with pytest.raises(FitError, match="1 records"):
            split_capacities([[1.0, np.nan], [1.0, 2.0]])
        with pytest.raises(InputError, match="inf"):
            split_capacities([[1.0, np.inf], [1.0, 2.0]])
        with pytest.raises(InputError, match="numerical"):
            split_capacities([[1.0, 2.0], [1.0, 2.0]], numerical=-1.0)


class TestCurves:
    def test_sampling_error_is_removed(self):
        generator = np.random.default_rng(9)
        squares = np.zeros((STUDIES, 2))
        for i in range(STUDIES):
            logs = generator.normal(0.0, MODEL, (ARCHES, 1)) + generator.normal(
                0.0, RECORD, (ARCHES, RECORDS)
            )
            beta = logs.std(axis=1, ddof=1)
            parts = split_curves(
                np.exp(logs.mean(axis=1)), beta, beta / np.sqrt(RECORDS), n_record=RECORDS
            )
            squares[i] = parts.beta_record_to_record**2, parts.beta_model**2
        assert np.sqrt(squares.mean(axis=0)) == pytest.approx([RECORD, MODEL], rel=0.05)

    def test_shared_records_share_their_error(self):
        theta, beta = np.exp([0.0, 0.2, 0.4]), np.full(3, 0.4)
        own = split_curves(theta, beta, np.full(3, 0.1), n_record=16)
        shared = split_curves(theta, beta, np.full(3, 0.1), n_record=16, shared=0.75)
        assert own.beta_model**2 == pytest.approx(0.04 - 0.01)
        assert shared.beta_model**2 == pytest.approx(0.04 - 0.0025)

    def test_bad_input_is_refused(self):
        with pytest.raises(InputError, match="shared"):
            split_curves([1, 2], [0.4, 0.4], [0.1, 0.1], n_record=9, shared=1.0)
        with pytest.raises(InputError, match="standard_error"):
            split_curves([1, 2], [0.4, 0.4], [0.1], n_record=9)
        with pytest.raises(FitError, match="one arch"):
            split_curves([1], [0.4], [0.1], n_record=9)


def test_numerical_scatter():
    generator = np.random.default_rng(10)
    case = generator.normal(0.0, 0.5, (300, 1))
    assert numerical_from_repeats(
        np.exp(case + generator.normal(0.0, 0.05, (300, 3)))
    ) == pytest.approx(0.05, rel=0.1)
    assert numerical_from_theta(0.01, 25) == pytest.approx(0.05)
    with pytest.raises(InputError, match="two repeats"):
        numerical_from_repeats([[1.0, np.nan]])


def test_combination_is_explicit():
    assert combine(0.3, 0.4, 1.2) == pytest.approx(1.3)
    with pytest.raises(InputError, match=r"-0\.1"):
        combine(0.3, -0.1)
