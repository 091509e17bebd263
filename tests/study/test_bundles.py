"""Bundles of chunks: all dealt out once, long while there is much left and short at the end."""

import pytest

from archfrag.study.bundles import LONGEST, SHORTEST, Bundles, Rates

LENGTHS, KINDS = [3.0] * 600, [0] * 300 + [1] * 300


def dealt(workers, wall, lengths=LENGTHS, rates=None):
    """Bundles as they are taken by workers that are done with each at once."""
    bundles = Bundles(lengths, KINDS, workers, rates or Rates())
    taken = []
    while bundle := bundles.take():
        taken.append(bundle)
        bundles.learn((chunk, wall(chunk)) for chunk in bundle)
    return taken


@pytest.mark.parametrize("workers", [1, 2, 40])
@pytest.mark.parametrize("wall", [1e-9, 1e-4, 0.01, 0.3, 100.0])
def test_each_chunk_is_dealt_out_once_in_order(workers, wall):
    taken = [chunk for bundle in dealt(workers, lambda chunk: wall) for chunk in bundle]
    assert taken == list(range(600))


def test_bundles_are_short_at_the_end():
    wall = [0.05 * len(bundle) for bundle in dealt(2, lambda chunk: 0.05)]
    assert max(wall) == pytest.approx(LONGEST)
    assert wall[-1] <= SHORTEST + 1e-9
    # None is longer than what the other worker has to do with what is left then.
    assert all(wall[i] <= sum(wall[i:]) / 2 + SHORTEST for i in range(len(wall)))


def test_of_a_kind_of_which_nothing_is_known_one_chunk_goes_first():
    rates = Rates()
    taken = dealt(1, lambda chunk: 0.01 if chunk < 300 else 1.0, rates=rates)
    assert taken[0] == (0,)
    assert (300,) in taken
    # In the next round both are known.
    assert len(dealt(1, lambda chunk: 0.01, rates=rates)[0]) > 1


def test_the_longest_chunks_go_first():
    taken = dealt(1, lambda chunk: 9.0, lengths=[1.0, 4.0, 2.0, 3.0])
    assert [chunk for bundle in taken for chunk in bundle] == [1, 3, 2, 0]
