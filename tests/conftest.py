"""For all tests."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

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


def pytest_configure(config: pytest.Config) -> None:
    path = config.getoption("--validation-table", None)
    if path and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Writer(Path(path)))
