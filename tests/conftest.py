"""For all tests."""

import csv
import os
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

TESTS = Path(__file__).parent
ELSEWHERE = str(TESTS / "elsewhere")
if "--as-elsewhere" in sys.argv:  # before anything imports archfrag
    places = filter(None, (ELSEWHERE, os.environ.get("PYTHONPATH")))
    os.environ["PYTHONPATH"] = os.pathsep.join(places)
    sys.path.insert(0, ELSEWHERE)
    sys.modules.pop("sitecustomize", None)
    import_module("sitecustomize")

from tests.nearby import STEP  # noqa: E402
from tests.validation.table import Writer, validated  # noqa: E402, F401

SLOW = TESTS / "slow.csv"
LAWS = {TESTS / "physics", TESTS / "validation"}


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


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Mark what is slow and what is a law, skip what is POSIX's, and begin with the site."""
    elsewhere = os.name != "posix" or config.getoption("--as-elsewhere")
    with SLOW.open(encoding="utf-8", newline="") as file:
        slow = {row["test"] for row in csv.DictReader(file)}
    for item in items:
        if item.nodeid in slow:
            item.add_marker("slow")
        if elsewhere and item.get_closest_marker("posix"):
            item.add_marker(pytest.mark.skip(reason="of POSIX only"))
        if not LAWS.isdisjoint(item.path.parents):
            item.add_marker("law")
    items.sort(key=lambda item: item.path.name != "test_site.py")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Use two processes for folders, and this one for files and single tests."""
    if all(".py" in argument for argument in config.args):
        config.option.dist = "no"
        return 0
    return 2


def _cpu_seconds() -> float:
    return sum(os.times()[:4])


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Keep the CPU time of each test, with that of processes that it started and waited for."""
    begun = _cpu_seconds()
    item.user_properties.append(("cpu_seconds", begun))
    yield


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo) -> None:
    if call.when == "teardown":
        item.user_properties[0] = (
            "cpu_seconds",
            _cpu_seconds() - item.user_properties[0][1],
        )


class SlowTests:
    """Writes the tests that took more than two CPU seconds."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seconds = dict[str, float]()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "teardown" and report.nodeid.startswith("tests/"):
            self.seconds[report.nodeid] = dict(report.user_properties)["cpu_seconds"]

    def pytest_sessionfinish(self) -> None:
        rows = [
            (test, seconds) for test, seconds in self.seconds.items() if seconds > 2.0
        ]
        with self.path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(("test", "cpu_seconds"))
            writer.writerows((test, f"{seconds:.1f}") for test, seconds in sorted(rows))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--write-slow",
        action="store_true",
        help="write tests/slow.csv: run it with -m '' and kernels that are ready",
    )
    parser.addoption(
        "--validation-table",
        metavar="CSV",
        help="write the values that tests compare with others",
    )
    parser.addoption(
        "--as-elsewhere",
        action="store_true",
        help="take away what Windows does not have (tests/elsewhere)",
    )
    parser.addoption(
        "--last-bits",
        metavar="K",
        type=int,
        default=0,
        help="multiply all ground motions by 1 + K 1e-13: no test may depend on last bits",
    )


def pytest_configure(config: pytest.Config) -> None:
    change_last_bits(config.getoption("--last-bits", 0))
    if config.getoption("--write-slow", False) and not hasattr(config, "workerinput"):
        config.pluginmanager.register(SlowTests(SLOW))
    path = config.getoption("--validation-table", None)
    if path and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Writer(Path(path)))


def change_last_bits(k: int) -> None:
    """Multiply the ground motions of all simulations in this process by 1 + `k` 1e-13."""
    simulation: Any = import_module("archfrag.simulation.simulate")
    exact = simulation.ground_of

    def changed(*given: Any) -> Any:
        ground = exact(*given)
        names = ("horizontal", "vertical", "apart")
        waves = {name: getattr(ground, name) for name in names}
        return ground._replace(
            **{
                name: None if wave is None else (1.0 + k * STEP) * wave
                for name, wave in waves.items()
            }
        )

    if k:
        simulation.ground_of = changed
