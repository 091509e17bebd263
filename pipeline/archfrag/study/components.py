"""The components of a study's records: which files hold them, read together and processed."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archfrag.errors import InputError, RecordError
from archfrag.motions.index import IndexEntry
from archfrag.motions.partners import VERTICAL, folder_names, partners, vertical_files
from archfrag.study.config import Study
from archfrag.study.processing import Step, apply_step

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion
    from archfrag.study.records import Source

_ROTATED = "RotD"


def needs_pairs(study: Study) -> bool:
    """Whether both horizontal components of a record are needed at once."""
    steps = [step.name for step in study.motions.processing]
    return "rotate" in steps or study.intensity.measure.strip().startswith(_ROTATED)


def without_verticals(sources: Sequence["Source"]) -> list["Source"]:
    """Sources without those that hold but the vertical component of another one's record."""
    rows = [source.entry for source in sources if source.entry is not None]
    paths = {source.path for source in sources}
    verticals = vertical_files(sorted(paths)) if len(paths) > 1 else set()
    return [
        source
        for source in sources
        if source.path not in verticals
        and not (
            source.entry is not None
            and _is_vertical(source.entry)
            and _row_beside(source.entry, [row for row in rows if not _is_vertical(row)])
        )
    ]


def with_partners(
    sources: Sequence["Source"], study: Study, rows: Sequence[IndexEntry]
) -> list["Source"]:
    """Sources with the files of the components that belong to them, as far as they are asked for.

    A row of the index with the same event and station comes before a file of nearly the same
    name; what is in the record's own file comes before both when it is read.
    """
    pairs, vertical = needs_pairs(study), study.motions.vertical
    if not pairs and not vertical:
        return list(sources)
    folders = {
        folder: partners(folder_names(folder)) for folder in {s.path.parent for s in sources}
    }
    found = []
    for source in sources:
        by_name = folders[source.path.parent]
        files: list[Path | None] = []
        for kind, asked in ((False, pairs), (True, vertical)):
            of_kind = [row for row in rows if _is_vertical(row) == kind]
            row = _row_beside(source.entry, of_kind) if source.entry is not None else None
            name = by_name[kind].get(source.path.name)
            path = row.path if row else source.path.with_name(name) if name else None
            files.append(path if asked else None)
        found.append(replace(source, beside=files[0], upward=files[1]))
    return found


def _is_vertical(row: IndexEntry) -> bool:
    return VERTICAL.fullmatch(str(row.metadata.get("component") or "")) is not None


def _row_beside(row: IndexEntry, rows: Sequence[IndexEntry]) -> IndexEntry | None:
    """The one other row of the same event and station."""
    keys = ("event", "station")
    own = [str(row.metadata.get(key) or "") for key in keys]
    if not all(own):
        return None
    others = (other for other in rows if other is not row)
    alike = [o for o in others if [str(o.metadata.get(key) or "") for key in keys] == own]
    return alike[0] if len(alike) == 1 else None


class Components:
    """Reads the sources of a study one after the other and does to them what it asks for."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.steps: tuple[Step, ...] = study.motions.processing
        self._pairs = needs_pairs(study)
        self._rotated: set[frozenset[tuple[str, str]]] = set()
        self._left_out: dict[Any, str] = {}
        self._kept: set[Any] = set()

    def read(self, source: "Source") -> Iterator["Motion"]:
        """The motions of a source."""
        motions = _read(source)
        others = tuple(motions) if self._pairs else ()
        while motions:
            motion = motions.pop(0)
            if not self._chosen(motion, source):
                continue
            motion = self._complete(motion, others, source)
            if self._is_rotated_already(motion):
                continue
            # In a list, to be let go when the first step is done: records may be long.
            held = [motion]
            del motion
            yield self._processed(held, source)

    def check_choice(self) -> None:
        """See that no record was left out completely."""
        for record, name in self._left_out.items():
            if record not in self._kept:
                wanted = f"{', '.join(self._wanted())} that motions.processing chooses"
                raise RecordError(f"{name}: has none of the components {wanted}")

    def _wanted(self) -> tuple[str, ...]:
        chosen = (step.choose.components for step in self.steps if step.name == "choose")
        return next(chosen, ())

    def _chosen(self, motion: "Motion", source: "Source") -> bool:
        wanted = [code.upper() for code in self._wanted()]
        if not wanted:
            return True
        code = str(motion.metadata.get("component", "")).upper()
        facts = [str(motion.metadata.get(k) or "") for k in ("event", "station", "start_time")]
        record = tuple(facts) if any(facts) else source.path
        if code in wanted or code[-1:] in wanted:
            self._kept.add(record)
            return True
        self._left_out.setdefault(record, f"{source.path}: record {motion.id} ({code})")
        return False

    def _complete(
        self, motion: "Motion", motions: Sequence["Motion"], source: "Source"
    ) -> "Motion":
        """The motion with the components asked for and without the others."""
        from archfrag.motions.partners import other_horizontal, with_across, with_vertical
        from archfrag.motions.read import read_vertical

        alone = motion
        if not self.study.motions.vertical and motion.vertical is not None:
            labels = {**motion.metadata, "vertical_component": ""}
            motion = motion._replaced(
                vertical=None, metadata=labels, log=(*motion.log, "Vertical component left out.")
            )
        elif self.study.motions.vertical and motion.vertical is None:
            if source.upward is None:
                raise _lacks(source, motion, "vertical", "motions.vertical asks for it")
            row = source.entry or source
            upward = read_vertical(
                source.upward, row.unit, inventory=source.inventory, accept=row.accept
            )
            motion = with_vertical(motion, _as_listed(upward, source))
        if not self._pairs:
            return motion
        other = other_horizontal(alone, motions)
        if other is None and source.beside is not None:
            unit = (source.entry or source).unit
            beside = replace(source, path=source.beside, unit=unit, entry=None, name=None)
            found = _read(beside)
            other = found[0] if len(found) == 1 else None
        if other is None:
            both = "motions.processing or intensity.measure needs both"
            raise _lacks(source, motion, "other horizontal", both)
        motion = with_across(motion, _as_listed(other, source))
        return motion._replaced(metadata={**motion.metadata, "id_across": other.id})

    def _is_rotated_already(self, motion: "Motion") -> bool:
        """Whether the other component of a pair that is to be rotated came before."""
        if all(step.name != "rotate" for step in self.steps):
            return False
        about = motion.metadata
        file = str(about.get("file", ""))
        across = str(about.get("file_across", file)), str(about.get("component_across", ""))
        pair = frozenset(((file, str(about.get("component", ""))), across))
        known = pair in self._rotated
        self._rotated.add(pair)
        return known

    def _processed(self, held: list["Motion"], source: "Source") -> "Motion":
        motion = held.pop()
        for number, step in enumerate(self.steps):
            if step.name == "choose":
                text = f"Components {', '.join(self._wanted())} chosen."
                motion = motion._replaced(log=(*motion.log, text))
                continue
            try:
                motion = apply_step(step, motion, source.path, source.inventory)
            except InputError as error:
                key = f"motions.processing[{number}] ({step.name})"
                raise RecordError(f"{source.path}: {key}: {error}") from None
            if step.name == "rotate":
                motion = motion._replaced(id=_name_of_pair(motion))
        return motion


def _lacks(source: "Source", motion: "Motion", component: str, why: str) -> RecordError:
    return RecordError(
        f"{source.path}: record {motion.id} has no {component} component, and {why}. It must be "
        "in this file, in one whose name differs in the direction only (N and E; 090, 180 and "
        "UP), or in the one other row of an index with this event and station"
    )


def _as_listed(partner: "Motion", source: "Source") -> "Motion":
    """A component as it is named in the index, if a row of it names the record.

    Rows are paired by the index alone: what it calls event and station need not be the header's.
    """
    if source.entry is None:
        return partner
    unknown = dict.fromkeys(("event", "date", "station"), "")
    return partner._replaced(metadata={**partner.metadata, **unknown})


def _name_of_pair(motion: "Motion") -> str:
    one, other = motion.id, str(motion.metadata.get("id_across", ""))
    differ = (i for i, (a, b) in enumerate(zip(one, other)) if a != b)
    return one[: next(differ, len(one))].rstrip(" -+_.:") or f"{one}+{other}"


def _read(source: "Source") -> list["Motion"]:
    from archfrag.motions.read import load_motion, read_motions

    if source.entry is not None:
        return [load_motion(source.entry)]
    names = ("unit", "inventory", "accept", "columns", "name")
    return read_motions(source.path, **{name: getattr(source, name) for name in names})
