"""A study in Python: the keys of a study file, given as objects, and its run; fits of tables."""

from __future__ import annotations

import contextlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import escape
from numpy.typing import ArrayLike

from archfrag.api.results import PathLike, Results
from archfrag.arch import Arch
from archfrag.errors import InputError, OutputError
from archfrag.files import (
    Named,
    check_targets,
    counted,
    make_folder,
    read_text,
    sha256_of,
)
from archfrag.motions.channel import filled
from archfrag.motions.index import INDEX_NAME, write_index
from archfrag.motions.measures import measure_unit
from archfrag.motions.motion import Motion
from archfrag.properties import VARIABLE
from archfrag.report import make_report
from archfrag.study.answer.fits import fit_runs
from archfrag.study.answer.outside import read_runs
from archfrag.study.file import schema
from archfrag.study.keys import check_text
from archfrag.study.provenance import digest_of, write_text
from archfrag.study.reading import MotionList
from archfrag.study.steps import run_study
from archfrag.study.yaml_text import LARGEST_FILE, relative, yaml_of
from archfrag.version import __version__

Keys = Mapping[str, Any]  # of a study file
Arches = Arch | Keys | Sequence[Arch]
Motions = Motion | PathLike | Sequence[Any] | Keys
Levels = ArrayLike | Mapping[str, float]
# Facts of a motion that its row of an index keeps.
_FACTS = (
    "event",
    "station",
    "component",
    "Mw",
    "distance_km",
    "Vs30_mps",
    "level",
    "unit_in_file",
    "start_time",
    "origin_time",
)
_COLUMNS = ("", "acceleration=1", "acceleration=1 vertical=2")  # by their number
_CONTENT = "# Content: "
_NAMED = 3  # arches in a heading
_OTHER_ORDER = (
    "was changed twice in one way, or in an order that a study file cannot state: the study would "
    "run another arch; change it at most once by each of Bridge, filled, recessed, jointed or "
    "crushed, and move_springing, in this order, and last by tied"
)
_HEAD = "# Written by archfrag {version}. Run it with: archfrag run {name}\n"


class Study:
    """Study of arches under motions that are scaled to levels, as in a study file.

    Arguments are keys of a study file, listed in docs/study_file.md, or objects in their place.

    Parameters
    ----------
    arch : Arch, mapping of names to arches, or list of arches
        Arches of a list are named arch1, arch2, ... A mapping of keys is an arch too.
    motions : Motion, path, sequence of either, or mapping
        Paths may be patterns with * and ?, or an ``index.csv``. A mapping has the keys of
        `motions`. Verticals of Motion objects are used.
    measure : str
        Intensity measure, such as PGA, PGV or Sa(0.5).
    levels : sequence of float, or mapping of start, stop and count
        Intensities that the motions are scaled to.
    unit : str, optional
        Unit of the levels; if not given, g for accelerations, else m/s or m.
    design : "stripes", "ida", "cloud", or mapping of `kind` and settings
    vary : mapping, optional
        Number of `samples`, and the distribution of each key that varies.
    hazard : path or mapping, optional
        Hazard curve of the site, for the rate of collapse; a mapping has the keys of `risk`.
    id, title : str, optional
        Name of the study, whose results are in results/ID (made of its content if not given);
        heading of its report.
    **keys
        Other keys of a study file: method, limit_states, report, execution, institution, output.

    Raises
    ------
    InputError
        If a study file cannot state an argument, such as an Arch recessed twice.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> wave = np.sin(np.arange(200) / 10.0) * np.hanning(200)
    >>> motions = [af.Motion(factor * wave, 0.01, id=f"wave{factor}") for factor in (1, 2)]
    >>> study = af.Study(af.Block(0.4, 2.0, 0.8), motions, levels=[0.2, 0.6, 1.8], id="block")
    >>> study
    <Study 'block': 1 arch, stripes at 3 levels of PGA from 0.2 to 1.8 g>
    >>> study.to_file("block.yaml").name
    'block.yaml'
    """

    def __init__(
        self,
        arch: Arches,
        motions: Motions,
        measure: str = "PGA",
        *,
        levels: Levels,
        unit: str | None = None,
        design: str | Keys = "stripes",
        vary: Keys | None = None,
        hazard=None,
        id: str | None = None,
        title: str | None = None,
        **keys,
    ) -> None:
        for key, own in (("arches", "arch"), ("intensity", "measure, levels and unit")):
            if key in keys:
                raise InputError(f"Study: {key} cannot be given; give {own}")
        self._motions, found = _motions(motions)
        if isinstance(levels, np.ndarray):  # as a person would have typed them
            if (
                levels.dtype.kind not in "iuf"
                or levels.ndim > 1
                or np.ma.is_masked(levels)
            ):
                raise InputError(f"Study: levels = {levels!r} must be a row of numbers")
            levels = [float(f"{level:.12g}") for level in levels.ravel().tolist()]
        if vary is not None and not isinstance(vary, Mapping):
            raise InputError(
                f"Study: vary is {type(vary).__name__}; it must be a mapping of "
                "samples and, by key, its distribution"
            )
        if unit is None:
            unit = "g"
            with contextlib.suppress(
                InputError
            ):  # which the schema words, with the key
                unit = next(iter(schema.LEVEL_UNITS.get(measure_unit(measure), "g")))
        arches = _arches(arch, id or "arch", vary)
        heading = "Fragility of the arch"
        if arches[1:]:
            heading = f"Fragility of {', '.join(str(e['id']) for e in arches[:_NAMED])}"
        if arches[_NAMED:]:
            heading += f" and {len(arches) - _NAMED} more"
        given = {
            "title": title or id or heading,
            "arches": arches,
            "motions": found,
            "intensity": {"measure": measure, "unit": unit, "levels": levels},
            "design": {"kind": design} if isinstance(design, str) else design,
            **keys,
        }
        if isinstance(hazard, Mapping):
            given["risk"] = hazard
        elif hazard is not None:
            given["risk"] = {"hazard": hazard}
        plain = json.loads(json.dumps(given, default=_plain))
        self._content = digest_of([plain, list(map(_digest_of_motion, self._motions))])
        plain["id"] = f"study-{self._content[:8]}" if id is None else id
        check_text(plain, "Study")
        self._keys = schema.study_of(plain, Path.cwd(), "Study")
        for entry, each in zip(self._keys.arches, _named(arch, "arch").values()):
            # To the last bit what is built of its keys.
            pairs: Any = (
                zip(each.chain, entry.build().chain) if isinstance(each, Arch) else ()
            )
            if not all(np.array_equal(*pair) for pair in pairs):
                raise InputError(f"Study: arch {entry.id} {_OTHER_ORDER}")
        self._file: Path | None = None

    @classmethod
    def from_file(cls, path: PathLike) -> Study:
        """Read a study file in YAML; InputError names the key that is wrong."""
        study = cls.__new__(cls)
        study._file = Path(path)
        study._motions = ()
        study._content = ""
        study._keys = schema.load_study(Path(path))
        return study

    @property
    def id(self) -> str:
        """Name of the study."""
        return self._keys.id

    @property
    def folder(self) -> Path:
        """Folder of the results."""
        return self._keys.folder

    def to_file(self, path: PathLike) -> Path:
        """Write a study file that anybody can run, and that gives the same results to the bit.

        Motions that were given as objects go into a folder beside it, as text with all digits.
        Other files stay where they are, and their paths are relative to the new file. The results
        will be in results/ID beside the new file. OutputError if a file cannot be written.
        """
        path = Path(path)
        keys = self._keys.model_dump(exclude_unset=True)
        place = path.parent.resolve() / f"{path.stem}-motions"
        made = [place / f"motion{n + 1}.txt" for n in range(len(self._motions))]
        check_targets([path, place / INDEX_NAME if made else None, *made])
        folder = make_folder(path.parent).resolve()
        if folder != self.folder.resolve():
            del keys["output"]
        if self._motions:
            make_folder(place)
            keys["motions"]["index"] = str(_write_motions(self._motions, place))
        text = yaml_of(relative(keys, folder))
        head = _HEAD.format(version=__version__, name=path.name)
        write_text(
            path, head + f"{_CONTENT}{self._content}\n" * bool(self._content) + text
        )
        return path

    def run(
        self,
        progress: bool = True,
        cores: int | None = None,
        *,
        workers: int | None = None,
        replace: bool = False,
    ) -> Results:
        """Run what is missing of the study, as `archfrag run` does, and open its results.

        If there is a current dask client and no number of cores is given, its workers make the
        runs; else threads of this process make them.

        Parameters
        ----------
        progress : bool
            Show what is done, with a progress bar.
        cores, workers : int, optional
            Number of threads, by either name; all cores by default.
        replace : bool
            Replace the results of another study with this id. Runs that both have are kept.

        Returns
        -------
        Results

        Raises
        ------
        OutputError
            If the folder holds the results of another study with this id.
        ArchfragError
            Of the step that failed. What is finished is kept: call `run` again to continue.
        """
        if None not in (cores, workers) and cores != workers:
            raise InputError(
                f"cores = {cores} and workers = {workers} are one number; give one"
            )
        path = self._file
        if path is None:
            path = self.folder / "study.yaml"
            if not replace and _content_of(path) not in ("", self._content):
                raise OutputError(
                    f"{self.folder}: holds the results of another study with the id {self.id!r}; "
                    "give this one another id, or replace them by .run(replace=True)"
                )
            self.to_file(path)
        study = schema.load_study(path)
        cores = workers if cores is None else cores
        run_study(study, path, lambda: None, make_report, cores, quiet=not progress)
        return Results(study)

    def __repr__(self) -> str:
        keys = self._keys
        levels = keys.intensity.given
        ends = f"from {levels[0]:g} to {levels[-1]:g} {keys.intensity.unit}"
        return (
            f"<Study {self.id!r}: {counted(len(keys.members), 'arch')}, {keys.design.kind} at "
            f"{counted(len(levels), 'level')} of {keys.intensity.measure} {ends}>"
        )

    def _repr_html_(self) -> str:
        keys = self._keys
        asked = self._keys.motions
        named = [each.id for each in self._motions] or [
            each.path for each in asked.files
        ]
        lists = {
            "arches": [entry.id for entry in keys.arches],
            "motions": named,
            "index": [] if self._motions or not asked.index else [asked.index],
            "results": [str(self.folder)],
        }
        lines = (
            f"<br>{name}: {escape(', '.join(of))}" for name, of in lists.items() if of
        )
        return f"<p><b>{escape(repr(self)[1:-1])}</b>{''.join(lines)}</p>"


def fit(
    table,
    columns: Mapping[str, str] | None = None,
    measure: str | None = None,
    unit: str | None = None,
    states: Sequence[str] = (),
    confidence: float = 0.9,
    output: PathLike | None = None,
) -> Results:
    """Fit fragility curves to verdicts of any program or experiment, as those of a study.

    Parameters
    ----------
    table : path, DataFrame, or what makes one
        A row for each run, with columns record, event, intensity and verdict (collapsed or
        survived, 1 or 0; unfinished or failed if it shows neither); or for each record, with
        lower and upper: the highest level that stood and the lowest that collapsed, one of which
        may be empty. Without a column record, each row has a motion of its own. Runs of several
        structures have a column arch.
    columns : dict, optional
        Names of columns by what they hold, such as ``{"intensity": "PGA", "verdict": "fell"}``.
    measure, unit : str, optional
        Intensity measure and its unit, if the column's name does not state them as ``PGA [g]``
        does.
    states : sequence of str
        Damage states in a column damage state, in order from none to collapse.
    confidence : float
        Confidence of all bands and intervals.
    output : path, optional
        Folder for the report; results/NAME of the table if not given.

    Raises
    ------
    InputError
        If a row cannot be used; it names row, column, value and what is allowed.

    Examples
    --------
    >>> import archfrag as af
    >>> fell = [0, 0, 1, 0, 1, 1, 0, 1]
    >>> tests = {"PGA [g]": [0.1, 0.2, 0.25, 0.3, 0.35, 0.5, 0.28, 0.6], "verdict": fell}
    >>> af.fit(tests).curve
    <Curve structure: median 0.292 g PGA (90 %: 0.190–0.436), dispersion 0.37 (0.14–1.14)>
    """
    study, cube = read_runs(table, columns, measure, unit, states, confidence, output)
    return Results(study, fit_runs(study, cube))


def _named(arch, name: str) -> Keys:
    """Return arches by name; a single one gets `name`, those of a list arch1, arch2, ..."""
    if isinstance(arch, list | tuple):
        arch = {f"arch{number}": each for number, each in enumerate(arch, start=1)}
    several = (
        isinstance(arch, Mapping) and not {"profile", "drawing", "table"} & arch.keys()
    )
    return arch if several else {name: arch}


def _arches(arch, name: str, vary: Keys | None) -> list[Any]:
    """Return the entries of a study file for arches; `name` is for a single one."""
    arch = _named(arch, name)
    entries = []
    for name, each in arch.items():
        if not isinstance(each, Arch | Mapping):
            raise InputError(
                f"Study: arch is {type(each).__name__}; it must be an Arch, a mapping "
                "of names to arches, or a mapping of an arch's keys"
            )
        given = each.parameters if isinstance(each, Arch) else each
        entries.append({"id": name} | {k: v for k, v in given.items() if v is not None})
        if vary is not None:
            of = {key: law for key, law in vary.items() if key in VARIABLE}
            others = {key: value for key, value in vary.items() if key not in of}
            entries[-1]["vary"] = others | (
                {"of": {**others.get("of", {}), **of}} if of else {}
            )
    return entries


def _motions(given) -> tuple[tuple[Motion, ...], Named]:
    """Return the motion objects, and the block `motions` of a study file."""
    if isinstance(given, MotionList) and given.asked is not None:
        given = given.asked.model_dump(exclude_unset=True)
    if isinstance(given, Mapping):
        return (), dict(given)
    if isinstance(given, Motion | str) or not isinstance(given, Iterable):
        given = [given]
    each: list[Any] = [*given]
    if each and all(isinstance(one, str | os.PathLike | Mapping) for one in each):
        index = not isinstance(each[0], Mapping) and Path(each[0]).name == INDEX_NAME
        return (), {"index": each[0]} if index and len(each) == 1 else {"files": each}
    if not each or not all(isinstance(one, Motion) for one in each):
        names = dict.fromkeys(type(one).__name__ for one in each)
        raise InputError(
            f"Study: motions hold {', '.join(names) or 'nothing'}; they must be Motion objects, "
            "or paths, or a mapping"
        )
    for name, times in Counter(one.id for one in each if one.id).items():
        if times > 1:
            raise InputError(
                f"Study: several motions have the id {name!r}; each needs its own"
            )
    count = sum(one.vertical is not None for one in each)
    if 0 < count < len(each):
        raise InputError(
            f"Study: {count} of {len(each)} motions have a vertical component; all of them must "
            "have one, or none"
        )
    # The index is that which `to_file` writes.
    return tuple(each), {"index": INDEX_NAME, "vertical": count > 0}


def _write_motions(motions: Sequence[Motion], folder: Path) -> Path:
    """Write motions as text with all digits, and their index; return the path of the index."""
    rows = []
    for number, motion in enumerate(motions, start=1):
        path = folder / f"motion{number}.txt"
        parts = [
            each for each in (motion.acceleration, motion.vertical) if each is not None
        ]
        lines = (" ".join(map(repr, row)) for row in np.column_stack(parts).tolist())
        write_text(path, "\n".join(lines) + "\n")
        facts = {name: motion.metadata.get(name) for name in _FACTS}
        source = motion.facts.source_sha256 or motion.facts.file_sha256
        rows.append(
            {
                **filled(facts | {"source_sha256": source}),
                "id": motion.id or path.stem,
                "file": path.name,
                "unit": "m/s2",
                "sha256": sha256_of(path),
                "columns": f"{_COLUMNS[len(parts)]} dt={motion.dt!r}",
                # Who made the object has seen its numbers.
                "accept": "pga time_step",
            }
        )
    return write_index(folder, rows)


def _plain(value):
    """Return a value as a study file has it: an array as a list, a path as text.

    InputError for any other value that JSON does not know.
    """
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise InputError(f"Study: {value!r} cannot be written to a study file")


def _digest_of_motion(motion: Motion) -> str:
    """Return the digest of all that a study takes from a motion."""
    parts = {
        name: sha256(part.tobytes()).hexdigest()
        for name, part in motion.components.items()
    }
    named = (*_FACTS, "source_sha256", "file_sha256")
    facts = {name: str(motion.metadata.get(name)) for name in named}
    return digest_of([motion.id, motion.dt, parts, facts])


def _content_of(path: Path) -> str:
    """Return the digest of the content of a study, from the file that it wrote.

    It is empty if the file cannot be read, and "unknown" if it states no digest.
    """
    try:
        lines = read_text(path, LARGEST_FILE, InputError, "the study file").splitlines()
    except InputError:
        return ""
    known = [line.removeprefix(_CONTENT) for line in lines if line.startswith(_CONTENT)]
    return known[0] if known else "unknown"
