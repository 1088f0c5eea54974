"""Which stage of the solver is which step of the paper.

Where no eigenproblem is solved, the reflection and transmission of the layer, found with the beams in it, stand for the
homogeneous and the particular solution together, and joining for the boundary conditions.
"""

from collections.abc import Mapping

from vrte.studies.tables.paper import STEPS

ASSEMBLY, OTHER = "assembly", "other"
OWN_STEPS = (*STEPS, ASSEMBLY, OTHER)
WITHOUT_EIGENVECTORS = ("doubling", "invariance")
STEP_OF_STAGE = {
    **{name: name for name in (*STEPS, ASSEMBLY)},
    "fourier sum": "reconstruction",  # (1:12)
    "single scattering": "reconstruction",  # Q of (1:38)
    "joining": "boundary",
    **dict.fromkeys(WITHOUT_EIGENVECTORS, "homogeneous"),
}


def steps_of(seconds: float, stages: Mapping[str, float]) -> dict[str, float]:
    """Seconds of OWN_STEPS; what no step accounts for, planning and transfers among it, is OTHER.

    >>> steps_of(10.0, {"doubling": 4.0, "joining": 1.0, "fourier sum": 2.0, "planning": 1.0})["other"]
    3.0
    """
    found = dict.fromkeys(OWN_STEPS, 0.0)
    for stage, spent in stages.items():
        found[STEP_OF_STAGE.get(stage, OTHER)] += spent
    found[OTHER] += max(0.0, seconds - sum(stages.values()))
    return found


def has_no_eigenvectors(stages: Mapping[str, float]) -> bool:
    """Whether orders were solved by another algorithm than the paper's."""
    return any(stages.get(name, 0.0) > 0.0 for name in WITHOUT_EIGENVECTORS)
