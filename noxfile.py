"""Tasks of a contributor, in the environment that is active: `nox -l` lists them."""

import nox

nox.options.default_venv_backend = "none"
nox.options.sessions = ["tests", "lint"]


@nox.session
def tests(session: nox.Session) -> None:
    """Run the fast tests, or those that are named."""
    session.run("pytest", *session.posargs)


@nox.session
def full(session: nox.Session) -> None:
    """Run all tests, slow ones and the site included."""
    session.run("pytest", "-m", "", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Check style, types, layers, names and sizes."""
    session.run(".ci/lint", external=True)


@nox.session
def site(session: nox.Session) -> None:
    """Build the site in build/site; its cells run."""
    session.run("python", "-m", "sphinx", "-W", "--keep-going", "docs", "build/site")
