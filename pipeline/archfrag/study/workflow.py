"""One command for a whole study: Snakemake, started, resumed and translated."""

import contextlib
import fcntl
import os
import re
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO

from archfrag.errors import ArchfragError, OutputError
from archfrag.study.checks import STUDY_FILE, check_output
from archfrag.study.config import Study, dump_study
from archfrag.study.files import PACKAGE, cannot_write, make_folder, sweep, write_text
from archfrag.study.provenance import available_cores
from archfrag.study.records import find_sources

LOGS = "logs"
_INSIDE = "ARCHFRAG_INSIDE_RUN"
_EXIT = re.compile(r"^archfrag: error: (?P<sentence>.*) \[exit code (?P<code>\d+)\]$", re.M)


def snakefile() -> Path:
    """The Snakefile: of the checkout, or the one inside the installed package.

    Raises
    ------
    OutputError
        If there is neither.
    """
    for path in (PACKAGE.parents[1] / "Snakefile", PACKAGE / "workflow" / "Snakefile"):
        if path.is_file() and (path.parent / "pipeline" / "rules").is_dir():
            return path
    raise OutputError(f"{PACKAGE}: this installation has no Snakefile; install archfrag again")


@contextlib.contextmanager
def step_log(path: Path | None) -> Iterator[Callable[[str], None]]:
    """Say things on stderr and in a log; an error goes to the log with its exit code.

    Yields
    ------
    callable
        Takes one line of text.
    """
    lines: list[str] = []

    def say(text: str) -> None:
        if os.environ.get(_INSIDE) != "quiet":
            print(f"archfrag: {text}", file=sys.stderr, flush=True)
        lines.append(f"archfrag: {text}\n")

    try:
        yield say
    except ArchfragError as error:
        lines.append(f"archfrag: error: {error} [exit code {error.exit_code}]\n")
        # The run above tells what this log says, once.
        setattr(error, "told", _INSIDE in os.environ and path is not None)  # noqa: B010
        raise
    except BaseException:
        lines.append(traceback.format_exc())
        raise
    finally:
        if path is not None:
            with contextlib.suppress(OSError):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("".join(lines), encoding="utf-8")


def run_study(
    study: Study,
    *,
    resume: bool = False,
    cores: int | None = None,
    profile: Path | None = None,
    quiet: bool = False,
    typed: str = "archfrag run STUDY",
) -> Path:
    """Bring all results of a study up to date.

    Parameters
    ----------
    study : Study
    resume : bool
        Go on where a killed run stopped.
    cores : int, optional
        All that this process may use if not given.
    profile : Path, optional
        Snakemake profile, such as ``configs/profiles/slurm``; then `cores` is its business.
    quiet : bool
        Nothing but errors.
    typed : str
        The command, for the sentence that says what to type.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    StudyError, RecordError
        If records are missing.
    OutputError
        If the output cannot be written or is another study's, another run is at work in it, or
        an earlier run was killed and `resume` is not given.
    ArchfragError
        What stopped a step, with its exit code.
    """
    check_output(study)
    find_sources(study)
    make_folder(study.folder / LOGS)
    with _only_run(study) as lock:
        if _was_killed(study.folder):
            if not resume:
                raise OutputError(
                    f"{study.folder}: an earlier run was stopped in the middle; type "
                    f"`{typed} --resume` to go on"
                )
            _snakemake(study, ["--cores", "1", "--unlock"], lock, quiet=True)
            sweep(study.folder)
        write_text(study.folder / STUDY_FILE, dump_study(study))
        share = ["--profile", str(profile.resolve())] if profile is not None else []
        if cores is not None or profile is None:
            share += ["--cores", str(cores or available_cores())]
        started = time.time()
        code = _snakemake(study, [*share, "--rerun-incomplete"], lock, quiet)
        if code != 0:
            raise _failure(study.folder, started)
    return study.folder / "report.html"


@contextlib.contextmanager
def _only_run(study: Study) -> Iterator[IO[str]]:
    """Lock of the output folder, held until the last of the run's processes is gone."""
    path = study.folder / ".archfrag.lock"
    try:
        lock = open(path, "a")  # noqa: SIM115
    except OSError as error:
        raise cannot_write(path, error) from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"{study.folder}: another run of study {study.id!r} is at work here; wait for it "
                "or stop it"
            ) from None
        yield lock


def _was_killed(folder: Path) -> bool:
    state = folder / ".snakemake"
    return any(
        any((state / name).iterdir())
        for name in ("locks", "incomplete")
        if (state / name).is_dir()
    )


def _snakemake(study: Study, options: Sequence[str], lock: IO[str], quiet: bool) -> int:
    command = [
        sys.executable, "-m", "snakemake", "--snakefile", str(snakefile()),
        "--directory", str(study.folder), "--quiet", "all", "--nocolor",
        "--config", f"study={STUDY_FILE}", f"quiet={int(quiet)}", *options,
    ]  # fmt: skip
    # Rules say `archfrag …`, also where the environment of this Python is not activated.
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    log = study.folder / LOGS / "snakemake.log"
    with open(log, "a", encoding="utf-8") as file:
        return subprocess.run(
            command,
            env={**os.environ, "PATH": path, _INSIDE: "quiet" if quiet else "told"},
            pass_fds=[lock.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=file,
        ).returncode


def _failure(folder: Path, started: float) -> ArchfragError:
    """What the step that failed had to say, by its log."""
    for path in sorted((folder / LOGS).glob("*.log")):
        if path.stat().st_mtime >= started - 1.0:
            found = _EXIT.search(path.read_text(encoding="utf-8", errors="replace"))
            if found:
                error = ArchfragError(found["sentence"])
                error.exit_code = int(found["code"])
                return error
    return ArchfragError(
        f"{folder}: a step failed; its log is in {folder / LOGS}, Snakemake's in "
        f"{folder / '.snakemake' / 'log'}"
    )
