"""For all tests."""

import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.nearby import STEP
from tests.validation.table import Writer, validated  # noqa: F401


@pytest.fixture(autouse=True)
def environment_of_each_test() -> Iterator[None]:
    """Undo what a command called in this process sets for the processes that it starts."""
    yield
    os.environ.pop("PYTHONSAFEPATH", None)


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Of the tests' own helpers no examples are collected: some need other people's solvers."""
    helper = collection_path.suffix == ".py" and not collection_path.name.startswith(
        ("test_", "_")
    )
    return helper or None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Have one of two processes compile first, and the other build the site meanwhile.

    Each gets one half of the tests, in this order. Otherwise they wait for each other's kernels.
    """
    tests = Path(__file__).parent
    compiling = {
        tests / name for name in ("arch", "methods", "mechanics", "physics", "validation")
    }
    items.sort(key=lambda item: compiling.isdisjoint(item.path.parents))
    site = [item for item in items if item.path.name == "test_site.py"]
    others = [item for item in items if item not in site]
    half = len(items) // 2
    items[:] = others[:half] + site + others[half:]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--validation-table", metavar="CSV", help="write the values that tests compare with others"
    )
    parser.addoption(
        "--last-bits", metavar="K", type=int, default=0,
        help="multiply all ground motions by 1 + K 1e-13: no test may depend on last bits",
    )  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    change_last_bits(config.getoption("--last-bits", 0))
    path = config.getoption("--validation-table", None)
    if path and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Writer(Path(path)))


def change_last_bits(k: int) -> None:
    """Multiply the ground motions of all simulations in this process by 1 + `k` 1e-13."""
    simulation: Any = import_module("archfrag.simulation.simulate")
    exact = simulation.ground_of

    def changed(*given: Any) -> tuple[Any, ...]:
        x, y, dt, *apart = exact(*given)
        factor = 1.0 + k * STEP
        return factor * x, None if y is None else factor * y, dt, *(factor * a for a in apart)

    if k:
        simulation.ground_of = changed
