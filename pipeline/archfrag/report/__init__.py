"""One offline page of what a study found and how it was found."""

from pathlib import Path


def make_report(study, *given) -> Path:
    """Write the report of a finished study and return its path; `page.make_report` says more."""
    # jinja2 and scipy, which other commands do without
    from archfrag.report import page

    return page.make_report(study, *given)
