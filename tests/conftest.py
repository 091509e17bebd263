"""For all tests."""

from pathlib import Path


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Of the tests' own helpers no examples are collected: some need other people's solvers."""
    helper = collection_path.suffix == ".py" and not collection_path.name.startswith(
        ("test_", "_")
    )
    return helper or None
