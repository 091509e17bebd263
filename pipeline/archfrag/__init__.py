"""Earthquake records to collapse probabilities of masonry arches.

The stub of this module lists the public names. Each is imported when it is first used.
"""

import warnings

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str):
    """Import a public name when it is first used, and return it.

    Deprecation warnings of other libraries are hidden meanwhile: they are not the user's.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        value = globals()[name] = _load(name)
    return value
