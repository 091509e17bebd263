"""Earthquake records to collapse probabilities of masonry arches.

Its stub lists what it offers, which is imported when it is asked for.
"""

import warnings

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str):
    """Import what is asked for; deprecations in the libraries that it needs are not the user's."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        value = globals()[name] = _load(name)
    return value
