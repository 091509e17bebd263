"""Errors that archfrag raises on purpose.

Each has one message with the place, the value and what is allowed.
"""

from collections.abc import Callable
from importlib import import_module
from typing import TypeVar

Made = TypeVar("Made")


class ArchfragError(Exception):
    """Base class of all errors that archfrag raises on purpose.

    `exit_code` is the exit code of the command after such an error.
    """

    exit_code = 1


class InputError(ArchfragError):
    """Something the user gave cannot be used: a file, a key, a value, a geometry."""

    exit_code = 2


class RecordError(InputError):
    """A ground-motion record that cannot be read or used. The message names the file."""

    LONGEST = 900  # characters: what is quoted from a file may have any length

    def __init__(self, message: str) -> None:
        cut = len(message) > self.LONGEST
        super().__init__(f"{message[: self.LONGEST]} ..." if cut else message)


class GeometryError(InputError):
    """An arch that cannot exist. The message names the parameter and its value."""


class StabilityError(ArchfragError):
    """An arch that does not stand under its own weight."""

    exit_code = 3


class OutputError(ArchfragError):
    """Results that cannot be written where they were asked for; nothing half-written is left."""

    exit_code = 4


class WorkerError(ArchfragError):
    """The run stopped because workers were lost; finished parts are kept."""

    exit_code = 5


class FitError(ArchfragError):
    """Results from which no fragility curve can be estimated.

    The message says what the results do show. Each ``{}`` in it stands for one of `levels`, which
    are intensities in the unit of the fit.
    """

    exit_code = 6

    def __init__(self, message: str, *levels: float) -> None:
        self.message = message
        self.levels = levels
        super().__init__(self.worded())

    def worded(self, factor: float = 1.0, unit: str = "") -> str:
        """Return the message with each level divided by `factor` and followed by `unit`."""
        shown = [f"{level / factor:g} {unit}".rstrip() for level in self.levels]
        return self.message.format(*shown) if shown else self.message


class ServiceError(ArchfragError):
    """A data service that did not answer as it should; the same request may succeed later."""

    exit_code = 7


class UnitWarning(UserWarning):
    """A value so unusual that it may be in another unit than the documented one."""


def reason_of(error: Exception) -> str:
    """Return the first line of the message of an error of another library.

    If the message is empty, the name of its class is returned.
    """
    return [*str(error).strip().splitlines(), type(error).__name__][0]


def from_extra(module: str, extra: str):
    """Import a module of a package that comes with an extra of archfrag, and return it.

    If the package is not installed, InputError gives the command that installs `extra`.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            f"this needs the package {module.partition('.')[0]}, which is not installed; install "
            f'it with: pip install "archfrag[{extra}]", or in a checkout -e ".[{extra}]"'
        ) from error


def attempt(
    make: Callable[[], Made], worded: Callable[[FitError], str] = str
) -> Made | str:
    """Return what `make` returns, or the reason why it failed, as text.

    `worded` turns a `FitError` into text. Another error of archfrag gives its message. Any other
    error is described as an error in archfrag.
    """
    try:
        return make()
    except FitError as error:
        return worded(error)
    except ArchfragError as error:
        return str(error)
    except Exception as error:
        # After all simulations a report without one part is better than none.
        kind = type(error).__name__
        return f"{kind}: {error}; this is an error in archfrag: please report it"
