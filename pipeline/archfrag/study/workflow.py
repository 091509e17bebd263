"""One command for an entire study: Snakemake, started, stopped, resumed; a study to start from."""

import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from archfrag.errors import ArchfragError, OutputError
from archfrag.files import cannot_write, printable
from archfrag.study import tree
from archfrag.study.checks import STUDY_FILE, check_start, refuse_foreign_results
from archfrag.study.config import Study, dump_study, study_schema
from archfrag.study.files import PACKAGE, check_own, make_folder, replacing, write_text
from archfrag.study.provenance import available_cores
from archfrag.study.steps import stale_steps
from archfrag.study.tree import Lock, only_run

LOGS = "logs"
SNAKEMAKE_LOG = "snakemake.log"
_OF_SNAKEMAKE = (".snakemake", "benchmarks", "cache")  # begun anew: it writes in their place
ORIGIN = "study_file.txt"  # relative to the output, so that both may be moved together
_EXIT = re.compile(r"^archfrag: error: (?P<message>.*?) \[exit code (?P<code>\d+)\]$", re.M | re.S)
_MOST_LINES = 8


def shipped_folder() -> Path:
    """Folder with Snakefile, rules and records: the checkout, or one of the installed package."""
    for folder in (PACKAGE.parents[1], PACKAGE / "workflow"):
        if (folder / "Snakefile").is_file() and (folder / "pipeline" / "rules").is_dir():
            return folder
    raise OutputError(f"{PACKAGE}: this installation has no Snakefile; install archfrag again")


def snakefile() -> Path:
    """The Snakefile of the checkout or of the installed package."""
    return shipped_folder() / "Snakefile"


@contextlib.contextmanager
def step_log(path: Path | None) -> Iterator[Callable[[str], None]]:
    """Report on stderr and in a log; an error goes to the log with its exit code."""
    lines: list[str] = []
    inside = tree.INSIDE in os.environ and path is not None

    def note(text: str) -> None:
        if os.environ.get(tree.INSIDE) != "quiet":
            print(f"archfrag: {printable(text)}", file=sys.stderr, flush=True)
        lines.append(f"archfrag: {text}\n")

    try:
        yield note
    except ArchfragError as error:
        lines.append(f"archfrag: error: {error} [exit code {error.exit_code}]\n")
        # The run above reports what stands in this log, once.
        setattr(error, "reported", inside)  # noqa: B010
        raise
    except BaseException as error:
        lines.append(traceback.format_exc())
        if inside and isinstance(error, Exception):
            sys.exit(1)
        raise
    finally:
        if path is not None:
            with contextlib.suppress(OSError, OutputError):
                path.parent.mkdir(parents=True, exist_ok=True)
                text = "".join(lines).encode(errors="backslashreplace")
                if path.exists() and not path.is_file():  # such as /dev/stdout
                    path.write_bytes(text)
                else:
                    with replacing(path, lasting=False) as temporary:
                        temporary.write_bytes(text)


@dataclass(frozen=True)
class RunOptions:
    """How a study is run."""

    resume: bool = False  # go on where a run was stopped
    cores: int | None = None  # all that this process may use if None
    # Snakemake profile, such as ``configs/profiles/slurm``; then `cores` is its business.
    profile: Path | None = None
    quiet: bool = False  # nothing but errors
    typed: str = "archfrag run STUDY"  # the command, for the message that states what to type
    study_file: Path = Path("study.yaml")


def run_study(study: Study, options: RunOptions, stop: tree.Stop) -> bool:
    """Bring all results of a study up to date; where they are, nothing is written."""
    check_own(study)
    refuse_foreign_results(study)
    origin = _refuse_another_file(study, options.study_file)
    if not stale_steps(study)[0]:
        return False
    check_start(study)
    make_folder(study.work)
    with only_run(study) as lock:
        if not options.resume:
            lock.refuse_stopped(study.folder, options.typed)
        write_text(study.work / ORIGIN, origin)
        stale, changed = stale_steps(study)
        if not stale:
            return False
        if changed and not options.quiet:
            _print_changes(changed)
        write_text(study.work / STUDY_FILE, dump_study(study))
        for name in (LOGS, *_OF_SNAKEMAKE):
            shutil.rmtree(study.work / name, ignore_errors=True)
        make_folder(study.work / LOGS)
        if _snakemake(study, options, lock, stop) != 0:
            raise _failure(study.work / LOGS)
        stale, changed = stale_steps(study)
        if stale:
            what = f"{(changed or stale)[0]}, while the run was at work"
            raise ArchfragError(f"{study.folder}: {what}; the same command makes it again")
    return True


def _refuse_another_file(study: Study, path: Path) -> str:
    """See that the results are not those of a study file beside this one with the same id.

    Returned is the place of the file relative to the results.
    """
    origin = study.work / ORIGIN
    if origin.is_file():
        before = study.folder / origin.read_text(encoding="utf-8")
        if before.is_file() and not before.samefile(path):
            raise OutputError(
                f"{study.folder}: holds the results of {before.resolve()}, which has the id "
                f"{study.id!r} too; give {path.name} another id or output"
            )
    return os.path.relpath(path.resolve(), study.folder.resolve())


def _print_changes(changed: Sequence[str]) -> None:
    for line in changed[:_MOST_LINES]:
        print(f"archfrag: {printable(line)}", file=sys.stderr)
    if len(changed) > _MOST_LINES:
        print(f"archfrag: … and {len(changed) - _MOST_LINES} more", file=sys.stderr)
    kept = "finished runs that are still what they were are kept"
    print(f"archfrag: what follows from it is made anew; {kept}", file=sys.stderr, flush=True)


def _snakemake(study: Study, options: RunOptions, lock: Lock, stop: tree.Stop) -> int:
    command = [
        # No module and no profile of the current folder, which may be somebody else's.
        sys.executable, "-P", "-m", "snakemake", "--snakefile", str(snakefile()),
        "--workflow-profile", "none",
        "--directory", str(study.work), "--nocolor", "--nolock", "--rerun-incomplete",
        "--config", f"study={STUDY_FILE}", f"quiet={int(options.quiet)}",
    ]  # fmt: skip
    if options.profile is not None:
        command += ["--profile", str(options.profile.resolve())]
    if options.cores is not None or options.profile is None:
        command += ["--cores", str(options.cores or available_cores())]
    environment = {
        **os.environ,
        # Rules call `archfrag …`, also where the environment of this Python is not activated.
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]),
        tree.INSIDE: "quiet" if options.quiet else "full",
        tree.RUN: json.dumps(tree.identity()),
        # Snakemake keeps things in the user's cache, which need not be writable.
        "XDG_CACHE_HOME": str(study.work.absolute() / "cache"),
        tree.CACHE_HOME: os.environ.get("XDG_CACHE_HOME", ""),
        "PYTHONSAFEPATH": "1",
    }
    environment.pop("SNAKEMAKE_PROFILE", None)
    with open(study.work / LOGS / SNAKEMAKE_LOG, "x", encoding="utf-8") as log:
        # Steps report on their standard output (2>&1 in the rules), Snakemake into its log.
        with stop.held():
            process = tree.start(
                command, env=environment, stdin=subprocess.DEVNULL, stdout=2, stderr=log,
                cwd=study.work,  # Snakemake looks for modules in .snakemake of where it starts
            )  # fmt: skip
        try:
            while process.poll() is None:
                stop.check()
                lock.beat()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(timeout=0.2)
        finally:
            tree.end(process)
    return int(process.returncode)


def _failure(logs: Path) -> ArchfragError:
    """Message of the step that failed, by its log; or else Snakemake, by its own."""
    paths = sorted(logs.glob("*.log"))
    texts = {path: path.read_text(encoding="utf-8", errors="replace") for path in paths}
    for text in texts.values():
        if found := _EXIT.search(text):
            error = ArchfragError(found["message"])
            error.exit_code = int(found["code"])
            return error
    for path, text in texts.items():
        if path.name != SNAKEMAKE_LOG and "Traceback (most recent call last)" in text:
            last = text.rstrip().splitlines()[-1]
            return ArchfragError(f"step {path.stem} failed: {last}; all of it is in {path}")
    path = logs / SNAKEMAKE_LOG
    reason = _reason(texts.get(path, ""))
    return ArchfragError(f"Snakemake failed: {reason}; its output is in {path}")


def _reason(text: str) -> str:
    """The line of Snakemake's log that states what is wrong."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    for pattern in (r"\w*(Error|Exception)\b", r"(Error|Failed|Exiting)\b", r"(?i).*\berror\b"):
        for number, line in enumerate(lines):
            if re.match(pattern, line):
                return " ".join(lines[number : number + 2])[:500]
    return lines[-1][:500] if lines else "it gave no reason"


SCHEMA = "study.schema.json"
RECORDS = "records"


def write_starter(folder: Path) -> Path:
    """Write a commented study file, its schema and the shipped motions; all of it or nothing."""
    folder = make_folder(folder)
    for name in (RECORDS, SCHEMA, STUDY_FILE):
        if os.path.lexists(folder / name):
            raise OutputError(f"{folder / name}: is there already; allowed is a folder without it")
    placed = []
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".init") as temporary:
            made = Path(temporary)
            unwanted = shutil.ignore_patterns("*.svg", "*.py")
            shutil.copytree(shipped_folder() / RECORDS, made / RECORDS, ignore=unwanted)
            (made / SCHEMA).write_text(study_schema())
            shutil.copyfile(PACKAGE / "study" / "templates" / STUDY_FILE, made / STUDY_FILE)
            for name in (RECORDS, SCHEMA, STUDY_FILE):
                os.rename(made / name, folder / name)
                placed.append(folder / name)
    except OSError as error:
        for path in placed:
            shutil.rmtree(path, ignore_errors=True)
            path.unlink(missing_ok=True)
        raise cannot_write(folder, error) from error
    return folder / STUDY_FILE
