"""All arches of a study: those of its entries, samples drawn for them, and rows of tables."""

import hashlib
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # whose parts are loaded when they are used
from numpy.typing import ArrayLike

from archfrag.arch.checks import FloatArray
from archfrag.errors import InputError, StabilityError
from archfrag.files import Named, number, read_text, stated_unit, table_of
from archfrag.properties import PROPERTIES, SPELLED, VARIABLE
from archfrag.simulation.arguments import check_can_run, check_method
from archfrag.simulation.simulate import onset
from archfrag.simulation.standing import check_stands, prestress_text
from archfrag.study.file.arches import COLUMNS, ArchEntry, JointScatter, Vary
from archfrag.study.keys import at, meant
from archfrag.study.provenance import SHOWN
from archfrag.study.yaml_text import parse_value

MOST_CHECKED = (
    500  # arches that are built to validate a study; a run builds all of them
)
MOST_MEMBERS = 20_000  # arches of a study; each sample counts
LARGEST_TABLE = 20_000_000  # [bytes]
_ALIKE = (
    0.85  # difflib's ratio to a key, from which the name of a column is a typing error
)


@dataclass(frozen=True)
class Member:
    """An arch of a study."""

    entry: ArchEntry  # the arch as a study file could have given it; its `id` is unique
    # Id of the study's entry that it was drawn for or listed in; its own id otherwise.
    arch_class: str
    place: str  # where it comes from and what was drawn for it, for messages
    # Numbers by which it differs within its class: drawn, or from a table [SI, degrees].
    values: dict[str, float] = field(default_factory=dict)
    attributes: dict[str, str] = field(default_factory=dict)  # text from a table
    row: str = ""  # id of its row, if the table is a sample of a larger stock
    shock: tuple[
        float, ...
    ] = ()  # level [SI] of a shock before each record, and gap [s]; empty without one

    @property
    def id(self) -> str:
        """Name of the arch in results."""
        return self.entry.id

    @property
    def intact(self) -> bool:
        """Whether nothing shakes it before its records."""
        return not self.shock

    @cached_property
    def chain(self) -> str:
        """SHA-256 of the arrays that the kernels get for this arch."""
        digest = hashlib.sha256()
        for name, value in self.entry.build().chain._asdict().items():
            array = np.ascontiguousarray(value, "<f8")
            digest.update(f"{name} {array.shape} ".encode() + array.tobytes())
        return digest.hexdigest()


Members = tuple[Member, ...]  # in the order of the study's entries


def checked(members: Members) -> Members:
    """Return the arches that a check of the study builds.

    They are all arches, or of very many at most `MOST_CHECKED` at equal distances in the list.
    """
    return members[:: -(-len(members) // MOST_CHECKED) or 1]


def shown(theta: Sequence[float]) -> list[int]:
    """Return the indices of the arches that a report shows one by one.

    `theta` are the median capacities, nan for an arch without a curve. Up to `SHOWN` arches all
    are shown; of more only the weakest, the middle and the strongest.
    """
    if len(theta) <= SHOWN:
        return list(range(len(theta)))
    order = np.argsort(np.asarray(theta, dtype=float), kind="stable")
    known = order[: max(1, int(np.isfinite(theta).sum()))]
    return sorted({int(known[0]), int(known[len(known) // 2]), int(known[-1])})


def expand(entries: Sequence[ArchEntry], shocks: Sequence[Any] = ()) -> Members:
    """Return all arches of the entries of a study file, intact and after each first shock.

    Each of `shocks` is a pair: the suffix of the names of arches after it, and their
    `Member.shock`. InputError if a table or drawing cannot be used, two arches have the same id,
    or there are too many.
    """
    found: list[Member] = []
    seen: dict[str, str] = {}
    for i, entry in enumerate(entries):
        where = f"arches[{i}] ({entry.id})"
        bases = list(_listed(entry, where))
        each = 1 if entry.vary is None else entry.vary.samples
        count = len(found) + each * len(bases) * (1 + len(shocks))
        if count > MOST_MEMBERS:
            raise InputError(
                f"{where}: makes {count} arches with those before it; a study must "
                f"have at most {MOST_MEMBERS}"
            )
        new = [member for base in bases for member in _drawn(base)]
        new += [
            replace(
                own,
                arch_class=own.arch_class + end,
                shock=shock,
                entry=own.entry.model_copy(update={"id": own.id + end}),
            )
            for end, shock in shocks
            for own in new
        ]
        names = dict.fromkeys(each.arch_class for each in new)
        own = (each.id for each in new if entry.table or each.id != each.arch_class)
        for name in (*names, *own):
            key = name.casefold()  # as some systems see names of files
            if key in seen:
                raise InputError(
                    f"{where}: the id {name!r} already belongs to {seen[key]} (small letters are "
                    "the same as capitals)"
                )
            seen[key] = where
        found += new
    return tuple(found)


def _listed(entry: ArchEntry, where: str) -> Iterator[Member]:
    """Yield the arch of an entry, or an arch for each row of its table.

    If a cell of the table is empty, the key of the entry holds. `where` names the entry in
    messages.
    """
    if entry.table is None:
        with at(where):
            entry = entry.read()
        yield Member(entry, entry.id, where)
        return
    place = f"{where}: {entry.table}"
    text = read_text(
        Path(entry.table), LARGEST_TABLE, InputError, f"{where}: the table"
    )
    with at(place):
        table = table_of(text)
        if "id" not in table or table.empty:
            raise InputError("must have arches and a column id")
        table.columns = table.columns.map(_key_or_attribute)
        for name in table.columns[table.columns.duplicated()]:
            raise InputError(f"column {name!r} is there twice, with a unit and without")
        for name in table["id"][table["id"].duplicated()]:
            raise InputError(f"several arches have the id {name!r}")
    keys = [name for name in map(str, table) if name in COLUMNS and name != "id"]
    for row in table.to_dict("records"):
        given: Named = {"id": row["id"]}
        for key in filter(row.get, keys):
            try:  # numbers as spreadsheets write them, such as 7.0 for 7
                value: Any = number(row[key])
            except ValueError:
                value = parse_value(row[key], f"{place}, column {key}")
            whole = isinstance(value, float) and value.is_integer()
            given[key] = int(value) if whole else value
        own = f"{place}, arch {row['id']}"
        arch = entry.varied(given, own, "table", "rows")
        # Of rows that leave a cell empty too: the study's entry gives what they have.
        numbers = {
            key: float(arch.value(key))
            for key in keys
            if key in ("voussoirs", "spans", *VARIABLE)
            and isinstance(arch.value(key), float | int)
        }
        attributes = {str(key): text for key, text in row.items() if key not in COLUMNS}
        sampled = row["id"] if entry.rows == "sample" else ""
        yield Member(arch, entry.id, own, numbers, attributes, sampled)


def _key_or_attribute(column: str) -> str:
    """Return the key that a column of a table holds, or its name if it is an attribute.

    The key is returned without its unit. InputError if the column states another unit than the key
    has, if an attribute has a unit, or if its name is so close to a key that this may be meant.
    """
    name, unit = stated_unit(column)
    if name in COLUMNS:
        about = PROPERTIES.get(name)
        asked = "" if about is None or about.unit is None else SPELLED[about.unit][1]
        if unit is not None and re.sub(r"[\s^]", "", unit) not in asked.split():
            must = f"is in {asked.split()[0]}" if asked else "has no unit"
            raise InputError(
                f"column {column!r}: {name} {must}; change the numbers and the name"
            )
        return name
    block, dot, key = name.partition(".")
    hint = meant(name.lower(), COLUMNS, _ALIKE)
    if dot and block in COLUMNS:
        hint = f"a column {block} takes blocks such as {{{key}: 1.0}}"
    if hint or unit is not None:
        raise InputError(
            f"column {column} is not a key of an arch; {hint or 'is it an attribute?'} (an "
            "attribute has no unit, and a name less like a key)"
        )
    return column


def _drawn(base: Member) -> Iterator[Member]:
    """Yield the samples of an arch, or the arch itself if it does not vary.

    Keys are drawn by `sample`. What differs from joint to joint is drawn by plain random numbers:
    no design of a few points is even in as many coordinates as there are joints. These numbers are
    the same for the n-th sample of a seed, whatever the number of samples.
    """
    entry = base.entry
    vary = entry.vary
    if vary is None:
        yield base
        return
    seed = [vary.seed]
    # Rows are drawn independently, whatever other rows there are.
    if base.id != base.arch_class:
        seed.append(zlib.crc32(base.id.encode()))
    with at(base.place):
        n_joint = 0 if vary.each_joint is None else entry.build().n_joint
    values = sample(vary, seed)
    for i in range(vary.samples):
        given: Named = {"id": f"{base.id}-{i + 1:04d}"}
        own = dict(base.values)
        for key, distribution in vary.of.items():
            value = given[key] = float(values[key][i])
            if distribution.relative:
                given[key] = to_digits(np.multiply(entry.value(key), value)).tolist()
            many = isinstance(given[key], list)
            own[f"{key}_factor" if many else key] = value if many else given[key]
        if "embrace" in given and entry.joint_positions:
            # Joints in degrees keep their parts of an angle of embrace that varies.
            places = np.multiply(
                entry.joint_positions, given["embrace"] / entry.embrace
            )
            given["joint_positions"] = [*places[:-1].tolist(), given["embrace"]]
        if vary.each_joint is not None:
            # Zeros behind a seed are the same seed to numpy: 1 separates joints from keys.
            generator = np.random.default_rng([*seed, i, 1])
            given |= _of_each_joint(vary.each_joint, entry, given, n_joint, generator)
        told = ", ".join(f"{name} = {number:.6g}" for name, number in own.items())
        place = f"{base.place}: sample {i + 1} ({told or 'joints'})"
        yield replace(
            base, entry=entry.varied(given, place, "vary"), place=place, values=own
        )


def _of_each_joint(
    scatter: JointScatter,
    entry: ArchEntry,
    given: Mapping[str, Any],
    n_joint: int,
    generator: np.random.Generator,
) -> Named:
    """Draw the keys of a sample that differ from joint to joint, and return them.

    `given` are the keys that were drawn for the sample before; they replace those of `entry`. The
    keys returned are those of friction, joint_positions, recess.intrados and recess.extrados that
    scatter. Each is a list with a value for each joint.
    """
    keys: Named = {}
    # All are drawn, so that one key more leaves the others' numbers as they are.
    for name, distribution in scatter:
        points = _inside(generator.random(n_joint))
        if distribution is None:
            continue
        values = to_digits(distribution.quantile(points))
        if name == "friction":
            keys[name] = to_digits(
                np.asarray(given.get("friction", entry.friction)) * values
            ).tolist()
        elif name == "position":  # the springings stay where they are
            end = float(given.get("embrace", entry.embrace or 1.0))
            count = max(n_joint - 1, 1)
            step = end / count
            known = given.get("joint_positions", entry.joint_positions)
            places = known or [*(step * np.arange(count)), end]
            moved = np.asarray(places[1:-1]) + step * values[1:-1]
            inner = (float(f"{place:.12g}") for place in moved)
            keys["joint_positions"] = [float(places[0]), *inner, float(places[-1])]
        else:
            keys[name.replace("_", ".")] = values.tolist()
    return keys


def sample(vary: Vary, seed: Sequence[int]) -> dict[str, FloatArray]:
    """Sample the uncertain keys of an arch; return as many values of each as it has samples.

    Points fill the unit cube evenly (quasi-Monte Carlo). The quantile function of each
    distribution turns a coordinate into a value. Scheme sobol is Sobol's sequence, scrambled (Owen
    1998): the first samples of a longer design are those of a shorter one, and its one- and
    two-dimensional projections are even if the number of samples is a power of two. Scheme
    latin_hypercube (McKay, Beckman and Conover 1979) takes any number of samples: it cuts the
    range of every key into as many slices, and puts one sample in each.
    """
    generator = np.random.default_rng(seed)
    if not vary.of:
        return {}
    if vary.scheme == "sobol":
        points = scipy.stats.qmc.Sobol(
            len(vary.of), scramble=True, seed=generator
        ).random_base2((vary.samples - 1).bit_length())
    else:
        points = scipy.stats.qmc.LatinHypercube(len(vary.of), seed=generator).random(
            vary.samples
        )
    return {
        name: to_digits(law.quantile(x))
        for (name, law), x in zip(vary.of.items(), _inside(points).T)
    }


def _inside(points: FloatArray) -> FloatArray:
    """Move points off the faces of the unit cube, where quantiles may be infinite."""
    return np.clip(points, 2.0**-32, 1.0 - 2.0**-32)


def to_digits(values: ArrayLike) -> FloatArray:
    """Round values to ten significant digits, so that they are the same on every machine."""
    array = np.asarray(values, dtype=float)
    return np.array([float(f"{v:.10g}") for v in array.ravel()]).reshape(array.shape)


def check_buildable(given: Members) -> None:
    """Check that all arches can exist.

    InputError names the first that cannot. It is StabilityError if that arch does not stand with
    its joints.
    """
    for member in given:
        with at(f"{member.place}: cannot exist"):
            member.entry.build()


def check_standing(given: Members, method) -> None:
    """Check that all arches can exist, can be run by the study's method, and stand.

    `method` is the block of that name of the study. InputError if an arch cannot exist or cannot
    be run by it; StabilityError if it does not stand.
    """
    check_buildable(given)
    for member in given:
        arch = member.entry.build()
        with at(member.place):
            info = check_method(method.name)
            check_can_run(arch, info, method.wave_speed, method.bases)
            if not onset(arch).stands:
                why = (
                    "does not stand under its own weight; make it thicker, raise the "
                    "friction, or narrow the distributions of what varies"
                )
                raise StabilityError(prestress_text(arch) or why)
            check_stands(arch)
