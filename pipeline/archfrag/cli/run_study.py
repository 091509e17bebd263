"""The command `run`, which imports little if there is nothing to do."""

from pathlib import Path

from archfrag.cli.options import (
    command,
    cores_option,
    option,
    point_to_report,
    takes,
    takes_study,
    warn,
)


@command()
@takes_study
@takes(
    option(
        "--resume", bool, "Continue a stopped run; the command also does so without it."
    ),
    cores_option,
    option("--quiet", bool, "Print errors only."),
)
def run(
    study_file: Path,
    overrides: tuple[str, ...],
    quiet: bool,
    resume: bool,
    cores: int | None,
) -> None:
    """Run a study, or continue it, from records to report.

    The steps are motions, simulations, cube, curves and report. After Ctrl-C, a kill or a full
    disk the same command continues.
    """
    if not quiet:  # before the imports, which take a second or more
        warn(f"reading {study_file}")
    from archfrag.study.provenance import finished_folder
    from archfrag.study.yaml_text import read_keys

    folder = finished_folder(study_file, *read_keys(study_file, overrides))
    if folder is None:
        # what has nothing to do imports none of this
        from archfrag.cli.study import run_all

        run_all(study_file, overrides, cores, quiet)
    elif not quiet:
        point_to_report(folder, folder if overrides else study_file, False)
