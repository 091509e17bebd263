"""Methods that archfrag's own are compared with, registered when `archbench` is imported."""

from collections.abc import Callable
from importlib import import_module

from archfrag.methods.registry import FOLLOW, MethodInfo, Parameter, register


def _from(module: str) -> Callable[[], Callable]:
    return lambda: import_module(f"archbench.baselines.{module}").run


BASELINES = (
    MethodInfo(
        name="four_link",
        meaning=(
            "baseline: a linkage of one degree of freedom, its four hinges those of limit "
            "analysis, mirrored at every impact"
        ),
        parameters=(
            Parameter("rtol", "1", 1e-6, "relative error allowed between impacts"),
            FOLLOW,
        ),
        citation=(
            "Oppenheim 1992, Earthquake Engng Struct. Dyn. 21(11), 1005-1017; Clemente 1998, "
            "ibid. 27(5), 513-522; De Lorenzis, DeJong and Ochsendorf 2007, ibid. 36(14), "
            "2119-2136"
        ),
        load=_from("four_link"),
    ),
    MethodInfo(
        name="penalty",
        meaning=(
            "distinct elements: rigid voussoirs on penalty springs with Coulomb friction and "
            "Rayleigh or local damping, by explicit central differences"
        ),
        parameters=(
            Parameter("dt", "s", 1e-3, "largest time step; divided where the springs need it"),
            FOLLOW,
            Parameter("stiffness", "Pa/m", 1e10, "normal stiffness per joint area", 1e3, 1e16),
            Parameter("shear_ratio", "1", 0.4, "shear over normal stiffness", 1e-3, 10.0),
            Parameter(
                "damping_stiffness",
                "1",
                0.3,
                "stiffness-proportional damping: critical at the highest frequency is one",
                0.0,
                10.0,
            ),
            Parameter(
                "damping_mass",
                "1",
                0.0,
                "mass-proportional damping: critical at damping_frequency is one",
                0.0,
                10.0,
            ),
            Parameter("damping_frequency", "Hz", 1.0, "where damping_mass applies", 1e-3, 1e4),
            Parameter("local_damping", "1", 0.0, "Cundall's local damping coefficient", 0.0, 0.99),
            Parameter("step_fraction", "1", 0.25, "part of the critical step", 1e-3, 4.0),
            Parameter(
                "rounding",
                "1",
                1e-3,
                "slip over joint length in which a vertex passes another",
                1e-9,
                0.1,
            ),
        ),
        citation=(
            "Cundall and Strack 1979, Geotechnique 29(1), 47-65; Cundall 1988, Int. J. Rock Mech. "
            "Min. Sci. 25(3), 107-116; Lemos 2007, Int. J. Archit. Heritage 1(2), 190-213"
        ),
        load=_from("penalty"),
    ),
    MethodInfo(
        name="gauss_seidel",
        meaning=(
            "baseline: contact dynamics with two contacts a joint, solved by block Gauss-Seidel "
            "sweeps, as LMGC90 does"
        ),
        parameters=(
            Parameter("dt", "s", 1e-3, "time step", 1e-9),
            FOLLOW,
            Parameter(
                "sweep_tolerance",
                "1",
                1e-6,
                "relative change of the impulses in a sweep below which a step is solved",
                1e-15,
                1.0,
            ),
            Parameter("sweeps", "1", 25000, "largest number of sweeps in a step", 1, 1e9),
        ),
        citation=(
            "Moreau 1988, CISM 302, 1-82; Jean 1999, Comput. Methods Appl. Mech. Engrg. 177, "
            "235-257; Dubois, Acary and Jean 2018, C. R. Mecanique 346, 247-262"
        ),
        load=_from("gauss_seidel"),
    ),
    MethodInfo(
        name="quadratic_programme",
        meaning=(
            "baseline: each step a convex quadratic programme in the velocities, with associative "
            "friction"
        ),
        parameters=(
            Parameter("dt", "s", 1e-3, "time step", 1e-9),
            FOLLOW,
            Parameter(
                "solver_tolerance", "1", 1e-9, "accuracy asked of the solver, relative", 1e-12, 1.0
            ),
        ),
        citation=(
            "Loetstedt 1984, SIAM J. Sci. Stat. Comput. 5(2), 370-393; Glocker and Pfeiffer 1996, "
            "Multibody Dynamics with Unilateral Contacts; Anitescu and Potra 1997, Nonlinear "
            "Dynamics 14, 231-247"
        ),
        load=_from("quadratic_programme"),
        needs="piqp",
    ),
)
register(*BASELINES)
