"""Bundles of chunks: all dealt out once, long while there is much left and short at the end."""

from dataclasses import replace

import pytest

from archfrag.study.bundles import LONGEST, MOST_CHUNKS, SHORTEST, Bundles, longest_first


@pytest.fixture
def plan(done):
    """Of 600 chunks of two runs of 1.5 s, half of them of each arch."""
    wave = done.plan.records[0]
    records = tuple(replace(wave, id=f"wave{i}", duration=1.5) for i in range(200))
    return replace(done.plan, records=records)


def dealt(plan, workers, wall):
    """Bundles as they are taken by workers that are done with each at once."""
    bundles = Bundles(plan, range(plan.n_chunk), workers)
    taken = []
    while bundle := bundles.take():
        taken.append(bundle)
        bundles.learn({"chunk": chunk, "wall_time": wall(chunk)} for chunk in bundle)
    return taken


@pytest.mark.parametrize("workers", [1, 2, 40])
@pytest.mark.parametrize("wall", [1e-9, 1e-4, 0.01, 0.3, 100.0])
def test_each_chunk_is_dealt_out_once_in_order(plan, workers, wall):
    taken = [chunk for bundle in dealt(plan, workers, lambda chunk: wall) for chunk in bundle]
    assert taken == longest_first(plan, range(plan.n_chunk))
    assert sorted(taken) == list(range(600))


def test_short_chunks_go_together_and_long_ones_alone(plan):
    short, long = (dealt(plan, 2, lambda chunk, wall=wall: wall) for wall in (0.01, LONGEST))
    assert len(short) < 20
    assert {len(bundle) for bundle in long} == {1}
    assert max(map(len, dealt(plan, 2, lambda chunk: 1e-6))) == MOST_CHUNKS


def test_bundles_are_short_at_the_end(plan):
    wall = [0.05 * len(bundle) for bundle in dealt(plan, 2, lambda chunk: 0.05)]
    assert max(wall) == pytest.approx(LONGEST)
    assert wall[-1] <= SHORTEST + 1e-9
    # None is longer than what the other worker has to do with what is left then.
    assert all(wall[i] <= sum(wall[i:]) / 2 + SHORTEST for i in range(len(wall)))


def test_of_an_arch_of_which_nothing_is_known_one_chunk_goes_first(plan):
    taken = dealt(plan, 1, lambda chunk: 0.01 if chunk < 300 else 1.0)
    assert taken[0] == (0,)
    assert (300,) in taken
    assert max(len(bundle) for bundle in taken if 300 in bundle or bundle[0] > 300) <= 2


def test_what_is_in_flight_is_not_dealt_out_again(plan):
    bundles = Bundles(plan, [3, 5, 7], 2)
    assert [bundles.take() for _ in range(4)] == [(3,), (5,), (7,), ()]


def test_the_longest_chunks_go_first(done):
    order = longest_first(done.plan, [0, 1, 2, 3])
    assert sorted(order) == [0, 1, 2, 3]
    longer = replace(done.plan.records[1], duration=1e3)
    plan = replace(done.plan, records=(done.plan.records[0], longer))
    assert longest_first(plan, [0, 1, 2, 3])[0] == 2
